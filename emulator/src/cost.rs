//! What the images cost: instructions, flash and RAM.
//!
//! In: the product, its variant with a gyroscope, the paper's instrument. Out: [`Figures`] of the
//! node of channel A in a calibrated pair, `docs/cost.md` made of them, and what of a committed
//! page is not what was counted. The wait for the sensor's
//! bytes is told apart: it is as long as SPI is slow, not as the code is.
//!
//! The chain alone is counted too, by integers and in floating point, each on the same samples in
//! one image of its own ([`FLOAT`]).
//!
//! Left out: cycles.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use canopen::Frame;
use device::calibration::encoding;
use flash::image::Version;
use flash::layout::Slot;
use sim::bench::{BenchError, Mode, World};
use sim::memory;
use sim::network::instrument::Delivered;
use tilt::chain::Calibration;
use tilt::rate::RateCorrection;
use tilt::temperature::{Quadratic, TemperatureModel};

use crate::board::FlashError;
use crate::build::{self, BuildError, FLOAT, Product};
use crate::cpu::Cpu;
use crate::image::{Image, readable};
use crate::pair::{Pair, SdoError};
use crate::stopwatch::Stopwatch;

mod dynamic;
mod page;
mod paper;
mod shares;

pub use dynamic::DynamicFigures;
pub use page::differences;
pub use paper::PaperFigures;
pub use shares::Share;

/// Requests that are counted.
const REQUESTS: u32 = 1000;
/// SYNCs that are counted, one every 10 ms.
const SYNCS: u32 = 1000;
/// How long that takes, and how long nothing but samples is counted, s.
const SPAN_S: f64 = 10.0;
/// What the runtime paints the stack with (`cortex_m_rt::STACK_PAINT_VALUE`).
const PAINT: u32 = 0xCCCC_CCCC;
/// What 1F57h reads after a wrong signature.
const REFUSED: u32 = 7 << 1 | 5 << 16;
/// What the symbol of the wait for SPI has in it.
const WAIT: [&str; 2] = ["3spi", "4wait"];
/// Polls of 1F57h before a check counts as one without end, ten a second.
const POLLS: u32 = 50;
/// "save", as 1010h wants it (CiA 301 7.5.2.13).
const SAVE: u32 = 0x6576_6173;

/// Why nothing was counted.
#[derive(Debug)]
pub enum CostError {
    /// The image does not build.
    Build(BuildError),
    /// It does not go into the flash.
    Flash(FlashError),
    /// The instrument does not leave the bench.
    Bench(BenchError),
    /// The bus took no more frames.
    BusFull,
    /// An SDO was not answered as it should be.
    Sdo(SdoError),
    /// The linker or the compiler has left no such name: nothing can be told by it.
    NoSymbol(&'static str),
    /// A program that nobody has signed was started.
    Forged,
    /// The chains alone, or the check of a program, did not come to their end.
    Unfinished,
}

impl fmt::Display for CostError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Build(error) => error.fmt(f),
            Self::Flash(error) => write!(f, "the image does not go into the flash: {error:?}"),
            Self::Bench(error) => write!(f, "the instrument does not leave the bench: {error}"),
            Self::BusFull => f.write_str("the bus is full"),
            Self::Sdo(error) => write!(f, "an SDO was not answered as it should be: {error:?}"),
            Self::NoSymbol(name) => write!(f, "nothing in the image is called {name}"),
            Self::Forged => f.write_str("a program that nobody has signed was started"),
            Self::Unfinished => f.write_str("the chains alone or a check came to no end"),
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
    /// Instructions of the check of a new program as long as the application, which nobody has
    /// signed who may: all that the background does of it, from its order to its refusal.
    pub check: f64,
    /// Instructions of the longest interrupt while that program came and was checked.
    pub longest: f64,
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
    /// The same before the signature of a program was checked.
    pub unchecked_stack: u32,
    /// What interrupts took while there were SYNCs.
    pub interrupts: Vec<Interrupt>,
    /// How many times as fast as time the two emulated nodes ran then, on this machine.
    pub speed: f64,
    /// The chain alone.
    pub chain: Chain,
    /// The image of the variant with a gyroscope.
    pub dynamic: DynamicFigures,
    /// The paper's image.
    pub paper: PaperFigures,
    /// Of a sample and of a SYNC, in which functions they are.
    pub shares: [Share; 2],
}

/// What the signal chain takes alone, by integers and by floating point in software.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain {
    /// Instructions of a sample: gaps and low-pass.
    pub sample: [f64; 2],
    /// Instructions of a reading: everything from there to two angles with their uncertainties.
    pub reading: [f64; 2],
    /// The largest difference between both chains' angles, 0.000 001 deg.
    pub apart: f64,
}

