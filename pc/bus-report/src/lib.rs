//! What happened on a bus, afterwards: from logs, and from what the nodes remember.
//!
//! In: logs of a bus, and the fault logs and black boxes of nodes. Out: a summary, a table of all
//! values, the frames on a bus again ([`playback`]); the report of a period ([`period`]); the lists
//! of faults and the samples around them ([`blackbox`]); the page of a whole fleet ([`fleet`]).
//! Replay and report count a log once (`totals`).
//!
//! Left out: the bus while it lives (`monitor`).

pub mod blackbox;
pub mod fleet;
pub mod period;
pub mod playback;
mod totals;
