//! Whether a node's slopes are in the unit (6000h) that they are taken in.
//!
//! In: slopes (TPDO 1) in the unit that the plan has, and the angles as measured (TPDO 3) of the
//! same SYNC, which have a unit of their own. Out: whether another unit of CiA 410 explains the
//! slopes and the one taken does not.
//!
//! Preset and offset shift a slope, so what counts is by how much both change. A slope that has
//! turned by 2 deg says which unit it has; four such turns in a row that only another unit
//! explains are a doubt, and one that the unit taken explains ends it. A jump that no unit
//! explains is a preset, or a slope at a limit, and says nothing.
//!
//! Where nothing has turned yet, the numbers themselves count: slopes of all axes that are the
//! measured angles in another unit, without preset, at five SYNCs in a row. One of them has to be
//! large enough that a preset does not come to the same by accident. This doubt ends where it no
//! longer fits.
//!
//! Left out: which unit it is; the node's configuration states that.

use super::exchange::{Measured, slope_minus};

/// The units of CiA 410, 0.001 deg.
const UNITS_MDEG: [i32; 4] = [1, 10, 100, 1000];

/// A turn that tells the unit, 0.001 deg.
const TURN_MDEG: i32 = 2_000;

/// Turns in a row that only another unit explains.
const TURNS: u8 = 4;

/// SYNCs in a row at which the slopes are the angles in another unit.
const ALIKE: u8 = 5;

/// An angle large enough to be compared with the slope itself, 0.001 deg, and the least number.
const LARGE_MDEG: i32 = 5_000;
const LARGE_COUNT: i32 = 50;

/// Slope and angle are each rounded to 0.001 deg, and the difference of two of them twice.
const ROUNDING_MDEG: i32 = 4;

/// Slope and angle of an axis at one SYNC.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// The slope as it was sent, in whatever unit the node has.
    count: i32,
    /// As measured, 0.001 deg.
    angle_mdeg: i32,
}

/// What the slopes of a node have told of their unit.
#[derive(Clone, Debug)]
pub struct Unit {
    /// The one they are taken in, 0.001 deg.
    taken_mdeg: i32,
    /// Where the turn under way began, by axis.
    since: [Option<Point>; 2],
    /// Turns in a row that only another unit explains.
    against: u8,
    /// Whether the latest turn was in the unit taken.
    follows: bool,
    /// SYNCs in a row at which the slopes are the angles in another unit.
    alike: u8,
}

impl Unit {
    pub(super) const fn taken(taken_mdeg: i32) -> Self {
        Self {
            taken_mdeg,
            since: [None; 2],
            against: 0,
            follows: false,
            alike: 0,
        }
    }

    /// True while the slopes are in another unit than they are taken in.
    pub const fn is_another(&self) -> bool {
        self.against >= TURNS || self.alike >= ALIKE
    }

    /// The node has started: it may have been set anew.
    pub(super) const fn restart(&mut self) {
        *self = Self::taken(self.taken_mdeg);
    }

    /// The log has a hole: what turned in it was not seen.
    pub(super) const fn excuse(&mut self) {
        self.since = [None; 2];
    }

    /// Takes the slopes and angles of one SYNC.
    #[inline]
    pub(super) fn judge(&mut self, slopes_mdeg: &[Option<i32>; 2], measured: &Measured) {
        let mut points = [None; 2];
        for (axis, point) in points.iter_mut().enumerate() {
            let both = slopes_mdeg.get(axis).copied().flatten();
            *point = both
                .zip(measured.mdeg(axis))
                .map(|(mdeg, angle_mdeg)| Point {
                    count: mdeg / self.taken_mdeg.max(1),
                    angle_mdeg,
                });
        }
        for axis in 0..2 {
            self.turn(axis, points.get(axis).copied().flatten());
        }
        if self.follows {
            self.alike = 0;
        } else if points.iter().any(Option::is_some) {
            let is_alike = self.others().any(|unit| is_alike(&points, unit));
            self.alike = if is_alike {
                (self.alike + 1).min(ALIKE)
            } else {
                0
            };
        }
    }

    fn turn(&mut self, axis: usize, now: Option<Point>) {
        let (taken, others) = (self.taken_mdeg, self.others());
        let Some(since) = self.since.get_mut(axis) else {
            return;
        };
        let (Some(from), Some(to)) = (*since, now) else {
            *since = now;
            return;
        };
        let turned = slope_minus(to.angle_mdeg, from.angle_mdeg);
        let is_taken = explains(taken, from, to);
        if !is_taken && !others.into_iter().any(|unit| explains(unit, from, to)) {
            *since = now;
            self.follows = false;
            // As at a limit, into which a slope may turn by any part.
            if self.against < TURNS {
                self.against = 0;
            }
        } else if turned.abs() >= TURN_MDEG {
            *since = now;
            self.follows = is_taken;
            self.against = if is_taken {
                0
            } else {
                (self.against + 1).min(TURNS)
            };
        }
    }

    fn others(&self) -> impl Iterator<Item = i32> + use<> {
        let taken = self.taken_mdeg;
        UNITS_MDEG.into_iter().filter(move |unit| *unit != taken)
    }
}

/// Whether a slope of this unit may have gone from one point to the other, in either direction,
/// since a slope may be inverted (6011h).
fn explains(unit_mdeg: i32, from: Point, to: Point) -> bool {
    let turned = slope_minus(to.angle_mdeg, from.angle_mdeg);
    let count = i64::from(to.count) - i64::from(from.count);
    // A fifth of the turn, as PDOs of a log without SYNC may be of two instants. Units are ten
    // times apart.
    let may_be_off = unit_mdeg + ROUNDING_MDEG + turned.abs() / 5;
    is_near(count * i64::from(unit_mdeg), turned, may_be_off)
}

/// Whether the slopes of all axes are the angles in this unit, and one of them is large.
fn is_alike(points: &[Option<Point>; 2], unit_mdeg: i32) -> bool {
    let near = |point: &Point| {
        let slope_mdeg = i64::from(point.count) * i64::from(unit_mdeg);
        is_near(slope_mdeg, point.angle_mdeg, unit_mdeg / 2 + ROUNDING_MDEG)
    };
    let is_large = |point: &Point| {
        let count = point.count.saturating_abs();
        count >= LARGE_COUNT && point.angle_mdeg.abs() >= LARGE_MDEG
    };
    let mut both = points.iter().flatten();
    both.clone().all(near) && both.any(is_large)
}

/// Whether a slope is the angle or its opposite, the shorter way round. No slope is more than the
/// full circle.
fn is_near(slope_mdeg: i64, angle_mdeg: i32, may_be_off_mdeg: i32) -> bool {
    let slope = i32::try_from(slope_mdeg).ok();
    let Some(slope_mdeg) = slope.filter(|mdeg| mdeg.unsigned_abs() <= 360_000) else {
        return false;
    };
    [angle_mdeg, -angle_mdeg]
        .into_iter()
        .any(|angle| slope_minus(slope_mdeg, angle).abs() <= may_be_off_mdeg)
}
