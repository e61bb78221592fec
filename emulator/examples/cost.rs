//! What the images cost: `cargo run -p emulator --example cost`.
//!
//! In: nothing, or `--write`. Out: the page `docs/cost.md`, printed or written.

use std::error::Error;
use std::{env, fs};

use emulator::build::{Paper, Product};
use emulator::cost::{Figures, document};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<_> = env::args().skip(1).collect();
    let write = match arguments.as_slice() {
        [] => false,
        [only] if only == "--write" => true,
        _ => return Err("usage: cost [--write]".into()),
    };
    let (product, variant) = (Product::build()?, Product::dynamic()?);
    let page = Figures::count(&product, &variant, &Paper::build()?)?.page();
    if write {
        fs::write(document(), page)?;
    } else {
        print!("{page}");
    }
    Ok(())
}
