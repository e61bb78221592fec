//! Slow random processes: the 1/f floor and the wander of a sagging supply.
//!
//! In: the time since the last sample, s. Out: a value per axis in the unit of its rms, mean 0. The
//! floor is the sum of three first-order Gauss-Markov processes with time constants of 1, 10 and
//! 100 s and equal power, which is roughly 1/f from 2 mHz to 0.2 Hz. Each moves on when a hundredth
//! of its time constant has passed, exactly for the time that did pass, so samples far apart are as
//! right as samples close together, and the fast path draws one number a sample rather than nine.

use crate::rng::Rng;

/// A first-order Gauss-Markov process on three axes, rms 1 when it has settled.
#[derive(Clone, Debug)]
pub(super) struct Markov {
    tau_s: f64,
    waited_s: f64,
    /// The present value on each axis.
    pub(super) value: [f64; 3],
}

impl Markov {
    /// A process that starts at zero.
    pub(super) fn at_rest(tau_s: f64) -> Markov {
        Markov {
            tau_s,
            waited_s: 0.0,
            value: [0.0; 3],
        }
    }

    /// A process that has run for ever: its start is drawn.
    pub(super) fn settled(tau_s: f64, rng: &mut Rng) -> Markov {
        Markov {
            value: rng.normals(),
            ..Markov::at_rest(tau_s)
        }
    }

    /// Lets `dt_s` pass; true when the value has changed.
    #[inline]
    pub(super) fn step(&mut self, dt_s: f64, rng: &mut Rng) -> bool {
        self.waited_s += dt_s;
        let changes = self.waited_s >= 0.01 * self.tau_s;
        if changes {
            self.renew(rng);
        }
        changes
    }

    /// Seldom beside the steps, and kept out of them: those run at every sample.
    #[inline(never)]
    fn renew(&mut self, rng: &mut Rng) {
        let keep = (-self.waited_s / self.tau_s).exp();
        let drive = (1.0 - keep * keep).sqrt();
        let normals = rng.normals();
        self.value = [0, 1, 2].map(|i| keep * self.value[i] + drive * normals[i]);
        self.waited_s = 0.0;
    }
}

/// The 1/f floor.
#[derive(Clone, Debug)]
pub(super) struct Flicker {
    each: f64,
    /// Time that the processes have not been told of, s.
    waited_s: f64,
    processes: [Markov; 3],
    /// The present sum on each axis.
    pub(super) sum: [f64; 3],
}

/// Time constants of the floor's processes, s. `[ASSUME]`
const TAUS_S: [f64; 3] = [1.0, 10.0, 100.0];

/// None of them changes sooner than this, s.
const LOOK_S: f64 = 0.01;

impl Flicker {
    /// A floor of this rms that has run for ever.
    pub(super) fn settled(rms: f64, rng: &mut Rng) -> Flicker {
        let processes = TAUS_S.map(|tau_s| Markov::settled(tau_s, rng));
        let each = rms / (TAUS_S.len() as f64).sqrt();
        let mut flicker = Flicker {
            each,
            waited_s: 0.0,
            processes,
            sum: [0.0; 3],
        };
        flicker.add_up();
        flicker
    }

    #[inline]
    pub(super) fn step(&mut self, dt_s: f64, rng: &mut Rng) {
        self.waited_s += dt_s;
        if self.waited_s >= LOOK_S {
            self.look(rng);
        }
    }

    #[inline(never)]
    fn look(&mut self, rng: &mut Rng) {
        let waited_s = std::mem::take(&mut self.waited_s);
        let mut changed = false;
        for process in &mut self.processes {
            changed |= process.step(waited_s, rng);
        }
        if changed {
            self.add_up();
        }
    }

    fn add_up(&mut self) {
        let [a, b, c] = &self.processes;
        self.sum = [0, 1, 2].map(|i| self.each * (a.value[i] + b.value[i] + c.value[i]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_floor_has_its_rms_whatever_the_step() {
        for dt_s in [0.0025, 0.02, 1.0, 60.0] {
            let mut rng = Rng::stream(1, "flicker");
            // Many short records and not a long one: 100 s processes average slowly.
            let mut power = 0.0;
            for _ in 0..3000 {
                let mut flicker = Flicker::settled(40e-6, &mut rng);
                (0..20).for_each(|_| flicker.step(dt_s, &mut rng));
                power += flicker.sum.iter().map(|g| g * g).sum::<f64>() / 9000.0;
            }
            assert!(
                (power.sqrt() / 40e-6 - 1.0).abs() < 0.03,
                "{dt_s}: {}",
                power.sqrt()
            );
        }
    }

    #[test]
    fn a_process_forgets_with_its_time_constant() {
        for (dt_s, steps) in [(0.0025, 400), (0.1, 10), (1.0, 1)] {
            let mut rng = Rng::stream(2, "markov");
            let mut product = 0.0;
            for _ in 0..4000 {
                let mut process = Markov::settled(1.0, &mut rng);
                let before = process.value;
                (0..steps).for_each(|_| {
                    process.step(dt_s, &mut rng);
                });
                product += (0..3).map(|i| before[i] * process.value[i]).sum::<f64>() / 12_000.0;
            }
            assert!((product - (-1f64).exp()).abs() < 0.03, "{dt_s}: {product}");
        }
    }
}
