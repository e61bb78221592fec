//! Vibration: noise in a band, a steady tone, and ringing that dies away.
//!
//! In: amplitudes in g, frequencies in Hz, one call per tick of [`crate::TICK_S`]. Out: force on
//! three axes in g, mean 0. Nothing here takes a sine per tick: tones and rings turn a phasor by
//! a fixed step, noise runs through two second-order sections. Left out: how vibration travels
//! through the structure; each axis gets its share as its owner sets it.

use super::{Lanes, axes, each, lanes};
use crate::TICK_S;
use crate::rng::Rng;
use std::f64::consts::{PI, SQRT_2, TAU};

/// A second-order section in transposed direct form II: b0, b1, b2, a1, a2.
#[derive(Clone, Copy, Debug)]
struct Section([f64; 5]);

/// What a section remembers of each axis.
type SectionState = [Lanes; 2];

impl Section {
    /// Butterworth low-pass, -3 dB at `corner_hz`, by the pre-warped bilinear transform.
    fn low_pass(corner_hz: f64, rate_hz: f64) -> Section {
        let c = (PI * corner_hz / rate_hz).tan();
        let norm = 1.0 / (1.0 + SQRT_2 * c + c * c);
        let b0 = c * c * norm;
        Section([
            b0,
            2.0 * b0,
            b0,
            2.0 * (c * c - 1.0) * norm,
            (1.0 - SQRT_2 * c + c * c) * norm,
        ])
    }

    /// Butterworth high-pass, otherwise like [`Section::low_pass`].
    fn high_pass(corner_hz: f64, rate_hz: f64) -> Section {
        let Section([_, _, _, a1, a2]) = Section::low_pass(corner_hz, rate_hz);
        let b0 = (1.0 - a1 + a2) / 4.0;
        Section([b0, -2.0 * b0, b0, a1, a2])
    }

    #[inline]
    fn step(&self, state: &mut SectionState, x: Lanes) -> Lanes {
        let [b0, b1, b2, a1, a2] = self.0;
        let [first, second] = *state;
        let y = each(|i| b0 * x[i] + first[i]);
        *state = [
            each(|i| b1 * x[i] - a1 * y[i] + second[i]),
            each(|i| b2 * x[i] - a2 * y[i]),
        ];
        y
    }
}

/// Noise between two frequencies, independent on each axis.
///
/// White noise through a second-order high-pass and low-pass, scaled so that the output has the
/// wanted rms. With `every` above 1 the noise is made at every n-th tick and is the control points
/// of a uniform cubic B-spline, which saves time for low bands; the rms allows for the spline. Its
/// images about the lower rate are down by the fourth power of sinc: straight lines have kinks,
/// which a part hears above 150 Hz, and the louder the nearer it samples to one.
#[derive(Clone, Debug)]
pub struct BandNoise {
    high_pass: Section,
    low_pass: Section,
    gain_g: f64,
    every: u32,
    state: [SectionState; 2],
    tick: u32,
    spline: Spline,
}

/// The spline on all axes: its last four points, and its value with three forward differences.
#[derive(Clone, Copy, Debug, Default)]
struct Spline {
    points: [Lanes; 4],
    value: Lanes,
    differences: [Lanes; 3],
}

/// The points' weights in the spline a share `t` of the way through a piece, oldest first.
fn spline_weights(t: f64) -> [f64; 4] {
    let (square, cube) = (t * t, t * t * t);
    [
        (1.0 - 3.0 * t + 3.0 * square - cube) / 6.0,
        (4.0 - 6.0 * square + 3.0 * cube) / 6.0,
        (1.0 + 3.0 * t + 3.0 * square - 3.0 * cube) / 6.0,
        cube / 6.0,
    ]
}

