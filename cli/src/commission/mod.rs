//! The verbs that commission an instrument: `scan`, `info`, `get`, `set`, `zero`, `save`,
//! `restore`, `node-id`, `bitrate`.
//!
//! In: a bus, node-ids, names of objects and values with units. Out: lines or one JSON object,
//! and instruments that are set up; or one sentence that names the node, what, and what to do.
//! What is written is read back, and nothing is written twice.
//!
//! Left out: names of objects and values (`codes`), the choice of nodes and the transfers
//! (`bus_master`), calibration, programs, and what the instrument sends by itself (`monitor`).

mod answer;
pub mod bitrate;
mod common;
mod error;
pub mod get;
pub mod info;
pub mod node_id;
pub mod restore;
pub mod save;
pub mod scan;
pub mod set;
pub mod zero;
