//! The variant with a gyroscope beside product mode: at rest, on the swing and on a boom.

use std::fmt::Write as _;

use sim::bench::boom::{BoomResult, REST_S};
use sim::bench::gyroscope::GyroscopeReport;
use sim::bench::statistics::{Tally, median};
use sim::bench::{Bench, BenchError, Mode, World};
use sim::excavator::ExcavatorSetup;

use crate::{Passage, SEED, of_unit, passage, shared, summary, swing};

/// Machines and places on their booms, with their names.
const BOOMS: [(ExcavatorSetup, &str); 4] = [
    (
        boom(&ExcavatorSetup::NOMINAL, 1.0),
        "boom, 1 m from the pivot",
    ),
    (
        boom(&ExcavatorSetup::NOMINAL, 3.0),
        "boom, 3 m from the pivot",
    ),
    (
        boom(&ExcavatorSetup::SLEWING, 1.0),
        "slewing boom, 1 m from the pivot",
    ),
    (
        boom(&ExcavatorSetup::SLEWING, 3.0),
        "slewing boom, 3 m from the pivot",
    ),
];
/// How long a unit digs and rests at each of them, s.
const BOOM_S: f64 = 120.0;

const fn boom(machine: &ExcavatorSetup, lever_arm_m: f64) -> ExcavatorSetup {
    ExcavatorSetup {
        lever_arm_m,
        ..*machine
    }
}

/// Both kinds of instrument through everything that the section shows.
pub struct Dynamic {
    /// Units through the bench.
    pub units: Vec<Passage>,
    /// Each unit on each of [`BOOMS`], in product mode and with a gyroscope.
    booms: [Vec<[BoomResult; BOOMS.len()]>; 2],
    /// Largest standard uncertainty of scale and alignment, of each node.
    gains: Vec<f64>,
}

impl Dynamic {
    /// Measures so many units.
    ///
    /// Errors: see [`BenchError`].
    pub fn measure(count: u32) -> Result<Self, BenchError> {
        let units = shared(count, |unit| passage(Mode::Dynamic, &World::NOMINAL, unit))?;
        let on = |mode| shared(count, move |unit| on_booms(mode, unit));
        let (product, _): (Vec<_>, Vec<_>) = on(Mode::Product)?.into_iter().unzip();
        let (dynamic, nodes): (Vec<_>, Vec<_>) = on(Mode::Dynamic)?.into_iter().unzip();
        let nodes = nodes.iter().flatten().flatten();
        Ok(Self {
            units,
            booms: [product, dynamic],
            gains: nodes.map(largest_uncertainty).collect(),
        })
    }

    /// The section of the page.
    pub fn section(&self, page: &mut String, product: &[Passage]) {
        let count = self.units.len();
        let _ = write!(
            page,
            "## The variant with a gyroscope\n\nAn ISM330DHCX in the place of the LIS2DW12, its \
             accelerometer with the same errors, its gyroscope with those of \
             [gyroscope-parts.md](gyroscope-parts.md); {count} units, and of product mode the same \
             ones. \"As it arrives\" is the angle of that very moment. On the boom of an excavator \
             every unit digs and rests for {BOOM_S:.0} s; at rest is what is read {REST_S:.0} s \
             after the last move and later, with the engine idling. On a slewing boom the cab \
             turns out by up to 120 deg and back, at up to 60 deg/s.\n\n\
             | figure | product mode | with a gyroscope | at most | target |\n\
             |---|---|---|---|---|\n"
        );
        let product = product.get(..count).unwrap_or(product);
        self.bench_rows(page, product);
        self.boom_rows(page);
        let mut gains = self.gains.clone();
        let _ = writeln!(
            page,
            "\nThe motor's turns leave a standard uncertainty of {:.3} % of the gyroscope's scale \
             and alignment at most (median node).\n",
            median(&mut gains) * 100.0
        );
    }

