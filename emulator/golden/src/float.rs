//! The product's chain once more, in floating point of 32 bits, and what each of the two costs.
//!
//! In: the samples of [`Outcome`](crate::Outcome), and a counter of instructions. Out:
//! [`Compared`]: what either chain takes of a Cortex-M3, which has no floating point of its own,
//! and how far their angles are apart. Both have the same stages, constants and times: gaps,
//! low-pass, alignment in time, temperature, matrix, slopes, harmonics, uncertainties.
//!
//! Left out: other calibrations than the product's, reasons for having no angle, and the check
//! for saturation; each makes the comparison kinder to floating point.

use core::hint::black_box;

use instant::Instant;
use tilt::angle::Axes;
use tilt::chain::{Chain, ChainState, Correction, PART_DELAY_Q16, Reading, Timing};
use tilt::sample::{Counts, Temperature};
use tilt::temperature::TemperatureModel;

use crate::{counts, product};

/// Samples that both are given.
pub const SAMPLES: u32 = 800;

/// Steps of [`Angle`](tilt::angle::Angle) in a radian: 2^32 / (2 pi).
const STEPS: f32 = 683_565_275.6;
/// 2^-26 g, in g.
const ACCEL: f32 = 1.0 / 67_108_864.0;

/// What was counted, and how far apart the angles are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct Compared {
    /// Instructions of all samples, by integers and by floating point.
    pub sample: [u32; 2],
    /// Instructions of all readings.
    pub reading: [u32; 2],
    /// The largest difference of two slopes, 2^-32 of a circle.
    pub apart: u32,
    /// The same of their uncertainties.
    pub uncertainty: u32,
    /// Readings that both had.
    pub readings: u32,
    /// Samples run; [`SAMPLES`] once it is done.
    pub done: u32,
}

impl Compared {
    /// Nothing yet.
    pub const NOTHING: Self = Self {
        sample: [0; 2],
        reading: [0; 2],
        apart: 0,
        uncertainty: 0,
        readings: 0,
        done: 0,
    };

    /// Runs both. `count` is how many instructions there have been so far; it may wrap.
    pub fn run(&mut self, count: impl Fn() -> u32) {
        let chain = product();
        let float = Float::of(&chain);
        let (mut state, mut memory) = (ChainState::default(), Memory::default());
        let mut noise = 1;
        for number in 0..SAMPLES {
            if number % 400 == 0 {
                chain.temperature(&mut state, Temperature(30 * 256 + number as i32));
            }
            let at = Instant(5_000_000 + u64::from(number * chain.period_us * 101 / 100));
            let codes = black_box(counts(number, &mut noise));
            let start = count();
            chain.sample(&mut state, codes, at);
            let middle = count();
            float.sample(&mut memory, codes, at);
            let end = count();
            add(&mut self.sample, [start, middle, end]);
            let now = at.offset(i64::from(number % 2_500));
            let degrees = state.temperature().map_or(0, |t| t.0) as f32 / 256.0;
            let start = count();
            let reading = black_box(chain.reading(&state, now));
            let middle = count();
            let floating = black_box(float.reading(&memory, now, degrees));
            let end = count();
            if self.take(&reading, &floating) {
                add(&mut self.reading, [start, middle, end]);
            }
            self.done = number + 1;
        }
    }

    /// False while there is no reading yet.
    fn take(&mut self, reading: &Reading, floating: &[[f32; 2]; 2]) -> bool {
        let (Ok(x), Ok(y)) = (reading.x, reading.y) else {
            return false;
        };
        for (exact, [angle, uncertainty]) in [x, y].iter().zip(floating) {
            let apart = exact.angle.0.wrapping_sub((angle * STEPS) as i32);
            self.apart = self.apart.max(apart.unsigned_abs());
            let apart = exact.uncertainty.0.abs_diff((uncertainty * STEPS) as u32);
            self.uncertainty = self.uncertainty.max(apart);
        }
        self.readings += 1;
        true
    }
}

fn add(sums: &mut [u32; 2], [start, middle, end]: [u32; 3]) {
    let [integers, floating] = sums;
    *integers = integers.wrapping_add(middle.wrapping_sub(start));
    *floating = floating.wrapping_add(end.wrapping_sub(middle));
}

