//! Errors of communication and of the device: EMCY, error register, and what 1029h makes of them.

use super::*;

fn emergency(code: u16, register: u8, detail: u8) -> Spoken {
    let [low, high] = code.to_le_bytes();
    spoken(0x85, &[low, high, register, detail, 0, 0, 0, 0])
}

/// In OPERATIONAL, and node 9 has been heard once within its 100 ms.
fn watching() -> Bench {
    let mut bench = Bench::operational();
    bench.write(0x1016, 2, Value::u32(9 << 16 | 100)).unwrap();
    bench.hears(0x709, &[5]);
    bench
}

#[test]
fn a_lost_heartbeat_is_told_and_taken_back() {
    let mut bench = watching();
    let [here, gone] = [true, false].map(|alive| Event::Heartbeat { node: 9, alive });
    assert_eq!(bench.events(), [here]);
    assert_eq!(bench.wait(99), []);
    assert_eq!(bench.wait(1), [emergency(0x8130, 0x11, 9)]);
    assert_eq!(bench.read(0x1001, 0), Ok(0x11));
    assert_eq!(bench.read(0x1003, 1), Ok(0x0009_8130));
    let left = Event::State(State::PreOperational);
    assert_eq!(bench.events(), [left, gone]);
    bench.hears(0x709, &[0x7F]);
    assert_eq!(bench.sent(), [emergency(0, 0, 0)]);
    assert_eq!(bench.read(0x1001, 0), Ok(0));
    assert_eq!(bench.node.state(), State::PreOperational);
}

#[test]
fn error_behaviour_sets_what_a_lost_heartbeat_does() {
    let states = [State::PreOperational, State::Operational, State::Stopped];
    for (behaviour, state) in (0..).zip(states) {
        let mut bench = watching();
        bench.write(0x1029, 1, Value::u8(behaviour)).unwrap();
        bench.wait(100);
        assert_eq!(bench.node.state(), state, "1029h = {behaviour}");
    }
    let mut bench = Bench::new();
    assert_eq!(bench.write(0x1029, 1, Value::u8(3)), Err(0x0609_0030));
}

#[test]
fn a_lost_heartbeat_that_is_no_longer_supervised_stands_for_ever() {
    let mut bench = watching();
    bench.wait(100);
    bench.write(0x1016, 2, Value::u32(0)).unwrap();
    assert_eq!(bench.read(0x1001, 0), Ok(0));
}

#[test]
fn guarding_that_is_switched_off_is_lost() {
    let mut bench = Bench::new();
    bench.write(0x100C, 0, Value::u16(50)).unwrap();
    bench.write(0x100D, 0, Value::u8(2)).unwrap();
    bench.asked(0x705, 1);
    assert_eq!(bench.wait(99), [spoken(0x705, &[0x7F])]);
    bench.write(0x100D, 0, Value::u8(0)).unwrap();
    assert_eq!(bench.wait(200), []);
}

#[test]
fn lost_guarding_is_told_and_taken_back() {
    let mut bench = Bench::new();
    bench.write(0x100C, 0, Value::u16(50)).unwrap();
    bench.write(0x100D, 0, Value::u8(2)).unwrap();
    bench.asked(0x705, 1);
    bench.sent();
    assert_eq!(bench.wait(100), [emergency(0x8130, 0x11, 0)]);
    bench.asked(0x705, 1);
    assert_eq!(bench.sent(), [emergency(0, 0, 0), spoken(0x705, &[0xFF])]);
}

#[test]
fn what_happens_in_stopped_is_told_afterwards() {
    let mut bench = watching();
    bench.nmt(2);
    assert_eq!(bench.wait(150), []);
    bench.nmt(128);
    assert_eq!(bench.sent(), [emergency(0x8130, 0x11, 9)]);
}

fn controller(bench: &mut Bench, state: BusState) {
    bench.node.bus_state(&mut bench.plant, state, bench.now);
}

#[test]
fn error_passive_is_a_warning() {
    let mut bench = Bench::operational();
    controller(&mut bench, BusState::Passive);
    controller(&mut bench, BusState::Passive);
    assert_eq!(bench.sent(), [emergency(0x8120, 0x11, 0)]);
    assert_eq!(bench.node.state(), State::Operational);
    controller(&mut bench, BusState::Active);
    assert_eq!(bench.sent(), [emergency(0, 0, 0)]);
}

