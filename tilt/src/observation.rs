//! What one channel reports of one instant: its angles, and what stands behind them.
//!
//! In: a [`Reading`] and, where the channel has them, the calibrated acceleration it came from, the
//! signal's energy at high frequency, and how far the gyroscope has turned. Out: an
//! [`Observation`], which travels to the other channel and is judged there by `cross_check`.
//!
//! Left out: the journey (counters, capture times), which is the device's.

use crate::angle::Axes;
use crate::chain::{Invalid, Reading};
use crate::health::Activity;
use crate::turned::Turned;
use crate::vector::Corrected;

/// What one channel reports of one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Observation {
    /// The angles, or the reasons why there are none.
    pub reading: Reading,
    /// The calibrated acceleration behind the angles; `None` where there is none: no reading, or
    /// the paper's tables, which make no vector, or one axis, which makes none of three.
    pub vector: Option<Corrected>,
    /// Energy above 150 Hz since the observation before.
    pub activity: Activity,
    /// How far its gyroscope has turned; `None` where there is none, or it takes no part.
    pub turned: Option<Turned>,
}

impl Observation {
    /// A channel that reports nothing, for this reason.
    pub const fn absent(reason: Invalid) -> Self {
        Self {
            reading: Axes {
                x: Err(reason),
                y: Err(reason),
            },
            vector: None,
            activity: Activity(0),
            turned: None,
        }
    }

    /// The same observation without its angles, for this reason; what is behind them stays.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub const fn refused(self, reason: Invalid) -> Self {
        Self {
            reading: Axes {
                x: Err(reason),
                y: Err(reason),
            },
            ..self
        }
    }
}

impl From<Reading> for Observation {
    /// Angles alone, as a recording or the paper's instrument has them.
    fn from(reading: Reading) -> Self {
        Self {
            reading,
            vector: None,
            activity: Activity(0),
            turned: None,
        }
    }
}
