//! Why an operation of the driver failed: one small enum per operation.
//!
//! A bus error keeps the error `E` of the SPI device. A register that does not hold what it
//! should is named, with what was expected and what was found. `R` is the part's own list of
//! registers, the LIS2DW12's where nothing else is written.

use core::error::Error;
use core::fmt::{self, Debug, Display, Formatter};

use super::registers::Register;

/// A register that does not hold what was written to it, or what the part always has there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mismatch<R = Register> {
    /// The register.
    pub register: R,
    /// What it should hold.
    pub expected: u8,
    /// What was read.
    pub found: u8,
}

impl<R: Display> Display for Mismatch<R> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            register,
            expected,
            found,
        } = self;
        write!(
            f,
            "{register} holds {found:02X}h instead of {expected:02X}h"
        )
    }
}

/// Why the set-up failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InitError<E> {
    /// The SPI device reported an error.
    Bus(E),
    /// A register is wrong: WHO_AM_I when it is another part or nobody answers.
    Mismatch(Mismatch),
    /// BOOT or SOFT_RESET stayed set.
    ResetStuck {
        /// What CTRL2 held at the last look.
        ctrl2: u8,
    },
}

/// Why the periodic read-back failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VerifyError<E, R = Register> {
    /// The SPI device reported an error.
    Bus(E),
    /// A register is wrong: after a brown-out this is CTRL1, back in power-down.
    Mismatch(Mismatch<R>),
}

/// Why samples or the temperature could not be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadError<E> {
    /// The SPI device reported an error.
    Bus(E),
    /// Every byte was FFh, which the part cannot send: the data line is stuck high.
    StuckHigh,
}

/// Why the self-test has no result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelfTestError<E, R = Register> {
    /// The SPI device reported an error.
    Bus(E),
    /// A register did not take the self-test's setting.
    Mismatch(Mismatch<R>),
    /// Every byte was FFh: the data line is stuck high.
    StuckHigh,
    /// Data-ready did not come within 50 ms at 50 Hz.
    NoData,
    /// The part could not be brought back to its previous configuration: run `init`.
    Restore(VerifyError<E, R>),
}

impl<E> From<VerifyError<E>> for InitError<E> {
    fn from(error: VerifyError<E>) -> Self {
        match error {
            VerifyError::Bus(error) => Self::Bus(error),
            VerifyError::Mismatch(mismatch) => Self::Mismatch(mismatch),
        }
    }
}

impl<E, R> From<VerifyError<E, R>> for SelfTestError<E, R> {
    fn from(error: VerifyError<E, R>) -> Self {
        match error {
            VerifyError::Bus(error) => Self::Bus(error),
            VerifyError::Mismatch(mismatch) => Self::Mismatch(mismatch),
        }
    }
}

impl<E, R> From<ReadError<E>> for SelfTestError<E, R> {
    fn from(error: ReadError<E>) -> Self {
        match error {
            ReadError::Bus(error) => Self::Bus(error),
            ReadError::StuckHigh => Self::StuckHigh,
        }
    }
}

/// Holds a register against what it should contain.
pub(super) fn expect<E, R>(register: R, expected: u8, found: u8) -> Result<(), VerifyError<E, R>> {
    if expected == found {
        Ok(())
    } else {
        Err(VerifyError::Mismatch(Mismatch {
            register,
            expected,
            found,
        }))
    }
}

const STUCK_HIGH: &str = "the sensor's data line is stuck high";

impl<E: Debug> Display for InitError<E> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "SPI error {error:?} during the sensor's set-up"),
            Self::Mismatch(mismatch) => Display::fmt(mismatch, f),
            Self::ResetStuck { ctrl2 } => {
                write!(
                    f,
                    "the sensor's reset does not end (CTRL2 holds {ctrl2:02X}h)"
                )
            }
        }
    }
}

impl<E: Debug, R: Display> Display for VerifyError<E, R> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "SPI error {error:?} during the read-back"),
            Self::Mismatch(mismatch) => Display::fmt(mismatch, f),
        }
    }
}

impl<E: Debug> Display for ReadError<E> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "SPI error {error:?} while reading the sensor"),
            Self::StuckHigh => f.write_str(STUCK_HIGH),
        }
    }
}

impl<E: Debug, R: Display> Display for SelfTestError<E, R> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "SPI error {error:?} during the self-test"),
            Self::Mismatch(mismatch) => Display::fmt(mismatch, f),
            Self::StuckHigh => f.write_str(STUCK_HIGH),
            Self::NoData => f.write_str("no sample from the sensor during the self-test"),
            Self::Restore(error) => write!(f, "not restored after the self-test: {error}"),
        }
    }
}

impl<E: Debug> Error for InitError<E> {}
impl<E: Debug, R: Debug + Display> Error for VerifyError<E, R> {}
impl<E: Debug> Error for ReadError<E> {}
impl<E: Debug, R: Debug + Display> Error for SelfTestError<E, R> {}
