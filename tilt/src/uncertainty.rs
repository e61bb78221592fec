//! Standard uncertainty of each angle, from a budget kept with the calibration.
//!
//! In: the budget, the acceleration an angle came from, its temperature. Out: [`Uncertainty`],
//! one standard deviation (k = 1) in steps of [`Angle`]. It combines, as independent:
//! noise behind the filter, repeatability (turn-on and 1/f floor), thermal hysteresis away from
//! the temperature of the fit, the reference's own uncertainty and the residual of the fit.
//!
//! A calibration holds at the temperatures at which it was made, its [`Span`]: those of the run
//! without a temperature model, those of the chamber with one. Outside the span the zero-g offset
//! and the sensitivity go on by coefficients that nobody measured, so the uncertainty of each axis
//! grows by `tco` for every degree beyond the nearer end.
//!
//! In product mode the sensitivity is 1/g rad per unit of acceleration at every tilt (E6 explains
//! why all three axes are used); only within a few standard deviations of the vertical does the
//! fold of the square root add. In paper mode the table itself propagates the noise: it is read
//! at the acceleration and at +-sqrt(3) standard deviations (a three-point Gauss-Hermite rule,
//! which copes with the steep and saturating ends), and the width of its step is added.
//!
//! Acceleration of the machine is no tilt (E15). What of it shows in the length of the vector is
//! added; what does not show, no accelerometer can measure, and the figure does not contain it.

use crate::ONE_G;
use crate::angle::{Angle, Axes, hypot};
use crate::composition::Composition;
use crate::filter::LowPass;
use crate::root::root_sum;
use crate::sample::Temperature;
use crate::table::{Rule, Table};
use crate::temperature::TemperatureModel;
use crate::vector::Corrected;

/// A standard uncertainty in steps of [`Angle`] (2^-32 of a circle).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Uncertainty(pub u32);

impl Uncertainty {
    /// In degrees.
    pub const fn degrees(self) -> f64 {
        self.0 as f64 / crate::angle::STEPS_PER_DEGREE
    }

    /// The nearest uncertainty to `degrees`, 0 to 180.
    pub const fn from_degrees(degrees: f64) -> Self {
        Self((degrees * crate::angle::STEPS_PER_DEGREE + 0.5) as u32)
    }

    /// That of an angle of which nothing is known: 360 deg / sqrt(12).
    pub const UNKNOWN: Self = Self(NOTHING_KNOWN);

    /// Root of the sum of two squares.
    pub fn combined_with(self, other: Self) -> Self {
        if other.0 == 0 {
            // The root of a square.
            return Self(self.0.min(NOTHING_KNOWN));
        }
        Self(root_sum(self.0, other.0).min(NOTHING_KNOWN))
    }
}

/// Temperatures at which a calibration holds, as the part's own thermometer tells them.
///
/// With `low` above `high` it is what two spans that do not meet have in common: each end counts
/// as far as it is away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// The lowest.
    pub low: Temperature,
    /// The highest.
    pub high: Temperature,
}

impl Span {
    /// 25 degC, where the data sheet states offset and sensitivity.
    pub const REFERENCE: Self = Self::at(Temperature::REFERENCE);

    /// No temperature: what the first one makes a span of.
    pub const NOWHERE: Self = Self {
        low: Temperature(i32::MAX),
        high: Temperature(i32::MIN),
    };

    /// -10 to 70 degC, the chamber run of R4.
    pub const CHAMBER: Self = Self {
        low: Temperature::from_celsius(-10),
        high: Temperature::from_celsius(70),
    };

    /// One temperature.
    pub const fn at(temperature: Temperature) -> Self {
        Self {
            low: temperature,
            high: temperature,
        }
    }

    /// From the lowest to the highest of `temperatures`; [`Span::NOWHERE`] of none.
    pub fn of(temperatures: impl IntoIterator<Item = Temperature>) -> Self {
        let each = temperatures.into_iter();
        each.fold(Self::NOWHERE, |span, temperature| span.widened(temperature))
    }

