//! When something of a trial begins and ends, and on which channel.

use std::fmt;

/// One thing that is done to a channel for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timed<T> {
    /// What.
    pub what: T,
    /// On which channel, 0 or 1; of no account for what concerns the bus.
    pub channel: usize,
    /// From when, s.
    pub from_s: f64,
    /// Until when, s.
    pub until_s: f64,
}

impl<T: fmt::Display> fmt::Display for Timed<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            what,
            channel,
            from_s,
            until_s,
        } = self;
        let name = ["A", "B"].get(*channel).unwrap_or(&"?");
        write!(
            f,
            "{what} on channel {name} from {from_s:.3} s to {until_s:.3} s"
        )
    }
}