impl Chain {
    /// Runs both chains on the chip.
    ///
    /// Errors: see [`CostError`].
    pub fn count() -> Result<Self, CostError> {
        let image = FLOAT.image().map_err(CostError::Build)?;
        let mut pair = Pair::of(1, 1, &image.pieces).map_err(CostError::Flash)?;
        pair.run(SPAN_S);
        // The borrow's flag stands before the value.
        let at = image.symbol("COMPARED");
        let at = at.ok_or(CostError::NoSymbol("COMPARED"))? + 4;
        let machine = pair.board(0).machine();
        let mut bytes = [0; 32];
        let read = machine.cpu().read(at, &mut bytes);
        let words = bytes
            .as_chunks()
            .0
            .iter()
            .map(|word| u32::from_le_bytes(*word).into());
        let words: Vec<f64> = words.collect();
        let [
            sample,
            float_sample,
            reading,
            float_reading,
            apart,
            _,
            readings,
            samples,
        ] = words[..]
        else {
            return Err(CostError::Unfinished);
        };
        if read.is_err() || !machine.sleeps() || readings == 0.0 {
            return Err(CostError::Unfinished);
        }
        Ok(Self {
            sample: [sample / samples, float_sample / samples],
            reading: [reading / readings, float_reading / readings],
            apart: apart * 360e6 / 4_294_967_296.0,
        })
    }
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
    /// Those in no handler.
    background: f64,
    /// How long it was, s.
    seconds: f64,
    /// Samples of its sensor.
    samples: u64,
    interrupts: Vec<Interrupt>,
    /// Instructions by function, without the wait for SPI and the background's functions.
    functions: BTreeMap<String, u64>,
}

impl Span {
    /// Instructions in handlers, without the wait for SPI.
    fn own(&self) -> f64 {
        self.handlers.saturating_sub(self.waiting) as f64
    }

    /// Instructions of the longest interrupt.
    fn longest(&self) -> u64 {
        let most = self.interrupts.iter().map(|interrupt| interrupt.most);
        most.max().unwrap_or_default()
    }

