//! Where the instructions of the product's image go: `cargo run -p emulator --example profile`.
//!
//! In: how many seconds, 10 unless said, and `still` for a bus without a host. Out: speed by
//! processor time, load, and the symbols with the most instructions of the node of channel A, per
//! second and per sample; in OPERATIONAL with a SYNC every 10 ms unless it is still.

use std::error::Error;

use canopen::Frame;
use emulator::build::Product;
use emulator::pair::Pair;
use emulator::stopwatch::Stopwatch;

/// How many symbols are printed.
const MOST: usize = 40;

fn main() -> Result<(), Box<dyn Error>> {
    let seconds = std::env::args()
        .nth(1)
        .map_or(Ok(10), |text| text.parse::<u32>())?;
    let product = Product::build()?;
    let mut pair = Pair::new(1, &product.pieces())?;
    pair.run(1.0);
    let busy = |_| "the bus is full";
    let is_still = std::env::args().nth(2).is_some_and(|word| word == "still");
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
        let count = *count as f64;
        println!("{:10.0} {:8.1}  {name}", count / seconds, count / samples);
    }
    Ok(())
}
