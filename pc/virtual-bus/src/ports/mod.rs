//! Programs and people that do not speak CAN: words for the instrument, and bench devices.
//!
//! `twin` takes words over TCP and `stdin` takes them as they are typed. `motor` and `chamber` are
//! devices behind a `line_port`. `line_server` carries lines over TCP for both kinds of ports.

pub mod chamber;
pub mod line_port;
mod line_server;
pub mod motor;
pub mod stdin;
pub mod twin;
