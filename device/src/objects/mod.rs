//! The object dictionary of the instrument: one row per object, the only source.
//!
//! In: nothing. Out: the rows ([`table::rows`]), from which EDS, DBC and documents are made, and
//! the compact table on the chip ([`table::dictionary`]).
//!
//! Left out: what the objects do.

mod build;
mod calibration;
pub mod communication;
pub mod device_objects;
pub mod manufacturer;
pub mod moment;
pub mod parameters;
pub mod pdo;
pub mod process;
pub mod profile;
pub mod row;
pub mod safety;
pub mod slopes;
pub mod streams;
pub mod table;
pub mod turned;
pub mod update;
pub mod values;
