//! The driver of whichever part there is, for hosts that decide at run time.
//!
//! In and out: as [`Part`], of the part that it was made for. No image has it: those are built with
//! one part's driver.

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use tilt::sample::{Sample, Temperature};

use super::ism330dhcx::Ism330dhcx;
use super::{Lis2dw12, Part, PartConfig, PartError, ReadError};

/// A driver of either part, each behind its own kind of wires.
#[derive(Clone, Debug)]
pub enum AnyDriver<A, G> {
    /// Of the accelerometer.
    Lis2dw12(Lis2dw12<A>),
    /// Of the part with a gyroscope.
    Ism330dhcx(Ism330dhcx<G>),
}

impl<A, G> AnyDriver<A, G> {
    /// The accelerometer's own driver; `None` where there is another part.
    pub const fn lis2dw12(&mut self) -> Option<&mut Lis2dw12<A>> {
        match self {
            Self::Lis2dw12(part) => Some(part),
            Self::Ism330dhcx(_) => None,
        }
    }
}

impl<A: SpiDevice, G: SpiDevice<Error = A::Error>> Part for AnyDriver<A, G> {
    type Error = A::Error;

    fn init<D: DelayNs>(
        &mut self,
        config: &PartConfig,
        delay: &mut D,
    ) -> Result<(), PartError<A::Error>> {
        match self {
            Self::Lis2dw12(part) => Part::init(part, config, delay),
            Self::Ism330dhcx(part) => Part::init(part, config, delay),
        }
    }

    fn verify(&mut self) -> Result<(), PartError<A::Error>> {
        match self {
            Self::Lis2dw12(part) => Part::verify(part),
            Self::Ism330dhcx(part) => Part::verify(part),
        }
    }

    fn read(&mut self) -> Result<Option<Sample>, ReadError<A::Error>> {
        match self {
            Self::Lis2dw12(part) => Part::read(part),
            Self::Ism330dhcx(part) => Part::read(part),
        }
    }

    fn read_temperature(&mut self) -> Result<Temperature, ReadError<A::Error>> {
        match self {
            Self::Lis2dw12(part) => Part::read_temperature(part),
            Self::Ism330dhcx(part) => Part::read_temperature(part),
        }
    }
}
