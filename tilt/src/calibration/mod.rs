//! Fitting: from a bench's readings to the constants that the chain runs on.
//!
//! Three benches, three modules: `motor` (reference angles, R5), `thermal` (the climatic chamber,
//! R4) and `poses` (no reference but gravity's length). A fourth, `gyroscope`, has the calibrated
//! accelerometer beside it as its reference. They share `least_squares`. The fits work in f64 with
//! nothing but + - * /, without allocation, so that they run on the chip too when the calibration
//! is driven over the bus.
//!
//! Left out: moving motors and chambers, which are the host's or the simulation's, and storing.

pub mod algebra;
pub mod gyroscope;
pub mod least_squares;
pub mod motor;
pub mod poses;
pub mod thermal;

/// Why a set of readings does not determine a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FitError {
    /// Too few readings; how many there are and how many it takes.
    TooFew {
        /// Readings given.
        have: usize,
        /// Readings needed.
        need: usize,
    },
    /// The readings leave a combination of the parameters open.
    IllConditioned {
        /// Ratio of the largest to the smallest pivot of the scaled normal equations.
        condition: f64,
    },
    /// The fit did not settle.
    NoConvergence,
    /// The result is outside what a working part can have.
    Implausible,
}

impl core::fmt::Display for FitError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TooFew { have, need } => {
                write!(
                    f,
                    "{have} readings do not determine the fit; take at least {need}"
                )
            }
            Self::IllConditioned { condition } => write!(
                f,
                "the readings are too alike (condition {condition:.0}); \
                 add poses in other directions"
            ),
            Self::NoConvergence => {
                write!(
                    f,
                    "the fit does not settle; check that the readings were at a standstill"
                )
            }
            Self::Implausible => {
                write!(
                    f,
                    "the fit is outside what a working part can have; check axes and units"
                )
            }
        }
    }
}
