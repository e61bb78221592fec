//! What an instrument is composed of: which stages it has, and which are left out of its image.
//!
//! In: a type that names the composition. Out: the types of the stages. A stage that is left out
//! has the type [`LeftOut`], which no value has: the compiler then drops every path that would need
//! one, and the room for it. So the images of the product and of the paper's instrument come from
//! the same sources, without a choice at run time and without Cargo features.
//!
//! [`Whole`] has everything. It is what hosts, benches and the simulated world use, where one
//! program has to be either instrument.
//!
//! Left out: services of the bus, which are the device's (`device::instrument`).

use core::fmt::Debug;

use crate::angle::Axes;
use crate::chain::Correction;
use crate::cross_check::{CrossCheck, PaperState, ProductState, RateState};
use crate::fusion::{Fusion, FusionState};
use crate::rate::RateCorrection;
use crate::table::Table;
use crate::temperature::Quadratic;
use crate::vector::Vector;

/// The place of a stage in a composition: the stage itself, or [`LeftOut`].
pub trait Place<T>: Clone + Debug {
    /// Whether the stage is there.
    const FITTED: bool;

    /// The stage in its place; `None`, and nothing is made, where it is left out.
    fn put(stage: impl FnOnce() -> T) -> Option<Self>;
    /// The stage, for reading.
    fn get(&self) -> &T;
    /// The stage, to be changed.
    fn get_mut(&mut self) -> &mut T;
}

/// What an image may leave out.
pub trait Stage: Clone + Debug {}

impl Stage for Axes<Table> {}
impl Stage for Vector {}
impl Stage for Quadratic {}
impl Stage for PaperState {}
impl Stage for ProductState {}
impl Stage for RateState {}
impl Stage for RateCorrection {}
impl Stage for Fusion {}
impl Stage for FusionState {}

/// A stage that is not there. No value has this type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeftOut {}

impl<T: Stage> Place<T> for T {
    const FITTED: bool = true;

    #[inline(always)]
    fn put(stage: impl FnOnce() -> T) -> Option<Self> {
        Some(stage())
    }

    #[inline(always)]
    fn get(&self) -> &T {
        self
    }

    #[inline(always)]
    fn get_mut(&mut self) -> &mut T {
        self
    }
}

impl<T: Stage> Place<T> for LeftOut {
    const FITTED: bool = false;

    fn put(_: impl FnOnce() -> T) -> Option<Self> {
        None
    }

    fn get(&self) -> &T {
        match *self {}
    }

    fn get_mut(&mut self) -> &mut T {
        match *self {}
    }
}

/// The stages of one instrument.
pub trait Composition: Clone + Debug + PartialEq + Sized + 'static {
    /// The tables of the paper's calibration (R5, R6).
    type Tables: Place<Axes<Table>> + PartialEq;
    /// The product's correction on three axes.
    type Vector: Place<Vector> + PartialEq;
    /// The product's temperature model.
    type Quadratic: Place<Quadratic> + Copy + PartialEq;
    /// The calibration of a gyroscope.
    type Rates: Place<RateCorrection> + PartialEq;
    /// How the vertical follows a gyroscope.
    type Fusion: Place<Fusion> + PartialEq;
    /// The memory of it.
    type FusionState: Place<FusionState>;
    /// The memory of the paper's rule (R12, R13).
    type PaperRule: Place<PaperState>;
    /// The memory of the product's ladder.
    type Ladder: Place<ProductState>;
    /// The memory of its comparison of two gyroscopes.
    type RateLadder: Place<RateState>;
    /// Whether the uncertainty of each angle is evaluated; where not it is
    /// [`UNKNOWN`](crate::uncertainty::Uncertainty::UNKNOWN).
    const UNCERTAINTY: bool;

    /// The cross-check that the instrument is built with, fresh.
    fn check() -> CrossCheck<Self>;

    /// The correction of a part of which nothing is known.
    fn uncalibrated() -> Correction<Self>;
}

/// Everything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Whole {}

impl Composition for Whole {
    type Tables = Axes<Table>;
    type Vector = Vector;
    type Quadratic = Quadratic;
    type Rates = RateCorrection;
    type Fusion = Fusion;
    type FusionState = FusionState;
    type PaperRule = PaperState;
    type Ladder = ProductState;
    type RateLadder = RateState;
    const UNCERTAINTY: bool = true;

    fn check() -> CrossCheck<Self> {
        CrossCheck::product()
    }

    fn uncalibrated() -> Correction<Self> {
        Correction::NOMINAL
    }
}
