//! The whole instrument with its sensors on a machine and a bus: every detector once with the
//! fault that it is for, named rightly by what a receiver on the bus sees.
//!
//! In: a calibrated pair, a scene, one fault on one channel. Out: states and EMCY of both
//! channels. The times are generous ones; `docs/faults.md` has those that were measured.

use sim::excavator::{ExcavatorSetup, Scene};
use sim::fault::{NodeFault, SensorFault};
use sim::trial::checks::detection::Blame;
use sim::trial::inject::{Injection, What};
use sim::trial::message::{Emergency, Message};
use sim::trial::pool::Pool;
use sim::trial::{Report, Setup, run};

use sim::bench::Mode;

/// When the fault begins: every baseline is known by then, s.
const FROM_S: f64 = 8.0;

/// EMCY: this channel is faulty, and the other one is.
const OWN_CHANNEL: u16 = 0xFF14;
const PEER_CHANNEL: u16 = 0xFF15;

fn pool() -> Pool {
    Pool::of(&[(Mode::Product, 0)]).expect("the bench commissions its first unit")
}

fn on(scene: Scene, seed: u64) -> Setup {
    Setup {
        machine: ExcavatorSetup {
            scene,
            ..ExcavatorSetup::NOMINAL
        },
        ..Setup::healthy(seed)
    }
}

/// What both channels report of a fault that lasts for `length_s`.
struct Outcome {
    report: Report,
    emergencies: Vec<(usize, Emergency)>,
}

fn outcome(pool: &Pool, setup: Setup, what: What, channel: usize, length_s: f64) -> Outcome {
    let setup = Setup {
        faults: vec![Injection {
            what,
            channel,
            from_s: FROM_S,
            until_s: FROM_S + length_s,
        }],
        ..setup
    };
    let mut emergencies = Vec::new();
    let report = run(&setup, pool, |seen| {
        if let Some((channel, Message::Emergency(emergency))) = seen.message {
            emergencies.push((channel, emergency));
        }
    });
    Outcome {
        report: report.expect("the unit is in the pool"),
        emergencies,
    }
}

impl Outcome {
    /// Whether a channel has sent this code with this blame, for one of these reasons.
    fn tells(&self, channel: usize, code: u16, blamed: u8, reasons: &[u8]) -> bool {
        self.emergencies.iter().any(|(by, e)| {
            let same = (*by, e.code, e.blamed) == (channel, code, blamed);
            same && reasons.contains(&e.reason)
        })
    }

    /// Nothing forbidden happened, and the faulty channel was named within the time.
    fn names_rightly(&self, within_s: f64, name: &str) {
        let detection = &self.report.detections[0];
        assert_eq!(self.report.violations, [], "{name}");
        assert_eq!(detection.blame(), Blame::Right, "{name}: {detection:?}");
        let named = detection.by.iter().filter_map(|found| found.named);
        let first_s = named.map(|(s, _)| s).fold(f64::INFINITY, f64::min);
        assert!(first_s <= within_s, "{name}: {first_s} s");
    }
}

/// A fault on either channel, with a reason that both channels have to give.
fn named(machine: &Setup, fault: SensorFault, reasons: &[u8], within_s: f64) {
    let pool = pool();
    let scene = machine.machine.scene;
    for channel in [0, 1] {
        let setup = machine.clone();
        let outcome = outcome(&pool, setup, What::Sensor(fault), channel, within_s + 1.0);
        let name = format!("{fault} on channel {channel}, {scene:?}");
        outcome.names_rightly(within_s, &name);
        let told = &outcome.emergencies;
        let by_itself = outcome.tells(channel, OWN_CHANNEL, 1, reasons);
        assert!(by_itself, "{name}: {told:X?}");
        let by_the_other = outcome.tells(1 - channel, PEER_CHANNEL, 2, reasons);
        assert!(by_the_other, "{name}: {told:X?}");
    }
}

/// Digging and standing, with the vibration of a machine at work and at idle.
fn scenes() -> [Setup; 2] {
    [on(Scene::Digging, 11), on(Scene::Standstill, 12)]
}

