//! The figures that real recordings must give at the end of the whole chain: `docs/recordings.md`
//! quotes what these tests print. The recordings lie beside the checkout, not in it; where they
//! are missing each test prints this and passes.

use std::path::{Path, PathBuf};

use super::arguments::{Arguments, Mode, Options};
use super::calibration_file;
use super::gather;
use super::prepare::{Prepared, prepare};
use crate::report::replay_data::{Plateau, ReplayReport, SlopeSeries};
use crate::report::tables::axis_name;
use output::progress::Progress;

const PAGE: &str = include_str!("../../../../docs/recordings.md");

/// Prints a row of a table, which must stand in the page as it is.
pub fn documented(cells: &[&str]) {
    let row = format!("| {} |", cells.join(" | "));
    println!("{row}");
    assert!(PAGE.contains(&row), "not in docs/recordings.md: {row}");
}

fn mode_word(mode: Mode) -> &'static str {
    match mode {
        Mode::Paper => "paper",
        Mode::Product => "product",
    }
}

/// What replays these recordings; `None` with a word on it where one is missing.
pub fn arguments(names: &[&str], mode: Mode) -> Option<Arguments> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let files: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
    if let Some(missing) = files.iter().find(|file| !file.exists()) {
        println!("skipped: recording not present ({})", missing.display());
        return None;
    }
    Some(Arguments {
        files,
        options: Options {
            mode: Some(mode),
            ..Options::default()
        },
        ..Arguments::default()
    })
}

/// Replays.
pub fn replayed(arguments: &Arguments) -> (Vec<Prepared>, ReplayReport) {
    let progress = Progress::hidden();
    let (channels, notes) = prepare(arguments, &progress).unwrap();
    let report = gather::report(&channels, notes, arguments.options.mode.unwrap(), &progress);
    (channels, report)
}

/// Root mean square over both slopes of the plateaus that both runs measured, and their number.
fn back_deg(one: &[Plateau], other: &[Plateau]) -> (f64, usize) {
    let differences = one.iter().zip(other).filter_map(|(a, b)| {
        let reference = (a.reference_x_deg? - b.reference_x_deg?)
            .hypot(a.reference_y_deg? - b.reference_y_deg?);
        assert!(reference < 1.0, "{a:?} and {b:?} are not the same plateau");
        Some((a.x_deg? - b.x_deg?, a.y_deg? - b.y_deg?))
    });
    let squares: Vec<f64> = differences.map(|(x, y)| x * x + y * y).collect();
    let mean = squares.iter().sum::<f64>() / (2 * squares.len()) as f64;
    (mean.sqrt(), squares.len())
}

fn at_plateaus_deg(slopes: &[SlopeSeries]) -> f64 {
    let of = |slope: &SlopeSeries| slope.accuracy_at_plateaus.as_ref()?.rmse_deg;
    let squares: f64 = slopes.iter().filter_map(of).map(|rmse| rmse * rmse).sum();
    (squares / 2.0).sqrt()
}

#[test]
fn angles_of_the_robots_slow_run_come_back_on_the_fast_one() {
    for (sensor, mode) in [
        ("lsm9ds0", Mode::Product),
        ("lsm9ds0", Mode::Paper),
        ("mpu9150", Mode::Product),
        ("mpu9150", Mode::Paper),
    ] {
        let run = |speed: u32| arguments(&[&format!("abb-robot/{speed}mm_s_{sensor}.csv")], mode);
        let (Some(slow), Some(mut fast)) = (run(300), run(500)) else {
            return;
        };
        let (channels, slow) = replayed(&slow);
        let kept = std::env::temp_dir().join(format!(
            "plumb-robot-{sensor}-{mode:?}-{}.json",
            std::process::id()
        ));
        let records: Vec<_> = channels.into_iter().map(|channel| channel.record).collect();
        let staged =
            calibration_file::stage(&kept, &records, output::write::Existing::Keep).unwrap();
        staged.put_in_place().unwrap();
        fast.options.calibration = Some(kept.clone());
        let (_, fast) = replayed(&fast);
        std::fs::remove_file(kept).unwrap();
        let (slow, fast) = (&slow.channels[0], &fast.channels[0]);
        let (back, pairs) = back_deg(&slow.plateaus, &fast.plateaus);
        documented(&[
            sensor,
            mode_word(mode),
            &pairs.to_string(),
            &format!("{back:.3}"),
            &format!("{:.2}", at_plateaus_deg(&slow.slopes)),
            &format!("{:.2}", at_plateaus_deg(&fast.slopes)),
        ]);
        assert!(pairs >= 6, "{sensor}: {pairs}");
        assert!(back <= 0.30, "{sensor} {mode:?}: {back}");
        // The mount gives: this is what it costs, not what the chain costs.
        assert!((0.8..2.5).contains(&at_plateaus_deg(&fast.slopes)));
    }
}

const BOARD: [&str; 2] = ["mimu4444/exp1_imu1.csv.gz", "mimu4444/exp1_imu3.csv.gz"];

#[test]
fn two_channels_of_one_board_through_the_whole_chain() {
    for (mode, most_deg) in [(Mode::Paper, 0.25), (Mode::Product, 0.20)] {
        let Some(arguments) = arguments(&BOARD, mode) else {
            return;
        };
        let (_, report) = replayed(&arguments);
        for channel in &report.channels {
            let residual = channel.calibration.residual_mg.unwrap();
            documented(&[
                &channel.file,
                mode_word(mode),
                &channel.calibration.poses.unwrap().to_string(),
                &format!("{residual:.3}"),
            ]);
            assert_eq!(channel.calibration.poses, Some(21));
            assert!(residual <= 0.25, "{residual}");
        }
        let check = report.cross_check.unwrap();
        let deltas: Vec<f64> = check
            .slopes
            .iter()
            .filter_map(|slope| slope.standstill_rms_deg)
            .collect();
        documented(&[
            mode_word(mode),
            &format!("{:.3}", deltas[0]),
            &format!("{:.3}", deltas[1]),
            &check.compared.to_string(),
            &check.stops.to_string(),
            &check.faults.to_string(),
        ]);
        assert!(deltas.iter().all(|delta| (0.1..most_deg).contains(delta)));
        assert!(check.compared > 29_000);
    }
}

#[test]
fn reported_noise_is_the_scatter_of_the_poses() {
    for mode in [Mode::Paper, Mode::Product] {
        let Some(arguments) = arguments(&BOARD, mode) else {
            return;
        };
        let (_, report) = replayed(&arguments);
        for channel in &report.channels {
            for slope in &channel.slopes {
                let found = slope.standstill.as_ref().unwrap();
                let ratio = found.noise_deg / found.scatter_deg;
                documented(&[
                    &channel.file,
                    mode_word(mode),
                    axis_name(slope.axis),
                    &format!("{:.3}", found.noise_deg),
                    &format!("{:.3}", found.scatter_deg),
                    &format!("{ratio:.2}"),
                ]);
                assert!((0.8..=1.2).contains(&ratio), "{ratio}");
                assert!(found.uncertainty_deg >= found.noise_deg);
            }
        }
    }
}
