//! The bus as a master uses it.
//!
//! In: the name of a bus, requests to its nodes. Out: frames, values of objects, and why there are
//! none. [`Bus`] is joined whatever leads to it (socketcand, SLCAN, the kernel's CAN), `options`
//! is how a person names one, `sdo`, `lss` and `nmt` are what a master sends on it, `node` is one
//! node to talk to, `nodes` which nodes are meant, and `diagnosis` why there is no answer.
//!
//! Left out: CAN FD, and what frames mean that nobody asked for (`listen`).

pub mod address;
mod bus;
pub mod diagnosis;
mod error;
pub mod fault;
pub mod intake;
#[cfg(target_os = "linux")]
mod kernel;
pub mod lss;
pub mod nmt;
pub mod node;
pub mod nodes;
pub mod options;
mod received;
pub mod sdo;
mod slcan;
mod socketcand;
pub mod survey;

pub use bus::{Bus, BusEnd, interrupted};
pub use error::JoinError;
pub use options::BusOptions;
pub use received::{Received, Trouble, now_ns};