/// A machine that stands with its engine running smoothly.
fn quiet() -> Setup {
    let mut setup = on(Scene::Standstill, 13);
    setup.machine.rumble_g = 0.010;
    setup
}

#[test]
fn gravity_names_a_channel_whose_offset_moves_while_it_stands() {
    let drift = SensorFault::Drift {
        axis: 2,
        mg_per_s: 2.0,
    };
    named(&quiet(), drift, &[13], 10.0);
}

#[test]
fn a_step_of_the_offset_is_named_where_the_machine_stands() {
    // The step itself may pass for a spike, before gravity has been looked at.
    let step = SensorFault::Bias { axis: 2, mg: 50.0 };
    named(&quiet(), step, &[10, 11, 13], 3.0);
}

#[test]
fn a_step_of_the_offset_is_detected_at_once_and_never_blamed_on_the_other() {
    let pool = pool();
    for scene in [Scene::Digging, Scene::StopAndGo, Scene::Standstill] {
        for (channel, axis) in [(0, 0), (0, 2), (1, 1), (1, 2)] {
            let step = What::Sensor(SensorFault::Bias { axis, mg: 50.0 });
            let outcome = outcome(&pool, on(scene, 14), step, channel, 20.0);
            let detection = &outcome.report.detections[0];
            let name = format!("{scene:?}, channel {channel}, axis {axis}: {detection:?}");
            assert_eq!(outcome.report.violations, [], "{name}");
            assert_ne!(detection.blame(), Blame::Wrong, "{name}");
            assert!(detection.told_s().is_some_and(|s| s < 0.3), "{name}");
        }
    }
}

#[test]
fn codes_that_stand_still_name_their_channel() {
    for machine in scenes() {
        named(&machine, SensorFault::Stuck { axis: None }, &[9], 0.1);
        named(&machine, SensorFault::Stuck { axis: Some(1) }, &[9], 0.5);
    }
}

#[test]
fn noise_names_its_channel() {
    for machine in scenes() {
        named(&machine, SensorFault::Noise { factor: 3.0 }, &[10], 2.0);
    }
}

#[test]
fn spikes_name_their_channel() {
    // One that lies across two looks passes for noise.
    let spikes = SensorFault::Spikes { g: 0.5, per_s: 2.0 };
    for machine in scenes() {
        named(&machine, spikes, &[10, 11], 3.0);
    }
}

#[test]
fn a_brown_out_names_its_channel_and_its_cause() {
    let pool = pool();
    for machine in scenes() {
        for channel in [0, 1] {
            let brown_out = What::Sensor(SensorFault::BrownOut { s: 0.02 });
            let outcome = outcome(&pool, machine.clone(), brown_out, channel, 1.0);
            outcome.names_rightly(0.1, &format!("brown-out on channel {channel}"));
            let told = outcome.emergencies.iter();
            let of_the_supply = |(by, e): &(usize, Emergency)| (*by, e.code) == (channel, 0x3200);
            assert_eq!(told.filter(|one| of_the_supply(one)).count(), 1);
            // Its samples are missed first, and what it is comes after.
            assert!(outcome.tells(1 - channel, PEER_CHANNEL, 2, &[3, 7]));
        }
    }
}

#[test]
fn a_sagging_supply_names_its_channel() {
    let pool = pool();
    for scene in [Scene::Digging, Scene::Standstill] {
        for channel in [0, 1] {
            let setup = on(scene, 21 + channel as u64);
            let sag = What::Sensor(SensorFault::Sag);
            let outcome = outcome(&pool, setup, sag, channel, 10.0);
            outcome.names_rightly(9.0, &format!("sag on channel {channel}, {scene:?}"));
        }
    }
}

#[test]
fn a_calibration_that_changes_in_memory_names_its_channel() {
    let pool = pool();
    for channel in [0, 1] {
        let setup = on(Scene::Digging, 31);
        let flip = What::Node(NodeFault::CorruptCalibration);
        let outcome = outcome(&pool, setup, flip, channel, 1.0);
        outcome.names_rightly(0.5, "calibration");
        let told = outcome
            .emergencies
            .iter()
            .any(|(by, e)| (*by, e.code) == (channel, 0xFF21));
        assert!(told, "{:X?}", outcome.emergencies);
    }
}

