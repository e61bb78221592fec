//! The sequence of temperatures that an instrument is taken through.
//!
//! In: nothing (the paper's own, R4), a file, or ends and steps. Out: a [`Profile`]: dwells in
//! degC of the air and minutes, how often the whole of it is run, which branch of the thermal
//! hysteresis each dwell lies on, and how the part is conditioned behind the last one.
//!
//! A file has a dwell a line, degC and minutes; `runs N` may stand before them, and `#` begins a
//! comment. Left out: reaching a temperature (`hold`), and what is measured there (`run`).

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sim::chamber;
use tilt::temperature::KNOTS;

use super::model::Model;

/// Temperatures of a dwell, degC: the sensor's operating range is -40 to 85 degC.
const TEMPERATURES: std::ops::RangeInclusive<f64> = -40.0..=85.0;

/// Minutes of a dwell: to a day.
const DWELLS: std::ops::RangeInclusive<f64> = 0.1..=1440.0;

/// The lowest stair of eq 6 and all of them together, degC: a sensor tells its temperature to a
/// degree.
const RISE_C: f64 = 2.0;
const WIDTH_C: f64 = 10.0;

/// Runs of a profile.
const RUNS: std::ops::RangeInclusive<u32> = 1..=10;

/// The most dwells of a profile.
const LONGEST: usize = 200;

/// Where calibrations are made, and where the part is brought at the end, degC.
pub const REFERENCE_C: f64 = 25.0;

/// How far beyond it the part is taken, so that the hysteresis ends in the middle of its loop.
const CONDITIONING_C: f64 = 10.0;

/// One dwell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Temperature of the air.
    pub temperature_degc: f64,
    /// How long it is kept once the air is stable.
    pub dwell_min: f64,
}

/// Which branch of the hysteresis a dwell lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Branch {
    /// The first one: nothing is known of what was before.
    Start,
    /// Warmer than the one before.
    Up,
    /// Colder than the one before.
    Down,
}

/// A sequence of dwells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Profile {
    /// How often the whole of it is run.
    pub runs: u32,
    /// The dwells in their order.
    pub steps: Vec<Step>,
}

/// Why a profile is none.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    /// A line of it is no dwell: its number and its text.
    #[error("{0} line {1}: {2:?} is no dwell: write degC and minutes, as 25 10, or runs 2")]
    Line(PathBuf, usize, String),
    /// There are no dwells, or too many.
    #[error("a profile has 1 to {LONGEST} dwells; this one has {0}")]
    Count(usize),
    /// A temperature is beyond what the sensor is made for.
    #[error("{0} degC is beyond the sensor's operating range, -40 to 85 degC")]
    Temperature(f64),
    /// A dwell is too short or too long.
    #[error("a dwell of {0} min is none: take 0.1 to 1440 min")]
    Dwell(f64),
    /// It is run never or too often.
    #[error("{0} runs are too few or too many: take 1 to 10")]
    Runs(u32),
    /// The stairs do not lead from one end to the other.
    #[error("no stairs lead there: give --from below --to and a --step above 0")]
    Stairs,
    /// The quadratics want three temperatures over 20 degC.
    #[error("the quadratic model takes three temperatures over 20 degC or more: add dwells")]
    Narrow,
    /// The stairs of eq 6 are too low, or all of them together are.
    #[error("the piecewise model takes stairs of {RISE_C} degC or more, {WIDTH_C} degC together")]
    Flat,
    /// Eq 6 has slopes between two to nine rising temperatures; how many there are.
    #[error(
        "the piecewise model takes 2 to {KNOTS} rising temperatures in a row; the profile has {0}"
    )]
    Knots(usize),
}

impl From<&chamber::Dwell> for Step {
    fn from(dwell: &chamber::Dwell) -> Self {
        Self {
            temperature_degc: dwell.set_point_c,
            dwell_min: dwell.dwell_min,
        }
    }
}

impl Profile {
    /// The paper's run (section II.B), twice; for the quadratics down the stairs again as well.
    pub fn paper(model: Model) -> Self {
        let up = chamber::Profile::paper();
        let mut steps: Vec<Step> = up.steps.iter().map(Step::from).collect();
        if model == Model::Quadratic {
            let down = chamber::Profile::down_the_stairs();
            steps.extend(down.steps.iter().map(Step::from));
        }
        Self { runs: 2, steps }
    }

