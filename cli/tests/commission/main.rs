//! The verbs that commission an instrument from the outside, against the nodes of `plumb serve`.

mod bench;
#[cfg(unix)]
mod bitrate;
#[cfg(unix)]
mod cut_short;
#[cfg(unix)]
mod node_id;
#[path = "../program/mod.rs"]
mod program;
mod silence;
mod states;
mod values;
mod verbs;
#[cfg(unix)]
mod watch;