#[test]
fn a_channel_without_power_is_named_by_the_other_one() {
    let pool = pool();
    for channel in [0, 1] {
        let silent = What::Node(NodeFault::Silent);
        let outcome = outcome(&pool, on(Scene::Digging, 41), silent, channel, 2.0);
        outcome.names_rightly(0.3, "silent");
        assert!(outcome.tells(1 - channel, PEER_CHANNEL, 2, &[15]));
    }
}

#[test]
fn a_bus_that_fails_never_makes_a_wrong_angle_valid() {
    let pool = pool();
    let faults = [
        (NodeFault::BusOff, true),
        (NodeFault::SyncLost, true),
        (NodeFault::LateFrames { ms: 50 }, true),
        // Nothing else gets through, nor does the word of it.
        (
            NodeFault::Babbling {
                id: 0x10,
                share: 1.0,
            },
            false,
        ),
    ];
    for (fault, is_told) in faults {
        let outcome = outcome(&pool, on(Scene::Digging, 51), What::Node(fault), 1, 3.0);
        assert_eq!(outcome.report.violations, [], "{fault}");
        let told = outcome.report.detections[0].told_s().is_some();
        assert_eq!(told, is_told, "{fault}");
    }
}

/// On a machine that moves: what goes out when a flood of 4 s ends is of then, not of before.
#[test]
fn frames_of_before_a_flood_went_out_after_it() {
    let pool = pool();
    for (channel, id, seed) in [(0, 0x10, 71), (1, 0x10, 72), (0, 0x17F, 73), (1, 0x17F, 74)] {
        let flood = NodeFault::Babbling { id, share: 1.0 };
        let until_s = FROM_S + 4.0;
        let setup = Setup {
            safety_frames: true,
            faults: vec![Injection {
                what: What::Node(flood),
                channel,
                from_s: FROM_S,
                until_s,
            }],
            ..on(Scene::Digging, seed)
        };
        let mut slopes = 0;
        // A safety frame is sent without a SYNC: it is up to 35 ms older than the angle of a TPDO.
        let mut lately = std::collections::VecDeque::new();
        let report = run(&setup, &pool, |seen| {
            let after_s = seen.event.at_ns() as f64 * 1e-9 - until_s;
            let Some(truth) = seen.truth_deg.filter(|_| after_s > -0.1) else {
                return;
            };
            lately.push_back((after_s, truth));
            lately.retain(|(at_s, _)| after_s - at_s < 0.035);
            let Some((by, message)) = seen.message.filter(|_| (0.0..0.1).contains(&after_s)) else {
                return;
            };
            let name = format!("{after_s:.4} s after {id:X}h, channel {by}: {message:?}");
            let near = |deg: Option<f64>, truth: f64| deg.is_none_or(|d| (d - truth).abs() <= 1.0);
            let right =
                |deg: [Option<f64>; 2], [x, y]: [f64; 2]| near(deg[0], x) && near(deg[1], y);
            let is_of_now = match message {
                Message::Safety(deg) => {
                    let deg = deg.map(Some);
                    lately.iter().any(|(_, truth)| right(deg, *truth))
                }
                Message::Slopes(told) => {
                    slopes += 1;
                    right(told.deg, truth)
                }
                _ => return,
            };
            assert!(is_of_now, "{name}, {truth:?}");
        });
        assert_eq!(report.expect("the unit is in the pool").violations, []);
        assert!(slopes > 4, "{slopes}");
    }
}

#[test]
fn a_healthy_pair_is_accused_of_nothing_in_any_scene() {
    let pool = pool();
    for scene in [Scene::Digging, Scene::StopAndGo, Scene::Standstill] {
        for degrees in [-30.0, 25.0, 70.0] {
            let setup = Setup {
                safety_s: 60.0,
                start_c: degrees,
                ..on(scene, 61)
            };
            let report = run(&setup, &pool, |_| {}).expect("the unit is in the pool");
            assert_eq!(report.violations, [], "{scene:?} at {degrees} degC");
        }
    }
}
