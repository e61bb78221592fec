//! A trial from a seed: every option drawn, each from a stream of its own.
//!
//! In: a seed. Out: a [`Setup`]. One seed in [`BEYOND_ONE_IN`] goes beyond the promise: both
//! channels are faulty at once, and only a wrong angle marked valid counts. One product within it
//! in [`MAINTAINED_ONE_IN`] is maintained meanwhile: [`service`].
//!
//! Left out: other node-ids than 1 and 2.

mod service;

use crate::bench::Mode;
use crate::can_bus::Rates;
use crate::excavator::{ExcavatorSetup, Scene};
use crate::fault::{NodeFault, RateFault, SensorFault};
use crate::rng::Rng;
use crate::trial::inject::{Injection, What};
use crate::trial::sabotage::Sabotage;
use crate::trial::{CHANNELS, LOOK_AFTER_S, Setup};

/// Units that trials are drawn from, of each mode.
pub const UNITS: u32 = 4;
/// One seed in so many goes beyond the promise.
pub const BEYOND_ONE_IN: u32 = 8;
/// One seed within the promise in so many is of an instrument in paper mode.
const PAPER_ONE_IN: u32 = 8;
/// One product within the promise in so many is maintained while its fault stands.
pub const MAINTAINED_ONE_IN: u32 = 3;
/// One seed in so many has no fault at all.
const HEALTHY_ONE_IN: u32 = 6;

/// One fault of a sensor in so many is of its gyroscope, where it has one.
const OF_GYROSCOPE_ONE_IN: u32 = 3;

/// When the first fault begins, s: the instrument is in order by then.
const FIRST_S: (f64, f64) = (6.0, 10.0);
/// How long a fault lasts, s.
const LASTS_S: (f64, f64) = (3.0, 12.0);
/// From the look after a fault to the next one, s.
const BETWEEN_S: (f64, f64) = (5.5, 9.0);

fn stream(seed: u64, label: &str) -> Rng {
    Rng::stream(seed, &format!("campaign {label}"))
}

/// A whole number below `count`.
fn below(rng: &mut Rng, count: u32) -> u32 {
    ((rng.uniform() * f64::from(count)) as u32).min(count.saturating_sub(1))
}

fn one_in(rng: &mut Rng, count: u32) -> bool {
    below(rng, count) == 0
}

fn any<T: Copy, const N: usize>(rng: &mut Rng, of: [T; N]) -> T {
    of[below(rng, N as u32) as usize]
}

/// Any size between the two, each order of magnitude alike.
fn logarithmic(rng: &mut Rng, low: f64, high: f64) -> f64 {
    rng.range(low.ln(), high.ln()).exp()
}

/// The trial of a seed.
pub fn draw(seed: u64) -> Setup {
    let beyond = one_in(&mut stream(seed, "promise"), BEYOND_ONE_IN);
    let mut instrument = stream(seed, "instrument");
    let paper = !beyond && one_in(&mut instrument, PAPER_ONE_IN);
    let maintained = !beyond && !paper && one_in(&mut stream(seed, "service"), MAINTAINED_ONE_IN);
    let (latch_s, degraded) = policy(seed, beyond);
    let (faults, maintenance) = if maintained {
        service::draw(seed)
    } else {
        (faults(seed, beyond, f64::from(latch_s)), Vec::new())
    };
    let (start_c, ramp_c_per_min) = temperature(seed);
    let (kbit_s, sync_us, host_clock_ppm) = bus(seed);
    Setup {
        seed,
        mode: if paper { Mode::Paper } else { Mode::Product },
        unit: below(&mut instrument, UNITS),
        power_cycles: below(&mut instrument, 16),
        machine: machine(seed),
        kbit_s,
        sync_us,
        host_clock_ppm,
        start_c,
        ramp_c_per_min,
        latch_s,
        degraded,
        safety_frames: !paper && one_in(&mut stream(seed, "safety frames"), 2),
        rates: rates(seed),
        safety_s: stream(seed, "length").range(10.0, 30.0),
        faults,
        maintenance,
        within_promise: !beyond,
        sabotage: Sabotage::None,
    }
}

