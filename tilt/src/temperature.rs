//! Temperature compensation: from the filtered acceleration to that at 25 degC.
//!
//! In: [`Filtered`] and the part's own [`Temperature`]. Out: [`Compensated`]. Four models, chosen
//! by configuration: none, the data sheet's coefficient (R3, eq 5), the chamber's piecewise slopes
//! (R4, eq 6), and the product's quadratics of offset and gain.
//!
//! The temperature is the one the part itself reports. Its offset (up to 15 degC) and gain error
//! do no harm, because the chamber run that yields the coefficients is read off the same sensor.
//!
//! # Erratum E12: eq 6 is a slope, not a bias
//! B_n is in mg/degC. The bias to remove at T is the sum of slope times temperature step on the
//! way from 25 degC to T; that sum is what [`Piecewise`] forms. It mends the offset only. The
//! product model adds the gain, and is fitted on four orientations and both branches of the run.
//!
//! Left out: fitting (see `calibration::thermal`) and smoothing of the thermometer (the chain).

use crate::composition::{Composition, Place, Whole};
use crate::filter::Filtered;
use crate::sample::Temperature;
use crate::saturate::saturate;

/// Acceleration as the part would give it at 25 degC; 2^-26 g nominal per step, part's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Compensated {
    /// The x, y and z axes of the part.
    pub accel: [i32; 3],
}

/// Which compensation runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TemperatureModel<C: Composition = Whole> {
    /// Nothing is removed.
    None,
    /// Eq 5: bias = TCO (T - 25 degC).
    DataSheet(DataSheet),
    /// Eq 6 summed up: slopes between the chamber's temperatures.
    Piecewise(Piecewise),
    /// Product mode: quadratics of offset and gain.
    Quadratic(C::Quadratic),
}

/// The data-sheet model of R3.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DataSheet {
    /// TCO of each axis in 1/256 step (of 2^-26 g) per degC. 0.2 mg/degC is 3 435 974.
    pub tco_q8: [i32; 3],
}

/// How many temperatures the chamber run of R4 holds: -10 to 70 degC in steps of 10.
pub const KNOTS: usize = 9;

/// The chamber's slopes (R4, eq 6): one per interval between neighbouring temperatures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Piecewise {
    /// Temperatures the part reported at each step of the chamber, rising.
    pub knots: [Temperature; KNOTS],
    /// B_n of each interval and axis, 1/256 step (of 2^-26 g) per degC.
    pub slopes_q8: [[i32; 3]; KNOTS - 1],
}

/// Offset and gain as quadratics of d = T - 25 degC: y = (x - d (b1 + b2 d)) (1 + d (g1 + g2 d)).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quadratic {
    /// b1 of each axis, 1/256 step (of 2^-26 g) per degC.
    pub offset1_q8: [i32; 3],
    /// b2 of each axis, 1/65536 step per degC^2.
    pub offset2_q16: [i32; 3],
    /// g1 of each axis, 2^-38 per degC.
    pub gain1_q38: [i32; 3],
    /// g2 of each axis, 2^-46 per degC^2.
    pub gain2_q46: [i32; 3],
}

/// What a model removes at one temperature, for whoever compensates many samples at it:
/// y = (x - offset) (1 + gain).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CompensationAt {
    /// Of each axis, 2^-26 g per step.
    offset: [i32; 3],
    /// Of each axis, 2^-30 per step.
    gain_q30: [i32; 3],
}

impl CompensationAt {
    /// Removes it; the same bits as [`TemperatureModel::apply`].
    pub fn apply(&self, input: Filtered) -> Compensated {
        let mut accel = input.accel;
        let terms = self.offset.iter().zip(&self.gain_q30);
        for (value, (offset, gain_q30)) in accel.iter_mut().zip(terms) {
            *value = freed(*value, i64::from(*offset), *gain_q30);
        }
        Compensated { accel }
    }
}

/// A value without an offset and a gain error.
#[inline(always)]
fn freed(value: i32, offset: i64, gain_q30: i32) -> i32 {
    let centred = i64::from(saturate(i64::from(value) - offset));
    saturate(centred + ((centred * i64::from(gain_q30)) >> 30))
}

/// Distance from 25 degC in 1/256 degC, held inside the part's operating range (-40..85 degC).
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
pub(crate) fn from_reference(t: Temperature) -> i64 {
    const LOW: i32 = -40 * 256;
    const HIGH: i32 = 85 * 256;
    i64::from(t.0.clamp(LOW, HIGH) - Temperature::REFERENCE.0)
}

impl<C: Composition> TemperatureModel<C> {
    /// Removes the model's error at `t`.
    pub fn apply(&self, input: Filtered, t: Temperature) -> Compensated {
        match self {
            Self::None => Compensated { accel: input.accel },
            Self::DataSheet(model) => subtract(input, model.bias(t)),
            Self::Piecewise(model) => subtract(input, model.bias(t)),
            Self::Quadratic(model) => model.get().apply(input, t),
        }
    }

