//! The driver against a scripted SPI device: bytes on the wire, bus errors, arbitrary answers.
//!
//! How it works with the register-level model of the part is tested in `sim`.

extern crate std;

use core::iter;
use std::string::ToString;
use std::vec::Vec;

use proptest::prelude::*;
use tilt::sample::{Counts, RateCounts, Temperature};

use super::super::ReadError;
use super::super::tests::{Broken, Script, Waited};
use super::*;

fn answering(answers: &[u8]) -> Ism330dhcx<Script> {
    Ism330dhcx::new(Script {
        answers: answers.to_vec(),
        ..Script::default()
    })
}

/// What a healthy part in product mode answers to the set-up, transfer by transfer.
fn healthy_set_up() -> Vec<u8> {
    iter::once(0x6B) // WHO_AM_I
        .chain([0x04]) // CTRL3_C after the reset
        .chain([0; 16]) // the old sample
        .chain([0x00, 0x3F, 0, 0, 0, 0]) // FUNC_CFG_ACCESS to 06h
        .chain([0, 0, 0, 0, 0x80, 0x00, 0x02, 0x00, 0x6B]) // FIFO_CTRL1 to WHO_AM_I
        .chain(Config::PRODUCT.control())
        .chain([0; 13]) // events and offsets
        .collect()
}

#[test]
fn a_sample_is_one_burst_from_status_to_outz_h_a() {
    let mut bytes = [0; 16];
    bytes[0] = 0x07;
    bytes[2..4].copy_from_slice(&[0x80, 0x01]);
    bytes[4..10].copy_from_slice(&[1, 0, 0xFF, 0xFF, 0x00, 0x80]);
    bytes[10..].copy_from_slice(&[4, 0, 0xFC, 0xFF, 0x00, 0x20]);
    let mut sensor = answering(&bytes);
    let sample = sensor.read().unwrap().unwrap();
    assert_eq!(sample.rate, RateCounts([1, -1, i16::MIN]));
    assert_eq!(sample.acceleration, Counts([4, -4, 8192]));
    assert_eq!(sample.temperature, Temperature(26 * 256 + 128));
    assert!(sample.acceleration_is_new);
    assert_eq!(sensor.release().seen, [(Vec::from([0x9E]), 16)]);
}

#[test]
fn the_gyroscope_counts_the_samples() {
    let read = |status: u8| {
        let mut bytes = [1; 16];
        bytes[0] = status;
        answering(&bytes).read().unwrap()
    };
    assert_eq!(read(0x00), None);
    assert_eq!(read(0x05), None);
    assert!(!read(0x02).unwrap().acceleration_is_new);
    assert!(read(0x03).unwrap().acceleration_is_new);
}

#[test]
fn a_line_stuck_high_is_no_sample() {
    assert_eq!(answering(&[0xFF; 16]).read(), Err(ReadError::StuckHigh));
    let temperature = answering(&[0xFF; 4]).read_temperature();
    assert_eq!(temperature, Err(ReadError::StuckHigh));
    let fifo = answering(&[0xFF; 2]).read_fifo(&mut []);
    assert_eq!(fifo, Err(ReadError::StuckHigh));
}

#[test]
fn temperature_is_256_steps_per_degree_above_25() {
    let read = |low, high| answering(&[0x04, 0, low, high]).read_temperature();
    assert_eq!(read(0x00, 0x00), Ok(Temperature::from_celsius(25)));
    // FFFFh is a temperature as any other.
    assert_eq!(read(0xFF, 0xFF), Ok(Temperature(25 * 256 - 1)));
}

#[test]
fn fifo_words_have_their_sensor_and_slot() {
    let words = [
        0x0A, 1, 0, 2, 0, 3, 0, 0x12, 0, 1, 0, 2, 0, 3, 0x1C, 0, 0, 0, 0, 0, 0,
    ];
    let answers: Vec<u8> = [4, 0x08].into_iter().chain(words).collect();
    let mut sensor = answering(&answers);
    let mut out = [FifoWord::default(); 3];
    let read = sensor.read_fifo(&mut out).unwrap();
    assert_eq!((read.count, read.left, read.overrun), (3, 1, true));
    let rate = FifoData::Rate(RateCounts([1, 2, 3]));
    let acceleration = FifoData::Acceleration(Counts([256, 512, 768]));
    assert_eq!(out.map(|word| word.slot), [1, 1, 2]);
    let data = [rate, acceleration, FifoData::Other { tag: 3 }];
    assert_eq!(out.map(|word| word.data), data);
}

