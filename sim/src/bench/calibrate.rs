//! The motor (R5): memorise angle and acceleration step by step, fit, and verify (R15).
//!
//! In: an instrument with its temperature model. Out: its correction and uncertainty budget, set
//! in both nodes, and a [`CalibrationReport`]. The motor turns 1 deg every 1500 ms from -90 to
//! 90 deg, once in each mount; a one-axis 360 deg instrument turns the whole circle in one.
//!
//! The paper's node memorises its filtered acceleration at each step of one sweep, over as long as
//! the `interpretation` has it. The product's takes the mean of the last half second, and is swept
//! four times in all, half of them back, with the power off and on before each: the motor's
//! direction error (+-0.0083 deg by the side it comes from) averages out, and of the turn-on
//! offset of the calibration only half is left in it. All twelve parameters are fitted from both
//! mounts together. The verification round turns once more, judged in paper mode up to the angle
//! of assumption A7; above the tolerance of 0.20 deg the calibration is made anew, three times at
//! most, and what it ended with is reported.

use tilt::angle::{Angle, Axes};
use tilt::calibration::motor::{Slope, Stand, one_axis, two_axis};
use tilt::chain::{Correction, Timing};
use tilt::sample::Temperature;
use tilt::table::{Point, Table};
use tilt::temperature::{Compensated, TemperatureModel};
use tilt::uncertainty::{Budget, Span, TCO, TCS, Uncertainty};

use super::characterise::mean_of_both;
use super::interpretation::Interpretation;
use super::static_test::wrap;
use super::statistics::Tally;
use super::{Bench, BenchError, Mode};
use crate::rig::Mount;

/// R5: one step of the motor.
pub const STEP_S: f64 = 1.5;

/// How long the motor stands within a step: 0.11 s of it go into the turn of 1 deg.
const DWELL_S: f64 = STEP_S - 0.12;

/// The longest mean within a step: the ringing of the rig needs the rest of it to fade.
const LONGEST_MEAN_S: f64 = 1.0;

/// R15: the largest error that the verification round may show.
pub const TOLERANCE_DEG: f64 = 0.20;

/// How often a calibration is made anew before it is left as it is.
const MOST_ROUNDS: u32 = 3;

/// Speed between two steps of 1 deg, deg/s.
const STEP_SPEED: f64 = 10.0;

/// What is memorised at one step for one node.
#[derive(Clone, Copy, Debug)]
struct Memory {
    mount: Mount,
    reference_deg: f64,
    compensated: Compensated,
    temperature: Temperature,
}

/// How a calibration went, for one node.
#[derive(Clone, Copy, Debug, Default)]
pub struct CalibrationReport {
    /// Calibrations made, 1 to 3.
    pub rounds: u32,
    /// Errors of the verification round against the motor, deg, as far as it is judged.
    pub verification: Tally,
    /// The same beyond the angle up to which it is judged; empty in product mode.
    pub beyond: Tally,
    /// Condition figure of the fit; 0 in paper mode.
    pub condition: f64,
    /// Rms of what the fit left at the memorised points, deg; 0 in paper mode.
    pub residual_deg: f64,
}

impl CalibrationReport {
    /// Whether the verification round stayed within [`TOLERANCE_DEG`].
    pub fn passed(&self) -> bool {
        self.verification.largest() <= TOLERANCE_DEG
    }
}

impl Bench {
    /// Calibrates, verifies, and repeats while the verification round is above the tolerance.
    ///
    /// Errors: a fit or a table that is refused, a silent node.
    pub fn calibrate(&mut self) -> Result<[CalibrationReport; 2], BenchError> {
        let mut round = 0;
        loop {
            round += 1;
            let memories = self.memorise()?;
            let mut reports = [CalibrationReport::default(); 2];
            for node in 0..2 {
                reports[node] = self.fit(node, &memories[node])?;
                reports[node].rounds = round;
            }
            let verified = self.verify();
            for (report, [judged, beyond]) in reports.iter_mut().zip(verified) {
                report.verification = judged;
                report.beyond = beyond;
            }
            if round >= MOST_ROUNDS || reports.iter().all(CalibrationReport::passed) {
                return Ok(reports);
            }
        }
    }