    /// The span that a calibration was made with before its format told one.
    ///
    /// The coefficients of a model come from a chamber run, and there was that of R4 alone.
    pub const fn implied_by<C: Composition>(model: &TemperatureModel<C>) -> Self {
        match model {
            TemperatureModel::None => Self::REFERENCE,
            _ => Self::CHAMBER,
        }
    }

    /// This span and `temperature`.
    #[must_use]
    pub fn widened(self, temperature: Temperature) -> Self {
        Self {
            low: self.low.min(temperature),
            high: self.high.max(temperature),
        }
    }

    /// What this span and `other` have in common.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            low: self.low.max(other.low),
            high: self.high.min(other.high),
        }
    }

    /// Half way between the ends.
    pub const fn middle(self) -> Temperature {
        Temperature(self.low.0.midpoint(self.high.0))
    }

    /// How far `temperature` is outside, 1/256 degC; 0 within.
    pub fn beyond(&self, temperature: Temperature) -> u32 {
        let below = self.low.0.wrapping_sub(temperature.0);
        let above = temperature.0.wrapping_sub(self.high.0);
        below.max(above).max(0).unsigned_abs()
    }
}

impl Default for Span {
    fn default() -> Self {
        Self::NOWHERE
    }
}

/// Change of one axis per degC of a part that was never in a chamber, 2^-26 g (k = 1).
///
/// TCO +-0.2 mg/degC and TCS 0.01 %/degC, which is 0.1 mg/degC at 1 g \[DS\]: together
/// 0.224 mg/degC.
pub const TCO: u32 = 15_006;

/// The part of [`TCO`] that is left where the offset is compensated and the sensitivity is not.
pub const TCS: u32 = 6_711;

/// A thousandth of g in 2^-26 g.
const MG: u32 = 67_109;

/// Turn-on repeatability of 0.3 mg, once for the calibration and once for the use, and the 1/f
/// floor of 0.04 mg: 0.426 mg, 2^-26 g per step \[ASSUME\].
const TURN_ONS: u32 = 28_598;

/// Thermal hysteresis, half the opening of the loop: 0.5 mg, 2^-26 g per step \[ASSUME\].
const HYSTERESIS: u32 = 33_554;

/// What is known of the spread of one channel; all k = 1.
///
/// There is no default: a channel that measures has the budget of its calibration, or else
/// [`Budget::DATA_SHEET`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// White noise of one axis, standard deviation of single samples, 2^-26 g per step.
    pub noise: u32,
    /// What the zero of one axis is off by, 2^-26 g per step: turn-on repeatability and 1/f floor;
    /// of a part that is not calibrated, its zero-g offset.
    pub repeatability: u32,
    /// Thermal hysteresis of one axis, whole from 5 degC away from `fitted_at` on, 2^-26 g per
    /// step.
    pub hysteresis: u32,
    /// The calibration reference's own uncertainty; without a calibration, that of the mounting.
    pub reference: Uncertainty,
    /// What the fit left.
    pub residual: Uncertainty,
    /// Where acceleration was related to angles: there the hysteresis was part of it.
    pub fitted_at: Temperature,
    /// Zero-g offset of one axis per degC beyond the span, 2^-26 g per step.
    pub tco: u32,
    /// Where the calibration holds.
    pub span: Span,
}

/// An excursion leaves the loop of the hysteresis open where it was closed at the fit: as much as
/// if that were 3 degC away from it, 1/256 degC.
const LOOP: u32 = 3 * 256;

/// Angle steps per acceleration step, in 1/65536: (2^32 / 2 pi) / 2^26.
const STEPS_PER_ACCEL_Q16: u64 = 667_544;

fn square(value: u32) -> u64 {
    u64::from(value) * u64::from(value)
}

/// Standard deviation of an angle of which nothing is known: 360 deg / sqrt(12), 103.9 deg.
const NOTHING_KNOWN: u32 = 1_239_850_262;

