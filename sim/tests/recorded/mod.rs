//! The motor of the bench with a record of where it was, for tests of whole devices on a bus.

use sim::motion::{Motion, Mover};
use sim::rig::Rig;

/// The motor, and where it was at each tick: s and deg.
pub struct Recorded {
    pub rig: Rig,
    truth: Vec<(f64, f64)>,
}

impl Mover for Recorded {
    fn step(&mut self, time_s: f64) -> Motion {
        let motion = self.rig.step(time_s);
        self.truth.push((time_s, self.rig.shaft().true_deg));
        motion
    }
}

impl Recorded {
    /// A motor that has not moved yet.
    pub fn new(rig: Rig) -> Self {
        Self {
            rig,
            truth: Vec::new(),
        }
    }

    /// Where it was, deg: between two ticks along a straight line.
    pub fn at(&self, time_s: f64) -> f64 {
        let after = self.truth.partition_point(|(tick_s, _)| *tick_s < time_s);
        let ((from_s, from), (to_s, to)) = (self.truth[after - 1], self.truth[after]);
        from + (to - from) * (time_s - from_s) / (to_s - from_s)
    }
}
