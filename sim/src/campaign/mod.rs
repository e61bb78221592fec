//! The world tries to break the instrument: a trial for each seed.
//!
//! In: seeds, and instruments from the bench. Out: an [`Outcome`] for each, which prints as lines
//! that end with the one command that runs it again, and a [`Summary`] of many. The same seed
//! gives the same trial and the same fingerprint.
//!
//! Left out: clocks and threads, which belong to the program that runs a campaign.

mod draw;
mod summary;

use std::fmt;

use crate::bench::{BenchError, Mode};
use crate::trial::checks::Rule;
use crate::trial::checks::detection::{Blame, Detection};
use crate::trial::pool::Pool;
use crate::trial::sabotage::Sabotage;
use crate::trial::{self, NoSuchUnit, Report, Seen, Setup};

pub use draw::{UNITS, draw, draw_with_gyroscope};
pub use summary::Summary;

/// Seeds among which a device broken on purpose must be found out.
pub const CANARY_SEEDS: std::ops::RangeInclusive<u64> = 1..=40;

/// A trial and what came of it.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The trial.
    pub setup: Setup,
    /// What came of it.
    pub report: Report,
}

/// Every instrument that a seed may draw; `product` is the product's mode.
///
/// Errors: see [`BenchError`].
pub fn pool(product: Mode) -> Result<Pool, BenchError> {
    let modes = [product, Mode::Paper];
    let units = modes.map(|mode| (0..UNITS).map(move |unit| (mode, unit)));
    Pool::of(&units.into_iter().flatten().collect::<Vec<_>>())
}

/// The instrument of one seed.
///
/// Errors: see [`BenchError`].
pub fn pool_for(setup: &Setup) -> Result<Pool, BenchError> {
    Pool::of(&[(setup.mode, setup.unit)])
}

/// Runs a trial; `seen` gets every event of the bus.
///
/// Errors: the pool lacks its unit.
pub fn run(setup: Setup, pool: &Pool, seen: impl FnMut(Seen<'_>)) -> Result<Outcome, NoSuchUnit> {
    let report = trial::run(&setup, pool, seen)?;
    Ok(Outcome { setup, report })
}

/// Runs the trials of [`CANARY_SEEDS`] within the promise with a device that is broken on purpose
/// until one is found out; the number of trials and that outcome, or `None` when none was.
///
/// Errors: the pool lacks a unit.
pub fn canary(pool: &Pool) -> Result<(u32, Option<Outcome>), NoSuchUnit> {
    let mut trials = 0;
    for seed in CANARY_SEEDS {
        let mut setup = draw(seed);
        if !setup.within_promise || setup.mode == Mode::Paper {
            continue;
        }
        setup.sabotage = Sabotage::Blind;
        trials += 1;
        let outcome = run(setup, pool, |_| {})?;
        let caught = |rule| outcome.report.violations.iter().any(|v| v.rule == rule);
        if caught(Rule::WrongAngle) {
            return Ok((trials, Some(outcome)));
        }
    }
    Ok((trials, None))
}

impl Outcome {
    /// True when no rule was broken.
    pub fn passed(&self) -> bool {
        self.report.violations.is_empty()
    }

    /// The command that runs this trial again.
    pub fn replay(&self) -> String {
        match self.setup.sabotage {
            Sabotage::None => {
                let variant = match self.setup.mode {
                    Mode::Dynamic => " --gyroscope",
                    _ => "",
                };
                format!("cargo sim seed {}{variant}", self.setup.seed)
            }
            Sabotage::Blind => "cargo sim canary".into(),
        }
    }
}

/// When a fault was detected, and which channel was named, in words.
fn told(detection: &Detection) -> String {
    let Some(after_s) = detection.told_s() else {
        return "not detected".into();
    };
    let blame = match detection.blame() {
        Blame::Right => "the right channel named",
        Blame::Wrong => "the wrong channel named",
        Blame::Unknown => "no channel named",
    };
    let named_s = detection.by.iter().filter_map(|f| f.named).map(|n| n.0);
    match named_s.reduce(f64::min) {
        Some(named_s) => format!("after {after_s:.3} s, {blame} after {named_s:.3} s"),
        None => format!("after {after_s:.3} s, {blame}"),
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { setup, report } = self;
        write!(f, "{setup}")?;
        if setup.mode == Mode::Paper {
            let reaction_s = setup.limits().reaction_s;
            writeln!(
                f,
                "paper mode     the promise is not for it: a wrong angle counts from \
                 {reaction_s} s on (erratum E16)"
            )?;
        }
        for (injection, detection) in setup.faults.iter().zip(&report.detections) {
            writeln!(f, "detected       {}: {}", injection.what, told(detection))?;
        }
        let (duration_s, old) = (report.duration_s, report.old_angles);
        writeln!(
            f,
            "lasted         {duration_s:.1} s, a wrong angle marked valid for {:.3} s at the most, \
             {old} angles of an earlier SYNC",
            report.longest_wrong_s
        )?;
        writeln!(f, "fingerprint    {:016x}", report.fingerprint)?;
        for violation in &report.violations {
            writeln!(f, "broken         {violation}")?;
        }
        let verdict = if self.passed() { "passed" } else { "FAILED" };
        writeln!(f, "verdict        {verdict}")?;
        writeln!(f, "again          {}", self.replay())
    }
}

#[cfg(test)]
mod tests;