impl Spline {
    /// Begins the piece that `next` is the newest point of, `step` of a piece per tick.
    #[inline]
    fn begin(&mut self, next: Lanes, step: f64) {
        let [_, a, b, c] = self.points;
        self.points = [a, b, c, next];
        let d1 = each(|i| (c[i] - a[i]) / 2.0);
        let d2 = each(|i| (a[i] + c[i]) / 2.0 - b[i]);
        let d3 = each(|i| (next[i] - a[i]) / 6.0 + (b[i] - c[i]) / 2.0);
        let (h2, h3) = (step * step, step * step * step);
        self.value = each(|i| (a[i] + 4.0 * b[i] + c[i]) / 6.0);
        self.differences = [
            each(|i| d1[i] * step + d2[i] * h2 + d3[i] * h3),
            each(|i| 2.0 * d2[i] * h2 + 6.0 * d3[i] * h3),
            each(|i| 6.0 * d3[i] * h3),
        ];
    }

    /// The value at this tick; moves on to the next.
    #[inline]
    fn step(&mut self) -> Lanes {
        let value = self.value;
        let [d1, d2, d3] = self.differences;
        self.value = each(|i| value[i] + d1[i]);
        self.differences = [each(|i| d1[i] + d2[i]), each(|i| d2[i] + d3[i]), d3];
        value
    }
}

impl BandNoise {
    /// Noise of `rms_g` per axis from `low_hz` to `high_hz` (both above 0 and below half the
    /// rate 1 kHz / `every`), made at every `every`-th tick (0 counts as 1).
    pub fn new(rms_g: f64, low_hz: f64, high_hz: f64, every: u32) -> BandNoise {
        let every = every.max(1);
        let rate_hz = 1.0 / (TICK_S * f64::from(every));
        let mut noise = BandNoise {
            high_pass: Section::high_pass(low_hz, rate_hz),
            low_pass: Section::low_pass(high_hz, rate_hz),
            gain_g: 1.0,
            every,
            state: Default::default(),
            tick: 0,
            spline: Spline::default(),
        };
        let ring_out = (20.0 * rate_hz / low_hz) as usize;
        noise.gain_g = rms_g / noise.power_gain(ring_out).sqrt();
        noise
    }

    /// Mean square of the output when white noise of unit variance goes in: from the impulse
    /// response's correlation at lags 0 to 3, averaged over the ticks of a piece.
    fn power_gain(&self, length: usize) -> f64 {
        let mut state = [SectionState::default(); 2];
        let (mut lags, mut past) = ([0.0; 4], [0.0; 4]);
        for n in 0..length {
            let [a, b, c, _] = past;
            let impulse = if n == 0 { 1.0 } else { 0.0 };
            let [h, ..] = self.pass(&mut state, [impulse, 0.0, 0.0, 0.0]);
            past = [h, a, b, c];
            for (lag, before) in lags.iter_mut().zip(past) {
                *lag += h * before;
            }
        }
        if self.every == 1 {
            return lags[0];
        }
        let at = |tick: u32| {
            let w = spline_weights(f64::from(tick) / f64::from(self.every));
            let pairs = (0..4usize).flat_map(|i| (0..4usize).map(move |j| (i, j)));
            pairs
                .map(|(i, j)| w[i] * w[j] * lags[i.abs_diff(j)])
                .sum::<f64>()
        };
        (0..self.every).map(at).sum::<f64>() / f64::from(self.every)
    }

    #[inline]
    fn pass(&self, state: &mut [SectionState; 2], x: Lanes) -> Lanes {
        let high = self.high_pass.step(&mut state[0], x);
        self.low_pass.step(&mut state[1], high)
    }

    /// The next tick's force, g.
    #[inline]
    pub fn step(&mut self, rng: &mut Rng) -> [f64; 3] {
        if self.every == 1 {
            return axes(self.next_g(rng));
        }
        if self.tick == 0 {
            let step = 1.0 / f64::from(self.every);
            let next_g = self.next_g(rng);
            self.spline.begin(next_g, step);
            self.tick = self.every;
        }
        self.tick -= 1;
        axes(self.spline.step())
    }

