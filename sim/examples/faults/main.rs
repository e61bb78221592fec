//! Prints `docs/faults.md`: what the pair makes of each fault, and of none.
//!
//! In: nothing, or `--long`. Out: the section that every run of the tests repeats; with `--long`
//! the whole page, which takes a quarter of an hour. Progress goes to the standard error output.
//!
//! Run by `cargo xtask faults`, which compares the short section with the committed page, and its
//! fingerprint with the one that the rest of the page carries. Runs are spread over two threads;
//! each world is a thread of its own, so the figures depend on the seeds alone.

mod observer;
mod plan;
mod spread;
mod tables;
mod world;

use std::fmt::Write as _;

use sim::bench::{BenchError, Mode};

use observer::Outcome;
use plan::{Counts, KINDS, Kind, PROMISED, SCENES, STEP};
use spread::spread;
use tables::{Cell, Healthy};
use world::{Case, Units, run};

fn main() -> Result<(), BenchError> {
    let long = std::env::args().any(|word| word == "--long");
    let short = Everything::run(&Counts::SHORT)?;
    let mut page = String::new();
    if long {
        let everything = Everything::run(&Counts::LONG)?;
        whole(&mut page, &everything, short.fingerprint());
    }
    repeated(&mut page, &short);
    print!("{page}");
    Ok(())
}

/// All runs of one set of counts.
struct Everything {
    counts: Counts,
    promises: Vec<(&'static Kind, Vec<Outcome>)>,
    /// Scene by scene, fault by fault.
    cells: Vec<Vec<Cell>>,
    healthy: Vec<Healthy>,
}

impl Everything {
    fn run(counts: &Counts) -> Result<Self, BenchError> {
        let units = Units::commission(counts.units)?;
        eprintln!("{} units of each mode calibrated", units.count());
        Ok(Self {
            counts: *counts,
            promises: promises(counts, &units),
            cells: cells(counts, &units),
            healthy: healthy(counts, &units),
        })
    }

    /// Of every bus of every run, in their order.
    fn fingerprint(&self) -> u64 {
        let promises = self.promises.iter().map(|(_, outcomes)| outcomes);
        let cells = self.cells.iter().flatten();
        let cells = cells.flat_map(|cell| [&cell.product, &cell.paper]);
        let healthy = self.healthy.iter().flat_map(|h| [&h.product, &h.paper]);
        let all = promises.chain(cells).chain(healthy).flatten();
        // The constants are those of FNV-1a, a word at a time.
        all.fold(0xCBF2_9CE4_8422_2325, |hash: u64, outcome| {
            (hash ^ outcome.fingerprint).wrapping_mul(0x100_0000_01B3)
        })
    }
}

/// Runs all cases; outcomes in their order.
fn all(cases: &[Case], units: &Units) -> Vec<Outcome> {
    spread(cases.len(), |number| run(&cases[number], units))
}

/// Runs groups of cases together, so that both threads have work up to the end.
fn grouped(groups: &[Vec<Case>], units: &Units) -> Vec<Vec<Outcome>> {
    let mut outcomes = all(&groups.concat(), units).into_iter();
    let sizes = groups.iter().map(Vec::len);
    sizes
        .map(|size| outcomes.by_ref().take(size).collect())
        .collect()
}

fn promises(counts: &Counts, units: &Units) -> Vec<(&'static Kind, Vec<Outcome>)> {
    let names = PROMISED.into_iter().chain([STEP]);
    let kinds: Vec<&Kind> = names.filter_map(plan::kind).collect();
    let cases = |kind: &&Kind| -> Vec<Case> {
        let case = |number| plan::promised(kind, number, counts.units);
        (0..counts.promise).map(case).collect()
    };
    let groups: Vec<Vec<Case>> = kinds.iter().map(cases).collect();
    let outcomes = grouped(&groups, units);
    eprintln!("promises: done");
    kinds.into_iter().zip(outcomes).collect()
}

fn cells(counts: &Counts, units: &Units) -> Vec<Vec<Cell>> {
    let kinds: Vec<Option<&'static Kind>> =
        [None].into_iter().chain(KINDS.iter().map(Some)).collect();
    let mut scenes = Vec::new();
    for (scene, name) in SCENES {
        let product = |kind: &Option<&'static Kind>| -> Vec<Case> {
            let case = |number| plan::case("table", scene, *kind, number, counts.units);
            (0..counts.cell).map(case).collect()
        };
        let paper = |kind: &Option<&'static Kind>| -> Vec<Case> {
            let fits = counts.paper && kind.is_none_or(|kind| kind.in_paper);
            let cases = if fits { product(kind) } else { Vec::new() };
            cases.into_iter().map(plan::in_paper_mode).collect()
        };
        let groups: Vec<Vec<Case>> = kinds
            .iter()
            .flat_map(|kind| [product(kind), paper(kind)])
            .collect();
        let mut outcomes = grouped(&groups, units).into_iter();
        let mut next = || outcomes.next().unwrap_or_default();
        let cell = |kind: &Option<&'static Kind>| Cell {
            kind: *kind,
            product: next(),
            paper: next(),
        };
        scenes.push(kinds.iter().map(cell).collect());
        eprintln!("{name}: done");
    }
    scenes
}