/// The same trial with a gyroscope in the product: its promise is the product's, with the angle as
/// right as it states ([`COVERAGE`](crate::trial::checks::COVERAGE)). One fault of a sensor in
/// three is one of the gyroscope instead.
pub fn draw_with_gyroscope(seed: u64) -> Setup {
    let mut setup = draw(seed);
    if setup.mode != Mode::Product {
        return setup;
    }
    setup.mode = Mode::Dynamic;
    let mut rng = stream(seed, "gyroscope");
    for injection in &mut setup.faults {
        let of_sensor = matches!(injection.what, What::Sensor(_));
        if of_sensor && one_in(&mut rng, OF_GYROSCOPE_ONE_IN) {
            let fault = rate_fault(&mut rng);
            injection.what = What::Sensor(SensorFault::Gyroscope(fault));
        }
    }
    setup
}

fn rate_fault(rng: &mut Rng) -> RateFault {
    let axis = below(rng, 3) as usize;
    let sign = rng.sign();
    match below(rng, 5) {
        0 => RateFault::Stuck,
        1 => RateFault::Noise {
            factor: any(rng, [3.0, 10.0]),
        },
        2 => RateFault::Bias {
            axis,
            dps: sign * any(rng, [0.5, 2.0, 10.0]),
        },
        3 => RateFault::Scale {
            ratio: sign * any(rng, [0.02, 0.05, 0.2]),
        },
        _ => RateFault::SwappedAxes,
    }
}

fn machine(seed: u64) -> ExcavatorSetup {
    let mut rng = stream(seed, "machine");
    let scenes = [Scene::Digging, Scene::StopAndGo, Scene::Standstill];
    let strikes = !one_in(&mut rng, 3);
    let slews = one_in(&mut stream(seed, "slew"), 3);
    ExcavatorSetup {
        scene: any(&mut rng, scenes),
        slew_deg: if slews {
            ExcavatorSetup::SLEWING.slew_deg
        } else {
            (0.0, 0.0)
        },
        lever_arm_m: rng.range(0.0, 1.5),
        sway_deg: rng.range(0.0, 5.0),
        rumble_g: rng.range(0.0, 0.030),
        engine_g: rng.range(0.0, 0.050),
        shock_g: if strikes { (1.0, 5.0) } else { (0.0, 0.0) },
    }
}

fn bus(seed: u64) -> (u16, u32, f64) {
    let mut rng = stream(seed, "bus");
    let kbit_s = any(&mut rng, [125, 250, 500, 800, 1000]);
    let sync_us = match below(&mut rng, 3) {
        0 => 20_000,
        1 => any(&mut rng, [10_000, 25_000, 50_000]),
        _ => rng.range(10_000.0, 50_000.0) as u32,
    };
    (kbit_s, sync_us, rng.range(-100.0, 100.0))
}

/// Latch time, s, and whether a channel may go on alone. With both channels faulty at once it may
/// not: what is left alone has nobody to be compared with.
fn policy(seed: u64, beyond: bool) -> (u16, bool) {
    let mut rng = stream(seed, "policy");
    let until_reset = one_in(&mut rng, 2);
    let seconds = 1 + below(&mut rng, 5) as u16;
    let alone = one_in(&mut rng, 2);
    (if until_reset { 0 } else { seconds }, alone && !beyond)
}

fn rates(seed: u64) -> Rates {
    let mut rng = stream(seed, "frames");
    let rate = |rng: &mut Rng| {
        let rate = logarithmic(rng, 1e-5, 3e-3);
        if one_in(rng, 2) { rate } else { 0.0 }
    };
    if one_in(&mut rng, 2) {
        return Rates::default();
    }
    Rates {
        corrupt: rate(&mut rng),
        local: rate(&mut rng),
        last_but_one: rate(&mut rng),
        overrun: rate(&mut rng),
    }
}

/// Start, degC, and ramp, K/min; both dies stay within the calibrated -10 to 70 degC.
fn temperature(seed: u64) -> (f64, f64) {
    let mut rng = stream(seed, "temperature");
    let start_c = rng.range(-3.0, 63.0);
    let ramp = rng.range(-5.0, 5.0);
    let steady = one_in(&mut rng, 2);
    (start_c, if steady { 0.0 } else { ramp })
}

