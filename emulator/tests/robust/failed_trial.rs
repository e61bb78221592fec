//! Programs that arrive whole and signed, and do not work: the node goes back by itself.
//!
//! In: an update to a program that hangs, that crashes, or that never has an angle. Out: three
//! starts of it, and then the old program, which reports what became of the new one and measures.

use emulator::chip::rcc::Cause;
use emulator::pair::SdoError;
use flash::slots::ATTEMPTS;
use sim::fault::SensorFault;
use sim::rng::Rng;

use crate::bench::Bench;
use crate::update::{begin, body, body_that_begins_with, file, send};

/// B to itself.
const HANG: u16 = 0xE7FE;
/// UDF: undefined for ever.
const CRASH: u16 = 0xDE00;

/// 1F57h of an image that is not signed by whom it has to be: its error and the slot's.
const FORGED: u32 = 7 << 1 | 5 << 16;

/// What each attempt ended with, and the error codes of the EMCYs since the update.
struct Story {
    attempts: Vec<Cause>,
    told: Vec<u16>,
}

/// Updates to this body; what has happened until the old program runs again, within `seconds`.
fn rolled_back(bench: &mut Bench, body: &[u8], seconds: f64) -> Story {
    let old = bench.shown();
    send(bench, &file(body)).expect("a whole image");
    let resets = bench.resets().len();
    bench.pair.heard.clear();
    begin(bench).expect("a signed one");
    for _ in 0..(seconds * 10.0) as usize {
        bench.pair.run(0.1);
        if bench.resets().len() == resets + 1 + usize::from(ATTEMPTS) {
            break;
        }
    }
    bench.pair.run(1.5);
    let shown = bench.shown();
    let [version, slot, _] = old.program;
    let expected = crate::bench::Shown {
        program: [version, slot, 2],
        ..old
    };
    assert_eq!(shown, expected);
    assert_eq!(bench.broken_rules(), 0);
    // The first reset is the command's.
    let attempts = bench.resets()[resets + 1..].to_vec();
    let told = bench.pair.of_id(0x081);
    let told = told.iter().map(|heard| {
        let [low, high, ..] = heard.frame.padded();
        u16::from_le_bytes([low, high])
    });
    Story {
        attempts,
        told: told.collect(),
    }
}

#[test]
fn a_program_that_hangs_is_given_up_by_the_watchdog() {
    let mut bench = Bench::new();
    let story = rolled_back(&mut bench, &body_that_begins_with(HANG), 10.0);
    assert_eq!(story.attempts, [Cause::Watchdog; ATTEMPTS as usize]);
    assert!(story.told.contains(&0x6104), "{:04X?}", story.told);
    assert_eq!(bench.read(0x2020, 0) & 3, 3, "it measures");
}

#[test]
fn a_program_that_crashes_is_given_up_at_once() {
    let mut bench = Bench::new();
    let story = rolled_back(&mut bench, &body_that_begins_with(CRASH), 3.0);
    assert_eq!(story.attempts, [Cause::Software; ATTEMPTS as usize]);
    assert!(story.told.contains(&0x6102), "{:04X?}", story.told);
    assert_eq!(bench.read(0x2020, 0) & 3, 3, "it measures");
}

#[test]
fn a_program_that_has_no_angle_gives_itself_up_within_half_a_minute() {
    let mut bench = Bench::new();
    let electronics = bench.pair.network.electronics(0);
    let silent = SensorFault::SampleLoss { share: 1.0 };
    electronics.inject(silent, Rng::stream(1, "fault"));
    let story = rolled_back(&mut bench, &body(), 40.0);
    assert_eq!(story.attempts, [Cause::Software; ATTEMPTS as usize]);
    // The old one stays, although it has no angle either.
    bench.pair.run(15.0);
    assert_eq!(bench.shown().program[2], 2);
    bench.pair.network.electronics(0).heal();
}

#[test]
fn an_image_whose_check_sum_or_signature_is_wrong_never_starts() {
    let mut bench = Bench::new();
    let old = bench.shown();
    let resets = bench.resets().len();
    let mut damaged = file(&body());
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    let refused = send(&mut bench, &damaged);
    assert_eq!(refused, Err(SdoError::Abort(0x0800_0020)));
    let started = begin(&mut bench);
    assert_eq!(started, Err(SdoError::Abort(0x0800_0022)));
    let mut forged = file(&body());
    forged[40] ^= 1;
    send(&mut bench, &forged).expect("whole");
    assert_eq!(begin(&mut bench), Ok(()));
    // The check runs beside everything else; then 1F57h tells the error.
    let mut status = Ok(1);
    for _ in 0..100 {
        bench.pair.run(0.1);
        status = bench.pair.read(1, 0x1F57, 1);
        if status != Ok(1) {
            break;
        }
    }
    assert_eq!(status, Ok(FORGED));
    bench.pair.run(1.0);
    assert_eq!(bench.resets().len(), resets);
    assert_eq!(bench.shown(), old);
    // Nor does either start after a loss of supply.
    let cells = bench.cells();
    bench.start(cells);
    assert_eq!(bench.shown(), old);
}
