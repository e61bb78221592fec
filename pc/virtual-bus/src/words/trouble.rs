//! What can break in a node, in words.
//!
//! In: what stands behind `fault NODE`. Out: a [`Trouble`] with its size. One table declares every
//! fault; help, the manual of the command line and the complaints are made of it.
//!
//! Left out: what it does to the node (`world/effects`); a node without power and cut wires, which
//! have words of their own.

use std::ops::RangeInclusive;

use sim::fault::{NodeFault, RateFault, SensorFault};
use sim::lis2dw12::Fault;

use super::reader::Reader;
use super::table::{Table, row};

/// A part of one node, broken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trouble {
    /// The part, or what connects it to the microcontroller.
    Part(Fault),
    /// The part loses its supply for a moment, and with it its set-up.
    BrownOut,
    /// The supply sags and breaks down from now on.
    Supply,
    /// The board has come loose: slope X and Y are off by so many g.
    Offset(f64),
    /// The memory takes no more records.
    Memory,
    /// On the way from the housing to the samples; one at a time.
    Sensor(SensorFault),
    /// With the node on the bus; one at a time.
    Node(NodeFault),
}

use Trouble::{Node, Part, Sensor};

/// Spikes in a second unless the word states how many.
const SPIKES_PER_S: f64 = 1.0;

/// A step that no part can have, and more than full scale of the default range.
const MG: RangeInclusive<f64> = -2000.0..=2000.0;

