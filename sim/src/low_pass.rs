//! The part's internal analogue low-pass: what the housing feels in, what its converter sees out.
//!
//! In: the specific force at each tick of [`crate::TICK_S`], g. Out: the same three axes after a
//! second-order Butterworth filter at the part's bandwidth. The data sheet gives the bandwidth
//! (DS11811, ODR/2, /4, /10 or /20) but not the shape: second order is `[ASSUME]`.
//!
//! The force between two ticks is a straight line, and for a straight line the filter's answer
//! is known exactly, so the delay at low frequency is that of the analogue filter,
//! 1 / (sqrt(2) pi bandwidth): 9.00 ms at 25 Hz and 1.13 ms at 200 Hz. (A pre-warped bilinear
//! transform at 1 kHz gives 0.97 ms at 200 Hz, which is 0.012 degrees at 80 deg/s.)
//! Left out: the mechanical resonance of the sensing element (kilohertz) and its overload.

use crate::TICK_S;
use crate::motion::{Lanes, axes, each, lanes};
use std::f64::consts::{FRAC_1_SQRT_2, PI, SQRT_2, TAU};

/// The highest bandwidth the tick can carry, Hz; a request above it gets this one.
pub const MAX_BANDWIDTH_HZ: f64 = 450.0;

/// The lowest bandwidth, Hz: far below the part's slowest setting (0.625 Hz at 12.5 Hz ODR / 20).
pub const MIN_BANDWIDTH_HZ: f64 = 0.1;

/// Delay of the filter on slow signals, s, for a bandwidth in Hz within the limits above.
pub fn delay_s(bandwidth_hz: f64) -> f64 {
    1.0 / (SQRT_2 * PI * bandwidth_hz)
}

/// The filter of all three axes with its state.
#[derive(Clone, Debug)]
pub struct LowPass {
    response: Response,
    /// The force at the previous tick, g; the first one fills the state.
    input_g: Lanes,
    /// The output of each axis, g.
    output_g: Lanes,
    /// Its slope divided by the corner's angular frequency, g.
    slope_g: Lanes,
    started: bool,
}

/// The filter's output at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Its value, g.
    value_g: Lanes,
    /// Its slope, g per tick.
    slope_g: Lanes,
}

impl Moment {
    /// The output a share `way` of the tick that goes from here to `after`.
    ///
    /// The cubic with the value and the slope of both ends. A straight line is short of a 60 Hz
    /// sine by up to 2 % in the middle of a tick and by nothing at its ends, and a part whose
    /// samples fall on middles and ends in turn would hear the difference above 150 Hz.
    #[inline]
    pub fn towards(&self, after: &Moment, way: f64) -> [f64; 3] {
        let left = 1.0 - way;
        let (here, there) = (
            left * left * (1.0 + 2.0 * way),
            way * way * (1.0 + 2.0 * left),
        );
        let (up, down) = (way * left * left, -way * way * left);
        axes(each(|i| {
            here * self.value_g[i]
                + there * after.value_g[i]
                + up * self.slope_g[i]
                + down * after.slope_g[i]
        }))
    }
}

/// What one tick does to the state; depends on the bandwidth alone.
///
/// Output and slope at the tick's end are sums of what there was at its beginning, output, slope
/// and input, and of the input at its end, each times one of these.
#[derive(Clone, Copy, Debug)]
struct Response {
    output: [f64; 4],
    slope: [f64; 4],
    /// The corner's angle per tick, rad.
    corner_rad: f64,
}