    /// Stairs from one temperature up to another; for the quadratics down again as well.
    ///
    /// Errors: [`ProfileError::Stairs`].
    pub fn stairs(
        [from, to, step, dwell_min]: [f64; 4],
        runs: u32,
        model: Model,
    ) -> Result<Self, ProfileError> {
        // The last stair is a lower one where the step does not fit.
        let count = ((to - from) / step - 1e-9).ceil();
        if !(from < to && step > 0.0 && (1.0..=LONGEST as f64).contains(&count)) {
            return Err(ProfileError::Stairs);
        }
        let at = |n: u32| Step {
            temperature_degc: (from + f64::from(n) * step).min(to),
            dwell_min,
        };
        let last = count as u32;
        let mut steps: Vec<Step> = (0..=last).map(at).collect();
        if model == Model::Quadratic {
            steps.extend((0..last).rev().map(at));
        }
        Ok(Self { runs, steps })
    }

    /// The profile in the text of this file; `runs` where it has none.
    ///
    /// Errors: [`ProfileError::Line`].
    pub fn read(path: &Path, text: &str, runs: u32) -> Result<Self, ProfileError> {
        let mut profile = Self {
            runs,
            steps: Vec::new(),
        };
        // Some editors put a mark of the byte order first.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        for (number, line) in (1..).zip(text.lines()) {
            let bare = line.split('#').next().unwrap_or("").trim();
            let words: Vec<&str> = bare.split_whitespace().collect();
            let taken = match words[..] {
                [] => Some(()),
                ["runs", runs] if profile.steps.is_empty() => {
                    runs.parse().ok().map(|runs| profile.runs = runs)
                }
                [degc, minutes] => step(degc, minutes).map(|step| profile.steps.push(step)),
                _ => None,
            };
            taken.ok_or_else(|| ProfileError::Line(path.to_owned(), number, bare.to_owned()))?;
        }
        Ok(profile)
    }

    /// Whether a model can be fitted to what such a run measures.
    ///
    /// Errors: see [`ProfileError`].
    pub fn check(&self, model: Model) -> Result<(), ProfileError> {
        if !(1..=LONGEST).contains(&self.steps.len()) {
            return Err(ProfileError::Count(self.steps.len()));
        }
        if !RUNS.contains(&self.runs) {
            return Err(ProfileError::Runs(self.runs));
        }
        for step in &self.steps {
            if !TEMPERATURES.contains(&step.temperature_degc) {
                return Err(ProfileError::Temperature(step.temperature_degc));
            }
            if !DWELLS.contains(&step.dwell_min) {
                return Err(ProfileError::Dwell(step.dwell_min));
            }
        }
        match model {
            Model::Quadratic => self.check_width(),
            Model::Piecewise => self.check_stair(),
        }
    }

    fn check_stair(&self) -> Result<(), ProfileError> {
        let stair = self.steps.get(self.stair()).unwrap_or(&[]);
        if !(2..=KNOTS).contains(&stair.len()) {
            return Err(ProfileError::Knots(stair.len()));
        }
        let rise = |pair: &[Step]| pair[1].temperature_degc - pair[0].temperature_degc;
        let low = stair.windows(2).any(|pair| rise(pair) < RISE_C);
        match low || rise(&[stair[0], stair[stair.len() - 1]]) < WIDTH_C {
            true => Err(ProfileError::Flat),
            false => Ok(()),
        }
    }

    fn check_width(&self) -> Result<(), ProfileError> {
        let mut all: Vec<f64> = self.steps.iter().map(|s| s.temperature_degc).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        match (all.len(), all.first(), all.last()) {
            (3.., Some(low), Some(high)) if high - low >= 20.0 => Ok(()),
            _ => Err(ProfileError::Narrow),
        }
    }

    /// The longest row of rising temperatures: the stairs of eq 6.
    pub fn stair(&self) -> Range<usize> {
        let mut longest = 0..0;
        let mut begin = 0;
        for end in 1..=self.steps.len() {
            let rises = |pair: &[Step]| pair[1].temperature_degc > pair[0].temperature_degc;
            if end - begin > longest.len() {
                longest = begin..end;
            }
            if self
                .steps
                .get(end - 1..=end)
                .is_some_and(|pair| !rises(pair))
            {
                begin = end;
            }
        }
        longest
    }

    /// Run (from 1) and number of each dwell, in their order.
    pub fn places(&self) -> impl Iterator<Item = (u32, usize)> + '_ {
        (1..=self.runs).flat_map(|run| (0..self.steps.len()).map(move |step| (run, step)))
    }

    /// The dwell before this one; none before the first.
    pub fn before(&self, run: u32, step: usize) -> Option<Step> {
        let last = self.steps.last().filter(|_| run > 1);
        let before = step.checked_sub(1).and_then(|step| self.steps.get(step));
        before.or(last).copied()
    }

    /// The branch that a dwell lies on; one at the temperature of the one before lies on its.
    pub fn branch(&self, run: u32, step: usize) -> Branch {
        let places = self.places().collect::<Vec<_>>();
        let here = places.iter().position(|place| *place == (run, step));
        let mut later = self.steps.get(step).map(|step| step.temperature_degc);
        for (run, step) in places[..here.unwrap_or(0)].iter().rev() {
            debug_assert!(*run <= self.runs);
            let earlier = self.steps[*step].temperature_degc;
            match later {
                Some(later) if later > earlier => return Branch::Up,
                Some(later) if later < earlier => return Branch::Down,
                _ => later = Some(earlier),
            }
        }
        Branch::Start
    }

    /// Where the part is brought behind the last dwell: past the reference and back, from the side
    /// on which it ended.
    pub fn conditioning(&self) -> [f64; 2] {
        let last = self
            .steps
            .last()
            .map_or(REFERENCE_C, |s| s.temperature_degc);
        let beyond = match last < REFERENCE_C {
            true => REFERENCE_C + CONDITIONING_C,
            false => REFERENCE_C - CONDITIONING_C,
        };
        [beyond, REFERENCE_C]
    }

    /// The lowest and the highest temperature, degC.
    pub fn ends(&self) -> [f64; 2] {
        let all = || self.steps.iter().map(|step| step.temperature_degc);
        [
            all().fold(f64::MAX, f64::min),
            all().fold(f64::MIN, f64::max),
        ]
    }
}

