//! Recordings made of a few lines, played: what is read when, and what is stepped over.

use std::io::Cursor;

use super::*;
use crate::recordings::calibration_file::Channel;
use crate::recordings::calibration_file::tests::channel as some_calibration;
use crate::recordings::prepare::Prepared;
use crate::recordings::recording::{Options, Recording};
use crate::recordings::segments::{self, Standstill};
use crate::recordings::steady::steady;
use crate::recordings::tuning;
use crate::report::replay_data::{CalibrationKind, ReplayCalibration};
use tilt::chain::Invalid;
use tilt::vector::Vector;

/// A level sensor at 100 Hz over these spans of time, in samples.
fn prepared(spans: &[(u64, u64)], offset_us: u64) -> Prepared {
    let mut text = "time_us,ax_g,ay_g,az_g\n".to_owned();
    for at in spans.iter().flat_map(|&(from, to)| from..to) {
        text.push_str(&format!("{},0,0,1\n", at * 10_000));
    }
    let recording = Recording::read("test.csv", Cursor::new(text), Options::default()).unwrap();
    identity(recording, offset_us)
}

/// A recording with a calibration that leaves it as it is.
pub fn identity(recording: Recording, offset_us: u64) -> Prepared {
    let found: Standstill = segments::find(&recording, segments::Options::POSES);
    let mut record = Channel::with_vector(some_calibration(), &Vector::IDENTITY);
    record.temperature = None;
    Prepared {
        steady: steady(&recording),
        recording,
        standstill: found,
        offset_us,
        record,
        how: ReplayCalibration {
            kind: CalibrationKind::File,
            poses: None,
            residual_mg: None,
            residual_deg: None,
            condition: None,
        },
        rate_delay_s: 0.0,
    }
}

fn played(channels: &[Prepared], mode: Mode) -> Vec<Moment> {
    let chains = tuning::chains(channels, mode);
    let mut moments = Vec::new();
    play(channels, &chains, mode, &Progress::hidden(), |moment| {
        moments.push(moment);
    });
    moments
}

#[test]
fn product_is_read_at_50_hz_and_paper_at_each_row() {
    let one = [prepared(&[(0, 200)], 0)];
    let product = played(&one, Mode::Product);
    assert_eq!(product.len(), 100);
    let paper = played(&one, Mode::Paper);
    assert_eq!(paper.len(), 200);
    assert_eq!(paper[7].now, Instant(70_000));
    assert!(product.iter().chain(&paper).all(|m| m.peer.is_none()));
    // 128 samples of settling at 100 Hz.
    assert_eq!(product[60].own.x, Err(Invalid::Settling));
    let read = product[90].own.x.unwrap();
    assert_eq!(read.at.0 + u64::from(read.latency_us), 90 * 20_000);
}

#[test]
fn a_channel_that_falls_silent_is_seen_until_the_other_ends() {
    for mode in [Mode::Product, Mode::Paper] {
        // Channel 1 ends after 2 s, channel 2 began 0.5 s late and goes on to 3.5 s.
        let pair = [prepared(&[(0, 200)], 0), prepared(&[(0, 300)], 500_000)];
        let moments = played(&pair, mode);
        assert_eq!(moments[0].peer.unwrap().x, Err(Invalid::NoSample));
        let last = moments.last().unwrap();
        assert!(last.now.0 >= 3_480_000, "{:?}", last.now);
        assert_eq!(last.own.x, Err(Invalid::Stale));
        assert!(last.peer.unwrap().x.is_ok());
    }
}

#[test]
fn years_without_a_row_are_stepped_over_and_the_chain_starts_anew() {
    for mode in [Mode::Product, Mode::Paper] {
        let year = 365 * 86_400 * 100;
        let one = [prepared(&[(0, 200), (year, year + 200)], 0)];
        let moments = played(&one, mode);
        assert!(moments.len() < 5_000, "{}", moments.len());
        assert!(moments.windows(2).all(|pair| pair[0].now < pair[1].now));
        let settling = moments
            .iter()
            .filter(|m| m.own.x == Err(Invalid::Settling))
            .filter(|m| m.now.0 > 1_000_000_000);
        assert!(settling.count() > 50);
        assert!(moments.last().unwrap().own.x.is_ok());
    }
}