    /// By itself, because among other code the axes are no longer taken in pairs.
    #[inline(never)]
    fn next_g(&mut self, rng: &mut Rng) -> Lanes {
        let mut state = self.state;
        let noise = self.pass(&mut state, lanes(rng.normals()));
        self.state = state;
        each(|i| self.gain_g * noise[i])
    }
}

/// A complex number that turns by a fixed step at each tick, and shrinks when damped.
#[derive(Clone, Copy, Debug, Default)]
struct Phasor {
    re: f64,
    im: f64,
    turn_re: f64,
    turn_im: f64,
}

impl Phasor {
    /// Turns at `frequency_hz`, dies away by 1/e every `decay_s` (infinite for a steady one).
    fn new(frequency_hz: f64, decay_s: f64) -> Phasor {
        let (sin, cos) = (TAU * frequency_hz * TICK_S).sin_cos();
        let keep = (-TICK_S / decay_s).exp();
        Phasor {
            re: 0.0,
            im: 0.0,
            turn_re: keep * cos,
            turn_im: keep * sin,
        }
    }

    #[inline]
    fn step(&mut self) {
        let re = self.re * self.turn_re - self.im * self.turn_im;
        self.im = self.re * self.turn_im + self.im * self.turn_re;
        self.re = re;
    }
}

/// A steady sine, such as an engine's, with a phase of its own on each axis.
#[derive(Clone, Debug)]
pub struct Tone {
    phasor: Phasor,
    /// Shares of the phasor's real part and of its imaginary part.
    share_g: [Lanes; 2],
}

impl Tone {
    /// A sine of `rms_g` on each axis at `frequency_hz` (below 500), phases drawn from `rng`.
    pub fn new(rms_g: f64, frequency_hz: f64, rng: &mut Rng) -> Tone {
        let mut phasor = Phasor::new(frequency_hz, f64::INFINITY);
        phasor.re = 1.0;
        let mut share_g = [[0.0; 4]; 2];
        let [re, im] = &mut share_g;
        for (re, im) in re.iter_mut().zip(im).take(3) {
            let (sin, cos) = rng.range(0.0, TAU).sin_cos();
            *re = rms_g * SQRT_2 * cos;
            *im = rms_g * SQRT_2 * sin;
        }
        Tone { phasor, share_g }
    }

    /// The next tick's force, g.
    #[inline]
    pub fn step(&mut self) -> [f64; 3] {
        self.phasor.step();
        // Rounding would let the length wander over a week; one Newton step holds it at 1.
        let length_2 = self.phasor.re * self.phasor.re + self.phasor.im * self.phasor.im;
        let hold = 1.5 - 0.5 * length_2;
        self.phasor.re *= hold;
        self.phasor.im *= hold;
        let [re, im] = self.share_g;
        axes(each(|i| re[i] * self.phasor.re + im[i] * self.phasor.im))
    }
}

/// A resonance that rings after each kick; output on one line, to be spread by its owner.
#[derive(Clone, Debug, Default)]
pub struct Ring {
    phasor: Phasor,
}

impl Ring {
    /// A resonance at `frequency_hz` with this damping ratio (0.03 for 3 %).
    pub fn damped(frequency_hz: f64, damping_ratio: f64) -> Ring {
        let natural = frequency_hz / (1.0 - damping_ratio * damping_ratio).sqrt();
        Ring {
            phasor: Phasor::new(frequency_hz, 1.0 / (TAU * damping_ratio * natural)),
        }
    }

    /// Adds a sine of this amplitude that starts at zero now, g; the sign is its direction.
    pub fn kick(&mut self, amplitude_g: f64) {
        self.phasor.re += amplitude_g;
    }

    /// Whether the ring is still worth a step (envelope above 1 ug).
    #[inline]
    pub fn sounds(&self) -> bool {
        self.phasor.re.abs() + self.phasor.im.abs() > 1e-6
    }

    /// The next tick's force along the ring's line, g; exactly 0 once it has died away.
    #[inline]
    pub fn step(&mut self) -> f64 {
        if !self.sounds() {
            self.phasor.re = 0.0;
            self.phasor.im = 0.0;
            return 0.0;
        }
        self.phasor.step();
        self.phasor.im
    }
}