    /// How much of the time is left beside the instructions, s: for the check sum of the running
    /// program, which goes by the clock.
    fn idle_s(&self, hclk_hz: f64) -> f64 {
        self.seconds - self.all as f64 / hclk_hz
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
    /// Runs the product, its variant with a gyroscope and the paper's instrument, each for half a
    /// minute of its time, and counts.
    ///
    /// Errors: see [`CostError`].
    pub fn count(
        product: &Product,
        variant: &Product,
        paper: &build::Paper,
    ) -> Result<Self, CostError> {
        let mut pair = delivered(Mode::Product, product)?;
        let app = &product.app;
        let still = still(&mut pair, app)?;
        let asked = span(&mut pair, app, |pair| {
            for _ in 0..REQUESTS {
                pair.read(1, 0x1000, 0)?;
            }
            Ok(())
        })?;
        command(&mut pair, 0x01)?;
        synced(&mut pair, 10)?;
        let watch = Stopwatch::start();
        let synced = span(&mut pair, app, |pair| synced(pair, SYNCS))?;
        let speed = SPAN_S / watch.seconds();
        store(&mut pair)?;
        calibrate(&mut pair, None)?;
        let unchecked_stack = stack(&mut pair, app)?;
        let (came, judged) = judged(&mut pair, product)?;
        let longest = came.longest().max(judged.longest());
        let sample = still.own() / still.samples as f64;
        let hclk_hz = hclk_hz(&mut pair);
        Ok(Self {
            sample,
            wait: still.waiting as f64 / still.samples as f64,
            sdo: asked.each(sample, REQUESTS),
            sync: synced.each(sample, SYNCS),
            check: judged.background - still.background / SPAN_S * judged.idle_s(hclk_hz),
            longest: longest as f64,
            rate: still.samples as f64 / SPAN_S,
            load: per_cent(synced.own(), hclk_hz),
            whole: per_cent(synced.all as f64, hclk_hz),
            boot: product.boot.flash(),
            app: product.app.flash(),
            statics: product.app.statics,
            stack: stack(&mut pair, app)?,
            unchecked_stack,
            interrupts: synced.interrupts.clone(),
            chain: Chain::count()?,
            dynamic: DynamicFigures::count(variant)?,
            paper: PaperFigures::count(paper)?,
            speed,
            shares: shares::shares(&still, &synced, SYNCS),
        })
    }
}

/// Instructions of a sample and of a SYNC, function by function, without what else is counted:
/// of an image for the boards of this mode.
///
/// Errors: see [`CostError`].
pub fn each_by_function(mode: Mode, product: &Product) -> Result<[Share; 2], CostError> {
    let mut pair = delivered(mode, product)?;
    let still = still(&mut pair, &product.app)?;
    command(&mut pair, 0x01)?;
    synced(&mut pair, 10)?;
    let synced = span(&mut pair, &product.app, |pair| synced(pair, SYNCS))?;
    Ok(shares::shares(&still, &synced, SYNCS))
}

/// A calibrated pair that has started.
fn delivered(mode: Mode, product: &Product) -> Result<Pair, CostError> {
    let delivered = Delivered::calibrated(mode, &World::NOMINAL, 1, 0);
    let delivered = delivered.map_err(CostError::Bench)?;
    let pair = Pair::delivered(&delivered, 1, &product.pieces());
    let mut pair = pair.map_err(CostError::Flash)?;
    pair.run(2.0);
    Ok(pair)
}

/// Nothing but samples.
fn still(pair: &mut Pair, app: &Image) -> Result<Span, CostError> {
    span(pair, app, |pair| {
        pair.run(SPAN_S);
        Ok(())
    })
}

/// The clock of node A's core, Hz.
fn hclk_hz(pair: &mut Pair) -> f64 {
    f64::from(pair.board(0).machine().chip().hclk_hz())
}

/// Instructions of a span as a part of what the core could have executed, %.
fn per_cent(instructions: f64, hclk_hz: f64) -> f64 {
    instructions / SPAN_S / hclk_hz * 100.0
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

/// Node A gets another calibration (2061h), as a fit on the host leaves it: understood, put in
/// force and stored.
fn calibrate(pair: &mut Pair, rates: Option<RateCorrection>) -> Result<(), CostError> {
    let fitted = Calibration {
        temperature: TemperatureModel::Quadratic(Quadratic::default()),
        rates,
        ..Calibration::NOMINAL
    };
    let mut bytes = vec![0; encoding::length(&fitted) as usize];
    encoding::read_at(&fitted, 0, &mut bytes);
    pair.download(1, (0x2061, 0), &bytes)?;
    pair.run(1.0);
    Ok(())
}

/// Node A gets a program as long as its own that somebody else has signed and is told to start it:
/// its signature is checked as a good one is, and no reset wipes out how deep in the stack that
/// was. What was counted while it came, and while it was checked.
fn judged(pair: &mut Pair, product: &Product) -> Result<(Span, Span), CostError> {
    let body = vec![0x5A; product.app.flash() as usize];
    let mut file = memory::image(Slot::B, Version::new(99, 0, 0), &body);
    memory::sign(&mut file, b"nobody whom the node would know.");
    for control in [0, 3] {
        pair.write(1, (0x1F51, 1), 1, control)?;
    }
    while pair.read(1, 0x1F57, 1)? & 1 == 1 {
        pair.run(0.1);
    }
    let came = span(pair, &product.app, |pair| {
        Ok(pair.download(1, (0x1F50, 1), &file)?)
    })?;
    let judged = span(pair, &product.app, |pair| {
        pair.write(1, (0x1F51, 1), 1, 1)?;
        for _ in 0..POLLS {
            pair.run(0.1);
            match pair.read(1, 0x1F57, 1)? {
                1 => {}
                REFUSED => return Ok(()),
                _ => return Err(CostError::Forged),
            }
        }
        Err(CostError::Unfinished)
    })?;
    Ok((came, judged))
}

/// Lets `act` run and counts what node A executes meanwhile.
fn span(
    pair: &mut Pair,
    app: &Image,
    act: impl FnOnce(&mut Pair) -> Result<(), CostError>,
) -> Result<Span, CostError> {
    let machine = pair.board(0).machine_mut();
    machine.clear_costs();
    machine.chip_mut().code.start_profile();
    let before = machine.chip().instructions();
    let samples = pair.board(0).samples();
    let begun_ns = pair.network.now_ns();
    act(pair)?;
    let seconds = (pair.network.now_ns() - begun_ns) as f64 * 1e-9;
    let samples = pair.board(0).samples() - samples;
    let machine = pair.board(0).machine();
    let by_symbol = app.by_symbol(machine.chip().code.profile());
    let waits = |name: &str| WAIT.iter().all(|word| name.contains(word));
    let waiting = by_symbol.iter().filter(|(name, _)| waits(name));
    let waiting = waiting.map(|(_, count)| count).sum();
    if app.symbols_with(&WAIT).is_empty() {
        // The compiler has put it into its caller, and a sample would seem to cost more.
        return Err(CostError::NoSymbol("spi::wait"));
    }
    let mut functions = BTreeMap::new();
    for (name, count) in by_symbol.iter().filter(|(name, _)| !waits(name)) {
        let name = readable(name);
        if !shares::is_background(&name) {
            *functions.entry(name).or_default() += count;
        }
    }
    let costs = machine.costs();
    let handlers = costs.values().map(|cost| cost.instructions).sum();
    let all = machine.chip().instructions() - before;
    Ok(Span {
        handlers,
        waiting,
        all,
        background: all.saturating_sub(handlers) as f64,
        functions,
        seconds,
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
fn stack(pair: &mut Pair, app: &Image) -> Result<u32, CostError> {
    let symbol = |name| app.symbol(name).ok_or(CostError::NoSymbol(name));
    let (end, start) = (symbol("_stack_end")?, symbol("_stack_start")?);
    let used = [0, 1].map(|number| {
        let unused = pair.board(number).machine().painted_from(end, PAINT);
        (start - end).saturating_sub(unused)
    });
    Ok(used.into_iter().max().unwrap_or_default())
}
