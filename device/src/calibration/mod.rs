//! Calibration over the bus: the motor's run, and the table as a DOMAIN.
//!
//! In: commands, reference angles, bytes. Out: a [`Calibration`] that the caller stores and puts
//! in force. Everything big is lent by the caller: the calibration that is made or received, and
//! one set of working [`Points`], which the motor's run and a download share because they exclude
//! each other.
//!
//! Left out: the objects themselves, the record store, and fits that need floating point; those
//! run on a host, which downloads what it found.

pub mod crc;
pub mod encoding;
pub mod motor;

use tilt::angle::Axes;
use tilt::chain::{Calibration, Correction};
use tilt::table::{MAX_POINTS, Point, Rule, Table};

/// Working room for the points of one axis: 1456 bytes on the chip.
#[derive(Clone, Debug)]
pub struct Points {
    points: [Point; MAX_POINTS],
    count: usize,
}

/// Why a point was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointError {
    /// There are [`MAX_POINTS`] already.
    Full,
    /// There is a point with this angle already.
    SameAngle,
}

impl Default for Points {
    fn default() -> Self {
        Self::new()
    }
}

impl Points {
    /// No points.
    pub const fn new() -> Self {
        Self {
            points: [Point {
                accel: 0,
                angle: tilt::angle::Angle(0),
            }; MAX_POINTS],
            count: 0,
        }
    }

    /// Forgets every point.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// The points in their order.
    pub fn as_slice(&self) -> &[Point] {
        self.points.get(..self.count).unwrap_or(&[])
    }

    /// Adds a point behind the others.
    fn push(&mut self, point: Point) -> Result<(), PointError> {
        let slot = self.points.get_mut(self.count).ok_or(PointError::Full)?;
        *slot = point;
        self.count += 1;
        Ok(())
    }

    /// Adds a point where its angle belongs, so that a motor may turn either way.
    ///
    /// Errors: see [`PointError`]; nothing changes then.
    pub fn insert(&mut self, point: Point) -> Result<(), PointError> {
        let place = self.as_slice().partition_point(|p| p.angle < point.angle);
        let next = self.as_slice().get(place);
        if next.is_some_and(|p| p.angle == point.angle) {
            return Err(PointError::SameAngle);
        }
        self.push(point)?;
        let mut carried = point;
        for slot in self.points.iter_mut().take(self.count).skip(place) {
            core::mem::swap(slot, &mut carried);
        }
        Ok(())
    }
}

/// The two tables of `calibration` with `rule` set; copies of `table` where it had none.
///
/// Out of line for the sake of the stack: going from another correction to tables takes room for
/// both of them twice over, 6 kB, and going from tables to tables takes none.
#[inline(never)]
fn tables_in<'a>(
    calibration: &'a mut Calibration,
    rule: Rule,
    table: &Table,
) -> Option<&'a mut Axes<Table>> {
    if !matches!(calibration.correction, Correction::Tables { .. }) {
        calibration.correction = Correction::Tables {
            tables: Axes {
                x: *table,
                y: *table,
            },
            rule,
        };
    }
    match &mut calibration.correction {
        Correction::Tables { tables, rule: kept } => {
            *kept = rule;
            Some(tables)
        }
        _ => None,
    }
}
