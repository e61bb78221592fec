//! The paper's look-up table: acceleration of one axis to angle (R5, R6).
//!
//! In: the compensated acceleration of one axis. Out: the angle memorised for it. Three rules:
//! - [`Rule::Nearest`] is the text: the angle of the nearer of the two neighbouring points,
//!   switching in the middle between them;
//! - [`Rule::Linear`] interpolates, by which paper mode has the paper's own figures;
//! - [`Rule::PrintedQuarter`] is eq 7 to the letter, for analysis only.
//!
//! # Errata
//! - E3: eq 7 halves the distance and its conditions halve it again, so the printed rule switches
//!   at a quarter of the step: 0.38 deg rms and 0.25 deg of bias away from zero, where the middle,
//!   which the text describes, gives 0.289.
//! - E4: a 1 deg table read by the nearest rule is 0.289 deg rms between its knots. It can be
//!   neither +-0.2 deg nor resolve 0.001 deg.
//! - E5: a static test in 10 deg steps stands on knots only and does not see that error.
//! - E6: one axis loses its sensitivity as the cosine of the angle; at 90 deg the last degree
//!   spans 0.6 LSB. The noise makes neighbouring points change places there, so the table is
//!   made monotone by pooling such neighbours; where points share an acceleration, the end of the
//!   pool nearer to the reading answers.
//! - E7: ignoring z couples the axes: a true roll of 10 deg reads 7.05 deg at 45 deg pitch.

use heapless::Vec;

use crate::angle::Angle;
use crate::root::root;
use crate::saturate::saturate;

/// Most points a table holds: -90 to 90 deg in steps of 1 deg (R5).
pub const MAX_POINTS: usize = 181;

/// One memorised pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Point {
    /// Filtered, compensated acceleration of the axis, 2^-26 g per step.
    pub accel: i32,
    /// The reference's angle.
    pub angle: Angle,
}

/// How a reading between two points becomes an angle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rule {
    /// The nearer point, switching at the middle (the text of section III).
    #[default]
    Nearest,
    /// A straight line between the two points.
    Linear,
    /// Eq 7 as printed, switching at a quarter of the step counted from the point nearer zero.
    PrintedQuarter,
}

/// Why points do not make a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableError {
    /// Fewer than two points.
    TooFew,
    /// More than [`MAX_POINTS`].
    TooMany,
    /// Angles must rise from point to point.
    NotRising,
    /// The acceleration hardly changes over the whole table: wrong axis, or a dead part.
    Flat,
}

/// A table of up to [`MAX_POINTS`] points, rising in angle and not falling in acceleration.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    points: Vec<Point, MAX_POINTS>,
}

impl Table {
    /// Builds a table from memorised points with rising angles.
    ///
    /// Accelerations that fall from one point to the next are pooled to their mean. Errors: see
    /// [`TableError`].
    pub fn new(memorised: &[Point]) -> Result<Self, TableError> {
        let mut table = Self::default();
        table.refill(memorised)?;
        Ok(table)
    }

    /// Puts memorised points in the place of the present ones, as [`Table::new`] does.
    ///
    /// Errors: see [`TableError`]; the table is then empty.
    pub fn refill(&mut self, memorised: &[Point]) -> Result<(), TableError> {
        let mut builder = self.rebuild();
        for point in memorised {
            builder.push(*point)?;
        }
        builder.finish()
    }

