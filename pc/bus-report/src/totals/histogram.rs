//! How often each value came, in memory that does not grow: the base of every percentile.
//!
//! In: angles in 0.001 deg, any number of them. Out: counts in equal steps of 0.001, 0.01, 0.1 deg
//! and so on, the finest of these that takes no more than [`MOST`] steps from the least value to
//! the greatest. Which step that is depends on the values alone and not on their order, so the
//! histogram of two halves joined is the histogram of the whole.
//!
//! Left out: mean and scatter, which are kept exactly (`tally`).

use super::join::Join;
use serde::{Deserialize, Serialize};

/// Steps that are kept.
pub const MOST: usize = 4096;

/// Steps that there are, each ten times the one before: with the last all values have room.
const STEPS: usize = 8;

/// Half of 0.01 deg, the resolution as delivered: a step of 0.01 deg or more begins that much
/// below its first value, so that no value of that resolution lies on an edge.
const BEFORE: i64 = 5;

/// Counts by value.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Form")]
pub struct Histogram {
    /// The step, a power of ten, 0.001 deg.
    step_mdeg: i64,
    /// Number of the first step.
    first: i64,
    counts: Vec<u64>,
}

/// A histogram as it is read, of which nothing is known yet.
#[derive(Deserialize)]
struct Form {
    step_mdeg: i64,
    first: i64,
    counts: Vec<u64>,
}

impl TryFrom<Form> for Histogram {
    type Error = &'static str;

    fn try_from(form: Form) -> Result<Self, Self::Error> {
        let read = Self {
            step_mdeg: form.step_mdeg,
            first: form.first,
            counts: form.counts,
        };
        let steps = std::iter::successors(Some(1), |step| Some(step * 10));
        if !steps.take(STEPS).any(|step| step == read.step_mdeg) {
            return Err("a histogram has a step that there is not");
        }
        let (least, most) = (read.index_of(i32::MIN), read.index_of(i32::MAX));
        let length = read.counts.len();
        let is_within = length <= MOST && (least..=most).contains(&read.first);
        if !is_within || length as i64 > most - read.first + 1 {
            return Err("a histogram reaches beyond the values that there are");
        }
        Ok(read)
    }
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            step_mdeg: 1,
            first: 0,
            counts: Vec::new(),
        }
    }
}

impl Histogram {
    /// Width of a step, 0.001 deg.
    pub const fn step_mdeg(&self) -> i64 {
        self.step_mdeg
    }

    /// Values taken.
    pub fn total(&self) -> u64 {
        self.counts.iter().copied().fold(0, u64::saturating_add)
    }

    /// Takes a value.
    #[inline]
    pub fn add(&mut self, mdeg: i32) {
        let place = (self.index_of(mdeg) - self.first) as usize;
        match self.counts.get_mut(place) {
            Some(count) => *count += 1,
            None => self.add_beyond(mdeg),
        }
    }

    /// Takes a value that the counts do not reach to.
    #[cold]
    fn add_beyond(&mut self, mdeg: i32) {
        let mut index = self.index_of(mdeg);
        while !self.make_room(index) {
            self.coarsen();
            index = self.index_of(mdeg);
        }
        let place = (index - self.first) as usize;
        if let Some(count) = self.counts.get_mut(place) {
            *count += 1;
        }
    }

    #[inline]
    fn index_of(&self, mdeg: i32) -> i64 {
        (i64::from(mdeg) + BEFORE).div_euclid(self.step_mdeg)
    }

    /// Lets the counts reach to this step; `false` when that would be too many.
    fn make_room(&mut self, index: i64) -> bool {
        if self.counts.is_empty() {
            self.first = index;
        }
        let end = self.first + self.counts.len() as i64;
        let (from, to) = (self.first.min(index), end.max(index + 1));
        if to - from > MOST as i64 {
            return false;
        }
        if from < self.first {
            let more = (self.first - from) as usize;
            self.counts.splice(0..0, std::iter::repeat_n(0, more));
            self.first = from;
        }
        self.counts.resize((to - from) as usize, 0);
        true
    }

    /// Joins ten steps to one.
    fn coarsen(&mut self) {
        let old = std::mem::take(&mut self.counts);
        let old_first = self.first;
        self.step_mdeg *= 10;
        for (index, count) in (old_first..).zip(old) {
            let index = index.div_euclid(10);
            // Joined steps are no more than they were.
            if count > 0 && self.make_room(index) {
                let own = &mut self.counts[(index - self.first) as usize];
                *own = own.saturating_add(count);
            }
        }
    }

    /// The middle of a step, 0.001 deg.
    fn middle(&self, index: i64) -> i64 {
        let step = self.step_mdeg;
        index * step - BEFORE + step / 2
    }