impl Response {
    /// The steady answer to a line lags it by sqrt(2) slopes; what differs from it decays by
    /// exp(A t) of the undriven filter.
    fn new(bandwidth_hz: f64) -> Response {
        // Unlike `clamp`, `max` turns NaN into the lower limit.
        let at_least_hz = bandwidth_hz.max(MIN_BANDWIDTH_HZ);
        let corner_rad = TAU * at_least_hz.min(MAX_BANDWIDTH_HZ) * TICK_S;
        let (sin, cos) = (corner_rad * FRAC_1_SQRT_2).sin_cos();
        let keep = (-corner_rad * FRAC_1_SQRT_2).exp();
        let [a, b] = [keep * (cos + sin), keep * SQRT_2 * sin];
        let [c, d] = [-keep * SQRT_2 * sin, keep * (cos - sin)];
        // The line's slope and its lag, for a force that goes from 0 to 1 g in the tick.
        let slope = 1.0 / corner_rad;
        let lag = SQRT_2 * slope;
        let output = a * lag - b * slope - lag;
        let turn = c * lag - d * slope + slope;
        Response {
            output: [a, b, -a - output, 1.0 + output],
            slope: [c, d, -c - turn, turn],
            corner_rad,
        }
    }
}

impl LowPass {
    /// A filter of this bandwidth (-3 dB), Hz, held within [`MIN_BANDWIDTH_HZ`] and
    /// [`MAX_BANDWIDTH_HZ`].
    pub fn new(bandwidth_hz: f64) -> LowPass {
        LowPass {
            response: Response::new(bandwidth_hz),
            input_g: [0.0; 4],
            output_g: [0.0; 4],
            slope_g: [0.0; 4],
            started: false,
        }
    }

    /// Changes the bandwidth, Hz; the output goes on without a jump, as when the registers of a
    /// running part are written.
    pub fn retune(&mut self, bandwidth_hz: f64) {
        self.response = Response::new(bandwidth_hz);
    }

    /// The output at the last tick.
    #[inline]
    pub fn moment(&self) -> Moment {
        let per_tick = self.response.corner_rad;
        Moment {
            value_g: self.output_g,
            slope_g: each(|i| self.slope_g[i] * per_tick),
        }
    }

    /// One tick: the force now, g; returns the filtered force now, g. The first force fills the
    /// state, as if it had stood there for ever.
    #[inline]
    pub fn step(&mut self, force_g: [f64; 3]) -> [f64; 3] {
        let to_g = lanes(force_g);
        if !self.started {
            self.started = true;
            (self.input_g, self.output_g) = (to_g, to_g);
            return force_g;
        }
        self.advance(to_g);
        axes(self.output_g)
    }

