//! A frame of a log with its time.
//!
//! In: what a line of a log holds. Out: the same for every format.

use canopen::Frame;

/// A frame of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Logged {
    /// When it was seen, in ns since 1970 (UTC), or since the log began where that has no date;
    /// 0 in all frames of a log without times.
    pub time_ns: u64,
    /// The interface it was seen on, by its place in
    /// [`Source::interfaces`](crate::Source::interfaces).
    pub interface: u8,
    /// What was seen.
    pub frame: Frame,
}
