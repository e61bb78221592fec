//! One channel's supply: a steady rail, or one that sags and breaks down until it is repaired.
//!
//! In: the time, s. Out: the rail in V and what it means for the part ([`Condition`]). The
//! brown-out limit is the LIS2DW12's lowest supply (DS11811 table of electrical
//! characteristics); where a sag begins, how deep and how often it comes is `[ASSUME]`.
//! Left out: inrush, slew of the rail (it steps), and the regulator's own noise.

use crate::rng::Rng;

/// The rail when all is well, V. `[ASSUME]`
pub const NOMINAL_V: f64 = 3.3;
/// Below this the part measures badly but keeps its registers, V. `[ASSUME]`
pub const SAG_BELOW_V: f64 = 3.0;
/// Below this the part resets, V. `[DS]` lowest supply of the LIS2DW12
pub const BROWN_OUT_BELOW_V: f64 = 1.62;

/// Rail during a sag, V: lowest and highest. `[ASSUME]`
const SAG_V: (f64, f64) = (1.8, 2.8);
/// Length of a sag, s. `[ASSUME]`
const SAG_S: (f64, f64) = (0.5, 20.0);
/// Rail during a brown-out, V. `[ASSUME]`
const BROWN_OUT_V: (f64, f64) = (0.2, 1.5);
/// Length of a brown-out, s. `[ASSUME]`
const BROWN_OUT_S: (f64, f64) = (0.001, 0.050);
/// Quiet time between two events, s. `[ASSUME]`
const QUIET_S: (f64, f64) = (2.0, 20.0);
/// How many of the events are brown-outs. `[ASSUME]`
const BROWN_OUT_SHARE: f64 = 0.25;

/// What the rail's voltage means for the part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Condition {
    /// Within specification.
    #[default]
    Good,
    /// Low: more noise and a wandering offset.
    Sag,
    /// Too low to run: the part resets and wakes in power-down.
    BrownOut,
}

/// What a rail of this voltage does to the part; NaN counts as a brown-out.
pub fn condition(volts: f64) -> Condition {
    if volts >= SAG_BELOW_V {
        Condition::Good
    } else if volts >= BROWN_OUT_BELOW_V {
        Condition::Sag
    } else {
        Condition::BrownOut
    }
}

/// A rail over time; ask it with increasing time.
#[derive(Clone, Debug)]
pub struct Supply {
    unrest: Option<Unrest>,
}

/// The plan of an unstable rail: one event at a time.
#[derive(Clone, Debug)]
struct Unrest {
    rng: Rng,
    begin_s: f64,
    end_s: f64,
    volts: f64,
    repaired_s: f64,
}

impl Unrest {
    /// Plans the event that follows a quiet time after `after_s`.
    fn plan(&mut self, after_s: f64) {
        let rng = &mut self.rng;
        let (length_s, volts) = if rng.uniform() < BROWN_OUT_SHARE {
            (BROWN_OUT_S, BROWN_OUT_V)
        } else {
            (SAG_S, SAG_V)
        };
        self.begin_s = after_s + rng.range(QUIET_S.0, QUIET_S.1);
        self.end_s = self.begin_s + rng.range(length_s.0, length_s.1);
        self.volts = rng.range(volts.0, volts.1);
    }
}

impl Supply {
    /// [`NOMINAL_V`] for ever.
    pub fn steady() -> Supply {
        Supply { unrest: None }
    }

    /// Steady until `from_s`, then random sags of 0.5-20 s and brown-outs of 1-50 ms with 2-20 s
    /// between them, until [`Supply::repair`]. Takes one number from `rng`.
    pub fn unstable(from_s: f64, rng: &mut Rng) -> Supply {
        let mut unrest = Unrest {
            rng: rng.fork(),
            begin_s: 0.0,
            end_s: 0.0,
            volts: NOMINAL_V,
            repaired_s: f64::INFINITY,
        };
        unrest.plan(from_s);
        Supply {
            unrest: Some(unrest),
        }
    }

