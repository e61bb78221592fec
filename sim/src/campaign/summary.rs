//! Many trials in a few lines.
//!
//! In: outcomes. Out: how many there were, how many rules were broken, and for each kind of fault
//! how often and how soon it was told and who was named. Printed as a table.

use std::collections::BTreeMap;
use std::fmt;

use super::Outcome;
use crate::bench::Mode;
use crate::bench::statistics::median;
use crate::trial::checks::detection::Blame;

/// Of one kind of fault.
#[derive(Clone, Debug, Default)]
struct Row {
    trials: u32,
    told_s: Vec<f64>,
    right: u32,
    wrong: u32,
}

/// Of all trials so far. Paper mode, what is beyond the promise, and maintenance, of which either
/// node may rightly be named, are left out of the rows.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// Trials.
    pub trials: u64,
    /// Trials in which a rule was broken.
    pub failed: u64,
    /// Trials in product mode within the promise, without maintenance.
    pub promised: u64,
    /// Trials in product mode in which one node alone was maintained.
    pub maintained: u64,
    /// The longest time for which a wrong angle was marked valid, in product mode within the
    /// promise, s.
    pub longest_wrong_s: f64,
    /// Virtual time, s.
    pub virtual_s: f64,
    broken: BTreeMap<&'static str, u32>,
    rows: BTreeMap<String, Row>,
}

impl Summary {
    /// Counts one trial.
    pub fn add(&mut self, outcome: &Outcome) {
        let Outcome { setup, report } = outcome;
        self.trials += 1;
        self.failed += u64::from(!outcome.passed());
        self.virtual_s += report.duration_s;
        for violation in &report.violations {
            *self.broken.entry(violation.rule.name()).or_default() += 1;
        }
        if !setup.within_promise || setup.mode == Mode::Paper {
            return;
        }
        if !setup.maintenance.is_empty() {
            self.maintained += 1;
            return;
        }
        self.promised += 1;
        self.longest_wrong_s = self.longest_wrong_s.max(report.longest_wrong_s);
        for (injection, detection) in setup.faults.iter().zip(&report.detections) {
            // Up or down makes no difference to how soon a fault is told.
            let name = injection
                .what
                .to_string()
                .replace(" -", " ")
                .replace(" +", " ");
            let row = self.rows.entry(name).or_default();
            row.trials += 1;
            row.told_s.extend(detection.told_s());
            match detection.blame() {
                Blame::Right => row.right += 1,
                Blame::Wrong => row.wrong += 1,
                Blame::Unknown => {}
            }
        }
    }

    /// Counts what another summary has counted.
    pub fn join(&mut self, other: Self) {
        self.trials += other.trials;
        self.failed += other.failed;
        self.promised += other.promised;
        self.maintained += other.maintained;
        self.virtual_s += other.virtual_s;
        self.longest_wrong_s = self.longest_wrong_s.max(other.longest_wrong_s);
        for (rule, count) in other.broken {
            *self.broken.entry(rule).or_default() += count;
        }
        for (name, row) in other.rows {
            let mine = self.rows.entry(name).or_default();
            mine.trials += row.trials;
            mine.told_s.extend(row.told_s);
            mine.right += row.right;
            mine.wrong += row.wrong;
        }
    }
}

/// A delay; a dash where nothing was detected.
fn seconds(seconds: Option<f64>) -> String {
    seconds.map_or("-".to_owned(), |s| format!("{s:.3}"))
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hours = self.virtual_s / 3600.0;
        writeln!(
            f,
            "{} trials, {hours:.2} h of virtual time, {} failed",
            self.trials, self.failed
        )?;
        writeln!(
            f,
            "{} of them of the product within the promise; in these a wrong angle was marked \
             valid for {:.3} s at the most",
            self.promised, self.longest_wrong_s
        )?;
        writeln!(
            f,
            "{} more with maintenance of one node alone, or of SYNC, while its fault stood",
            self.maintained
        )?;
        for (rule, count) in &self.broken {
            writeln!(f, "  {rule}: {count}")?;
        }
        if self.rows.is_empty() {
            return Ok(());
        }
        writeln!(
            f,
            "{:<24} {:>6} {:>10} {:>9} {:>9} {:>6} {:>6}",
            "fault, in these", "trials", "detected %", "median s", "worst s", "right", "wrong"
        )?;
        for (name, row) in &self.rows {
            let mut told_s = row.told_s.clone();
            let share = told_s.len() as f64 / f64::from(row.trials) * 100.0;
            let worst_s = told_s.iter().copied().reduce(f64::max);
            let median_s = worst_s.map(|_| median(&mut told_s));
            let [median_s, worst_s] = [median_s, worst_s].map(seconds);
            writeln!(
                f,
                "{name:<24} {:>6} {share:>10.0} {median_s:>9} {worst_s:>9} {:>6} {:>6}",
                row.trials, row.right, row.wrong
            )?;
        }
        Ok(())
    }
}
