//! Prints the section of `docs/accuracy.md` on the uncertainty that readings come with.
//!
//! Run by `cargo xtask accuracy` behind the example `accuracy` of `sim`. Each unit is put through
//! the chamber, calibrated by hand, by a motor and by the tables of 2060h, all with the code that
//! `plumb calibrate` and the nodes run; then it is read over temperature, and one and the same
//! filtered acceleration goes through every calibration. The units are spread over two threads,
//! each a world of its own.

use std::fmt::Write as _;

use calibrate::fits::fit::{self, Stand};
use calibrate::fits::hand::{self, POSES, Taken};
use calibrate::fits::{Axis, Reading};
use device::calibration::motor::{Command, MOTOR, Motor, StandReading, TableSettings};
use sim::bench::characterise::{Mean, mean_of_both};
use sim::bench::person::Person;
use sim::bench::statistics::{Tally, median};
use sim::bench::{Bench, BenchError, Mode, World, run};
use sim::rig::{Fixture, Mount};
use sim::rng::Rng;
use tilt::chain::{Calibration, Chain};
use tilt::filter::Filtered;
use tilt::sample::Temperature;
use tilt::table::Rule;

const SEED: u64 = 1;
const UNITS: u32 = 100;

/// Down to the cold end, up to the hot end and back, as the thermal test: every temperature is met
/// on both branches of the hysteresis.
const PATH_C: [f64; 9] = [0.0, -10.0, 10.0, 30.0, 50.0, 70.0, 50.0, 30.0, 10.0];

/// Poses at each of them, anywhere in the upper half, and of each slope with the other one level.
const POSES_EACH: usize = 4;

/// Degrees between two stands of the motor.
const STEP_DEG: usize = 5;

/// Without and with the model of the chamber.
const MODELS: [&str; 2] = ["none", "chamber"];

/// The last one is the one before, read with one slope level, as its tables were made.
const NAMES: [&str; 5] = [
    "none, as soldered",
    "by hand, 13 poses",
    "by motor",
    "by 2060h, every 5 deg",
    "the same, one slope level",
];

/// What one row of one channel came to.
#[derive(Clone, Copy, Default)]
struct Seen {
    error: Tally,
    uncertainty: Tally,
    within: u64,
}

/// By name and by model.
type Rows<T> = [[T; MODELS.len()]; NAMES.len()];

/// Calibrations of both nodes, by model.
type Both = [[Calibration; MODELS.len()]; 2];

fn main() -> Result<(), BenchError> {
    let halves = std::thread::scope(|scope| {
        let halves = [0, 1].map(|first| scope.spawn(move || every_other(first)));
        halves.map(|half| half.join().expect("a world without panics"))
    });
    let mut channels = Vec::new();
    for half in halves {
        channels.extend(half?);
    }
    print!("{}", section(&channels));
    Ok(())
}

fn every_other(first: u32) -> Result<Vec<Rows<Seen>>, BenchError> {
    let mut channels = Vec::new();
    for unit in (first..UNITS).step_by(2) {
        channels.extend(study(unit)?);
    }
    Ok(channels)
}

/// Both channels of one unit.
fn study(unit: u32) -> Result<[Rows<Seen>; 2], BenchError> {
    let mut bench = Bench::new(Mode::Product, &World::NOMINAL, SEED, unit);
    let bare = bench.instrument.sides[0].settings.chain.clone();
    bench.characterise()?;
    let before: Both = [0, 1].map(|node| {
        let with = &bench.instrument.sides[node].settings.chain.calibration;
        [bare.calibration.clone(), with.clone()]
    });
    for side in &mut bench.instrument.sides {
        side.settings.chain = bare.clone();
    }
    bench.power_cycle();
    let by_hand = by_hand(&mut bench, &before, unit)?;
    bench.power_cycle();
    let (by_motor, tables) = by_motor(&mut bench, &bare, &before)?;
    bench.power_cycle();
    let chains = [0, 1].map(|node| {
        [&before, &by_hand, &by_motor, &tables, &tables]
            .map(|both| both[node].each_ref().map(|c| with(&bare, c)))
    });
    Ok(over_temperature(&mut bench, &chains))
}

fn with(bare: &Chain, calibration: &Calibration) -> Chain {
    Chain {
        calibration: calibration.clone(),
        ..bare.clone()
    }
}

/// A mean as a node tells it over the bus, with its temperature to a degree.
fn reading(mean: &Mean) -> Reading {
    Reading {
        accel: mean.accel,
        scatter_mg: 0.0,
        temperature_c: f64::from(mean.temperature.celsius()),
        angle_deg: [Ok(0.0); 2],
        rate_rad_s: None,
    }
}

