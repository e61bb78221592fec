//! As many seconds of two product nodes on a 50 Hz bus as the argument gives, for counting
//! instructions and for comparing two versions of the world.
//!
//! In: a number. Out: a line with the seconds, the frames on the bus, its fingerprint, and how much
//! faster than real time that was on this core. Two versions that print the same fingerprint have
//! done the same.

#[path = "../benches/dig/mod.rs"]
mod dig;

use std::time::Instant;

fn main() {
    let number = std::env::args().nth(1).and_then(|text| text.parse().ok());
    let seconds: u32 = number.unwrap_or(1);
    let mut dig = dig::Dig::new();
    let started = Instant::now();
    (0..seconds).for_each(|_| dig.second());
    let ratio = f64::from(seconds) / started.elapsed().as_secs_f64();
    let (frames, fingerprint) = dig.seen();
    println!(
        "{seconds} s, {frames} frames, fingerprint {fingerprint:016x}: {ratio:.0} x real time"
    );
}
