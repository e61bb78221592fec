//! Prints `docs/accuracy.md`: every figure of accuracy that the project claims, in one run.
//!
//! Run by `cargo xtask accuracy`, which compares the text with the committed document: without an
//! argument by few units, with `--full` by all of them and with `--commit` and the commit that does
//! it, which the page names. The units are spread over two threads; each world is a thread of its
//! own, so the figures depend on the seed alone.

use std::fmt::Write as _;

use sim::bench::interpretation::Interpretation;
use sim::bench::static_test::{StaticPoint, errors};
use sim::bench::statistics::{Tally, median};
use sim::bench::unit::{Plan, UnitResult};
use sim::bench::{Bench, BenchError, Mode, World};
use sim::error_model::ErrorModel;
use sim::rig::Mount;

mod assumptions;
mod dense;
mod dynamic;
mod published;
mod scatter;
#[path = "../faults/spread.rs"]
mod spread;
mod tables;
mod week;

const SEED: u64 = 1;

/// How many units and weeks the figures are of.
struct Scale {
    /// What the page opens with.
    opening: &'static str,
    /// Units of each mode.
    units: u32,
    /// Units of each row about an assumption.
    assumed: u32,
    /// Units of the variant with a gyroscope.
    dynamic: u32,
    /// Weeks of paper mode and of product mode.
    weeks: u32,
    /// Weeks as printed: every day of every seed has warnings, and fewer show that as well.
    printed_weeks: u32,
}

/// What is claimed.
const FULL: Scale = Scale {
    opening: FULL_OPENING,
    units: 100,
    assumed: 20,
    dynamic: 30,
    weeks: 20,
    printed_weeks: 2,
};

/// What every run of the tests repeats.
const REPEATED: Scale = Scale {
    opening: REPEATED_OPENING,
    units: 6,
    assumed: 2,
    dynamic: 3,
    weeks: 2,
    printed_weeks: 1,
};

/// The literal reading of the paper.
const AS_PRINTED: World = World {
    paper: Interpretation::AS_PRINTED,
    ..World::NOMINAL
};

fn main() -> Result<(), BenchError> {
    let is_full = std::env::args().any(|word| word == "--full");
    let scale = if is_full { &FULL } else { &REPEATED };
    let mut page = head(scale);
    let of = |mode, world: &World| shared(scale.units, |unit| passage(mode, world, unit));
    let product = of(Mode::Product, &World::NOMINAL)?;
    let paper = of(Mode::Paper, &World::NOMINAL)?;
    let printed = of(Mode::Paper, &AS_PRINTED)?;
    let one_axis = of(Mode::OneAxis, &World::NOMINAL)?;
    let with_gyroscope = dynamic::Dynamic::measure(scale.dynamic)?;
    let weeks = week::Weeks::dig(scale)?;
    published::against_the_paper(&mut page, &paper, &product, &weeks);
    targets(&mut page, &product, &one_axis)?;
    with_gyroscope.section(&mut page, &product);
    let compared = [
        ("paper mode", paper.as_slice()),
        ("as printed", &printed),
        ("product mode", &product),
    ];
    tables::table_two(&mut page, &compared);
    let gyroscope = [("with a gyroscope", with_gyroscope.units.as_slice())];
    tables::table_three(&mut page, &[compared.as_slice(), &gyroscope].concat());
    tables::calibration(&mut page, &compared, &one_axis);
    scatter::section(&mut page, &compared);
    weeks.section(&mut page);
    assumptions::section(&mut page, scale)?;
    dense::section(&mut page, scale)?;
    print!("{page}");
    Ok(())
}

const FULL_OPENING: &str = "\
# Accuracy

For those who judge the accuracy of the instrument. `cargo xtask accuracy --full` prints this
page in a quarter of an hour, and with it the same page of a few units, which `cargo xtask test`
repeats and compares: [accuracy-of-few-units.md](accuracy-of-few-units.md). So the code that printed
the one prints the other.
";

const REPEATED_OPENING: &str = "\
# Accuracy, of few units

For whoever changes the code: `cargo xtask test` prints this page again and compares it. It is
[accuracy.md](accuracy.md) of so few units that its figures scatter, and whether a bound is kept is
judged there, not here. `cargo xtask accuracy --full` writes both.
";

/// Where the page comes from: the word behind `--commit`, if there is one.
fn origin() -> String {
    let commit = std::env::args()
        .skip_while(|word| word != "--commit")
        .nth(1);
    commit.map_or_else(String::new, |commit| {
        format!("\nPrinted by the code of commit {commit}.\n")
    })
}

