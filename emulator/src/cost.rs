//! What the product's image costs: instructions, flash and RAM.
//!
//! In: the product. Out: [`Figures`] of the node of channel A in a pair, `docs/cost.md` made of
//! them, and what of a committed page is not what was counted. The wait for the sensor's bytes is
//! told apart: it is as long as SPI is slow, not as the code is.
//!
//! Left out: cycles, and the same chain with floating point.

use std::fmt;
use std::path::{Path, PathBuf};

use canopen::Frame;

use crate::board::FlashError;
use crate::build::{BuildError, Product};
use crate::pair::{Pair, SdoError};
use crate::stopwatch::Stopwatch;

mod page;

pub use page::differences;

/// Requests that are counted.
const REQUESTS: u32 = 1000;
/// SYNCs that are counted, one every 10 ms.
const SYNCS: u32 = 1000;
/// How long that takes, and how long nothing but samples is counted, s.
const SPAN_S: f64 = 10.0;
/// What the runtime paints the stack with (`cortex_m_rt::STACK_PAINT_VALUE`).
const PAINT: u32 = 0xCCCC_CCCC;
/// "save", as 1010h wants it (CiA 301 7.5.2.13).
const SAVE: u32 = 0x6576_6173;

/// Why nothing was counted.
#[derive(Debug)]
pub enum CostError {
    /// The image does not build.
    Build(BuildError),
    /// It does not go into the flash.
    Flash(FlashError),
    /// The bus took no more frames.
    BusFull,
    /// An SDO was not answered as it should be.
    Sdo(SdoError),
    /// The linker or the compiler has left no such name: nothing can be told by it.
    NoSymbol(&'static str),
}

impl fmt::Display for CostError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Build(error) => error.fmt(f),
            Self::Flash(error) => write!(f, "the image does not go into the flash: {error:?}"),
            Self::BusFull => f.write_str("the bus is full"),
            Self::Sdo(error) => write!(f, "an SDO was not answered as it should be: {error:?}"),
            Self::NoSymbol(name) => write!(f, "nothing in the image is called {name}"),
        }
    }
}

impl std::error::Error for CostError {}

impl From<SdoError> for CostError {
    fn from(error: SdoError) -> Self {
        Self::Sdo(error)
    }
}

/// What was counted.
#[derive(Clone, Debug, PartialEq)]
pub struct Figures {
    /// Instructions of handlers per sample while no host speaks, without the wait for SPI.
    pub sample: f64,
    /// Instructions of the wait for SPI per sample.
    pub wait: f64,
    /// Instructions of an SDO request of up to four bytes with its answer.
    pub sdo: f64,
    /// Instructions of a SYNC with what it brings: the PDOs of both nodes.
    pub sync: f64,
    /// Samples per second of its sensor, Hz.
    pub rate: f64,
    /// Load with 100 SYNCs a second, without the wait for SPI and the background, %.
    pub load: f64,
    /// The same with both, %.
    pub whole: f64,
    /// Flash of the bootloader, bytes.
    pub boot: u32,
    /// Flash of the application, bytes, its header left out.
    pub app: u32,
    /// RAM of the application's statics, bytes.
    pub statics: u32,
    /// The deepest stack of the two nodes, bytes.
    pub stack: u32,
    /// What interrupts took while there were SYNCs.
    pub interrupts: Vec<Interrupt>,
    /// How many times as fast as time the two emulated nodes ran then, on this machine.
    pub speed: f64,
}

/// What the handlers of an interrupt took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interrupt {
    /// Number of the exception: interrupt n is exception 16 + n.
    pub number: u32,
    /// How often it came, Hz.
    pub rate: f64,
    /// Mean of its instructions.
    pub mean: u64,
    /// Instructions of the longest one.
    pub most: u64,
}

/// What was executed in a span of time.
#[derive(Clone, Debug, Default)]
struct Span {
    /// Instructions in handlers.
    handlers: u64,
    /// Of them, those of the wait for SPI.
    waiting: u64,
    /// All, of the background's check sum too.
    all: u64,
    /// Samples of its sensor.
    samples: u64,
    interrupts: Vec<Interrupt>,
}

impl Span {
    /// Instructions in handlers, without the wait for SPI.
    fn own(&self) -> f64 {
        self.handlers.saturating_sub(self.waiting) as f64
    }

    /// What one of `times` took, when each sample took `sample` beside.
    fn each(&self, sample: f64, times: u32) -> f64 {
        (self.own() - sample * self.samples as f64) / f64::from(times)
    }
}

/// The committed page.
pub fn document() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/cost.md")
}

