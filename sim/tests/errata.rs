//! What the cross-check sees and what it cannot: errata E8 to E11 and E16, and rule R13 in the
//! world.
//!
//! In: perfect parts, so that nothing but the point in question differs, unless a test has
//! others. Perfect parts need no calibration: the identity is exact for the product's chain,
//! and paper mode gets a table of sines read by the linear rule, since the nearest rule's steps of
//! 1 deg would mask noise and skew of tenths.

use std::collections::VecDeque;

use device::channel::Settings;
use instant::Instant;
use proptest::prelude::*;
use sim::bench::static_test::{differences, errors};
use sim::bench::statistics::Tally;
use sim::bench::{Bench, Mode, World, run};
use sim::error_model::{ErrorModel, Term};
use sim::excavator::{Excavator, ExcavatorSetup};
use sim::instrument::Instrument;
use sim::motion::Mover;
use sim::motor::MotorModel;
use sim::rig::{Fixture, Mount, Rig, RigSetup};
use sim::rng::Rng;
use sim::supply::Supply;
use tilt::ONE_G;
use tilt::angle::{Angle, Axes};
use tilt::chain::{Correction, Measurement, Reading};
use tilt::cross_check::{CrossCheck, Judgement, THRESHOLD, Verdict};
use tilt::table::{Point, Rule, Table};
use tilt::uncertainty::{Budget, Span, Uncertainty};

/// Readings are compared every 20 ms.
const SYNC_S: f64 = 0.020;

/// Paper mode on a perfect part: the true sines as the table, read by the linear rule.
fn linear_paper() -> Settings {
    let points: Vec<_> = (-90..=90)
        .map(|degrees| Point {
            accel: (f64::from(degrees).to_radians().sin() * f64::from(ONE_G)) as i32,
            angle: Angle::from_degrees(f64::from(degrees)),
        })
        .collect();
    let table = Table::new(&points).unwrap();
    let mut settings = Mode::Paper.settings();
    settings.chain.calibration.correction = Correction::Tables {
        tables: Axes {
            x: table.clone(),
            y: table,
        },
        rule: Rule::Linear,
    };
    settings
}

fn standing_at(slope_x_deg: f64) -> Fixture {
    let (sin, cos) = slope_x_deg.to_radians().sin_cos();
    Fixture::facing([sin, 0.0, cos])
}

/// A started instrument that judges by the paper's rule.
fn instrument(settings: &Settings, parts: &ErrorModel, seed: u64) -> Instrument {
    let mut instrument = Instrument::new(settings, &CrossCheck::paper(), parts, seed, 1);
    instrument.power_cycle();
    instrument
}

fn shifted(reading: Reading, by: Angle) -> Reading {
    let shift = |m: Measurement| Measurement {
        angle: m.angle.plus(by),
        ..m
    };
    Axes {
        x: reading.x.map(shift),
        y: reading.y,
    }
}

/// A reading of a perfect product at 30 deg, calibrated with nothing left.
fn good_reading() -> Reading {
    let mut settings = Mode::Product.settings();
    settings.chain.calibration.budget =
        Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::REFERENCE);
    let mut instrument = instrument(&settings, &ErrorModel::PERFECT, 1);
    run(&mut instrument, &mut standing_at(30.0), 2.0);
    let reading = instrument.sync().readings[0];
    assert!((reading.x.unwrap().angle.degrees() - 30.0).abs() < 0.003);
    reading
}

proptest! {
    // No file of failing cases: a case that is found becomes a test of its own.
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// E8: the mean size of a difference is at most the sum of the two root mean squares.
    #[test]
    fn e8_a_mean_difference_never_exceeds_the_sum_of_the_rmse(
        errors_deg in proptest::collection::vec((-1.0f64..1.0, -1.0f64..1.0), 1..300),
    ) {
        let (mut one, mut two, mut difference) = <(Tally, Tally, Tally)>::default();
        for (a, b) in errors_deg {
            one.add(a);
            two.add(b);
            difference.add((a - b).abs());
        }
        prop_assert!(difference.mean() <= one.rms() + two.rms() + 1e-12);
    }
}

#[test]
fn e8_table_iii_x_states_more_than_that() {
    // Table III, X: RMSE 0.091 and 0.100 deg, mean difference 0.2; Y: 0.088, 0.085 and 0.1.
    let [x, y] = [(0.091, 0.100, 0.2), (0.088, 0.085, 0.1)];
    let possible = |(one, two, mean): (f64, f64, f64)| mean <= one + two;
    assert!(!possible(x) && possible(y));
}

