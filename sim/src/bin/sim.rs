//! `sim`: the world tries to break the instrument, seed by seed.
//!
//! In: a seed, or a time to go on. Out: what happened, on stdout; progress on stderr. Exit status
//! 0 when every trial passed, 1 when one failed, 2 when the command could not be carried out.
//!
//! This is where clocks and threads are: worlds have neither.

use std::io::Write;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use clap::{Parser, Subcommand};
use sim::bench::{BenchError, Mode};
use sim::campaign::{self, Outcome, Summary};
use sim::can_bus::Event;
use sim::trial::pool::Pool;
use sim::trial::{NoSuchUnit, Seen, Setup};

/// Worlds that run side by side.
const WORKERS: usize = 2;

/// Seeded trials of the virtual instrument.
///
/// Exit status: 0 when all is well, 1 when a trial failed, 2 when the command could not be carried
/// out.
#[derive(Debug, Parser)]
#[command(name = "sim", version, arg_required_else_help = true)]
struct CommandLine {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Run the trial of one seed and print everything about it
    Seed {
        /// The seed
        seed: u64,
        /// Print every message on the bus beside the truth
        #[arg(long)]
        trace: bool,
        /// Take the variant with a gyroscope
        #[arg(long)]
        gyroscope: bool,
    },
    /// Run seed after seed for a time, up to the first that fails
    Campaign {
        /// How long, minutes; more than 0
        #[arg(long)]
        minutes: f64,
        /// The first seed
        #[arg(long, default_value_t = 1)]
        from: u64,
        /// Go on after a failure, and list all that fail
        #[arg(long)]
        keep_going: bool,
        /// Take the variant with a gyroscope
        #[arg(long)]
        gyroscope: bool,
    },
    /// Run so many seeds, one after the other
    Fixed {
        /// How many; more than 0
        #[arg(long)]
        seeds: u64,
        /// The first seed
        #[arg(long, default_value_t = 1)]
        from: u64,
        /// Go on after a failure, and list all that fail
        #[arg(long)]
        keep_going: bool,
        /// Take the variant with a gyroscope
        #[arg(long)]
        gyroscope: bool,
    },
    /// Run a device that is broken on purpose: it must be found out
    Canary,
}

/// Why a command could not be carried out.
#[derive(Debug)]
enum Problem {
    Bench(BenchError),
    Unit(NoSuchUnit),
    /// A time that nothing can be done in.
    Minutes,
    /// No seed at all.
    NoSeeds,
    /// More seeds than there are from this one on.
    Seeds(u64),
}

impl From<BenchError> for Problem {
    fn from(error: BenchError) -> Self {
        Self::Bench(error)
    }
}

impl From<NoSuchUnit> for Problem {
    fn from(error: NoSuchUnit) -> Self {
        Self::Unit(error)
    }
}

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Bench(error) => write!(f, "an instrument could not be calibrated: {error}"),
            Self::Unit(error) => error.fmt(f),
            Self::Minutes => f.write_str("--minutes must be above 0 and at most 100000"),
            Self::NoSeeds => f.write_str("--seeds must be at least 1"),
            Self::Seeds(from) => write!(
                f,
                "there are not so many seeds from {from} on: the last one is {}",
                u64::MAX
            ),
        }
    }
}

fn main() -> ExitCode {
    let ended = match CommandLine::parse().verb {
        Verb::Seed {
            seed,
            trace,
            gyroscope,
        } => one(drawn(gyroscope)(seed), trace),
        Verb::Campaign {
            minutes,
            from,
            keep_going,
            gyroscope,
        } => for_a_time(minutes, from, keep_going, gyroscope),
        Verb::Fixed {
            seeds,
            from,
            keep_going,
            gyroscope,
        } => so_many(seeds, from, keep_going, gyroscope),
        Verb::Canary => canary(),
    };
    match ended {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(problem) => {
            eprintln!("sim: {problem}");
            ExitCode::from(2)
        }
    }
}

/// How trials are drawn.
fn drawn(gyroscope: bool) -> fn(u64) -> Setup {
    match gyroscope {
        true => campaign::draw_with_gyroscope,
        false => campaign::draw,
    }
}

fn one(setup: Setup, trace: bool) -> Result<bool, Problem> {
    let pool = campaign::pool_for(&setup)?;
    let outcome = campaign::run(setup, &pool, |seen| {
        if trace {
            print(seen);
        }
    })?;
    print!("{outcome}");
    Ok(outcome.passed())
}

/// A reader that has seen enough closes the pipe, which is no fault.
fn print(seen: Seen<'_>) {
    let at_s = seen.event.at_ns() as f64 * 1e-9;
    let mut out = std::io::stdout();
    let _ = match (seen.message, seen.event) {
        (Some((channel, message)), _) => {
            let name = ["A", "B"][channel];
            let [x, y] = seen.truth_deg.unwrap_or([f64::NAN; 2]);
            writeln!(out, "{at_s:.6} {name} {message:?}, truth {x:.2} {y:.2} deg")
        }
        (None, Event::Error { .. } | Event::Changed { .. }) => {
            writeln!(out, "{at_s:.6} {:?}", seen.event)
        }
        _ => Ok(()),
    };
}

fn canary() -> Result<bool, Problem> {
    let (trials, caught) = campaign::canary(&campaign::pool(Mode::Product)?)?;
    match &caught {
        Some(outcome) => {
            print!("{outcome}");
            println!("the device broken on purpose was found out in trial {trials}");
        }
        None => println!("the device broken on purpose passed {trials} trials"),
    }
    Ok(caught.is_some())
}