fn root(value: u64) -> Uncertainty {
    Uncertainty(crate::root::root(value).min(NOTHING_KNOWN))
}

impl Budget {
    /// Of a part as it was soldered: the spread of all parts of its kind.
    ///
    /// LIS2DW12: zero-g offset +-20 mg, 90 ug/rtHz at 400 samples/s \[DS\]. Mounting 1 deg; the
    /// angles between the axes, 0.5 deg each, sensitivity 1 % and nonlinearity 1 mg/g^2 and
    /// 1 mg/g^3 come to 0.7 deg at the worst pose \[ASSUME\].
    pub const DATA_SHEET: Self = Self {
        noise: crate::health::noise(2500),
        repeatability: 20 * MG,
        ..Self::calibrated(
            Uncertainty::from_degrees(1.0),
            Uncertainty::from_degrees(0.7),
            Span::REFERENCE,
        )
    };

    /// Of a part that was calibrated within one power-on: against a reference of this uncertainty,
    /// with this residual, at these temperatures.
    ///
    /// The rest no single calibration shows: turn-on repeatability, 1/f floor and thermal
    /// hysteresis \[ASSUME\], noise at 400 samples/s and [`TCO`] \[DS\].
    pub const fn calibrated(reference: Uncertainty, residual: Uncertainty, span: Span) -> Self {
        Self {
            noise: crate::health::noise(2500),
            repeatability: TURN_ONS,
            hysteresis: HYSTERESIS,
            reference,
            residual,
            fitted_at: span.middle(),
            tco: TCO,
            span,
        }
    }

    /// Becomes that of a calibration by `tables`, the scatter of whose points stays in them,
    /// against a reference of this uncertainty. Noise, and what goes with the temperature, stay.
    pub fn take_tables(&mut self, tables: &Axes<Table>, reference: Uncertainty) {
        let scatter = tables.x.scatter().max(tables.y.scatter());
        self.repeatability = root(square(TURN_ONS).saturating_add(square(scatter))).0;
        self.reference = reference;
        self.residual = Uncertainty(0);
    }

    /// Becomes that of a fit at the temperatures of `run`. A temperature model, if there is one,
    /// keeps what it leaves and where it holds; without one that is where the fit was made.
    pub fn take_run<C: Composition>(&mut self, run: Span, temperature: &TemperatureModel<C>) {
        self.fitted_at = run.middle();
        if matches!(temperature, TemperatureModel::None) {
            self.hysteresis = HYSTERESIS;
            self.tco = TCO;
            self.span = run;
        }
    }

    /// Standard deviation of one axis behind `filter` at `t`, 2^-26 g per step.
    pub fn accel(&self, filter: &LowPass, t: Temperature) -> u32 {
        root(self.noise_power(filter).saturating_add(self.standing(t))).0
    }

    /// [`Budget::accel`] of a mean so long that no noise is left in it.
    pub fn accel_at_rest(&self, t: Temperature) -> u32 {
        root(self.standing(t)).0
    }

    /// Square of what does not scatter from sample to sample.
    fn standing(&self, t: Temperature) -> u64 {
        let opened =
            t.0.abs_diff(self.fitted_at.0)
                .saturating_add(LOOP)
                .min(8 * 256);
        let hysteresis = (u64::from(self.hysteresis) * u64::from(opened)) >> 11;
        square(self.repeatability)
            .saturating_add(hysteresis.saturating_mul(hysteresis))
            .saturating_add(square(self.drift(t)))
    }

    /// What the offset of one axis may have drifted by at `t`, 2^-26 g per step.
    fn drift(&self, t: Temperature) -> u32 {
        let drift = (u64::from(self.tco) * u64::from(self.span.beyond(t))) >> 8;
        u32::try_from(drift).unwrap_or(u32::MAX)
    }

