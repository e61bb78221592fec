//! Simulated gyroscopes with slopes of their own through a chamber, against what they do to a known
//! rate there, and turns that cannot be used.

use device::objects::table::Channel as Side;
use tilt::calibration::least_squares::{invert, times};
use tilt::rate::RealRateCorrection;

use super::super::measured::{Begun, Dwelt, Felt};
use super::super::model::Model;
use super::super::profile::{Profile, Step};
use super::super::report;
use super::super::turns::followed;
use super::*;
use crate::gains::Rest;
use crate::held::Held;
use crate::session::{Node, encode};
use tilt::ONE_G;

const EDGE: f64 = 54.7356;

/// The motor's way through a dwell, pitch and roll in deg, and whether it is one of the four
/// orientations.
const WAY: [((f64, f64), bool); 14] = [
    ((0.0, 0.0), false),
    ((0.0, 180.0 - EDGE), true),
    ((0.0, EDGE - 180.0), true),
    ((0.0, -EDGE), false),
    ((-35.0, -EDGE), false),
    ((35.0, -EDGE), false),
    ((0.0, -EDGE), false),
    ((0.0, 0.0), false),
    ((EDGE, 0.0), true),
    ((EDGE, -35.0), false),
    ((EDGE, 35.0), false),
    ((EDGE, 0.0), false),
    ((-EDGE, 0.0), true),
    ((0.0, 0.0), false),
];

/// Stairs up and down, degC.
const STAIRS: [f64; 5] = [-10.0, 30.0, 70.0, 30.0, -10.0];

fn begun() -> Begun {
    let step = |temperature_degc| Step {
        temperature_degc,
        dwell_min: 40.0,
    };
    Begun {
        model: Model::Quadratic,
        chamber: "Maker,Model".to_owned(),
        turned_by: None,
        profile: Profile {
            runs: 1,
            steps: STAIRS.map(step).to_vec(),
        },
        channels: Vec::new(),
    }
}

/// A node with this calibration.
fn node(held: &Held, place: usize, calibration: Calibration) -> Node {
    let period_q8 = held.instrument.sides[place].node.channel.period_q8();
    Node {
        id: place as u8 + 1,
        channel: [Side::A, Side::B][place],
        serial: 0,
        product: 0,
        software: String::new(),
        kind: 1,
        calibrated: true,
        state: None,
        bytes: encode(&calibration),
        calibration,
        hash: None,
        presented: Vec::new(),
        heartbeat: None,
        period_s: f64::from(period_q8) / 256e6,
        changed: false,
        upset: None,
        counted: None,
    }
}

/// A simulated instrument whose nodes are calibrated at `calibrated_at` degC, with its true gains
/// there and no slopes, after a run in the chamber.
fn characterised(seed: u64, calibrated_at: f64) -> (Held, Vec<Node>, Measured) {
    let mut held = Held::new(seed, 15);
    held.heat(calibrated_at);
    let accelerometers = held.accelerometers();
    let gains = held.truth();
    let nodes = [0, 1].map(|place| {
        let real = RealRateCorrection {
            matrix: gains[place],
            ..RateCorrection::IDENTITY.real()
        };
        let mut calibration = accelerometers[place].clone();
        calibration.rates = RateCorrection::from_real(&real);
        node(&held, place, calibration)
    });
    let mut measured = Measured::new(begun(), 0);
    for (step, degc) in STAIRS.into_iter().enumerate() {
        held.heat(degc);
        let dwelt = dwell(&mut held, &nodes, step);
        measured.dwells.push(dwelt);
    }
    (held, nodes.to_vec(), measured)
}

fn dwell(held: &mut Held, nodes: &[Node], step: usize) -> Dwelt {
    held.rests.clear();
    let mut orientations = Vec::new();
    for ((pitch, roll), is_orientation) in WAY {
        let readings = held.rest(pitch, roll);
        if is_orientation {
            let felt = readings.iter().map(|reading| Felt {
                accel_g: reading.accel.map(|a| a / f64::from(ONE_G)),
                scatter_mg: 0.3,
                sensor_degc: reading.temperature_c,
                rate_rad_s: reading.rate_rad_s,
            });
            orientations.push(felt.collect());
        }
    }
    let rests: Vec<Vec<Rest>> = held.rests.iter().map(|rest| rest.to_vec()).collect();
    Dwelt {
        run: 1,
        step,
        air_degc: None,
        minutes: 40.0,
        repeated: 0,
        orientations,
        turns: followed(nodes, &held.logs, &rests),
    }
}

/// How far the scale of each axis of the housing is off with a correction, at the temperature that
/// the instrument has.
fn scale_errors(truth: [[f64; 3]; 3], rates: &RateCorrection, celsius: f64) -> [f64; 3] {
    let real = rates.real();
    let scale = real.scale1.map(|s| 1.0 + s * (celsius - 25.0));
    let sensor = invert(truth).unwrap();
    [0, 1, 2].map(|axis| {
        let mut turned = [0.0; 3];
        turned[axis] = 1.0;
        let felt = times(&sensor, turned);
        let scaled = [0, 1, 2].map(|n| felt[n] * scale[n]);
        times(&real.matrix, scaled)[axis] - 1.0
    })
}

