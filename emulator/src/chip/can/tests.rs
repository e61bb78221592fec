//! The controller's rules, register by register.

use super::*;

/// Normal mode, all frames into FIFO 0, at 250 kbit/s of 36 MHz.
fn joined() -> Can {
    let mut can = Can::default();
    can.write(0x00, 1);
    can.write(0x1C, 0x001C_0008);
    for (offset, value) in [(0x20C, 1), (0x21C, 1), (0x200, 0x2A1C_0E00)] {
        can.write(offset, value);
    }
    can.write(0x00, 0);
    can
}

fn actions(can: &mut Can) -> Vec<Action> {
    std::iter::from_fn(|| can.take_action()).collect()
}

fn post(can: &mut Can, mailbox: u32, id: u32) {
    let base = 0x180 + 16 * mailbox;
    can.write(base + 4, 2);
    can.write(base + 8, 0x2211);
    can.write(base, id << 21 | 1);
}

#[test]
fn a_reset_is_sleep_and_initialisation_is_acknowledged() {
    let mut can = Can::default();
    assert_eq!(can.read(0x04) & 3, 2);
    can.write(0x00, 1);
    assert_eq!(can.read(0x04) & 3, 1);
    can.write(0x1C, 0x001C_0008);
    can.write(0x00, 0);
    assert_eq!(can.read(0x04) & 3, 0);
    let join = Action::Join {
        pclk1_per_bit: 9 * 16,
        silent: false,
    };
    assert_eq!(actions(&mut can), [Action::Reset, join]);
    // Outside of initialisation the bit timing stays.
    can.write(0x1C, 0);
    assert_eq!(can.read(0x1C), 0x001C_0008);
}

#[test]
fn a_request_goes_to_the_bus_and_its_end_frees_the_mailbox() {
    let mut can = joined();
    actions(&mut can);
    can.write(0x14, 1);
    post(&mut can, 0, 0x123);
    let frame = Frame::data_frame(0x123, &[0x11, 0x22]);
    let offer = Action::Offer {
        mailbox: 0,
        frame,
        once: false,
    };
    assert_eq!(actions(&mut can), [offer]);
    assert_eq!(can.read(0x08) >> 26 & 7, 0b110);
    assert_eq!(can.read(0x08) >> 24 & 3, 1);
    can.sent(0);
    assert_eq!(can.read(0x08) & 0xF, 0b0011);
    assert!(can.lines()[0]);
    can.write(0x08, 1);
    assert_eq!(can.read(0x08) & 0xF, 0);
    assert!(!can.lines()[0]);
}

#[test]
fn the_last_in_line_is_named_once_the_mailboxes_are_full() {
    let mut can = joined();
    for (mailbox, id) in [(0, 0x181), (1, 0x701), (2, 0x080)] {
        post(&mut can, mailbox, id);
    }
    let status = can.read(0x08);
    assert_eq!(
        (status >> 26 & 7, status >> 24 & 3, status >> 29),
        (0, 1, 0b010)
    );
    actions(&mut can);
    can.write(0x08, 1 << 15);
    assert_eq!(actions(&mut can), [Action::Abort { mailbox: 1 }]);
    can.ended(1, End::Aborted);
    assert_eq!(can.read(0x08) >> 8 & 0xF, 1);
}

#[test]
fn the_fourth_frame_is_an_overrun_and_takes_the_place_of_the_third() {
    let mut can = joined();
    can.write(0x14, 1 << 1);
    for id in 1..=4 {
        can.receive(Frame::data_frame(id, &[]));
    }
    assert!(can.lines()[1]);
    assert_eq!(can.read(0x0C), 3 | 1 << 3 | 1 << 4);
    let ids: Vec<_> = (0..3)
        .map(|_| {
            let id = can.read(0x1B0) >> 21;
            can.write(0x0C, 1 << 5);
            id
        })
        .collect();
    assert_eq!(ids, [1, 2, 4]);
    assert!(!can.lines()[1]);
}

#[test]
fn a_locked_fifo_keeps_the_oldest() {
    let mut can = joined();
    can.write(0x00, 1 << 3);
    for id in 1..=4 {
        can.receive(Frame::data_frame(id, &[]));
    }
    can.write(0x0C, 1 << 5);
    can.write(0x0C, 1 << 5);
    assert_eq!(can.read(0x1B0) >> 21, 3);
}

#[test]
fn bus_off_ends_by_itself_or_by_initialisation() {
    let off = Errors {
        transmit: 256,
        receive: 0,
        state: ErrorState::BusOff,
    };
    let mut can = joined();
    can.write(0x00, 1 << 6);
    actions(&mut can);
    can.set_errors(off);
    assert_eq!(actions(&mut can), [Action::Recover]);
    let mut can = joined();
    actions(&mut can);
    can.write(0x14, 1 << 15 | 1 << 10);
    can.set_errors(off);
    assert_eq!(actions(&mut can), []);
    assert_eq!(can.read(0x18), 0x00FF_0007);
    assert!(can.lines()[3]);
    can.write(0x04, 1 << 2);
    assert!(!can.lines()[3]);
    can.write(0x00, 1);
    can.write(0x00, 0);
    assert_eq!(actions(&mut can).last(), Some(&Action::Recover));
}