fn by_hand(bench: &mut Bench, before: &Both, unit: u32) -> Result<Both, BenchError> {
    let mut draw = Rng::stream(u64::from(unit), "surface");
    let surface_deg = [draw.range(-0.5, 0.5), draw.range(-0.5, 0.5)];
    let mut person = Person::new(surface_deg, 5.0, 2.0, u64::from(unit));
    let mut readings = Vec::new();
    for pose in POSES.iter().take(hand::FEWEST.into()) {
        let up = person.put(pose.up, pose.words.contains("turned"));
        let fixture = &mut Fixture::facing(up);
        let means = mean_of_both(&mut bench.instrument, fixture, 0.5, 1.2, "by hand")?;
        readings.push(means.each_ref().map(reading));
    }
    let mut both = before.clone();
    for model in 0..MODELS.len() {
        let taken = |node: usize| {
            let temperature = &before[node][model].temperature;
            let one = |(pose, both): (usize, &[Reading; 2])| {
                let t = fit::temperature(both[node].temperature_c);
                let mean_g = fit::compensated_g(temperature, both[node].accel, t);
                Taken { pose, mean_g }
            };
            readings.iter().enumerate().map(one).collect()
        };
        let channels = [('A', taken(0)), ('B', taken(1))];
        let fits = hand::fit(&channels, hand::FEWEST.into());
        let (fits, faces) = fits.expect("a set of poses that is accepted");
        for (node, fit) in fits.iter().enumerate() {
            let told = readings.iter().map(|both| both[node].temperature_c);
            let before = &before[node][model];
            both[node][model] = fit.calibration(before, told.map(fit::temperature), &faces);
        }
    }
    Ok(both)
}

/// A node under 2060h.
struct Memorising {
    motor: Motor,
    chain: Chain,
}

impl Memorising {
    const TABLE_SETTINGS: TableSettings = TableSettings {
        rule: Rule::Linear,
        reference: MOTOR,
    };

    fn command(&mut self, command: Command) {
        let calibration = &mut self.chain.calibration;
        let done = self
            .motor
            .command(command, &Self::TABLE_SETTINGS, calibration);
        done.expect("a run in its order");
    }

    fn memorise(&mut self, deg: i32, sight: &StandReading) {
        let taken = self.motor.memorise(deg * 1000, &self.chain, sight);
        taken.expect("a channel that measures");
    }

    fn finished(mut self) -> Calibration {
        self.command(Command::Finish);
        self.chain.calibration
    }
}

/// Both ways over each slope: for the fit on the host, and on the way up for the nodes' tables.
fn by_motor(bench: &mut Bench, bare: &Chain, before: &Both) -> Result<(Both, Both), BenchError> {
    let mut stands = Vec::new();
    let mut nodes = before.each_ref().map(|both| {
        both.each_ref().map(|before| Memorising {
            motor: Motor::new(),
            chain: with(bare, before),
        })
    });
    for (mount, axis, command) in [
        (Mount::X, Axis::X, Command::StartX),
        (Mount::Y, Axis::Y, Command::StartY),
    ] {
        bench.mount(mount, 0.0, 0.0);
        let each = nodes.as_flattened_mut().iter_mut();
        each.for_each(|node| node.command(command));
        for deg in (-90..=90).step_by(STEP_DEG) {
            stands.push(stand(bench, axis, deg)?);
            for (node, both) in nodes.iter_mut().enumerate() {
                let sight = sight(bench, node);
                both.iter_mut().for_each(|node| node.memorise(deg, &sight));
            }
        }
        for deg in (-90..=90).rev().step_by(STEP_DEG) {
            stands.push(stand(bench, axis, deg)?);
        }
    }
    let fitted = [0, 1].map(|node| {
        before[node].each_ref().map(|before| {
            let fitted = fit::by_motor(before, node, &stands, MOTOR.degrees());
            fitted.expect("two slopes determine it").calibration
        })
    });
    Ok((fitted, nodes.map(|both| both.map(Memorising::finished))))
}

fn stand(bench: &mut Bench, axis: Axis, deg: i32) -> Result<Stand, BenchError> {
    bench.turn_to(f64::from(deg), 40.0, 0.4);
    let means = mean_of_both(&mut bench.instrument, &mut bench.rig, 0.0, 0.3, "by motor")?;
    Ok(Stand {
        axis,
        reference_deg: bench.rig.reference_deg(),
        readings: means.each_ref().map(reading).to_vec(),
    })
}

/// What a node sees when the motor's angle is written to it.
fn sight(bench: &Bench, node: usize) -> StandReading {
    let side = &bench.instrument.sides[node];
    let now = side.clock(bench.instrument.time_s());
    StandReading {
        filtered: side.node.channel.filtered().map(|(filtered, _)| filtered),
        temperature: side.node.channel.temperature(),
        reading: side.node.channel.reading(&side.settings, now),
    }
}

