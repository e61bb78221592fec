//! A CAN frame as others have it and back: as text of two protocols, and as the kernel's.
//!
//! In: frames, or the bytes of a line. Out: the text, or the frame. Both ends of a line are made
//! with the same code: a client that joins a bus, and a server that offers one.
//!
//! Left out: who speaks when (the two ends), and the text of log files (`bus-logs`).

pub mod hex;
#[cfg(target_os = "linux")]
pub mod kernel;
pub mod slcan;
pub mod socketcand;
