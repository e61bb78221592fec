//! A page of tables: what two channels with a gyroscope report of each fault.
//!
//! In: the runs of each line, the hours without a fault in each scene, and a text that the names of
//! lines contain, of which no others are run then. Out: the page, on standard output; the seeds of
//! runs in which the healthy channel was named, on standard error. Everything counts as a receiver
//! on the bus sees it; see `sim::trial`.
//!
//! Left out: faults that the product has as well (`faults`).

use sim::bench::Mode;
use sim::excavator::{ExcavatorSetup, Scene};
use sim::fault::{RateFault, SensorFault};
use sim::rng::Rng;
use sim::trial::checks::detection::Blame;
use sim::trial::checks::{Rule, Violation};
use sim::trial::inject::{Injection, What};
use sim::trial::pool::Pool;
use sim::trial::{self, Setup};

#[path = "faults/spread.rs"]
mod spread;
use spread::spread;

/// Units that the runs are drawn from.
const UNITS: u32 = 4;

/// A fault is watched for so long, s.
const WATCHED_S: f64 = 40.0;

/// Seconds of a run without a fault.
const HEALTHY_S: f64 = 360.0;

/// Temperatures of the runs without a fault, degC: those of the calibration.
const HEALTHY_C: (f64, f64) = (-10.0, 70.0);

const fn scene(scene: Scene) -> ExcavatorSetup {
    ExcavatorSetup {
        scene,
        ..ExcavatorSetup::NOMINAL
    }
}

const SCENES: [(ExcavatorSetup, &str); 4] = [
    (scene(Scene::Digging), "digging"),
    (ExcavatorSetup::SLEWING, "digging and slewing"),
    (scene(Scene::StopAndGo), "stop and go"),
    (scene(Scene::Standstill), "standstill"),
];

/// Where faults begin: the scene, its name, and the temperature, degC.
fn places() -> Vec<(ExcavatorSetup, String, f64)> {
    let mild = SCENES.map(|(machine, called)| (machine, called.to_owned(), 25.0));
    let [(digging, called), ..] = SCENES;
    let hot = (digging, format!("{called}, 70 degC"), 70.0);
    mild.into_iter().chain([hot]).collect()
}

fn bias(dps: f64) -> Vec<SensorFault> {
    let axes = (0..3).flat_map(|axis| [(axis, dps), (axis, -dps)]);
    axes.map(|(axis, dps)| SensorFault::Gyroscope(RateFault::Bias { axis, dps }))
        .collect()
}

/// The lines: a name, and the faults that are drawn from.
fn lines() -> Vec<(&'static str, Vec<SensorFault>)> {
    let gyroscope = |fault| vec![SensorFault::Gyroscope(fault)];
    let step = (0..3).flat_map(|axis| [10.0, -10.0].map(|mg| SensorFault::Bias { axis, mg }));
    vec![
        ("codes of the gyroscope stuck", gyroscope(RateFault::Stuck)),
        (
            "noise of the gyroscope x 10",
            gyroscope(RateFault::Noise { factor: 10.0 }),
        ),
        ("bias of the gyroscope 0.5 deg/s", bias(0.5)),
        ("bias of the gyroscope 2 deg/s", bias(2.0)),
        (
            "scale of the gyroscope 5 %",
            [0.05, -0.05]
                .map(|ratio| SensorFault::Gyroscope(RateFault::Scale { ratio }))
                .to_vec(),
        ),
        (
            "axes of the gyroscope swapped",
            gyroscope(RateFault::SwappedAxes),
        ),
        ("bias of the accelerometer 10 mg", step.collect()),
    ]
}

fn setup(machine: &ExcavatorSetup, seed: u64) -> Setup {
    Setup {
        mode: Mode::Dynamic,
        unit: (seed % u64::from(UNITS)) as u32,
        power_cycles: (seed % 5) as u32,
        machine: *machine,
        ..Setup::healthy(seed)
    }
}