    /// The state at the tick's end. By itself, because among other code the axes are no longer
    /// taken in pairs.
    #[inline(never)]
    fn advance(&mut self, to_g: Lanes) {
        let Response { output, slope, .. } = self.response;
        let (out_g, slope_g, from_g) = (self.output_g, self.slope_g, self.input_g);
        let sum = |of: [f64; 4], i: usize| {
            of[0] * out_g[i] + of[1] * slope_g[i] + of[2] * from_g[i] + of[3] * to_g[i]
        };
        self.output_g = each(|i| sum(output, i));
        self.slope_g = each(|i| sum(slope, i));
        self.input_g = to_g;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lag behind a ramp of 1 mg per tick after the start has died away, s.
    fn lag_s(bandwidth_hz: f64) -> f64 {
        let mut filter = LowPass::new(bandwidth_hz);
        let mut out = 0.0;
        for n in 0..2000 {
            out = f64::from(n) * 0.001 - filter.step([f64::from(n) * 0.001, 0.0, 0.0])[0];
        }
        out / 0.001 * TICK_S
    }

    fn gain_at(bandwidth_hz: f64, frequency_hz: f64) -> f64 {
        let mut filter = LowPass::new(bandwidth_hz);
        let mut power = 0.0;
        for n in 0..20_000 {
            let force = (TAU * frequency_hz * TICK_S * f64::from(n)).sin();
            let out = filter.step([0.0, force, 0.0])[1];
            if n >= 10_000 {
                power += 2.0 * out * out / 10_000.0;
            }
        }
        power.sqrt()
    }

    #[test]
    fn slow_signals_come_late_by_the_declared_delay() {
        for (bandwidth_hz, want_ms) in [(25.0, 9.0), (200.0, 1.13), (100.0, 2.25)] {
            let got_ms = lag_s(bandwidth_hz) * 1e3;
            assert!(
                (got_ms - want_ms).abs() < 0.005,
                "{bandwidth_hz} Hz: {got_ms} ms"
            );
            assert!((got_ms - delay_s(bandwidth_hz) * 1e3).abs() < 1e-6);
        }
    }

    #[test]
    fn the_corner_is_at_minus_3_db_and_the_skirt_falls_by_12_db_per_octave() {
        assert!(
            (gain_at(25.0, 25.0) - FRAC_1_SQRT_2).abs() < 0.003,
            "{}",
            gain_at(25.0, 25.0)
        );
        assert!((gain_at(25.0, 1.0) - 1.0).abs() < 1e-3);
        assert!(
            (gain_at(25.0, 100.0) - 1.0 / 16.0).abs() < 0.006,
            "{}",
            gain_at(25.0, 100.0)
        );
        // A line between the ticks carries 1.2 dB less of a sine at a fifth of the tick rate.
        let near_ticks = FRAC_1_SQRT_2 * ((0.2 * PI).sin() / (0.2 * PI)).powi(2);
        let got = gain_at(200.0, 200.0);
        assert!((got - near_ticks).abs() < 0.003, "{got}");
    }

    #[test]
    fn a_sine_between_two_ticks_was_short_by_two_per_cent() {
        let turn = TAU * 60.0 * TICK_S;
        let mut filter = LowPass::new(200.0);
        let moments: Vec<Moment> = (0..2000)
            .map(|n| {
                filter.step([(turn * f64::from(n)).sin(), 0.0, 0.0]);
                filter.moment()
            })
            .collect();
        let settled = &moments[1000..];
        let amplitude = settled.iter().map(|m| m.value_g[0]).fold(0.0, f64::max);
        // The half-way value of a sine, from its ends: cos of half a step is what a line lacks.
        let miss = settled.windows(2).map(|pair| {
            let line = (pair[0].value_g[0] + pair[1].value_g[0]) / 2.0;
            (pair[0].towards(&pair[1], 0.5)[0] - line / (turn / 2.0).cos()).abs()
        });
        let miss = miss.fold(0.0, f64::max) / amplitude;
        assert!(miss < 0.001, "{miss}");
        let ends = [0.0, 1.0].map(|way| settled[0].towards(&settled[1], way)[0]);
        assert_eq!(ends, [settled[0].value_g[0], settled[1].value_g[0]]);
    }

    #[test]
    fn the_first_input_fills_the_state() {
        let mut filter = LowPass::new(25.0);
        for _ in 0..100 {
            let out = filter.step([0.3, -0.4, 0.9]);
            assert!(
                out.iter()
                    .zip([0.3, -0.4, 0.9])
                    .all(|(a, b)| (a - b).abs() < 1e-12)
            );
        }
    }

    #[test]
    fn retuning_makes_no_jump() {
        let mut filter = LowPass::new(25.0);
        filter.step([0.0; 3]);
        let before = (0..10).fold(0.0, |_, _| filter.step([1.0; 3])[0]);
        filter.retune(200.0);
        let after = filter.step([1.0; 3])[0];
        assert!(
            before > 0.4 && after > before && after - before < 0.4,
            "{before} {after}"
        );
    }

    #[test]
    fn absurd_bandwidths_are_held_within_the_limits() {
        for bandwidth_hz in [f64::NAN, -1.0, 0.0, 1e9, f64::INFINITY] {
            let mut filter = LowPass::new(bandwidth_hz);
            filter.step([0.0; 3]);
            let out = filter.step([1.0; 3])[0];
            assert!((0.0..1.1).contains(&out), "{bandwidth_hz}: {out}");
        }
    }
}
