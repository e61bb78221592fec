//! A device on a bus, whole, with the peer, the tools and the supply that it has there.
//!
//! One program of them all, since each would compile the device's generic code anew.

mod boxes;
mod certainty;
mod configuration;
mod fuzz;
mod mailboxes;
mod pair;
mod paper_rule;
mod played;
mod power_cuts;
mod registers;
mod set_up;
mod site;
mod update;