/// What came of one run.
struct Run {
    told_s: Option<f64>,
    /// When the right channel was named.
    right_s: Option<f64>,
    wrong: bool,
    /// Something was reported before the fault began.
    early: bool,
}

impl Run {
    fn of(
        (machine, start_c): (&ExcavatorSetup, f64),
        fault: SensorFault,
        seed: u64,
        pool: &Pool,
    ) -> Self {
        let mut rng = Rng::stream(seed, "gyroscope fault");
        let from_s = rng.range(20.0, 30.0);
        let setup = Setup {
            faults: vec![Injection {
                what: What::Sensor(fault),
                channel: (seed % 2) as usize,
                from_s,
                until_s: from_s + WATCHED_S,
            }],
            start_c,
            ..setup(machine, seed)
        };
        let report = trial::run(&setup, pool, |_| {}).expect("a unit of the pool");
        let detection = &report.detections[0];
        let named = detection.by.iter().filter_map(|found| found.named);
        let named_s = named.map(|(after_s, _)| after_s).reduce(f64::min);
        let early = |v: &Violation| v.at_s < from_s && !is_of_angles(v);
        Self {
            told_s: detection.told_s(),
            right_s: named_s.filter(|_| detection.blame() == Blame::Right),
            wrong: detection.blame() == Blame::Wrong,
            early: report.violations.iter().any(early),
        }
    }
}

/// What came of the runs of one line in one scene.
struct Row {
    runs: usize,
    told_s: Vec<f64>,
    right_s: Vec<f64>,
    wrong: usize,
    early: usize,
}

impl Row {
    fn of(runs: &[Run]) -> Self {
        Self {
            runs: runs.len(),
            told_s: runs.iter().filter_map(|run| run.told_s).collect(),
            right_s: runs.iter().filter_map(|run| run.right_s).collect(),
            wrong: runs.iter().filter(|run| run.wrong).count(),
            early: runs.iter().filter(|run| run.early).count(),
        }
    }

    fn print(&mut self, name: &str, scene: &str) {
        for times in [&mut self.told_s, &mut self.right_s] {
            times.sort_by(f64::total_cmp);
        }
        let share = |count: usize| 100.0 * count as f64 / self.runs as f64;
        println!(
            "| {name} | {scene} | {} | {:.1} % | {} | {} | {:.1} % | {} | {} |",
            self.runs,
            share(self.told_s.len()),
            at(&self.told_s, 0.5, 3),
            at(&self.told_s, 0.95, 3),
            share(self.right_s.len()),
            at(&self.right_s, 0.5, 1),
            self.wrong
        );
    }
}

/// A quantile of sorted times, s.
fn at(sorted: &[f64], share: f64, digits: usize) -> String {
    let place = ((sorted.len() as f64 * share) as usize).min(sorted.len().saturating_sub(1));
    let time = sorted.get(place);
    time.map_or_else(|| "-".to_owned(), |s| format!("{s:.digits$}"))
}

/// What came of so many hours without a fault: the hours, how often somebody was accused, and how
/// often an angle was off by more than 0.6 deg for longer than the reaction time.
fn healthy(machine: &ExcavatorSetup, hours: u32, pool: &Pool) -> (f64, usize, usize) {
    let runs = (f64::from(hours) * 3600.0 / HEALTHY_S).ceil() as usize;
    let found = spread(runs, |seed| {
        let seed = 1_000_000 + seed as u64;
        let (coldest_c, hottest_c) = HEALTHY_C;
        let setup = Setup {
            safety_s: HEALTHY_S,
            start_c: Rng::stream(seed, "temperature").range(coldest_c, hottest_c),
            ..setup(machine, seed)
        };
        let report = trial::run(&setup, pool, |_| {}).expect("a unit of the pool");
        let (angles, alarms): (Vec<_>, Vec<_>) =
            report.violations.iter().partition(|v| is_of_angles(v));
        for violation in &alarms {
            eprintln!("{machine}, seed {seed}: {violation}");
        }
        (alarms.len(), angles.len())
    });
    let alarms = found.iter().map(|(alarms, _)| alarms).sum();
    let angles = found.iter().map(|(_, angles)| angles).sum();
    (runs as f64 * HEALTHY_S / 3600.0, alarms, angles)
}

