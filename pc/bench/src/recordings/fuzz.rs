//! Recordings and calibration files as chance makes them: never a panic, always an answer.

use std::fmt::Write as _;
use std::io::{Cursor, Write as _};

use flate2::{Compression, write::GzEncoder};
use proptest::prelude::*;

use super::arguments::Mode;
use super::calibrate::{calibrate_from_poses, calibrate_from_reference};
use super::calibration_file;
use super::error::FileError;
use super::play::{play, tests::identity};
use super::recording::{Options, Recording};
use super::segments;
use super::tuning;
use output::progress::Progress;

/// Through the chain, in an order of time and in a bounded time.
fn play_through(recording: Recording) -> Result<(), TestCaseError> {
    let rows = recording.rows.len();
    let channels = [identity(recording, 0)];
    let chains = tuning::chains(&channels, Mode::Product);
    let (mut count, mut last) = (0, None);
    play(
        &channels,
        &chains,
        Mode::Product,
        &Progress::hidden(),
        |moment| {
            assert!(last < Some(moment.now));
            last = Some(moment.now);
            count += 1;
        },
    );
    // 20 s of 50 Hz around each row at most.
    prop_assert!(count <= 1001 * rows, "{count} readings of {rows} rows");
    Ok(())
}

/// What must hold whatever came in.
fn examine(bytes: &[u8]) -> Result<(), TestCaseError> {
    match Recording::read("fuzz.csv", Cursor::new(bytes.to_vec()), Options::default()) {
        Ok(recording) => {
            let kept = recording.rows.len() as u64;
            prop_assert_eq!(kept + recording.skips.total(), recording.data_lines);
            prop_assert!(kept >= recording.skips.total());
            prop_assert!(
                recording
                    .rows
                    .windows(2)
                    .all(|w| w[0].time_us < w[1].time_us)
            );
            prop_assert!(
                recording
                    .rows
                    .iter()
                    .flat_map(|r| r.accel_g)
                    .all(|a| a.abs() <= 16.0)
            );
            let found = segments::find(&recording, segments::Options::for_recording(&recording));
            let _ = calibrate_from_poses(&found.segments);
            let _ = calibrate_from_reference(&found.segments);
            play_through(recording)?;
        }
        Err(error) => {
            let text = error.to_string();
            prop_assert!(text.starts_with("fuzz.csv"), "{}", text);
            prop_assert!(
                text.len() > 20 && !text.contains(char::is_control),
                "{}",
                text
            );
        }
    }
    Ok(())
}

/// A sound recording with a temperature and a reference.
fn sound() -> Vec<u8> {
    let mut text = "time_s,ax_g,ay_g,az_g,temp_c,ref_qw,ref_qx,ref_qy,ref_qz\n".to_owned();
    for i in 0..120 {
        let wobble = f64::from(i % 7) * 1e-3;
        let t = f64::from(i) * 0.016;
        writeln!(
            text,
            "{t:.3},{wobble:.4},0.5,{:.4},25.1,0.7,0,-0.7,0",
            0.86 - wobble
        )
        .unwrap();
    }
    text.into_bytes()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Changes some bytes and cuts the end off.
fn mutate(mut bytes: Vec<u8>, changes: &[(prop::sample::Index, u8)], keep: f64) -> Vec<u8> {
    for (place, value) in changes {
        let place = place.index(bytes.len());
        bytes[place] = *value;
    }
    bytes.truncate((bytes.len() as f64 * keep) as usize);
    bytes
}

fn changes() -> impl Strategy<Value = Vec<(prop::sample::Index, u8)>> {
    prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..12)
}

/// A cell as careless loggers write it.
fn cell() -> impl Strategy<Value = String> {
    prop_oneof![
        8 => (-2.0f64..2.0).prop_map(|v| format!("{v:.4}")),
        1 => any::<f64>().prop_map(|v| format!("{v:e}")),
        1 => "[ \"a-z0-9.+#;-]{0,6}",
        1 => prop::sample::select(vec!["", "0", "nan", "-inf", "1e999", "1,5", "\u{fffd}"])
            .prop_map(str::to_owned),
    ]
}

#[test]
fn the_sound_one_is_sound() {
    let read = Recording::read("fuzz.csv", Cursor::new(sound()), Options::default()).unwrap();
    assert_eq!(
        (read.rows.len(), read.skips.total(), read.unread_extras.rows),
        (120, 0, 0)
    );
}

proptest! {
    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        examine(&bytes)?;
        examine(&[&[0x1f, 0x8b], bytes.as_slice()].concat())?;
        examine(&[b"time_s,ax_g,ay_g,az_g\n", bytes.as_slice()].concat())?;
    }

    #[test]
    fn a_sound_file_with_some_bytes_changed(changes in changes(), keep in 0.0f64..1.2) {
        examine(&mutate(sound(), &changes, keep))?;
        examine(&mutate(gzip(&sound()), &changes, keep))?;
        examine(&gzip(&mutate(sound(), &changes, keep)))?;
    }

    #[test]
    fn any_cells(
        header in prop::sample::subsequence(
            vec!["time_s", "ax_g", "ay_g", "az_g", "ax_lsb", "temp_c", "ref_x_deg", "ref_y_deg"],
            0..=8,
        ),
        cells in prop::collection::vec(prop::collection::vec(cell(), 3..9), 0..150),
    ) {
        let mut text = header.join(",");
        for (i, row) in cells.iter().enumerate() {
            write!(text, "\n{},{}", i as f64 * 0.01, row.join(",")).unwrap();
        }
        examine(text.as_bytes())?;
        let fixed = format!("time_s,ax_g,ay_g,az_g{}", &text[header.join(",").len()..]);
        examine(fixed.as_bytes())?;
    }

    #[test]
    fn a_calibration_file_with_some_bytes_changed(changes in changes(), keep in 0.5f64..1.2) {
        let sound = calibration_file::to_text(&[calibration_file::tests::channel()]).unwrap();
        let unchanged = calibration_file::from_text(sound.as_bytes(), 1).unwrap();
        let text = mutate(sound.as_bytes().to_vec(), &changes, keep);
        match calibration_file::from_text(&text, 1) {
            Ok(channels) => {
                // Spaces may change; the channels may not.
                prop_assert_eq!(channels, unchanged);
            }
            Err(problem) => {
                let error = FileError::of_file("fuzz.json", problem);
                prop_assert!(error.to_string().starts_with("fuzz.json: "));
                prop_assert!(!error.to_string().contains(char::is_control));
            }
        }
    }
}
