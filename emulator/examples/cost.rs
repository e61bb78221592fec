//! What the product's image costs, in instructions: `cargo run -p emulator --example cost`.
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

/// Requests that are counted.
const REQUESTS: u32 = 1000;
/// SYNCs that are counted, one every 10 ms.
const SYNCS: u32 = 1000;
/// How long that takes, and how long nothing but samples is counted, s.
const SPAN_S: f64 = 10.0;

/// What was executed in a span of time.
struct Span {
    /// Instructions in handlers.
    handlers: u64,
    /// Of them, those of the wait for SPI.
    waiting: u64,
    /// All, of the background's check sum too.
    all: u64,
    /// Samples of its sensor.
    samples: f64,
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
    machine.chip_mut().code.start_profile();
    let before = machine.chip().instructions();
    let samples = pair.board(0).samples();
    act(pair)?;
    let samples = (pair.board(0).samples() - samples) as f64;
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
        samples,
        rows: costs
            .iter()
            .map(|(number, cost)| (*number, cost.times, cost.instructions, cost.most))
            .collect(),
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let product = Product::build()?;
    let app = &product.app;
    let mut pair = Pair::new(1, &product.pieces())?;
    let busy = |_| "the bus is full";
    pair.run(2.0);
    let still = count(&mut pair, app, |pair| {
        pair.run(SPAN_S);
        Ok(())
    })?;
    let asked = count(&mut pair, app, |pair| {
        for _ in 0..REQUESTS {
            pair.read(1, 0x1000, 0)
                .map_err(|error| format!("{error:?}"))?;
        }
        Ok(())
    })?;
    pair.send(Frame::data_frame(0, &[1, 0])).map_err(busy)?;
    pair.run_synced(10).map_err(busy)?;
    let synced = count(&mut pair, app, |pair| {
        Ok(pair.run_synced(SYNCS).map_err(busy)?)
    })?;
    print(&still, &asked, &synced);
    Ok(())
}

/// The tables.
fn print(still: &Span, asked: &Span, synced: &Span) {
    let own = |span: &Span| (span.handlers - span.waiting) as f64;
    let per_sample = own(still) / still.samples;
    let wait = still.waiting as f64 / still.samples;
    // What the samples of that time cost is taken away.
    let beside = |span: &Span| own(span) - per_sample * span.samples;
    let sdo = beside(asked) / f64::from(REQUESTS);
    let sync = beside(synced) / f64::from(SYNCS);
    let per_cent = |instructions: f64| instructions / SPAN_S / 72e6 * 100.0;
    let (load, whole) = (per_cent(own(synced)), per_cent(synced.all as f64));
    println!("| what | instructions |\n|---|---|");
    println!("| a sample, without the wait for SPI | {per_sample:.0} |");
    println!("| the wait for SPI in it | {wait:.0} |");
    println!("| an SDO request of 4 bytes, with its answer | {sdo:.0} |");
    println!("| a SYNC with its PDOs, both nodes' | {sync:.0} |");
    println!("| load at 400 samples/s and 100 SYNC/s, % of 72 MHz | {load:.1} |");
    println!("| the same with wait and background, % | {whole:.1} |");
    println!("\n| interrupt | times a second | instructions each | at most |\n|---|---|---|---|");
    for (number, times, instructions, most) in &synced.rows {
        let name = NAMES.iter().find(|row| row.0 == *number);
        let name = name.map_or("another", |row| row.1);
        let each = instructions / times.max(&1);
        let rate = *times as f64 / SPAN_S;
        println!("| {name} | {rate:.0} | {each} | {most} |");
    }
}
