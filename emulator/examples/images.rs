//! Builds the images that the emulator's tests run: `cargo run -p emulator --example images`.
//!
//! In: nothing. Out: the images of the product, its variant and the paper, where
//! `emulator::build` finds them. The test command does this once, before tests that run side by
//! side ask for them.

use std::error::Error;

use emulator::build::Product;

fn main() -> Result<(), Box<dyn Error>> {
    // Each of them builds all.
    Product::build()?;
    Ok(())
}
