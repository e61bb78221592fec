//! What happened when, in memory that does not grow with the time.
//!
//! In: values with their time, in ns. Out: at most [`MOST`] bins that hold any, all of the same
//! width: the shortest of 1 s, 2 s, 4 s and so on with which that many are enough. Stretches
//! without a value take no bin. The width depends on the times alone and not on their order, so
//! the bins of two halves joined are the bins of the whole.

use super::join::Join;
use serde::{Deserialize, Serialize};

/// Bins that are kept.
pub const MOST: usize = 400;

/// Width of the shortest bin, ns.
const SHORTEST_NS: u64 = 1_000_000_000;

/// The level at which no more than [`MOST`] bins are left of all times that there are.
const WIDEST: u32 = 26;

/// Least and greatest value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Extremes {
    /// The least.
    pub least: i32,
    /// The greatest.
    pub most: i32,
}

impl Extremes {
    /// A single value.
    pub const fn of(value: i32) -> Self {
        Self {
            least: value,
            most: value,
        }
    }
}

impl Join for Extremes {
    #[inline]
    fn join(&mut self, other: &Self) {
        self.least = self.least.min(other.least);
        self.most = self.most.max(other.most);
    }
}

/// Bins over time.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Form<T>", bound(deserialize = "T: Deserialize<'de>"))]
pub struct Bins<T> {
    /// The width is the shortest one times two to the power of this.
    level: u32,
    /// Number of the bin, counted from time 0, and what it holds; in order of time.
    bins: Vec<(u64, T)>,
}

/// Bins as they are read, of which nothing is known yet.
#[derive(Deserialize)]
struct Form<T> {
    level: u32,
    bins: Vec<(u64, T)>,
}

impl<T> TryFrom<Form<T>> for Bins<T> {
    type Error = &'static str;

    fn try_from(Form { level, bins }: Form<T>) -> Result<Self, Self::Error> {
        let last = (u64::MAX / SHORTEST_NS).checked_shr(level).unwrap_or(0);
        let is_in_order = bins.is_sorted_by(|a, b| a.0 < b.0);
        if level > WIDEST || bins.len() > MOST {
            return Err("bins are wider or more than they can be");
        }
        if !is_in_order || bins.iter().any(|(number, _)| *number > last) {
            return Err("bins are out of order, or of no time");
        }
        Ok(Self { level, bins })
    }
}

impl<T> Default for Bins<T> {
    fn default() -> Self {
        Self {
            level: 0,
            bins: Vec::new(),
        }
    }
}

impl<T: Join + Clone> Bins<T> {
    /// Width of a bin, ns.
    pub const fn width_ns(&self) -> u64 {
        SHORTEST_NS << self.level
    }

    /// Puts a value into the bin of its time.
    #[inline]
    pub fn add(&mut self, time_ns: u64, value: T) {
        let number = (time_ns / SHORTEST_NS) >> self.level;
        match self.bins.last_mut() {
            Some((last, held)) if *last == number => held.join(&value),
            _ => self.add_elsewhere(number, value),
        }
    }

    /// Puts a value into another bin than the last one.
    #[cold]
    fn add_elsewhere(&mut self, number: u64, value: T) {
        self.put(number, value);
        while self.bins.len() > MOST {
            self.coarsen();
        }
    }

    fn put(&mut self, number: u64, value: T) {
        // Nearly always the last bin, or one behind it.
        let at = match self.bins.last_mut() {
            Some((last, held)) if *last == number => return held.join(&value),
            Some((last, _)) if *last > number => {
                self.bins.partition_point(|(other, _)| *other < number)
            }
            _ => self.bins.len(),
        };
        match self.bins.get_mut(at) {
            Some((other, held)) if *other == number => held.join(&value),
            _ => self.bins.insert(at, (number, value)),
        }
    }

    /// Joins two bins to one.
    fn coarsen(&mut self) {
        self.level += 1;
        let old = std::mem::take(&mut self.bins);
        for (number, value) in old {
            self.put(number >> 1, value);
        }
    }

    /// Gives both the width of the wider ones.
    pub fn align<U: Join + Clone>(&mut self, other: &mut Bins<U>) {
        while self.level < other.level {
            self.coarsen();
        }
        while other.level < self.level {
            other.coarsen();
        }
    }

    /// The bins that hold a value: start of the bin, ns, and what it holds.
    pub fn iter(&self) -> impl Iterator<Item = (u64, &T)> {
        let width_ns = self.width_ns();
        let bins = self.bins.iter();
        bins.map(move |(number, value)| (number.saturating_mul(width_ns), value))
    }
}

impl<T: Join + Clone> Join for Bins<T> {
    fn join(&mut self, other: &Self) {
        let mut other = other.clone();
        self.align(&mut other);
        for (number, value) in other.bins {
            self.put(number, value);
        }
        while self.bins.len() > MOST {
            self.coarsen();
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn of(values: &[(u64, i32)]) -> Bins<Extremes> {
        let mut bins = Bins::default();
        for (time_s, value) in values {
            bins.add(time_s * SHORTEST_NS, Extremes::of(*value));
        }
        bins
    }

    #[test]
    fn a_week_takes_no_more_bins_than_a_minute() {
        let week: Vec<(u64, i32)> = (0..7 * 86_400).map(|s| (s, (s % 60) as i32)).collect();
        let bins = of(&week);
        assert!(bins.bins.len() <= MOST);
        assert_eq!(bins.width_ns(), 2048 * SHORTEST_NS);
        let (start, held) = bins.iter().next().unwrap();
        assert_eq!((start, held.least, held.most), (0, 0, 59));
    }

    #[test]
    fn a_night_without_data_takes_no_bin() {
        let times: Vec<(u64, i32)> = (0..300).map(|n| (n % 150 + n / 150 * 90_000, 1)).collect();
        assert_eq!(of(&times).width_ns(), SHORTEST_NS);
    }

    proptest! {
        #[test]
        fn merged_parts_are_the_whole(
            values in prop::collection::vec((0..5000_u64, -9..9_i32, any::<bool>()), 0..900),
        ) {
            let part = |wanted| {
                let values = values.iter().filter(|value| value.2 == wanted);
                of(&values.map(|value| (value.0, value.1)).collect::<Vec<_>>())
            };
            let mut merged = part(false);
            merged.join(&part(true));
            let all: Vec<_> = values.iter().map(|value| (value.0, value.1)).collect();
            prop_assert_eq!(merged, of(&all));
        }
    }
}
