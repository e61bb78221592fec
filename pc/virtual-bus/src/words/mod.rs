//! The words that move and break the virtual instrument: how they are written and what they mean.
//!
//! `line` and `trouble` declare every word in a `table` each, from which help, completion and
//! reading follow; `reader` reads what stands behind a word. `script` is a file of lines. What the
//! words do is in `world/effects`.

pub mod line;
pub mod reader;
pub mod script;
mod table;
pub mod trouble;