fn step(degc: &str, minutes: &str) -> Option<Step> {
    let number = |text: &str| text.parse().ok().filter(|n: &f64| n.is_finite());
    Some(Step {
        temperature_degc: number(degc)?,
        dwell_min: number(minutes)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn profile(temperatures: &[f64]) -> Profile {
        let step = |degc: &f64| Step {
            temperature_degc: *degc,
            dwell_min: 1.0,
        };
        Profile {
            runs: 2,
            steps: temperatures.iter().map(step).collect(),
        }
    }

    #[test]
    fn the_paper_s_run_is_nine_stairs_twice_and_for_the_product_down_again() {
        let paper = Profile::paper(Model::Piecewise);
        assert_eq!((paper.runs, paper.steps.len()), (2, 12));
        assert_eq!(paper.stair(), 3..12);
        assert!(paper.check(Model::Piecewise).is_ok());
        assert_eq!(paper.conditioning(), [15.0, 25.0]);
        let product = Profile::paper(Model::Quadratic);
        assert_eq!((product.runs, product.steps.len()), (2, 20));
        assert_eq!(product.stair(), 3..12);
        assert!(product.check(Model::Quadratic).is_ok());
        assert_eq!(product.conditioning(), [35.0, 25.0]);
        assert_eq!(product.ends(), [-10.0, 70.0]);
        let minutes: f64 = product.steps.iter().map(|s| s.dwell_min).sum();
        assert_eq!(minutes, 430.0 + 320.0);
    }

    #[test]
    fn branches_are_those_of_the_way_and_a_second_dwell_at_one_temperature_keeps_its() {
        let profile = profile(&[25.0, 0.0, 0.0, 10.0]);
        let branches: Vec<_> = profile
            .places()
            .map(|(run, step)| profile.branch(run, step))
            .collect();
        use Branch::{Down, Start, Up};
        assert_eq!(branches, [Start, Down, Down, Up, Up, Down, Down, Up]);
        assert_eq!(profile.before(1, 0), None);
        assert_eq!(profile.before(2, 0).unwrap().temperature_degc, 10.0);
        assert_eq!(profile.before(2, 1).unwrap().temperature_degc, 25.0);
    }

    #[test]
    fn stairs_end_at_their_ends() {
        let up = Profile::stairs([-10.0, 70.0, 40.0, 5.0], 1, Model::Piecewise).unwrap();
        let temperatures =
            |p: &Profile| -> Vec<f64> { p.steps.iter().map(|s| s.temperature_degc).collect() };
        assert_eq!(temperatures(&up), [-10.0, 30.0, 70.0]);
        let both = Profile::stairs([0.0, 50.0, 20.0, 5.0], 1, Model::Quadratic).unwrap();
        assert_eq!(
            temperatures(&both),
            [0.0, 20.0, 40.0, 50.0, 40.0, 20.0, 0.0]
        );
        let lower = Profile::stairs([0.0, 50.0, 22.0, 5.0], 1, Model::Piecewise).unwrap();
        assert_eq!(temperatures(&lower), [0.0, 22.0, 44.0, 50.0]);
        for ends in [
            [0.0, 0.0, 1.0, 1.0],
            [0.0, 9.0, 0.0, 1.0],
            [9.0, 0.0, 1.0, 1.0],
        ] {
            let told = Profile::stairs(ends, 1, Model::Quadratic);
            assert!(matches!(told, Err(ProfileError::Stairs)), "{ends:?}");
        }
    }

    #[test]
    fn what_no_model_can_be_fitted_to_is_refused_before_anything_is_done() {
        let told = |temperatures: &[f64], model| {
            let told = profile(temperatures).check(model);
            told.map_err(|error| error.to_string()).unwrap_err()
        };
        let narrow = told(&[20.0, 25.0, 30.0], Model::Quadratic);
        assert!(narrow.contains("three temperatures"), "{narrow}");
        assert!(told(&[0.0, 50.0, 0.0], Model::Quadratic).contains("three"));
        assert!(told(&[50.0, 20.0, 0.0], Model::Piecewise).contains("has 1"));
        let many: Vec<f64> = (0..10).map(f64::from).collect();
        assert!(told(&many, Model::Piecewise).contains("has 10"));
        assert!(told(&many[..9], Model::Piecewise).contains("stairs of 2 degC"));
        assert!(told(&[0.0, 5.0], Model::Piecewise).contains("10 degC together"));
        assert!(told(&[0.0, 30.0, 90.0], Model::Quadratic).contains("90 degC"));
        assert!(told(&[], Model::Quadratic).contains("has 0"));
        let mut short = profile(&[0.0, 30.0, 60.0]);
        short.steps[1].dwell_min = 0.0;
        assert!(short.check(Model::Quadratic).is_err());
        short.steps[1].dwell_min = f64::NAN;
        assert!(short.check(Model::Quadratic).is_err());
        short = profile(&[0.0, 30.0, 60.0]);
        short.runs = 0;
        assert!(short.check(Model::Quadratic).is_err());
    }

    #[test]
    fn a_file_is_read_line_by_line_and_the_bad_line_is_named() {
        let read = |text: &str| Profile::read(Path::new("profile"), text, 2);
        let text = "# two stairs\nruns 1\n\n25 10 # begin\n-10\t0.5\n";
        let profile = read(text).unwrap();
        assert_eq!((profile.runs, profile.steps.len()), (1, 2));
        assert_eq!(profile.steps[1].temperature_degc, -10.0);
        assert_eq!(read("0 1\n").unwrap().runs, 2);
        assert_eq!(read("\u{feff}25 1\n").unwrap().steps.len(), 1);
        // `runs` stands before the dwells.
        for bad in ["25", "25 ten", "25 10 5", "runs many", "nan 1", "runs 2"] {
            let told = read(&format!("0 1\n{bad}\n")).unwrap_err().to_string();
            assert!(told.contains("line 2"), "{told}");
        }
    }
}