fn correlation(pairs: &[(f64, f64)]) -> f64 {
    let count = pairs.len() as f64;
    let mean = |pick: fn(&(f64, f64)) -> f64| pairs.iter().map(pick).sum::<f64>() / count;
    let (a, b) = (mean(|p| p.0), mean(|p| p.1));
    let sum = |f: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|p| f(p.0 - a, p.1 - b)).sum::<f64>();
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

#[test]
fn e9_an_error_of_the_reference_does_not_show_in_the_difference() {
    // Perfect parts, calibrated on a motor fourteen times worse than the bench's.
    let motor = MotorModel {
        harmonic_deg_pp: 0.7,
        ..MotorModel::NOMINAL
    };
    let rig = RigSetup {
        motor,
        ..RigSetup::NOMINAL
    };
    let parts = ErrorModel::PERFECT;
    let world = World {
        parts,
        rig,
        ..World::NOMINAL
    };
    let (mut bench, calibration) = Bench::commissioned(Mode::Product, &world, 9, 1).unwrap();
    let passed = calibration.iter().all(|c| c.passed());
    assert!(
        passed,
        "the verification round shares the reference, so it does not see it"
    );
    bench.mount(Mount::X, 0.0, 0.0);
    let angles_deg = bench.random_angles(60, 80.0);
    let points = bench.static_test(Mount::X, &angles_deg);
    let [one, two] = [0, 1].map(|node| errors(&points, node).rms());
    let delta = differences(&points).rms();
    let pairs: Vec<_> = points
        .iter()
        .map(|p| (p.nodes[0].error_deg, p.nodes[1].error_deg))
        .collect();
    let correlation = correlation(&pairs);
    println!("errors {one:.3} and {two:.3} deg, delta {delta:.3}, correlation {correlation:.4}");
    assert!(one > 0.07 && two > 0.07, "{one} {two}");
    assert!(delta < 0.05 * one, "{delta}");
    assert!(correlation > 0.98, "{correlation}");
    assert!(points.iter().all(|p| !p.warning));
}

#[test]
fn e10_an_error_of_0_6_hides_behind_one_of_0_2_the_same_way() {
    let good = good_reading();
    let hidden = Angle(Angle::from_degrees(0.2).0 + THRESHOLD as i32);
    assert!((hidden.degrees() - 0.6).abs() < 1e-6);
    let shown = Angle(hidden.0 + 1);
    let common = Angle::from_degrees(25.0);
    let peer = shifted(good, Angle::from_degrees(0.2));
    let judge = |mut check: CrossCheck, own: Reading, peer: Reading| {
        let judgements = (0..100).map(|i| check.step(own, peer, Instant(20_000 * i)).judgement());
        judgements.last().unwrap()
    };
    for check in [CrossCheck::paper(), CrossCheck::product()] {
        let agree = judge(check.clone(), shifted(good, hidden), peer);
        assert_eq!(agree, Judgement::Agree, "0.6 deg wrong and not seen");
        let both = judge(check, shifted(good, common), shifted(good, common));
        assert_eq!(
            both,
            Judgement::Agree,
            "a common error of any size is not seen"
        );
    }
    assert_eq!(
        judge(CrossCheck::paper(), shifted(good, shown), peer),
        Judgement::Warning
    );
    assert_eq!(
        judge(CrossCheck::product(), shifted(good, shown), peer),
        Judgement::Disagree
    );
}

/// Pairs with more than 0.40 deg between the nodes, and stops asked for, in ten minutes at this
/// angle: parts with white noise and nothing else, in paper mode with linear tables.
fn excesses_in_ten_minutes(slope_x_deg: f64, seed: u64) -> (u32, u32) {
    let noise = ErrorModel::NOMINAL.only(Term::WhiteNoise);
    let mut instrument = instrument(&linear_paper(), &noise, seed);
    let mut pose = standing_at(slope_x_deg);
    run(&mut instrument, &mut pose, 1.0);
    let (mut excesses, mut stops, mut stopped) = (0, 0, false);
    for _ in 0..30_000 {
        run(&mut instrument, &mut pose, SYNC_S);
        let verdict = instrument.sync().verdict;
        let delta = verdict.delta().x.expect("both measure");
        excesses += u32::from(delta.magnitude() > THRESHOLD);
        let stops_now = verdict.judgement() == Judgement::StopMotion;
        stops += u32::from(stops_now && !stopped);
        stopped = stops_now;
    }
    (excesses, stops)
}