/// What the page is, and how many units it is of.
fn head(scale: &Scale) -> String {
    let Scale { opening, units, .. } = scale;
    let origin = origin();
    format!(
        "{opening}{origin}\nEverything here is simulated: parts with the errors of the nominal \
         model, on a virtual rig, read\nthrough the device code. Seed {SEED}, {units} units of \
         each mode, both nodes of each; {HEAD}"
    )
}

const HEAD: &str = "\
errors are against
the true angle of the shaft, not against the angle that the motor reports. RMSE are those of the
median unit, largest errors those of the worst.

In product mode every unit is switched off and on between calibration and test, and one reading is
one reading, not a mean. Paper mode is the reading of the paper under which its own tables come
back, by the assumptions at the end of this page; \"as printed\" is the literal reading.

";

/// One unit through everything that this page asks of its mode.
struct Passage {
    unit: UnitResult,
    /// The other axis tilted by 10 deg; empty in paper mode.
    wedged: Tally,
    /// Errors and reported uncertainties at each of [`scatter::ANGLES`].
    scatter: [[Tally; 2]; 4],
    /// Random angles from -10 to 70 degC; empty in paper mode.
    thermal: Tally,
}

fn passage(mode: Mode, world: &World, unit: u32) -> Result<Passage, BenchError> {
    let (mut bench, calibration) = Bench::commissioned(mode, world, SEED, unit)?;
    let one_axis = mode == Mode::OneAxis;
    let plan = Plan {
        lever_arms_cm: if one_axis { &[] } else { &[0, 2, 5] },
        ..Plan::WHOLE
    };
    let (statics, dynamics) = bench.tests(&plan);
    let mut unit = UnitResult {
        calibration,
        statics,
        dynamics,
    };
    unit.dynamics
        .iter_mut()
        .for_each(|run| run.result.points = Vec::new());
    let scatter = scatter::of_unit(&mut bench);
    let (mut wedged, mut thermal) = (Tally::default(), Tally::default());
    if matches!(mode, Mode::Product | Mode::Dynamic) {
        wedged = tilted(&mut bench);
        thermal = over_temperature(&mut bench);
    }
    Ok(Passage {
        unit,
        wedged,
        scatter,
        thermal,
    })
}

/// Runs `work` for the first `count` units on two threads; results in the order of the units.
fn shared<T: Send>(
    count: u32,
    work: impl Fn(u32) -> Result<T, BenchError> + Sync,
) -> Result<Vec<T>, BenchError> {
    let all = spread::spread(count as usize, |unit| work(unit as u32));
    all.into_iter().collect()
}

/// Errors of both nodes over the points that `keep` keeps.
fn tally(points: &[StaticPoint], keep: impl Fn(&StaticPoint) -> bool) -> Tally {
    let kept: Vec<_> = points.iter().copied().filter(|p| keep(p)).collect();
    let mut tally = errors(&kept, 0);
    tally.join(&errors(&kept, 1));
    tally
}

fn of_unit(unit: &UnitResult, knots: bool, keep: impl Fn(&StaticPoint) -> bool) -> Tally {
    let mut all = Tally::default();
    for run in unit.statics.iter().filter(|run| run.knots == knots) {
        all.join(&tally(&run.points, &keep));
    }
    all
}

/// (median rms, largest) over units.
fn summary(tallies: &[Tally]) -> (f64, f64) {
    let mut rms: Vec<_> = tallies.iter().map(Tally::rms).collect();
    (
        median(&mut rms),
        tallies.iter().map(Tally::largest).fold(0.0, f64::max),
    )
}

fn row(page: &mut String, name: &str, obtained: f64, limit: Option<f64>, digits: usize) {
    let (must, kept) = match limit {
        Some(limit) => (
            format!("<= {limit:.digits$}"),
            if obtained <= limit { "yes" } else { "NO" },
        ),
        None => (String::from("reported"), ""),
    };
    let _ = writeln!(page, "| {name} | {obtained:.digits$} | {must} | {kept} |");
}