fn for_a_time(minutes: f64, from: u64, keep_going: bool, gyroscope: bool) -> Result<bool, Problem> {
    let many = Many {
        from,
        last: u64::MAX,
        time: Some(time(minutes)?),
        keep_going,
        gyroscope,
    };
    many.run()
}

/// Nothing tried would be nothing failed, and count as passed.
fn time(minutes: f64) -> Result<Duration, Problem> {
    if minutes > 0.0 && minutes <= 1e5 {
        Ok(Duration::from_secs_f64(minutes * 60.0))
    } else {
        Err(Problem::Minutes)
    }
}

fn so_many(seeds: u64, from: u64, keep_going: bool, gyroscope: bool) -> Result<bool, Problem> {
    let many = Many {
        from,
        last: last(seeds, from)?,
        time: None,
        keep_going,
        gyroscope,
    };
    many.run()
}

/// The last of so many seeds.
fn last(seeds: u64, from: u64) -> Result<u64, Problem> {
    let further = seeds.checked_sub(1).ok_or(Problem::NoSeeds)?;
    from.checked_add(further).ok_or(Problem::Seeds(from))
}

/// Many trials.
struct Many {
    from: u64,
    last: u64,
    /// No trial but the first begins later than this after the start.
    time: Option<Duration>,
    keep_going: bool,
    /// Of the variant with a gyroscope.
    gyroscope: bool,
}

/// What the workers share.
struct Shared {
    many: Many,
    pool: Pool,
    begun: Instant,
    /// Seeds given to workers so far; a count, since the seed behind the last one is no number.
    given: AtomicU64,
    stop: AtomicBool,
    /// Trials so far, and those that failed.
    done: Mutex<(Summary, Vec<Outcome>)>,
}

impl Many {
    fn run(self) -> Result<bool, Problem> {
        eprintln!("calibrating the instruments");
        let product = match self.gyroscope {
            true => Mode::Dynamic,
            false => Mode::Product,
        };
        let pool = campaign::pool(product)?;
        let shared = Shared {
            given: AtomicU64::new(0),
            many: self,
            pool,
            begun: Instant::now(),
            stop: AtomicBool::new(false),
            done: Mutex::default(),
        };
        let ended: Vec<_> = std::thread::scope(|scope| {
            let workers = [(); WORKERS].map(|()| scope.spawn(|| shared.work()));
            workers.into_iter().map(|worker| worker.join()).collect()
        });
        for worker in ended {
            match worker {
                Ok(result) => result?,
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        Ok(shared.report())
    }
}

impl Shared {
    /// The next seed; `None` when it is over.
    fn next(&self) -> Option<u64> {
        let given = self.given.fetch_add(1, Ordering::Relaxed);
        let seed = self.many.from.checked_add(given);
        let seed = seed.filter(|seed| *seed <= self.many.last)?;
        let late = self.many.time.is_some_and(|t| self.begun.elapsed() >= t);
        let over = (late && given > 0) || self.stop.load(Ordering::Relaxed);
        (!over).then_some(seed)
    }

    fn work(&self) -> Result<(), NoSuchUnit> {
        while let Some(seed) = self.next() {
            let setup = drawn(self.many.gyroscope)(seed);
            let outcome = campaign::run(setup, &self.pool, |_| {})?;
            self.take(outcome);
        }
        Ok(())
    }

    fn take(&self, outcome: Outcome) {
        // A worker that panicked ends the program anyway.
        let mut done = self.done.lock().unwrap_or_else(|e| e.into_inner());
        let (summary, failed) = &mut *done;
        summary.add(&outcome);
        if !outcome.passed() {
            self.stop.fetch_or(!self.many.keep_going, Ordering::Relaxed);
            failed.push(outcome);
        }
        let (trials, virtual_s) = (summary.trials, summary.virtual_s);
        if trials % 100 == 0 {
            let real_s = self.begun.elapsed().as_secs_f64().max(1e-3);
            let times = virtual_s / real_s;
            let failed = failed.len();
            eprintln!(
                "{trials} trials in {real_s:.0} s, {times:.0} times real time, {failed} failed"
            );
        }
    }

    /// Prints all; true when none failed.
    fn report(self) -> bool {
        let (summary, mut failed) = self.done.into_inner().unwrap_or_else(|e| e.into_inner());
        failed.sort_by_key(|outcome| outcome.setup.seed);
        print!("{summary}");
        for outcome in &failed {
            println!("failed: {}", outcome.replay());
        }
        if let Some(first) = failed.first() {
            println!();
            print!("{first}");
        }
        failed.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_seed_was_counted_past_the_largest_number() {
        assert_eq!(last(1, 7).ok(), Some(7));
        assert_eq!(last(2, u64::MAX - 1).ok(), Some(u64::MAX));
        assert_eq!(last(u64::MAX, 1).ok(), Some(u64::MAX));
        let said = last(3, u64::MAX - 1).unwrap_err().to_string();
        assert!(said.contains("from 18446744073709551614 on"), "{said}");
    }

    #[test]
    fn a_campaign_of_nothing_had_passed() {
        assert!(last(0, 1).unwrap_err().to_string().contains("at least 1"));
        for minutes in [0.0, -1.0, f64::NAN, f64::INFINITY, 100_001.0] {
            assert!(matches!(time(minutes), Err(Problem::Minutes)), "{minutes}");
        }
        assert_eq!(time(0.5).ok(), Some(Duration::from_secs(30)));
    }
}
