//! The low-pass filters: the paper's single pole at 50 Hz and the product's Butterworth at 400 Hz.
//!
//! In: [`Counts`]. Out: [`Filtered`], in units of 2^-26 g nominal. Both filters are the same
//! integer biquad of `idsp` with other coefficients; the state keeps 32 fractional bits, so there
//! is neither a dead band nor a bias. Unity gain at DC.
//!
//! # Erratum E1: where the exponential stands
//! Equations 2 and 3 of the paper put exp(-2 pi tau) on the input; equation 1 and its Fig 3
//! ("about 10 Hz") put it on the feedback. At tau = 0.2 the feedback form has its pole at 0.285,
//! -3 dB at 11.7 Hz and 7.96 ms delay; the printed form has 0.715, 2.69 Hz and 50.3 ms. The
//! feedback form is built here; the test `e1_one_pole_is_11_7_hz_and_7_96_ms` pins it and shows
//! the printed one beside it.
//!
//! Left out: decimation and alignment in time, which are the chain's.

use crate::sample::{Counts, FullScale};
use dsp_fixedpoint::Q;
use dsp_process::SplitProcess;
use idsp::iir::{Biquad, DirectForm1Wide};

/// Acceleration behind the low-pass, 2^-26 g nominal per step; not yet corrected in any way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Filtered {
    /// The x, y and z axes of the part.
    pub accel: [i32; 3],
}

/// Brings counts of any range to 2^-26 g nominal per step, without loss.
pub const fn scale(counts: Counts, full_scale: FullScale) -> [i32; 3] {
    let shift = 12 + full_scale.log2();
    let Counts([x, y, z]) = counts;
    [
        (x as i32) << shift,
        (y as i32) << shift,
        (z as i32) << shift,
    ]
}

/// Configuration of a low-pass filter: coefficients and what follows from them.
#[derive(Clone, Debug, PartialEq)]
pub struct LowPass {
    biquad: Biquad<Q<i32, i64, 30>>,
    /// Group delay at DC in 1/65536 sample.
    delay_q16: u32,
    /// Variance of the output for white input of variance 1, in 2^-30.
    noise_power_q30: u32,
}

/// One axis' memory for each of three axes.
#[derive(Clone, Debug, Default)]
pub struct FilterState {
    axes: [DirectForm1Wide; 3],
}

impl LowPass {
    /// R2: one pole at exp(-2 pi 10/50) = 0.284610, for 50 samples/s. 11.7 Hz, 7.96 ms (E1).
    pub const PAPER: Self = Self::one_pole(0.284_609_543_336_029_3);

    /// Second-order Butterworth, 10 Hz at 400 samples/s; delay 22.4 ms.
    pub const PRODUCT: Self = Self::new([
        0.005_542_717_210_280_681,
        0.011_085_434_420_561_362,
        0.005_542_717_210_280_681,
        1.778_631_777_824_585,
        -0.800_802_646_665_707_8,
    ]);

    /// A single pole on the feedback: y\[n\] = (1 - pole) x\[n\] + pole y\[n-1\] (eq 1).
    ///
    /// `pole` is exp(-2 pi fc/fs), 0 to 1.
    pub const fn one_pole(pole: f64) -> Self {
        Self::new([1.0 - pole, 0.0, 0.0, pole, 0.0])
    }

    /// A second-order Butterworth low-pass by the bilinear transform.
    ///
    /// `corner_hz` must lie between 0 and half of `rate_hz`; returns `None` otherwise. The chip
    /// uses the constants above; this is for recordings with a rate of their own.
    pub fn butterworth(corner_hz: f64, rate_hz: f64) -> Option<Self> {
        let usable = corner_hz > 0.0 && corner_hz < 0.49 * rate_hz && rate_hz.is_finite();
        if !usable {
            return None;
        }
        let mut design = idsp::iir::coefficients::Filter::<f64>::default();
        let [b, a] = design.frequency(corner_hz, rate_hz).lowpass();
        let [b0, b1, b2] = b.map(|v| v / a[0]);
        Some(Self::new([b0, b1, b2, -a[1] / a[0], -a[2] / a[0]]))
    }

