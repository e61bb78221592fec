//! Which model of a part over temperature is made.
//!
//! In: the user's wish, or the correction that a node has. Out: a [`Model`].
//!
//! Left out: how it is fitted (`thermal`).

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use tilt::calibration::thermal::ORIENTATIONS;
use tilt::chain::Correction;

/// Which model is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// Offset and gain as quadratics, from four orientations: product mode
    Quadratic,
    /// The paper's eq 6: slopes of the offset between temperatures, level, rising stairs
    Piecewise,
}

impl Model {
    /// The one that goes with a correction: eq 6 with the paper's tables.
    pub const fn of(correction: &Correction) -> Self {
        match correction {
            Correction::Tables { .. } => Self::Piecewise,
            Correction::TwoAxis { .. } | Correction::OneAxis { .. } => Self::Quadratic,
        }
    }

    /// Orientations of each dwell.
    pub const fn orientations(self) -> usize {
        match self {
            Self::Quadratic => ORIENTATIONS,
            Self::Piecewise => 1,
        }
    }

    /// Its name as people write it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Quadratic => "quadratic",
            Self::Piecewise => "piecewise",
        }
    }
}