#[test]
fn e11_noise_alone_fires_the_rule_above_78_6_deg() {
    let mean_over_seeds = |slope_deg: f64| {
        let runs = (1..=5).map(|seed| excesses_in_ten_minutes(slope_deg, seed));
        let (excesses, stops): (Vec<_>, Vec<_>) = runs.unzip();
        let mean = f64::from(excesses.iter().sum::<u32>()) / 5.0;
        println!("{slope_deg} deg: {mean} excesses in ten minutes, stops {stops:?}");
        (mean, stops)
    };
    let (at_80, stops) = mean_over_seeds(80.0);
    assert!((at_80 / 321.0 - 1.0).abs() < 0.2, "{at_80}");
    assert!(
        stops.iter().all(|&n| n >= 1),
        "no fault is there, yet it stops"
    );
    let (at_79, _) = mean_over_seeds(79.0);
    assert!(at_79 > 110.0, "{at_79}");
    let (at_78, stops) = mean_over_seeds(78.0);
    assert!(at_78 < 110.0, "{at_78}");
    assert!(stops.iter().all(|&n| n == 0), "{stops:?}");
}

/// Largest difference while the shaft turns at 80 deg/s and node 2 is read `skew_ms` later, and
/// whether the paper's rule warned.
fn skewed(skew_ms: u32) -> (f64, bool) {
    let settings = Mode::Product.settings();
    let mut instrument = instrument(&settings, &ErrorModel::PERFECT, 2);
    let mut rig = Rig::new(&RigSetup::PERFECT, &mut Rng::stream(2, "rig"));
    run(&mut instrument, &mut rig, 1.0);
    rig.command(-40.0, 80.0).unwrap();
    run(&mut instrument, &mut rig, 2.0);
    rig.command(40.0, 80.0).unwrap();
    run(&mut instrument, &mut rig, 0.3);
    let mut check = CrossCheck::paper();
    let (mut largest, mut warned) = (0.0f64, false);
    for _ in 0..20 {
        let own = instrument.sync().readings[0];
        run(&mut instrument, &mut rig, f64::from(skew_ms) * 0.001);
        let peer = instrument.sync().readings[1];
        let now = instrument.sides[0].clock(instrument.time_s());
        let verdict = check.step(own, peer, now);
        largest = largest.max(verdict.delta().x.unwrap().degrees().abs());
        warned |= verdict.judgement() == Judgement::Warning;
        run(
            &mut instrument,
            &mut rig,
            SYNC_S - f64::from(skew_ms) * 0.001,
        );
    }
    (largest, warned)
}

#[test]
fn e11_five_ms_of_skew_are_0_40_deg_at_80_deg_per_s() {
    let (together, warned) = skewed(0);
    assert!(together < 0.01 && !warned, "{together}");
    let (at_5, _) = skewed(5);
    assert!((at_5 - 0.40).abs() < 0.01, "{at_5}");
    assert!(!skewed(4).1 && skewed(6).1);
}

#[test]
fn e16_a_fault_that_grows_slowly_takes_the_paper_s_rule_645_s() {
    let good = good_reading();
    let bad = shifted(good, Angle::from_degrees(0.5));
    // A contact that opens for single readings, 111 times in 600 s, and then for good.
    let opens: Vec<u64> = (0..111).map(|n| n * 29_999 / 110).collect();
    let fault_at = |mut check: CrossCheck, broken_from: u64| {
        (0..40_000u64).find(|tick| {
            let open = opens.contains(tick) || *tick >= broken_from;
            let own = if open { bad } else { good };
            let verdict = check.step(own, good, Instant(20_000 * tick));
            verdict.judgement().is_fault()
        })
    };
    let seconds = |tick: u64| tick as f64 * SYNC_S;
    let slow = seconds(fault_at(CrossCheck::paper(), 29_999).unwrap());
    assert!((644.9..=645.0).contains(&slow), "{slow}");
    let at_once = seconds(fault_at(CrossCheck::paper(), 0).unwrap());
    assert!(
        (47.1..47.3).contains(&at_once),
        "110 readings and 45 s: {at_once}"
    );
    let product = seconds(fault_at(CrossCheck::product(), 0).unwrap());
    assert!(product < 0.25, "{product}");
    let product = seconds(fault_at(CrossCheck::product(), 29_999).unwrap());
    assert!(
        (599.9..600.5).contains(&product),
        "single readings do not count: {product}"
    );
}

/// An excavator that obeys the paper's rule on the product's chain; node 2's readings may come
/// late. The product's chain aligns the nodes, so that the delay is the only difference.
struct Site {
    instrument: Instrument,
    arm: Excavator,
    check: CrossCheck,
    late: VecDeque<Reading>,
    /// Readings of node 2 that are on their way.
    delay: usize,
}

