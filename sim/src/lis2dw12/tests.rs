//! The model byte by byte, as a host sees it on the wire.

use proptest::prelude::*;

use super::registers::WHO_AM_I;
use super::*;
use crate::spi_part::bench::{burst, read, write};

const LEVEL_G: [f64; 3] = [0.0, 0.0, 1.0];

/// A part that has booted.
fn ready() -> Chip {
    let mut chip = Chip::new(Traits::TYPICAL);
    chip.power_on(0);
    chip.advance_to(BOOT_NS);
    chip
}

/// A part in product mode: 400 Hz, +-2 g, data-ready on INT1.
fn measuring() -> Chip {
    let mut chip = ready();
    for (address, value) in [(0x21, 0x0E), (0x25, 0x04), (0x23, 0x01), (0x20, 0x74)] {
        write(&mut chip, address, value);
    }
    chip
}

#[test]
fn nothing_answers_before_the_boot_is_over() {
    let mut chip = Chip::new(Traits::TYPICAL);
    assert_eq!(read(&mut chip, WHO_AM_I), 0x00);
    chip.power_on(1_000);
    chip.advance_to(1_000 + BOOT_NS - 1);
    assert_eq!(read(&mut chip, WHO_AM_I), 0x00);
    write(&mut chip, CTRL1, 0x74);
    chip.advance_to(1_000 + BOOT_NS);
    assert_eq!(read(&mut chip, WHO_AM_I), 0x44);
    assert_eq!(read(&mut chip, CTRL1), 0x00);
    chip.power_off();
    assert_eq!(read(&mut chip, WHO_AM_I), 0x00);
}

#[test]
fn soft_reset_shows_for_five_microseconds_and_restores_the_defaults() {
    let mut chip = measuring();
    write(&mut chip, CTRL2, 0x4E);
    assert_eq!(read(&mut chip, CTRL2), 0x44);
    assert_eq!(read(&mut chip, CTRL1), 0x00);
    chip.advance_to(BOOT_NS + SOFT_RESET_NS - 1);
    write(&mut chip, CTRL1, 0x74);
    assert_eq!(
        (read(&mut chip, CTRL2), read(&mut chip, CTRL1)),
        (0x44, 0x00)
    );
    chip.advance_to(BOOT_NS + SOFT_RESET_NS);
    assert_eq!(read(&mut chip, CTRL2), 0x04);
}

#[test]
fn boot_keeps_the_registers_and_stops_the_samples_for_20_ms() {
    let mut chip = measuring();
    write(&mut chip, CTRL2, 0x8E);
    assert_eq!(
        (read(&mut chip, CTRL2), read(&mut chip, CTRL1)),
        (0x8E, 0x74)
    );
    assert_eq!(chip.odr_hz(), None);
    chip.convert(LEVEL_G, 25.0);
    assert!(!chip.data_ready());
    chip.advance_to(2 * BOOT_NS);
    assert_eq!(read(&mut chip, CTRL2), 0x0E);
    assert_eq!(chip.odr_hz(), Some(400.0));
}

#[test]
fn read_only_and_reserved_bits_ignore_writes() {
    let mut chip = measuring();
    for address in [
        OUT_T_L,
        WHO_AM_I,
        STATUS,
        OUT_X_L,
        FIFO_SAMPLES,
        STATUS_DUP,
        0x10,
        0x50,
    ] {
        let before = read(&mut chip, address);
        write(&mut chip, address, 0xA5);
        assert_eq!(read(&mut chip, address), before, "{address:02X}h");
    }
    write(&mut chip, CTRL6, 0xFF);
    assert_eq!(read(&mut chip, CTRL6), 0xFC);
    assert_eq!(burst::<16>(&mut chip, 0x10), [0; 16]);
    assert_eq!(burst::<64>(&mut chip, 0x40), [0; 64]);
}

#[test]
fn the_address_counts_up_only_when_asked_to() {
    let mut chip = measuring();
    assert_eq!(
        burst(&mut chip, CTRL1),
        [0x74, 0x0E, 0x00, 0x01, 0x00, 0x04]
    );
    write(&mut chip, CTRL2, 0x0A);
    assert_eq!(burst(&mut chip, CTRL1), [0x74; 6]);
    // A burst of writes stays at its address, too.
    chip.select();
    for byte in [0x20, 0x44, 0x54] {
        chip.exchange(byte);
    }
    chip.deselect();
    assert_eq!(
        (read(&mut chip, CTRL1), read(&mut chip, CTRL2)),
        (0x54, 0x0A)
    );
}