    /// From `[b0, b1, b2, a1, a2]` of y = b0 x0 + b1 x1 + b2 x2 + a1 y1 + a2 y2.
    ///
    /// Coefficients must be under 2 in size and the filter stable; b is scaled to unity DC gain
    /// after rounding, so that a standing input passes exactly.
    const fn new(ba: [f64; 5]) -> Self {
        let [b0, b1, b2, a1, a2] = ba;
        let (q1, q2, q3, q4) = (quantise(b1), quantise(b2), quantise(a1), quantise(a2));
        let q0 = (1 << 30) - q1 - q2 - q3 - q4;
        let feedback = 1.0 - a1 - a2;
        let delay = (b1 + 2.0 * b2) / (b0 + b1 + b2) + (a1 + 2.0 * a2) / feedback;
        let power = noise_power(ba);
        Self {
            biquad: Biquad {
                ba: [
                    Q::from_bits(q0),
                    Q::from_bits(q1),
                    Q::from_bits(q2),
                    Q::from_bits(q3),
                    Q::from_bits(q4),
                ],
            },
            delay_q16: (delay * 65536.0 + 0.5) as u32,
            noise_power_q30: (power * 1_073_741_824.0 + 0.5) as u32,
        }
    }

    /// Group delay at DC, in 1/65536 sample.
    pub const fn delay_q16(&self) -> u32 {
        self.delay_q16
    }

    /// Variance of the output for white input of variance 1, in 2^-30.
    pub const fn noise_power_q30(&self) -> u32 {
        self.noise_power_q30
    }

    /// Filters one reading.
    pub fn step(&self, state: &mut FilterState, input: [i32; 3]) -> Filtered {
        let mut accel = input;
        for (value, memory) in accel.iter_mut().zip(&mut state.axes) {
            *value = self.biquad.process(memory, *value);
        }
        Filtered { accel }
    }
}

impl FilterState {
    /// A state in which `input` has stood for ever, so that the output starts there and not at 0.
    pub fn standing_at(input: [i32; 3]) -> Self {
        Self {
            axes: input.map(|v| DirectForm1Wide {
                x: [v; 2],
                y: [i64::from(v) << 32; 2],
            }),
        }
    }
}

const fn quantise(value: f64) -> i32 {
    let scaled = value * 1_073_741_824.0;
    (if scaled < 0.0 {
        scaled - 0.5
    } else {
        scaled + 0.5
    }) as i32
}