/// Every fault.
pub static FAULTS: Table<Trouble> = Table {
    what: "fault",
    before: "fault NODE ",
    rows: &[
        row(
            "fault NODE stuck",
            "the sensor's data line reads ones",
            |_| Ok(Part(Fault::MisoHigh)),
        ),
        row(
            "fault NODE silent",
            "the sensor's data line reads zeros",
            |_| Ok(Part(Fault::MisoLow)),
        ),
        row(
            "fault NODE spi",
            "the processor's SPI port reports errors",
            |_| Ok(Part(Fault::Bus)),
        ),
        row(
            "fault NODE reset-stuck",
            "a reset of the sensor never ends",
            |_| Ok(Part(Fault::ResetStuck)),
        ),
        row(
            "fault NODE brown-out [MS] (1 to 60000; no time: a moment)",
            "the sensor's supply is gone",
            |r| match r.optional(|r| r.number("ms", 1.0..=60_000.0))? {
                None => Ok(Trouble::BrownOut),
                Some(ms) => Ok(Sensor(SensorFault::BrownOut { s: ms / 1000.0 })),
            },
        ),
        row(
            "fault NODE supply",
            "the supply sags and breaks down, time and again",
            |_| Ok(Trouble::Supply),
        ),
        row(
            "fault NODE offset MG (-2000 to 2000)",
            "a loose board: x and y measure so much more",
            |r| Ok(Trouble::Offset(r.number("mg", MG)? / 1000.0)),
        ),
        row("fault NODE memory", "no more records can be stored", |_| {
            Ok(Trouble::Memory)
        }),
        row(
            "fault NODE bias AXIS MG (-2000 to 2000)",
            "a step of the zero-g offset",
            |r| {
                let (axis, mg) = (r.axis()?, r.number("mg", MG)?);
                Ok(Sensor(SensorFault::Bias { axis, mg }))
            },
        ),
        row(
            "fault NODE drift AXIS MG/S (-1000 to 1000)",
            "the zero-g offset grows",
            |r| {
                let (axis, mg_per_s) = (r.axis()?, r.number("mg/s", -1000.0..=1000.0)?);
                Ok(Sensor(SensorFault::Drift { axis, mg_per_s }))
            },
        ),
        row(
            "fault NODE gain AXIS PERCENT (-100 to 100)",
            "the sensitivity is another one",
            |r| {
                let (axis, percent) = (r.axis()?, r.number("%", -100.0..=100.0)?);
                let ratio = percent / 100.0;
                Ok(Sensor(SensorFault::Gain { axis, ratio }))
            },
        ),
        row(
            "fault NODE rate-bias AXIS DEG/S (-500 to 500)",
            "a step of the gyroscope's bias",
            |r| {
                let (axis, dps) = (r.axis()?, r.number("deg/s", -500.0..=500.0)?);
                Ok(Sensor(SensorFault::Gyroscope(RateFault::Bias {
                    axis,
                    dps,
                })))
            },
        ),
        row(
            "fault NODE rate-scale PERCENT (-100 to 100)",
            "the gyroscope's sensitivity is another one",
            |r| {
                let ratio = r.number("%", -100.0..=100.0)? / 100.0;
                Ok(Sensor(SensorFault::Gyroscope(RateFault::Scale { ratio })))
            },
        ),
        row(
            "fault NODE rate-frozen",
            "the gyroscope's code repeats for ever",
            |_| Ok(Sensor(SensorFault::Gyroscope(RateFault::Stuck))),
        ),
        row(
            "fault NODE frozen [AXIS] (no axis: all three)",
            "the sensor's code repeats for ever",
            |r| {
                let axis = r.optional(Reader::axis)?;
                Ok(Sensor(SensorFault::Stuck { axis }))
            },
        ),
        row(
            "fault NODE noise FACTOR (1 to 100)",
            "the sensor has so many times its noise",
            |r| {
                let factor = r.number("", 1.0..=100.0)?;
                Ok(Sensor(SensorFault::Noise { factor }))
            },
        ),
        row(
            "fault NODE spikes MG [PER-SECOND] (1 to 16000; 0.01 to 100, or 1)",
            "single samples are off",
            |r| {
                let g = r.number("mg", 1.0..=16_000.0)? / 1000.0;
                let per_s = r
                    .optional(|r| r.number("/s", 0.01..=100.0))?
                    .unwrap_or(SPIKES_PER_S);
                Ok(Sensor(SensorFault::Spikes { g, per_s }))
            },
        ),
        row(
            "fault NODE delay MS (1 to 10000)",
            "samples reach the code late",
            |r| {
                let s = r.number("ms", 1.0..=10_000.0)? / 1000.0;
                Ok(Sensor(SensorFault::Late { s }))
            },
        ),
        row("fault NODE loss SHARE (0 to 1)", "samples get lost", |r| {
            let share = r.share()?;
            Ok(Sensor(SensorFault::SampleLoss { share }))
        }),
        row(
            "fault NODE sag",
            "the supply sags: noise, and an offset that wanders",
            |_| Ok(Sensor(SensorFault::Sag)),
        ),
        row(
            "fault NODE thermometer DEGC (-100 to 100)",
            "the sensor's thermometer is off",
            |r| {
                let c = r.number("degC", -100.0..=100.0)?;
                Ok(Sensor(SensorFault::Thermometer { c }))
            },
        ),
        row(
            "fault NODE swapped",
            "the sensor's x and y are exchanged",
            |_| Ok(Sensor(SensorFault::SwappedAxes)),
        ),
        row(
            "fault NODE calibration",
            "a bit of the calibration in use flips",
            |_| Ok(Node(NodeFault::CorruptCalibration)),
        ),
        row(
            "fault NODE halted",
            "the node's code stands still until healed or reset",
            |_| Ok(Node(NodeFault::Halted)),
        ),
        row(
            "fault NODE frames-late MS (1 to 10000)",
            "the node sends late",
            |r| {
                let ms = r.number("ms", 1.0..=10_000.0)?.round() as u32;
                Ok(Node(NodeFault::LateFrames { ms }))
            },
        ),
        row(
            "fault NODE babble ID [SHARE] (0 to 7FF, hexadecimal; 0.01 to 1 of the time)",
            "the node floods the bus",
            |r| {
                let id = r.identifier()?;
                let share = r.optional(|r| r.number("", 0.01..=1.0))?.unwrap_or(1.0);
                Ok(Node(NodeFault::Babbling { id, share }))
            },
        ),
        row(
            "fault NODE bus-off",
            "every frame of the node is destroyed",
            |_| Ok(Node(NodeFault::BusOff)),
        ),
        row("fault NODE sync-lost", "the node receives no SYNC", |_| {
            Ok(Node(NodeFault::SyncLost))
        }),
    ],
};

