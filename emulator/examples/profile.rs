//! Where the instructions of the product's image go: `cargo run -p emulator --example profile`.
//!
//! In: nothing, `dynamic` for the variant with a gyroscope, or how many seconds, and `still` for a
//! bus without a host. Out: instructions of one sample and of one SYNC by crate and by function,
//! the 40 with the most, of the node of channel A: what interrupts execute for them, without the
//! wait for SPI.
//!
//! With seconds: speed by processor time, load, and the functions with the most instructions per
//! second and per sample, those of the background and of the wait with them; in OPERATIONAL with a
//! SYNC every 10 ms unless it is still.

use std::error::Error;

use canopen::Frame;
use emulator::build::Product;
use emulator::cost::{Share, each_by_function};
use emulator::image::readable;
use emulator::pair::Pair;
use emulator::stopwatch::Stopwatch;
use sim::bench::Mode;

/// How many functions are printed.
const MOST: usize = 40;

fn main() -> Result<(), Box<dyn Error>> {
    let word = std::env::args().nth(1);
    let is_dynamic = word.as_deref() == Some("dynamic");
    let Some(seconds) = word.filter(|_| !is_dynamic) else {
        let (mode, image) = match is_dynamic {
            false => (Mode::Product, Product::build()?),
            true => (Mode::Dynamic, Product::dynamic()?),
        };
        let [sample, sync] = each_by_function(mode, &image)?;
        print("a sample, without the wait for SPI", &sample);
        print("a SYNC with its PDOs, both nodes'", &sync);
        return Ok(());
    };
    let is_still = std::env::args().nth(2).is_some_and(|word| word == "still");
    span(&Product::build()?, seconds.parse()?, is_still)
}

/// The lists of one thing.
fn print(title: &str, share: &Share) {
    println!("{title}: {:.0} instructions", share.whole);
    println!("  by crate");
    for (name, count) in share.crates() {
        println!("{count:10.1}  {name}");
    }
    println!("  by function");
    for (name, count) in share.functions.iter().take(MOST) {
        println!("{count:10.1}  {name}");
    }
}

/// A span of time as a whole.
fn span(product: &Product, seconds: u32, is_still: bool) -> Result<(), Box<dyn Error>> {
    let mut pair = Pair::new(1, &product.pieces())?;
    pair.run(1.0);
    let busy = |_| "the bus is full";
    if !is_still {
        pair.send(Frame::data_frame(0, &[1, 0])).map_err(busy)?;
        pair.run_synced(50).map_err(busy)?;
    }
    let samples = pair.board(0).samples();
    let code = &mut pair.board(0).machine_mut().chip_mut().code;
    code.start_profile();
    let before = pair.board(0).machine().chip().instructions();
    let watch = Stopwatch::start();
    if is_still {
        pair.run(seconds.into());
    } else {
        pair.run_synced(100 * seconds).map_err(busy)?;
    }
    let samples = (pair.board(0).samples() - samples) as f64;
    let span = watch.seconds();
    let chip = pair.board(0).machine().chip();
    let seconds = f64::from(seconds);
    let rate = (chip.instructions() - before) as f64 / seconds;
    let load = rate / f64::from(chip.hclk_hz()) * 100.0;
    println!(
        "{:.1} times real time, {rate:.0} instructions a second, {load:.1} %",
        seconds / span
    );
    for (name, count) in product.app.by_symbol(chip.code.profile()).iter().take(MOST) {
        let (name, count) = (readable(name), *count as f64);
        println!("{:10.0} {:8.1}  {name}", count / seconds, count / samples);
    }
    Ok(())
}