    fn mounts(&self) -> &'static [Mount] {
        if self.mode == Mode::OneAxis {
            &[Mount::X]
        } else {
            &[Mount::X, Mount::Y]
        }
    }

    fn range_deg(&self) -> i32 {
        if self.mode == Mode::OneAxis { 180 } else { 90 }
    }

    /// Sweeps in one mount: true upwards. The product's are four in all.
    fn sweeps(&self) -> &'static [bool] {
        match self.mode {
            Mode::Paper => &[true],
            Mode::Product | Mode::Dynamic => &[true, false],
            Mode::OneAxis => &[true, false, true, false],
        }
    }

    fn memorise(&mut self) -> Result<[Vec<Memory>; 2], BenchError> {
        let mut memories = [Vec::new(), Vec::new()];
        let range = self.range_deg();
        for &mount in self.mounts() {
            self.mount(mount, 0.0, 0.0);
            for &up in self.sweeps() {
                let sign = if up { 1 } else { -1 };
                self.turn_to(f64::from(-sign * (range + 1)), 40.0, 2.0);
                if self.mode != Mode::Paper {
                    self.power_cycle();
                }
                for step in -range..=range {
                    self.memorise_step(mount, f64::from(sign * step), &mut memories)?;
                }
            }
        }
        Ok(memories)
    }

    /// Puts the housing on the motor in another way.
    ///
    /// It comes there without a turn that a gyroscope could feel, so where there is one the code
    /// starts anew, as after a power-off.
    pub fn mount(&mut self, mount: Mount, wedge_deg: f64, lever_arm_m: f64) {
        self.rig.remount(mount, wedge_deg, lever_arm_m);
        if self.mode == Mode::Dynamic {
            self.instrument.start();
        }
        self.run(0.5);
    }

    fn memorise_step(
        &mut self,
        mount: Mount,
        degrees: f64,
        memories: &mut [Vec<Memory>; 2],
    ) -> Result<(), BenchError> {
        let mean_s = if self.mode == Mode::Paper {
            self.paper.memorised_over_s.clamp(0.02, LONGEST_MEAN_S)
        } else {
            0.5
        };
        self.turn_to(degrees, STEP_SPEED, DWELL_S - mean_s);
        let Self {
            instrument, rig, ..
        } = self;
        let means = mean_of_both(instrument, rig, 0.0, mean_s, "motor calibration")?;
        let reference_deg = rig.reference_deg();
        for ((list, mean), side) in memories.iter_mut().zip(&means).zip(&instrument.sides) {
            let model = &side.settings.chain.calibration.temperature;
            let filtered = tilt::filter::Filtered {
                accel: mean.accel.map(|a| a.round() as i32),
            };
            let compensated = model.apply(filtered, mean.temperature);
            list.push(Memory {
                mount,
                reference_deg,
                compensated,
                temperature: mean.temperature,
            });
        }
        Ok(())
    }

    fn fit(&mut self, node: usize, memories: &[Memory]) -> Result<CalibrationReport, BenchError> {
        let fit_error = |error| BenchError::Fit {
            step: "motor calibration",
            node: node + 1,
            error,
        };
        let (correction, condition) = match self.mode {
            Mode::Paper => {
                let tables = paper_tables(memories).map_err(|error| BenchError::Table {
                    node: node + 1,
                    error,
                })?;
                (
                    Correction::Tables {
                        tables,
                        rule: self.paper.rule,
                    },
                    0.0,
                )
            }
            Mode::Product | Mode::Dynamic => two_axis(&stands(memories)).map_err(fit_error)?,
            Mode::OneAxis => one_axis(&stands(memories)).map_err(fit_error)?,
        };
        let chain = &mut self.instrument.sides[node].settings.chain;
        chain.calibration.correction = correction;
        let residual_deg = if self.mode == Mode::Paper {
            0.0
        } else {
            residual(chain, memories)
        };
        let run = Span::of(memories.iter().map(|m| m.temperature));
        let before = &chain.calibration;
        let (tco, span) = match before.temperature {
            TemperatureModel::None => (TCO, run),
            // The slopes mend the offset alone, and the sensitivity drifts on.
            TemperatureModel::Piecewise(_) | TemperatureModel::DataSheet(_) => (TCS, run),
            TemperatureModel::Quadratic(_) => (before.budget.tco, before.budget.span),
        };
        chain.calibration.budget = Budget {
            fitted_at: run.middle(),
            tco,
            span,
            ..budget(self.mode, &self.paper, residual_deg)
        };
        Ok(CalibrationReport {
            condition,
            residual_deg,
            ..CalibrationReport::default()
        })
    }

    /// Turns the round of R15 and compares with the motor's own angle: per node inside and beyond
    /// the angle up to which the round is judged.
    fn verify(&mut self) -> [[Tally; 2]; 2] {
        let mut tallies = [[Tally::default(); 2]; 2];
        let range = self.range_deg();
        let judged_deg = match self.mode {
            Mode::Paper => self.paper.judged_within_deg,
            Mode::Product | Mode::Dynamic | Mode::OneAxis => 180.0,
        };
        let mean_s = self.read_over_s().min(LONGEST_MEAN_S);
        for &mount in self.mounts() {
            self.mount(mount, 0.0, 0.0);
            self.turn_to(f64::from(-range - 1), 40.0, 2.0);
            for degrees in -range..=range {
                self.turn_to(f64::from(degrees), STEP_SPEED, DWELL_S - mean_s);
                let reference_deg = self.rig.reference_deg();
                let beyond = usize::from(reference_deg.abs() > judged_deg + 0.5);
                let point = self.static_reading_over(mount, mean_s);
                for (tally, node) in tallies.iter_mut().zip(point.nodes) {
                    if let Some(angle_deg) = node.angle_deg {
                        tally[beyond].add(wrap(angle_deg - reference_deg));
                    }
                }
            }
        }
        tallies
    }
}