    /// Empties the table and takes new points one by one, which needs no room for a second one.
    pub fn rebuild(&mut self) -> Builder<'_> {
        self.points.clear();
        Builder {
            table: self,
            sound: false,
        }
    }

    /// Whether these points make a table. Errors: see [`TableError`].
    pub fn check(memorised: &[Point]) -> Result<(), TableError> {
        if memorised.len() > MAX_POINTS {
            return Err(TableError::TooMany);
        }
        if memorised.len() < 2 {
            return Err(TableError::TooFew);
        }
        if !memorised.is_sorted_by(|a, b| a.angle < b.angle) {
            return Err(TableError::NotRising);
        }
        // What the first and the last stretch are pooled to; the last is the first of the same
        // points turned round.
        let lowest = first_pooled(memorised, false);
        let highest = -first_pooled(memorised, true);
        if highest - lowest < i64::from(crate::ONE_G / 100) {
            return Err(TableError::Flat);
        }
        Ok(())
    }

    /// The points in use, rising.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// The step around `accel`: from the last point not above it to the first above it; beyond the
    /// ends, the end twice.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn step_around(&self, accel: i32) -> Step {
        let points = self.points();
        let above = points.partition_point(|p| p.accel <= accel);
        let high = points.get(above).or(points.last());
        let low = above.checked_sub(1).and_then(|i| points.get(i));
        Step {
            low: low.or(points.first()).copied().unwrap_or_default(),
            high: high.copied().unwrap_or_default(),
        }
    }

    /// The angle for `accel` by `rule`; beyond the ends, the end's angle.
    pub fn look_up(&self, accel: i32, rule: Rule) -> Angle {
        let Step { low, high } = self.step_around(accel);
        let step = i64::from(high.accel) - i64::from(low.accel);
        if step <= 0 {
            return low.angle;
        }
        let way = i64::from(accel) - i64::from(low.accel);
        match rule {
            Rule::Nearest if 2 * way < step => low.angle,
            Rule::Nearest => high.angle,
            Rule::Linear => {
                let rise = i64::from(high.angle.minus(low.angle).0);
                Angle(low.angle.0.wrapping_add((rise * way / step) as i32))
            }
            // "Previous" is the point nearer to zero, so that the sizes in eq 7 make sense for
            // negative accelerations too.
            Rule::PrintedQuarter if i64::from(low.accel) + i64::from(high.accel) >= 0 => {
                if 4 * way < step {
                    low.angle
                } else {
                    high.angle
                }
            }
            Rule::PrintedQuarter => {
                if 4 * (step - way) < step {
                    high.angle
                } else {
                    low.angle
                }
            }
        }
    }

    /// Standard deviation of single points about the sine through their neighbours, 2^-26 g: the
    /// noise of what was memorised, and of the reference. 0 of fewer than three points.
    pub fn scatter(&self) -> u32 {
        let (mut sum, mut count) = (0u64, 0);
        for triple in self.points().windows(3) {
            let [low, middle, high] = triple else {
                continue;
            };
            let off = u64::from(off_its_neighbours(*low, *middle, *high).unsigned_abs());
            sum = sum.saturating_add(2 * off * off);
            // Of a point and its two neighbours, half as uncertain together, 2/3 are the point's.
            count += 3;
        }
        root(sum.checked_div(count).unwrap_or(0))
    }
}

/// Two neighbouring points of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// The lower one.
    pub low: Point,
    /// The higher one.
    pub high: Point,
}

impl Step {
    /// The angle between them, in steps of [`Angle`].
    pub const fn width(&self) -> u32 {
        self.high.angle.minus(self.low.angle).magnitude()
    }

    /// How far the line between the points is off the sine that it cuts short around `accel`, on
    /// the average of its length, in steps of [`Angle`].
    ///
    /// A step of h radians is off by h^2/8 tan(angle) at most, in the middle, where the tangent is
    /// the acceleration times h over its rise; this is 0.81 of that, and the parabola's rms 0.73.
    pub fn sagitta(&self, accel: i32) -> u32 {
        let width = self.width();
        let rise = self.high.accel.abs_diff(self.low.accel);
        // h^2 times (2^16 / 2 pi)^2; then times the tangent over h, and times h.
        let square = u64::from(width >> 16) * u64::from(width >> 16);
        let bend = (square * u64::from(accel.unsigned_abs())).checked_div(rise.into());
        let bend = bend.map_or(0, |bend| bend.min(u64::from(u32::MAX)));
        // 8 (2^16 / 2 pi)^2 is 0.81 of 2^30.
        width.min(((bend * u64::from(width)) >> 30) as u32)
    }
}

