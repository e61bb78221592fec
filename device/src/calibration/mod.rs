//! Calibration over the bus: the motor's run, and the table as a DOMAIN.
//!
//! In: commands, reference angles, bytes. Out: a calibration. There is room in the RAM for one
//! only, so a new one is made in the place of the one in force, by a call during which nothing
//! measures; when it comes to nothing, the one that is stored is read back.
//!
//! Left out: the objects themselves, the record store, and fits that need floating point; those
//! run on a host, which downloads what it found.

pub mod encoding;
pub mod motor;
mod recall;
pub mod report;

pub use recall::{Recalled, deliver, recall, stage};

use heapless::Vec;
use tilt::angle::Axes;
use tilt::chain::Correction;
use tilt::composition::{Composition, Place};
use tilt::table::{MAX_POINTS, Point, Rule, Table};

/// Working room for the points of one axis: 1452 bytes on the chip.
#[derive(Clone, Debug, Default)]
pub struct Points {
    points: Vec<Point, MAX_POINTS>,
}

/// Why a point was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointError {
    /// There are [`MAX_POINTS`] already.
    Full,
    /// There is a point with this angle already.
    SameAngle,
}

impl Points {
    /// No points.
    pub const fn new() -> Self {
        Self { points: Vec::new() }
    }

    /// Forgets every point.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// The points in their order.
    pub fn as_slice(&self) -> &[Point] {
        &self.points
    }

    /// Adds a point where its angle belongs, so that a motor may turn either way.
    ///
    /// Errors: see [`PointError`]; nothing changes then.
    pub fn insert(&mut self, point: Point) -> Result<(), PointError> {
        let place = self.points.partition_point(|p| p.angle < point.angle);
        let next = self.points.get(place);
        if next.is_some_and(|p| p.angle == point.angle) {
            return Err(PointError::SameAngle);
        }
        let inserted = self.points.insert(place, point);
        inserted.map_err(|_| PointError::Full)
    }
}

/// The two tables of `correction` with `rule` set; without points where it had none. `None` where
/// the instrument has no tables.
fn tables_in<C: Composition>(
    correction: &mut Correction<C>,
    rule: Rule,
) -> Option<&mut Axes<Table>> {
    if !matches!(correction, Correction::Tables { .. }) {
        let tables = C::Tables::put(|| Axes {
            x: Table::default(),
            y: Table::default(),
        })?;
        *correction = Correction::Tables { tables, rule };
    }
    match correction {
        Correction::Tables { tables, rule: kept } => {
            *kept = rule;
            Some(tables.get_mut())
        }
        _ => None,
    }
}