/// Behind the list: what is common to the words of it.
pub const NOTE: &str = "  AXIS is x, y or z of the sensor. `brown-out MS` and from `bias` to \
                        `swapped` one at a time per sensor, and from `calibration` to \
                        `sync-lost` one per node: the next one takes its place.\n";

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str) -> Option<Trouble> {
        let words: Vec<_> = text.split(' ').map(str::to_owned).collect();
        FAULTS.read(&mut Reader::new(text, &words, 2)).ok()
    }

    #[test]
    fn every_fault_of_a_sensor_has_its_word() {
        use SensorFault as Fault;
        for (text, fault_of) in [
            ("brown-out 50ms", Fault::BrownOut { s: 0.05 }),
            ("bias x -10mg", Fault::Bias { axis: 0, mg: -10.0 }),
            (
                "drift z 0.2mg/s",
                Fault::Drift {
                    axis: 2,
                    mg_per_s: 0.2,
                },
            ),
            (
                "gain y -2%",
                Fault::Gain {
                    axis: 1,
                    ratio: -0.02,
                },
            ),
            ("frozen", Fault::Stuck { axis: None }),
            ("frozen y", Fault::Stuck { axis: Some(1) }),
            ("noise 3", Fault::Noise { factor: 3.0 }),
            ("spikes 200mg", Fault::Spikes { g: 0.2, per_s: 1.0 }),
            ("spikes 200 5", Fault::Spikes { g: 0.2, per_s: 5.0 }),
            ("delay 50ms", Fault::Late { s: 0.05 }),
            ("loss 0.1", Fault::SampleLoss { share: 0.1 }),
            ("sag", Fault::Sag),
            ("thermometer 5degC", Fault::Thermometer { c: 5.0 }),
            ("swapped", Fault::SwappedAxes),
        ] {
            assert_eq!(fault(text), Some(Trouble::Sensor(fault_of)), "{text}");
        }
    }

    #[test]
    fn every_fault_of_a_node_has_its_word() {
        use NodeFault as Fault;
        let babbling = |share| Fault::Babbling { id: 0x10, share };
        for (text, fault_of) in [
            ("calibration", Fault::CorruptCalibration),
            ("halted", Fault::Halted),
            ("frames-late 200ms", Fault::LateFrames { ms: 200 }),
            ("babble 010", babbling(1.0)),
            ("babble 0x10 0.3", babbling(0.3)),
            ("bus-off", Fault::BusOff),
            ("sync-lost", Fault::SyncLost),
        ] {
            assert_eq!(fault(text), Some(Trouble::Node(fault_of)), "{text}");
        }
    }

    #[test]
    fn every_name_of_the_list_is_read_and_every_size_has_its_bounds() {
        let sizes = ["", " x", " 1", " x 1"];
        for name in FAULTS.names() {
            let read = sizes
                .iter()
                .any(|size| fault(&format!("{name}{size}")).is_some());
            assert!(read, "{name}");
        }
        for text in [
            "bias w 1",
            "bias x 2001",
            "bias x 1deg",
            "bias 1 x",
            "drift x nan",
            "gain x 101",
            "frozen w",
            "noise 0.5",
            "spikes 0",
            "spikes 200 0",
            "delay 0",
            "loss 1.1",
            "frames-late 0",
            "babble 800",
            "babble 1 0",
            "brown-out 0",
            "sag 3",
        ] {
            assert_eq!(fault(text), None, "{text}");
        }
    }
}
