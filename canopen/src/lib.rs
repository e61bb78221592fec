//! A CANopen slave without a bus: frames and time go in, frames come out.
//!
//! CiA 301 (communication profile), CiA 305 (LSS) and EN 50325-5 (CANopen Safety), one file per
//! chapter. No clock, no heap, no statics, no `unsafe`, no panicking path: any sequence of frames
//! leaves a node in a legal state with bounded output.
//!
//! Left out: every object at 2000h and above (the device's business), CAN controllers, CAN FD.
#![no_std]

pub mod communication;
pub mod crc;
pub mod emcy;
pub mod error_control;
pub mod frame;
pub mod lss;
pub mod mapping;
pub mod nmt;
pub mod node;
pub mod object;
pub mod pdo;
pub mod sdo;
pub mod services;
pub mod srdo;
pub mod storage;
pub mod sync;
pub mod time;

pub use frame::Frame;
pub use instant::Instant;
