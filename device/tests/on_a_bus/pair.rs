//! A device and its peer: what the pair makes of angles, EMCY, log, black box and safety frames.
//!
//! In: a healthy or unhealthy peer, and faults of the device's own. Out: what the bus is told.

use crate::played::{Pair, level, tilted};
use canopen::node::BusState;
use canopen::object::{Value, at};
use device::fault::Fault;
use tilt::angle::Angle;
use tilt::chain::{Correction, Invalid};
use tilt::health::Activity;
use tilt::observation::Observation;

#[test]
fn angles_are_shown_as_measured_until_somebody_works_by_them() {
    let mut pair = Pair::new();
    assert_eq!(pair.read(at(0x6010, 0)), 0);
    assert_eq!(pair.read(at(0x2020, 0)) & 3, 3);
}

#[test]
fn in_operational_an_angle_counts_when_it_was_compared_once() {
    let mut pair = Pair::new();
    pair.peer.silent = true;
    pair.hears(0, &[1, 0]);
    for _ in 0..50 {
        pair.sync();
        assert!(!pair.told().is_valid(), "{:?}", pair.told());
        assert_eq!(pair.read(at(0x2025, 1)), 18);
    }
    pair.peer.silent = false;
    pair.syncs(2);
    assert!(
        pair.told().is_valid() && pair.told().state == 1,
        "{:?}",
        pair.told()
    );
    assert_eq!(pair.read(at(0x2025, 1)), 0);
}

#[test]
fn a_channel_that_started_alone_was_valid_without_ever_having_been_compared() {
    for degraded in [1, 0] {
        let mut pair = Pair::new().set_policy(0, degraded);
        pair.peer.silent = true;
        pair.hears(0, &[1, 0]);
        pair.seconds(4.0);
        let told = pair.told();
        assert_eq!((told.is_valid(), told.state), (false, 8), "{told:?}");
        assert_eq!(pair.read(at(0x2025, 1)), 18);
        assert!(pair.has(Fault::PeerChannel));
        // What the other one reports of itself is no comparison either.
        pair.peer.silent = false;
        pair.peer.sends = level().refused(Invalid::Stuck);
        pair.seconds(4.0);
        assert_eq!((pair.told().is_valid(), pair.told().state), (false, 8));
        assert_eq!(pair.read(at(0x2025, 1)), 18);
        // Once compared it goes on alone, if it may.
        pair.peer.sends = level();
        pair.seconds(2.0);
        assert!(pair.told().is_valid());
        pair.peer.silent = true;
        pair.seconds(1.0);
        let told = pair.told();
        assert_eq!(
            (told.is_valid(), told.state),
            (degraded == 1, 8),
            "{told:?}"
        );
    }
}

#[test]
fn a_peer_that_was_never_heard_was_faulty_for_having_no_sample() {
    let mut pair = Pair::new();
    pair.peer.silent = true;
    pair.hears(0, &[1, 0]);
    pair.seconds(4.0);
    assert_eq!(
        (pair.read(at(0x2027, 1)), pair.read(at(0x2027, 2))),
        (2, 18)
    );
    // FF15h: fault 14; the peer is blamed, since it was not heard; state 8. Its heartbeat is
    // missed as well, which is bit 4 of the register.
    assert_eq!(
        pair.of(0x81).pop().unwrap(),
        [0x15, 0xFF, 0x91, 0, 0x40, 0, 2 << 6 | 18, 8]
    );
}

#[test]
fn a_disagreement_takes_the_angles_away_until_a_reset() {
    let mut pair = Pair::working();
    pair.peer.sends = tilted(2.0);
    let after = pair.until_refused(1.0);
    assert!(after.is_some_and(|s| s <= 0.3), "{after:?}");
    pair.syncs(2);
    assert_eq!(pair.told().state, 6);
    assert_eq!(pair.read(at(0x2025, 1)), 17);
    assert_eq!(pair.read(at(0x2027, 1)), 0, "nobody is named");
    pair.peer.sends = level();
    pair.seconds(10.0);
    let told = pair.told();
    assert!(!told.is_valid() && told.validity & 0x80 != 0, "{told:?}");
    pair.hears(0, &[129, 1]);
    pair.seconds(1.0);
    let pair = pair.at_work();
    assert!(pair.device.faults().is_empty());
}