/// A blow and the ringing after it, on one line: what shakes comes back to where it was, so its
/// force adds up to nothing.
#[derive(Clone, Debug, Default)]
pub struct Burst {
    /// The velocity, of which the force is the change in a tick: a ring, less one that dies away
    /// three times as fast, so that the force begins at zero as well.
    velocity: [Ring; 2],
    before: f64,
}

impl Burst {
    /// A burst at `frequency_hz` whose envelope is down to 5 % after `duration_s` and whose
    /// highest peak is `peak_g`. It has started.
    pub fn new(peak_g: f64, frequency_hz: f64, duration_s: f64) -> Burst {
        let of = |amplitude: f64| {
            let velocity = [3.0, 9.0].map(|decays| {
                let mut ring = Ring {
                    phasor: Phasor::new(frequency_hz, duration_s / decays),
                };
                ring.kick(amplitude);
                ring
            });
            Burst {
                velocity,
                before: 0.0,
            }
        };
        let mut one = of(1.0);
        let ticks = (duration_s / TICK_S) as u32;
        let peak = (0..ticks).fold(0.0, |peak: f64, _| peak.max(one.step().abs()));
        of(peak_g / peak)
    }

    /// Whether the burst is still worth a step.
    #[inline]
    pub fn sounds(&self) -> bool {
        self.velocity[0].sounds() || self.before != 0.0
    }

