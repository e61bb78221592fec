//! What tells one instrument from another: the stages and services that its image is composed of.
//!
//! In: nothing. Out: the compositions. [`Product`] is the instrument of the STM32F103RC,
//! [`Dynamic`] its variant with a gyroscope, [`Paper`] that of the paper's own part, and [`Whole`]
//! has everything that any of them has, for hosts that decide at run time.
//!
//! What is left out has a type without values ([`LeftOut`]), so neither its code nor its room is in
//! the image. No Cargo feature takes part in it.
//!
//! Left out: settings, which are values ([`Setup`](crate::channel::Setup)).

use canopen::object::Dictionary;
use canopen::pdo::{PDOS, Tpdo, Tpdos};
use canopen::services::Services;
use tilt::angle::Axes;
use tilt::chain::Correction;
use tilt::composition::{Composition, LeftOut, Place, Stage, Whole};
use tilt::cross_check::{CrossCheck, PaperCheck, PaperState, ProductState, RateState};
use tilt::fusion::{Fusion, FusionState};
use tilt::rate::RateCorrection;
use tilt::table::{Rule, Table};
use tilt::temperature::Quadratic;
use tilt::vector::Vector;

use crate::calibration::motor::Motor;
use crate::objects::device_objects::Identity;
use crate::objects::moment::Moment;
use crate::objects::table;

impl Stage for Motor {}
impl Stage for Moment {}

/// TPDOs of an instrument with a gyroscope: three more than the predefined connection set has.
pub const DYNAMIC_TPDOS: usize = PDOS + 3;

/// The stages of the signal chain and the services of one instrument.
pub trait Instrument: Composition {
    /// The motor's run of 2060h.
    type Motor: Place<Motor>;
    /// Angle and rates of the moment (2029h, 202Ah).
    type Moment: Place<Moment>;
    /// The TPDOs.
    type Tpdos: Tpdos;
    /// Fault log and black box (2070h to 2072h).
    const HISTORY: bool;
    /// Program download with trial and roll back (1F50h to 1F57h, 2080h).
    const UPDATE: bool;
    /// Unit, preset, offset, inversion and measuring range of the slopes can be set (6000h, 6011h
    /// to 6014h and their like, 2040h), and so are compared with the other channel's (2006h).
    const PRESETS: bool;
    /// What the bus is offered of what CiA 301 and CiA 305 leave to the device.
    const SERVICES: Services;

    /// The object dictionary of this device.
    fn dictionary(identity: Identity) -> Dictionary;
}

impl Instrument for Whole {
    type Motor = Motor;
    type Moment = Moment;
    type Tpdos = [Tpdo; DYNAMIC_TPDOS];
    const HISTORY: bool = true;
    const UPDATE: bool = true;
    const PRESETS: bool = true;
    const SERVICES: Services = Services::ALL;

    fn dictionary(identity: Identity) -> Dictionary {
        table::dictionary(identity.models, identity.channel)
    }
}

/// The product: vectors, the ladder, every service; no tables, and so no run that makes them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Product {}

impl Composition for Product {
    type Tables = LeftOut;
    type Vector = Vector;
    type Quadratic = Quadratic;
    type Rates = LeftOut;
    type Fusion = LeftOut;
    type FusionState = LeftOut;
    type PaperRule = LeftOut;
    type Ladder = ProductState;
    type RateLadder = LeftOut;
    const UNCERTAINTY: bool = true;

    fn check() -> CrossCheck<Self> {
        CrossCheck::ladder(ProductState::fresh())
    }

    fn uncalibrated() -> Correction<Self> {
        Correction::TwoAxis {
            vector: Vector::IDENTITY,
            harmonics: Axes::default(),
        }
    }
}

impl Instrument for Product {
    type Motor = LeftOut;
    type Moment = LeftOut;
    type Tpdos = [Tpdo; PDOS];
    const HISTORY: bool = true;
    const UPDATE: bool = true;
    const PRESETS: bool = true;
    const SERVICES: Services = Services::ALL;

    fn dictionary(identity: Identity) -> Dictionary {
        table::product(identity.channel)
    }
}

/// The variant with a gyroscope: the product, and the vertical while the machine moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dynamic {}

impl Composition for Dynamic {
    type Tables = LeftOut;
    type Vector = Vector;
    type Quadratic = Quadratic;
    type Rates = RateCorrection;
    type Fusion = Fusion;
    type FusionState = FusionState;
    type PaperRule = LeftOut;
    type Ladder = ProductState;
    type RateLadder = RateState;
    const UNCERTAINTY: bool = true;

    fn check() -> CrossCheck<Self> {
        CrossCheck::ladder(ProductState::fresh())
    }

    fn uncalibrated() -> Correction<Self> {
        Correction::TwoAxis {
            vector: Vector::IDENTITY,
            harmonics: Axes::default(),
        }
    }
}

impl Instrument for Dynamic {
    type Motor = LeftOut;
    type Moment = Moment;
    type Tpdos = [Tpdo; DYNAMIC_TPDOS];
    const HISTORY: bool = true;
    const UPDATE: bool = true;
    const PRESETS: bool = true;
    const SERVICES: Services = Services::ALL;

    fn dictionary(identity: Identity) -> Dictionary {
        table::dynamic(identity.channel)
    }
}

/// What the paper's instrument has of what the standards leave to the device.
pub const PAPER_SERVICES: Services = Services {
    safety: false,
    lss: false,
    fastscan: false,
    ..Services::ALL
};

/// The paper's instrument: tables and the motor's run that makes them, the rule of Table I.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paper {}

impl Composition for Paper {
    type Tables = Axes<Table>;
    type Vector = LeftOut;
    type Quadratic = LeftOut;
    type Rates = LeftOut;
    type Fusion = LeftOut;
    type FusionState = LeftOut;
    type PaperRule = PaperState;
    type Ladder = LeftOut;
    type RateLadder = LeftOut;
    const UNCERTAINTY: bool = false;

    fn check() -> CrossCheck<Self> {
        CrossCheck::Paper(PaperCheck::PAPER, PaperState::default())
    }

    /// Without points there is no angle: [`Invalid::NotMeasured`](tilt::chain::Invalid).
    fn uncalibrated() -> Correction<Self> {
        Correction::Tables {
            tables: Axes {
                x: Table::default(),
                y: Table::default(),
            },
            rule: Rule::Linear,
        }
    }
}

impl Instrument for Paper {
    type Motor = Motor;
    type Moment = LeftOut;
    type Tpdos = [Tpdo; PDOS];
    const HISTORY: bool = false;
    const UPDATE: bool = false;
    const PRESETS: bool = false;
    const SERVICES: Services = PAPER_SERVICES;

    fn dictionary(identity: Identity) -> Dictionary {
        table::paper(identity.channel)
    }
}
