//! The verbs that commission an instrument from the outside, against the nodes of `plumb serve`.

mod bench;
#[cfg(unix)]
mod bitrate;
#[cfg(unix)]
mod cut_short;
#[path = "../program/mod.rs"]
mod program;
mod silence;
mod states;
mod values;
mod verbs;