fn paper_tables(memories: &[Memory]) -> Result<Axes<Table>, tilt::table::TableError> {
    let table = |mount: Mount, axis: usize| {
        let points: Vec<_> = memories
            .iter()
            .filter(|m| m.mount == mount)
            .map(|m| Point {
                accel: m.compensated.accel[axis],
                angle: Angle::from_degrees(m.reference_deg),
            })
            .collect();
        Table::new(&points)
    };
    Ok(Axes {
        x: table(Mount::X, 0)?,
        y: table(Mount::Y, 1)?,
    })
}

/// The memorised points as the fits take them.
fn stands(memories: &[Memory]) -> Vec<Stand> {
    let stand = |m: &Memory| Stand {
        slope: match m.mount {
            Mount::X | Mount::Z => Slope::X,
            Mount::Y => Slope::Y,
        },
        reference_deg: m.reference_deg,
        sin_cos: m.reference_deg.to_radians().sin_cos(),
        felt: m.compensated,
    };
    memories.iter().map(stand).collect()
}

/// Rms of what the chain finds at the memorised points, deg, the fold at +-90 deg left out.
fn residual(chain: &tilt::chain::Chain, memories: &[Memory]) -> f64 {
    let mut tally = Tally::default();
    let mut bare = chain.clone();
    bare.calibration.temperature = tilt::temperature::TemperatureModel::None;
    for m in memories {
        let filtered = tilt::filter::Filtered {
            accel: m.compensated.accel,
        };
        let found = bare.evaluate(filtered, Temperature::REFERENCE);
        let axis = if m.mount == Mount::X {
            found.x
        } else {
            found.y
        };
        let folds = chain.period_us < 10_000 && (m.reference_deg.abs() - 90.0).abs() < 1.0;
        if let (Ok(found), false) = (axis, folds) {
            tally.add(
                found
                    .angle
                    .minus(Angle::from_degrees(m.reference_deg))
                    .degrees(),
            );
        }
    }
    tally.rms()
}

/// Reference uncertainty that ends up in the calibration, deg: the motor's first and second
/// harmonics, a third each of 0.05 deg peak to peak, pass for mounting and nonlinearity.
const REFERENCE_DEG: f64 = 0.0083;

/// What reference and repeatability leave at the memorised points, deg: direction error 0.0083,
/// 18th harmonic 0.0059, motor repeatability 0.0024, noise of a half-second mean 0.005, and the
/// turn-on offset of 0.3 mg, of which the mean of four sweeps takes a quarter, 0.0149.
const EXPECTED_RESIDUAL_DEG: f64 = 0.0188;

/// Sweeps, each with a turn-on offset of its own, that a product calibration is the mean of.
const SWEEPS: f64 = 4.0;

/// Noise of a reading anywhere on the line between two samples of the one pole, over that of a
/// sample: the root of (2 + r) / 3, where r = 0.285 is what two neighbours have in common. The
/// product's neighbours have nearly all in common.
const BETWEEN_SAMPLES: f64 = 0.873;

/// The budget: data-sheet noise, the assumptions of the sensor specification, and the fit.
///
/// Turn-on repeatability, 0.3 mg, stands in it twice: for the use and, divided by the sweeps, for
/// the calibration; with it the 1/f floor of 0.04 mg. In paper mode, which is swept once, the noise
/// of a memorised mean is in the table as well; two neighbouring points share in every
/// answer. Of the thermal hysteresis, 0.5 mg half-loop, the lens-shaped loop leaves 0.73 on the
/// average. The residual counts as far as it is not expected.
fn budget(mode: Mode, read_as: &Interpretation, residual_deg: f64) -> Budget {
    let mg = f64::from(tilt::ONE_G) / 1000.0;
    let paper = mode == Mode::Paper;
    let period_us = mode.settings().chain.period_us;
    let noise = tilt::health::noise(period_us);
    let noise_mg = f64::from(noise) / mg;
    let filter_gain = f64::from(mode.settings().chain.filter.noise_power_q30()) / 2f64.powi(30);
    let samples = (read_as.memorised_over_s * mode.rate_hz()).max(1.0);
    let memorised_mg = if paper {
        noise_mg * (filter_gain.min(1.0 / samples) / 2.0).sqrt()
    } else {
        0.0
    };
    let turn_ons = 1.0 + if paper { 1.0 } else { 1.0 / SWEEPS };
    let repeatability_mg =
        (turn_ons * 0.3f64.powi(2) + 0.04f64.powi(2) + memorised_mg.powi(2)).sqrt();
    let unexpected = (residual_deg.powi(2) - EXPECTED_RESIDUAL_DEG.powi(2))
        .max(0.0)
        .sqrt();
    let between = match read_as.timing {
        Timing::Aligned { .. } if paper => BETWEEN_SAMPLES,
        _ => 1.0,
    };
    Budget {
        noise: (f64::from(noise) * between) as u32,
        repeatability: (repeatability_mg * mg) as u32,
        ..Budget::calibrated(
            Uncertainty::from_degrees(REFERENCE_DEG),
            Uncertainty::from_degrees(unexpected),
            Span::REFERENCE,
        )
    }
}
