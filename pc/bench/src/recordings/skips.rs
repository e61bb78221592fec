//! Why rows of a recording were left out, how many of each kind, and where the first one stands.

use std::fmt;

/// Why a row was left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Reason {
    /// More or fewer cells than the header has.
    #[error("wrong number of cells")]
    CellCount,
    /// The time or an acceleration is empty.
    #[error("missing cell")]
    MissingCell,
    /// The time or an acceleration is no number, or the line is no text.
    #[error("cell that is no number")]
    UnparsableCell,
    /// The time or an acceleration is infinite or not a number.
    #[error("number that is not finite")]
    NotFinite,
    /// All three accelerations are exactly zero: what a logger writes before the sensor answers.
    #[error("all axes zero")]
    AllZero,
    /// The same time as the row before, to the microsecond.
    #[error("repeated timestamp")]
    RepeatedTime,
    /// An earlier time than the row before.
    #[error("backward timestamp")]
    BackwardTime,
    /// A time ahead of the rows that follow, or far ahead at the end: up to three in a row.
    #[error("timestamp ahead of the others")]
    ForwardJump,
    /// An axis beyond 16 g, which no sensor of this kind can report.
    #[error("acceleration beyond 16 g")]
    OverRange,
}

/// Every reason, in the order of a report.
pub const REASONS: [Reason; 9] = [
    Reason::CellCount,
    Reason::MissingCell,
    Reason::UnparsableCell,
    Reason::NotFinite,
    Reason::AllZero,
    Reason::RepeatedTime,
    Reason::BackwardTime,
    Reason::ForwardJump,
    Reason::OverRange,
];

/// How many rows of one kind, and the line of the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    /// Rows.
    pub rows: u64,
    /// Line of the first, counted from 1; 0 when there is none.
    pub first_line: u64,
}

impl Count {
    /// Adds one row.
    pub fn add(&mut self, line: u64) {
        if self.rows == 0 || line < self.first_line {
            self.first_line = line;
        }
        self.rows += 1;
    }
}

/// The counts by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Skips {
    counts: [Count; REASONS.len()],
}

impl Skips {
    /// Adds a row left out for `reason`.
    pub fn add(&mut self, reason: Reason, line: u64) {
        for (count, _) in self
            .counts
            .iter_mut()
            .zip(REASONS)
            .filter(|(_, r)| *r == reason)
        {
            count.add(line);
        }
    }

    /// The reasons that occurred, with their counts.
    pub fn iter(&self) -> impl Iterator<Item = (Reason, Count)> + '_ {
        REASONS
            .into_iter()
            .zip(self.counts)
            .filter(|(_, count)| count.rows > 0)
    }

    /// Rows left out for `reason`.
    #[cfg(test)]
    pub fn of(&self, reason: Reason) -> Count {
        self.iter()
            .find(|(r, _)| *r == reason)
            .map(|(_, count)| count)
            .unwrap_or_default()
    }

    /// Rows left out altogether.
    pub fn total(&self) -> u64 {
        self.counts.iter().map(|count| count.rows).sum()
    }

    /// The reason that cost most rows.
    pub fn worst(&self) -> Option<(Reason, Count)> {
        self.iter().max_by_key(|(_, count)| count.rows)
    }
}

impl fmt::Display for Skips {
    /// As in `2 rows skipped: 1 missing cell (line 370), 1 all axes zero (line 2)`.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let total = self.total();
        write!(
            f,
            "{total} row{} skipped",
            if total == 1 { "" } else { "s" }
        )?;
        for (i, (reason, count)) in self.iter().enumerate() {
            let (separator, rows) = (if i == 0 { ":" } else { "," }, count.rows);
            let first = if rows > 1 { "first in line" } else { "line" };
            write!(
                f,
                "{separator} {rows} {reason} ({first} {})",
                count.first_line
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_by_reason_and_keeps_the_first_line() {
        let mut skips = Skips::default();
        assert_eq!(skips.to_string(), "0 rows skipped");
        skips.add(Reason::AllZero, 2);
        skips.add(Reason::MissingCell, 370);
        skips.add(Reason::MissingCell, 371);
        assert_eq!(skips.total(), 3);
        assert_eq!(
            skips.of(Reason::MissingCell),
            Count {
                rows: 2,
                first_line: 370
            }
        );
        assert_eq!(skips.worst().unwrap().0, Reason::MissingCell);
        assert_eq!(
            skips.to_string(),
            "3 rows skipped: 2 missing cell (first in line 370), 1 all axes zero (line 2)"
        );
    }

    #[test]
    fn every_reason_has_a_place() {
        let mut skips = Skips::default();
        for (reason, line) in REASONS.into_iter().zip(1..) {
            skips.add(reason, line);
            assert_eq!(skips.of(reason).first_line, line);
        }
        assert_eq!(skips.total(), REASONS.len() as u64);
    }
}
