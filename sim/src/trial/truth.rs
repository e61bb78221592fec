//! What an ideal instrument would report: the measure that the real one is held to.
//!
//! In: what the housing feels, tick by tick, taken from the mover itself. Out: the slopes that
//! ideal parts behind an ideal copy of the product's signal path would give for any instant of the
//! last second, and the attitude of the housing.
//!
//! The copy is the nominal one in `f64`: the part's low-pass at 200 Hz, then the second-order
//! Butterworth at 10 Hz and 400 samples/s. Motion that looks like tilt is in its output as it is
//! in the instrument's, so it does not count as an error: no accelerometer can part the two.
//!
//! Left out: noise, offsets, clipping, and the paper's signal path, whose angle has no instant of
//! its own (its age is between 17 and 37 ms).

use std::collections::VecDeque;
use std::f64::consts::{PI, SQRT_2};

use crate::TICK_S;
use crate::bench::Mode;
use crate::low_pass::{self, LowPass};
use crate::motion::{Attitude, Motion, Mover};

/// Rate of the ideal samples, Hz.
const RATE_HZ: f64 = 400.0;
/// Corner of the digital filter, Hz.
const CORNER_HZ: f64 = 10.0;
/// Bandwidth of the part's own low-pass, Hz.
const BANDWIDTH_HZ: f64 = 200.0;
/// How far back the truth is known, s.
const MEMORY_S: f64 = 1.0;

/// The slopes at one instant, deg.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Slopes {
    /// What an ideal instrument would report: X, Y.
    pub ideal_deg: [f64; 2],
    /// Where the housing stands: X, Y.
    pub attitude_deg: [f64; 2],
}

/// A second-order section for three axes, transposed.
#[derive(Clone, Debug)]
struct Butterworth {
    b: [f64; 3],
    a: [f64; 2],
    state: Option<[[f64; 2]; 3]>,
}

impl Butterworth {
    /// By the bilinear transform with its corner in place.
    fn new() -> Self {
        let k = (PI * CORNER_HZ / RATE_HZ).tan();
        let norm = 1.0 / (1.0 + SQRT_2 * k + k * k);
        let b0 = k * k * norm;
        Self {
            b: [b0, 2.0 * b0, b0],
            a: [
                2.0 * (k * k - 1.0) * norm,
                (1.0 - SQRT_2 * k + k * k) * norm,
            ],
            state: None,
        }
    }

    /// Delay on slow signals, s.
    fn delay_s(&self) -> f64 {
        let [a1, a2] = self.a;
        // A symmetric numerator of three taps delays by one sample.
        (1.0 - (a1 + 2.0 * a2) / (1.0 + a1 + a2)) / RATE_HZ
    }

    fn step(&mut self, input: [f64; 3]) -> [f64; 3] {
        let ([b0, b1, b2], [a1, a2]) = (self.b, self.a);
        let standing = |x: f64| [x - b0 * x, (b2 - a2) * x];
        let state = self.state.get_or_insert_with(|| input.map(standing));
        let mut output = input;
        for (x, s) in output.iter_mut().zip(state) {
            let y = b0 * *x + s[0];
            *s = [b1 * *x - a1 * y + s[1], b2 * *x - a2 * y];
            *x = y;
        }
        output
    }
}

/// One ideal sample: the instant it belongs to, s, and its slopes.
type Point = (f64, Slopes);

/// The ideal instrument with the last second of its output.
#[derive(Clone, Debug)]
pub struct Truth {
    analogue: LowPass,
    digital: Butterworth,
    delay_s: f64,
    /// The last tick: its time, s, the filtered force and the attitude.
    last: Option<(f64, [f64; 3], Attitude)>,
    samples: u64,
    points: VecDeque<Point>,
}

impl Default for Truth {
    fn default() -> Self {
        Self::new()
    }
}

impl Truth {
    /// Has felt nothing yet.
    pub fn new() -> Self {
        let digital = Butterworth::new();
        Self {
            analogue: LowPass::new(BANDWIDTH_HZ),
            delay_s: digital.delay_s() + low_pass::delay_s(BANDWIDTH_HZ),
            digital,
            last: None,
            samples: 0,
            points: VecDeque::new(),
        }
    }

    /// Delay of the whole path on slow signals, s.
    pub fn delay_s(&self) -> f64 {
        self.delay_s
    }

    /// One tick that ends at `time_s`; ticks follow each other by [`TICK_S`].
    pub fn feel(&mut self, motion: &Motion, time_s: f64) {
        let now_g = self.analogue.step(motion.force_g);
        let before = self.last.replace((time_s, now_g, motion.attitude));
        let Some((before_s, before_g, before)) = before else {
            self.samples = (time_s * RATE_HZ).ceil() as u64;
            return;
        };
        loop {
            let due_s = self.samples as f64 / RATE_HZ;
            // Half a nanosecond for the rounding of the ticks' times.
            if due_s > time_s + 5e-10 {
                break;
            }
            let way = (due_s - before_s) / (time_s - before_s).max(TICK_S * 1e-3);
            let mut force_g = before_g;
            for (from, to) in force_g.iter_mut().zip(now_g) {
                *from += way * (to - *from);
            }
            self.sample(force_g, due_s, [before, motion.attitude], way);
        }
    }

