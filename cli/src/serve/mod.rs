//! The virtual instrument on a bus that other programs can join.
//!
//! In: frames of CAN clients that come over TCP, over a pseudo-terminal or from a CAN interface
//! of the kernel. Out: every frame of the bus to each of them.

mod error;
mod hex;
mod hub;
mod outlet;
mod pty;
mod ready;
mod slcan;
mod socketcan;
mod socketcand;
mod tcp;

#[cfg(test)]
mod tests;