/// How far the middle one of three points is off the sine through the other two, 2^-26 g.
fn off_its_neighbours(low: Point, middle: Point, high: Point) -> i32 {
    // Up to 2^16, so that 32 bits are enough for most of it.
    let before = middle.angle.0.abs_diff(low.angle.0) >> 16;
    let after = high.angle.0.abs_diff(middle.angle.0) >> 16;
    let share_q15 = (before << 15).checked_div(before + after).unwrap_or(0);
    let rise = i64::from(high.accel) - i64::from(low.accel);
    let line = i64::from(low.accel) + ((rise * i64::from(share_q15)) >> 15);
    // A line is short of the sine by half the product of both distances in radians; that is
    // pi^2 / 8 of 2^-28, or 79 / 64.
    let bend = (i64::from(middle.accel) * i64::from(before * after)) >> 28;
    let off = i64::from(middle.accel) - line - ((bend * 79) >> 6);
    saturate(off)
}

/// A table that is being filled. Whoever drops it before [`Builder::finish`] has an empty table.
#[derive(Debug)]
pub struct Builder<'a> {
    table: &'a mut Table,
    sound: bool,
}

impl Drop for Builder<'_> {
    fn drop(&mut self) {
        if !self.sound {
            self.table.points.clear();
        }
    }
}

impl Builder<'_> {
    /// Adds the point with the next higher angle. Errors: [`TableError::TooMany`].
    pub fn push(&mut self, point: Point) -> Result<(), TableError> {
        let pushed = self.table.points.push(point);
        pushed.map_err(|_| TableError::TooMany)
    }

    /// Checks the points and pools falling accelerations.
    ///
    /// Errors: see [`TableError`]; the table is then empty.
    pub fn finish(mut self) -> Result<(), TableError> {
        Table::check(&self.table.points)?;
        pool(&mut self.table.points);
        self.sound = true;
        Ok(())
    }
}

/// What [`pool`] makes of the first point: the smallest mean of so many of them. `turned`: of the
/// last point, times -1.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn first_pooled(points: &[Point], turned: bool) -> i64 {
    let (mut sum, mut smallest) = (0, i64::MAX);
    for place in 0..points.len() {
        let back = points.len() - 1 - place;
        let point = points.get(if turned { back } else { place });
        let accel = point.map_or(0, |point| i64::from(point.accel));
        sum += if turned { -accel } else { accel };
        smallest = smallest.min(sum / (place as i64 + 1));
    }
    smallest
}

/// Makes accelerations non-falling by replacing each falling stretch by its mean.
///
/// Pool-adjacent-violators, in place: whenever a point lies below the mean of the stretch before
/// it, it joins that stretch, which may then join the one before.
fn pool(points: &mut [Point]) {
    let mut end = 1;
    while end < points.len() {
        let mut begin = end;
        while let Some((first, joined)) = falls(points, begin, end) {
            begin = first;
            for point in points.get_mut(begin..=end).into_iter().flatten() {
                point.accel = joined;
            }
        }
        end += 1;
    }
}

/// Where the stretch `begin..=end` lies below the one before it: the first index and the mean of
/// both together.
fn falls(points: &[Point], begin: usize, end: usize) -> Option<(usize, i32)> {
    let last_before = begin.checked_sub(1)?;
    let before = points.get(last_before)?.accel;
    if before <= mean(points, begin, end)? {
        return None;
    }
    let mut first = last_before;
    while first > 0 && points.get(first - 1)?.accel == before {
        first -= 1;
    }
    Some((first, mean(points, first, end)?))
}