#[test]
fn an_emcy_tells_faults_blame_and_state_and_its_end_is_told_too() {
    let mut pair = Pair::new().set_policy(1, 1).at_work();
    pair.peer.sends = tilted(2.0);
    pair.seconds(1.0);
    let told = pair.of(0x81);
    // FF13h, register: any and device-specific, fault 12, nobody blamed, state 6.
    assert_eq!(told, [[0x13, 0xFF, 0x81, 0, 0x10, 0, 0, 6]]);
    pair.peer.sends = level();
    pair.seconds(3.0);
    assert_eq!(pair.of(0x81)[1..], [[0, 0, 0, 0, 0, 0, 0, 1]]);
    assert!(pair.told().is_valid());
}

#[test]
fn a_peer_s_own_word_is_told_with_its_reason() {
    let mut pair = Pair::working();
    pair.peer.sends = level().refused(Invalid::Noise);
    pair.seconds(0.5);
    // FF15h: fault 14; the peer is blamed for noise; state 8.
    assert_eq!(
        pair.of(0x81),
        [[0x15, 0xFF, 0x81, 0, 0x40, 0, 2 << 6 | 10, 8]]
    );
    assert_eq!(
        (pair.read(at(0x2027, 1)), pair.read(at(0x2027, 2))),
        (2, 10)
    );
    // It takes its word back, and a second later it counts again: its latch is its own.
    pair.peer.sends = level();
    pair.seconds(1.5);
    assert_eq!(pair.emergencies(), [0xFF15, 0]);
    assert_eq!(pair.told().state, 1);
}

#[test]
fn a_disagreement_was_forgotten_when_the_other_channel_fell_silent() {
    let mut pair = Pair::working();
    pair.peer.sends = tilted(2.0);
    pair.seconds(1.0);
    assert_eq!(pair.told().state, 6);
    pair.peer.silent = true;
    for n in 0..250 {
        pair.sync();
        assert!(!pair.told().is_valid(), "{n}: {:?}", pair.told());
    }
    assert_eq!(pair.told().state, 8);
    assert_eq!(pair.read(at(0x2025, 1)), 17);
    // Neither does it help that the other one has lost its sensor's set-up.
    pair.peer.silent = false;
    pair.peer.sends = level().refused(Invalid::PartReset);
    pair.seconds(2.0);
    assert!(!pair.told().is_valid(), "{:?}", pair.told());
    // It has found out that it is the wrong one.
    pair.peer.sends = level().refused(Invalid::Biased);
    pair.seconds(2.0);
    assert!(pair.told().is_valid(), "{:?}", pair.told());
}

#[test]
fn a_calibration_that_was_found_damaged_after_the_difference_took_both_angles() {
    use Invalid::{Corrupt, Noise, Spikes, Stuck, Thermometer};
    for reason in [Corrupt, Noise, Spikes, Stuck, Thermometer] {
        let mut pair = Pair::working();
        pair.peer.sends = tilted(2.0);
        pair.seconds(1.0);
        assert_eq!((pair.told().is_valid(), pair.told().state), (false, 6));
        pair.peer.sends = level().refused(reason);
        pair.seconds(1.0);
        let told = pair.told();
        assert_eq!((told.is_valid(), told.state), (true, 8), "{reason:?}");
    }
}

#[test]
fn a_sensor_set_up_anew_is_compared_before_it_goes_on_alone() {
    let mut pair = Pair::new().set_policy(2, 1).at_work();
    pair.brown_out();
    pair.peer.silent = true;
    pair.seconds(6.0);
    assert_eq!(pair.sensor_restarts, 1);
    assert_eq!((pair.told().is_valid(), pair.told().state), (false, 8));
    assert_eq!(pair.read(at(0x2025, 1)), 18);
    pair.peer.silent = false;
    pair.seconds(2.0);
    assert!(pair.told().is_valid());
}

#[test]
fn one_channel_alone_works_on_or_does_not() {
    for (degraded, valid) in [(1, true), (0, false)] {
        let mut pair = Pair::new().set_policy(0, degraded).at_work();
        pair.peer.sends = level().refused(Invalid::PartReset);
        pair.seconds(0.5);
        let told = pair.told();
        assert_eq!((told.is_valid(), told.state), (valid, 8), "{told:?}");
        let reason = if valid { 0 } else { 19 };
        assert_eq!(pair.read(at(0x2025, 1)), reason);
    }
}

