//! What can break in a node, in words.
//!
//! In: what stands behind `fault NODE`. Out: a [`Trouble`] with its size. What it does is told in
//! one table, which `help`, the manual of the command line and the complaints are made of.
//!
//! Left out: what it does to the node (`stage`); a node without power and cut wires, which have
//! words of their own.

use std::ops::RangeInclusive;

use sim::fault::{NodeFault, SensorFault};

use super::words::{identifier, number};

/// A part of one node, broken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trouble {
    /// The data line from the part reads ones.
    Stuck,
    /// The data line from the part reads zeros: it does not answer.
    Silent,
    /// The microcontroller's SPI reports errors.
    Spi,
    /// A reset of the part does not end.
    ResetStuck,
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

/// Spikes in a second unless the word says how many.
const SPIKES_PER_S: f64 = 1.0;

/// The first word, how all of it is written, and what it does.
const FORMS: [(&str, &str, &str); 25] = [
    (
        "stuck",
        "fault NODE stuck",
        "the sensor's data line reads ones",
    ),
    (
        "silent",
        "fault NODE silent",
        "the sensor's data line reads zeros",
    ),
    (
        "spi",
        "fault NODE spi",
        "the processor's SPI port reports errors",
    ),
    (
        "reset-stuck",
        "fault NODE reset-stuck",
        "a reset of the sensor never ends",
    ),
    (
        "brown-out",
        "fault NODE brown-out [MS] (1 to 60000; no time: a moment)",
        "the sensor's supply is gone",
    ),
    (
        "supply",
        "fault NODE supply",
        "the supply sags and breaks down, time and again",
    ),
    (
        "offset",
        "fault NODE offset MG (-2000 to 2000)",
        "a loose board: x and y measure so much more",
    ),
    (
        "memory",
        "fault NODE memory",
        "no more records can be stored",
    ),
    (
        "bias",
        "fault NODE bias AXIS MG (-2000 to 2000)",
        "a step of the zero-g offset",
    ),
    (
        "drift",
        "fault NODE drift AXIS MG/S (-1000 to 1000)",
        "the zero-g offset grows",
    ),
    (
        "gain",
        "fault NODE gain AXIS PERCENT (-100 to 100)",
        "the sensitivity is another one",
    ),
    (
        "frozen",
        "fault NODE frozen [AXIS] (no axis: all three)",
        "the sensor's code repeats for ever",
    ),
    (
        "noise",
        "fault NODE noise FACTOR (1 to 100)",
        "the sensor has so many times its noise",
    ),
    (
        "spikes",
        "fault NODE spikes MG [PER-SECOND] (1 to 16000; 0.01 to 100, or 1)",
        "single samples are off",
    ),
    (
        "delay",
        "fault NODE delay MS (1 to 10000)",
        "samples reach the code late",
    ),
    ("loss", "fault NODE loss SHARE (0 to 1)", "samples get lost"),
    (
        "sag",
        "fault NODE sag",
        "the supply sags: noise, and an offset that wanders",
    ),
    (
        "thermometer",
        "fault NODE thermometer DEGC (-100 to 100)",
        "the sensor's thermometer is off",
    ),
    (
        "swapped",
        "fault NODE swapped",
        "the sensor's x and y are exchanged",
    ),
    (
        "calibration",
        "fault NODE calibration",
        "a bit of the calibration in use flips",
    ),
    (
        "halted",
        "fault NODE halted",
        "the node's code stands still until healed or reset",
    ),
    (
        "frames-late",
        "fault NODE frames-late MS (1 to 10000)",
        "the node sends late",
    ),
    (
        "babble",
        "fault NODE babble ID [SHARE] (0 to 7FF, hexadecimal; 0.01 to 1 of the time)",
        "the node floods the bus",
    ),
    (
        "bus-off",
        "fault NODE bus-off",
        "every frame of the node is destroyed",
    ),
    (
        "sync-lost",
        "fault NODE sync-lost",
        "the node receives no SYNC",
    ),
];

/// Behind the list: what is common to the words of it.
const NOTE: &str = "  AXIS is x, y or z of the sensor. `brown-out MS` and from `bias` to \
                    `swapped` one at a time per sensor, and from `calibration` to `sync-lost` \
                    one per node: the next one takes its place.\n";

/// How a fault is written; `None` when there is none of this name.
pub fn form(first: &str) -> Option<&'static str> {
    let row = FORMS.iter().find(|(word, ..)| *word == first);
    row.map(|(_, form, _)| *form)
}

/// The names of all faults.
pub fn names() -> impl Iterator<Item = &'static str> {
    FORMS.iter().map(|(word, ..)| *word)
}

/// The faults with their meaning, a line each.
pub fn help() -> String {
    let line = |(_, form, meaning): &(&str, &str, &str)| format!("  {form}: {meaning}\n");
    FORMS.iter().map(line).chain([NOTE.to_owned()]).collect()
}

