//! The virtual bench: what a laboratory does with an instrument, step by step.
//!
//! In: a seed, a unit's number, a mode and the error models. Out: figures. One [`Bench`] holds one
//! instrument on one rig; its steps are the paper's: chamber (`characterise`, R4), motor
//! (`calibrate`, R5; verification, R15), static and dynamic test (`static_test` R16,
//! `dynamic_test` R17), Table I (`scene`) and the week on the excavator (`week`, R18).
//!
//! Everything is measured through the device code; the truth comes from the rig, never from the
//! device.

pub mod boom;
pub mod calibrate;
pub mod characterise;
pub mod dynamic_test;
pub mod gyroscope;
pub mod interpretation;
pub mod person;
pub mod published;
pub mod scene;
pub mod static_test;
pub mod statistics;
pub mod thermal_test;
pub mod turns;
pub mod unit;
pub mod week;

use device::channel::{Settings, Setup};
use device::factory;
use tilt::calibration::FitError;
use tilt::calibration::gyroscope::FittedBias;
use tilt::chain::{Calibration, Chain, PART_DELAY_Q16, Timing};
use tilt::composition::Whole;
use tilt::cross_check::CrossCheck;
use tilt::table::Rule;
use tilt::uncertainty::Budget;

use crate::chamber::Chamber;
use crate::error_model::ErrorModel;
use crate::instrument::Instrument;
use crate::motion::Mover;
use crate::rig::{Rig, RigSetup};
use crate::rng::Rng;
use gyroscope::GyroscopeReport;
use interpretation::Interpretation;
use turns::Turned;

/// Which instrument is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The paper's: 50 samples/s, one pole, one-axis tables, read as [`World::paper`] has it.
    Paper,
    /// Two axes, 400 samples/s, Butterworth, twelve parameters.
    Product,
    /// Two axes by a part with a gyroscope, 416 samples/s: the angle while the machine moves.
    Dynamic,
    /// One axis over 360 deg, otherwise as the product.
    OneAxis,
}

impl Mode {
    /// Part and chain of this mode, not yet calibrated; the paper's as printed, which
    /// [`World::settings`] reads as its world does.
    pub fn settings(self) -> Settings {
        let setup = match self {
            Self::Paper => Setup {
                timing: Timing::AsItArrives,
                ..factory::paper()
            },
            Self::Product | Self::OneAxis => factory::product(),
            Self::Dynamic => factory::dynamic(),
        };
        let part = setup.part;
        let chain = Chain {
            filter: setup.filter,
            full_scale: part.full_scale(),
            period_us: part.period_us(),
            part_delay_q16: PART_DELAY_Q16,
            timing: setup.timing,
            fusion: factory::fusion::<Whole>(&part, setup.noise),
            calibration: Calibration {
                budget: Budget {
                    noise: tilt::health::noise(part.period_us()),
                    ..Budget::DATA_SHEET
                },
                ..Calibration::NOMINAL
            },
        };
        Settings {
            part,
            chain,
            noise: setup.noise,
        }
    }

    /// The cross-check of this mode, fresh.
    pub fn check(self) -> CrossCheck {
        if self == Self::Paper {
            CrossCheck::paper()
        } else {
            CrossCheck::product()
        }
    }

    /// Sampling rate of the part, nominal, in Hz.
    pub fn rate_hz(self) -> f64 {
        1e6 / f64::from(self.settings().part.period_us())
    }
}

/// What the world is made of: the error models of parts and rig, and how the paper is read.
#[derive(Clone, Copy, Debug)]
pub struct World {
    /// The parts.
    pub parts: ErrorModel,
    /// The rig.
    pub rig: RigSetup,
    /// How the paper's text is read, in paper mode.
    pub paper: Interpretation,
}

impl World {
    /// The nominal models of the sensor specification.
    pub const NOMINAL: Self = Self {
        parts: ErrorModel::NOMINAL,
        rig: RigSetup::NOMINAL,
        paper: Interpretation::REPRODUCED,
    };

    /// Part and chain of an instrument of `mode` in this world, not yet calibrated.
    pub fn settings(&self, mode: Mode) -> Settings {
        let mut settings = mode.settings();
        if mode == Mode::Paper {
            settings.chain.timing = self.paper.timing;
        }
        settings
    }

