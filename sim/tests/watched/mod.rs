//! A calibrated pair with gyroscopes on a machine, one of them with a fault: what node 1 judges.
//!
//! In: the scene, the fault, how often the pair is judged. Out: each judgement with its time. A
//! judgement other than "agree" before the fault is a failure.

use device::channel::Settings;
use sim::TICK_S;
use sim::bench::{Bench, Mode, World};
use sim::excavator::{Excavator, ExcavatorSetup, Scene};
use sim::fault::SensorFault;
use sim::motion::Mover;
use sim::rng::Rng;
use tilt::cross_check::Judgement;

/// What both nodes of a unit run with, calibrated.
pub fn calibrated() -> [Settings; 2] {
    let commissioned = Bench::commissioned(Mode::Dynamic, &World::NOMINAL, 1, 0);
    let (bench, _) = commissioned.expect("a sound unit");
    bench.instrument.sides.map(|side| side.settings)
}

/// How a pair is watched.
pub struct Watch {
    /// Between two pairs.
    pub sync_ticks: u64,
    /// A fault is waited for at most so long, s.
    pub patience_s: f64,
}

impl Watch {
    /// Gives node 1 the fault after 20 to 30 s and hands on each judgement behind it, with the time
    /// since the fault's beginning in s, until there is something.
    ///
    /// # Panics
    /// When anything is said before the fault.
    pub fn until<T>(
        &self,
        settings: &[Settings; 2],
        scene: Scene,
        (fault, seed): (SensorFault, u64),
        mut seen: impl FnMut(f64, Judgement) -> Option<T>,
    ) -> Option<T> {
        let mut bench = Bench::new(Mode::Dynamic, &World::NOMINAL, 1, 0);
        for (side, settings) in bench.instrument.sides.iter_mut().zip(settings) {
            side.settings = settings.clone();
        }
        bench.instrument.power_cycle();
        let mut rng = Rng::stream(seed, "gyroscope faults");
        let setup = ExcavatorSetup {
            scene,
            ..ExcavatorSetup::NOMINAL
        };
        let mut machine = Excavator::new(&setup, &mut rng);
        let start_s = bench.instrument.time_s();
        let from_tick = (rng.range(20.0, 30.0) / TICK_S) as u64;
        for tick in 0..from_tick + (self.patience_s / TICK_S) as u64 {
            if tick == from_tick {
                let electronics = &mut bench.instrument.sides[0].electronics;
                electronics.inject(fault, rng.fork());
            }
            let motion = machine.step(bench.instrument.time_s() + TICK_S - start_s);
            bench.instrument.tick(&motion);
            if !tick.is_multiple_of(self.sync_ticks) || (tick as f64) < 5.0 / TICK_S {
                continue;
            }
            let judgement = bench.instrument.sync().verdict.judgement();
            if tick < from_tick {
                assert_eq!(judgement, Judgement::Agree, "false alarm");
                continue;
            }
            let after_s = (tick - from_tick) as f64 * TICK_S;
            if let Some(found) = seen(after_s, judgement) {
                return Some(found);
            }
        }
        None
    }
}