    /// The value that this share of all values does not exceed, 0.001 deg, true to a step; `None`
    /// without values.
    pub fn percentile(&self, share: f64) -> Option<i64> {
        let wanted = (share * self.total() as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        for (index, count) in (self.first..).zip(&self.counts) {
            seen = u64::saturating_add(seen, *count);
            if seen >= wanted {
                return Some(self.middle(index));
            }
        }
        None
    }

    /// The widest run of empty steps between two values, and how many values are below it: width in
    /// 0.001 deg; `None` without one.
    pub fn widest_gap(&self) -> Option<(i64, u64)> {
        let mut widest: Option<(i64, u64)> = None;
        let (mut below, mut empty) = (0_u64, 0);
        for count in &self.counts {
            if *count == 0 {
                empty += self.step_mdeg;
                continue;
            }
            if below > 0 && empty > widest.map_or(0, |(width, _)| width) {
                widest = Some((empty, below));
            }
            below = below.saturating_add(*count);
            empty = 0;
        }
        widest
    }

    /// The counts in at most `most` equal steps, those that join whole ones: middle and width in
    /// 0.001 deg, and count.
    pub fn bars(&self, most: usize) -> Vec<(i64, i64, u64)> {
        let joined = self.counts.len().div_ceil(most.max(1)).max(1);
        let joined = nice(joined as i64);
        let first = self.first.div_euclid(joined);
        let width = joined * self.step_mdeg;
        let mut bars: Vec<(i64, i64, u64)> = Vec::new();
        for (index, count) in (self.first..).zip(&self.counts) {
            let bar = index.div_euclid(joined);
            let place = (bar - first) as usize;
            if place == bars.len() {
                bars.push((bar * width - BEFORE + width / 2, width, 0));
            }
            if let Some(bar) = bars.get_mut(place) {
                bar.2 = bar.2.saturating_add(*count);
            }
        }
        bars
    }
}

/// The next of 1, 2, 5, 10, 20 ... that is not less.
fn nice(least: i64) -> i64 {
    let mut power = 1;
    loop {
        for times in [1, 2, 5] {
            if times * power >= least {
                return times * power;
            }
        }
        power *= 10;
    }
}

impl Join for Histogram {
    fn join(&mut self, other: &Self) {
        let mut other = other.clone();
        while self.step_mdeg < other.step_mdeg {
            self.coarsen();
        }
        while other.step_mdeg < self.step_mdeg {
            other.coarsen();
        }
        while let Some(last) = other.counts.len().checked_sub(1) {
            if self.make_room(other.first) && self.make_room(other.first + last as i64) {
                let from = (other.first - self.first) as usize;
                for (to, count) in self.counts.iter_mut().skip(from).zip(&other.counts) {
                    *to = to.saturating_add(*count);
                }
                return;
            }
            self.coarsen();
            other.coarsen();
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn of(values: &[i32]) -> Histogram {
        let mut histogram = Histogram::default();
        values.iter().for_each(|value| histogram.add(*value));
        histogram
    }

    #[test]
    fn percentiles_are_true_to_a_step() {
        let fine = of(&(0..=1000).collect::<Vec<_>>());
        assert_eq!(fine.step_mdeg(), 1);
        assert_eq!(fine.percentile(0.5), Some(500));
        assert_eq!(fine.percentile(0.0), Some(0));
        assert_eq!(fine.percentile(1.0), Some(1000));
        let wide = of(&[-90_000, -10, 0, 10, 90_000]);
        assert_eq!(wide.step_mdeg(), 100);
        assert!((wide.percentile(0.5).unwrap()).abs() <= 100);
        assert_eq!(Histogram::default().percentile(0.5), None);
    }

    #[test]
    fn values_of_the_resolution_as_delivered_stand_in_the_middle_of_a_step() {
        let mut histogram = of(&[-30_000, 10, 8_000]);
        assert_eq!(histogram.step_mdeg(), 10);
        histogram.add(10);
        assert_eq!(histogram.percentile(0.5), Some(10));
    }

    #[test]
    fn the_size_does_not_grow() {
        let mut histogram = Histogram::default();
        for value in [0, i32::MAX, i32::MIN, 7] {
            histogram.add(value);
            assert!(histogram.counts.len() <= MOST);
        }
        assert_eq!(histogram.total(), 4);
    }

    #[test]
    fn bars_hold_every_value_once() {
        let histogram = of(&(-500..700).collect::<Vec<_>>());
        let bars = histogram.bars(60);
        assert!(bars.len() <= 61);
        assert_eq!(bars.iter().map(|bar| bar.2).sum::<u64>(), 1200);
        assert!(bars.windows(2).all(|two| two[1].0 - two[0].0 == two[0].1));
    }

    proptest! {
        #[test]
        fn merged_parts_are_the_whole(
            values in prop::collection::vec(
                (prop_oneof![-300..300_i32, -400_000..400_000], any::<bool>()),
                0..200,
            ),
        ) {
            let part = |wanted| {
                let values = values.iter().filter(|(_, part)| *part == wanted);
                of(&values.map(|(value, _)| *value).collect::<Vec<_>>())
            };
            let mut merged = part(false);
            merged.join(&part(true));
            let all: Vec<i32> = values.iter().map(|(value, _)| *value).collect();
            prop_assert_eq!(merged, of(&all));
        }
    }
}
