//! What the image of the variant with a gyroscope costs on the product's part.
//!
//! In: the variant. Out: [`DynamicFigures`] of node A of a calibrated pair, counted as the
//! product's are, and their section of `docs/cost.md`, beside the product's.
//!
//! Left out: the bootloader, which is the product's, and what an SDO request takes.

use flash::layout::{HEADER, RC};
use sim::bench::Mode;
use tilt::rate::RateCorrection;

use super::page::{Row, table};
use super::shares::{is_in, sum_of};
use super::{
    CostError, Figures, SPAN_S, SYNCS, calibrate, command, delivered, hclk_hz, judged, per_cent,
    span, stack, still, store, synced,
};
use crate::build::Product;

/// The estimator: the vertical from rates and accelerations.
const ESTIMATOR: [&str; 1] = ["tilt::motion::"];
/// What joins it to the chain: correction of the rates, the clock, temperature and matrix for each
/// sample, and both verticals of a reading.
const JOINT: [&str; 3] = ["tilt::fusion::", "tilt::chain::fused::", "tilt::rate::"];

/// What was counted of the variant's image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DynamicFigures {
    /// Instructions of handlers per sample while no host speaks, without the wait for SPI.
    pub sample: f64,
    /// Of them, those of the estimator.
    pub estimator: f64,
    /// Of them, those of what joins it to the chain.
    pub joint: f64,
    /// Instructions of the wait for SPI per sample.
    pub wait: f64,
    /// Instructions of a SYNC with what it brings: the PDOs of both nodes.
    pub sync: f64,
    /// Samples per second of its sensor, Hz.
    pub rate: f64,
    /// Load with 100 SYNCs a second, without the wait for SPI and the background, %.
    pub load: f64,
    /// Flash of the application, bytes, its header left out.
    pub app: u32,
    /// RAM of the application's statics, bytes.
    pub statics: u32,
    /// The deepest stack of the two nodes, bytes.
    pub stack: u32,
}

impl DynamicFigures {
    /// Runs the variant's pair and counts.
    ///
    /// Errors: see [`CostError`].
    pub fn count(variant: &Product) -> Result<Self, CostError> {
        let mut pair = delivered(Mode::Dynamic, variant)?;
        let app = &variant.app;
        let still = still(&mut pair, app)?;
        command(&mut pair, 0x01)?;
        synced(&mut pair, 10)?;
        let synced = span(&mut pair, app, |pair| synced(pair, SYNCS))?;
        store(&mut pair)?;
        calibrate(&mut pair, Some(RateCorrection::IDENTITY))?;
        judged(&mut pair, variant)?;
        let samples = still.samples as f64;
        let sample = still.own() / samples;
        let of = |modules: &[&str]| sum_of(&still, |name| is_in(name, modules)) / samples;
        Ok(Self {
            sample,
            estimator: of(&ESTIMATOR),
            joint: of(&JOINT),
            wait: still.waiting as f64 / samples,
            sync: synced.each(sample, SYNCS),
            rate: samples / SPAN_S,
            load: per_cent(synced.own(), hclk_hz(&mut pair)),
            app: app.flash(),
            statics: app.statics,
            stack: stack(&mut pair, app)?,
        })
    }

    fn rows(&self) -> [Row; 10] {
        let ram = f64::from(self.statics + self.stack);
        let room = f64::from(RC.a.length - HEADER);
        [
            Row::new(
                "a sample with a gyroscope, without the wait for SPI",
                self.sample,
                Some(2500.0),
            ),
            Row::new("the estimator in it", self.estimator, Some(1200.0)),
            Row::new("what joins it to the chain", self.joint, None),
            Row::new("the wait for SPI in addition", self.wait, None),
            Row::new("a SYNC with its PDOs, with a gyroscope", self.sync, None),
            Row::new("samples of six axes a second", self.rate, None),
            Row::per_cent("load with a gyroscope, % of 72 MHz", self.load, None),
            Row::new(
                "flash of the application with a gyroscope",
                self.app.into(),
                Some(room),
            ),
            Row::new("RAM of statics with a gyroscope", self.statics.into(), None),
            Row::new(
                "statics and deepest stack with a gyroscope",
                ram,
                Some(18_432.0),
            ),
        ]
    }

    /// The section of the page, beside what was counted of the product.
    pub fn section(&self, product: &Figures) -> String {
        let rows = self.rows();
        let [sample, estimator, ..] = &rows;
        let why = |row: &Row, why: &'static str| if row.is_missed() { why } else { "" };
        let beside = self.beside(product);
        let counted = table("Instructions or bytes", &rows);
        [
            TITLE,
            &counted,
            WHAT,
            why(sample, SAMPLE_MISSED),
            why(estimator, ESTIMATOR_MISSED),
            BESIDE,
            &beside,
        ]
        .concat()
    }

    /// The rows of product and variant.
    fn beside(&self, product: &Figures) -> String {
        let row = |(what, one, other): (&str, f64, f64)| {
            format!("| {what} | {one:.0} | {other:.0} | {:+.0} |\n", other - one)
        };
        let (app, ram) = (product.app, product.statics + product.stack);
        let rows = [
            ("a sample, without the wait", product.sample, self.sample),
            ("the wait for SPI in it", product.wait, self.wait),
            ("a SYNC with its PDOs", product.sync, self.sync),
            (
                "flash of the application",
                f64::from(app),
                f64::from(self.app),
            ),
            (
                "statics and deepest stack",
                f64::from(ram),
                f64::from(self.statics + self.stack),
            ),
        ];
        rows.map(row).concat()
    }
}

/// Before the table.
const TITLE: &str = "
## The variant with a gyroscope

The variant on the product's part and in its slots: two calibrated nodes, each with an ISM330DHCX,
as above.

";

/// What the figures are.
const WHAT: &str = "
- **The estimator** is what stands in `tilt::motion`, **what joins it to the chain** what stands in
  `tilt::fusion`, `tilt::chain::fused` and `tilt::rate`. What they take of functions that others use
  too, such as divisions, is in the sample's figure alone.
- **The wait for SPI** is for 17 bytes a sample, where the product's sensor has 9.
- **Flash** of the application is its slot's without the header of 512 bytes.
- **The deepest stack** is that after the same as the product's; the calibration that is downloaded
  has the gyroscope's terms.
";

/// Why a sample takes more than its target.
const SAMPLE_MISSED: &str = "
The target for a sample is missed: the product's alone takes more than that, and all of it is spent
here too. A little more than half of what comes on top are the estimator and what joins it to the
chain. The rest are the longer burst, temperature and axes of each sample, which the product
corrects once in about four, and the angle of the moment in addition to the aligned one.
";

/// Why the estimator takes more than its target.
const ESTIMATOR_MISSED: &str = "
The target for the estimator is missed. Every sample turns the frame and the vertical ahead of it by
what the gyroscope is late; the filter runs once in 32 samples.
";

/// Before the table of product and variant.
const BESIDE: &str = "
Product and variant, counted in one run:

| Instructions or bytes | product | with a gyroscope | more |
|---|---:|---:|---:|
";