    /// Noise alone behind `filter`: what scatters from reading to reading at a standstill.
    pub fn noise_only(&self, filter: &LowPass) -> Uncertainty {
        accel_to_angle(root(self.noise_power(filter)).0)
    }

    fn noise_power(&self, filter: &LowPass) -> u64 {
        ((square(self.noise) >> 15) * u64::from(filter.noise_power_q30())) >> 15
    }

    fn systematic(&self) -> u64 {
        square(self.reference.0).saturating_add(square(self.residual.0))
    }

    /// Uncertainty of a slope or turn that a three-axis formula found, the machine's own
    /// acceleration left out.
    ///
    /// `accel` is [`Budget::accel`]; `beside` is the length of what the angle's own axis does not
    /// take part in (hypot(y, z) for slope X).
    pub fn of_vector(&self, beside: i32, accel: u32) -> Uncertainty {
        let accel = if folds(beside, accel) {
            root(square(accel).saturating_mul(2)).0
        } else {
            accel.min(NOTHING_KNOWN)
        };
        let from_accel = accel_to_angle(accel);
        root(square(from_accel.0).saturating_add(self.systematic()))
    }

    /// [`Budget::of_vector`] of both slopes, `beside` each of them; it is the same as a rule.
    pub fn of_vectors(&self, beside: Axes<i32>, accel: u32) -> Axes<Uncertainty> {
        let x = self.of_vector(beside.x, accel);
        let same = folds(beside.x, accel) == folds(beside.y, accel);
        let y = if same {
            x
        } else {
            self.of_vector(beside.y, accel)
        };
        Axes { x, y }
    }

    /// What the machine's acceleration may do to the angle, as far as the vector's length shows
    /// it: 0 while the length is 1 g to within four standard deviations (E15).
    pub fn of_motion(&self, vector: Corrected, accel: u32) -> Uncertainty {
        let [x, y, z] = vector.accel;
        let off = hypot(hypot(x, y), z).abs_diff(ONE_G);
        accel_to_angle(off.saturating_sub(accel.saturating_mul(4)))
    }

    /// Uncertainty of an angle that `table` gave for `reading` by `rule`; `accel` as above.
    pub fn of_table(&self, table: &Table, rule: Rule, reading: i32, accel: u32) -> Uncertainty {
        // sqrt(3) = 1.7320508.
        let reach = i32::try_from((u64::from(accel) * 113_512) >> 16).unwrap_or(i32::MAX);
        let at = |a| i64::from(table.look_up(a, Rule::Linear).0);
        let middle = at(reading);
        let below = at(reading.saturating_sub(reach)) - middle;
        let above = at(reading.saturating_add(reach)) - middle;
        // The second moment about the reading, not about the mean: at the table's end all that
        // is uncertain lies on one side.
        let spread = (below * below + above * above) / 6;
        let spread = u64::try_from(spread).unwrap_or(0);
        root(
            spread
                .saturating_add(square(table_error(table, rule, reading, reach)))
                .saturating_add(self.systematic()),
        )
    }
}

/// What `rule` makes of the step of `table` around `reading`, and beyond its end, where the angle
/// stops, what may be left of the way up to the vertical: a standard uncertainty.
fn table_error(table: &Table, rule: Rule, reading: i32, reach: i32) -> u32 {
    /// Near the vertical an axis turns further than its acceleration tells at level.
    const STEEPER: u32 = 8;
    const VERTICAL: u32 = 1 << 30;
    let step = table.step_around(reading);
    let wide = u64::from(step.width());
    match rule {
        _ if wide == 0 => {
            let beyond = reading.abs_diff(step.low.accel);
            let beyond = beyond.saturating_sub(reach.unsigned_abs());
            let left = VERTICAL.saturating_sub(step.low.angle.magnitude());
            left.min(accel_to_angle(beyond.saturating_mul(STEEPER)).0)
        }
        Rule::Linear => step.sagitta(reading),
        // 1 / sqrt(12) and, with a quarter of a step of bias beside the spread (E3), sqrt(7 / 48).
        Rule::Nearest => ((wide * 18_919) >> 16) as u32,
        Rule::PrintedQuarter => ((wide * 25_027) >> 16) as u32,
    }
}