impl Site {
    fn new(parts: &ErrorModel, seed: u64) -> Self {
        let settings = Mode::Product.settings();
        let mut site = Self {
            instrument: instrument(&settings, parts, seed),
            arm: Excavator::new(&ExcavatorSetup::SMOOTH, &mut Rng::stream(seed, "arm")),
            check: CrossCheck::paper(),
            late: VecDeque::new(),
            delay: 0,
        };
        run(&mut site.instrument, &mut site.arm, 1.0);
        site
    }

    /// 20 ms, then one comparison; the arm does what the rule asks for.
    fn step(&mut self) -> Verdict {
        run(&mut self.instrument, &mut self.arm, SYNC_S);
        let [own, peer] = self.instrument.sync().readings;
        self.late.push_back(peer);
        while self.late.len() > self.delay + 1 {
            self.late.pop_front();
        }
        let peer = self.late.front().copied().unwrap_or(peer);
        let now_s = self.instrument.time_s();
        let now = self.instrument.sides[0].clock(now_s);
        let verdict = self.check.step(own, peer, now);
        match verdict.judgement() {
            Judgement::StopMotion | Judgement::PhysicalFault => self.arm.stop(now_s),
            Judgement::DataDelay => self.arm.resume(now_s),
            _ => {}
        }
        verdict
    }

    /// Steps until this judgement; how long it took, s.
    fn until(&mut self, wanted: Judgement, most_s: f64) -> Option<f64> {
        let steps = (most_s / SYNC_S) as u32;
        (1..=steps)
            .find(|_| self.step().judgement() == wanted)
            .map(|n| f64::from(n) * SYNC_S)
    }

    fn warnings_in(&mut self, seconds: f64) -> usize {
        let steps = (seconds / SYNC_S) as u32;
        (0..steps)
            .filter(|_| self.step().judgement().is_warning())
            .count()
    }
}

#[test]
fn r13_a_late_peer_stops_the_work_for_45_s_and_resumes() {
    let mut site = Site::new(&ErrorModel::PERFECT, 3);
    assert_eq!(
        site.warnings_in(120.0),
        0,
        "in time there is nothing to report"
    );
    site.delay = 10;
    let moving_s = site.until(Judgement::StopMotion, 60.0).expect("a stop");
    assert!(moving_s > 2.2, "111 warnings: {moving_s}");
    let stopped_s = site
        .until(Judgement::DataDelay, 60.0)
        .expect("Table I, row 1");
    // The arm comes to rest first: the 45 s are of standstill.
    println!("resumed {stopped_s:.2} s after the request");
    assert!((44.9..50.0).contains(&stopped_s), "{stopped_s}");
    assert!(!site.arm.stopped(), "work resumes");
    site.delay = 0;
    assert_eq!(site.warnings_in(120.0), 0);
}

#[test]
fn r13_a_bad_supply_ends_as_a_physical_fault_that_a_reset_cures() {
    let parts = ErrorModel::PERFECT
        .with(Term::SagNoise, &ErrorModel::NOMINAL)
        .with(Term::SagWander, &ErrorModel::NOMINAL);
    let mut site = Site::new(&parts, 4);
    let from_s = site.instrument.time_s();
    site.instrument.sides[1].electronics.supply =
        Supply::unstable(from_s, &mut Rng::stream(4, "supply"));
    let found_s = site
        .until(Judgement::PhysicalFault, 645.0)
        .expect("Table I, row 2");
    println!("supply fault found after {found_s:.1} s");
    assert!(site.arm.stopped());
    assert!(
        site.warnings_in(30.0) > 0,
        "it stays until somebody has looked"
    );
    site.instrument.sides[1]
        .electronics
        .supply
        .repair(site.instrument.time_s());
    run(&mut site.instrument, &mut site.arm, 0.1);
    site.instrument.power_cycle();
    site.check.reset();
    run(&mut site.instrument, &mut site.arm, 1.5);
    site.late.clear();
    site.arm.resume(site.instrument.time_s());
    assert_eq!(site.warnings_in(120.0), 0, "the reset has cured it");
}

#[test]
fn the_site_s_arm_really_moves() {
    let mut arm = Excavator::new(&ExcavatorSetup::SMOOTH, &mut Rng::stream(3, "arm"));
    let pitch = |arm: &mut Excavator, s: f64| arm.step(s).attitude.slope_y_deg;
    let fastest = (1..60_000).fold((0.0f64, pitch(&mut arm, 0.0)), |(most, last), tick| {
        let now = pitch(&mut arm, f64::from(tick) * 0.001);
        (most.max((now - last).abs() * 1000.0), now)
    });
    assert!(fastest.0 > 20.0, "{fastest:?}");
}
