//! The stretches of time of which there is no data.
//!
//! In: the gaps as they are found. Out: their number, their sum, and the longest [`MOST`] of them
//! by name. Joining two lists gives the list of both.

use super::join::{Join, join_fields};
use serde::{Deserialize, Serialize};

/// Gaps that are kept by name.
pub const MOST: usize = 40;

/// A gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Gap {
    /// The last frame before it, ns.
    pub from_ns: u64,
    /// The first frame after it, ns.
    pub to_ns: u64,
    /// True when nothing at all was on the bus, so that the log or the bus stood still; false when
    /// others went on.
    pub whole_bus: bool,
}

impl Gap {
    /// How long it is, ns.
    pub const fn length_ns(&self) -> u64 {
        self.to_ns.saturating_sub(self.from_ns)
    }
}

/// The gaps.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gaps {
    longest: Vec<Gap>,
    count: u64,
    sum_ns: u64,
}

impl Gaps {
    /// Takes a gap.
    pub fn add(&mut self, gap: Gap) {
        self.count += 1;
        self.sum_ns += gap.length_ns();
        self.keep(gap);
    }

    fn keep(&mut self, gap: Gap) {
        // By length, longest first; equal ones by time, so that the order of adding is the same.
        let key = |gap: &Gap| (std::cmp::Reverse(gap.length_ns()), *gap);
        let at = self.longest.partition_point(|kept| key(kept) <= key(&gap));
        if at < MOST {
            self.longest.insert(at, gap);
            self.longest.truncate(MOST);
        }
    }

    /// How many there are.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// How long they are together, ns.
    pub const fn sum_ns(&self) -> u64 {
        self.sum_ns
    }

    /// How long the longest one is, ns; 0 without one.
    pub fn longest_ns(&self) -> u64 {
        self.longest.first().map_or(0, Gap::length_ns)
    }

    /// The longest ones in the order of time.
    pub fn in_time(&self) -> Vec<Gap> {
        let mut gaps = self.longest.clone();
        gaps.sort_unstable();
        gaps
    }
}

impl Join for Gaps {
    fn join(&mut self, other: &Self) {
        join_fields! { self, other: count, sum_ns }
        other.longest.iter().for_each(|gap| self.keep(*gap));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn of<'a>(gaps: impl Iterator<Item = &'a (u64, u64, bool)>) -> Gaps {
        let mut list = Gaps::default();
        for (from_ns, length_ns, _) in gaps {
            list.add(Gap {
                from_ns: *from_ns,
                to_ns: from_ns + length_ns,
                whole_bus: true,
            });
        }
        list
    }

    proptest! {
        #[test]
        fn merged_parts_are_the_whole(
            gaps in prop::collection::vec((0..900_u64, 0..50_u64, any::<bool>()), 0..120),
        ) {
            let mut merged = of(gaps.iter().filter(|gap| gap.2));
            merged.join(&of(gaps.iter().filter(|gap| !gap.2)));
            prop_assert!(merged.in_time().len() <= MOST);
            prop_assert_eq!(merged, of(gaps.iter()));
        }
    }
}