    /// What is removed at `t`.
    pub fn at(&self, t: Temperature) -> CompensationAt {
        let of = |offset| CompensationAt {
            offset,
            gain_q30: [0; 3],
        };
        match self {
            Self::None => CompensationAt::default(),
            Self::DataSheet(model) => of(model.bias(t)),
            Self::Piecewise(model) => of(model.bias(t)),
            Self::Quadratic(model) => model.get().at(t),
        }
    }
}

fn subtract(input: Filtered, bias: [i32; 3]) -> Compensated {
    let ([x, y, z], [bias_x, bias_y, bias_z]) = (input.accel, bias);
    Compensated {
        accel: [
            x.saturating_sub(bias_x),
            y.saturating_sub(bias_y),
            z.saturating_sub(bias_z),
        ],
    }
}

impl DataSheet {
    /// Bias at `t` in 2^-26 g (eq 5).
    pub fn bias(&self, t: Temperature) -> [i32; 3] {
        let d = from_reference(t);
        self.tco_q8.map(|tco| saturate((i64::from(tco) * d) >> 16))
    }
}

impl Piecewise {
    /// Accumulated bias at `t` in 2^-26 g, 0 at 25 degC; the outer slopes go on beyond the run.
    pub fn bias(&self, t: Temperature) -> [i32; 3] {
        let mut sum = [0i64; 3];
        let inner = self.knots.windows(2).zip(&self.slopes_q8).enumerate();
        for (i, (ends, slopes)) in inner {
            let [low, high] = *ends else { continue };
            let low = if i == 0 { Temperature(-(1 << 20)) } else { low };
            let high = if i == KNOTS - 2 {
                Temperature(1 << 20)
            } else {
                high
            };
            let span = clip(t, low, high) - clip(Temperature::REFERENCE, low, high);
            for (s, &slope) in sum.iter_mut().zip(slopes) {
                *s += i64::from(slope) * span;
            }
        }
        sum.map(|s| saturate(s >> 16))
    }
}

/// `t` within `low..=high`; never panics, even where a damaged record has them reversed.
fn clip(t: Temperature, low: Temperature, high: Temperature) -> i64 {
    i64::from(t.max(low).min(high).0)
}

impl Quadratic {
    /// Removes offset and gain error at `t`.
    pub fn apply(&self, input: Filtered, t: Temperature) -> Compensated {
        let d = from_reference(t);
        let mut accel = input.accel;
        let offsets = self.offset1_q8.iter().zip(&self.offset2_q16);
        let gains = self.gain1_q38.iter().zip(&self.gain2_q46);
        for ((value, (&b1, &b2)), (&g1, &g2)) in accel.iter_mut().zip(offsets).zip(gains) {
            let gain_q30 = saturate(quadratic(g1, g2, d));
            *value = freed(*value, quadratic(b1, b2, d), gain_q30);
        }
        Compensated { accel }
    }

    /// Offset and gain error at `t`; each is below 2^31.
    fn at(&self, t: Temperature) -> CompensationAt {
        let d = from_reference(t);
        let mut found = CompensationAt::default();
        let offsets = self.offset1_q8.iter().zip(&self.offset2_q16);
        let gains = self.gain1_q38.iter().zip(&self.gain2_q46);
        for (offset, (b1, b2)) in found.offset.iter_mut().zip(offsets) {
            *offset = saturate(quadratic(*b1, *b2, d));
        }
        for (gain_q30, (g1, g2)) in found.gain_q30.iter_mut().zip(gains) {
            *gain_q30 = saturate(quadratic(*g1, *g2, d));
        }
        found
    }
}

