//! The short names that faults have in tables.
//!
//! In: a fault. Out: a few words with its size and unit, without the axis.

use std::fmt::{Display, Formatter, Result};

use super::{NodeFault, RateFault, SensorFault};

/// A number without the digits that only binary fractions have.
fn short(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

impl Display for SensorFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match *self {
            Self::Bias { mg, .. } => write!(f, "bias step {} mg", short(mg)),
            Self::Drift { mg_per_s, .. } => write!(f, "drift {} mg/s", short(mg_per_s)),
            Self::Gain { ratio, .. } => write!(f, "gain {:+} %", short(ratio * 100.0)),
            Self::Stuck { axis: Some(_) } => f.write_str("stuck, one axis"),
            Self::Stuck { axis: None } => f.write_str("stuck, all"),
            Self::Noise { factor } => write!(f, "noise x{}", short(factor)),
            Self::Spikes { g, .. } => write!(f, "spikes {} mg", short(g * 1000.0)),
            Self::Late { s } => write!(f, "delay {} ms", short(s * 1000.0)),
            Self::SampleLoss { share } => write!(f, "sample loss {} %", short(share * 100.0)),
            Self::BrownOut { .. } => f.write_str("brown-out"),
            Self::Sag => f.write_str("sag"),
            Self::Thermometer { c } => write!(f, "thermometer {:+} degC", short(c)),
            Self::SwappedAxes => f.write_str("swapped axes"),
            Self::Gyroscope(fault) => write!(f, "gyroscope, {fault}"),
        }
    }
}

impl Display for RateFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match *self {
            Self::Bias { dps, .. } => write!(f, "bias step {} deg/s", short(dps)),
            Self::Scale { ratio } => write!(f, "scale {:+} %", short(ratio * 100.0)),
            Self::Stuck => f.write_str("stuck"),
            Self::Noise { factor } => write!(f, "noise x{}", short(factor)),
            Self::SwappedAxes => f.write_str("swapped axes"),
        }
    }
}

impl Display for NodeFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match *self {
            Self::Silent => f.write_str("silent"),
            Self::Halted => f.write_str("halted"),
            Self::LateFrames { ms } => write!(f, "frames {ms} ms late"),
            Self::Babbling { share, .. } if share < 1.0 => {
                write!(f, "babbling {} %", short(share * 100.0))
            }
            Self::Babbling { .. } => f.write_str("babbling"),
            Self::BusOff => f.write_str("bus-off"),
            Self::SyncLost => f.write_str("SYNC lost"),
            Self::CorruptCalibration => f.write_str("calibration corrupted"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_names_are_those_of_the_tables() {
        let axis = 0;
        for (fault, name) in [
            (SensorFault::Bias { axis, mg: 5.0 }, "bias step 5 mg"),
            (
                SensorFault::Drift {
                    axis,
                    mg_per_s: 0.2,
                },
                "drift 0.2 mg/s",
            ),
            (SensorFault::Gain { axis, ratio: -0.02 }, "gain -2 %"),
            (SensorFault::Stuck { axis: Some(2) }, "stuck, one axis"),
            (SensorFault::Stuck { axis: None }, "stuck, all"),
            (SensorFault::Noise { factor: 3.0 }, "noise x3"),
            (SensorFault::Spikes { g: 0.2, per_s: 1.0 }, "spikes 200 mg"),
            (SensorFault::Late { s: 0.05 }, "delay 50 ms"),
            (SensorFault::SampleLoss { share: 0.1 }, "sample loss 10 %"),
            (SensorFault::BrownOut { s: 0.01 }, "brown-out"),
            (SensorFault::Sag, "sag"),
            (SensorFault::Thermometer { c: 5.0 }, "thermometer +5 degC"),
            (SensorFault::SwappedAxes, "swapped axes"),
            (
                SensorFault::Gyroscope(RateFault::Scale { ratio: 0.05 }),
                "gyroscope, scale +5 %",
            ),
            (
                SensorFault::Gyroscope(RateFault::Bias { axis, dps: 0.5 }),
                "gyroscope, bias step 0.5 deg/s",
            ),
        ] {
            assert_eq!(fault.to_string(), name);
        }
        let babbling = |share| NodeFault::Babbling { id: 1, share };
        for (fault, name) in [
            (NodeFault::Silent, "silent"),
            (NodeFault::Halted, "halted"),
            (NodeFault::LateFrames { ms: 200 }, "frames 200 ms late"),
            (babbling(1.0), "babbling"),
            (babbling(0.3), "babbling 30 %"),
            (NodeFault::BusOff, "bus-off"),
            (NodeFault::SyncLost, "SYNC lost"),
            (NodeFault::CorruptCalibration, "calibration corrupted"),
        ] {
            assert_eq!(fault.to_string(), name);
        }
    }
}
