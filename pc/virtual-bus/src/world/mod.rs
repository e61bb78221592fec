//! The virtual instrument on its bus, and what words do to it.
//!
//! `stage` runs the nodes, the housing and the chamber; `adapter` is the clients' CAN controller on
//! that bus. `effects` carries out words, `agenda` those that were put off, `status` describes how
//! things stand, and `keep` stores the nodes' records in files.

mod adapter;
pub mod agenda;
pub mod effects;
pub mod keep;
pub mod stage;
mod status;

#[cfg(test)]
mod stage_tests;
#[cfg(test)]
mod trouble_tests;
