//! How the paper is read where its text contradicts itself or leaves a choice.
//!
//! In: nothing but constants. Out: an [`Interpretation`], one field for each choice, which
//! `docs/paper.md` lists as the assumptions A1 to A8 with the figure that each one moves.
//! [`Interpretation::REPRODUCED`] is the one under which the paper's own tables and its week come
//! back; [`Interpretation::AS_PRINTED`] is the literal one.
//!
//! Left out: the errata that are no choice (a formula that is wrong is mended where it is built),
//! and what the paper states once and plainly.

use device::factory::{PAPER_LATENCY_US, RULE};
use tilt::chain::Timing;
use tilt::table::Rule;

use crate::error_model::ErrorModel;
use crate::excavator::ExcavatorSetup;

/// One reading of the paper: its assumptions, each of which can be switched alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interpretation {
    /// A1: how a value between two points of the table becomes an angle (eq 7, E3, E4).
    pub rule: Rule,
    /// A2: which instant the readings of the two nodes belong to (E11).
    pub timing: Timing,
    /// A3: over how much of a step of the motor the acceleration is averaged for the table, s, up
    /// to 1 s; 0 is one sample.
    pub memorised_over_s: f64,
    /// A4: over how long the acceleration is averaged for a reading at standstill, s; 0 is one
    /// sample.
    pub read_over_s: f64,
    /// A5: how true the metal piece of section V holds the parts to the motor's axis.
    pub fixture: Fixture,
    /// A6: whether the supply is switched off and on between calibration and tests.
    pub power_off_between: bool,
    /// A7: up to which angle the verification round is judged, deg (R15).
    pub judged_within_deg: f64,
    /// A8: how rough the machine of section VII is (Fig 21).
    pub machine: ExcavatorSetup,
}

/// How a part stands on the motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fixture {
    /// As it was soldered, a degree off.
    AsSoldered,
    /// Rotation of the part and angles between its sensitive axes, deg, 1 sigma.
    True {
        /// Rotation of the part.
        mounting_deg: f64,
        /// Each of the angles of the sensitive axes.
        skew_deg: f64,
    },
}

impl Fixture {
    /// The parts of `model` as they stand on the motor.
    pub fn hold(self, model: &ErrorModel) -> ErrorModel {
        match self {
            Self::AsSoldered => *model,
            Self::True {
                mounting_deg,
                skew_deg,
            } => ErrorModel {
                mounting_deg: model.mounting_deg.min(mounting_deg),
                non_orthogonality_deg: model.non_orthogonality_deg.min(skew_deg),
                ..*model
            },
        }
    }
}

/// Latency of paper mode, us.
pub const LATENCY_US: u32 = PAPER_LATENCY_US;

impl Interpretation {
    /// The reading under which the paper's results hold.
    pub const REPRODUCED: Self = Self {
        rule: RULE,
        timing: Timing::Aligned {
            latency_us: LATENCY_US,
        },
        memorised_over_s: 1.0,
        read_over_s: 1.0,
        fixture: Fixture::True {
            mounting_deg: 0.1,
            skew_deg: 0.1,
        },
        power_off_between: false,
        judged_within_deg: 80.0,
        machine: ExcavatorSetup::PAPER,
    };

    /// The literal reading.
    pub const AS_PRINTED: Self = Self {
        rule: Rule::Nearest,
        timing: Timing::AsItArrives,
        memorised_over_s: 0.0,
        read_over_s: 0.0,
        fixture: Fixture::AsSoldered,
        power_off_between: true,
        judged_within_deg: 90.0,
        machine: ExcavatorSetup::NOMINAL,
    };
}
