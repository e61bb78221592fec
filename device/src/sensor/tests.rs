//! The driver against a scripted SPI device: bytes on the wire, bus errors, arbitrary answers.
//!
//! How it works with the register-level model of the part is tested in `sim`.

extern crate std;

use core::iter;
use std::string::ToString;
use std::vec::Vec;

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{Error, ErrorKind, ErrorType, Operation, SpiDevice};
use proptest::prelude::*;
use tilt::sample::{Counts, Temperature};

use super::*;

/// What went over the wire: the bytes written, and how many were then read.
pub(super) type Transfer = (Vec<u8>, usize);

/// Answers every read from a list of bytes, then with zeros; fails after a number of transfers.
#[derive(Debug, Default)]
pub(super) struct Script {
    pub(super) answers: Vec<u8>,
    pub(super) next: usize,
    pub(super) seen: Vec<Transfer>,
    pub(super) fail_after: Option<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Broken(pub(super) u8);

impl Error for Broken {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl ErrorType for Script {
    type Error = Broken;
}

impl SpiDevice for Script {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Broken> {
        if self.fail_after == Some(self.seen.len()) {
            return Err(Broken(7));
        }
        let mut transfer = (Vec::new(), 0);
        for operation in operations {
            match operation {
                Operation::Write(bytes) => transfer.0.extend_from_slice(bytes),
                Operation::Read(bytes) => {
                    for byte in bytes.iter_mut() {
                        *byte = self.answers.get(self.next).copied().unwrap_or(0);
                        self.next += 1;
                    }
                    transfer.1 += bytes.len();
                }
                other => panic!("the driver does not use {other:?}"),
            }
        }
        self.seen.push(transfer);
        Ok(())
    }
}

/// Adds up what was waited, in nanoseconds.
#[derive(Default)]
pub(super) struct Waited(pub(super) u64);

impl DelayNs for Waited {
    fn delay_ns(&mut self, ns: u32) {
        self.0 += u64::from(ns);
    }
}

fn answering(answers: &[u8]) -> Lis2dw12<Script> {
    Lis2dw12::new(Script {
        answers: answers.to_vec(),
        ..Script::default()
    })
}

#[test]
fn a_sample_is_one_burst_from_out_t_to_out_z_h() {
    let mut sensor = answering(&[0xFD, 0x01, 0x04, 0x00, 0xFC, 0xFF, 0x00, 0x40]);
    let sample = sensor.read().unwrap().unwrap();
    assert_eq!(sample.counts, Counts([4, -4, 16384]));
    assert_eq!(sample.temperature_whole_c, 22);
    assert_eq!(sensor.release().seen, [(Vec::from([0xA6]), 8)]);
}

#[test]
fn no_data_ready_is_no_sample() {
    let mut sensor = answering(&[0x00, 0xFE, 1, 2, 3, 4, 5, 6]);
    assert_eq!(sensor.read(), Ok(None));
}

#[test]
fn a_line_stuck_high_is_no_sample() {
    assert_eq!(answering(&[0xFF; 8]).read(), Err(ReadError::StuckHigh));
    assert_eq!(
        answering(&[0xFF; 2]).read_temperature(),
        Err(ReadError::StuckHigh)
    );
    assert_eq!(
        answering(&[0xFF]).read_fifo(&mut []),
        Err(ReadError::StuckHigh)
    );
}

#[test]
fn temperature_is_256_steps_per_degree_above_25() {
    assert_eq!(
        answering(&[0x00, 0x00]).read_temperature(),
        Ok(Temperature::from_celsius(25))
    );
    // -3 5/16 degC from 25.
    assert_eq!(
        answering(&[0xB0, 0xFC]).read_temperature(),
        Ok(Temperature(22 * 256 - 5 * 16))
    );
}

#[test]
fn the_set_up_writes_ctrl1_last_and_waits_for_the_boot() {
    let reads: Vec<u8> = iter::once(0x44) // WHO_AM_I
        .chain([0x04]) // CTRL2 after the reset
        .chain([0; 6]) // the old sample
        .chain([0x44])
        .chain(Config::PRODUCT.control())
        .chain([0; 17]) // FIFO_CTRL to Z_OFS_USR
        .chain([0x80])
        .collect();
    let mut sensor = answering(&reads);
    let mut waited = Waited::default();
    assert_eq!(sensor.init(&Config::PRODUCT, &mut waited), Ok(()));
    assert!(waited.0 >= 20_000_000, "{}", waited.0);
    let seen = sensor.release().seen;
    let writes: Vec<&[u8]> = seen
        .iter()
        .filter(|t| t.1 == 0)
        .map(|t| t.0.as_slice())
        .collect();
    let expected: [&[u8]; 10] = [
        &[0x21, 0x44],
        &[0x20, 0x00],
        &[0x21, 0x0E],
        &[0x22, 0x00],
        &[0x25, 0x04],
        &[0x23, 0x01],
        &[0x3F, 0x80],
        &[0x2E, 0x00],
        &[0x2E, 0x00],
        &[0x20, 0x74],
    ];
    assert_eq!(writes, expected);
}

#[test]
fn a_reset_that_does_not_end_is_given_up_after_25_ms() {
    let mut sensor = answering(&[0x44; 1000]);
    let mut waited = Waited::default();
    let error = sensor.init(&Config::PRODUCT, &mut waited);
    assert_eq!(error, Err(InitError::ResetStuck { ctrl2: 0x44 }));
    assert_eq!(waited.0, 45_000_000);
}

#[test]
fn a_bus_error_keeps_its_cause_wherever_it_strikes() {
    // 1 identity, 1 reset, 1 look, 7 writes, the old sample, CTRL1, 3 bursts of read-back.
    for fail_after in 0..15 {
        let mut answers = Vec::from([0x44, 0x04]);
        answers.extend([0; 6]);
        answers.push(0x44);
        answers.extend(Config::PAPER.control());
        let script = Script {
            answers,
            fail_after: Some(fail_after),
            ..Script::default()
        };
        let outcome = Lis2dw12::new(script).init(&Config::PAPER, &mut Waited::default());
        assert_eq!(
            outcome,
            Err(InitError::Bus(Broken(7))),
            "at transfer {fail_after}"
        );
    }
    let broken = || {
        Lis2dw12::new(Script {
            fail_after: Some(0),
            ..Script::default()
        })
    };
    assert_eq!(broken().read(), Err(ReadError::Bus(Broken(7))));
    assert_eq!(broken().read_temperature(), Err(ReadError::Bus(Broken(7))));
    assert_eq!(broken().verify(), Err(VerifyError::Bus(Broken(7))));
    let test = broken().self_test(&mut Waited::default());
    assert_eq!(
        test,
        Err(SelfTestError::Restore(VerifyError::Bus(Broken(7))))
    );
}

#[test]
fn an_error_names_the_register_and_what_it_holds() {
    let mismatch = Mismatch {
        register: Register::Ctrl1,
        expected: 0x74,
        found: 0x00,
    };
    let error: VerifyError<Broken> = VerifyError::Mismatch(mismatch);
    assert_eq!(error.to_string(), "CTRL1 (20h) holds 00h instead of 74h");
}

proptest! {
    /// Whatever the part answers and whenever the bus fails, the driver comes back.
    #[test]
    fn arbitrary_answers_never_panic(
        answers in prop::collection::vec(any::<u8>(), 0..600),
        fail_after in prop::option::of(0..60_usize),
    ) {
        let script = || Script { answers: answers.clone(), fail_after, ..Script::default() };
        let mut out = [Counts::default(); 40];
        let mut waited = Waited::default();
        let _ = Lis2dw12::new(script()).init(&Config::PRODUCT, &mut waited);
        let _ = Lis2dw12::new(script()).verify();
        let _ = Lis2dw12::new(script()).read();
        let _ = Lis2dw12::new(script()).read_temperature();
        let _ = Lis2dw12::new(script()).self_test(&mut waited);
        if let Ok(read) = Lis2dw12::new(script()).read_fifo(&mut out) {
            prop_assert!(read.count + read.left <= FIFO_DEPTH);
        }
    }
}
