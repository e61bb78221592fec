//! The climatic chamber (R4): the paper's profile, run twice, and what each mode fits to it.
//!
//! In: an instrument. Out: its temperature model, set in both nodes. The hours between the
//! measurements are stepped over: the dies follow the chamber in steps of 10 s, and samples are
//! taken only at the end of each dwell.
//!
//! At every dwell the product's fixture holds the instrument in four orientations, in which each
//! axis sees both signs of gravity (E12); the paper's holds it level. The paper's stairs only rise,
//! so nearly all of its points lie on one branch of the thermal hysteresis; the product's run goes
//! down the stairs again, and the fit comes out between the branches.
//!
//! Where there are gyroscopes the motor turns the housing at both ends of the stairs as well, for
//! their scale over temperature. These turns are kept until the accelerometers are calibrated
//! (`gyroscope`).
//!
//! Afterwards the part is conditioned: it passes 25 degC by 10 degC and comes back, which leaves
//! the hysteresis in the middle of its loop whichever branch the run ended on.

use tilt::calibration::gyroscope::BiasFit;
use tilt::calibration::thermal::{Dwell, ORIENTATIONS, QuadraticFit, piecewise};
use tilt::sample::Temperature;
use tilt::temperature::{KNOTS, TemperatureModel};
use tilt::uncertainty::Span;

use super::{Bench, BenchError, Mode, run};
use crate::chamber::{Profile, Program};
use crate::instrument::Instrument;
use crate::motion::Mover;
use crate::rig::Fixture;

/// How long one mean reading takes, behind a second for the filter.
const MEAN_S: f64 = 1.0;

/// Steps of the profile before the nine stairs from -10 to 70 degC.
const BEFORE_STAIRS: usize = 3;

/// Ends of the stairs, degC, where gyroscopes are turned, in one run. A slope shows best between
/// them, and both branches of the accelerometer's hysteresis meet there.
const ENDS_C: [f64; 2] = [-10.0, 70.0];

/// Where the motor rests in each mount then, deg: turns of 90 and 180 deg.
const STATIONS_DEG: [f64; 4] = [-90.0, 0.0, 90.0, -90.0];

const STEP: &str = "climatic chamber";

/// A mean of what a node's filter puts out.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    /// 2^-26 g per step.
    pub accel: [f64; 3],
    /// As the gyroscope reads it, rad/s; 0 where there is none.
    pub rate: [f64; 3],
    /// The part's temperature.
    pub temperature: Temperature,
}

/// Means of both nodes over `duration_s`, after `settle_s`.
///
/// Errors: [`BenchError::Silent`] when a node gives nothing.
pub fn mean_of_both(
    instrument: &mut Instrument,
    mover: &mut impl Mover,
    settle_s: f64,
    duration_s: f64,
    step: &'static str,
) -> Result<[Mean; 2], BenchError> {
    run(instrument, mover, settle_s);
    let mut sums = [[0.0; 3]; 2];
    let mut rates = [[0.0; 3]; 2];
    let mut counts = [0.0; 2];
    let mut last = [None; 2];
    for _ in 0..(duration_s / crate::TICK_S) as u32 {
        run(instrument, mover, crate::TICK_S);
        for (i, side) in instrument.sides.iter().enumerate() {
            let Some((filtered, at)) = side.node.channel.filtered() else {
                continue;
            };
            if last[i] == Some(at) {
                continue;
            }
            last[i] = Some(at);
            counts[i] += 1.0;
            for (sum, a) in sums[i].iter_mut().zip(filtered.accel) {
                *sum += f64::from(a);
            }
            let rate = side.node.channel.measured_rate().unwrap_or_default();
            for (sum, rate) in rates[i].iter_mut().zip(rate.rad_s()) {
                *sum += rate;
            }
        }
    }
    let mut means = [Mean::default(); 2];
    for (i, mean) in means.iter_mut().enumerate() {
        let temperature = instrument.sides[i].node.channel.temperature();
        let alive = counts[i] > 0.0 && instrument.sides[i].node.channel.fault().is_none();
        let (Some(temperature), true) = (temperature, alive) else {
            return Err(BenchError::Silent { step, node: i + 1 });
        };
        *mean = Mean {
            accel: sums[i].map(|s| s / counts[i]),
            rate: rates[i].map(|s| s / counts[i]),
            temperature,
        };
    }
    Ok(means)
}

/// Mean of what was read at one stair, over the two runs.
#[derive(Clone, Copy, Default)]
struct Stair {
    accel: [f64; 3],
    temperature: f64,
    count: f64,
}

impl Stair {
    fn add(&mut self, mean: &Mean) {
        for (sum, a) in self.accel.iter_mut().zip(mean.accel) {
            *sum += a;
        }
        self.temperature += f64::from(mean.temperature.0);
        self.count += 1.0;
    }

    fn dwell(&self) -> Dwell {
        let count = self.count.max(1.0);
        Dwell {
            temperature: Temperature((self.temperature / count) as i32),
            accel: self.accel.map(|a| a / count),
        }
    }
}

/// What is gathered while the profile runs.
#[derive(Default)]
struct Gathered {
    stairs: [[Stair; KNOTS]; 2],
    fits: [QuadraticFit; 2],
    biases: [BiasFit; 2],
    /// Temperatures that each part has told.
    spans: [Span; 2],
}

impl Gathered {
    fn note(&mut self, means: &[Mean; 2]) {
        for (span, mean) in self.spans.iter_mut().zip(means) {
            *span = span.widened(mean.temperature);
        }
    }
}