#[test]
fn a_brown_out_takes_the_channel_s_own_angles_and_tells_the_peer_why() {
    let mut pair = Pair::working();
    pair.brown_out();
    let after = pair.until_refused(1.0);
    assert!(after.is_some_and(|s| s <= 0.14), "{after:?}");
    pair.syncs(2);
    assert_eq!(pair.told().state, 7);
    assert_eq!((pair.read(at(0x2027, 1)), pair.read(at(0x2027, 2))), (1, 7));
    let exchange = pair.of(0x381).pop().unwrap();
    assert_eq!(exchange[6..], [7, 7], "quality: the reason");
    let mut told = pair.emergencies();
    told.sort_unstable();
    assert_eq!(told, [0x3200, 0xFF14]);
    // As delivered nothing is mended before a reset.
    pair.seconds(30.0);
    assert_eq!(pair.sensor_restarts, 0);
    assert!(!pair.told().is_valid());
    assert!(pair.told().validity & 0x80 != 0);
    pair.hears(0, &[129, 1]);
    pair.seconds(1.0);
    assert!(pair.at_work().device.faults().is_empty());
}

#[test]
fn with_a_latch_time_the_sensor_is_set_up_anew() {
    let mut pair = Pair::new().set_policy(2, 1).at_work();
    pair.brown_out();
    pair.seconds(1.9);
    assert_eq!(pair.sensor_restarts, 0);
    pair.seconds(0.4);
    assert_eq!(pair.sensor_restarts, 1);
    pair.seconds(4.0);
    assert!(pair.told().is_valid(), "{:?}", pair.told());
    assert_eq!(pair.sensor_restarts, 1);
    assert!(pair.device.faults().is_empty());
    assert_eq!(pair.emergencies().last(), Some(&0));
    assert_eq!(
        pair.of(0x81).last().unwrap()[2],
        0,
        "the error register is clear"
    );
}

#[test]
fn a_flipped_bit_of_the_calibration_is_told_within_half_a_second() {
    for bit in [0, 7, 15, 25] {
        let mut pair = Pair::working();
        let calibration = &mut pair.device.settings_mut().chain.calibration;
        let Correction::TwoAxis { vector, .. } = &mut calibration.correction else {
            panic!("two axes")
        };
        vector.matrix[1][0] ^= 1 << bit;
        let after = pair.until_refused(0.5);
        assert!(after.is_some(), "bit {bit}: {:?}", pair.told());
        pair.syncs(2);
        assert_eq!(pair.read(at(0x2025, 1)), 14);
        assert!(
            pair.emergencies().contains(&0xFF21),
            "{:X?}",
            pair.emergencies()
        );
        assert!(pair.told().validity & 0x80 != 0);
    }
}

#[test]
fn a_temperature_that_jumps_is_no_temperature() {
    for step in [-5.0, 5.0] {
        let mut pair = Pair::working();
        pair.warm(25.0 + step);
        assert!(pair.until_refused(0.6).is_some(), "{step}");
        pair.syncs(2);
        assert_eq!(pair.read(at(0x2025, 1)), 12);
        assert!(pair.emergencies().contains(&0xFF07));
    }
    // A die that warms up in the sun is believed.
    let mut pair = Pair::working();
    for n in 0..1200 {
        pair.warm(25.0 + 5.0 / 60.0 * f64::from(n) / 50.0 * 3.0);
        pair.sync();
        assert!(pair.told().is_valid(), "{n}");
    }
}

#[test]
fn for_four_syncs_without_the_second_frame_the_angles_are_compared_alone() {
    let mut pair = Pair::working();
    let missed = pair.device.values().process.missed;
    for angle in [level(), tilted(1.0)] {
        pair.peer.sends = angle;
        for _ in 0..6 {
            pair.peer.backed = false;
            pair.syncs(4);
            let told = pair.told();
            assert!(told.state == 1 && told.is_valid() || told.state == 6);
            pair.peer.backed = true;
            pair.sync();
        }
    }
    assert_eq!(pair.device.values().process.missed, missed);
    assert_eq!(pair.told().state, 6);
    assert!(!pair.told().is_valid());
}

/// A silence that ends now is over after a second, and leaves nothing.
fn assert_is_over_after_a_second(pair: &mut Pair) {
    pair.seconds(0.9);
    assert_eq!(pair.told().state, 8);
    pair.seconds(0.4);
    assert_eq!(pair.told().state, 1);
    assert!(pair.device.faults().is_empty());
}