fn targets(page: &mut String, product: &[Passage], one_axis: &[Passage]) -> Result<(), BenchError> {
    page.push_str("## Product mode against its specification\n\n");
    page.push_str("| figure | obtained, deg | must be | kept |\n|---|---|---|---|\n");
    static_rows(page, product, one_axis);
    let thermal: Vec<_> = product.iter().map(|p| p.thermal).collect();
    thermal_rows(page, "nominal model", &thermal, Some((0.040, 0.20)));
    for (hysteresis, turn_on) in [(2.0, 3.0), (3.0, 6.0)] {
        let name = format!("pessimistic: hysteresis x{hysteresis:.0}, turn-on x{turn_on:.0}");
        thermal_rows(
            page,
            &name,
            &pessimistic(product.len() as u32, hysteresis, turn_on)?,
            None,
        );
    }
    let swing =
        |aligned| -> Vec<Tally> { product.iter().map(|p| swing(&p.unit, 0, aligned)).collect() };
    let name = "two axes, 80 deg/s, lever arm 0, aligned: RMSE";
    row(page, name, summary(&swing(true)).0, Some(0.045), 4);
    row(
        page,
        "the same as it arrives: RMSE",
        summary(&swing(false)).0,
        None,
        3,
    );
    let random = product.iter().map(|p| of_unit(&p.unit, false, |_| true));
    let above = random.filter(|t| t.rms() > 0.040).count();
    let _ = writeln!(
        page,
        "\nOf the {} two-axis units {above} have an RMSE of their own above 0.040 deg at \
         25 degC: the limit is that of the median unit.\n",
        product.len()
    );
    Ok(())
}

/// Everything at 25 degC and standstill.
fn static_rows(page: &mut String, product: &[Passage], one_axis: &[Passage]) {
    let over = |list: &[Passage], knots: bool, keep: fn(&StaticPoint) -> bool| {
        summary(
            &list
                .iter()
                .map(|p| of_unit(&p.unit, knots, keep))
                .collect::<Vec<_>>(),
        )
    };
    let tilted: Vec<_> = product.iter().map(|p| p.wedged).collect();
    let lines = [
        (
            "two axes, static, 25 degC, random angles +-90",
            over(product, false, |_| true),
            0.040,
            true,
        ),
        (
            "one axis, 360 deg, random angles",
            over(one_axis, false, |_| true),
            0.035,
            false,
        ),
        (
            "two axes, at +-90 only",
            over(product, true, |p| p.truth_deg.abs() > 89.0),
            0.09,
            false,
        ),
        (
            "two axes, the other one tilted 10 deg",
            summary(&tilted),
            0.045,
            false,
        ),
    ];
    for (name, (rms, largest), limit, bounded) in lines {
        row(page, &format!("{name}: RMSE"), rms, Some(limit), 4);
        row(
            page,
            "the same: largest error of any unit",
            largest,
            bounded.then_some(0.20),
            3,
        );
    }
}

fn swing(unit: &UnitResult, arm: u32, aligned: bool) -> Tally {
    let mut all = Tally::default();
    for run in unit.dynamics.iter().filter(|run| run.lever_arm_cm == arm) {
        let tallies = if aligned {
            run.result.aligned
        } else {
            run.result.as_it_arrives
        };
        tallies.iter().for_each(|t| all.join(t));
    }
    all
}

fn thermal_rows(page: &mut String, name: &str, tallies: &[Tally], limits: Option<(f64, f64)>) {
    let (rms, largest) = summary(tallies);
    let name = format!("two axes, -10..70 degC, {name}: RMSE");
    row(page, &name, rms, limits.map(|l| l.0), 4);
    row(
        page,
        "the same: largest error of any unit",
        largest,
        limits.map(|l| l.1),
        3,
    );
}

/// Random angles with the other axis tilted by 10 deg (E7).
fn tilted(bench: &mut Bench) -> Tally {
    let mut all = Tally::default();
    for mount in [Mount::X, Mount::Y] {
        bench.mount(mount, 10.0, 0.0);
        let angles = bench.random_angles(20, 85.0);
        all.join(&tally(&bench.static_test(mount, &angles), |_| true));
    }
    all
}

/// Random angles from -10 to 70 degC, both axes.
fn over_temperature(bench: &mut Bench) -> Tally {
    let mut all = tally(&bench.thermal_test(Mount::X, 4), |_| true);
    all.join(&tally(&bench.thermal_test(Mount::Y, 4), |_| true));
    all
}

fn pessimistic(count: u32, hysteresis: f64, turn_on: f64) -> Result<Vec<Tally>, BenchError> {
    let parts = ErrorModel::pessimistic(hysteresis, turn_on);
    let world = World {
        parts,
        ..World::NOMINAL
    };
    shared(count, |unit| {
        let (mut bench, _) = Bench::commissioned(Mode::Product, &world, SEED, unit)?;
        Ok(over_temperature(&mut bench))
    })
}
