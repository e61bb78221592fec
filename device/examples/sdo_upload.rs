//! As many SDO uploads of a four-byte object as the argument gives, for counting instructions.
//!
//! In: a number. Out: exit status 0 when each request was answered with an expedited response of
//! four bytes, 1 when one was not. `cargo xtask size` runs it under valgrind.

#[path = "../benches/instrument/mod.rs"]
mod instrument;

use std::hint::black_box;
use std::process::ExitCode;

fn main() -> ExitCode {
    let number = std::env::args().nth(1).and_then(|text| text.parse().ok());
    let number: u64 = number.unwrap_or(1);
    let mut instrument = instrument::Instrument::new();
    for _ in 0..number {
        let response = black_box(&mut instrument).upload();
        let first = response.and_then(|frame| frame.bytes().first().copied());
        // CiA 301, "SDO upload": expedited, four bytes.
        if first != Some(0x43) {
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}
