//! The supply falls below what the chip runs on, in the middle of measuring, and comes back.
//!
//! In: how far it falls, which decides what RAM and sensor still hold, and for how long. Out: the
//! node starts as after power-on, with nothing to tell, and measures again within a second.

use canopen::Frame;
use emulator::chip::rcc::Cause;
use emulator::pair::Pair;
use sim::network::guest::Switch;

use crate::bench::{Bench, NEAR_DEG, PARTS, POSE, pieces};

/// Depths, V: the chip only; the sensor, and bits of the RAM; all of it.
const DEPTHS_V: [f64; 4] = [1.85, 1.65, 1.2, 0.3];
/// Lengths, s.
const LENGTHS_S: [f64; 4] = [0.0, 0.0007, 0.02, 0.4];
/// PORRSTF and PINRSTF, as after power-on (RM0008 7.3.10).
const POWER: u32 = 1 << 27 | 1 << 26;

#[test]
fn after_any_dip_of_the_supply_the_node_measures_again_within_a_second() {
    let mut bench = Bench::new();
    bench.pair.run(1.0);
    let healthy = bench.shown();
    let mut longest_s: f64 = 0.0;
    for (depth, volts) in DEPTHS_V.into_iter().enumerate() {
        for (length, seconds) in LENGTHS_S.into_iter().enumerate() {
            let case = format!("{volts} V for {seconds} s");
            // Nothing of it falls on the same instant twice.
            bench
                .pair
                .run(0.0123 + 0.00037 * (4 * depth + length) as f64);
            bench.pair.board(0).dip_to(volts);
            bench.pair.network.switch_guest(0, Switch::Off);
            bench.pair.run(seconds);
            bench.pair.heard.clear();
            bench.pair.network.switch_guest(0, Switch::On);
            let back_ns = bench.pair.network.now_ns();
            assert_eq!(bench.resets().last(), Some(&Cause::Power));
            let flags = bench.pair.board(0).machine().chip().reset_flags();
            assert_eq!(flags, POWER, "{case}");
            bench.boot();
            while bench.read(0x2020, 0) & 3 != 3 {
                let gone_ns = bench.pair.network.now_ns() - back_ns;
                assert!(gone_ns < 1_000_000_000, "{case}");
            }
            let gone_s = (bench.pair.network.now_ns() - back_ns) as f64 * 1e-9;
            longest_s = longest_s.max(gone_s);
            assert_eq!(bench.shown(), healthy, "{case}");
            let slopes = [(0x6010, POSE.roll_deg), (0x6020, POSE.pitch_deg)];
            for (index, truth_deg) in slopes {
                let slope = f64::from(bench.read(index, 0) as u16 as i16) / 100.0;
                assert!((slope - truth_deg).abs() < NEAR_DEG, "{case}: {slope}");
            }
            let told = bench.pair.of_id(0x081);
            assert!(told.is_empty(), "{case}: {told:?}");
        }
    }
    eprintln!("the longest time to an angle after a dip: {longest_s:.3} s");
}

#[test]
fn the_other_node_measures_on_until_the_first_is_back_and_both_agree_within_two_seconds() {
    let pair = Pair::with(&PARTS, 2, 4, &pieces());
    let mut pair = pair.expect("the image is for the flash");
    pair.run(0.6);
    pair.send(Frame::data_frame(0, &[1, 0])).unwrap();
    // A channel goes on alone when it has agreed with the other one for half a second.
    pair.run_synced(80).unwrap();
    pair.heard.clear();
    pair.board(0).dip_to(1.7);
    pair.network.switch_guest(0, Switch::Off);
    pair.run_synced(1).unwrap();
    pair.network.switch_guest(0, Switch::On);
    pair.run_synced(30).unwrap();
    let boots = pair.of_id(0x701).into_iter();
    let boots: Vec<_> = boots.filter(|heard| heard.frame.bytes() == [0]).collect();
    assert_eq!(boots.len(), 1, "one boot-up");
    pair.send(Frame::data_frame(0, &[1, 1])).unwrap();
    pair.run_synced(100).unwrap();
    let shown = |id| pair.of_id(id).into_iter();
    // Who has just come back is waited for (docs/canopen.md, the state of the pair).
    let back_ns = boots[0].at_ns;
    for heard in shown(0x182).filter(|heard| heard.frame.padded()[4] & 3 != 3) {
        let wait_ns = back_ns..back_ns + 2_000_000_000;
        assert!(wait_ns.contains(&heard.at_ns), "{heard:?}");
    }
    for id in [0x181, 0x182] {
        let last = shown(id).last().expect("frames").frame.padded();
        // Both valid, both compared, and they agree (2020h, 2021h).
        assert_eq!([last[4] & 0x3F, last[5]], [0x3F, 1], "{id:03X}");
    }
}