fn is_of_angles(violation: &Violation) -> bool {
    matches!(violation.rule, Rule::WrongAngle | Rule::OldAngle)
}

fn head(runs: usize, hours: u32) -> String {
    format!(
        "\
# Faults of the variant with a gyroscope

For those who judge the redundancy of the variant with a gyroscope: how soon two channels report a
fault of a gyroscope or of an accelerometer, and which channel they name. Everything on this page is
simulated and printed by
`cargo run --release -p sim --example gyroscope_faults -- {runs} {hours}`; the first number is that
of the runs of each line, the second one the hours without a fault.
Calibrated units, 250 kbit/s, 50 SYNCs a second, the sensor 1 m from the boom's pivot; a cab that
slews does so by 60 to 120 deg. The fault begins after 20 to 30 s, at 25 degC unless another
temperature is stated, and stays for 40 s; axis, sign, channel, unit and moment are drawn. Only what
is reported on the bus counts.

*Reported* is the first word of either channel: from then on neither angle is valid unless a channel
is named. *Right* are the runs in which the faulty channel was named and the healthy one was not;
*wrong* those in which the healthy one was named at any time. A gyroscope with an error of scale is
in order while nothing turns, and so is one with swapped axes.

| fault | scene | runs | reported | median, s | 95 %, s | right | median, s | wrong |
|---|---|---|---|---|---|---|---|---|"
    )
}

const HEALTHY: &str = "
Without a fault, from -10 to 70 degC. An *alarm* is any accusation of a channel, any EMCY without a
cause and any other rule of a trial that is broken, for example by angles that are still not valid
12 s after a start in motion; standard error names it. The last column counts the readings of a
valid angle that was off by more than 0.6 deg for longer than the reaction time. They come from
starts while the machine moves: an estimator that begins in motion states its uncertainty (2022h),
and it is larger than 0.6 deg until the machine has paused.

| scene | hours | alarms | readings off by more than 0.6 deg |
|---|---|---|---|";

fn main() {
    let mut words = std::env::args().skip(1);
    let mut number = || words.next().and_then(|word| word.parse().ok());
    let (Some(runs), Some(hours)) = (number(), number()) else {
        eprintln!("gyroscope_faults RUNS HOURS [LINE]");
        std::process::exit(2);
    };
    let (runs, wanted) = (runs as usize, words.next().unwrap_or_default());
    let units: Vec<_> = (0..UNITS).map(|unit| (Mode::Dynamic, unit)).collect();
    let pool = Pool::of(&units).expect("sound units");
    println!("{}", head(runs, hours));
    for (name, faults) in lines() {
        for (machine, called, start_c) in places() {
            if runs == 0 || !format!("{name}, {called}").contains(&wanted) {
                continue;
            }
            let found = spread(runs, |seed| {
                let fault = faults[(seed / 2) % faults.len()];
                Run::of((&machine, start_c), fault, seed as u64, &pool)
            });
            for (seed, _) in found.iter().enumerate().filter(|(_, run)| run.wrong) {
                eprintln!("{name}, {called}: seed {seed} names the healthy channel");
            }
            let mut row = Row::of(&found);
            row.print(name, &called);
            if row.early > 0 {
                eprintln!(
                    "{name}, {called}: {} violations before the fault",
                    row.early
                );
            }
        }
    }
    println!("{HEALTHY}");
    for (machine, called) in SCENES {
        if hours == 0 || !format!("no fault, {called}").contains(&wanted) {
            continue;
        }
        let (hours, alarms, angles) = healthy(&machine, hours, &pool);
        println!("| {called} | {hours:.0} | {alarms} | {angles} |");
    }
}