    fn sample(&mut self, force_g: [f64; 3], due_s: f64, [from, to]: [Attitude; 2], way: f64) {
        let filtered = self.digital.step(force_g);
        let ideal = Attitude::from_gravity(filtered, 0.0);
        let between = |a: f64, b: f64| a + way * (b - a);
        let slopes = Slopes {
            ideal_deg: [ideal.slope_x_deg, ideal.slope_y_deg],
            attitude_deg: [
                between(from.slope_x_deg, to.slope_x_deg),
                between(from.slope_y_deg, to.slope_y_deg),
            ],
        };
        self.points.push_back((due_s - self.delay_s, slopes));
        if self.points.len() > (MEMORY_S * RATE_HZ) as usize {
            self.points.pop_front();
        }
        self.samples += 1;
    }

    /// The slopes at `time_s`, in a line between ideal samples. Before the memory the oldest, up
    /// to a few ms past the newest the line goes on; `None` before the second sample.
    ///
    /// The attitude is the one that the housing had when the sample was taken, so it comes late
    /// by [`Truth::delay_s`].
    pub fn at(&self, time_s: f64) -> Option<Slopes> {
        let after = self.points.partition_point(|(at, _)| *at < time_s);
        let upper = after.clamp(1, self.points.len().checked_sub(1)?.max(1));
        let (&(t0, a), &(t1, b)) = (self.points.get(upper - 1)?, self.points.get(upper)?);
        let way = ((time_s - t0) / (t1 - t0)).clamp(0.0, 2.5);
        let mix = |a: [f64; 2], b: [f64; 2]| [0, 1].map(|i| a[i] + way * (b[i] - a[i]));
        Some(Slopes {
            ideal_deg: mix(a.ideal_deg, b.ideal_deg),
            attitude_deg: mix(a.attitude_deg, b.attitude_deg),
        })
    }
}

impl Truth {
    /// What an instrument of this mode is held to at `time_s`, deg: with a gyroscope where the
    /// housing stands, since it parts motion from tilt.
    pub fn due_deg(&self, time_s: f64, mode: Mode) -> Option<[f64; 2]> {
        match mode {
            Mode::Dynamic => Some(self.at(time_s - self.delay_s)?.attitude_deg),
            Mode::Product | Mode::OneAxis | Mode::Paper => Some(self.at(time_s)?.ideal_deg),
        }
    }
}

/// A mover that is watched by an ideal instrument.
#[derive(Clone, Debug)]
pub struct Watched<M> {
    /// What moves the housing.
    pub mover: M,
    /// What it truly does.
    pub truth: Truth,
}

impl<M: Mover> Watched<M> {
    /// From now on watched.
    pub fn new(mover: M) -> Self {
        Self {
            mover,
            truth: Truth::new(),
        }
    }
}

impl<M: Mover> Mover for Watched<M> {
    fn step(&mut self, time_s: f64) -> Motion {
        let motion = self.mover.step(time_s);
        self.truth.feel(&motion, time_s);
        motion
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A housing that turns about one axis, slope X at a steady rate.
    struct Turning(f64);

    impl Mover for Turning {
        fn step(&mut self, time_s: f64) -> Motion {
            let slope_x_deg = self.0 * time_s;
            let (sin, cos) = slope_x_deg.to_radians().sin_cos();
            Motion {
                force_g: [sin, 0.0, cos],
                rate_dps: [0.0, -self.0, 0.0],
                attitude: Attitude {
                    slope_x_deg,
                    ..Attitude::default()
                },
            }
        }
    }

    fn run(mover: impl Mover, duration_s: f64) -> Truth {
        let mut watched = Watched::new(mover);
        for tick in 1..=(duration_s / TICK_S) as u64 {
            watched.step(tick as f64 * TICK_S);
        }
        watched.truth
    }

    #[test]
    fn a_steady_turn_is_told_for_the_instant_it_belongs_to() {
        let truth = run(Turning(20.0), 2.0);
        for at_s in [1.2, 1.5, 1.777, 1.95, 1.9765] {
            let told = truth.at(at_s).unwrap().ideal_deg[0];
            assert!((told - 20.0 * at_s).abs() < 0.01, "{told} at {at_s}");
        }
    }

    #[test]
    fn the_delay_is_the_one_that_the_product_declares() {
        let delay_ms = Truth::new().delay_s() * 1e3;
        assert!((delay_ms - 23.6).abs() < 0.2, "{delay_ms}");
    }

    #[test]
    fn standing_it_gives_the_attitude_from_the_first_sample_on() {
        let truth = run(Turning(0.0), 0.01);
        let slopes = truth.at(0.0).unwrap();
        assert!(slopes.ideal_deg.iter().all(|deg| deg.abs() < 1e-9));
        assert_eq!(slopes.attitude_deg, [0.0; 2]);
    }

    #[test]
    fn before_the_second_sample_nothing_is_told() {
        assert_eq!(run(Turning(1.0), 0.003).at(0.0), None);
    }
}
