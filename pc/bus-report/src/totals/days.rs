//! The days of a period, each with what is kept of it.
//!
//! In: the time of what happened, in ns. Out: the [`Day`] of that time, by its number since time 0.
//! Days without data are none. Joining the days of two parts gives the days of the whole.

use super::join::{Join, join_fields};
use super::kind::KINDS;
use serde::{Deserialize, Serialize};

/// A day in ns.
pub const DAY_NS: u64 = 86_400_000_000_000;

/// What is kept of each day.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Day {
    /// Time of which there is data, ns.
    pub covered_ns: u64,
    /// SYNCs at which something of the instrument was told.
    pub syncs: u64,
    /// Events by kind.
    pub events: [u64; KINDS],
    /// Events that stand apart: those closer than a second to the one before count once.
    pub incidents: u64,
    /// Greatest size of a difference, 0.001 deg.
    pub largest_mdeg: Option<u32>,
}

impl Join for Day {
    fn join(&mut self, other: &Self) {
        join_fields! { self, other: covered_ns, syncs, events, incidents }
        self.largest_mdeg = self.largest_mdeg.max(other.largest_mdeg);
    }
}

/// The days with data, in order of time.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Vec<(u64, Day)>")]
pub struct Days(Vec<(u64, Day)>);

impl TryFrom<Vec<(u64, Day)>> for Days {
    type Error = &'static str;

    fn try_from(days: Vec<(u64, Day)>) -> Result<Self, Self::Error> {
        let is_in_order = days.is_sorted_by(|a, b| a.0 < b.0);
        if !is_in_order
            || days
                .last()
                .is_some_and(|(last, _)| *last > u64::MAX / DAY_NS)
        {
            return Err("days are out of order, or of no time");
        }
        Ok(Self(days))
    }
}

impl Days {
    /// The day of this time.
    #[inline]
    pub fn at(&mut self, time_ns: u64) -> &mut Day {
        self.numbered(time_ns / DAY_NS)
    }

    #[inline]
    fn numbered(&mut self, number: u64) -> &mut Day {
        // Nearly always the last one.
        let place = match self.0.last() {
            Some((last, _)) if *last == number => self.0.len() - 1,
            _ => self.place(number),
        };
        &mut self.0[place].1
    }

    /// Where the day of this number is, which is entered if it is new.
    #[cold]
    fn place(&mut self, number: u64) -> usize {
        let found = self.0.binary_search_by_key(&number, |(number, _)| *number);
        found.unwrap_or_else(|place| {
            self.0.insert(place, (number, Day::default()));
            place
        })
    }

    /// The day of this number.
    pub fn get(&self, number: u64) -> Option<&Day> {
        let found = self.0.binary_search_by_key(&number, |(number, _)| *number);
        found.ok().map(|place| &self.0[place].1)
    }

    /// The numbers of the first and the last one.
    pub fn ends(&self) -> Option<(u64, u64)> {
        Some((self.0.first()?.0, self.0.last()?.0))
    }

    /// All of them, by number.
    pub fn iter(&self) -> impl Iterator<Item = (u64, &Day)> {
        self.0.iter().map(|(number, day)| (*number, day))
    }
}

impl Join for Days {
    fn join(&mut self, other: &Self) {
        for (number, day) in &other.0 {
            self.numbered(*number).join(day);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_stand_in_order_whenever_they_are_entered() {
        let mut days = Days::default();
        for (number, syncs) in [(3, 1), (1, 2), (3, 4)] {
            days.at(number * DAY_NS + 5).syncs += syncs;
        }
        assert_eq!(days.ends(), Some((1, 3)));
        assert_eq!(days.get(2), None);
        let all: Vec<_> = days
            .iter()
            .map(|(number, day)| (number, day.syncs))
            .collect();
        assert_eq!(all, [(1, 2), (3, 5)]);
    }
}
