//! The kinds of what can happen, as they are counted per day.
//!
//! In: an EMCY code (docs/canopen.md), or what the log itself shows. Out: one of a few kinds that
//! a person can tell apart.

use codes::words;
use device::fault::Fault;

/// A kind of event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Kind {
    /// The state of the pair (2021h) went to a warning.
    Warning,
    /// The channels disagree, or paper mode's stop or physical fault.
    Disagreement,
    /// One channel, or both, were found faulty.
    Channel,
    /// A sensor: supply, bus, samples, noise.
    Sensor,
    /// A slope outside 2040h, a sensor beyond full scale or outside its temperatures.
    Range,
    /// Calibration, parameters, program.
    Memory,
    /// A safe state.
    Safety,
    /// The bus itself, told by a node.
    Bus,
    /// A code that is none of this instrument's.
    Foreign,
    /// A heartbeat that stayed away, by the log.
    Heartbeat,
    /// A boot-up after the first frame of the node.
    Restart,
}

/// Number of kinds.
pub const KINDS: usize = 11;

impl Kind {
    /// Every kind, in the order of their numbers.
    pub const ALL: [Self; KINDS] = [
        Self::Warning,
        Self::Disagreement,
        Self::Channel,
        Self::Sensor,
        Self::Range,
        Self::Memory,
        Self::Safety,
        Self::Bus,
        Self::Foreign,
        Self::Heartbeat,
        Self::Restart,
    ];

    /// What an EMCY code is about.
    pub fn of(code: u16) -> Self {
        match words::fault(code) {
            Some(fault) => Self::of_fault(fault),
            None if matches!(code, 0x8100..=0x82FF) => Self::Bus,
            None if matches!(code, 0x6101..=0x6105) => Self::Memory,
            None => Self::Foreign,
        }
    }

    const fn of_fault(fault: Fault) -> Self {
        match fault {
            Fault::StopMotion | Fault::PhysicalFault | Fault::Disagree | Fault::Unlike => {
                Self::Disagreement
            }
            Fault::OwnChannel | Fault::PeerChannel | Fault::NoChannel => Self::Channel,
            Fault::RangeX | Fault::RangeY | Fault::SensorOverRange | Fault::Temperature => {
                Self::Range
            }
            Fault::SensorSupply
            | Fault::SensorBus
            | Fault::SensorSilent
            | Fault::SensorStuck
            | Fault::SensorNoise
            | Fault::SensorSpikes
            | Fault::Thermometer
            | Fault::Biased => Self::Sensor,
            Fault::NotCalibrated | Fault::CalibrationRecord | Fault::Storage | Fault::Program => {
                Self::Memory
            }
            Fault::FailSafe => Self::Safety,
        }
    }

    /// The kind in a table.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Warning => "Warning",
            Self::Disagreement => "Channels disagree",
            Self::Channel => "Channel faulty",
            Self::Sensor => "Sensor",
            Self::Range => "Out of range",
            Self::Memory => "Memory",
            Self::Safety => "Safe state",
            Self::Bus => "Bus",
            Self::Foreign => "Foreign code",
            Self::Heartbeat => "Heartbeat lost",
            Self::Restart => "Restart",
        }
    }

    /// The kind in JSON.
    pub const fn key(self) -> &'static str {
        match self {
            Self::Warning => "warning",
            Self::Disagreement => "disagreement",
            Self::Channel => "channel",
            Self::Sensor => "sensor",
            Self::Range => "range",
            Self::Memory => "memory",
            Self::Safety => "safety",
            Self::Bus => "bus",
            Self::Foreign => "foreign",
            Self::Heartbeat => "heartbeat",
            Self::Restart => "restart",
        }
    }

    /// True for what the instrument is there to notice: all but what is part of the work, and
    /// what a node reports of its memory.
    pub const fn is_fault(self) -> bool {
        matches!(
            self,
            Self::Disagreement | Self::Channel | Self::Sensor | Self::Safety
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_stands_at_its_number_and_is_named_once() {
        for (number, kind) in Kind::ALL.into_iter().enumerate() {
            assert_eq!(kind as usize, number);
            let same = Kind::ALL
                .into_iter()
                .filter(|other| other.key() == kind.key());
            assert_eq!(same.count(), 1);
        }
    }

    #[test]
    fn no_fault_of_the_instrument_is_foreign() {
        for fault in Fault::ALL {
            assert_ne!(Kind::of(fault.report().0), Kind::Foreign, "{fault:?}");
        }
        assert_eq!(Kind::of(0x8130), Kind::Bus);
        assert_eq!(Kind::of(0x6104), Kind::Memory);
        assert_eq!(Kind::of(0x1234), Kind::Foreign);
    }
}