/// d (c1 + c2 d) for c1 with n and c2 with n + 8 fractional bits, d in 1/256; loses 8 bits of n.
pub(crate) fn quadratic(c1: i32, c2: i32, d: i64) -> i64 {
    let slope = (i64::from(c1) << 16) + i64::from(c2) * d;
    (slope * d) >> 32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ONE_G;

    const MG: f64 = ONE_G as f64 / 1000.0;

    fn at(celsius: f64) -> Temperature {
        Temperature((celsius * 256.0).round() as i32)
    }

    #[test]
    fn eq5_bias_is_tco_times_distance_from_25() {
        let model = DataSheet {
            tco_q8: [(0.2 * MG * 256.0) as i32; 3],
        };
        assert_eq!(model.tco_q8[0], 3_435_973);
        for t in [-10.0, 0.0, 25.0, 70.0] {
            let got = f64::from(model.bias(at(t))[0]) / MG;
            assert!((got - 0.2 * (t - 25.0)).abs() < 1e-4, "{t}: {got}");
        }
    }

    #[test]
    fn what_is_kept_for_many_samples_removes_the_same_bits() {
        let quadratic = Quadratic {
            offset1_q8: [i32::MAX, -3_435_973, 17],
            offset2_q16: [i32::MAX, 900_000, i32::MIN],
            gain1_q38: [i32::MIN, 54_975_581, i32::MAX],
            gain2_q46: [i32::MAX, -7_000_000, i32::MAX],
        };
        let piecewise = Piecewise {
            knots: core::array::from_fn(|i| at(-10.0 + 10.0 * i as f64)),
            slopes_q8: [[1_000_000, -2_000_000, i32::MAX]; KNOTS - 1],
        };
        let sheet = DataSheet {
            tco_q8: [3_435_973, i32::MIN, 5],
        };
        let models: [TemperatureModel; 4] = [
            TemperatureModel::None,
            TemperatureModel::DataSheet(sheet),
            TemperatureModel::Piecewise(piecewise),
            TemperatureModel::Quadratic(quadratic),
        ];
        for model in &models {
            for t in [-60.0, -40.0, 24.9, 25.0, 85.0].map(at) {
                let kept = model.at(t);
                for value in [i32::MIN, -ONE_G, 0, 12_345, ONE_G, i32::MAX] {
                    let input = Filtered { accel: [value; 3] };
                    assert_eq!(kept.apply(input), model.apply(input, t), "{model:?} {t:?}");
                }
            }
        }
    }

    #[test]
    fn e12_slopes_are_summed_from_25_degc() {
        // A parabola of 0.02 mg/degC^2 about 25 degC: its secants, summed, meet it at the knots.
        let parabola = |t: f64| 0.02 * (t - 25.0).powi(2);
        let mut model = Piecewise::default();
        for i in 0..KNOTS {
            model.knots[i] = at(-10.0 + 10.0 * i as f64);
        }
        for i in 0..KNOTS - 1 {
            let t = -10.0 + 10.0 * i as f64;
            let slope = (parabola(t + 10.0) - parabola(t)) / 10.0;
            model.slopes_q8[i] = [(slope * MG * 256.0).round() as i32; 3];
        }
        assert_eq!(model.bias(at(25.0)), [0; 3]);
        // The secant through 20 and 30 degC lies 0.5 mg above the parabola at 25 degC, where the
        // model has its zero; every other knot carries that same 0.5 mg.
        for t in [-10.0, 0.0, 10.0, 50.0, 70.0] {
            let got = f64::from(model.bias(at(t))[1]) / MG;
            assert!((got - (parabola(t) - 0.5)).abs() < 1e-3, "{t}: {got}");
        }
        // Beyond the run the last slope (1.6 mg/degC... of 60..70 degC) goes on.
        let beyond = f64::from(model.bias(at(80.0))[2]) / MG;
        assert!((beyond - (parabola(70.0) - 0.5 + 0.02 * (45.0 + 35.0) * 10.0)).abs() < 2e-3);
    }

    #[test]
    fn quadratic_removes_offset_and_gain() {
        let (b1, b2, g1, g2) = (0.3, -0.0008, 1.2e-4, 3e-8);
        let model = Quadratic {
            offset1_q8: [(b1 * MG * 256.0) as i32; 3],
            offset2_q16: [(b2 * MG * 65536.0) as i32; 3],
            gain1_q38: [(g1 * 2f64.powi(38)) as i32; 3],
            gain2_q46: [(g2 * 2f64.powi(46)) as i32; 3],
        };
        for t in [-40.0, -10.0, 25.0, 70.0, 85.0] {
            let d = t - 25.0;
            let x = 0.8 * f64::from(ONE_G);
            let want = (x - d * (b1 + b2 * d) * MG) * (1.0 + d * (g1 + g2 * d));
            let got = model
                .apply(
                    Filtered {
                        accel: [x as i32; 3],
                    },
                    at(t),
                )
                .accel[0];
            assert!((f64::from(got) - want).abs() < 0.0005 * MG, "{t}");
        }
    }

    #[test]
    fn damaged_coefficients_do_not_overflow() {
        for v in [i32::MIN, i32::MAX] {
            let q = Quadratic {
                offset1_q8: [v; 3],
                offset2_q16: [v; 3],
                gain1_q38: [v; 3],
                gain2_q46: [v; 3],
            };
            let p = Piecewise {
                knots: [Temperature(v); KNOTS],
                slopes_q8: [[v; 3]; KNOTS - 1],
            };
            for t in [Temperature(i32::MIN), Temperature(i32::MAX), at(25.0)] {
                for x in [i32::MIN, i32::MAX] {
                    let input = Filtered { accel: [x; 3] };
                    let _ = TemperatureModel::<Whole>::Quadratic(q).apply(input, t);
                    let _ = TemperatureModel::<Whole>::Piecewise(p).apply(input, t);
                }
            }
        }
    }
}