    fn bench_rows(&self, page: &mut String, product: &[Passage]) {
        let of = |find: &dyn Fn(&Passage) -> Tally| {
            let both = [product, &self.units];
            both.map(|units| summary(&units.iter().map(find).collect::<Vec<_>>()))
        };
        let both = |page: &mut String, name: &str, limits: [f64; 2], found: [(f64, f64); 2]| {
            let [product, dynamic] = found;
            let rms = (product.0, dynamic.0);
            row(page, &format!("{name}: RMSE, deg"), rms, Some(limits[0]), 4);
            let name = "the same: largest error of any unit, deg";
            row(page, name, (product.1, dynamic.1), Some(limits[1]), 3);
        };
        let random = of(&|p| of_unit(&p.unit, false, |_| true));
        both(
            page,
            "static, 25 degC, random angles",
            [0.040, 0.20],
            random,
        );
        let thermal = of(&|p| p.thermal);
        both(page, "static, -10..70 degC", [0.040, 0.20], thermal);
        for arm in [0, 2, 5] {
            let [product, dynamic] = of(&|p| swing(&p.unit, arm, false));
            let name = format!("80 deg/s, lever arm {arm} cm, as it arrives: RMSE, deg");
            row(page, &name, (product.0, dynamic.0), Some(0.10), 3);
        }
        let [product, dynamic] = of(&|p| swing(&p.unit, 0, true));
        let name = "80 deg/s, lever arm 0, aligned: RMSE, deg";
        row(page, name, (product.0, dynamic.0), None, 3);
    }

    fn boom_rows(&self, page: &mut String) {
        let of = |place: usize, find: fn(&BoomResult) -> Tally| {
            let tallies = self.booms.each_ref().map(|units| {
                let found: Vec<_> = units.iter().map(|unit| find(&unit[place])).collect();
                summary(&found)
            });
            let [product, dynamic] = tallies;
            [(product.0, dynamic.0), (product.1, dynamic.1)]
        };
        for (place, (_, boom)) in BOOMS.iter().enumerate() {
            let [rms, largest] = of(place, |found| found.working);
            let name = format!("{boom}, digging: RMSE, deg");
            row(page, &name, rms, Some(0.5), 3);
            row(
                page,
                "the same: largest error of any unit, deg",
                largest,
                None,
                2,
            );
            let [rms, largest] = of(place, |found| found.resting);
            let name = format!("{boom}, at rest: RMSE, deg");
            row(page, &name, rms, Some(0.05), 3);
            row(
                page,
                "the same: largest error of any unit, deg",
                largest,
                None,
                2,
            );
            let shares = self.booms.each_ref().map(|units| {
                let mut all = BoomResult::default();
                units.iter().for_each(|unit| all.join(&unit[place]));
                let valid = all.valid().max(1) as f64;
                let covered = 100.0 * all.covered as f64 / valid;
                (covered, 100.0 * valid / (valid + all.invalid as f64))
            });
            let [product, dynamic] = shares;
            let name = format!("{boom}: errors within twice the stated uncertainty, %");
            row(page, &name, (product.0, dynamic.0), None, 1);
            let name = format!("{boom}: angles that are valid, %");
            row(page, &name, (product.1, dynamic.1), None, 1);
        }
    }
}

/// One line; the target is that of the variant with a gyroscope, and is said to be missed where it
/// is.
fn row(
    page: &mut String,
    name: &str,
    (product, dynamic): (f64, f64),
    limit: Option<f64>,
    digits: usize,
) {
    let (most, target) = match limit {
        Some(limit) if dynamic <= limit => (format!("{limit:.digits$}"), "met"),
        Some(limit) => (format!("{limit:.digits$}"), "missed"),
        None => (String::from("-"), "-"),
    };
    let _ = writeln!(
        page,
        "| {name} | {product:.digits$} | {dynamic:.digits$} | {most} | {target} |"
    );
}

/// What each of [`BOOMS`] shows of one unit, and how its gyroscopes were calibrated.
type OnBooms = ([BoomResult; BOOMS.len()], Option<[GyroscopeReport; 2]>);

fn on_booms(mode: Mode, unit: u32) -> Result<OnBooms, BenchError> {
    let (mut bench, _) = Bench::commissioned(mode, &World::NOMINAL, SEED, unit)?;
    let booms = BOOMS.map(|(machine, _)| bench.on_the_boom(&machine, BOOM_S));
    Ok((booms, bench.gyroscopes))
}

/// The largest standard uncertainty of a node's scale and alignment.
fn largest_uncertainty(node: &GyroscopeReport) -> f64 {
    let all = node.gains.uncertainty.as_flattened().iter();
    all.copied().fold(0.0, f64::max)
}