fn faults(seed: u64, beyond: bool, latch_s: f64) -> Vec<Injection> {
    let mut rng = stream(seed, "faults");
    if beyond {
        return both_at_once(&mut rng);
    }
    if one_in(&mut rng, HEALTHY_ONE_IN) {
        return Vec::new();
    }
    let count = 1 + below(&mut rng, 2);
    let mut from_s = rng.range(FIRST_S.0, FIRST_S.1);
    let mut faults = Vec::new();
    for _ in 0..count {
        let until_s = from_s + rng.range(LASTS_S.0, LASTS_S.1);
        faults.push(Injection {
            what: what(&mut rng),
            channel: below(&mut rng, CHANNELS as u32) as usize,
            from_s,
            until_s,
        });
        from_s = until_s + LOOK_AFTER_S + latch_s + rng.range(BETWEEN_S.0, BETWEEN_S.1);
    }
    faults
}

/// Two faults of different kinds, one on each channel, that overlap.
fn both_at_once(rng: &mut Rng) -> Vec<Injection> {
    let first = what(rng);
    let second = loop {
        let other = what(rng);
        if !same_kind(&first, &other) {
            break other;
        }
    };
    let from_s = rng.range(FIRST_S.0, FIRST_S.1);
    let until_s = from_s + rng.range(LASTS_S.0, LASTS_S.1);
    let channel = below(rng, CHANNELS as u32) as usize;
    let later_s = rng.range(from_s, until_s);
    let longer_s = until_s + rng.range(0.0, LASTS_S.0);
    let injection = |what, channel, from_s, until_s| Injection {
        what,
        channel,
        from_s,
        until_s,
    };
    vec![
        injection(first, channel, from_s, until_s),
        injection(second, 1 - channel, later_s, longer_s),
    ]
}

/// Two faults of one kind may cancel each other out, which no comparison can see; so may a step of
/// one channel and the drift of the other.
fn same_kind(a: &What, b: &What) -> bool {
    use std::mem::discriminant;
    let shifts = |fault: &SensorFault| {
        use SensorFault::{Bias, Drift, Gain};
        matches!(fault, Bias { .. } | Drift { .. } | Gain { .. })
    };
    match (a, b) {
        (What::Sensor(a), What::Sensor(b)) if shifts(a) && shifts(b) => true,
        (What::Sensor(a), What::Sensor(b)) => discriminant(a) == discriminant(b),
        (What::Node(a), What::Node(b)) => discriminant(a) == discriminant(b),
        _ => false,
    }
}

fn what(rng: &mut Rng) -> What {
    if one_in(rng, 4) {
        What::Node(node_fault(rng))
    } else {
        What::Sensor(sensor_fault(rng))
    }
}

fn sensor_fault(rng: &mut Rng) -> SensorFault {
    let axis = below(rng, 3) as usize;
    let sign = rng.sign();
    match below(rng, 12) {
        0 => SensorFault::Bias {
            axis,
            mg: sign * any(rng, [5.0, 10.0, 20.0, 50.0, 200.0]),
        },
        1 => SensorFault::Drift {
            axis,
            mg_per_s: sign * any(rng, [0.2, 2.0, 10.0]),
        },
        2 => SensorFault::Gain {
            axis,
            ratio: sign * any(rng, [0.02, 0.05, 0.2]),
        },
        3 => SensorFault::Stuck {
            axis: (!one_in(rng, 2)).then_some(axis),
        },
        4 => SensorFault::Noise {
            factor: any(rng, [3.0, 10.0]),
        },
        5 => SensorFault::Spikes {
            g: any(rng, [0.2, 0.5, 1.0]),
            per_s: any(rng, [1.0, 5.0, 20.0]),
        },
        6 => SensorFault::Late {
            s: any(rng, [0.05, 0.2]),
        },
        7 => SensorFault::SampleLoss {
            share: any(rng, [0.1, 0.5, 1.0]),
        },
        8 => SensorFault::BrownOut {
            s: any(rng, [0.005, 0.1, 1.0]),
        },
        9 => SensorFault::Sag,
        10 => SensorFault::Thermometer {
            c: sign * any(rng, [5.0, 20.0]),
        },
        _ => SensorFault::SwappedAxes,
    }
}

