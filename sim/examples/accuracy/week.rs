//! The week on the excavator, in each mode.

use std::fmt::Write as _;

use sim::bench::statistics::median;
use sim::bench::week::{Day, FAULT_DAY};
use sim::bench::{Bench, BenchError, Mode, World};

use crate::{AS_PRINTED, Scale, shared};

const DAYS: u32 = 7;

/// Weeks of every mode, by seed.
pub struct Weeks {
    pub paper: Vec<Vec<Day>>,
    printed: Vec<Vec<Day>>,
    pub product: Vec<Vec<Day>>,
}

fn week_of(mode: Mode, world: &World, seed: u32) -> Result<Vec<Day>, BenchError> {
    let (mut bench, _) = Bench::commissioned(mode, world, u64::from(seed), 0)?;
    let mut days = Vec::new();
    bench.week(DAYS, u64::from(seed), |day| {
        days.push(Day {
            trace: Vec::new(),
            ..day
        })
    });
    Ok(days)
}

impl Weeks {
    pub fn dig(scale: &Scale) -> Result<Self, BenchError> {
        let nominal = World::NOMINAL;
        Ok(Self {
            paper: shared(scale.weeks, |seed| week_of(Mode::Paper, &nominal, seed))?,
            printed: shared(scale.printed_weeks, |seed| {
                week_of(Mode::Paper, &AS_PRINTED, seed)
            })?,
            product: shared(scale.weeks, |seed| week_of(Mode::Product, &nominal, seed))?,
        })
    }

    pub fn section(&self, page: &mut String) {
        let _ = writeln!(
            page,
            "## The week on the excavator (R18, Fig 20)\n\n{} seeds ({} as printed), {DAYS} days \
             of 3 hours, 50 comparisons a second; the supply of node 2 is unstable from the first \
             hour of day {FAULT_DAY} on, until the fault is reported. Counts are sums over the \
             seeds. Paper mode works on the paper's machine, whose vibration is set by Fig 21; as \
             printed and product mode work on the harder one.\n\n\
             | mode | day | warnings | stops of 45 s | faults | weeks with a fault that day |\n\
             |---|---|---|---|---|---|",
            self.paper.len(),
            self.printed.len(),
        );
        for (name, weeks) in [
            ("paper mode", &self.paper),
            ("as printed", &self.printed),
            ("product mode", &self.product),
        ] {
            (1..=DAYS).for_each(|day| day_row(page, name, weeks, day));
        }
        product_week(page, &self.product);
    }
}

fn day_row(page: &mut String, name: &str, weeks: &[Vec<Day>], day: u32) {
    let of: Vec<_> = weeks.iter().flatten().filter(|d| d.day == day).collect();
    let sum = |pick: fn(&Day) -> u64| of.iter().map(|d| pick(d)).sum::<u64>();
    let with = of.iter().filter(|d| d.faults > 0).count();
    let _ = writeln!(
        page,
        "| {name} | {day} | {} | {} | {} | {with} of {} |",
        sum(|d| d.warnings),
        sum(|d| d.stops),
        sum(|d| d.faults),
        weeks.len(),
    );
}

fn product_week(page: &mut String, weeks: &[Vec<Day>]) {
    let days = || weeks.iter().flatten();
    let mut delay: Vec<_> = days().filter_map(|d| d.detection_s).collect();
    let left: u64 = days().map(|d| d.after_cure).sum();
    let quiet: u64 = days()
        .filter(|d| d.day != FAULT_DAY)
        .map(|d| d.warnings)
        .sum();
    let silent: u64 = days().map(|d| d.waiting).sum();
    let pairs: u64 = days().map(|d| d.pairs).sum();
    let largest = delay.iter().copied().fold(0.0, f64::max);
    let _ = writeln!(
        page,
        "\nProduct mode: warnings on days with a good supply {quiet} (must be 0); faults after the \
         supply was mended and the instrument reset {left} (must be 0). From the hour at which \
         the supply may fail to the report {:.1} s in the median and {largest:.1} s at most, of \
         which the supply itself holds for up to 20 s. Comparisons without both readings, because \
         a shock drove a part over its range: {:.1} %.\n",
        median(&mut delay),
        100.0 * silent as f64 / pairs as f64,
    );
}