fn healthy(counts: &Counts, units: &Units) -> Vec<Healthy> {
    let mut scenes = Vec::new();
    for (scene, name) in SCENES {
        let worlds = |mode, count: usize| -> Vec<Case> {
            let case = |number| plan::healthy(mode, scene, number, counts);
            (0..count).map(case).collect()
        };
        let groups = [
            worlds(Mode::Product, counts.worlds),
            worlds(Mode::Paper, counts.paper_worlds),
        ];
        let mut outcomes = grouped(&groups, units).into_iter();
        scenes.push(Healthy {
            scene: name,
            product: outcomes.next().unwrap_or_default(),
            paper: outcomes.next().unwrap_or_default(),
        });
        eprintln!("{name} without faults: done");
    }
    scenes
}

const HEAD: &str = "# Faults

For those who judge the redundancy: how soon two channels detect each fault, which channel they
name, and how often they raise a false alarm. Everything on this page is simulated and printed by
`cargo xtask faults --write --long`: calibrated instruments with the errors of the nominal model on
a virtual CAN bus at 250 kbit/s with 50 SYNCs a second, on an excavator with the sensor 1 m from the
boom's pivot. Only what is reported on the bus counts.

Three ways to monitor the same pair:

- **product**, the instrument as delivered. A fault is *detected* when a channel shows state 6 to 9
  in 2021h, or when neither channel sends a frame for 0.1 s. State 7 or 8 names a channel.
- **plain**, what a controller could do by itself: compare the two measured angles of each SYNC, as
  the product's nodes exchange them (TPDO 3), with 0.40 deg. It names no channel.
- **paper**, the instrument as the paper built it: its sampling, its tables, and its rule on the
  pitch, which is all that its excavator monitors. Each difference above 0.40 deg, and each reading
  that is missing, is a *warning*; more than 110 warnings in ten minutes ask for a *stop* of 45 s.
  It reports after the stop whether there was a fault, 10 min 45 s after the beginning at worst. It
  names no channel either.

";

const HOW_TO_READ: &str = "\
Product and plain are run for 10 s after the fault's beginning (drift of 0.2 mg/s: 60 s). Delays
are those of the runs in which the fault was detected. *Right* and *wrong* are runs in which the
faulty or the healthy channel was named, at any time; *unknown* those in which neither was.

Paper mode is run for 20 s, which is enough for 110 warnings but not for its verdict. Its single
warnings are counted separately: how many there are in a second of 50 comparisons, in the last 5 s
before the fault and in the first 5 s after its beginning. Where both are alike, a warning does not
indicate the fault. The machine ignores each request to stop, so that the warnings are those of the
scene. *Stopped before* are the runs in which 110 of them had been reached while
the instrument was healthy; *stop* is the share of the others in which it was reached afterwards.

