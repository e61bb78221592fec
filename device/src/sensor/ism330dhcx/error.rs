//! The shared errors with this part's registers, and why its set-up failed.

use core::error::Error;
use core::fmt::{self, Debug, Display, Formatter};

use super::super::error;
use super::registers::Register;

/// A register of this part that does not hold what it should.
pub type Mismatch = error::Mismatch<Register>;
/// Why the periodic read-back failed.
pub type VerifyError<E> = error::VerifyError<E, Register>;
/// Why the self-test has no result.
pub type SelfTestError<E> = error::SelfTestError<E, Register>;

/// Why the set-up failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InitError<E> {
    /// The SPI device reported an error.
    Bus(E),
    /// A register is wrong: WHO_AM_I when it is another part or nobody answers.
    Mismatch(Mismatch),
    /// BOOT or SW_RESET stayed set.
    ResetStuck {
        /// What CTRL3_C held at the last look.
        ctrl3_c: u8,
    },
}

impl<E> From<VerifyError<E>> for InitError<E> {
    fn from(error: VerifyError<E>) -> Self {
        match error {
            VerifyError::Bus(error) => Self::Bus(error),
            VerifyError::Mismatch(mismatch) => Self::Mismatch(mismatch),
        }
    }
}

impl<E: Debug> Display for InitError<E> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "SPI error {error:?} during the sensor's set-up"),
            Self::Mismatch(mismatch) => Display::fmt(mismatch, f),
            Self::ResetStuck { ctrl3_c } => write!(
                f,
                "the sensor's reset does not end (CTRL3_C holds {ctrl3_c:02X}h)"
            ),
        }
    }
}

impl<E: Debug> Error for InitError<E> {}