impl Figures {
    /// Runs the product for half a minute of its time and counts.
    ///
    /// Errors: see [`CostError`].
    pub fn count(product: &Product) -> Result<Self, CostError> {
        let mut pair = Pair::new(1, &product.pieces()).map_err(CostError::Flash)?;
        pair.run(2.0);
        let still = span(&mut pair, product, |pair| {
            pair.run(SPAN_S);
            Ok(())
        })?;
        let asked = span(&mut pair, product, |pair| {
            for _ in 0..REQUESTS {
                pair.read(1, 0x1000, 0)?;
            }
            Ok(())
        })?;
        command(&mut pair, 0x01)?;
        synced(&mut pair, 10)?;
        let watch = Stopwatch::start();
        let synced = span(&mut pair, product, |pair| synced(pair, SYNCS))?;
        let speed = SPAN_S / watch.seconds();
        store(&mut pair)?;
        let sample = still.own() / still.samples as f64;
        let hclk_hz = f64::from(pair.board(0).machine().chip().hclk_hz());
        let per_cent = |instructions: f64| instructions / SPAN_S / hclk_hz * 100.0;
        Ok(Self {
            sample,
            wait: still.waiting as f64 / still.samples as f64,
            sdo: asked.each(sample, REQUESTS),
            sync: synced.each(sample, SYNCS),
            rate: still.samples as f64 / SPAN_S,
            load: per_cent(synced.own()),
            whole: per_cent(synced.all as f64),
            boot: product.boot.flash(),
            app: product.app.flash(),
            statics: product.app.statics,
            stack: stack(&mut pair, product)?,
            interrupts: synced.interrupts,
            speed,
        })
    }
}

/// The host tells all nodes where to go (CiA 301 7.2.8.3.1).
fn command(pair: &mut Pair, command: u8) -> Result<(), CostError> {
    let frame = Frame::data_frame(0, &[command, 0]);
    pair.send(frame).map_err(|_| CostError::BusFull)
}

/// So many SYNCs.
fn synced(pair: &mut Pair, syncs: u32) -> Result<(), CostError> {
    pair.run_synced(syncs).map_err(|_| CostError::BusFull)
}

/// Both nodes store their parameters, which is deeper in the stack than measuring is.
fn store(pair: &mut Pair) -> Result<(), CostError> {
    command(pair, 0x80)?;
    pair.run(0.01);
    for node in [1, 2] {
        pair.write(node, (0x1010, 1), 4, SAVE)?;
    }
    pair.run(1.0);
    Ok(())
}

/// Lets `act` run and counts what node A executes meanwhile.
fn span(
    pair: &mut Pair,
    product: &Product,
    act: impl FnOnce(&mut Pair) -> Result<(), CostError>,
) -> Result<Span, CostError> {
    let machine = pair.board(0).machine_mut();
    machine.clear_costs();
    machine.chip_mut().code.start_profile();
    let before = machine.chip().instructions();
    let samples = pair.board(0).samples();
    act(pair)?;
    let samples = pair.board(0).samples() - samples;
    let machine = pair.board(0).machine();
    let by_symbol = product.app.by_symbol(machine.chip().code.profile());
    let waits = |name: &str| name.contains("3spi") && name.contains("4wait");
    let waiting = by_symbol.iter().filter(|(name, _)| waits(name));
    let waiting = waiting.map(|(_, count)| count).sum();
    if waiting == 0 {
        // The compiler has put it into its caller, and a sample would seem to cost more.
        return Err(CostError::NoSymbol("spi::wait"));
    }
    let costs = machine.costs();
    Ok(Span {
        handlers: costs.values().map(|cost| cost.instructions).sum(),
        waiting,
        all: machine.chip().instructions() - before,
        samples,
        interrupts: (costs.iter())
            .map(|(number, cost)| Interrupt {
                number: *number,
                rate: cost.times as f64 / SPAN_S,
                mean: cost.instructions / cost.times.max(1),
                most: cost.most,
            })
            .collect(),
    })
}

/// The deepest stack of the two nodes since their reset, bytes.
fn stack(pair: &mut Pair, product: &Product) -> Result<u32, CostError> {
    let symbol = |name| product.app.symbol(name).ok_or(CostError::NoSymbol(name));
    let (end, start) = (symbol("_stack_end")?, symbol("_stack_start")?);
    let used = [0, 1].map(|number| {
        let unused = pair.board(number).machine().painted_from(end, PAINT);
        (start - end).saturating_sub(unused)
    });
    Ok(used.into_iter().max().unwrap_or_default())
}
