//! What the product's image costs, in instructions: `cargo run --release -p emulator --example cost`.
//!
//! In: nothing. Out: a table in Markdown of instructions per sample, per SYNC and per SDO, of one
//! node of a pair, and what each interrupt takes. The wait for the sensor's bytes is told apart: it
//! is as long as SPI is slow, not as the code is.

use std::error::Error;

use canopen::Frame;
use emulator::build::Product;
use emulator::image::Image;
use emulator::pair::Pair;

/// The exceptions of the image, with what they do.
const NAMES: [(u32, &str); 5] = [
    (16 + 28, "TIM2: the edge's time"),
    (16 + 29, "TIM3: the device at work"),
    (16 + 19, "CAN: sent"),
    (16 + 20, "CAN: received"),
    (16 + 22, "CAN: state"),
];

/// What was executed in a span of time.
struct Span {
    /// Instructions in handlers.
    handlers: u64,
    /// Of them, those of the wait for SPI.
    waiting: u64,
    /// All, of the background's check sum too.
    all: u64,
    rows: Vec<(u32, u64, u64, u64)>,
}

/// Lets `act` run and counts what node A executes meanwhile.
fn count(
    pair: &mut Pair,
    app: &Image,
    act: impl FnOnce(&mut Pair) -> Result<(), Box<dyn Error>>,
) -> Result<Span, Box<dyn Error>> {
    let machine = pair.board(0).machine_mut();
    machine.clear_costs();
    machine.chip_mut().code.clear_profile();
    let before = machine.chip().instructions();
    act(pair)?;
    let machine = pair.board(0).machine();
    let by_symbol = app.by_symbol(machine.chip().code.profile());
    let waits = |name: &str| name.contains("3spi") && name.contains("4wait");
    let costs = machine.costs();
    Ok(Span {
        handlers: costs.values().map(|cost| cost.instructions).sum(),
        waiting: by_symbol
            .iter()
            .filter(|(name, _)| waits(name))
            .map(|(_, n)| n)
            .sum(),
        all: machine.chip().instructions() - before,
        rows: costs
            .iter()
            .map(|(number, cost)| (*number, cost.times, cost.instructions, cost.most))
            .collect(),
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let product = Product::build()?;
    let mut pair = Pair::new(1, &product.pieces())?;
    let busy = |_| "the bus is full";
    pair.run(2.0);
    let app = &product.app;
    let still = count(&mut pair, app, |pair| {
        pair.run(10.0);
        Ok(())
    })?;
    let asked = count(&mut pair, app, |pair| {
        for _ in 0..1000 {
            pair.read(1, 0x1000, 0)
                .map_err(|error| format!("{error:?}"))?;
        }
        Ok(())
    })?;
    let span_s = 10.0;
    pair.send(Frame::data_frame(0, &[1, 0])).map_err(busy)?;
    pair.run_synced(10).map_err(busy)?;
    let synced = count(&mut pair, app, |pair| {
        Ok(pair.run_synced(1000).map_err(busy)?)
    })?;
    let samples = still
        .rows
        .iter()
        .find(|row| row.0 == NAMES[0].0)
        .map_or(0, |row| row.1);
    println!("| what | instructions |\n|---|---|");
    let per_sample = |n: u64| n as f64 / samples.max(1) as f64;
    let (own, wait) = (still.handlers - still.waiting, still.waiting);
    println!(
        "| a sample, without the wait for SPI | {:.0} |",
        per_sample(own)
    );
    println!("| the wait for SPI in it | {:.0} |", per_sample(wait));
    let rate = own as f64 / span_s;
    // A request every ms at most; what the samples of that time cost is taken away.
    let sdo_s = asked
        .rows
        .iter()
        .find(|row| row.0 == NAMES[0].0)
        .map_or(0, |row| row.1) as f64
        / samples.max(1) as f64
        * span_s;
    let sdo = ((asked.handlers - asked.waiting) as f64 - rate * sdo_s) / 1000.0;
    println!("| an SDO request of 4 bytes, with its answer | {sdo:.0} |");
    let sync = ((synced.handlers - synced.waiting) as f64 - rate * span_s) / 1000.0;
    println!("| a SYNC with its PDOs, both nodes' | {sync:.0} |");
    let load = |span: &Span| (span.handlers - span.waiting) as f64 / span_s / 72e4;
    println!(
        "| load at 400 samples/s and 100 SYNC/s, % of 72 MHz | {:.1} |",
        load(&synced)
    );
    println!(
        "| the same with wait and background, % | {:.1} |",
        synced.all as f64 / span_s / 72e4
    );
    println!("\n| interrupt | times a second | instructions each | at most |\n|---|---|---|---|");
    for (number, times, instructions, most) in synced.rows {
        let name = NAMES
            .iter()
            .find(|row| row.0 == number)
            .map_or("another", |row| row.1);
        let each = instructions / times.max(1);
        println!(
            "| {name} | {:.0} | {each} | {most} |",
            times as f64 / span_s
        );
    }
    Ok(())
}