#[test]
fn the_set_up_starts_the_sensors_last_and_waits_for_the_boot() {
    let mut sensor = answering(&healthy_set_up());
    let mut waited = Waited::default();
    assert_eq!(sensor.init(&Config::PRODUCT, &mut waited), Ok(()));
    assert!(waited.0 >= 10_000_000, "{}", waited.0);
    let seen = sensor.release().seen;
    let writes: Vec<&[u8]> = seen
        .iter()
        .filter(|t| t.1 == 0)
        .map(|t| t.0.as_slice())
        .collect();
    let expected: [&[u8]; 23] = [
        &[0x01, 0x00],
        &[0x10, 0x00],
        &[0x11, 0x00],
        &[0x12, 0x05],
        &[0x10, 0x00],
        &[0x11, 0x00],
        &[0x12, 0x44],
        &[0x13, 0x04],
        &[0x14, 0x00],
        &[0x15, 0x00],
        &[0x16, 0x00],
        &[0x17, 0x00],
        &[0x18, 0xE2],
        &[0x19, 0x00],
        &[0x0B, 0x80],
        &[0x0D, 0x02],
        &[0x0A, 0x00],
        &[0x07, 0x00],
        &[0x08, 0x00],
        &[0x09, 0x00],
        &[0x0A, 0x00],
        &[0x10, 0x68],
        &[0x11, 0x64],
    ];
    assert_eq!(writes, expected);
}

#[test]
fn the_read_back_is_four_bursts() {
    let mut sensor = answering(&healthy_set_up()[18..]);
    assert_eq!(sensor.verify().map(|health| health.fifo_level), Ok(0));
    let lengths: Vec<usize> = sensor.release().seen.iter().map(|t| t.1).collect();
    assert_eq!(lengths, [25, 10, 3, 2]);
}

#[test]
fn a_reset_that_does_not_end_is_given_up_after_25_ms() {
    let answers = [0x6B].into_iter().chain([0x45; 1000]).collect::<Vec<u8>>();
    let mut waited = Waited::default();
    let error = answering(&answers).init(&Config::PRODUCT, &mut waited);
    assert_eq!(error, Err(InitError::ResetStuck { ctrl3_c: 0x45 }));
    assert_eq!(waited.0, 35_000_000);
}

#[test]
fn a_bus_error_keeps_its_cause_wherever_it_strikes() {
    let script = |fail_after| Script {
        answers: healthy_set_up(),
        fail_after: Some(fail_after),
        ..Script::default()
    };
    // 23 writes, identity, one look, the old sample, 3 bursts of read-back.
    for fail_after in 0..29 {
        let outcome =
            Ism330dhcx::new(script(fail_after)).init(&Config::PRODUCT, &mut Waited::default());
        let want = Err(InitError::Bus(Broken(7)));
        assert_eq!(outcome, want, "at transfer {fail_after}");
    }
    let broken = || Ism330dhcx::new(script(0));
    assert_eq!(broken().read(), Err(ReadError::Bus(Broken(7))));
    assert_eq!(broken().read_temperature(), Err(ReadError::Bus(Broken(7))));
    assert_eq!(broken().verify(), Err(VerifyError::Bus(Broken(7))));
    let test = broken().self_test(&mut Waited::default());
    let want = SelfTestError::Restore(VerifyError::Bus(Broken(7)));
    assert_eq!(test, Err(want));
}

#[test]
fn an_error_names_the_register_and_what_it_holds() {
    let mismatch = Mismatch {
        register: Register::Ctrl2G,
        expected: 0x64,
        found: 0x00,
    };
    let error: VerifyError<Broken> = VerifyError::Mismatch(mismatch);
    let text = "CTRL2_G (11h) holds 00h instead of 64h";
    assert_eq!(error.to_string(), text);
    assert_eq!(InitError::<Broken>::from(error).to_string(), text);
}

proptest! {
    /// Whatever the part answers and whenever the bus fails, the driver comes back.
    #[test]
    fn arbitrary_answers_never_panic(
        answers in prop::collection::vec(any::<u8>(), 0..900),
        fail_after in prop::option::of(0..90_usize),
    ) {
        let script = || Script { answers: answers.clone(), fail_after, ..Script::default() };
        let mut out = [FifoWord::default(); 40];
        let mut waited = Waited::default();
        let _ = Ism330dhcx::new(script()).init(&Config::PRODUCT, &mut waited);
        let _ = Ism330dhcx::new(script()).verify();
        let _ = Ism330dhcx::new(script()).read();
        let _ = Ism330dhcx::new(script()).read_temperature();
        let _ = Ism330dhcx::new(script()).self_test(&mut waited);
        if let Ok(read) = Ism330dhcx::new(script()).read_fifo(&mut out) {
            prop_assert!(read.count + read.left <= FIFO_WORDS);
        }
    }
}