fn over_temperature(bench: &mut Bench, chains: &[Rows<Chain>; 2]) -> [Rows<Seen>; 2] {
    let mut seen = [Rows::<Seen>::default(); 2];
    for celsius in PATH_C {
        bench.bring_to(celsius);
        // The thermometer is smoothed over about a second.
        run(&mut bench.instrument, &mut Fixture::level(), 4.0);
        for _ in 0..POSES_EACH {
            let up = anywhere_above(&mut bench.rng);
            read(bench, chains, &mut seen, up, [true; 2]);
        }
        for slopes in [[true, false], [false, true]] {
            let [sin, cos] = a_slope(&mut bench.rng);
            let [x, y] = slopes.map(|turned| if turned { sin } else { 0.0 });
            read(bench, chains, &mut seen, [x, y, cos], slopes);
        }
    }
    seen
}

/// Puts the housing where `up` points up and takes what every calibration makes of these slopes:
/// both for all rows but the last, and one that was turned for that.
fn read(
    bench: &mut Bench,
    chains: &[Rows<Chain>; 2],
    seen: &mut [Rows<Seen>; 2],
    up: [f64; 3],
    slopes: [bool; 2],
) {
    run(&mut bench.instrument, &mut Fixture::facing(up), 0.6);
    let level = slopes != [true; 2];
    for ((side, seen), chains) in bench.instrument.sides.iter().zip(seen).zip(chains) {
        let channel = &side.node.channel;
        let (filtered, _) = channel.filtered().expect("samples");
        let t = channel.temperature().expect("a temperature");
        let rows = seen.iter_mut().zip(chains).enumerate();
        for (_, (seen, chains)) in rows.filter(|(row, _)| (*row == NAMES.len() - 1) == level) {
            for (seen, chain) in seen.iter_mut().zip(chains) {
                take(seen, chain, (filtered, t), up, slopes);
            }
        }
    }
}

/// Sine and cosine of a slope, -90 to 90 deg.
fn a_slope(rng: &mut Rng) -> [f64; 2] {
    let (sin, cos) = rng.range(-90.0, 90.0).to_radians().sin_cos();
    [sin, cos]
}

/// A direction of the upper half, each as likely as any other.
fn anywhere_above(rng: &mut Rng) -> [f64; 3] {
    loop {
        let up = [0; 3].map(|_| rng.range(-1.0, 1.0));
        let length = up.iter().map(|c| c * c).sum::<f64>().sqrt();
        if (0.1..1.0).contains(&length) && up[2] > 0.0 {
            return up.map(|c| c / length);
        }
    }
}

fn take(
    seen: &mut Seen,
    chain: &Chain,
    (filtered, t): (Filtered, Temperature),
    [x, y, _]: [f64; 3],
    slopes: [bool; 2],
) {
    let found = chain.evaluate(filtered, t);
    let both = [(found.x, x), (found.y, y)].into_iter().zip(slopes);
    for ((found, truth), _) in both.filter(|(_, wanted)| *wanted) {
        let found = found.expect("two slopes");
        let error_deg = found.angle.degrees() - truth.asin().to_degrees();
        let u_deg = found.unshared.combined_with(found.motion).degrees();
        seen.error.add(error_deg);
        seen.uncertainty.add(u_deg);
        seen.within += u64::from(error_deg.abs() <= 1.96 * u_deg);
    }
}

const HEAD: &str = "
## What the stated uncertainty covers

Readings in poses anywhere in the upper half, -10 to 70 degC on both branches of the hysteresis, of
100 units that were calibrated at 25 degC and switched off and on, with the code of `plumb
calibrate` and of the nodes; the model is that of the bench's chamber. At least 95 % of the errors
have to be within 1.96 standard uncertainties u. The ratio is that of uncertainty to rms error, of
the median channel: where the uncertainty is that of all parts of the kind, a channel is better or
worse than it.

| calibration | model | readings | rms error, deg | u, deg | ratio | within 1.96 u | kept |
|---|---|---|---|---|---|---|---|
";

fn section(channels: &[Rows<Seen>]) -> String {
    let mut page = String::from(HEAD);
    for (row, name) in NAMES.iter().enumerate() {
        for (model, which) in MODELS.iter().enumerate() {
            let all: Vec<_> = channels.iter().map(|channel| channel[row][model]).collect();
            let middle = |figure: fn(&Seen) -> f64| {
                let mut figures: Vec<_> = all.iter().map(figure).collect();
                median(&mut figures)
            };
            let rms = middle(|seen| seen.error.rms());
            let u = middle(|seen| seen.uncertainty.rms());
            let ratio = middle(|seen| seen.uncertainty.rms() / seen.error.rms());
            let count: u64 = all.iter().map(|seen| seen.error.count()).sum();
            let within: u64 = all.iter().map(|seen| seen.within).sum();
            let share = 100.0 * within as f64 / count as f64;
            let kept = if share >= 95.0 { "yes" } else { "NO" };
            let _ = writeln!(
                page,
                "| {name} | {which} | {count} | {rms:.3} | {u:.3} | {ratio:.2} | {share:.1} % \
                 | {kept} |"
            );
        }
    }
    page
}