/// The accelerations, the energy of both and the age of the data were compared no longer, and
/// nothing reported it.
#[test]
fn a_second_frame_that_never_came_was_not_reported() {
    let mut pair = Pair::working();
    pair.peer.backed = false;
    pair.syncs(5);
    assert_eq!(pair.state(), 1, "the fifth may be under way");
    pair.sync();
    assert_eq!(pair.state(), 8);
    assert_eq!(pair.read(at(0x2027, 2)), 15);
    assert!(pair.device.values().process.missed > 0);
    assert_eq!(pair.safety_frames(), 0);
    pair.peer.backed = true;
    assert_is_over_after_a_second(&mut pair);
}

#[test]
fn a_peer_that_falls_silent_is_told_and_comes_back_by_itself() {
    let mut pair = Pair::working();
    pair.peer.silent = true;
    pair.syncs(2);
    assert_eq!(pair.told().state, 1, "two may be missed");
    pair.syncs(4);
    assert_eq!(pair.told().state, 8);
    assert_eq!(pair.read(at(0x2027, 2)), 15);
    pair.seconds(5.0);
    pair.peer.silent = false;
    assert_is_over_after_a_second(&mut pair);
}

#[test]
fn a_peer_s_boot_up_ends_what_is_held_against_it() {
    let noisy = Observation {
        activity: Activity(130),
        ..level()
    };
    let mut pair = Pair::working();
    pair.peer.sends = noisy;
    pair.seconds(1.0);
    pair.peer.sends = level();
    pair.seconds(10.0);
    assert_eq!(pair.told().state, 8, "latched here");
    pair.hears(0x702, &[0]);
    pair.seconds(1.0);
    assert_eq!(pair.told().state, 1);
    assert_eq!(pair.emergencies(), [0xFF15, 0]);
}

#[test]
fn a_channel_whose_frames_go_out_late_takes_its_angles_back() {
    let mut pair = Pair::working();
    // Each frame leaves the controller some SYNCs after it was handed over.
    for _ in 0..10 {
        pair.blocked = true;
        pair.syncs(4);
        pair.blocked = false;
        pair.listen();
    }
    assert_eq!(pair.state(), 7, "{:?}", pair.device.values().process);
    assert_eq!(pair.device.shown(pair.now).blame().1, 16);
    assert!(!pair.told().is_valid());
    pair.seconds(2.0);
    assert!(
        pair.told().is_valid() && pair.told().state == 1,
        "{:?}",
        pair.told()
    );
}

#[test]
fn who_is_off_the_bus_blames_nobody_else() {
    let mut pair = Pair::working();
    pair.device.bus_state(BusState::Off, 255, 0, pair.now);
    pair.off = true;
    for n in 0..250 {
        pair.sync();
        assert_ne!(pair.state(), 8, "{n}");
        assert!(!pair.has(Fault::PeerChannel), "{n}");
    }
    let shown = pair.device.shown(pair.now);
    assert_eq!(shown.validity() & 3, 0, "nobody has compared it: {shown:?}");
    pair.device.bus_state(BusState::Active, 0, 0, pair.now);
    pair.off = false;
    pair.hears(0, &[1, 0]);
    pair.seconds(3.0);
    assert_eq!(pair.told().state, 1);
    assert!(pair.told().is_valid());
    assert!(
        !pair.emergencies().contains(&0xFF15),
        "{:X?}",
        pair.emergencies()
    );
}

#[test]
fn a_silence_while_off_the_bus_is_the_own_one() {
    let mut pair = Pair::working();
    pair.device.bus_state(BusState::Off, 255, 0, pair.now);
    // SYNCs still come to the code, as those of its own do; nobody answers any.
    pair.peer.silent = true;
    for n in 0..50 {
        pair.sync();
        assert_ne!(pair.state(), 8, "{n}");
    }
    assert_eq!(pair.device.shown(pair.now).blame(), (1, 15));
}

