//! One seed, one world: the same seed gives the same bits, alone or beside another world.
//!
//! In: seeds. Out: a trace hash (FNV-1a, 64 bit) over every bit of every reading and verdict of
//! an instrument that is commissioned, turned on the rig and taken to the excavator.

use std::thread;

use sim::TICK_S;
use sim::bench::{Bench, Mode, World, run};
use sim::excavator::{Excavator, ExcavatorSetup};
use sim::instrument::Pair;
use sim::motion::Mover;
use sim::rig::Mount;
use sim::rng::Rng;
use sim::supply::Supply;
use tilt::chain::{Invalid, Measurement};

/// FNV-1a, 64 bit.
struct Hash(u64);

impl Hash {
    fn add(&mut self, value: u64) {
        for byte in value.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn axis(&mut self, axis: Result<Measurement, Invalid>) {
        match axis {
            Ok(m) => {
                self.add(u64::from(m.angle.0 as u32));
                self.add(u64::from(m.uncertainty.0) << 32 | u64::from(m.unshared.0));
                self.add(m.at.0);
                self.add(u64::from(m.latency_us));
            }
            Err(reason) => format!("{reason:?}")
                .bytes()
                .for_each(|b| self.add(b.into())),
        }
    }

    fn pair(&mut self, pair: &Pair) {
        for reading in pair.readings {
            self.axis(reading.x);
            self.axis(reading.y);
        }
        let judgement = format!("{:?}", pair.verdict.judgement());
        judgement.bytes().for_each(|b| self.add(b.into()));
    }
}

/// Every reading of one world: commissioning, the rig's swings, the arm with a bad supply.
fn trace(mode: Mode, seed: u64) -> u64 {
    let (mut bench, _) = Bench::commissioned(mode, &World::NOMINAL, seed, 1).unwrap();
    let mut hash = Hash(0xcbf2_9ce4_8422_2325);
    bench.mount(Mount::X, 0.0, 0.0);
    let angles_deg = bench.random_angles(5, 90.0);
    for point in bench.static_test(Mount::X, &angles_deg) {
        hash.add(point.truth_deg.to_bits());
        hash.add(point.nodes[0].error_deg.to_bits());
        hash.add(point.nodes[1].error_deg.to_bits());
    }
    for point in bench.dynamic_test(Mount::Y, 0.02).points {
        hash.add(point.truth_deg.to_bits());
        let nodes = point.nodes_deg.map(|n| n.unwrap_or(f64::NAN).to_bits());
        nodes.into_iter().for_each(|bits| hash.add(bits));
    }
    let mut rng = Rng::stream(seed, "trace");
    let mut arm = Excavator::new(&ExcavatorSetup::NOMINAL, &mut rng);
    let from_s = bench.instrument.time_s() + 20.0;
    bench.instrument.sides[1].electronics.supply = Supply::unstable(from_s, &mut rng);
    arm.step(bench.instrument.time_s());
    for _ in 0..3000 {
        run(&mut bench.instrument, &mut arm, 20.0 * TICK_S);
        hash.pair(&bench.instrument.sync());
    }
    hash.0
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_seed_others() {
    for mode in [Mode::Paper, Mode::Product] {
        let first = trace(mode, 11);
        assert_eq!(first, trace(mode, 11), "{mode:?}");
        assert_ne!(first, trace(mode, 12), "{mode:?}");
    }
}

#[test]
fn worlds_side_by_side_give_the_bits_of_each_alone() {
    let alone = [Mode::Paper, Mode::Product].map(|mode| trace(mode, 21));
    let together = [Mode::Paper, Mode::Product]
        .map(|mode| thread::spawn(move || trace(mode, 21)))
        .map(|world| world.join().unwrap());
    assert_eq!(alone, together);
}
