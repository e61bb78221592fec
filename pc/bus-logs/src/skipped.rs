//! What of a log was no frame that can be used: how many lines of each kind, and where the first
//! one stands.
//!
//! In: each such line with its file and number. Out: [`Skipped`].

/// Why a line gave no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skip {
    /// It ends in the middle.
    Cut,
    /// It is no line of its format.
    Unreadable,
    /// It is longer than any line of a log.
    TooLong,
    /// A CAN FD frame.
    Fd,
    /// An error frame: what the adapter has seen go wrong.
    ErrorFrame,
    /// A frame of an interface that was not asked for.
    OtherInterface,
    /// A frame of an interface beyond the 255 that are told apart.
    TooManyInterfaces,
    /// Comments, headers, blank lines, events that are no frames.
    NoFrame,
}

impl Skip {
    /// Every kind, in the order in which they are shown.
    pub const ALL: [Self; 8] = [
        Self::Cut,
        Self::Unreadable,
        Self::TooLong,
        Self::Fd,
        Self::ErrorFrame,
        Self::OtherInterface,
        Self::TooManyInterfaces,
        Self::NoFrame,
    ];

    /// In words, of several lines.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Cut => "lines cut short",
            Self::Unreadable => "lines that can't be read",
            Self::TooLong => "lines longer than 64 KiB",
            Self::Fd => "CAN FD frames",
            Self::ErrorFrame => "error frames",
            Self::OtherInterface => "frames of other interfaces",
            Self::TooManyInterfaces => "frames of a 256th interface and more",
            Self::NoFrame => "comments, headers and other events",
        }
    }

    /// The name in JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cut => "cut_lines",
            Self::Unreadable => "unreadable_lines",
            Self::TooLong => "too_long_lines",
            Self::Fd => "fd_frames",
            Self::ErrorFrame => "error_frames",
            Self::OtherInterface => "other_interfaces",
            Self::TooManyInterfaces => "too_many_interfaces",
            Self::NoFrame => "no_frames",
        }
    }
}

/// How many lines of a kind, and where the first stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// How many.
    pub count: u64,
    /// The file of the first, by its place in [`Source::files`](crate::Source::files).
    pub file: usize,
    /// The line of the first in its file, counted from 1.
    pub line: u64,
}

impl Tally {
    /// Counts one more.
    pub const fn add(&mut self, file: usize, line: u64) {
        if self.count == 0 {
            (self.file, self.line) = (file, line);
        }
        self.count += 1;
    }
}

/// How a file ended before its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// The gzip stream stops before its end mark.
    Cut,
    /// The gzip stream contradicts itself, or something else follows it.
    Corrupt,
}

impl Damage {
    /// In words.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Cut => "the gzip stream ends before its end mark; what stands before was read",
            Self::Corrupt => "the gzip stream is damaged; what stands before was read",
        }
    }
}

/// All that was counted besides frames.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Skipped {
    kinds: [Tally; Skip::ALL.len()],
    /// Frames that were read and are older than the one before them in their file.
    pub backwards: Tally,
    /// Files whose end is missing, by their place, and how.
    pub damaged: Vec<(usize, Damage)>,
    /// Files in a folder that are no logs.
    pub not_logs: Vec<String>,
    /// Files that were begun before another one had ended, whose frames were put between.
    pub overlapping: u64,
    /// Files without a date that were taken as following another one, by their place.
    pub undated: Vec<usize>,
}

impl Skipped {
    pub(super) const fn add(&mut self, kind: Skip, file: usize, line: u64) {
        self.kinds[kind as usize].add(file, line);
    }

    /// What was counted of one kind.
    #[cfg(test)]
    pub const fn tally(&self, kind: Skip) -> Tally {
        self.kinds[kind as usize]
    }

    /// The kinds that occurred.
    pub fn kinds(&self) -> impl Iterator<Item = (Skip, Tally)> + '_ {
        let all = Skip::ALL.iter().zip(&self.kinds);
        all.filter(|(_, tally)| tally.count > 0)
            .map(|(kind, tally)| (*kind, *tally))
    }

    /// How many lines could not be read though they may have been frames, with the first of them.
    pub fn unread(&self) -> Tally {
        let all =
            [Skip::Cut, Skip::Unreadable, Skip::TooLong].map(|kind| self.kinds[kind as usize]);
        let some = || all.iter().filter(|tally| tally.count > 0);
        let first = some().min_by_key(|tally| (tally.file, tally.line));
        Tally {
            count: some().map(|tally| tally.count).sum(),
            ..first.copied().unwrap_or_default()
        }
    }

    /// All lines that gave no frame.
    #[cfg(test)]
    pub fn lines(&self) -> u64 {
        self.kinds.iter().map(|tally| tally.count).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_its_own_place_and_name() {
        let mut skipped = Skipped::default();
        for (number, kind) in (1..).zip(Skip::ALL) {
            skipped.add(kind, 0, number);
            skipped.add(kind, 1, 100);
            let want = Tally {
                count: 2,
                file: 0,
                line: number,
            };
            assert_eq!(skipped.tally(kind), want);
        }
        assert_eq!((skipped.kinds().count(), skipped.lines()), (8, 16));
        let mut names: Vec<_> = Skip::ALL.iter().map(|kind| kind.name()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), 8);
    }
}
