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
use sim::bench::BenchError;
use sim::campaign::{self, Outcome, Summary};
use sim::can_bus::Event;
use sim::trial::pool::Pool;
use sim::trial::{NoSuchUnit, Seen};

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
    },
    /// Run seed after seed for a time, up to the first that fails
    Campaign {
        /// How long, minutes
        #[arg(long)]
        minutes: f64,
        /// The first seed
        #[arg(long, default_value_t = 1)]
        from: u64,
        /// Go on after a failure, and list all that fail
        #[arg(long)]
        keep_going: bool,
    },
    /// Run so many seeds, one after the other
    Fixed {
        /// How many
        #[arg(long)]
        seeds: u64,
        /// The first seed
        #[arg(long, default_value_t = 1)]
        from: u64,
        /// Go on after a failure, and list all that fail
        #[arg(long)]
        keep_going: bool,
    },
    /// Run a device that is broken on purpose: it must be found out
    Canary,
}

/// Why a command could not be carried out.
#[derive(Debug)]
enum Problem {
    Bench(BenchError),
    Unit(NoSuchUnit),
    Minutes,
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
            Self::Minutes => f.write_str("--minutes must be a number from 0 to 100000"),
        }
    }
}

fn main() -> ExitCode {
    let ended = match CommandLine::parse().verb {
        Verb::Seed { seed, trace } => one(seed, trace),
        Verb::Campaign {
            minutes,
            from,
            keep_going,
        } => for_a_time(minutes, from, keep_going),
        Verb::Fixed {
            seeds,
            from,
            keep_going,
        } => Many {
            from,
            count: seeds,
            time: None,
            keep_going,
        }
        .run(),
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

fn one(seed: u64, trace: bool) -> Result<bool, Problem> {
    let setup = campaign::draw(seed);
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
            let truth = seen.truth.map_or([f64::NAN; 2], |slopes| slopes.ideal_deg);
            let [x, y] = truth;
            writeln!(out, "{at_s:.6} {name} {message:?}, truth {x:.2} {y:.2} deg")
        }
        (None, Event::Error { .. } | Event::Changed { .. }) => {
            writeln!(out, "{at_s:.6} {:?}", seen.event)
        }
        _ => Ok(()),
    };
}

fn canary() -> Result<bool, Problem> {
    let (trials, caught) = campaign::canary(&campaign::pool()?)?;
    match &caught {
        Some(outcome) => {
            print!("{outcome}");
            println!("the device broken on purpose was found out in trial {trials}");
        }
        None => println!("the device broken on purpose passed {trials} trials"),
    }
    Ok(caught.is_some())
}

fn for_a_time(minutes: f64, from: u64, keep_going: bool) -> Result<bool, Problem> {
    if !(0.0..=1e5).contains(&minutes) {
        return Err(Problem::Minutes);
    }
    let many = Many {
        from,
        count: u64::MAX - from,
        time: Some(Duration::from_secs_f64(minutes * 60.0)),
        keep_going,
    };
    many.run()
}

/// Many trials.
struct Many {
    from: u64,
    count: u64,
    /// No trial begins later than this after the start.
    time: Option<Duration>,
    keep_going: bool,
}

/// What the workers share.
struct Shared {
    many: Many,
    pool: Pool,
    begun: Instant,
    next: AtomicU64,
    stop: AtomicBool,
    /// Trials so far, and those that failed.
    done: Mutex<(Summary, Vec<Outcome>)>,
}

impl Many {
    fn run(self) -> Result<bool, Problem> {
        eprintln!("calibrating the instruments");
        let pool = campaign::pool()?;
        let shared = Shared {
            next: AtomicU64::new(self.from),
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
    fn over(&self, seed: u64) -> bool {
        let late = self.many.time.is_some_and(|t| self.begun.elapsed() >= t);
        late || seed - self.many.from >= self.many.count || self.stop.load(Ordering::Relaxed)
    }

    fn work(&self) -> Result<(), NoSuchUnit> {
        loop {
            let seed = self.next.fetch_add(1, Ordering::Relaxed);
            if self.over(seed) {
                return Ok(());
            }
            let outcome = campaign::run(campaign::draw(seed), &self.pool, |_| {})?;
            self.take(outcome);
        }
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
        for outcome in failed.iter().skip(1) {
            println!("failed: {}", outcome.replay());
        }
        if let Some(first) = failed.first() {
            println!();
            print!("{first}");
        }
        failed.is_empty()
    }
}
