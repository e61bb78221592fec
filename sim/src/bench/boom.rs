//! The instrument on the boom of an excavator that digs and rests.
//!
//! In: a calibrated instrument and its distance from the boom's pivot. Out: errors of the angle of
//! each moment against the truth at that moment, apart for work and for rest, and how often they
//! were within the uncertainty that was stated.
//!
//! The boom goes up to 60 deg/s, the machine shakes by 30 mg and the bucket strikes the ground;
//! what is felt 3 m from the pivot is three times the centripetal and tangential force.
//!
//! Left out: the slewing of the cab, which no scene has.

use super::Bench;
use super::statistics::Tally;
use crate::TICK_S;
use crate::excavator::{Excavator, ExcavatorSetup, Scene};
use crate::motion::{Motion, Mover};

/// Readings are taken every 20 ms.
const SYNC_TICKS: u64 = 20;

/// How long the machine has to stand before a reading counts as one at rest, s.
pub const REST_S: f64 = 2.0;

/// What is left out at the beginning, s: the code starts on a boom that stands.
const START_S: f64 = 5.0;

/// What was found, both nodes and both slopes together, deg.
#[derive(Clone, Debug, Default)]
pub struct BoomResult {
    /// Errors while the boom moves, or has moved within [`REST_S`].
    pub working: Tally,
    /// Errors after that.
    pub resting: Tally,
    /// Readings that were invalid.
    pub invalid: u64,
    /// Readings within twice their standard uncertainty.
    pub covered: u64,
}

impl BoomResult {
    /// Readings that were valid.
    pub fn valid(&self) -> u64 {
        self.working.count() + self.resting.count()
    }

    /// What another run found, too.
    pub fn join(&mut self, other: &Self) {
        self.working.join(&other.working);
        self.resting.join(&other.resting);
        self.invalid += other.invalid;
        self.covered += other.covered;
    }
}

impl Bench {
    /// Digs and rests on this machine for `duration_s`.
    pub fn on_the_boom(&mut self, machine: &ExcavatorSetup, duration_s: f64) -> BoomResult {
        let setup = ExcavatorSetup {
            scene: Scene::StopAndGo,
            ..*machine
        };
        let mut rng = self.rng.fork();
        let mut machine = Standing {
            machine: Excavator::new(&setup, &mut rng),
            from_s: self.instrument.time_s(),
        };
        // The housing comes to the boom switched off.
        self.instrument.power_cycle();
        super::run(&mut self.instrument, &mut machine, START_S);
        let mut result = BoomResult::default();
        let mut still_s = 0.0;
        for tick in 0..(duration_s / TICK_S) as u64 {
            let motion = machine.step(self.instrument.time_s() + TICK_S);
            self.instrument.tick(&motion);
            let moves = motion.rate_dps != [0.0; 3];
            still_s = if moves { 0.0 } else { still_s + TICK_S };
            if tick % SYNC_TICKS == 0 {
                self.note_on_the_boom(&motion, still_s >= REST_S, &mut result);
            }
        }
        result
    }

    fn note_on_the_boom(&mut self, motion: &Motion, rests: bool, result: &mut BoomResult) {
        let truth = motion.attitude;
        for now in self.instrument.sync().now {
            let slopes = [(now.x, truth.slope_x_deg), (now.y, truth.slope_y_deg)];
            for (found, truth_deg) in slopes {
                let Ok(found) = found else {
                    result.invalid += 1;
                    continue;
                };
                let error_deg = found.angle.degrees() - truth_deg;
                let covered = error_deg.abs() <= 2.0 * found.uncertainty.degrees();
                result.covered += u64::from(covered);
                let tally = match rests {
                    true => &mut result.resting,
                    false => &mut result.working,
                };
                tally.add(error_deg);
            }
        }
    }
}

/// A machine whose scene begins when the instrument comes to it.
struct Standing {
    machine: Excavator,
    from_s: f64,
}

impl Mover for Standing {
    fn step(&mut self, time_s: f64) -> Motion {
        self.machine.step(time_s - self.from_s)
    }
}
