//! A board with the product's exact images, whose flash can be put in and taken out.
//!
//! In: what the flash is to hold. Out: a node that was started with it and a host that asks it.

use std::sync::OnceLock;

use device::calibration::deliver;
use emulator::build::Product;
use emulator::chip::flash_controller::{Cells, Operation};
use emulator::chip::rcc::Cause;
use emulator::pair::Pair;
use flash::layout::{HEADER, RC, Region};
use sim::error_model::{ErrorModel, Term};
use sim::memory::{Memory, blank};
use sim::network::guest::Switch;
use sim::network::hand::Pose;
use tilt::angle::{Angle, Axes, Harmonics};
use tilt::chain::{Calibration, Correction};
use tilt::temperature::TemperatureModel;
use tilt::uncertainty::{Budget, Span, Uncertainty};
use tilt::vector::Vector;

/// "save", as 1010h wants it (CiA 301 7.5.2.13).
pub const SAVE: u32 = 0x6576_6173;

/// How the housing stands, deg.
pub const POSE: Pose = Pose {
    pitch_deg: 30.0,
    roll_deg: -10.0,
};

/// How far an angle may be from [`POSE`], deg.
pub const NEAR_DEG: f64 = 0.2;

/// Parts that measure as drawn, with the noise that real ones have: the calibrations here are not
/// made for one part.
pub const PARTS: ErrorModel = ErrorModel::NOMINAL.only(Term::WhiteNoise);

/// The images, built once for all tests.
pub fn product() -> &'static Product {
    static PRODUCT: OnceLock<Product> = OnceLock::new();
    PRODUCT.get_or_init(|| Product::build().expect("the images build"))
}

/// A calibration that turns slope X by `degrees`.
pub fn calibration(degrees: f64) -> Calibration {
    let mut harmonics = Axes::<Harmonics>::default();
    harmonics.x.cosine[0] = Angle::from_degrees(degrees).0;
    Calibration {
        temperature: TemperatureModel::None,
        correction: Correction::TwoAxis {
            vector: Vector::IDENTITY,
            harmonics,
        },
        budget: Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::CHAMBER),
        rates: None,
    }
}

/// The calibration that the boards are delivered with.
pub fn delivered() -> Calibration {
    calibration(0.0)
}

/// What a region of a memory holds after the factory has filled it.
pub fn region(memory: &mut Memory, region: Region) -> Vec<u8> {
    let pages = memory.flash_mut().nor().pages();
    let bytes: Vec<u8> = pages.iter().flat_map(|page| *page.bytes()).collect();
    bytes[region.start as usize..region.end() as usize].to_vec()
}

/// The product as it is delivered: bootloader, program, calibration.
pub fn pieces() -> Vec<(u32, Vec<u8>)> {
    let mut memory = blank();
    deliver(&mut memory, &delivered()).expect("a new memory");
    let records = region(&mut memory, RC.records);
    let mut pieces = product().pieces();
    pieces.push((RC.records.address(), records));
    pieces
}

/// What a node shows of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shown {
    /// 1018h sub 4.
    pub serial: u32,
    /// 2080h sub 2 to 4: version, slot, how it came to run.
    pub program: [u32; 3],
    /// 2062h sub 1.
    pub calibration: u32,
    /// 1017h, ms.
    pub heartbeat: u32,
}

/// A board of channel A with a host.
pub struct Bench {
    /// Both.
    pub pair: Pair,
}

impl Bench {
    /// With power, as delivered, the housing in [`POSE`].
    pub fn new() -> Self {
        Self::with(&pieces())
    }

    /// With power and these pieces in its flash, the housing in [`POSE`].
    pub fn with(pieces: &[(u32, Vec<u8>)]) -> Self {
        let pair = Pair::with(&PARTS, 1, 2, pieces);
        let mut pair = pair.expect("the image is for the flash");
        pair.network.switch_guest(0, Switch::Off);
        assert!(pair.hand.go(POSE));
        pair.run(4.0);
        pair.network.switch_guest(0, Switch::On);
        let mut bench = Self { pair };
        bench.boot();
        bench
    }

    /// The flash as it is now.
    pub fn cells(&mut self) -> Cells {
        self.flash().cells().clone()
    }

    /// The flash controller.
    pub fn flash(&mut self) -> &mut emulator::chip::flash_controller::FlashController {
        &mut self.pair.board(0).machine_mut().chip_mut().flash
    }

    /// Takes the power away, puts these cells in, and starts it; panics when it does not come up.
    pub fn start(&mut self, cells: Cells) {
        self.insert(cells);
        self.boot();
    }

    /// [`Bench::start`] without the bootloader, which takes nine tenths of the time: for where
    /// slots are as they were.
    pub fn start_past_the_bootloader(&mut self, cells: Cells) {
        self.insert(cells);
        let vectors = RC.a.address() + HEADER;
        self.pair.board(0).machine_mut().jump(vectors);
        self.boot();
    }

    /// Takes the power away, puts these cells in, and gives it back.
    pub fn insert(&mut self, cells: Cells) {
        self.pair.network.switch_guest(0, Switch::Off);
        *self.flash().cells() = cells;
        self.pair.heard.clear();
        self.pair.network.switch_guest(0, Switch::On);
    }

    /// Waits for the boot-up message.
    pub fn boot(&mut self) {
        assert!(self.comes_up_within(1.0), "no boot-up within a second");
    }

    /// Whether a boot-up message comes within so long, s.
    pub fn comes_up_within(&mut self, seconds: f64) -> bool {
        let steps = (seconds * 1e3) as usize;
        let before = self.boots();
        for _ in 0..steps {
            self.pair.run(0.001);
            if self.boots() > before {
                return true;
            }
        }
        false
    }

    /// Boot-up messages so far.
    pub fn boots(&self) -> usize {
        let boots = |heard: &&emulator::pair::Heard| {
            heard.frame.cob_id() == Some(0x701) && heard.frame.bytes() == [0]
        };
        self.pair.heard.iter().filter(boots).count()
    }

    /// Reads an object; panics without an answer.
    pub fn read(&mut self, index: u16, sub: u8) -> u32 {
        let read = self.pair.read(1, index, sub);
        read.unwrap_or_else(|error| panic!("{index:04X} sub {sub}: {error:?}"))
    }

    /// What it shows of itself.
    pub fn shown(&mut self) -> Shown {
        Shown {
            serial: self.read(0x1018, 4),
            program: [2, 3, 4].map(|sub| self.read(0x2080, sub)),
            calibration: self.read(0x2062, 1),
            heartbeat: self.read(0x1017, 0),
        }
    }

    /// Does something, and what the flash was asked for meanwhile.
    pub fn journal(&mut self, act: impl FnOnce(&mut Self)) -> Vec<Operation> {
        self.flash().begin_journal();
        act(self);
        self.flash().take_journal()
    }

    /// Why it was reset, each time so far.
    pub fn resets(&mut self) -> &[Cause] {
        self.pair.board(0).machine().resets()
    }

    /// How often the code broke a rule of the flash.
    pub fn broken_rules(&mut self) -> u32 {
        self.flash().cells().broken_rules()
    }
}