#[test]
fn log_and_black_box_hold_the_event_and_what_was_on_the_bus_around_it() {
    let mut pair = Pair::working();
    pair.seconds(1.0);
    pair.peer.sends = tilted(2.0);
    pair.seconds(2.0);
    let log = pair.upload(at(0x2070, 0));
    assert_eq!(log[..2], [1, 20]);
    let entry = &log[4..24];
    assert_eq!(entry[8..10], [0x13, 0xFF]);
    assert_eq!(
        entry[10..18],
        [0, 0x10, 0, 0, 6, 0, 0, 1],
        "faults, state, blame, box"
    );
    let black_box = pair.upload(at(0x2071, 1));
    assert_eq!(black_box[..4], [1, 34, 32, 16]);
    assert_eq!(black_box[4..8], 20_000_u32.to_le_bytes());
    assert_eq!(black_box[8..28], *entry);
    let frames: Vec<&[u8]> = black_box[28..].chunks(34).collect();
    assert_eq!(frames.len(), 48);
    assert_eq!((frames[30][32], frames[31][32], frames[32][32]), (1, 6, 6));
    // Both halves of what this channel sent, one SYNC after the other, are on the bus's record.
    for (id, from) in [(0x381, 0), (0x481, 8)] {
        let sent = pair.of(id);
        let kept: Vec<&[u8]> = frames.iter().map(|frame| &frame[from..from + 8]).collect();
        let mut runs = sent.windows(kept.len());
        assert!(
            runs.any(|run| run.iter().eq(kept.iter().copied())),
            "{id:X}"
        );
    }
    // The peer's angle before and after it went off.
    let angle = |frame: &[u8]| i32::from_le_bytes([0, frame[16], frame[17], frame[18]]);
    assert_eq!(angle(frames[0]), 0);
    let off = Angle(angle(frames[47])).degrees();
    assert!((off - 2.0).abs() < 0.001, "{off}");
    // By block transfer they are the same.
    assert_eq!(pair.block_upload(at(0x2070, 0)), log);
    assert_eq!(pair.block_upload(at(0x2071, 1)), black_box);
    // A reset leaves both, because the memory has them; 2072h empties both for good.
    pair.hears(0, &[129, 1]);
    pair.seconds(0.5);
    assert_eq!(pair.upload(at(0x2071, 1)), black_box);
    assert_eq!(pair.upload(at(0x2070, 0))[4..], log[4..]);
    pair.hears(0, &[128, 1]);
    pair.write(at(0x2072, 0), Value::u32(0x6165_6C63));
    for _ in 0..2 {
        let empty = "head only: version and length, no entries";
        assert_eq!(pair.read(at(0x2070, 0)), 0x1401, "{empty}");
        pair.hears(0, &[129, 1]);
        pair.seconds(0.5);
    }
}

/// A pair that saw its part lose the supply two seconds ago, with flash that is cut after so many
/// operations from then on.
fn after_an_incident(cut: Option<u64>) -> (Pair, u64) {
    let mut pair = Pair::working();
    let before = pair.device.memory().flash().operations();
    if let Some(cut) = cut {
        pair.device.memory().flash_mut().cut_after(cut);
    }
    pair.brown_out();
    pair.seconds(2.0);
    let operations = pair.device.memory().flash().operations() - before;
    pair.device.memory().flash_mut().power_up();
    pair.boot();
    (pair, operations)
}

#[test]
fn a_cut_while_an_incident_is_written_leaves_each_event_and_the_box_whole_or_away() {
    let (mut whole, operations) = after_an_incident(None);
    let log = whole.upload(at(0x2070, 0));
    let black_box = whole.upload(at(0x2071, 1));
    let events: Vec<&[u8]> = log[4..].chunks(20).collect();
    assert!(events.len() >= 2 && black_box.len() == 1660, "{log:?}");
    assert!(operations > 830, "{operations}");
    let (mut fewest, mut boxes) = (events.len(), 0);
    for cut in (0..operations).step_by(5) {
        let (mut pair, _) = after_an_incident(Some(cut));
        // An empty log is four bytes, which come in the answer itself.
        let empty = pair.ask([0x40, 0x70, 0x20, 0, 0, 0, 0, 0]).pop().unwrap()[0] == 0x43;
        let found = if empty {
            vec![1, 20, 0, 0]
        } else {
            pair.upload(at(0x2070, 0))
        };
        let kept: Vec<&[u8]> = found[4..].chunks(20).collect();
        assert!(events.ends_with(&kept), "{cut}: {kept:?}");
        fewest = fewest.min(kept.len());
        let answer = pair.ask([0x40, 0x71, 0x20, 1, 0, 0, 0, 0]).pop().unwrap();
        if answer[0] == 0x41 {
            pair.ask([0x80, 0x71, 0x20, 1, 0, 0, 0, 0]);
            assert_eq!(pair.upload(at(0x2071, 1)), black_box, "{cut}");
            boxes += 1;
        }
    }
    assert_eq!(fewest, 0, "the first cuts come before the first event");
    assert!(boxes <= 2, "{boxes}");
}