/// Sum of the squared impulse response, over 4096 samples.
const fn noise_power(ba: [f64; 5]) -> f64 {
    let [b0, b1, b2, a1, a2] = ba;
    let (mut x1, mut x2, mut y1, mut y2) = (0.0, 0.0, 0.0, 0.0);
    let mut sum = 0.0;
    let mut n = 0;
    while n < 4096 {
        let x0 = if n == 0 { 1.0 } else { 0.0 };
        let y0 = b0 * x0 + b1 * x1 + b2 * x2 + a1 * y1 + a2 * y2;
        sum += y0 * y0;
        (x2, x1, y2, y1) = (x1, x0, y1, y0);
        n += 1;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    /// Gain at `f` Hz of a filter with the given float coefficients.
    fn gain(filter: &LowPass, f: f64, fs: f64) -> f64 {
        let ba = filter
            .biquad
            .ba
            .map(|q| f64::from(q.into_bits()) / 2f64.powi(30));
        let at = |n: f64| ((TAU * f / fs * n).cos(), -(TAU * f / fs * n).sin());
        let (c1, s1) = at(1.0);
        let (c2, s2) = at(2.0);
        let num = (ba[0] + ba[1] * c1 + ba[2] * c2, ba[1] * s1 + ba[2] * s2);
        let den = (1.0 - ba[3] * c1 - ba[4] * c2, -ba[3] * s1 - ba[4] * s2);
        num.0.hypot(num.1) / den.0.hypot(den.1)
    }

    fn corner(filter: &LowPass, fs: f64) -> f64 {
        let (mut low, mut high) = (0.01, fs / 2.0);
        for _ in 0..60 {
            let mid = 0.5 * (low + high);
            if gain(filter, mid, fs) > 0.5f64.sqrt() {
                low = mid
            } else {
                high = mid
            }
        }
        low
    }

    fn delay_ms(filter: &LowPass, fs: f64) -> f64 {
        f64::from(filter.delay_q16()) / 65536.0 / fs * 1000.0
    }

    #[test]
    fn e1_one_pole_is_11_7_hz_and_7_96_ms() {
        assert!(((-TAU * 0.2).exp() - 0.284_609_543).abs() < 1e-9);
        assert!((corner(&LowPass::PAPER, 50.0) - 11.7).abs() < 0.05);
        assert!((delay_ms(&LowPass::PAPER, 50.0) - 7.96).abs() < 0.01);
        // The printed form, which is not built: the exponential on the input.
        let printed = LowPass::one_pole(1.0 - (-TAU * 0.2).exp());
        assert!((corner(&printed, 50.0) - 2.69).abs() < 0.02);
        assert!((delay_ms(&printed, 50.0) - 50.3).abs() < 0.1);
    }

    #[test]
    fn product_is_butterworth_10_hz() {
        assert!((corner(&LowPass::PRODUCT, 400.0) - 10.0).abs() < 0.01);
        let designed = LowPass::butterworth(10.0, 400.0).unwrap();
        for (a, b) in designed.biquad.ba.iter().zip(&LowPass::PRODUCT.biquad.ba) {
            assert!((a.into_bits() - b.into_bits()).abs() <= 4, "{designed:?}");
        }
        assert!((delay_ms(&LowPass::PRODUCT, 400.0) - 22.4).abs() < 0.1);
    }

    #[test]
    fn butterworth_refuses_impossible_corners() {
        assert!(LowPass::butterworth(0.0, 400.0).is_none());
        assert!(LowPass::butterworth(30.0, 50.0).is_none());
        assert!(LowPass::butterworth(10.0, f64::INFINITY).is_none());
    }

    #[test]
    fn a_standing_input_passes_exactly() {
        for filter in [LowPass::PAPER, LowPass::PRODUCT] {
            for v in [1 << 26, -(1 << 27), 12345, -1, i32::MAX >> 1] {
                let mut state = FilterState::standing_at([v; 3]);
                for _ in 0..4000 {
                    let out = filter.step(&mut state, [v; 3]).accel;
                    assert!(out.iter().all(|o| (o - v).abs() <= 1), "{v} {out:?}");
                }
                let mut state = FilterState::default();
                for _ in 0..4000 {
                    filter.step(&mut state, [v; 3]);
                }
                let out = filter.step(&mut state, [v; 3]).accel;
                assert!(
                    out.iter().all(|o| (o - v).abs() <= 1),
                    "from zero: {v} {out:?}"
                );
            }
        }
    }

    #[test]
    fn noise_power_is_that_of_the_output() {
        // One pole: (1 - a) / (1 + a); Butterworth: about pi/2 sqrt(1/2) fc / (fs/2).
        let a = (-TAU * 0.2).exp();
        let paper = f64::from(LowPass::PAPER.noise_power_q30()) / 2f64.powi(30);
        assert!((paper - (1.0 - a) / (1.0 + a)).abs() < 1e-6);
        let product = f64::from(LowPass::PRODUCT.noise_power_q30()) / 2f64.powi(30);
        assert!(
            (product / (PI / 8f64.sqrt() * 10.0 / 200.0) - 1.0).abs() < 0.01,
            "{product}"
        );
    }

    #[test]
    fn scale_keeps_one_g_at_every_range() {
        for fs in [FullScale::G2, FullScale::G4, FullScale::G8, FullScale::G16] {
            let counts = fs.counts_per_g() as i16;
            assert_eq!(
                scale(Counts([counts, -counts, 0]), fs),
                [1 << 26, -(1 << 26), 0]
            );
        }
        assert_eq!(
            scale(Counts([i16::MIN; 3]), FullScale::G16),
            [-(1 << 30); 3]
        );
    }
}