fn largest(errors: &[[f64; 3]]) -> f64 {
    let errors = errors.as_flattened().iter();
    errors.fold(0.0, |most, error| most.max(error.abs()))
}

#[test]
fn simulated_parts_have_their_scale_right_when_they_are_hot() {
    let (mut before, mut after) = (Vec::new(), Vec::new());
    let (mut within, mut worst, mut stated) = (0, 0.0f64, [0.0f64; 3]);
    for seed in 1..=6 {
        // Calibrated warm, too: the gains have to stay right at that temperature.
        let calibrated_at = if seed % 2 == 0 { 40.0 } else { 25.0 };
        let (mut held, nodes, measured) = characterised(seed, calibrated_at);
        let made = report::make(&measured, &nodes).unwrap();
        let mut there = [(); 2].map(|()| Vec::new());
        for degc in [calibrated_at, 70.0] {
            held.heat(degc);
            let truth = held.truth();
            for place in [0, 1] {
                there[place].push((truth[place], held.celsius(place)));
            }
        }
        for place in [0, 1] {
            let found = made[place].scale_found().unwrap();
            let old = nodes[place].calibration.rates.unwrap();
            let new = made[place].calibration.rates.unwrap();
            let [(cool, cool_c), (hot, hot_c)] = there[place][..] else {
                panic!("two temperatures");
            };
            assert!(largest(&[scale_errors(cool, &new, cool_c)]) < 2e-4);
            before.push(scale_errors(hot, &old, hot_c));
            after.push(scale_errors(hot, &new, hot_c));
            // What the part's scale has done between both temperatures.
            let (hot, cool) = (
                scale_errors(hot, &old, 25.0),
                scale_errors(cool, &old, 25.0),
            );
            for axis in 0..3 {
                let truth = (cool[axis] - hot[axis]) / (hot_c - cool_c);
                let error = (found.slopes[axis] - truth).abs() / found.uncertainty[axis];
                within += usize::from(error <= 2.0);
                worst = worst.max(error);
                stated[axis] = stated[axis].max(found.uncertainty[axis]);
            }
            assert_eq!(found.open, [false; 3]);
        }
    }
    let all = 3 * after.len();
    println!(
        "{all} axes at 70 degC: largest error {:.3} % before and {:.3} % after; {within} slopes \
         within U (k = 2), worst {worst:.1} u, u at 70 degC {:.3?} % at most",
        100.0 * largest(&before),
        100.0 * largest(&after),
        stated.map(|u| 4500.0 * u)
    );
    assert!(largest(&before) > 2e-3);
    assert!(largest(&after) < 6e-4);
    assert!(10 * within >= 9 * all && worst < 3.0);
}

/// What comes of the turns of channel A after a change, with a calibrated accelerometer.
fn outcome(nodes: &[Node], measured: &Measured) -> Outcome {
    let calibration = &nodes[0].calibration;
    let before = calibration.rates.as_ref();
    scale(measured, 0, calibration, before, 0.05).unwrap()
}

/// Changes each turn of channel A, by its number in the dwell.
fn change(measured: &mut Measured, change: impl Fn(usize, &mut Followed)) {
    for dwelt in &mut measured.dwells {
        for (number, turn) in dwelt.turns.iter_mut().enumerate() {
            change(number, &mut turn[0]);
        }
    }
}

fn not_followed() -> Followed {
    Followed::LeftOut {
        left_out: "nobody looked".to_owned(),
    }
}

#[test]
fn turns_that_were_not_followed_are_left_out_and_without_tilted_ones_z_is_open() {
    let (_, mut nodes, mut measured) = characterised(1, 25.0);
    let whole = outcome(&nodes, &measured);
    assert_eq!((whole.used, &whole.left_out[..]), (65, &[][..]));
    let tilted = [4, 5, 9, 10];
    change(&mut measured, |number, turn| {
        if tilted.contains(&(number + 1)) {
            *turn = not_followed();
        }
    });
    // Slopes of before stay where they are open.
    let mut real = nodes[0].calibration.rates.unwrap().real();
    real.scale1 = [2e-5; 3];
    nodes[0].calibration.rates = RateCorrection::from_real(&real);
    let kept = nodes[0].calibration.rates.unwrap().real().scale1;
    let flat = outcome(&nodes, &measured);
    assert_eq!(flat.used, 45);
    assert_eq!(flat.left_out, [("nobody looked".to_owned(), 20)]);
    let found = flat.found.unwrap();
    assert_eq!(
        (found.open, found.slopes[2]),
        ([false, false, true], kept[2])
    );
    let whole = whole.found.unwrap();
    for axis in [0, 1] {
        let apart = (found.slopes[axis] - whole.slopes[axis]).abs();
        assert!(apart < 2.0 * found.uncertainty[axis], "{apart}");
    }
}

