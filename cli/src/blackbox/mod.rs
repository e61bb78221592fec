//! What a node remembers of its faults: the fault log (2070h) and the black box (2071h).
//!
//! In: the bytes that a node gives by SDO, or a file of them (docs/canopen.md has the formats).
//! Out: entries and frames, in words and as CSV.

pub mod words;
