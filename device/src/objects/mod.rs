//! The object dictionary of the instrument: one row per object, the only source.

pub mod row;