#[test]
fn a_sample_reaches_the_outputs_and_the_pin() {
    let mut chip = measuring();
    assert!(!chip.data_ready());
    chip.convert([0.5, -0.25, 1.0], 26.0);
    assert!(chip.data_ready() && chip.int1());
    let bytes = burst(&mut chip, OUT_T);
    assert_eq!(bytes, [0x01, 0x01, 0x00, 0x20, 0x00, 0xF0, 0x00, 0x40]);
    assert!(!chip.data_ready());
    assert_eq!(burst(&mut chip, OUT_T_L), [0x00, 0x01]);
    write(&mut chip, CTRL3, 0x08);
    assert!(chip.int1());
}

#[test]
fn any_high_byte_clears_data_ready_and_no_low_byte_does() {
    for high in [0x29, 0x2B, 0x2D] {
        let mut chip = measuring();
        chip.convert(LEVEL_G, 25.0);
        read(&mut chip, high - 1);
        assert_eq!(read(&mut chip, STATUS) & 1, 1, "{high:02X}h");
        assert_eq!(read(&mut chip, STATUS_DUP), 0x41);
        read(&mut chip, high);
        assert_eq!(read(&mut chip, STATUS) & 1, 0, "{high:02X}h");
        assert_eq!(read(&mut chip, STATUS_DUP), 0x40);
        read(&mut chip, OUT_T_H);
        assert_eq!(read(&mut chip, STATUS_DUP), 0x00);
    }
}

#[test]
fn a_data_ready_pulse_lasts_75_microseconds() {
    let mut chip = measuring();
    write(&mut chip, CTRL7, 0x80);
    chip.convert(LEVEL_G, 25.0);
    assert!(chip.data_ready());
    chip.advance_to(BOOT_NS + DRDY_PULSE_NS);
    assert!(!chip.data_ready());
    assert_eq!(read(&mut chip, STATUS) & 1, 1);
}

/// X read across the arrival of a new sample: 00FCh then 0100h.
fn x_across_a_new_sample(block_data_update: bool) -> u16 {
    let mut chip = measuring();
    write(
        &mut chip,
        CTRL2,
        if block_data_update { 0x0E } else { 0x06 },
    );
    chip.convert([252.0 / 16384.0, 0.0, 1.0], 25.0);
    chip.select();
    chip.exchange(OUT_X_L | 0x80);
    let low = chip.exchange(0);
    chip.convert([256.0 / 16384.0, 0.0, 1.0], 25.0);
    let high = chip.exchange(0);
    chip.deselect();
    u16::from_le_bytes([low, high])
}

#[test]
fn a_pair_tears_without_block_data_update_only() {
    assert_eq!(x_across_a_new_sample(false), 0x01FC);
    assert_eq!(x_across_a_new_sample(true), 0x00FC);
}

#[test]
fn the_newest_sample_waits_behind_a_half_read_pair() {
    let mut chip = measuring();
    chip.convert([0.5, 0.5, 0.5], 25.0);
    read(&mut chip, OUT_X_L);
    chip.convert([0.25, 0.25, 0.25], 25.0);
    // X is held, Y and Z are not: the rule is one per pair.
    assert_eq!(burst(&mut chip, 0x29), [0x20, 0x00, 0x10, 0x00, 0x10]);
    assert_eq!(burst(&mut chip, OUT_X_L), [0x00, 0x10]);
}

#[test]
fn the_fifo_burst_runs_through_its_levels() {
    let mut chip = measuring();
    write(&mut chip, FIFO_CTRL, 0xC0 | 2);
    write(&mut chip, CTRL4_INT1, 0x02);
    for x_g in [0.125, 0.25, 0.5] {
        assert!(!chip.data_ready() || x_g == 0.5);
        chip.convert([x_g, 0.0, 1.0], 25.0);
    }
    assert!(chip.data_ready());
    assert_eq!(read(&mut chip, FIFO_SAMPLES), 0x83);
    assert_eq!(read(&mut chip, STATUS), 0x81);
    let levels: [u8; 18] = burst(&mut chip, OUT_X_L);
    assert_eq!([levels[1], levels[7], levels[13]], [0x08, 0x10, 0x20]);
    assert_eq!(read(&mut chip, FIFO_SAMPLES), 0x00);
    assert_eq!(read(&mut chip, STATUS), 0x00);
}

#[test]
fn the_overrun_shows_until_a_level_is_taken_and_bypass_empties() {
    let mut chip = measuring();
    write(&mut chip, FIFO_CTRL, 0x20);
    write(&mut chip, CTRL4_INT1, 0x04);
    (0..32).for_each(|_| chip.convert(LEVEL_G, 25.0));
    assert!(chip.data_ready());
    assert_eq!(read(&mut chip, FIFO_SAMPLES), 0x20);
    chip.convert(LEVEL_G, 25.0);
    assert_eq!(read(&mut chip, FIFO_SAMPLES), 0x60);
    assert_eq!(read(&mut chip, STATUS_DUP) & 0x80, 0x80);
    let _: [u8; 6] = burst(&mut chip, OUT_X_L);
    assert_eq!(read(&mut chip, FIFO_SAMPLES), 0x1F);
    write(&mut chip, FIFO_CTRL, 0x00);
    assert_eq!(read(&mut chip, FIFO_SAMPLES), 0x00);
}

