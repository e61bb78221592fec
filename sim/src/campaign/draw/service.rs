//! Maintenance of one node alone while the other one works, and while a fault stands.
//!
//! In: a seed. Out: one fault of a sensor, and what is done to either node and to SYNC before it,
//! while it stands and after it. What is done to one node follows one after the other; what is done
//! to the other one and to SYNC falls anywhere beside it.
//!
//! Left out: faults of a node, which are what maintenance does.

use super::{any, below, logarithmic, one_in, sensor_fault, stream};
use crate::rng::Rng;
use crate::trial::CHANNELS;
use crate::trial::inject::{Injection, What};
use crate::trial::maintenance::{Maintenance, Work};

/// When the fault begins, s.
const FAULT_S: (f64, f64) = (5.0, 15.0);
/// How long it lasts, s.
const LASTS_S: (f64, f64) = (4.0, 20.0);
/// When the first work begins, s: the instrument is in order by then, or is just about to be.
const FIRST_S: (f64, f64) = (3.0, 10.0);
/// How long one piece of work stands, s.
const WORK_S: (f64, f64) = (0.010, 5.0);
/// Time to the next one, s.
const BETWEEN_S: (f64, f64) = (0.010, 6.0);
/// Pieces of work on one node, and on SYNC, at the most.
const MOST: [u32; 3] = [5, 5, 3];

/// The fault and the maintenance of a seed.
pub(super) fn draw(seed: u64) -> (Vec<Injection>, Vec<Maintenance>) {
    let mut rng = stream(seed, "maintenance");
    let from_s = rng.range(FAULT_S.0, FAULT_S.1);
    let fault = Injection {
        what: What::Sensor(sensor_fault(&mut rng)),
        channel: below(&mut rng, CHANNELS as u32) as usize,
        from_s,
        until_s: from_s + rng.range(LASTS_S.0, LASTS_S.1),
    };
    let mut all = Vec::new();
    for (target, most) in MOST.into_iter().enumerate() {
        let count = below(&mut rng, most + 1);
        let mut from_s = rng.range(FIRST_S.0, FIRST_S.1);
        for _ in 0..count {
            let until_s = from_s + logarithmic(&mut rng, WORK_S.0, WORK_S.1);
            all.push(Maintenance {
                what: if target < CHANNELS {
                    of_a_node(&mut rng)
                } else {
                    of_the_bus(&mut rng)
                },
                channel: target % CHANNELS,
                from_s,
                until_s,
            });
            from_s = until_s + logarithmic(&mut rng, BETWEEN_S.0, BETWEEN_S.1);
        }
    }
    all.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    // A machine that is maintained without a fault has to come back as well.
    let faults = if one_in(&mut rng, 6) {
        Vec::new()
    } else {
        vec![fault]
    };
    (faults, all)
}

fn of_a_node(rng: &mut Rng) -> Work {
    let works = [
        Work::PreOperational,
        Work::Stop,
        Work::Reset,
        Work::ResetCommunication,
        Work::ResetPin,
        Work::Power,
        Work::Wires,
        Work::BusOff,
        Work::Clear,
        Work::Offset,
        Work::LatchTime,
        Work::GoesOnAlone,
    ];
    any(rng, works)
}

fn of_the_bus(rng: &mut Rng) -> Work {
    match below(rng, 4) {
        0 => Work::NoSync,
        1 => Work::SyncPeriod {
            us: any(rng, [10_000, 20_000, 50_000, 100_000, 200_000]),
        },
        2 => Work::SecondMaster {
            us: any(rng, [15_000, 20_000, 100_000]),
        },
        _ => Work::Flood,
    }
}
