//! A sensor fault at work, sample by sample.
//!
//! In: what the part feels, g, and then the codes that it makes of it, each with its time. Out:
//! the same with the fault on it; whether the data-ready edge arrives, and the time stamp that it
//! has; what the supply has come down to. What lies before the converter is changed in g, so it
//! is rounded and clipped as the rest; what lies behind it is changed in codes, so the self-test's
//! deflection goes the same way.

use std::collections::VecDeque;

use super::{RateFault, SensorFault};
use crate::TICK_S;
use crate::rng::Rng;
use crate::supply::Condition;

/// Rounding of times that are sums of ticks, s.
const ROUNDING_S: f64 = 1e-9;

/// One sample behind the converter.
#[derive(Clone, Copy, Debug)]
struct Sample {
    captured_s: f64,
    codes: [i16; 3],
}

/// A fault that has been injected, with what it has to remember.
#[derive(Clone, Debug)]
pub struct Injected {
    fault: SensorFault,
    rng: Rng,
    from_s: f64,
    next_spike_s: f64,
    /// The codes that a stuck converter repeats.
    held: Option<[i16; 3]>,
    /// The same of a gyroscope.
    held_rate: Option<[i16; 3]>,
    /// Samples that are under way; the code gets the first.
    backlog: VecDeque<Sample>,
}

impl Injected {
    /// The fault begins at `from_s`; `rng` is its own.
    pub fn new(fault: SensorFault, from_s: f64, rng: Rng) -> Self {
        Self {
            fault,
            rng,
            from_s,
            next_spike_s: from_s,
            held: None,
            held_rate: None,
            backlog: VecDeque::new(),
        }
    }

    /// Which fault it is.
    pub fn fault(&self) -> SensorFault {
        self.fault
    }

    /// The stream of random numbers that is this fault's own.
    pub fn rng(&mut self) -> &mut Rng {
        &mut self.rng
    }

    /// How many times its white noise the part has now.
    pub fn noise(&self) -> f64 {
        match self.fault {
            SensorFault::Noise { factor } => factor,
            _ => 1.0,
        }
    }

    /// How many times its white noise the gyroscope has now.
    pub fn rate_noise(&self) -> f64 {
        match self.fault {
            SensorFault::Gyroscope(RateFault::Noise { factor }) => factor,
            _ => 1.0,
        }
    }

    /// What the gyroscope's converter gets instead of `felt_dps`.
    pub fn rate_dps(&self, felt_dps: [f64; 3]) -> [f64; 3] {
        let SensorFault::Gyroscope(fault) = self.fault else {
            return felt_dps;
        };
        let [x, y, z] = felt_dps;
        match fault {
            RateFault::Bias { axis, dps } => {
                let mut rate_dps = felt_dps;
                if let Some(value) = rate_dps.get_mut(axis) {
                    *value += dps;
                }
                rate_dps
            }
            RateFault::Scale { ratio } => felt_dps.map(|rate| rate * (1.0 + ratio)),
            RateFault::SwappedAxes => [y, x, z],
            RateFault::Stuck | RateFault::Noise { .. } => felt_dps,
        }
    }

    /// What the code finds instead of a gyroscope's `codes`.
    pub fn rate_codes(&mut self, codes: [i16; 3]) -> [i16; 3] {
        match self.fault {
            SensorFault::Gyroscope(RateFault::Stuck) => *self.held_rate.get_or_insert(codes),
            _ => codes,
        }
    }

    /// What the thermometer reads instead of `die_c`, degC.
    pub fn thermometer_c(&self, die_c: f64) -> f64 {
        match self.fault {
            SensorFault::Thermometer { c } => die_c + c,
            _ => die_c,
        }
    }

    /// What the converter gets instead of `felt_g` for the sample of `at_s`.
    pub fn force_g(&mut self, felt_g: [f64; 3], at_s: f64) -> [f64; 3] {
        let (axis, offset_g, gain) = match self.fault {
            SensorFault::Bias { axis, mg } => (axis, mg * 1e-3, 1.0),
            SensorFault::Drift { axis, mg_per_s } => {
                (axis, mg_per_s * 1e-3 * (at_s - self.from_s), 1.0)
            }
            SensorFault::Gain { axis, ratio } => (axis, 0.0, 1.0 + ratio),
            SensorFault::Spikes { g, per_s } => match self.spike(per_s, at_s) {
                Some((axis, sign)) => (axis, sign * g, 1.0),
                None => return felt_g,
            },
            _ => return felt_g,
        };
        let mut force_g = felt_g;
        if let Some(value) = force_g.get_mut(axis) {
            *value = *value * gain + offset_g;
        }
        force_g
    }

    /// Axis and sign of the spike that hits the sample of `at_s`; plans the next one.
    fn spike(&mut self, per_s: f64, at_s: f64) -> Option<(usize, f64)> {
        if at_s < self.next_spike_s {
            return None;
        }
        // Exponential times between them make a Poisson process; never when there are none.
        self.next_spike_s = at_s - (1.0 - self.rng.uniform()).ln() / per_s;
        if per_s <= 0.0 {
            self.next_spike_s = f64::INFINITY;
        }
        let axis = (self.rng.uniform() * 3.0) as usize;
        Some((axis, self.rng.sign()))
    }

    /// What the code finds instead of `codes` at the edge of `at_s`.
    pub fn codes(&mut self, codes: [i16; 3], at_s: f64) -> [i16; 3] {
        match self.fault {
            SensorFault::Stuck { axis } => {
                let held = *self.held.get_or_insert(codes);
                let is_stuck = |i| axis.is_none_or(|axis| axis == i);
                [0, 1, 2].map(|i| if is_stuck(i) { held[i] } else { codes[i] })
            }
            SensorFault::SwappedAxes => [codes[1], codes[0], codes[2]],
            SensorFault::Late { s } => self.late(codes, at_s, s),
            _ => codes,
        }
    }

    fn late(&mut self, codes: [i16; 3], at_s: f64, late_s: f64) -> [i16; 3] {
        self.backlog.push_back(Sample {
            captured_s: at_s,
            codes,
        });
        let due_s = at_s - late_s + ROUNDING_S;
        while self.backlog.get(1).is_some_and(|s| s.captured_s <= due_s) {
            self.backlog.pop_front();
        }
        self.backlog.front().map_or(codes, |sample| sample.codes)
    }

    /// The time stamp of the edge at `at_s`, whose sample has gone through [`Injected::codes`].
    pub fn captured_s(&self, at_s: f64) -> f64 {
        self.backlog.front().map_or(at_s, |s| s.captured_s)
    }

    /// Whether the next data-ready edge arrives; one draw for each.
    pub fn arrives(&mut self) -> bool {
        match self.fault {
            SensorFault::SampleLoss { share } => self.rng.uniform() >= share,
            _ => true,
        }
    }

    /// What the supply has come down to in the tick that ends at `time_s`.
    pub fn supply(&self, time_s: f64) -> Condition {
        match self.fault {
            SensorFault::BrownOut { s } => {
                let over_s = self.from_s + s.max(TICK_S) + ROUNDING_S;
                if time_s <= over_s {
                    Condition::BrownOut
                } else {
                    Condition::Good
                }
            }
            SensorFault::Sag => Condition::Sag,
            _ => Condition::Good,
        }
    }
}
