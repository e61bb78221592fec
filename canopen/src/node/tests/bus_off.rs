//! What bus-off takes out of the controller: what is told once is told again, the rest is not.

use super::*;

impl Bench {
    /// Everything that goes into the controller now, of which nothing goes out.
    fn hands_over(&mut self) -> Vec<Spoken> {
        self.node.poll(&mut self.plant, self.now);
        let frames = core::iter::from_fn(|| self.node.transmit(&mut self.plant, self.now));
        let frames = frames.take(MOST);
        frames
            .map(|frame| spoken(frame.cob_id().unwrap(), frame.bytes()))
            .collect()
    }

    /// Bus-off, and back.
    fn goes_off(&mut self) {
        for state in [BusState::Off, BusState::Active] {
            self.node.bus_state(&mut self.plant, state, self.now);
        }
    }
}

/// 8140h: back from bus-off, with this error register.
fn recovered_with(register: u8) -> Spoken {
    spoken(0x85, &[0x40, 0x81, register, 0, 0, 0, 0, 0])
}

fn recovered() -> Spoken {
    recovered_with(1)
}

/// An EMCY of the device.
fn fault(bench: &mut Bench) -> Spoken {
    let Bench { node, plant, now } = bench;
    node.report(plant, 0xFF01, 0x80, [7, 0, 0, 0, 0], *now);
    spoken(0x85, &[0x01, 0xFF, 0x81, 7, 0, 0, 0, 0])
}

#[test]
fn a_boot_up_message_that_bus_off_took_was_never_sent_again() {
    let mut bench = Bench::booting();
    for _ in 0..3 {
        assert_eq!(bench.hands_over(), [spoken(0x705, &[0])]);
        bench.goes_off();
    }
    assert_eq!(bench.sent(), [spoken(0x705, &[0]), recovered()]);
    assert_eq!(bench.node.state(), State::PreOperational);
    bench.goes_off();
    assert_eq!(bench.sent(), [recovered()]);
}

#[test]
fn a_boot_up_message_that_bus_off_took_goes_before_the_heartbeat_in_any_state() {
    for (command, state) in [(1, 5), (2, 4), (128, 127)] {
        let mut bench = Bench::booting();
        assert_eq!(bench.hands_over(), [spoken(0x705, &[0])]);
        // The answers wait for the boot-up message.
        bench.hears(0x605, &[0x2B, 0x17, 0x10, 0, 10, 0, 0, 0]);
        bench.hears(0x605, &[0x2F, 0x29, 0x10, 1, 1, 0, 0, 0]);
        assert_eq!(bench.hands_over(), []);
        bench.nmt(command);
        bench.goes_off();
        bench.now = bench.now.after_ms(10);
        let mut sent = bench.sent();
        sent.retain(|(id, _)| *id == 0x705);
        assert_eq!(sent, [spoken(0x705, &[0]), spoken(0x705, &[state])]);
    }
}

/// A mailbox beside that of the boot-up message would go first. A master forgets at the boot-up
/// message what was before it.
#[test]
fn an_emcy_of_the_start_overtook_the_boot_up_message() {
    let mut bench = Bench::booting();
    assert_eq!(bench.hands_over(), [spoken(0x705, &[0])]);
    let told = fault(&mut bench);
    for _ in 0..3 {
        assert_eq!(bench.hands_over(), []);
        bench.now = bench.now.after_ms(1000);
    }
    let boot_up = Frame::data_frame(0x705, &[0]);
    bench.node.sent(&mut bench.plant, &boot_up, bench.now);
    assert_eq!(bench.sent(), [told]);
}

#[test]
fn a_boot_up_message_of_before_a_reset_is_not_that_of_the_reset() {
    let mut bench = Bench::booting();
    let boot_up = Frame::data_frame(0x705, &[0]);
    assert_eq!(bench.hands_over(), [spoken(0x705, &[0])]);
    bench.nmt(130);
    bench.node.sent(&mut bench.plant, &boot_up, bench.now);
    assert_eq!(bench.hands_over(), [spoken(0x705, &[0])]);
    bench.goes_off();
    assert_eq!(bench.sent(), [spoken(0x705, &[0]), recovered()]);
}

#[test]
fn the_toggle_bit_of_guarding_begins_at_0_when_the_boot_up_message_has_gone_out_late() {
    let mut bench = Bench::booting();
    assert_eq!(bench.hands_over(), [spoken(0x705, &[0])]);
    bench.asked(0x705, 1);
    let boot_up = Frame::data_frame(0x705, &[0]);
    bench.node.sent(&mut bench.plant, &boot_up, bench.now);
    assert_eq!(bench.sent(), [spoken(0x705, &[0x7F])]);
}