impl Bench {
    /// Runs the profile twice, fits, and sets the temperature model in both nodes.
    ///
    /// Errors: a fit that is refused, or a silent node.
    pub fn characterise(&mut self) -> Result<(), BenchError> {
        let mut gathered = Gathered::default();
        for turned in [false, true] {
            self.run_profile(Profile::paper(), turned, &mut gathered)?;
        }
        if self.mode == Mode::Paper {
            self.bring_to(15.0);
        } else {
            self.run_profile(Profile::down_the_stairs(), false, &mut gathered)?;
            self.bring_to(35.0);
        }
        self.bring_to(25.0);
        self.fit_biases(&gathered)?;
        self.fit_temperature(&gathered)
    }

    /// Runs one profile and measures at the end of each of its dwells; turns gyroscopes at the
    /// ends of the stairs where they are to be `turned`.
    fn run_profile(
        &mut self,
        profile: Profile,
        turned: bool,
        into: &mut Gathered,
    ) -> Result<(), BenchError> {
        let mut program = Program::new(profile);
        while let Some((index, dwell, _)) = program.now() {
            let passed_s = program.step(&mut self.chamber, 10.0);
            self.pass(passed_s);
            if program.now().map(|(index, ..)| index) != Some(index) {
                self.measure(index, into)?;
                let at_end = index >= BEFORE_STAIRS && ENDS_C.contains(&dwell.set_point_c);
                if turned && at_end {
                    self.turn_gyroscopes()?;
                }
            }
        }
        Ok(())
    }

    /// Lets chamber time pass without sampling.
    fn pass(&mut self, passed_s: f64) {
        self.instrument.skip(passed_s);
        self.instrument.set_die_temperature(self.chamber.die_c);
    }

    /// Brings chamber and dies to `celsius`, in steps of 10 s, and waits until they are there.
    pub fn bring_to(&mut self, celsius: f64) {
        self.chamber.set_point(celsius);
        while (self.chamber.die_c - celsius).abs() > 0.02 {
            self.chamber.step(10.0);
            self.pass(10.0);
        }
    }

    fn measure(&mut self, index: usize, gathered: &mut Gathered) -> Result<(), BenchError> {
        if self.mode == Mode::Paper {
            let level = &mut Fixture::level();
            let means = mean_of_both(&mut self.instrument, level, 1.0, MEAN_S, STEP)?;
            gathered.note(&means);
            for (stairs, mean) in gathered.stairs.iter_mut().zip(&means) {
                let stair = index
                    .checked_sub(BEFORE_STAIRS)
                    .and_then(|i| stairs.get_mut(i));
                if let Some(stair) = stair {
                    stair.add(mean);
                }
            }
            return Ok(());
        }
        let mut rates = [[0.0; 3]; 2];
        for which in 0..ORIENTATIONS {
            let pose = &mut Fixture::tetrahedral(which);
            let share_g = pose.step(self.instrument.time_s()).force_g;
            let means = mean_of_both(&mut self.instrument, pose, 1.0, MEAN_S, STEP)?;
            gathered.note(&means);
            for (fit, mean) in gathered.fits.iter_mut().zip(&means) {
                let dwell = Dwell {
                    temperature: mean.temperature,
                    accel: mean.accel,
                };
                fit.add(which, share_g, dwell);
            }
            // What gravity does to a rate is another in each orientation, and 0 in their mean.
            for ((sum, fit), mean) in rates.iter_mut().zip(&mut gathered.biases).zip(&means) {
                for (sum, rate) in sum.iter_mut().zip(mean.rate) {
                    *sum += rate / ORIENTATIONS as f64;
                }
                if which + 1 == ORIENTATIONS {
                    fit.add(*sum, mean.temperature);
                }
            }
        }
        Ok(())
    }

    /// Turns of this dwell for the scale of the gyroscopes, where there are gyroscopes.
    fn turn_gyroscopes(&mut self) -> Result<(), BenchError> {
        if self.mode != Mode::Dynamic {
            return Ok(());
        }
        let turns = self.turn_in_all_mounts(&STATIONS_DEG, STEP)?;
        for (all, turns) in self.warm_turns.iter_mut().zip(turns) {
            all.extend(turns);
        }
        Ok(())
    }

    /// The gyroscopes' bias over temperature, where there are gyroscopes.
    fn fit_biases(&mut self, gathered: &Gathered) -> Result<(), BenchError> {
        if self.mode != Mode::Dynamic {
            return Ok(());
        }
        let fitted = |node: usize| {
            gathered.biases[node]
                .solve()
                .map_err(|error| BenchError::Fit {
                    step: "gyroscopes in the chamber",
                    node: node + 1,
                    error,
                })
        };
        self.biases = Some([fitted(0)?, fitted(1)?]);
        Ok(())
    }

    fn fit_temperature(&mut self, gathered: &Gathered) -> Result<(), BenchError> {
        for (i, side) in self.instrument.sides.iter_mut().enumerate() {
            let model = if self.mode == Mode::Paper {
                let dwells = gathered.stairs[i].map(|s| s.dwell());
                piecewise(&dwells).map(TemperatureModel::Piecewise)
            } else {
                gathered.fits[i].solve().map(TemperatureModel::Quadratic)
            };
            let calibration = &mut side.settings.chain.calibration;
            calibration.temperature = model.map_err(|error| BenchError::Fit {
                step: "climatic chamber",
                node: i + 1,
                error,
            })?;
            calibration.budget.span = gathered.spans[i];
        }
        Ok(())
    }
}
