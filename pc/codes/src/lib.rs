//! What the objects and codes of the nodes are called, in the terms of tools and people.
//!
//! In: the rows of the object dictionary (`device::objects`), the only source, and the numbers that
//! nodes send. Out: names and units of objects (`name`, `value`), words for states, reasons and
//! EMCY codes (`words`), and the documents for other tools: the electronic data sheet (EDS) and the
//! device configuration (DCF) of a channel, a DBC of what both send as delivered, and the page
//! `docs/objects.md`. The same rows give the same bytes, whatever the day and the machine.
//!
//! Left out: reading such files (`listen`), and what a device on a bus really holds.

mod dbc;
mod dcf;
pub mod dictionary;
mod eds;
mod markdown;
pub mod meaning;
pub mod name;
mod supervised;
#[cfg(test)]
mod tests;
pub mod value;
pub mod words;

pub use dbc::database;
pub use dcf::configuration;
pub use eds::sheet;
pub use markdown::page;