    /// The next tick's force along the burst's line, g; exactly 0 once it has died away.
    #[inline]
    pub fn step(&mut self) -> f64 {
        let [slow, fast] = &mut self.velocity;
        let velocity = slow.step() - fast.step();
        let force = velocity - self.before;
        self.before = velocity;
        force
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Power at one frequency of a signal sampled at 1 kHz, and the rms of the whole.
    fn power_at(signal: &[f64], frequency_hz: f64) -> f64 {
        let (mut re, mut im) = (0.0, 0.0);
        for (n, x) in signal.iter().enumerate() {
            let (sin, cos) = (TAU * frequency_hz * TICK_S * n as f64).sin_cos();
            re += x * cos;
            im += x * sin;
        }
        (re * re + im * im) / signal.len() as f64
    }

    fn rms(signal: &[f64]) -> f64 {
        (signal.iter().map(|x| x * x).sum::<f64>() / signal.len() as f64).sqrt()
    }

    /// Mean power near a frequency, to smooth one noise record's scatter.
    fn density(signal: &[f64], around_hz: f64) -> f64 {
        let share = 40;
        (0..share)
            .map(|k| power_at(signal, around_hz * (0.95 + 0.1 * k as f64 / share as f64)))
            .sum::<f64>()
            / share as f64
    }

    fn axis_of(mut noise: BandNoise, axis: usize, ticks: usize) -> Vec<f64> {
        let mut rng = Rng::stream(5, "band noise");
        (0..ticks).map(|_| noise.step(&mut rng)[axis]).collect()
    }

    #[test]
    fn band_noise_has_its_rms_on_every_axis() {
        for (low, high, every) in [(20.0, 200.0, 1), (3.0, 25.0, 5)] {
            for axis in 0..3 {
                let signal = axis_of(BandNoise::new(0.030, low, high, every), axis, 400_000);
                let got = rms(&signal);
                assert!(
                    (got / 0.030 - 1.0).abs() < 0.05,
                    "{low} Hz, axis {axis}: {got}"
                );
            }
        }
    }

    #[test]
    fn band_noise_stays_in_its_band() {
        for (low, high, every) in [(20.0, 200.0, 1), (3.0, 25.0, 5)] {
            let signal = axis_of(BandNoise::new(1.0, low, high, every), 0, 100_000);
            let middle = density(&signal, f64::sqrt(low * high));
            for outside in [low / 4.0, (high * 3.0f64).min(450.0)] {
                let ratio = density(&signal, outside) / middle;
                assert!(ratio < 0.05, "{outside} Hz: {ratio}");
            }
        }
    }

    #[test]
    fn slow_noise_had_kinks_that_a_part_heard_above_150_hz() {
        let signal = axis_of(BandNoise::new(0.030, 3.0, 25.0, 5), 0, 100_000);
        let middle = density(&signal, 9.0);
        for image in [160.0, 185.0, 240.0] {
            let ratio = density(&signal, image) / middle;
            assert!(ratio < 1e-6, "{image} Hz: {ratio}");
        }
    }

    #[test]
    fn a_spline_through_equal_points_is_flat_and_weighs_them_as_said() {
        let weights = spline_weights(0.4);
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let mut spline = Spline {
            points: [9.0, 1.0, -2.0, 5.0].map(|point| [point; 4]),
            ..Spline::default()
        };
        spline.begin([3.0; 4], 0.2);
        (0..2).for_each(|_| {
            spline.step();
        });
        let expected: f64 = weights
            .iter()
            .zip([1.0, -2.0, 5.0, 3.0])
            .map(|(w, p)| w * p)
            .sum();
        assert!((spline.step().iter()).all(|value| (value - expected).abs() < 1e-12));
    }

    #[test]
    fn a_tone_keeps_its_rms_and_frequency_for_an_hour() {
        let mut tone = Tone::new(0.050, 80.0, &mut Rng::stream(1, "tone"));
        (0..3_600_000).for_each(|_| {
            tone.step();
        });
        let signal: Vec<f64> = (0..10_000).map(|_| tone.step()[2]).collect();
        assert!((rms(&signal) - 0.050).abs() < 1e-6, "{}", rms(&signal));
        let share = power_at(&signal, 80.0) * 2.0 / (rms(&signal).powi(2) * signal.len() as f64);
        assert!((share - 1.0).abs() < 1e-3, "{share}");
    }

    #[test]
    fn a_ring_dies_away_as_its_damping_sets() {
        let mut ring = Ring::damped(25.0, 0.03);
        ring.kick(0.005);
        let signal: Vec<f64> = (0..8000).map(|_| ring.step()).collect();
        let peak = |from: usize| {
            signal[from..from + 40]
                .iter()
                .fold(0.0, |m: f64, x| m.max(*x))
        };
        // One period is 40 ticks and shrinks the ring by exp(-2 pi 0.03 / sqrt(1 - 0.03^2)).
        assert!((peak(40) / peak(0) - (-TAU * 0.03f64).exp()).abs() < 0.002);
        assert!((peak(0) - 0.005 * 0.954).abs() < 2e-5, "{}", peak(0));
        assert_eq!(signal[7999], 0.0);
    }

    #[test]
    fn a_burst_reaches_its_peak_and_is_over_after_its_duration() {
        for (frequency_hz, duration_s) in [(30.0, 0.020), (60.0, 0.060), (45.0, 0.040)] {
            let mut burst = Burst::new(3.0, frequency_hz, duration_s);
            let signal: Vec<f64> = (0..400).map(|_| burst.step()).collect();
            let peak = signal.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            assert!((peak - 3.0).abs() < 1e-9, "{frequency_hz} Hz: {peak}");
            assert!(
                signal[0].abs() < 0.7 * peak,
                "it does not begin in one tick"
            );
            let end = (duration_s / TICK_S) as usize;
            let late = signal[end..].iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            assert!(late < 0.12 * 3.0, "{frequency_hz} Hz: {late}");
        }
    }

    #[test]
    fn a_shock_left_the_housing_a_velocity_that_it_does_not_have() {
        for frequency_hz in [30.0, 45.0, 60.0] {
            for duration_s in [0.020, 0.040, 0.060] {
                let mut burst = Burst::new(5.0, frequency_hz, duration_s);
                let gained: f64 = (0..2000).map(|_| burst.step() * TICK_S).sum();
                assert!(
                    gained.abs() < 1e-8,
                    "{frequency_hz} Hz, {duration_s} s: {gained} g s"
                );
                assert!(!burst.sounds());
            }
        }
    }
}
