//! The scale of the gyroscopes over temperature: what the turns in the chamber leave of it.
//!
//! In: units of the bench, calibrated. Out: how far the rates of each are from the truth at -20,
//! -10 and 70 degC with the slopes that were found and without them, and the slopes against those
//! of the parts. The truth is the parts' own matrix: noise and bias take no part in it.

use sim::TICK_S;
use sim::bench::{Bench, Mode, World};
use sim::excavator::{Excavator, ExcavatorSetup};
use sim::motion::Mover;
use sim::rng::Rng;
use tilt::calibration::gyroscope::with_slopes;
use tilt::cross_check::Judgement;
use tilt::motion::Rate;
use tilt::rate::RateCorrection;
use tilt::sample::Temperature;

/// A rad/s, 2^-24 rad/s per step.
const ONE: f64 = 16_777_216.0;

/// One gyroscope at one temperature.
#[derive(Clone, Copy)]
struct At {
    /// What turns the housing's rate into the sensed one.
    matrix: [[f64; 3]; 3],
    /// As the part tells it.
    told: Temperature,
}

impl At {
    /// Both gyroscopes of a bench, with the dies at `celsius`, once what they tell of it has
    /// followed.
    fn both(bench: &mut Bench, celsius: f64) -> [Self; 2] {
        bench.bring_to(celsius);
        bench.run(10.0);
        [0, 1].map(|node| {
            let side = &bench.instrument.sides[node];
            let gyroscope = side.electronics.gyroscope().expect("a gyroscope");
            let told = side.node.channel.temperature().expect("a temperature");
            let matrix = gyroscope.matrix();
            Self { matrix, told }
        })
    }

    /// The error of scale about each axis of the housing with this correction.
    fn errors(&self, rates: &RateCorrection) -> [f64; 3] {
        let at = rates.at(self.told);
        let still = at.apply(Rate::default()).rate;
        [0, 1, 2].map(|axis| {
            let rate = self.matrix.map(|row| (row[axis] * ONE).round() as i32);
            let turned = at.apply(Rate { rate }).rate[axis] - still[axis];
            f64::from(turned) / ONE - 1.0
        })
    }

    /// The largest change of these errors from what they are at `mild`.
    fn changes(&self, mild: &Self, rates: &RateCorrection) -> f64 {
        let both = self.errors(rates).into_iter().zip(mild.errors(rates));
        both.fold(0.0, |most, (own, mild)| most.max((own - mild).abs()))
    }

    /// What a sensed rate of each axis has to be multiplied by, but for a factor.
    fn inverse(&self) -> [f64; 3] {
        let length = |row: [f64; 3]| row.iter().map(|a| a * a).sum::<f64>().sqrt();
        self.matrix.map(|row| 1.0 / length(row))
    }
}

fn celsius(temperature: Temperature) -> f64 {
    f64::from(temperature.0) / 256.0
}

/// The slopes of a part from -10 to 70 degC, as its own thermometer has them, 1 per degC.
fn true_slopes([cold, mild, hot]: [At; 3]) -> [f64; 3] {
    let degrees = celsius(hot.told) - celsius(cold.told);
    let [cold, mild, hot] = [cold, mild, hot].map(|at| at.inverse());
    [0, 1, 2].map(|axis| (hot[axis] - cold[axis]) / mild[axis] / degrees)
}

/// What has come of some units.
#[derive(Debug, Default)]
struct Found {
    /// Errors of the slopes in standard uncertainties, squared and summed up, and how many.
    squares: f64,
    slopes: f64,
    /// The largest standard uncertainty of a slope, 1 per degC.
    stated: f64,
    /// The largest changes of scale from 25 to -20, -10 and 70 degC, without slopes and with them.
    changes: [[f64; 2]; 3],
}

impl Found {
    fn add(&mut self, [colder, cold, mild, hot]: [At; 4], with: &RateCorrection, u: [f64; 3]) {
        let without = with_slopes(with, [0.0; 3], mild.told).expect("numbers that fit");
        for (most, part) in self.changes.iter_mut().zip([colder, cold, hot]) {
            for (most, rates) in most.iter_mut().zip([&without, with]) {
                *most = most.max(part.changes(&mild, rates));
            }
        }
        let slopes = with.real().scale1.into_iter().zip(u);
        for ((found, u), truth) in slopes.zip(true_slopes([cold, mild, hot])) {
            assert!((found - truth).abs() < 3.5 * u, "{found} {truth} {u}");
            self.squares += ((found - truth) / u).powi(2);
            self.slopes += 1.0;
            self.stated = self.stated.max(u);
        }
    }
}

#[test]
fn turns_in_the_chamber_leave_little_of_the_scale_over_temperature() {
    let mut found = Found::default();
    for unit in 0..8 {
        let commissioned = Bench::commissioned(Mode::Dynamic, &World::NOMINAL, 1, unit);
        let mut bench = commissioned.expect("a sound unit").0;
        let reports = bench.gyroscopes.expect("gyroscopes");
        let parts = [-20.0, -10.0, 25.0, 70.0].map(|celsius| At::both(&mut bench, celsius));
        for (node, report) in reports.iter().enumerate() {
            let rates = bench.instrument.sides[node]
                .settings
                .chain
                .calibration
                .rates;
            let rates = rates.expect("a correction");
            found.add(
                parts.map(|both| both[node]),
                &rates,
                report.scale.uncertainty,
            );
        }
    }
    let ratio = f64::sqrt(found.squares / found.slopes);
    println!("{found:?}; slopes are {ratio:.2} standard uncertainties off, rms");
    let [colder, cold, hot] = found.changes;
    assert!(hot[0] > 0.004 && hot[1] < 0.0003, "{hot:?}");
    assert!(cold[0] > 0.003 && cold[1] < 0.0003, "{cold:?}");
    assert!(colder[0] > 0.004 && colder[1] < 0.0003, "{colder:?}");
    // What the cross-check takes them for is 0.0015 %/degC for two.
    assert!(found.stated < 1e-5, "{found:?}");
    assert!((0.3..1.2).contains(&ratio), "{ratio}");
}

/// Digs and slews for a minute, and expects that no difference is found.
fn digs_in_agreement(bench: &mut Bench, case: &str) {
    let mut machine = Excavator::new(&ExcavatorSetup::SLEWING, &mut Rng::stream(1, case));
    let start_s = bench.instrument.time_s();
    for tick in 0..60_000_u32 {
        let motion = machine.step(bench.instrument.time_s() + TICK_S - start_s);
        bench.instrument.tick(&motion);
        if tick % 20 == 0 && tick > 5000 {
            let judgement = bench.instrument.sync().verdict.judgement();
            let in_order = matches!(judgement, Judgement::Agree | Judgement::Waiting(_));
            assert!(in_order, "{case}, {tick} ms: {judgement:?}");
        }
    }
}

#[test]
fn gyroscopes_in_order_agree_when_hot_or_cold_with_slopes_and_without() {
    for unit in [15, 16, 17, 18] {
        let commissioned = Bench::commissioned(Mode::Dynamic, &World::NOMINAL, 1, unit);
        let mut bench = commissioned.expect("a sound unit").0;
        for slopes in [true, false] {
            if !slopes {
                bench.bring_to(25.0);
                bench.run(10.0);
                bench.forget_slopes();
            }
            for celsius in [-20.0, 70.0] {
                bench.bring_to(celsius);
                bench.power_cycle();
                digs_in_agreement(&mut bench, &format!("{unit} {slopes} {celsius}"));
            }
        }
    }
}
