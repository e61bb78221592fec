//! Programs that join the bus as CAN clients, whatever they speak.
//!
//! `hub` is all of them to the one who runs the bus. `tcp`, `pty` and `kernel` are how bytes or
//! frames travel; `slcan` and `socketcand` are wire formats. Below these stand what each format
//! does for one client (`dialogue`), what the threads of all clients share (`shared`), and the two
//! queues: `round_robin` towards the bus, `outlet` towards a client.

mod dialogue;
pub mod hub;
mod kernel;
mod outlet;
mod pty;
pub mod round_robin;
mod shared;
mod slcan;
mod socketcand;
mod tcp;

#[cfg(test)]
mod tests;
