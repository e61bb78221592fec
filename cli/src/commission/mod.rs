//! The verbs that commission an instrument: `scan`, `info`, `get`, `set`, `zero`, `save`,
//! `restore`, `node-id`, `bitrate`.
//!
//! In: a bus, node-ids, names of objects and values with units. Out: lines or one JSON object,
//! and instruments that are set up; or one sentence that says which node, what, and what to do.
//! What is written is read back, and nothing is written twice.
//!
//! `name` and `value` are how people call objects and values, made from the dictionary's rows;
//! `nodes` is which nodes are meant, `ask` how they are asked, `fault` what may go wrong in all of
//! them.
//!
//! Left out: calibration, programs, and what the instrument sends by itself (`monitor`).

mod ask;
pub mod bitrate;
mod fault;
pub mod get;
pub mod info;
pub mod name;
pub mod node_id;
mod nodes;
mod print;
pub mod restore;
pub mod save;
pub mod scan;
pub mod set;
pub mod value;
pub mod zero;
