//! What a channel with a gyroscope has sent of its motion: the angle now and the rates of turn.
//!
//! In: what TPDO 5 and 6 carry. Out: a [`MotionSummary`] that merges like all others.
//!
//! Left out: how far the channel has turned (TPDO 7), which is for the other channel.

use serde::{Deserialize, Serialize};

use super::bins::{Bins, Extremes};
use super::join::{Join, join_fields};
use super::tally::Tally;
use listen::Now;

/// The motion of one channel.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MotionSummary {
    /// TPDO 5 seen.
    pub angles: u64,
    /// Slope X and Y at the SYNC itself while the channel had them, 0.001 deg.
    pub slope: [Tally; 2],
    /// The larger standard uncertainty of both, 0.001 deg.
    pub uncertainty: Tally,
    /// The same over time.
    pub uncertainty_bins: Bins<Extremes>,
    /// TPDO 6 seen.
    pub rates: u64,
    /// Rate of turn about the housing's X, Y and Z while the channel had it, 0.01 deg/s.
    pub rate: [Tally; 3],
    /// Size of the fastest of the three over time, 0.01 deg/s.
    pub fastest_bins: Bins<Extremes>,
}

impl MotionSummary {
    /// Takes a TPDO 5 that has come at this time.
    pub fn take_angle(&mut self, now_ns: u64, now: &Now) {
        self.angles += 1;
        for (tally, mdeg) in self.slope.iter_mut().zip(now.mdeg) {
            if let Some(mdeg) = mdeg {
                tally.add(mdeg);
            }
        }
        if let Some(mdeg) = now.uncertainty_mdeg.map(i32::from) {
            self.uncertainty.add(mdeg);
            self.uncertainty_bins.add(now_ns, Extremes::of(mdeg));
        }
    }

    /// Takes a TPDO 6 that has come at this time.
    pub fn take_rates(&mut self, now_ns: u64, now: &Now) {
        self.rates += 1;
        for (tally, rate) in self.rate.iter_mut().zip(now.rates) {
            if let Some(rate) = rate {
                tally.add(i32::from(rate));
            }
        }
        let sizes = now.rates.iter().flatten().map(|rate| rate.unsigned_abs());
        if let Some(fastest) = sizes.max() {
            let bins = &mut self.fastest_bins;
            bins.add(now_ns, Extremes::of(i32::from(fastest)));
        }
    }
}

impl Join for MotionSummary {
    fn join(&mut self, other: &Self) {
        join_fields! { self, other:
            angles, slope, uncertainty, uncertainty_bins, rates, rate, fastest_bins
        }
    }
}