#[test]
fn the_self_test_bits_shift_the_outputs_both_ways() {
    let mut chip = measuring();
    let mut x_after = |bits: u8| {
        write(&mut chip, CTRL3, bits);
        chip.convert([0.0; 3], 25.0);
        let bytes = burst::<2>(&mut chip, OUT_X_L);
        i16::from_le_bytes(bytes)
    };
    assert_eq!([x_after(0x40), x_after(0xC0), x_after(0x00)], [8192, 0, 0]);
    assert_eq!(x_after(0x80), -7864);
}

#[test]
fn the_thermometer_is_read_fifty_times_a_second() {
    let mut chip = measuring();
    let high: Vec<u8> = (0..17)
        .map(|step: u8| {
            chip.convert(LEVEL_G, 25.0 + f64::from(step));
            burst::<2>(&mut chip, OUT_T_L)[1]
        })
        .collect();
    assert_eq!(
        (high[0], high[7], high[8], high[15], high[16]),
        (0, 0, 8, 8, 16)
    );
}

#[test]
fn after_a_brown_out_the_part_is_in_power_down_with_frozen_or_zero_outputs() {
    for (after_brown_out, x) in [(AfterBrownOut::Frozen, 0x20), (AfterBrownOut::Zero, 0x00)] {
        let mut chip = measuring();
        chip.traits.after_brown_out = after_brown_out;
        chip.convert([0.5, 0.0, 1.0], 25.0);
        chip.brown_out(BOOT_NS + 10);
        assert_eq!(read(&mut chip, WHO_AM_I), 0x00);
        chip.advance_to(2 * BOOT_NS + 10);
        assert_eq!(read(&mut chip, WHO_AM_I), 0x44);
        assert_eq!((chip.odr_hz(), chip.bandwidth_hz()), (None, None));
        chip.convert(LEVEL_G, 25.0);
        assert!(!chip.data_ready());
        assert_eq!(
            burst(&mut chip, OUT_T),
            [0, 0, 0, x, 0, 0, 0, if x == 0 { 0 } else { 0x40 }]
        );
    }
}

#[test]
fn wire_faults_hide_the_part() {
    let mut chip = measuring();
    for (fault, byte) in [(Fault::MisoHigh, 0xFF), (Fault::MisoLow, 0x00)] {
        chip.set_fault(Some(fault));
        assert_eq!(read(&mut chip, WHO_AM_I), byte);
    }
    chip.set_fault(None);
    assert_eq!(read(&mut chip, WHO_AM_I), 0x44);
    write(&mut chip, CTRL2, 0x0F);
    assert_eq!(read(&mut chip, WHO_AM_I), 0x00);
    assert_eq!(chip.exchange(0x8F), 0x00);
}

/// What can happen to a part.
#[derive(Clone, Debug)]
enum Event {
    Select,
    Deselect,
    Exchange(u8),
    Convert([f64; 3], f64),
    Advance(u64),
    Upset(u8, u8),
    BrownOut,
    PowerOn,
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        3 => Just(Event::Select),
        1 => Just(Event::Deselect),
        9 => any::<u8>().prop_map(Event::Exchange),
        3 => (any::<[f64; 3]>(), any::<f64>()).prop_map(|(f, t)| Event::Convert(f, t)),
        2 => (0..BOOT_NS * 2).prop_map(Event::Advance),
        1 => any::<(u8, u8)>().prop_map(|(a, v)| Event::Upset(a, v)),
        1 => Just(Event::BrownOut),
        1 => Just(Event::PowerOn),
    ]
}

proptest! {
    /// Whatever is on the wire and whatever is felt, the model goes on, and its identity stays.
    #[test]
    fn any_sequence_leaves_a_part_that_can_be_started(
        events in prop::collection::vec(event(), 0..300),
    ) {
        let mut chip = ready();
        for event in events {
            let now_ns = chip.now_ns();
            match event {
                Event::Select => chip.select(),
                Event::Deselect => chip.deselect(),
                Event::Exchange(byte) => { chip.exchange(byte); }
                Event::Convert(force_g, die_c) => chip.convert(force_g, die_c),
                Event::Advance(ns) => chip.advance_to(now_ns + ns),
                Event::Upset(address, value) => chip.upset(address, value),
                Event::BrownOut => chip.brown_out(now_ns),
                Event::PowerOn => chip.power_on(now_ns),
            }
            prop_assert!(chip.fifo.count() <= FIFO_DEPTH);
        }
        let start_ns = chip.now_ns();
        chip.power_on(start_ns);
        chip.advance_to(start_ns + BOOT_NS);
        prop_assert_eq!(read(&mut chip, WHO_AM_I), 0x44);
    }
}
