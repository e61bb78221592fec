//! What a person sees of `plumb`: tables, charts, pages without scripts, progress bars, standard
//! output.
//!
//! In: numbers and texts. Out: lines for a terminal, and HTML that needs nothing from outside.
//!
//! Left out: what the numbers mean, and which of them a report has; that is the verbs'.

pub mod chart;
pub mod check;
pub mod hex;
pub mod html;
pub mod json;
mod plural;
mod printable;
pub mod progress;
pub mod series;
pub mod stdout;
pub mod table;
pub mod unreadable;
pub mod write;

pub use plural::plural;
pub use printable::printable;