#[test]
fn bus_off_leaves_operational_and_its_end_is_told() {
    let mut bench = Bench::operational();
    controller(&mut bench, BusState::Passive);
    bench.sent();
    controller(&mut bench, BusState::Off);
    assert_eq!(bench.node.state(), State::PreOperational);
    assert_eq!(bench.node.communication().emergency.register(), 0x11);
    assert_eq!(bench.sent(), []);
    controller(&mut bench, BusState::Active);
    assert_eq!(bench.sent(), [emergency(0x8140, 1, 0)]);
    assert_eq!(bench.read(0x1001, 0), Ok(0));
}

#[test]
fn a_bus_that_comes_back_passive_is_still_an_error() {
    let mut bench = Bench::new();
    controller(&mut bench, BusState::Off);
    controller(&mut bench, BusState::Passive);
    let both = [emergency(0x8140, 1, 0), emergency(0x8120, 0x11, 0)];
    assert_eq!(bench.sent(), both);
    // A reset of communication does not mend the bus.
    bench.nmt(130);
    bench.sent();
    assert_eq!(bench.read(0x1001, 0), Ok(0x11));
    controller(&mut bench, BusState::Active);
    assert_eq!(bench.sent(), [emergency(0, 0, 0)]);
}

#[test]
fn an_rpdo_of_the_wrong_length_is_told() {
    let mut bench = Bench::operational();
    bench.hears(0x205, &[]);
    assert_eq!(bench.sent(), [emergency(0x8210, 1, 1)]);
    assert_eq!(bench.read(0x2000, 0), Ok(7));
    bench.hears(0x205, &[8, 9]);
    assert_eq!(bench.sent(), [emergency(0x8220, 1, 1)]);
    assert_eq!(bench.read(0x2000, 0), Ok(8));
}

#[test]
fn a_sync_of_the_wrong_length_is_told_and_not_obeyed() {
    let mut bench = Bench::operational();
    bench.hears(0x80, &[1]);
    assert_eq!(bench.sent(), [emergency(0x8240, 1, 1)]);
    assert_eq!(bench.events(), []);
}

#[test]
fn an_rpdo_that_stays_away_is_told_once() {
    let mut bench = Bench::operational();
    bench.write(0x1400, 5, Value::u16(20)).unwrap();
    bench.hears(0x205, &[1]);
    assert_eq!(bench.wait(60), [emergency(0x8250, 1, 1)]);
}

#[test]
fn errors_of_the_device_have_a_class_and_bits_of_their_own() {
    let mut bench = watching();
    bench.wait(100);
    bench.nmt(1);
    let Bench { node, plant, now } = &mut bench;
    node.report(plant, 0xFF01, 0x80, [7, 0, 0, 0, 0], *now);
    assert_eq!(bench.sent(), [emergency(0xFF01, 0x91, 7)]);
    assert_eq!(bench.node.state(), State::Operational);
    bench.write(0x1029, 2, Value::u8(2)).unwrap();
    let Bench { node, plant, now } = &mut bench;
    node.report(plant, 0xFF02, 0x80, [0; 5], *now);
    assert_eq!(bench.node.state(), State::Stopped);
    bench.nmt(128);
    bench.node.cleared(0, [0; 5]);
    let both = [emergency(0xFF02, 0x91, 0), emergency(0, 0x11, 0)];
    assert_eq!(bench.sent(), both);
}

#[test]
fn frames_that_were_lost_before_the_boot_up_message_were_an_emcy_before_it() {
    let mut bench = Bench::new();
    bench.nmt(130);
    bench.node.overrun(3);
    assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
    assert_eq!(bench.node.overruns(), 3, "they count");
    bench.node.overrun(1);
    assert_eq!(bench.sent(), [emergency(0x8110, 1, 1)]);
}

#[test]
fn sub_0_of_1003_not_clearing() {
    let mut bench = Bench::new();
    bench.node.overrun(3);
    assert_eq!(bench.sent(), [emergency(0x8110, 1, 3)]);
    assert_eq!(bench.read(0x1003, 0), Ok(1));
    assert_eq!(bench.write(0x1003, 0, Value::u8(1)), Err(0x0609_0030));
    bench.write(0x1003, 0, Value::u8(0)).unwrap();
    assert_eq!(bench.read(0x1003, 0), Ok(0));
    assert_eq!(bench.read(0x1003, 1), Err(0x0800_0024));
}
