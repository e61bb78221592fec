//! Each fault does what was set, healing ends it, and the part's own noise does not notice.

use super::*;

use device::sensor::Part;

use crate::TICK_S;
use crate::bench::Mode;
use crate::electronics::{Driver, Electronics};
use crate::error_model::ErrorModel;
use crate::motion::Motion;
use crate::rng::Rng;

/// Codes per g of a left-justified sample at +-2 g, and its step.
const PER_G: f64 = 16384.0;
const STEP: i32 = 4;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Sample {
    at_s: f64,
    captured_s: f64,
    codes: [i16; 3],
}

/// One side whose code only keeps what it reads.
struct Side {
    electronics: Electronics,
    part: Driver,
    ticks: u64,
}

impl Side {
    fn new(model: &ErrorModel) -> Self {
        let electronics = Electronics::new(model, Rng::stream(5, "side"));
        let part = electronics.driver();
        let mut side = Self {
            electronics,
            part,
            ticks: 0,
        };
        assert!(side.start());
        side
    }

    /// Sets the part up; false when it does not answer.
    fn start(&mut self) -> bool {
        self.electronics.catch_up(self.ticks as f64 * TICK_S);
        let config = Mode::Product.settings().part;
        let part = &mut self.part;
        let answers =
            (self.electronics).run_waiting(|mut delay, _| Part::init(part, &config, &mut delay));
        self.ticks = (self.electronics.now_s() / TICK_S).ceil() as u64;
        answers.is_ok()
    }

    fn run_at(&mut self, force_g: [f64; 3], duration_s: f64) -> Vec<Sample> {
        let mut samples = Vec::new();
        let motion = Motion {
            force_g,
            ..Motion::default()
        };
        for _ in 0..(duration_s / TICK_S).round() as u64 {
            self.ticks += 1;
            let part = &mut self.part;
            let time_s = self.ticks as f64 * TICK_S;
            self.electronics.tick(&motion, time_s, |edge| {
                let sample = part.read().expect("a working bus").expect("a sample");
                samples.push(Sample {
                    at_s: edge.at_s,
                    captured_s: edge.captured_s,
                    codes: sample.counts.0,
                });
            });
        }
        samples
    }

    fn run(&mut self, duration_s: f64) -> Vec<Sample> {
        self.run_at([0.3, -0.5, 0.8], duration_s)
    }
}

fn rng() -> Rng {
    Rng::stream(5, "fault")
}

/// A second with the fault on one side, and the same second of its twin without; then heals it
/// and sees that both are the same again, bit for bit.
fn beside_its_twin(fault: SensorFault) -> (Vec<Sample>, Vec<Sample>) {
    let [mut faulty, mut well] = [0, 1].map(|_| Side::new(&ErrorModel::NOMINAL));
    assert_eq!(faulty.run(0.2), well.run(0.2));
    faulty.electronics.inject(fault, rng());
    assert_eq!(faulty.electronics.fault(), Some(fault));
    let seconds = (faulty.run(1.0), well.run(1.0));
    faulty.electronics.heal();
    assert_eq!(faulty.electronics.fault(), None);
    let (healed, sound) = (faulty.run(0.5), well.run(0.5));
    assert!(healed.len() > 180);
    assert_eq!(healed, sound, "{fault}");
    seconds
}

/// How far off the codes are, sample by sample.
fn differences(fault: SensorFault) -> Vec<[i32; 3]> {
    let (faulty, well) = beside_its_twin(fault);
    assert_eq!(faulty.len(), well.len());
    let pairs = faulty.iter().zip(&well);
    pairs
        .map(|(a, b)| {
            assert_eq!((a.at_s, a.captured_s), (b.at_s, b.captured_s));
            [0, 1, 2].map(|i| i32::from(a.codes[i]) - i32::from(b.codes[i]))
        })
        .collect()
}

