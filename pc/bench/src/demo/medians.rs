//! One figure of many units.
//!
//! In: the errors of each unit, in sums. Out: the median of the units, or the worst; `None` without
//! any value.

use sim::bench::statistics::{Tally, median};

/// The median unit's root mean square, of those that have a value.
pub fn median_rms(tallies: &[Tally]) -> Option<f64> {
    let filled = tallies.iter().filter(|tally| tally.count() > 0);
    let mut rms: Vec<_> = filled.map(Tally::rms).collect();
    (!rms.is_empty()).then(|| median(&mut rms))
}

/// The largest value of any unit.
pub fn largest(tallies: &[Tally]) -> Option<f64> {
    let filled = tallies.iter().filter(|tally| tally.count() > 0);
    filled.map(Tally::largest).reduce(f64::max)
}