#[test]
fn an_event_between_two_syncs_left_a_frame_twice_and_shortened_the_period() {
    let mut pair = Pair::working();
    pair.seconds(1.0);
    pair.brown_out();
    pair.seconds(1.0);
    let black_box = pair.upload(at(0x2071, 1));
    assert_eq!(black_box[..4], [1, 34, 32, 16]);
    assert_eq!(black_box[4..8], 20_000_u32.to_le_bytes());
    let frames: Vec<&[u8]> = black_box[28..].chunks(34).collect();
    assert!(frames.windows(2).all(|two| two[0][..32] != two[1][..32]));
    // The clock in them goes on by a SYNC from frame to frame, 2 ms a step.
    let steps = |two: &[&[u8]]| two[1][14].wrapping_sub(two[0][14]);
    assert!(frames.windows(2).all(|two| steps(two) == 10));
    assert_eq!((frames[31][32], frames[32][32]), (1, 7));
}

#[test]
fn no_safety_frame_goes_out_in_any_fault() {
    type Begin = fn(&mut Pair);
    let faults: [(&str, Begin); 11] = [
        ("disagreement", |pair| pair.peer.sends = tilted(2.0)),
        ("peer faulty", |pair| {
            pair.peer.sends = level().refused(Invalid::Stuck)
        }),
        ("peer silent", |pair| pair.peer.silent = true),
        ("peer over range", |pair| {
            pair.peer.sends = level().refused(Invalid::OverRange)
        }),
        ("brown-out", |pair| pair.brown_out()),
        ("thermometer", |pair| pair.warm(35.0)),
        ("sensor's bus", |pair| pair.set_register(0x0F, 0)),
        ("calibration", |pair| {
            pair.device
                .settings_mut()
                .chain
                .calibration
                .budget
                .hysteresis ^= 1 << 20;
        }),
        ("frames late", |pair| pair.blocked = true),
        ("outside the range", |pair| {
            pair.write(at(0x2040, 1), Value::i32(10_000));
        }),
        ("above the uncertainty limit", |pair| {
            pair.write(at(0x2007, 0), Value::u16(1));
        }),
    ];
    for (name, begin) in faults {
        let mut pair = Pair::new();
        pair.write(at(0x63FE, 0), Value::u8(0xA5));
        pair.write(at(0x13FE, 0), Value::u8(0xA5));
        let mut pair = pair.at_work();
        let healthy = pair.safety_frames();
        assert!(healthy > 30, "{name}: {healthy}");
        begin(&mut pair);
        pair.seconds(0.6);
        assert_eq!(
            pair.safety_frames(),
            0,
            "{name}: {:?}",
            pair.device.faults()
        );
    }
}

#[test]
fn one_0000h_takes_back_several_faults_and_a_reset_takes_them_back_without_any() {
    let mut pair = Pair::new().set_policy(2, 1).at_work();
    pair.brown_out();
    pair.seconds(1.0);
    let set = |frame: &[u8]| u32::from_le_bytes([frame[3], frame[4], frame[5], 0]);
    let told = pair.of(0x81);
    assert_eq!(told.len(), 2, "{told:X?}");
    // Supply, and this channel faulty: both stand after the second.
    assert_eq!(set(&told[1]), 1 << 2 | 1 << 13);
    // Communication is reset: nothing of it is told again.
    pair.hears(0, &[130, 1]);
    pair.hears(0, &[1, 0]);
    pair.seconds(0.5);
    assert_eq!(pair.emergencies().len(), 2);
    assert_ne!(pair.read(at(0x1001, 0)), 0);
    pair.seconds(6.0);
    let told = pair.of(0x81).split_off(2);
    assert!(told.iter().all(|frame| frame[..2] == [0, 0]), "{told:X?}");
    assert_eq!(set(&told[told.len() - 1]), 0);
    assert!(told.len() <= 2);
    // A reset of the node: the boot-up message and no 0000h.
    pair.brown_out();
    pair.seconds(1.0);
    let before = pair.emergencies().len();
    pair.hears(0, &[129, 1]);
    pair.seconds(1.0);
    assert_eq!(pair.emergencies().len(), before);
    assert_eq!(pair.of(0x701).iter().filter(|f| f[..] == [0]).count(), 2);
}