/// True near the vertical, where the fold of the square root adds.
const fn folds(beside: i32, accel: u32) -> bool {
    beside.unsigned_abs() < accel.saturating_mul(2)
}

fn accel_to_angle(accel: u32) -> Uncertainty {
    let steps = (u64::from(accel) * STEPS_PER_ACCEL_Q16) >> 16;
    Uncertainty(u32::try_from(steps).unwrap_or(u32::MAX).min(NOTHING_KNOWN))
}

/// How far `a` and `b` are apart, in [`Angle`] steps without sign.
pub const fn distance(a: Angle, b: Angle) -> u32 {
    a.minus(b).magnitude()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Point;
    use std::f64::consts::PI;
    use std::vec::Vec;

    const MG: f64 = ONE_G as f64 / 1000.0;

    /// No spread at all: what single terms are added to.
    const NOTHING: Budget = Budget {
        noise: 0,
        repeatability: 0,
        hysteresis: 0,
        reference: Uncertainty(0),
        residual: Uncertainty(0),
        fitted_at: Temperature::REFERENCE,
        tco: 0,
        span: Span::REFERENCE,
    };

    #[test]
    fn one_milli_g_is_0_0573_deg() {
        let u = accel_to_angle(MG as u32).degrees();
        assert!((u - 0.057_296).abs() < 1e-5, "{u}");
    }

    #[test]
    fn noise_behind_the_paper_filter_is_0_019_deg() {
        // 90 ug/rtHz over 25 Hz (E6): 0.45 mg before, 0.019 deg behind the one-pole.
        let budget = Budget {
            noise: (0.45 * MG) as u32,
            ..NOTHING
        };
        let u = budget.noise_only(&LowPass::PAPER).degrees();
        assert!((u - 0.0192).abs() < 0.0003, "{u}");
    }

    #[test]
    fn the_single_axis_loses_its_sensitivity_e6() {
        let points: Vec<_> = (-90..=90)
            .map(|d| Point {
                accel: ((f64::from(d) * PI / 180.0).sin() * f64::from(ONE_G)) as i32,
                angle: Angle::from_degrees(f64::from(d)),
            })
            .collect();
        let table = Table::new(&points).unwrap();
        let u = |degrees: f64| {
            let reading = ((degrees * PI / 180.0).sin() * f64::from(ONE_G)) as i32;
            let accel = (0.335 * MG) as u32;
            NOTHING
                .of_table(&table, Rule::Linear, reading, accel)
                .degrees()
        };
        assert!((u(0.0) - 0.0192).abs() < 0.001, "{}", u(0.0));
        assert!((u(80.0) - 0.11).abs() < 0.005, "{}", u(80.0));
        // Linear propagation would give 1.1 deg at 89; the end of the table at 90 cuts it.
        assert!(u(89.0) > 0.5 && u(89.0) < 1.1, "{}", u(89.0));
    }

    #[test]
    fn nearest_table_adds_its_step() {
        let points = [0, 1, 2].map(|d| Point {
            accel: d * ONE_G / 50,
            angle: Angle::from_degrees(f64::from(d)),
        });
        let table = Table::new(&points).unwrap();
        let u = NOTHING
            .of_table(&table, Rule::Nearest, ONE_G / 75, 0)
            .degrees();
        assert!((u - 1.0 / 12f64.sqrt()).abs() < 1e-4, "{u}");
    }

    #[test]
    fn motion_that_shows_in_the_norm_is_added() {
        let budget = Budget {
            noise: MG as u32,
            ..NOTHING
        };
        let still = Corrected {
            accel: [0, 0, ONE_G],
        };
        let moved = Corrected {
            accel: [0, 0, ONE_G + (50.0 * MG) as i32],
        };
        let accel = budget.accel(&LowPass::PRODUCT, Temperature::REFERENCE);
        assert_eq!(budget.of_motion(still, accel), Uncertainty(0));
        assert!(budget.of_motion(moved, accel).degrees() > 2.5);
        assert!(budget.of_vector(ONE_G, accel).degrees() < 0.02);
        let folded =
            budget.of_vector(0, accel).degrees() / budget.of_vector(ONE_G, accel).degrees();
        assert!((folded - 2f64.sqrt()).abs() < 1e-4, "{folded}");
    }

    #[test]
    fn both_slopes_are_worth_what_each_of_them_is() {
        let budget = Budget {
            repeatability: (0.7 * MG) as u32,
            reference: Uncertainty::from_degrees(0.01),
            ..NOTHING
        };
        for accel in [0, 1, MG as u32, 1 << 28, u32::MAX] {
            for (x, y) in [(0, 0), (0, ONE_G), (ONE_G, 0), (ONE_G, i32::MAX)] {
                let both = budget.of_vectors(Axes { x, y }, accel);
                assert_eq!(both.x, budget.of_vector(x, accel));
                assert_eq!(both.y, budget.of_vector(y, accel));
            }
        }
        let alone = Uncertainty(NOTHING_KNOWN + 7).combined_with(Uncertainty(0));
        assert_eq!(alone, Uncertainty(NOTHING_KNOWN));
    }

    #[test]
    fn no_uncertainty_is_larger_than_knowing_nothing() {
        let nothing = Uncertainty(NOTHING_KNOWN);
        assert!((nothing.degrees() - 360.0 / 12f64.sqrt()).abs() < 1e-6);
        let shaken = Corrected {
            accel: [i32::MAX; 3],
        };
        assert_eq!(NOTHING.of_motion(shaken, 0), nothing);
        assert_eq!(nothing.combined_with(nothing), nothing);
    }

    #[test]
    fn outside_its_span_an_axis_drifts_by_tco_for_each_degree() {
        let budget = Budget {
            tco: TCO,
            span: Span {
                low: Temperature::from_celsius(20),
                high: Temperature::from_celsius(30),
            },
            ..NOTHING
        };
        let mg = |t: i16| {
            let accel = budget.accel(&LowPass::PRODUCT, Temperature::from_celsius(t));
            f64::from(accel) / MG
        };
        assert_eq!([mg(20), mg(25), mg(30)], [0.0; 3]);
        // sqrt(0.2^2 + 0.1^2) mg/degC.
        assert!((mg(31) - 0.2236).abs() < 1e-3, "{}", mg(31));
        for t in [-10, 60] {
            assert!((mg(t) - 6.708).abs() < 1e-3, "{t}: {}", mg(t));
        }
    }

    #[test]
    fn two_spans_that_do_not_meet_count_by_the_farther_one() {
        let at = Temperature::from_celsius;
        let apart = Span {
            low: at(30),
            high: at(20),
        };
        assert_eq!(
            [15, 20, 25, 35].map(|t| apart.beyond(at(t)) / 256),
            [15, 10, 5, 15]
        );
        let ends = [i32::MIN, i32::MAX].map(Temperature);
        for (low, high) in [(ends[0], ends[1]), (ends[1], ends[0])] {
            let span = Span { low, high };
            for tco in [0, TCO, u32::MAX] {
                let budget = Budget {
                    tco,
                    span,
                    ..NOTHING
                };
                assert!(ends.map(|t| budget.accel(&LowPass::PAPER, t)) <= [NOTHING_KNOWN; 2]);
            }
        }
    }

    #[test]
    fn an_uncalibrated_part_was_worth_0_068_deg_and_is_worth_degrees() {
        let at = |t: i16| {
            let t = Temperature::from_celsius(t);
            let accel = Budget::DATA_SHEET.accel(&LowPass::PRODUCT, t);
            Budget::DATA_SHEET.of_vector(ONE_G, accel).degrees()
        };
        // 20 mg, 1 deg and 0.7 deg.
        assert!((at(25) - 1.675).abs() < 0.005, "{}", at(25));
        assert!((at(70) - 1.77).abs() < 0.01, "{}", at(70));
        let noise = f64::from(Budget::DATA_SHEET.noise) / MG;
        assert!((noise - 0.09 * 200f64.sqrt()).abs() < 1e-4, "{noise}");
    }

    #[test]
    fn a_calibrated_part_still_turns_on_twice() {
        let of = Budget::calibrated(Uncertainty(3), Uncertainty(4), Span::CHAMBER);
        let mg = |steps: u32| f64::from(steps) / MG;
        assert!((mg(of.repeatability) - (0.18 + 0.0016f64).sqrt()).abs() < 1e-4);
        assert!((mg(of.hysteresis) - 0.5).abs() < 1e-4);
        assert_eq!(of.fitted_at, Temperature::from_celsius(30));
        assert!((mg(of.tco) - 0.05f64.sqrt()).abs() < 1e-4);
        assert!((mg(TCS) - 0.1).abs() < 1e-4);
    }

    /// Both ends at 60 deg, in steps of 20, as an interop master memorises them.
    fn coarse() -> Table {
        let points: Vec<_> = (-3..=3)
            .map(|i| f64::from(20 * i))
            .map(|d| Point {
                accel: ((d * PI / 180.0).sin() * f64::from(ONE_G)) as i32,
                angle: Angle::from_degrees(d),
            })
            .collect();
        Table::new(&points).unwrap()
    }

    #[test]
    fn a_line_between_points_20_deg_apart_was_worth_nothing_and_missed_by_a_degree() {
        let table = coarse();
        let (mut sum, mut worth) = (0.0, 0.0);
        for tenth in -590..=590 {
            let degrees = f64::from(tenth) / 10.0;
            let reading = ((degrees * PI / 180.0).sin() * f64::from(ONE_G)) as i32;
            let error = table.look_up(reading, Rule::Linear).degrees() - degrees;
            let u = NOTHING.of_table(&table, Rule::Linear, reading, 0).degrees();
            assert!(error.abs() <= 1.96 * u + 1e-3, "{degrees}: {error} {u}");
            sum += error * error;
            worth += u * u;
        }
        let (rms, worth) = ((sum / 1181.0).sqrt(), (worth / 1181.0).sqrt());
        assert!(
            rms > 0.4 && worth > rms && worth < 1.6 * rms,
            "{rms} {worth}"
        );
    }

    #[test]
    fn beyond_the_end_of_a_table_an_angle_was_held_and_called_certain() {
        let table = coarse();
        for degrees in [-89.0, -75.0, -61.0, 61.0, 65.0, 75.0, 89.0] {
            let reading = ((degrees * PI / 180.0).sin() * f64::from(ONE_G)) as i32;
            for rule in [Rule::Linear, Rule::Nearest] {
                let error = table.look_up(reading, rule).degrees() - degrees;
                let u = NOTHING.of_table(&table, rule, reading, 0).degrees();
                assert!(error.abs() <= 1.96 * u, "{degrees}: {error} {u}");
                assert!(u <= 31.0, "{degrees}: {u}");
            }
        }
        let at_the_end = table.points()[6].accel;
        let u = NOTHING.of_table(&table, Rule::Linear, at_the_end, 0);
        assert_eq!(u, Uncertainty(0));
    }

    #[test]
    fn hysteresis_is_whole_from_5_degc_away_from_the_fit_on_and_never_nothing() {
        let budget = Budget {
            hysteresis: 1000,
            fitted_at: Temperature::from_celsius(20),
            ..NOTHING
        };
        let at = |t: i16| budget.accel(&LowPass::PRODUCT, Temperature::from_celsius(t));
        assert_eq!(
            [at(20), at(21), at(15), at(70), at(-10)],
            [375, 500, 1000, 1000, 1000]
        );
    }
}