fn sigma(samples: &[Sample], axis: usize) -> f64 {
    let values = samples.iter().map(|s| f64::from(s.codes[axis]));
    let count = samples.len() as f64;
    let mean = values.clone().sum::<f64>() / count;
    (values.map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt()
}

#[test]
fn a_bias_step_moves_its_axis_and_no_other() {
    let want = (0.005 * PER_G) as i32;
    for [x, y, z] in differences(SensorFault::Bias { axis: 1, mg: 5.0 }) {
        assert!((y - want).abs() <= STEP, "{y}");
        assert_eq!([x, z], [0, 0]);
    }
}

#[test]
fn a_drift_begins_with_nothing_and_grows() {
    let axis = 0;
    let mg_per_s = 20.0;
    let off = differences(SensorFault::Drift { axis, mg_per_s });
    let count = off.len() as f64;
    for ([x, y, z], number) in off.into_iter().zip(1..) {
        let want = 0.02 * PER_G * f64::from(number) / count;
        assert!((f64::from(x) - want).abs() < f64::from(2 * STEP), "{x}");
        assert_eq!([y, z], [0, 0]);
    }
}

#[test]
fn a_gain_fault_scales_what_is_measured() {
    let fault = SensorFault::Gain {
        axis: 2,
        ratio: -0.02,
    };
    let (faulty, well) = beside_its_twin(fault);
    for (faulty, well) in faulty.iter().zip(&well) {
        let want = f64::from(well.codes[2]) * 0.98;
        assert!((f64::from(faulty.codes[2]) - want).abs() <= f64::from(STEP));
        assert_eq!(faulty.codes[..2], well.codes[..2]);
    }
}

#[test]
fn a_stuck_axis_repeats_its_code_and_the_others_live() {
    let (faulty, well) = beside_its_twin(SensorFault::Stuck { axis: Some(1) });
    for (one, twin) in faulty.iter().zip(&well) {
        assert_eq!(one.codes[1], well[0].codes[1]);
        assert_eq!([one.codes[0], one.codes[2]], [twin.codes[0], twin.codes[2]]);
    }
    let (faulty, well) = beside_its_twin(SensorFault::Stuck { axis: None });
    assert!(faulty.iter().all(|sample| sample.codes == well[0].codes));
    assert!(faulty.len() > 380);
}

#[test]
fn a_stuck_part_is_stuck_in_its_self_test_too() {
    let mut side = Side::new(&ErrorModel::NOMINAL);
    let stuck = SensorFault::Stuck { axis: None };
    side.electronics.inject(stuck, rng());
    let part = &mut side.part;
    let test = (side.electronics)
        .run_waiting(|mut delay, _| part.lis2dw12().expect("an LIS2DW12").self_test(&mut delay));
    assert!(test.is_ok_and(|test| !test.within_data_sheet()));
}

#[test]
fn noise_grows_by_its_factor() {
    for factor in [3.0, 10.0] {
        let (faulty, well) = beside_its_twin(SensorFault::Noise { factor });
        for axis in 0..3 {
            let ratio = sigma(&faulty, axis) / sigma(&well, axis);
            assert!((ratio / factor - 1.0).abs() < 0.05, "{ratio}");
        }
    }
}

#[test]
fn spikes_are_single_samples_and_the_first_comes_at_once() {
    let off = differences(SensorFault::Spikes {
        g: 0.2,
        per_s: 20.0,
    });
    let hit = |off: &[i32; 3]| off.iter().any(|o| *o != 0);
    assert!(hit(&off[0]), "{:?}", off[0]);
    let spikes: Vec<_> = off.iter().filter(|off| hit(off)).collect();
    assert!((10..35).contains(&spikes.len()), "{}", spikes.len());
    for spike in &spikes {
        let sizes: Vec<_> = spike.iter().filter(|o| **o != 0).collect();
        assert_eq!(sizes.len(), 1);
        assert!((sizes[0].abs() - (0.2 * PER_G) as i32).abs() <= STEP);
    }
    let on = |axis: usize| spikes.iter().any(|spike| spike[axis] != 0);
    assert!(on(0) && on(1) && on(2));
    assert!(spikes.iter().any(|s| s.iter().sum::<i32>() < 0));
}

#[test]
fn without_a_rate_there_is_one_spike() {
    let off = differences(SensorFault::Spikes { g: 0.2, per_s: 0.0 });
    let hits = off.iter().filter(|off| **off != [0; 3]).count();
    assert_eq!(hits, 1);
}

#[test]
fn late_samples_keep_their_time_and_are_as_late_as_was_set() {
    for late_s in [0.05, 0.2] {
        let (faulty, well) = beside_its_twin(SensorFault::Late { s: late_s });
        assert_eq!(faulty.len(), well.len());
        let period_s = well[1].at_s - well[0].at_s;
        for (sample, twin) in faulty.iter().zip(&well) {
            assert_eq!(sample.at_s, twin.at_s);
            let original = well.iter().find(|w| w.captured_s == sample.captured_s);
            assert_eq!(sample.codes, original.expect("a true sample").codes);
            let age_s = sample.at_s - sample.captured_s;
            if twin.at_s < well[0].at_s + late_s {
                assert_eq!(sample.captured_s, well[0].captured_s);
            } else {
                assert!((age_s - late_s).abs() <= period_s, "{age_s}");
            }
        }
    }
}

#[test]
fn lost_edges_are_as_many_as_was_set_and_the_rest_is_true() {
    let (faulty, well) = beside_its_twin(SensorFault::SampleLoss { share: 0.1 });
    let lost = 1.0 - faulty.len() as f64 / well.len() as f64;
    assert!((0.06..0.14).contains(&lost), "{lost}");
    assert!(faulty.iter().all(|sample| well.contains(sample)));
}

#[test]
fn swapped_axes_are_swapped() {
    let (faulty, well) = beside_its_twin(SensorFault::SwappedAxes);
    for (faulty, well) in faulty.iter().zip(&well) {
        let [x, y, z] = well.codes;
        assert_eq!(faulty.codes, [y, x, z]);
    }
}

#[test]
fn a_sag_lasts_until_it_is_healed() {
    let mut side = Side::new(&ErrorModel::NOMINAL);
    side.run(0.2);
    let before = sigma(&side.run(1.0), 0);
    side.electronics.inject(SensorFault::Sag, rng());
    // Long enough for the wander, and a stretch short enough not to see it.
    let sagging = side.run(20.0);
    let short = sigma(&sagging[sagging.len() - 20..], 0);
    assert!(short > 1.4 * before, "{short} {before}");
    assert!(sigma(&sagging, 0) > 4.0 * before);
    side.electronics.heal();
    let after = sigma(&side.run(1.0), 0);
    assert!((after / before - 1.0).abs() < 0.15, "{after} {before}");
}

#[test]
fn a_brown_out_leaves_the_part_reset_until_it_is_set_up() {
    let mut side = Side::new(&ErrorModel::NOMINAL);
    assert!(side.run(0.1).len() > 35);
    side.electronics
        .inject(SensorFault::BrownOut { s: 0.01 }, rng());
    assert_eq!(side.run(0.5), []);
    side.electronics.heal();
    assert_eq!(side.run(0.5), []);
    assert!(side.start());
    assert!(side.run(0.1).len() > 35);
}

#[test]
fn a_part_does_not_start_while_its_supply_is_away() {
    let mut side = Side::new(&ErrorModel::NOMINAL);
    side.electronics
        .inject(SensorFault::BrownOut { s: 0.3 }, rng());
    side.run(0.15);
    assert!(!side.start());
    side.run(0.2);
    assert!(side.start());
    assert!(side.run(0.1).len() > 35);
}

#[test]
fn a_thermometer_is_off_and_the_force_is_not() {
    let [mut faulty, mut well] = [0, 1].map(|_| Side::new(&ErrorModel::NOMINAL));
    let fault = SensorFault::Thermometer { c: 5.0 };
    faulty.electronics.inject(fault, rng());
    assert_eq!(faulty.run(0.5), well.run(0.5));
    let read = |side: &mut Side| {
        side.run(0.1);
        f64::from(side.part.read_temperature().expect("a working bus").0) / 256.0
    };
    let off = read(&mut faulty) - read(&mut well);
    assert!((off - 5.0).abs() < 0.1, "{off}");
    faulty.electronics.heal();
    assert_eq!(read(&mut faulty), read(&mut well));
}

#[test]
fn one_stream_gives_one_fault_and_another_one_another() {
    let run = |label| {
        let mut side = Side::new(&ErrorModel::NOMINAL);
        let fault = SensorFault::SampleLoss { share: 0.3 };
        side.electronics.inject(fault, Rng::stream(1, label));
        side.run(1.0)
    };
    assert_eq!(run("a"), run("a"));
    assert_ne!(run("a"), run("b"));
}

#[test]
fn an_axis_that_is_none_has_no_effect() {
    let axis = 3;
    for fault in [
        SensorFault::Bias { axis, mg: 5.0 },
        SensorFault::Stuck { axis: Some(axis) },
    ] {
        assert!(differences(fault).iter().all(|off| *off == [0; 3]));
    }
}