    /// The parts of an instrument of `mode`: in paper mode as its fixture holds them.
    pub fn parts_of(&self, mode: Mode) -> ErrorModel {
        match mode {
            Mode::Paper => self.paper.fixture.hold(&self.parts),
            Mode::Product | Mode::Dynamic | Mode::OneAxis => self.parts,
        }
    }

    /// How a table that a node is given over the bus (2060h) is read.
    pub const fn rule(&self, mode: Mode) -> Rule {
        match mode {
            Mode::Paper => self.paper.rule,
            Mode::Product | Mode::Dynamic | Mode::OneAxis => factory::RULE,
        }
    }
}

/// One instrument on one rig.
#[derive(Debug)]
pub struct Bench {
    /// The instrument under test.
    pub instrument: Instrument,
    /// The rig it is mounted on.
    pub rig: Rig,
    /// The mode it was built for.
    pub mode: Mode,
    /// The chamber around both.
    pub chamber: Chamber,
    /// How the paper's text is read; paper mode only.
    pub paper: Interpretation,
    /// Bias of both gyroscopes over temperature, once the chamber has shown it.
    biases: Option<[FittedBias; 2]>,
    /// Turns where the chamber was coldest and hottest, of both nodes with a gyroscope.
    warm_turns: [Vec<Turned>; 2],
    /// How the calibration of both gyroscopes went, once it was made.
    pub gyroscopes: Option<[GyroscopeReport; 2]>,
    /// For the choice of test angles.
    pub rng: Rng,
}

/// Why an instrument could not be brought up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BenchError {
    /// A fit was refused, with the step and the node (1 or 2).
    Fit {
        /// The bench's step.
        step: &'static str,
        /// Node 1 or 2.
        node: usize,
        /// Why.
        error: FitError,
    },
    /// A table could not be built.
    Table {
        /// Node 1 or 2.
        node: usize,
        /// Why.
        error: tilt::table::TableError,
    },
    /// A node gave no reading where it should have.
    Silent {
        /// The bench's step.
        step: &'static str,
        /// Node 1 or 2.
        node: usize,
    },
}

impl std::fmt::Display for BenchError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Fit { step, node, error } => write!(f, "{step}, node {node}: {error}"),
            Self::Table { node, error } => write!(f, "calibration, node {node}: {error:?}"),
            Self::Silent { step, node } => write!(f, "{step}: node {node} gives no samples"),
        }
    }
}

impl std::error::Error for BenchError {}

impl Bench {
    /// A new instrument of `mode`, with part-to-part errors drawn from `seed` and `unit`, started.
    pub fn new(mode: Mode, world: &World, seed: u64, unit: u32) -> Self {
        let mut rng = Rng::stream(seed, &format!("unit {unit} bench"));
        let rig = Rig::new(&world.rig, &mut rng);
        let (settings, parts) = (world.settings(mode), world.parts_of(mode));
        let mut instrument = Instrument::new(&settings, &mode.check(), &parts, seed, unit);
        instrument.power_cycle();
        Self {
            instrument,
            rig,
            mode,
            chamber: Chamber::at(25.0),
            paper: world.paper,
            biases: None,
            warm_turns: Default::default(),
            gyroscopes: None,
            rng,
        }
    }

    /// Lets the rig run for `duration_s`.
    pub fn run(&mut self, duration_s: f64) {
        let Self {
            instrument, rig, ..
        } = self;
        run(instrument, rig, duration_s);
    }

    /// Turns the motor to `target_deg` and lets it stand there for `dwell_s`.
    pub fn turn_to(&mut self, target_deg: f64, speed_deg_s: f64, dwell_s: f64) {
        // The motor stands whenever the bench commands it, and the numbers are finite.
        let arrival_s = self.rig.command(target_deg, speed_deg_s).unwrap_or(0.0);
        self.run((arrival_s - self.instrument.time_s()).max(0.0) + dwell_s);
    }

    /// Power off and on: new turn-on offsets, code started anew.
    pub fn power_cycle(&mut self) {
        self.instrument.power_cycle();
        self.run(1.0);
    }
}

/// Lets `mover` move the instrument for `duration_s`.
pub fn run(instrument: &mut Instrument, mover: &mut impl Mover, duration_s: f64) {
    let ticks = (duration_s / crate::TICK_S).round().max(0.0) as u64;
    for _ in 0..ticks {
        let motion = mover.step(instrument.time_s() + crate::TICK_S);
        instrument.tick(&motion);
    }
}
