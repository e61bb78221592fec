//! The first angle after a start.
//!
//! In: a pair as delivered, tilted before it gets power, and a host that starts both nodes when
//! their boot-up messages have come. Out: frames of angles. The first valid one comes within a
//! second, and each one that is marked valid is the angle at which the housing stands.

use canopen::Frame;
use emulator::pair::Pair;
use sim::network::guest::Switch;

use crate::bench::{Bench, NEAR_DEG, PARTS, POSE, pieces};

#[test]
fn the_first_valid_angle_comes_within_a_second_of_power_and_none_before_is_marked_valid() {
    let pair = Pair::with(&PARTS, 2, 3, &pieces());
    let mut pair = pair.expect("the image is for the flash");
    for node in [0, 1] {
        pair.network.switch_guest(node, Switch::Off);
    }
    assert!(pair.hand.go(POSE));
    pair.run(4.0);
    pair.heard.clear();
    let start_ns = pair.network.now_ns();
    for node in [0, 1] {
        pair.network.switch_guest(node, Switch::On);
    }
    while pair.of_id(0x701).is_empty() || pair.of_id(0x702).is_empty() {
        pair.run(0.001);
        assert!(
            pair.network.now_ns() < start_ns + 1_000_000_000,
            "no boot-up"
        );
    }
    pair.send(Frame::data_frame(0, &[1, 0])).unwrap();
    pair.run_synced(150).unwrap();
    for id in [0x181, 0x182] {
        let frames = pair.of_id(id);
        assert!(frames.len() > 100, "{}", frames.len());
        let valid = frames
            .iter()
            .filter(|heard| heard.frame.padded()[4] & 3 != 0);
        for heard in valid.clone() {
            let [x0, x1, y0, y1, ..] = heard.frame.padded();
            let x = f64::from(i16::from_le_bytes([x0, x1])) / 100.0 - POSE.roll_deg;
            let y = f64::from(i16::from_le_bytes([y0, y1])) / 100.0 - POSE.pitch_deg;
            let age_s = (heard.at_ns - start_ns) as f64 * 1e-9;
            assert!(
                x.abs().max(y.abs()) < NEAR_DEG,
                "{id:03X} {age_s} s: {x} {y}"
            );
        }
        let first = valid.clone().next().expect("an angle");
        let first_s = (first.at_ns - start_ns) as f64 * 1e-9;
        let missing = frames
            .iter()
            .filter(|heard| heard.at_ns > first.at_ns)
            .count()
            + 1;
        eprintln!("{id:03X}: first valid angle {first_s:.3} s after power");
        assert!(first_s < 1.0, "{id:03X}: {first_s} s");
        assert_eq!(valid.count(), missing, "{id:03X}: it came and went");
    }
}

#[test]
fn a_pulse_of_data_ready_that_ended_a_nanosecond_early_left_its_pin_high_for_seconds() {
    let mut bench = Bench::new();
    // Each start has the part sample at other times.
    for start in 0..10 {
        bench.pair.network.switch_guest(0, Switch::Reset);
        bench.boot();
        let mut counts = || {
            bench.pair.run(0.3);
            let taken = u64::from(bench.read(0x2032, 0));
            (bench.pair.board(0).samples(), taken)
        };
        let (before, after) = (counts(), counts());
        let (there, taken) = (after.0 - before.0, after.1 - before.1);
        assert!(
            there.abs_diff(taken) <= 1,
            "start {start}: {taken} of {there} samples"
        );
    }
}
