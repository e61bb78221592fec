//! The model byte by byte, as a host sees it on the wire.

use proptest::prelude::*;

use super::registers::WHO_AM_I;
use super::*;
use crate::spi_part::bench::{burst, read, write};

const LEVEL_G: [f64; 3] = [0.0, 0.0, 1.0];
const STILL: [f64; 3] = [0.0; 3];

/// A part that has booted.
fn ready() -> Chip {
    let mut chip = Chip::new(Traits::TYPICAL);
    chip.power_on(0);
    chip.advance_to(BOOT_NS);
    chip
}

/// A part in product mode: 417 Hz, +-4 g, +-500 deg/s, the gyroscope's data-ready on INT1.
fn measuring() -> Chip {
    let mut chip = ready();
    for (address, value) in [(0x12, 0x44), (0x0D, 0x02), (0x10, 0x68), (0x11, 0x64)] {
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
    write(&mut chip, CTRL1_XL, 0x68);
    assert_eq!(read(&mut chip, WHO_AM_I), 0x00);
    chip.advance_to(1_000 + BOOT_NS);
    assert_eq!(read(&mut chip, WHO_AM_I), 0x6B);
    assert_eq!(read(&mut chip, CTRL1_XL), 0x00);
    chip.power_off();
    assert_eq!(read(&mut chip, WHO_AM_I), 0x00);
}

#[test]
fn a_reset_shows_for_50_microseconds_and_restores_the_defaults() {
    let mut chip = measuring();
    write(&mut chip, CTRL3_C, 0x45);
    let seen = (read(&mut chip, CTRL3_C), read(&mut chip, CTRL1_XL));
    assert_eq!(seen, (0x05, 0x00));
    chip.advance_to(BOOT_NS + SW_RESET_NS);
    assert_eq!(read(&mut chip, CTRL3_C), 0x04);
    assert_eq!(chip.odr_hz(), None);
}

#[test]
fn a_boot_keeps_the_registers_and_stops_the_samples() {
    let mut chip = measuring();
    write(&mut chip, CTRL3_C, 0xC4);
    let seen = (read(&mut chip, CTRL3_C), read(&mut chip, CTRL1_XL));
    assert_eq!(seen, (0xC4, 0x68));
    chip.convert(LEVEL_G, STILL, 25.0);
    assert!(!chip.data_ready());
    chip.advance_to(2 * BOOT_NS);
    assert_eq!(read(&mut chip, CTRL3_C), 0x44);
    assert!(chip.odr_hz().is_some_and(|hz| (hz - 416.67).abs() < 0.01));
}

#[test]
fn a_sample_reaches_the_outputs_and_the_pin() {
    let mut chip = measuring();
    assert!(!chip.data_ready());
    chip.convert([0.5, -0.25, 1.0], [17.5, -17.5, 0.0], 26.0);
    assert!(chip.data_ready() && chip.int1());
    let bytes: [u8; 16] = burst(&mut chip, STATUS_REG);
    assert_eq!(bytes[..4], [0x07, 0x00, 0x00, 0x01]);
    assert_eq!(bytes[4..10], [0xE8, 0x03, 0x18, 0xFC, 0x00, 0x00]);
    assert_eq!(bytes[10..], [0x00, 0x10, 0x00, 0xF8, 0x00, 0x20]);
    assert!(!chip.data_ready());
    assert_eq!(read(&mut chip, STATUS_REG), 0x00);
    write(&mut chip, CTRL3_C, 0x64);
    assert!(chip.int1());
}

#[test]
fn each_sensor_has_its_flag_and_its_pulse() {
    let mut chip = measuring();
    write(&mut chip, COUNTER_BDR_REG1, 0x80);
    chip.convert(LEVEL_G, STILL, 25.0);
    for (high, left) in [(0x21, 0x03), (0x25, 0x01), (0x2D, 0x00)] {
        assert!(chip.data_ready() || left == 0x01 || left == 0x00);
        read(&mut chip, high - 1);
        read(&mut chip, high);
        assert_eq!(read(&mut chip, STATUS_REG), left, "{high:02X}h");
    }
    chip.convert(LEVEL_G, STILL, 25.0);
    assert!(chip.data_ready());
    chip.advance_to(BOOT_NS + DRDY_PULSE_NS);
    assert!(!chip.data_ready());
    assert_eq!(read(&mut chip, STATUS_REG), 0x03);
}

/// X of the gyroscope read across the arrival of a new sample: 00FCh then 0100h.
fn x_across_a_new_sample(block_data_update: bool) -> u16 {
    let mut chip = measuring();
    write(
        &mut chip,
        CTRL3_C,
        if block_data_update { 0x44 } else { 0x04 },
    );
    chip.convert(LEVEL_G, [252.0 * 0.0175, 0.0, 0.0], 25.0);
    chip.select();
    chip.exchange(0x22 | 0x80);
    let low = chip.exchange(0);
    chip.convert(LEVEL_G, [256.0 * 0.0175, 0.0, 0.0], 25.0);
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
fn the_slower_sensor_samples_at_every_fourth_tick() {
    let mut chip = measuring();
    write(&mut chip, CTRL1_XL, 0x48);
    let hz = |rate: Option<f64>| rate.map(f64::round);
    assert_eq!(hz(chip.accelerometer_odr_hz()), Some(104.0));
    assert_eq!(hz(chip.gyroscope_odr_hz()), Some(417.0));
    let flags: Vec<u8> = (0..9)
        .map(|_| {
            chip.convert(LEVEL_G, STILL, 25.0);
            burst::<16>(&mut chip, STATUS_REG)[0]
        })
        .collect();
    assert_eq!(flags, [7, 2, 2, 2, 3, 2, 2, 2, 7]);
}

#[test]
fn a_fifo_burst_runs_through_its_words() {
    let mut chip = measuring();
    for (address, value) in [(0x07, 4), (0x09, 0x66), (0x0A, 0x06), (0x0D, 0x08)] {
        write(&mut chip, address, value);
    }
    for x_dps in [17.5, 35.0] {
        assert!(!chip.data_ready());
        chip.convert(LEVEL_G, [x_dps, 0.0, 0.0], 25.0);
    }
    assert!(chip.data_ready());
    assert_eq!(burst(&mut chip, FIFO_STATUS1), [4, 0x80]);
    let words: [u8; 28] = burst(&mut chip, FIFO_DATA_OUT_TAG);
    let tags = [0, 7, 14, 21].map(|at: usize| words[at] >> 3);
    assert_eq!(tags, [1, 2, 1, 2]);
    let slots = [0, 7, 14, 21].map(|at: usize| (words[at] >> 1) & 3);
    assert_eq!((slots[0], slots[2]), (slots[1], slots[3]));
    assert_eq!((slots[0] + 1) & 3, slots[2]);
    assert_eq!([words[1], words[15]], [0xE8, 0xD0]);
    assert_eq!(burst(&mut chip, FIFO_STATUS1), [0, 0x00]);
    assert_eq!(read(&mut chip, FIFO_DATA_OUT_TAG), 0x00);
}

#[test]
fn the_overrun_is_latched_until_the_status_is_read() {
    let mut chip = measuring();
    write(&mut chip, 0x09, 0x60);
    write(&mut chip, 0x0A, 0x06);
    (0..=FIFO_WORDS).for_each(|_| chip.convert(LEVEL_G, STILL, 25.0));
    assert_eq!(burst(&mut chip, FIFO_STATUS1), [0x00, 0x02 | 0x68]);
    assert_eq!(burst(&mut chip, FIFO_STATUS1), [0x00, 0x02 | 0x60]);
    let _: [u8; 7] = burst(&mut chip, FIFO_DATA_OUT_TAG);
    assert_eq!(burst(&mut chip, FIFO_STATUS1), [0xFF, 0x01]);
    write(&mut chip, 0x0A, 0x00);
    assert_eq!(burst(&mut chip, FIFO_STATUS1), [0, 0]);
}

#[test]
fn the_self_test_bits_shift_the_outputs_both_ways() {
    let mut chip = measuring();
    write(&mut chip, CTRL2_G, 0x6C);
    let mut x_after = |bits: u8| {
        write(&mut chip, CTRL5_C, bits);
        chip.convert([0.0; 3], STILL, 25.0);
        let bytes: [u8; 16] = burst(&mut chip, STATUS_REG);
        let x = |at: usize| i16::from_le_bytes([bytes[at], bytes[at + 1]]);
        (x(10), x(4))
    };
    assert_eq!(x_after(0x01), (4096, 0));
    assert_eq!(x_after(0x02), (-3932, 0));
    assert_eq!(x_after(0x04), (0, 5429));
    assert_eq!(x_after(0x0C), (0, -5571));
    assert_eq!(x_after(0x00), (0, 0));
}

#[test]
fn the_gyroscope_sleeps_alone() {
    let mut chip = measuring();
    write(&mut chip, CTRL4_C, 0x40);
    assert_eq!(
        (chip.gyroscope_odr_hz(), chip.gyroscope_delay_s()),
        (None, None)
    );
    chip.convert(LEVEL_G, STILL, 25.0);
    assert_eq!(read(&mut chip, STATUS_REG), 0x05);
}

#[test]
fn after_a_brown_out_the_sensors_rest_with_frozen_or_zero_outputs() {
    for (after_brown_out, high) in [(AfterBrownOut::Frozen, 0x10), (AfterBrownOut::Zero, 0x00)] {
        let mut chip = measuring();
        chip.traits.after_brown_out = after_brown_out;
        chip.convert([0.5, 0.0, 1.0], STILL, 25.0);
        chip.brown_out(BOOT_NS + 10);
        assert_eq!(read(&mut chip, WHO_AM_I), 0x00);
        chip.advance_to(2 * BOOT_NS + 10);
        assert_eq!(read(&mut chip, WHO_AM_I), 0x6B);
        assert_eq!(
            (chip.odr_hz(), chip.accelerometer_bandwidth_hz()),
            (None, None)
        );
        chip.convert(LEVEL_G, STILL, 25.0);
        assert!(!chip.data_ready());
        assert_eq!(burst(&mut chip, 0x28), [0x00, high]);
    }
}

#[test]
fn wire_faults_and_other_banks_hide_the_part() {
    let mut chip = measuring();
    for (fault, byte) in [(Fault::MisoHigh, 0xFF), (Fault::MisoLow, 0x00)] {
        chip.set_fault(Some(fault));
        assert_eq!(read(&mut chip, WHO_AM_I), byte);
    }
    chip.set_fault(None);
    write(&mut chip, FUNC_CFG_ACCESS, 0x80);
    assert_eq!(
        (read(&mut chip, WHO_AM_I), read(&mut chip, 0x01)),
        (0x00, 0x80)
    );
    write(&mut chip, CTRL1_XL, 0x00);
    write(&mut chip, FUNC_CFG_ACCESS, 0x00);
    assert_eq!(
        (read(&mut chip, WHO_AM_I), read(&mut chip, 0x10)),
        (0x6B, 0x68)
    );
    write(&mut chip, CTRL3_C, 0x4C);
    assert_eq!(read(&mut chip, WHO_AM_I), 0x00);
}

/// What can happen to a part.
#[derive(Clone, Debug)]
enum Event {
    Select,
    Exchange(u8),
    Convert([f64; 3], [f64; 3], f64),
    Advance(u64),
    Upset(u8, u8),
    BrownOut,
}

fn event() -> impl Strategy<Value = Event> {
    let felt = (any::<[f64; 3]>(), any::<[f64; 3]>(), any::<f64>());
    prop_oneof![
        3 => Just(Event::Select),
        9 => any::<u8>().prop_map(Event::Exchange),
        3 => felt.prop_map(|(f, r, t)| Event::Convert(f, r, t)),
        2 => (0..BOOT_NS * 2).prop_map(Event::Advance),
        2 => any::<(u8, u8)>().prop_map(|(a, v)| Event::Upset(a, v)),
        1 => Just(Event::BrownOut),
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
                Event::Exchange(byte) => { chip.exchange(byte); }
                Event::Convert(force_g, rate_dps, die_c) => chip.convert(force_g, rate_dps, die_c),
                Event::Advance(ns) => chip.advance_to(now_ns + ns),
                Event::Upset(address, value) => chip.upset(address, value),
                Event::BrownOut => chip.brown_out(now_ns),
            }
            prop_assert!(chip.fifo.count() <= FIFO_WORDS);
        }
        let start_ns = chip.now_ns();
        chip.power_on(start_ns);
        chip.advance_to(start_ns + BOOT_NS);
        prop_assert_eq!(read(&mut chip, WHO_AM_I), 0x6B);
    }
}