#[test]
fn an_emcy_that_bus_off_took_is_sent_again_and_in_its_order() {
    let mut bench = Bench::new();
    let told = fault(&mut bench);
    assert_eq!(bench.hands_over(), std::slice::from_ref(&told));
    bench.node.cleared(0, [0; 5]);
    bench.goes_off();
    assert_eq!(bench.hands_over(), std::slice::from_ref(&told));
    bench.goes_off();
    assert_eq!(bench.sent(), [told, spoken(0x85, &[0; 8]), recovered()]);
    assert_eq!(bench.sent(), []);
}

#[test]
fn a_fault_of_a_long_bus_off_is_told_however_often_the_node_tries_to_come_back() {
    let mut bench = Bench::new();
    for _ in 0..20 {
        let Bench { node, plant, now } = &mut bench;
        node.bus_state(plant, BusState::Passive, *now);
        bench.hands_over();
        bench.goes_off();
    }
    let told = fault(&mut bench);
    for _ in 0..20 {
        bench.goes_off();
    }
    let passive = spoken(0x85, &[0x20, 0x81, 0x11, 0, 0, 0, 0, 0]);
    assert_eq!(bench.sent(), [passive, recovered(), told]);
}

#[test]
fn answers_that_bus_off_took_are_not_given_to_the_next_request() {
    let mut bench = Bench::new();
    bench.hears(0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]);
    assert_eq!(bench.hands_over().len(), 1);
    bench.goes_off();
    assert_eq!(bench.sent(), [recovered()]);
    bench.hears(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    bench.hears(0x7E5, &[0x5E, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bench.hands_over().len(), 1);
    bench.goes_off();
    assert_eq!(bench.sent(), [recovered()]);
    // Both servers answer what they are asked then.
    assert_eq!(bench.read(0x1000, 0), Ok(0x019A));
    bench.hears(0x7E5, &[0x5E, 0, 0, 0, 0, 0, 0, 0]);
    let answer = [0x5E, ID, 0, 0, 0, 0, 0, 0];
    assert_eq!(bench.sent(), [spoken(0x7E4, &answer)]);
}

#[test]
fn an_event_driven_pdo_that_bus_off_took_was_never_sent_again() {
    let mut bench = Bench::operational();
    bench.write(0x1029, 1, Value::u8(1)).unwrap();
    bench.write(0x1800, 2, Value::u8(254)).unwrap();
    bench.sent();
    bench.write(0x6010, 0, Value::u16(5)).unwrap();
    bench.node.data_changed(&mut bench.plant, bench.now);
    assert_eq!(bench.hands_over(), [spoken(0x185, &[5, 0])]);
    bench.goes_off();
    assert_eq!(bench.sent(), [recovered(), spoken(0x185, &[5, 0])]);
    assert_eq!(bench.sent(), []);
}

#[test]
fn a_heartbeat_that_bus_off_took_is_the_next_one() {
    let mut bench = Bench::new();
    bench.write(0x1017, 0, Value::u16(10)).unwrap();
    bench.now = bench.now.after_ms(10);
    assert_eq!(bench.hands_over(), [spoken(0x705, &[0x7F])]);
    bench.goes_off();
    assert_eq!(bench.sent(), [recovered()]);
    assert_eq!(bench.wait(10), [spoken(0x705, &[0x7F])]);
}

#[test]
fn the_toggle_bit_of_guarding_alternates_on_the_bus_over_a_bus_off() {
    let mut bench = Bench::new();
    bench.asked(0x705, 1);
    assert_eq!(bench.sent(), [spoken(0x705, &[0x7F])]);
    bench.asked(0x705, 1);
    assert_eq!(bench.hands_over(), [spoken(0x705, &[0xFF])]);
    bench.goes_off();
    bench.asked(0x705, 1);
    assert_eq!(bench.sent(), [recovered(), spoken(0x705, &[0xFF])]);
}

#[test]
fn a_heartbeat_that_went_out_after_1017h_was_0_turned_the_toggle_bit_of_guarding() {
    let mut bench = Bench::new();
    let frame = Frame::data_frame(0x705, &[0x7F]);
    // Whichever of the two is in the controller when 1017h changes: only an answer turns the bit.
    bench.write(0x1017, 0, Value::u16(10)).unwrap();
    bench.now = bench.now.after_ms(10);
    assert_eq!(bench.hands_over(), [spoken(0x705, &[0x7F])]);
    bench.write(0x1017, 0, Value::u16(0)).unwrap();
    bench.node.sent(&mut bench.plant, &frame, bench.now);
    bench.asked(0x705, 1);
    assert_eq!(bench.hands_over(), [spoken(0x705, &[0x7F])]);
    bench.write(0x1017, 0, Value::u16(10)).unwrap();
    bench.node.sent(&mut bench.plant, &frame, bench.now);
    bench.write(0x1017, 0, Value::u16(0)).unwrap();
    bench.asked(0x705, 1);
    assert_eq!(bench.sent(), [spoken(0x705, &[0xFF])]);
}