    /// Someone mends the supply at `now_s`: steady from then on. Nothing happens to a steady one.
    pub fn repair(&mut self, now_s: f64) {
        if let Some(unrest) = &mut self.unrest {
            unrest.repaired_s = now_s;
        }
    }

    /// What the rail at `time_s` means for the part; the time may not go back.
    #[inline]
    pub fn condition(&mut self, time_s: f64) -> Condition {
        match self.unrest {
            None => Condition::Good,
            Some(_) => condition(self.step(time_s)),
        }
    }

    /// The rail at `time_s`, V; the time may not go back.
    #[inline]
    pub fn step(&mut self, time_s: f64) -> f64 {
        let Some(unrest) = &mut self.unrest else {
            return NOMINAL_V;
        };
        if time_s >= unrest.repaired_s {
            return NOMINAL_V;
        }
        while time_s >= unrest.end_s {
            unrest.plan(unrest.end_s);
        }
        if time_s >= unrest.begin_s {
            unrest.volts
        } else {
            NOMINAL_V
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TICK_S;

    /// Lengths in ticks of the events of each condition during an hour.
    fn events(supply: &mut Supply, from_tick: u32) -> [Vec<u32>; 3] {
        let mut lengths: [Vec<u32>; 3] = Default::default();
        let (mut last, mut length) = (Condition::Good, 0);
        for tick in from_tick..from_tick + 3_600_000 {
            let now = condition(supply.step(f64::from(tick) * TICK_S));
            if now == last {
                length += 1;
            } else {
                lengths[last as usize].push(length);
                (last, length) = (now, 1);
            }
        }
        lengths
    }

    #[test]
    fn the_thresholds_part_the_conditions() {
        assert_eq!(condition(3.3), Condition::Good);
        assert_eq!(condition(3.0), Condition::Good);
        assert_eq!(condition(2.999), Condition::Sag);
        assert_eq!(condition(1.62), Condition::Sag);
        assert_eq!(condition(1.619), Condition::BrownOut);
        assert_eq!(condition(f64::NAN), Condition::BrownOut);
    }

    #[test]
    fn a_steady_supply_never_moves() {
        let mut supply = Supply::steady();
        assert!((0..1_000_000).all(|s| supply.step(f64::from(s)) == NOMINAL_V));
    }

    #[test]
    fn an_unstable_supply_sags_and_breaks_down_within_its_times() {
        let mut supply = Supply::unstable(0.0, &mut Rng::stream(1, "supply"));
        let [good, sag, brown_out] = events(&mut supply, 0);
        assert!(good.iter().all(|n| (1999..=20_001).contains(n)));
        assert!(
            sag.len() > 60 && sag.iter().all(|n| (500..=20_001).contains(n)),
            "{sag:?}"
        );
        assert!(brown_out.len() > 20, "{brown_out:?}");
        assert!(
            brown_out.iter().all(|n| (1..=51).contains(n)),
            "{brown_out:?}"
        );
    }

    #[test]
    fn it_is_steady_before_the_fault_and_after_the_repair() {
        let mut supply = Supply::unstable(100.0, &mut Rng::stream(2, "supply"));
        assert!((0..102_000).all(|t| supply.step(f64::from(t) * TICK_S) == NOMINAL_V));
        let low = (102_000..400_000)
            .filter(|t| supply.step(f64::from(*t) * TICK_S) < 3.0)
            .count();
        assert!(low > 10_000, "{low}");
        supply.repair(400.0);
        assert!((400..100_000).all(|s| supply.step(f64::from(s)) == NOMINAL_V));
    }

    #[test]
    fn one_seed_gives_one_story() {
        let run = |seed| {
            let mut supply = Supply::unstable(5.0, &mut Rng::stream(seed, "supply"));
            (0..50_000)
                .map(move |t| supply.step(f64::from(t) * 0.01).to_bits())
                .collect::<Vec<_>>()
        };
        assert_eq!(run(3), run(3));
        assert_ne!(run(3), run(4));
    }
}