#[test]
fn turns_that_come_to_nothing_leave_the_slopes_and_name_the_reason() {
    let (_, mut nodes, whole) = characterised(2, 25.0);
    let refused = |nodes: &[Node], change_one: &dyn Fn(usize, &mut Followed)| {
        let mut measured = whole.clone();
        change(&mut measured, change_one);
        outcome(nodes, &measured).found.unwrap_err()
    };
    let few = refused(&nodes, &|number, turn| {
        if number != 1 {
            *turn = not_followed();
        }
    });
    assert_eq!(few, NoScale::TooFew(5, Some("nobody looked".to_owned())));
    let sentence = few.to_string();
    assert!(
        sentence.contains("of most others: nobody looked"),
        "{sentence}"
    );
    // Each turn of a gyroscope that stands still is left out by itself.
    let still = refused(&nodes, &|_, turn| {
        if let Followed::Turned(turned) = turn {
            turned.frame = RateCorrection::IDENTITY.real().matrix;
            turned.by_gain_rad = [[[0.0; 3]; 3]; 3];
        }
    });
    assert!(matches!(still, NoScale::TooFew(..)), "{still}");
    // Ends by another channel that has come loose: 12 deg, each turn its own way.
    let loose = refused(&nodes, &|number, turn| {
        if let Followed::Turned(turned) = turn {
            turned.after_g[number % 3] += 0.3;
        }
    });
    assert_eq!(loose, NoScale::Fit(FitError::Implausible));
    // One temperature only.
    let flat = refused(&nodes, &|_, turn| {
        if let Followed::Turned(turned) = turn {
            turned.turn_degc = 30.0;
        }
    });
    assert!(matches!(flat, NoScale::Open(u) if u > LARGEST), "{flat}");
    nodes[0].calibration.rates = None;
    assert_eq!(refused(&nodes, &|_, _| ()), NoScale::Uncalibrated);
    let untouched = Measured::new(begun(), 0);
    assert!(scale(&untouched, 0, &nodes[0].calibration, None, 0.05).is_none());
}

#[test]
fn a_run_that_goes_on_from_its_file_comes_to_the_same_slopes() {
    let (_, nodes, mut measured) = characterised(3, 25.0);
    measured.begun.channels = Begun::channels(&nodes);
    let scratch = tempfile::tempdir().unwrap();
    measured.save(scratch.path()).unwrap();
    let again = Measured::resume(scratch.path(), &measured.begun).unwrap();
    let [told, again] = [&measured, &again].map(|run| outcome(&nodes, run));
    assert_eq!((told.used, again.used), (65, 65));
    let (told, again) = (told.found.unwrap(), again.found.unwrap());
    for (told, again) in told.slopes.iter().zip(again.slopes) {
        // The last digit of a number in a file may be another one.
        assert!((told - again).abs() < 1e-12, "{told} {again}");
    }
    let bytes = std::fs::metadata(Measured::path(scratch.path()))
        .unwrap()
        .len();
    println!("five dwells of two channels take {} kbyte", bytes / 1000);
    assert!(bytes < 120_000, "{bytes}");
}

#[test]
fn an_axis_that_one_gyroscope_does_not_show_keeps_its_slope_in_both() {
    let (_, mut nodes, whole) = characterised(1, 25.0);
    // Each node has a slope of z of its own.
    for (node, z) in nodes.iter_mut().zip([2e-5, -3e-5]) {
        let mut real = node.calibration.rates.unwrap().real();
        real.scale1 = [0.0, 0.0, z];
        node.calibration.rates = RateCorrection::from_real(&real);
    }
    let slopes = |measured: &Measured| {
        let made = report::make(measured, &nodes).unwrap();
        let slopes = |made: &report::Made| made.calibration.rates.unwrap().real().scale1;
        let found = made.iter().map(|made| made.scale_found().is_some());
        let found: Vec<bool> = found.collect();
        (made.iter().map(slopes).collect::<Vec<_>>(), found)
    };
    let before = nodes.iter().map(|node| node.calibration.rates.unwrap());
    let before: Vec<_> = before.map(|rates| rates.real().scale1).collect();
    // The other channel shows z.
    let mut flat = whole.clone();
    let level = [1, 2, 7, 8];
    change(&mut flat, |number, turn| {
        if !level.contains(&(number + 1)) {
            *turn = not_followed();
        }
    });
    let (after, found) = slopes(&flat);
    assert_eq!(found, [true; 2]);
    for (after, before) in after.iter().zip(&before) {
        assert!(after[0] != 0.0 && after[1] != 0.0, "{after:?}");
        assert_eq!(after[2], before[2]);
    }
    // The other channel shows all.
    let mut none = whole.clone();
    change(&mut none, |_, turn| *turn = not_followed());
    assert_eq!(slopes(&none), (before, vec![false; 2]));
}
