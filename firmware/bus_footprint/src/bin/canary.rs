//! A binary that must not link: what it reaches panics when an index is out of range.
//!
//! In: nothing. Out: the linker's refusal, which shows that the refusal works.
#![cfg_attr(target_os = "none", no_std, no_main)]

// The library holds the panic handler.
use bus_footprint as _;

/// What the linker script keeps.
#[used]
static REACHED: fn(&[u8], usize) -> u8 = |bytes, index| bytes[index];

#[cfg(not(target_os = "none"))]
fn main() {
    println!("linked for the part by `cargo xtask size`, which expects that to fail");
}
