//! Everything that `plumb` prints, verb by verb, against committed goldens.
//!
//! In: runs of the program. Out: one file in `snapshots/` for each verb and kind of output, named
//! `VERB-KIND`. CONTRIBUTING.md explains how a change is accepted.
//!
//! Left out: what only looks right on a terminal (the picture of `monitor`, progress bars), the
//! page of `monitor --web`, and the documents of `describe`, which are committed as such and
//! compared by `describe.rs`.

mod benches;
mod commissioning;
mod documents;
mod errors;
mod golden;
mod help;
mod live;
mod log_text;
mod logs;
mod memory;
mod page;
#[path = "../program/mod.rs"]
mod program;
mod recordings;
mod transcript;
mod virtual_bus;

// The starts of servers and the made-up recordings are those of the other tests, which use more of
// them than these do.
#[path = "../commission/bench.rs"]
#[allow(dead_code)]
mod bus;
#[path = "../replay/bench.rs"]
#[allow(dead_code)]
mod sensors;
#[path = "../bench/stand.rs"]
#[allow(dead_code)]
mod stand;