/// The chain's configuration, in g, degC, radians and us.
struct Float {
    /// b0, b1, b2, a1, a2 of [`LowPass::PRODUCT`](tilt::filter::LowPass::PRODUCT).
    filter: [f32; 5],
    delay_samples: f32,
    latency_us: i64,
    period_us: f32,
    /// b1, b2, g1, g2 of each axis.
    temperature: [[f32; 4]; 3],
    matrix: [[f32; 3]; 3],
    offset: [f32; 3],
    /// Cosine and sine amplitudes of each slope.
    harmonics: [[[f32; 3]; 2]; 2],
    /// Squares: noise behind the filter, repeatability, hysteresis, what does not depend on g.
    squares: [f32; 4],
}

/// What it remembers.
#[derive(Clone, Copy, Default)]
struct Memory {
    inputs: [[f32; 3]; 2],
    outputs: [[f32; 3]; 2],
    at: [Instant; 2],
    period_us: f32,
    settling: u32,
}

impl Float {
    fn of(chain: &Chain) -> Self {
        let calibration = &chain.calibration;
        let (TemperatureModel::Quadratic(model), Correction::TwoAxis { vector, harmonics }) =
            (&calibration.temperature, &calibration.correction)
        else {
            unreachable!("the product's calibration has these");
        };
        let Timing::Aligned { latency_us } = chain.timing else {
            unreachable!("the product's readings are aligned");
        };
        let Axes { x, y } = harmonics;
        let wave = |numbers: [i32; 3]| numbers.map(|number| number as f32 / STEPS);
        let budget = &calibration.budget;
        let square = |size: f32| size * size;
        let terms = |axis: usize| {
            let of = |list: &[i32; 3]| list.get(axis).copied().unwrap_or(0) as f32;
            [
                of(&model.offset1_q8) * ACCEL / 256.0,
                of(&model.offset2_q16) * ACCEL / 65_536.0,
                of(&model.gain1_q38) / 274_877_906_944.0,
                of(&model.gain2_q46) / 70_368_744_177_664.0,
            ]
        };
        Self {
            filter: [
                0.005_542_717,
                0.011_085_434,
                0.005_542_717,
                1.778_631_8,
                -0.800_802_65,
            ],
            delay_samples: (chain.filter.delay_q16() + PART_DELAY_Q16) as f32 / 65_536.0,
            latency_us: i64::from(latency_us),
            period_us: chain.period_us as f32,
            temperature: [0, 1, 2].map(terms),
            matrix: vector
                .matrix
                .map(|row| row.map(|c| c as f32 / 1_073_741_824.0)),
            offset: vector.offset.map(|c| c as f32 * ACCEL),
            harmonics: [x, y].map(|w| [wave(w.cosine), wave(w.sine)]),
            squares: [
                square(budget.noise as f32 * ACCEL) * chain.filter.noise_power_q30() as f32
                    / 1_073_741_824.0,
                square(budget.repeatability as f32 * ACCEL),
                square(budget.hysteresis as f32 * ACCEL),
                square(budget.reference.0 as f32 / STEPS)
                    + square(budget.residual.0 as f32 / STEPS),
            ],
        }
    }

    /// Takes in one sample, as [`Chain::sample`] does.
    #[inline(never)]
    fn sample(&self, memory: &mut Memory, Counts(codes): Counts, at: Instant) {
        let input = codes.map(|code| f32::from(code) / 16_384.0);
        let [latest, _] = memory.at;
        if latest == Instant(0) {
            memory.inputs = [input; 2];
            memory.outputs = [input; 2];
            memory.period_us = self.period_us;
            memory.settling = 128;
        } else {
            let elapsed = at.micros_since(latest) as i32 as f32;
            // No sample is missing here; a chain would fill as many as this says, less one.
            if (elapsed / memory.period_us + 0.5) as u32 == 1 {
                let weight = if memory.settling > 96 {
                    0.125
                } else {
                    0.031_25
                };
                memory.period_us += (elapsed - memory.period_us) * weight;
            }
        }
        memory.at = [at, latest];
        self.filter(memory, input);
        memory.settling = memory.settling.saturating_sub(1);
    }

    fn filter(&self, memory: &mut Memory, input: [f32; 3]) {
        let [b0, b1, b2, a1, a2] = self.filter;
        let ([x1, x2], [y1, y2]) = (memory.inputs, memory.outputs);
        let mut output = input;
        let before = x1.iter().zip(&x2).zip(y1.iter().zip(&y2));
        for (value, ((x1, x2), (y1, y2))) in output.iter_mut().zip(before) {
            *value = b0 * *value + b1 * x1 + b2 * x2 + a1 * y1 + a2 * y2;
        }
        memory.inputs = [input, x1];
        memory.outputs = [output, y1];
    }