fn mean(points: &[Point], begin: usize, end: usize) -> Option<i32> {
    let slice = points.get(begin..=end)?;
    let sum: i64 = slice.iter().map(|p| i64::from(p.accel)).sum();
    sum.checked_div(slice.len() as i64).map(|m| m as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ONE_G;
    use std::f64::consts::PI;
    use std::vec::Vec;

    fn sine(degrees: f64) -> i32 {
        ((degrees * PI / 180.0).sin() * f64::from(ONE_G)).round() as i32
    }

    fn perfect() -> Table {
        let points: Vec<_> = (-90..=90)
            .map(|d| Point {
                accel: sine(f64::from(d)),
                angle: Angle::from_degrees(f64::from(d)),
            })
            .collect();
        Table::new(&points).unwrap()
    }

    /// (rms, mean in the direction away from zero) over off-knot angles up to +-`reach`.
    fn errors(rule: Rule, reach: f64) -> (f64, f64) {
        let table = perfect();
        let (mut square, mut outward, mut n) = (0.0, 0.0, 0.0);
        for i in -8994..=8994 {
            let t = (f64::from(i) * 0.01 + 0.0037) * reach / 90.0;
            let e = table.look_up(sine(t), rule).degrees() - t;
            square += e * e;
            outward += e * t.signum();
            n += 1.0;
        }
        ((square / n).sqrt(), outward / n)
    }

    #[test]
    fn e4_nearest_is_0_289_deg_off_knots() {
        let (rms, bias) = errors(Rule::Nearest, 90.0);
        assert!((rms - 0.289).abs() < 0.005, "{rms}");
        assert!(bias.abs() < 0.01, "{bias}");
    }

    #[test]
    fn e3_printed_rule_is_0_38_deg_with_a_quarter_of_bias() {
        // sqrt(1/12 + 1/16) = 0.3819 where the sine is nearly straight; 0.385 over all +-90.
        let (rms, bias) = errors(Rule::PrintedQuarter, 80.0);
        assert!((rms - 0.3819).abs() < 0.002, "{rms}");
        assert!((bias - 0.25).abs() < 0.003, "{bias}");
        assert!((errors(Rule::PrintedQuarter, 90.0).0 - 0.385).abs() < 0.001);
    }

    #[test]
    fn linear_is_far_better() {
        // The last degree before the vertical is the worst; below it hardly anything is left.
        assert!(errors(Rule::Linear, 90.0).0 < 0.04);
        assert!(errors(Rule::Linear, 80.0).0 < 0.005);
    }

    #[test]
    fn e5_knots_do_not_see_the_table_error() {
        let table = perfect();
        for d in (-90..=90).step_by(10) {
            let got = table.look_up(sine(f64::from(d)), Rule::Nearest).degrees();
            assert!((got - f64::from(d)).abs() < 1e-6);
        }
    }

    #[test]
    fn e6_the_last_degree_spans_0_6_lsb() {
        let last = f64::from(sine(90.0) - sine(89.0)) / f64::from(ONE_G) * 1000.0;
        assert!((last / 0.244 - 0.62).abs() < 0.01, "{last} mg");
    }

    #[test]
    fn middle_switches_exactly_in_the_middle() {
        let points = [(0, 0), (ONE_G / 2, 10), (ONE_G, 20)].map(|(accel, d)| Point {
            accel,
            angle: Angle::from_degrees(f64::from(d)),
        });
        let table = Table::new(&points).unwrap();
        let degrees = |a| table.look_up(a, Rule::Nearest).degrees().round() as i32;
        assert_eq!(degrees(ONE_G / 4 - 1), 0);
        assert_eq!(degrees(ONE_G / 4), 10);
        assert_eq!(degrees(i32::MIN), 0);
        assert_eq!(degrees(i32::MAX), 20);
        assert_eq!(
            table.look_up(ONE_G / 4, Rule::Linear).degrees().round() as i32,
            5
        );
    }

    #[test]
    fn refuses_what_is_no_table() {
        let p = |accel, d: f64| Point {
            accel,
            angle: Angle::from_degrees(d),
        };
        assert_eq!(Table::new(&[p(0, 0.0)]), Err(TableError::TooFew));
        assert_eq!(Table::new(&[p(0, 0.0); 182]), Err(TableError::TooMany));
        assert_eq!(
            Table::new(&[p(0, 1.0), p(ONE_G, 1.0)]),
            Err(TableError::NotRising)
        );
        assert_eq!(Table::new(&[p(0, 1.0), p(9, 2.0)]), Err(TableError::Flat));
    }

    #[test]
    fn a_table_that_falls_is_flat_whatever_its_ends_are() {
        let p = |accel, d: f64| Point {
            accel,
            angle: Angle::from_degrees(d),
        };
        let falls = [p(ONE_G, 0.0), p(0, 1.0), p(-ONE_G, 2.0)];
        let mut table = perfect();
        assert_eq!(table.refill(&falls), Err(TableError::Flat));
        assert!(table.points().is_empty());
        let _ = table.rebuild().push(p(0, 0.0));
        assert!(table.points().is_empty(), "it was never finished");
        // Only its last stretch rises, and by less than it takes.
        let few = [p(ONE_G, 0.0), p(0, 1.0), p(ONE_G / 2 + ONE_G / 101, 2.0)];
        assert_eq!(Table::check(&few), Err(TableError::Flat));
        let enough = [p(ONE_G, 0.0), p(0, 1.0), p(ONE_G / 2 + ONE_G / 99, 2.0)];
        assert_eq!(table.refill(&enough), Ok(()));
        assert_eq!(table.points().len(), 3);
    }

    #[test]
    fn noisy_points_are_pooled_monotone() {
        let mut points: Vec<_> = (-90..=90)
            .map(|d| Point {
                accel: sine(f64::from(d)),
                angle: Angle::from_degrees(f64::from(d)),
            })
            .collect();
        let total: i64 = points.iter().map(|p| i64::from(p.accel)).sum();
        for (i, p) in points.iter_mut().enumerate() {
            p.accel += if i % 3 == 0 { 30_000 } else { -15_000 };
        }
        let table = Table::new(&points).unwrap();
        assert!(table.points().windows(2).all(|w| w[0].accel <= w[1].accel));
        let noisy: i64 = points.iter().map(|p| i64::from(p.accel)).sum();
        let pooled: i64 = table.points().iter().map(|p| i64::from(p.accel)).sum();
        assert!(
            (noisy - pooled).abs() < 400,
            "pooling keeps the mean: {noisy} {pooled} {total}"
        );
    }

    #[test]
    fn the_scatter_of_points_is_that_of_the_noise_and_not_of_the_sine() {
        let with_noise = |step: f64, mg: f64| {
            let count = (90.0 / step) as i32;
            let mut state = 1u32;
            let mut noise = || {
                // A sum of twelve uniform numbers has a variance of one.
                let sum: f64 = (0..12)
                    .map(|_| {
                        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        f64::from(state >> 8) / f64::from(1 << 24)
                    })
                    .sum();
                ((sum - 6.0) * mg / 1000.0 * f64::from(ONE_G)) as i32
            };
            let points: Vec<_> = (-count..=count)
                .map(|i| f64::from(i) * step)
                .map(|degrees| Point {
                    accel: sine(degrees) + noise(),
                    angle: Angle::from_degrees(degrees),
                })
                .collect();
            let table = Table::new(&points).unwrap();
            f64::from(table.scatter()) * 1000.0 / f64::from(ONE_G)
        };
        // Of the curve alone the fourth power of the step is left.
        for (step, left_mg) in [(1.0, 0.01), (5.0, 0.01), (10.0, 0.04), (30.0, 2.0)] {
            let mg = with_noise(step, 0.0);
            assert!(mg < left_mg, "{step} deg: {mg}");
        }
        for mg in [0.3, 1.0, 3.0] {
            let seen = with_noise(5.0, mg);
            assert!((seen / mg - 1.0).abs() < 0.35, "{mg}: {seen}");
        }
        assert_eq!(Table::default().scatter(), 0);
        let ends = [-1, 1].map(|side| Point {
            accel: side * ONE_G,
            angle: Angle::from_degrees(f64::from(side) * 90.0),
        });
        assert_eq!(Table::new(&ends).unwrap().scatter(), 0, "no point between");
    }

    #[test]
    fn extremes_do_not_overflow_in_what_a_table_is_worth() {
        let ends = [i32::MIN, -1, 0, 1, i32::MAX];
        let points: Vec<_> = ends
            .iter()
            .map(|end| Point {
                accel: *end,
                angle: Angle(*end),
            })
            .collect();
        let table = Table::new(&points).unwrap();
        table.scatter();
        for accel in ends {
            let step = table.step_around(accel);
            assert!(step.sagitta(accel) <= step.width());
        }
    }
}