With faults marked (bus) frames are late or missing, for which either side may be the cause: a
channel that is cut off may report the other one as silent, and \"wrong\" counts that. While the bus
is dead nothing can be reported, and a receiver has its own timer only.

A bias or a gain acts on one axis of the part. A gain has no effect on an axis without acceleration,
so the fault exists only in the runs whose pose shows it; z measures at least half of gravity in
every pose of the arm. The wrong channel can only be named while the machine stands, and only where
the length of gravity shows the error, which it does not for an axis that lies level. Paper mode's
tables have no matrix to corrupt.

";

fn whole(page: &mut String, all: &Everything, fingerprint: u64) {
    let counts = &all.counts;
    page.push_str(HEAD);
    let _ = writeln!(
        page,
        "This part of the page was made with the code whose short runs have the fingerprint \
         `{fingerprint:016x}`; the last section explains its use.\n"
    );
    page.push_str("## What is promised\n\n");
    let _ = writeln!(
        page,
        "{} runs of each fault in product mode, a third of them in each scene. *Within 0.1 s* \
         counts the runs in which the right channel was named on the bus within 0.1 s after the \
         fault's beginning; *wrong* those in which the healthy one was named at any time. A \
         promise is kept when the first is all of them and the second none. \"Silent\" is a \
         channel without power, \"halted\" one whose code stands still.\n",
        counts.promise
    );
    tables::promises(page, &all.promises);
    faults(page, all);
    page.push_str("## Compared with the study\n\n");
    page.push_str(
        "The study that came before this instrument ran its tests on two streams of samples; here \
         the same faults go through two nodes and a bus, and the delays are those of the frame \
         that reports them. The scene is stop-and-go. This instrument is at least as good where \
         more or as many faults are detected, the median delay is no longer, and as many are \
         isolated. \"At once\" is taken as 0.1 s. The wait for the next SYNC alone is 10 ms in \
         the mean. The study does not state which axis lost its gain: drawn among the three, two \
         of them measure little or no acceleration in many poses; z always does.\n\n",
    );
    tables::beside_the_study(page, &all.cells[1]);
    page.push_str("## False alarms\n\n");
    let _ = writeln!(
        page,
        "Healthy instruments of {} units, worlds of {:.0} minutes; half of them at 25 degC, the \
         others with a steady change between two temperatures from 0 to 50 degC. A false alarm is \
         a reported fault (state 6 to 9); one that stays until a reset is counted once. Excesses \
         of the plain difference that are less than a second apart are one. In paper mode the \
         machine stops when requested, and a world ends with a physical fault, which only a reset \
         clears.\n",
        counts.units,
        counts.world_s / 60.0
    );
    tables::false_alarms(page, &all.healthy);
}

fn faults(page: &mut String, all: &Everything) {
    let _ = writeln!(
        page,
        "## Fault by fault\n\n{} runs of each line: one of {} units, channel, axis, sign and \
         moment drawn; the fault begins after 8 to 15 s of healthy work, and stays. The line \
         \"none\" is a healthy instrument observed for as long: its entries are chance.\n",
        all.counts.cell, all.counts.units
    );
    page.push_str(HOW_TO_READ);
    tables::named_before(page, &all.cells);
    for ((_, name), cells) in SCENES.iter().zip(&all.cells) {
        tables::scene(page, name, cells, all.counts.paper);
    }
}

fn repeated(page: &mut String, all: &Everything) {
    let counts = &all.counts;
    page.push_str("## What every run of the tests repeats\n\n");
    let _ = writeln!(
        page,
        "`cargo xtask test` runs this section and compares it. The fingerprint is that of every \
         bus of every run below: when it has changed, the instrument or its world behaves \
         differently, and the sections above are out of date until they are generated again.\n\n\
         Fingerprint `{:016x}`.\n",
        all.fingerprint()
    );
    let _ = writeln!(
        page,
        "{} units; the columns are those of the tables above, all scenes together.\n",
        counts.units
    );
    tables::repeated(page, &all.cells, counts);
    tables::promises(page, &all.promises);
    tables::false_alarms(page, &all.healthy);
}
