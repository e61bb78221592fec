//! The vertical under motion on real recordings: ten trials of the BROAD benchmark (Data 6(7):72,
//! 2021), a six-axis sensor carried by hand in front of cameras.
//!
//! The benchmark's metric: angle between the estimated and the true vertical, root mean square
//! over the samples that are marked as moving and that the cameras saw, mean over the trials. The
//! recordings lie beside the checkout, not in it; where they are missing the test says so and
//! passes. `docs/recordings.md` quotes what it prints.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;
use tilt::motion::{Expected, Motion, MotionState, RATE_STEPS, Rate, Vertical};
use tilt::vector::Corrected;

use super::reference::angle_between_deg;

const PAGE: &str = include_str!("../../../../docs/recordings.md");

const G: f64 = 9.80665;

const TRIALS: [&str; 10] = [
    "01_undisturbed_slow_rotation_A",
    "04_undisturbed_slow_rotation_with_breaks_A",
    "06_undisturbed_fast_rotation_A",
    "08_undisturbed_fast_rotation_with_breaks_A",
    "10_undisturbed_slow_translation_A",
    "14_undisturbed_slow_translation_with_breaks_B",
    "15_undisturbed_fast_translation_A",
    "21_undisturbed_fast_combined",
    "24_disturbed_tapping_A",
    "26_disturbed_phone_vibration_A",
];

/// The recordings' sensor: 2 000 samples in 7 s.
const SENSOR: Expected = Expected {
    period_s: 0.0035,
    ..Expected::INDUSTRIAL
};

/// How late the sensor is against the cameras, s: 2.2 to 2.7 ms in each trial of fast turns.
const DELAY_S: f64 = 0.0024;

/// One row of a recording.
struct Sample {
    rate: Rate,
    accel: Corrected,
    /// The true vertical, where it counts.
    up: Option<[f64; 3]>,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/broad")
}

fn samples(trial: &str) -> Vec<Sample> {
    let file = File::open(folder().join(format!("{trial}.csv.gz"))).unwrap();
    let text = io::read_to_string(MultiGzDecoder::new(file)).unwrap();
    text.lines().skip(1).map(sample).collect()
}

fn sample(line: &str) -> Sample {
    let cells: Vec<Option<f64>> = line.split(',').map(|cell| cell.parse().ok()).collect();
    let real = |at: usize| cells[at].unwrap();
    let steps = |value: f64, per_unit: f64| (value * per_unit).round() as i32;
    let reference = [7, 8, 9, 10].map(|at| cells[at]);
    let up = match (reference, cells[11]) {
        ([Some(w), Some(x), Some(y), Some(z)], Some(1.0)) => Some([
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ]),
        _ => None,
    };
    Sample {
        rate: Rate {
            rate: [1, 2, 3].map(|at| steps(real(at), RATE_STEPS)),
        },
        accel: Corrected {
            accel: [4, 5, 6].map(|at| steps(real(at) / G, f64::from(tilt::ONE_G))),
        },
        up,
    }
}

/// What one trial gives.
#[derive(Default)]
struct Outcome {
    samples: u32,
    without: u32,
    square: f64,
    within_two: u32,
    within_three: u32,
    stated: f64,
}

impl Outcome {
    fn take(&mut self, vertical: &Vertical, up: [f64; 3]) {
        let estimated = vertical.up.map(|v| f64::from(v) / f64::from(1 << 30));
        let error = angle_between_deg(estimated, up);
        let stated = vertical.uncertainty.degrees();
        self.samples += 1;
        self.square += error * error;
        self.stated += stated;
        self.within_two += u32::from(error <= 2.0 * stated);
        self.within_three += u32::from(error <= 3.0 * stated);
    }

    fn rms_deg(&self) -> f64 {
        (self.square / f64::from(self.samples)).sqrt()
    }

    fn share(&self, count: u32) -> f64 {
        f64::from(count) / f64::from(self.samples)
    }
}

fn follow(motion: &Motion, samples: &[Sample]) -> Outcome {
    let mut state = MotionState::default();
    let mut outcome = Outcome::default();
    for sample in samples {
        let vertical = motion.step(&mut state, sample.rate, sample.accel);
        match (vertical, sample.up) {
            (Ok(vertical), Some(up)) => outcome.take(&vertical, up),
            (Err(_), Some(_)) => outcome.without += 1,
            _ => (),
        }
    }
    outcome
}

#[test]
fn the_vertical_under_motion_and_its_uncertainty() {
    if !folder().exists() {
        println!("skipped: recording not present (broad)");
        return;
    }
    let with = |delay_s| Motion::new(&Expected { delay_s, ..SENSOR }).unwrap();
    let (late, now) = (with(0.0), with(DELAY_S));
    let mut sums = [0.0; 2];
    for trial in TRIALS {
        let samples = samples(trial);
        let outcomes = [follow(&late, &samples), follow(&now, &samples)];
        documented(trial, &outcomes);
        assert!(outcomes[0].rms_deg() < 1.2, "{trial}");
        for (sum, outcome) in sums.iter_mut().zip(&outcomes) {
            *sum += outcome.rms_deg() / TRIALS.len() as f64;
            assert_eq!(outcome.without, 0, "{trial}");
            assert!(outcome.share(outcome.within_two) > 0.93, "{trial}");
            assert!(outcome.share(outcome.within_three) > 0.98, "{trial}");
        }
    }
    let row = format!("| mean | {:.3} | {:.3} | | | |", sums[0], sums[1]);
    println!("{row}");
    assert!(PAGE.contains(&row), "not in docs/recordings.md: {row}");
}

/// Prints the row of a trial, which must stand in the page as it is.
fn documented(trial: &str, [as_it_comes, now]: &[Outcome; 2]) {
    let row = format!(
        "| {} | {:.3} | {:.3} | {:.1} | {:.2} | {:.2} |",
        &trial[..2],
        as_it_comes.rms_deg(),
        now.rms_deg(),
        100.0 * now.share(now.within_two),
        100.0 * now.share(now.within_three),
        now.stated / f64::from(now.samples)
    );
    println!("{row}");
    assert!(PAGE.contains(&row), "not in docs/recordings.md: {row}");
}