fn node_fault(rng: &mut Rng) -> NodeFault {
    match below(rng, 7) {
        0 => NodeFault::Silent,
        1 => NodeFault::Halted,
        2 => NodeFault::LateFrames {
            ms: any(rng, [5, 50, 200]),
        },
        // Identifiers that nobody owns: one that somebody owns would be another's word.
        3 => NodeFault::Babbling {
            id: any(rng, [0x001, 0x07F, 0x0FF, 0x17F]),
            share: any(rng, [0.3, 0.9, 1.0]),
        },
        4 => NodeFault::BusOff,
        5 => NodeFault::SyncLost,
        _ => NodeFault::CorruptCalibration,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_seed_draws_one_trial() {
        assert_eq!(draw(7), draw(7));
        assert_ne!(draw(7).to_string(), draw(8).to_string());
    }

    #[test]
    fn faults_follow_each_other_within_the_promise() {
        let alone = |setup: &Setup| setup.within_promise && setup.maintenance.is_empty();
        for setup in (1..500).map(draw).filter(alone) {
            for pair in setup.faults.windows(2) {
                assert!(pair[1].from_s > pair[0].until_s + LOOK_AFTER_S + 5.0);
            }
            let last_s = setup.faults.last().map_or(0.0, |f| f.until_s);
            assert!(last_s < 70.0, "{setup}");
        }
    }

    #[test]
    fn beyond_the_promise_both_channels_are_faulty_at_once_by_different_faults() {
        let beyond: Vec<_> = (1..500).map(draw).filter(|s| !s.within_promise).collect();
        assert!((30..100).contains(&beyond.len()), "{}", beyond.len());
        for setup in beyond {
            let [a, b] = setup.faults[..] else {
                panic!("{setup}")
            };
            assert_ne!(a.channel, b.channel);
            assert!(b.from_s < a.until_s && !same_kind(&a.what, &b.what));
        }
    }

    #[test]
    fn a_drift_that_met_the_others_step_made_both_wrong_alike() {
        let drift = |mg_per_s| What::Sensor(SensorFault::Drift { axis: 0, mg_per_s });
        let step = What::Sensor(SensorFault::Bias { axis: 0, mg: -20.0 });
        assert!(same_kind(&drift(-10.0), &step));
        assert!(!same_kind(&drift(-10.0), &What::Sensor(SensorFault::Sag)));
    }

    #[test]
    fn every_kind_of_maintenance_comes_up_before_in_and_after_every_kind_of_fault() {
        let mut kinds = std::collections::BTreeSet::new();
        let mut moments = [0; 3];
        for setup in (1..3000).map(draw) {
            for work in &setup.maintenance {
                let kind = work.what.to_string();
                kinds.insert(kind.split(" every").next().map(str::to_owned));
                for fault in &setup.faults {
                    moments[0] += u32::from(work.from_s < fault.from_s);
                    let stands = fault.from_s..fault.until_s;
                    moments[1] += u32::from(stands.contains(&work.from_s));
                    moments[2] += u32::from(work.until_s > fault.until_s);
                }
            }
        }
        assert_eq!(kinds.len(), 16, "{kinds:?}");
        assert!(moments.iter().all(|count| *count > 100), "{moments:?}");
    }

    #[test]
    fn every_kind_of_fault_comes_up() {
        let names: std::collections::BTreeSet<String> = (1..2000)
            .flat_map(|seed| draw(seed).faults)
            .map(|injection| injection.what.to_string())
            .collect();
        for name in [
            "sag",
            "stuck, all",
            "bus-off",
            "SYNC lost",
            "noise x3",
            "silent",
        ] {
            assert!(names.contains(name), "{name}");
        }
        assert!(names.len() > 35, "{names:?}");
    }
}