/// Reads what stands behind `fault NODE`; `None` when it does not fit its [`form`].
pub fn read(what: &[&str]) -> Option<Trouble> {
    Some(match what {
        ["stuck"] => Trouble::Stuck,
        ["silent"] => Trouble::Silent,
        ["spi"] => Trouble::Spi,
        ["reset-stuck"] => Trouble::ResetStuck,
        ["brown-out"] => Trouble::BrownOut,
        ["supply"] => Trouble::Supply,
        ["memory"] => Trouble::Memory,
        ["offset", mg] => Trouble::Offset(number(mg, "mg", MG)? / 1000.0),
        _ => match sensor(what) {
            Some(fault) => Trouble::Sensor(fault),
            None => Trouble::Node(node(what)?),
        },
    })
}

/// A step that no part can have, and more than full scale of the default range.
const MG: RangeInclusive<f64> = -2000.0..=2000.0;

fn sensor(what: &[&str]) -> Option<SensorFault> {
    Some(match what {
        ["brown-out", ms] => SensorFault::BrownOut {
            s: number(ms, "ms", 1.0..=60_000.0)? / 1000.0,
        },
        ["bias", on, mg] => SensorFault::Bias {
            axis: axis(on)?,
            mg: number(mg, "mg", MG)?,
        },
        ["drift", on, speed] => SensorFault::Drift {
            axis: axis(on)?,
            mg_per_s: number(speed, "mg/s", -1000.0..=1000.0)?,
        },
        ["gain", on, percent] => SensorFault::Gain {
            axis: axis(on)?,
            ratio: number(percent, "%", -100.0..=100.0)? / 100.0,
        },
        ["frozen"] => SensorFault::Stuck { axis: None },
        ["frozen", on] => SensorFault::Stuck {
            axis: Some(axis(on)?),
        },
        ["noise", factor] => SensorFault::Noise {
            factor: number(factor, "", 1.0..=100.0)?,
        },
        ["spikes", mg] => spikes(mg, SPIKES_PER_S)?,
        ["spikes", mg, rate] => spikes(mg, number(rate, "/s", 0.01..=100.0)?)?,
        ["delay", ms] => SensorFault::Late {
            s: number(ms, "ms", 1.0..=10_000.0)? / 1000.0,
        },
        ["loss", share] => SensorFault::SampleLoss {
            share: number(share, "", 0.0..=1.0)?,
        },
        ["sag"] => SensorFault::Sag,
        ["thermometer", celsius] => SensorFault::Thermometer {
            c: number(celsius, "degC", -100.0..=100.0)?,
        },
        ["swapped"] => SensorFault::SwappedAxes,
        _ => return None,
    })
}

fn spikes(mg: &str, per_s: f64) -> Option<SensorFault> {
    let g = number(mg, "mg", 1.0..=16_000.0)? / 1000.0;
    Some(SensorFault::Spikes { g, per_s })
}

fn node(what: &[&str]) -> Option<NodeFault> {
    Some(match what {
        ["calibration"] => NodeFault::CorruptCalibration,
        ["halted"] => NodeFault::Halted,
        ["frames-late", ms] => NodeFault::LateFrames {
            ms: number(ms, "ms", 1.0..=10_000.0)?.round() as u32,
        },
        ["babble", id] => NodeFault::Babbling {
            id: identifier(id)?,
            share: 1.0,
        },
        ["babble", id, share] => NodeFault::Babbling {
            id: identifier(id)?,
            share: number(share, "", 0.01..=1.0)?,
        },
        ["bus-off"] => NodeFault::BusOff,
        ["sync-lost"] => NodeFault::SyncLost,
        _ => return None,
    })
}

fn axis(name: &str) -> Option<usize> {
    ["x", "y", "z"].iter().position(|axis| *axis == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str) -> Option<Trouble> {
        read(&text.split(' ').collect::<Vec<_>>())
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
    fn every_line_of_the_page_of_faults_has_its_word() {
        let faults = include_str!("../../../docs/faults.md");
        let page = include_str!("../../../docs/serve.md");
        let (_, table) = faults.split_once("### Digging").unwrap();
        let (table, _) = table.split_once("###").unwrap();
        let lines = table.lines().filter_map(|line| line.strip_prefix("| "));
        let names = lines.filter_map(|line| line.split(" | ").next());
        let mut found = 0;
        for name in names.filter(|name| !["fault", "none"].contains(name)) {
            let row = format!("\n| {} | `", name.trim_end_matches(" (bus)"));
            let (_, rest) = page.split_once(&row).expect(name);
            let (word, _) = rest.split_once('`').unwrap();
            let line = crate::words::read(word, 2);
            assert!(matches!(line, Ok(Some(_))), "{name}: {word}: {line:?}");
            found += 1;
        }
        assert_eq!(found, 29, "lines of the page");
    }

    #[test]
    fn every_name_of_the_list_is_read_and_every_size_has_its_bounds() {
        let sizes = ["", " x", " 1", " x 1"];
        for name in names() {
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