    /// Slope and standard uncertainty of X and Y, rad, as [`Chain::reading`] has them.
    #[inline(never)]
    fn reading(&self, memory: &Memory, now: Instant, degrees: f32) -> [[f32; 2]; 2] {
        let accel = self.vector(self.aligned(memory, now), degrees - 25.0);
        let [noise, repeatability, hysteresis, fixed] = self.squares;
        let away = if degrees > 25.0 {
            degrees - 25.0
        } else {
            25.0 - degrees
        };
        let share = ((away + 3.0) / 8.0).min(1.0);
        let square = noise + repeatability + hysteresis * share * share;
        let [x, y, z] = accel.map(|c| c * c);
        let norm = libm::sqrtf(x + y + z);
        let off = if norm > 1.0 { norm - 1.0 } else { 1.0 - norm };
        let motion = (off - 4.0 * libm::sqrtf(square)).max(0.0);
        let [ax, ay, _] = accel;
        let slope = |own: f32, beside: f32, [cosine, sine]: &[[f32; 3]; 2]| {
            let folds = beside < 4.0 * square;
            let unshared = if folds { 2.0 * square } else { square } + fixed;
            let raw = libm::atan2f(own, libm::sqrtf(beside));
            let angle = raw + correction(raw, cosine, sine);
            let whole = libm::sqrtf(unshared + motion * motion);
            [angle.clamp(-1.570_796_4, 1.570_796_4), whole]
        };
        let [of_x, of_y] = &self.harmonics;
        [slope(ax, y + z, of_x), slope(ay, x + z, of_y)]
    }

    /// The filtered acceleration of the instant that belongs to `now`, g.
    fn aligned(&self, memory: &Memory, now: Instant) -> [f32; 3] {
        let [latest, previous] = memory.at;
        let way = (now.micros_since(previous) - self.latency_us) as i32 as f32;
        let way = way + self.delay_samples * memory.period_us;
        let weight = way / latest.micros_since(previous) as i32 as f32;
        let [newest, mut accel] = memory.outputs;
        for (a, b) in accel.iter_mut().zip(newest) {
            *a += (b - *a) * weight;
        }
        accel
    }

    /// Without the temperature's part, in the housing's frame, g.
    fn vector(&self, mut accel: [f32; 3], warmer: f32) -> [f32; 3] {
        for (value, [b1, b2, g1, g2]) in accel.iter_mut().zip(&self.temperature) {
            let centred = *value - warmer * (b1 + b2 * warmer);
            *value = centred + centred * warmer * (g1 + g2 * warmer);
        }
        let [x, y, z] = accel;
        let mut corrected = self.offset;
        for (out, [a, b, c]) in corrected.iter_mut().zip(&self.matrix) {
            *out += a * x + b * y + c * z;
        }
        corrected
    }
}

/// The three harmonics at `angle`, rad. One sine and one cosine give those of the multiples.
fn correction(angle: f32, cosine: &[f32; 3], sine: &[f32; 3]) -> f32 {
    let (s1, c1) = libm::sincosf(angle);
    let (s2, c2) = (2.0 * s1 * c1, c1 * c1 - s1 * s1);
    let (s3, c3) = (s2 * c1 + c2 * s1, c2 * c1 - s2 * s1);
    let [a1, a2, a3] = cosine;
    let [b1, b2, b3] = sine;
    a1 * c1 + a2 * c2 + a3 * c3 + b1 * s1 + b2 * s2 + b3 * s3
}

#[cfg(test)]
mod tests {
    use super::*;
    use tilt::angle::STEPS_PER_DEGREE;

    #[test]
    fn floating_point_comes_to_the_same_angles_within_a_thousandth_of_a_degree() {
        let mut compared = Compared::NOTHING;
        compared.run(|| 0);
        assert_eq!(compared.done, SAMPLES);
        assert!(compared.readings > SAMPLES / 2, "{compared:?}");
        let degrees = |steps: u32| f64::from(steps) / STEPS_PER_DEGREE;
        let (angle, uncertainty) = (degrees(compared.apart), degrees(compared.uncertainty));
        assert!(angle < 0.001, "{angle} deg");
        assert!(uncertainty < 0.001, "{uncertainty} deg");
    }
}
