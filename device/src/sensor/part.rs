//! What a channel needs of its sensor, whichever part it is.
//!
//! In: a [`PartConfig`], which names the part. Out: samples and the die's temperature, or a
//! [`PartError`]. Each part's driver implements [`Part`]; an instrument is built with one of them,
//! and what differs from part to part stands in the drivers.
//!
//! Left out: self-tests and FIFOs, which each part has in its own way, and the register that was
//! wrong, which the driver's own errors name.

use core::fmt::{self, Debug, Display, Formatter};

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use tilt::sample::{FullScale, Sample, Temperature};

use super::error::{InitError, ReadError, VerifyError};
use super::ism330dhcx::{self, Ism330dhcx};
use super::lis2dw12::Lis2dw12;
use super::{Config, Register};

/// Which part there is, and how it is set up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PartConfig {
    /// The accelerometer LIS2DW12.
    Lis2dw12(Config),
    /// The six-axis part ISM330DHCX.
    Ism330dhcx(ism330dhcx::Config),
}

impl PartConfig {
    /// Range of the accelerometer.
    pub const fn full_scale(&self) -> FullScale {
        match self {
            Self::Lis2dw12(config) => config.full_scale,
            Self::Ism330dhcx(config) => config.full_scale,
        }
    }

    /// Nominal time between two samples, us.
    pub const fn period_us(&self) -> u32 {
        match self {
            Self::Lis2dw12(config) => config.rate.period_us(),
            Self::Ism330dhcx(config) => config.rate.period_us(),
        }
    }
}

/// Why a part is not set up as it should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartError<E> {
    /// The SPI device reported an error.
    Bus(E),
    /// WHO_AM_I is another part's, or nobody answers.
    Identity,
    /// A register does not hold what was written to it: after a brown-out, the part's set-up.
    Register,
    /// The part's reset does not end.
    ResetStuck,
    /// The configuration is of another part than the driver. It never works.
    OtherPart,
}

impl<E: Debug> Display for PartError<E> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "SPI error {error:?}"),
            Self::Identity => f.write_str("the sensor does not answer by its name"),
            Self::Register => f.write_str("a register of the sensor does not hold what it should"),
            Self::ResetStuck => f.write_str("the sensor's reset does not end"),
            Self::OtherPart => f.write_str("the configuration is of another part"),
        }
    }
}

impl<E: Debug> core::error::Error for PartError<E> {}

impl<E> PartError<E> {
    /// What a failed read-back comes to; `name` is the part's WHO_AM_I.
    fn of<R: PartialEq>(error: VerifyError<E, R>, name: R) -> Self {
        match error {
            VerifyError::Bus(error) => Self::Bus(error),
            VerifyError::Mismatch(wrong) if wrong.register == name => Self::Identity,
            VerifyError::Mismatch(_) => Self::Register,
        }
    }
}

/// A driver, as a channel uses it.
pub trait Part {
    /// What the SPI device reports.
    type Error: Debug;

    /// Sets the part up and reads everything back; waits for its boot, some 20 ms.
    ///
    /// # Errors
    /// See [`PartError`].
    fn init<D: DelayNs>(
        &mut self,
        config: &PartConfig,
        delay: &mut D,
    ) -> Result<(), PartError<Self::Error>>;

    /// Reads the part's name and its whole configuration back.
    ///
    /// # Errors
    /// The bus failed, or a register is wrong.
    fn verify(&mut self) -> Result<(), PartError<Self::Error>>;

    /// The newest sample; `None` when there is nothing new.
    ///
    /// # Errors
    /// The bus failed or its data line is stuck.
    fn read(&mut self) -> Result<Option<Sample>, ReadError<Self::Error>>;

    /// The die's temperature.
    ///
    /// # Errors
    /// The bus failed or its data line is stuck.
    fn read_temperature(&mut self) -> Result<Temperature, ReadError<Self::Error>>;
}

impl<SPI: SpiDevice> Part for Lis2dw12<SPI> {
    type Error = SPI::Error;

    fn init<D: DelayNs>(
        &mut self,
        config: &PartConfig,
        delay: &mut D,
    ) -> Result<(), PartError<SPI::Error>> {
        let PartConfig::Lis2dw12(config) = config else {
            return Err(PartError::OtherPart);
        };
        self.init(config, delay).map_err(|error| match error {
            InitError::Bus(error) => PartError::Bus(error),
            InitError::Mismatch(wrong) => {
                PartError::of(VerifyError::Mismatch(wrong), Register::WhoAmI)
            }
            InitError::ResetStuck { .. } => PartError::ResetStuck,
        })
    }

    fn verify(&mut self) -> Result<(), PartError<SPI::Error>> {
        let seen = self.verify().map(|_| ());
        seen.map_err(|error| PartError::of(error, Register::WhoAmI))
    }

    #[inline]
    fn read(&mut self) -> Result<Option<Sample>, ReadError<SPI::Error>> {
        let sample = self.read()?;
        Ok(sample.map(|sample| sample.counts.into()))
    }

    fn read_temperature(&mut self) -> Result<Temperature, ReadError<SPI::Error>> {
        self.read_temperature()
    }
}

impl<SPI: SpiDevice> Part for Ism330dhcx<SPI> {
    type Error = SPI::Error;

    fn init<D: DelayNs>(
        &mut self,
        config: &PartConfig,
        delay: &mut D,
    ) -> Result<(), PartError<SPI::Error>> {
        let PartConfig::Ism330dhcx(config) = config else {
            return Err(PartError::OtherPart);
        };
        // Rates are good 80 ms later. The estimator's first block takes as long, and no rate.
        self.init(config, delay).map_err(|error| match error {
            ism330dhcx::InitError::Bus(error) => PartError::Bus(error),
            ism330dhcx::InitError::Mismatch(wrong) => {
                PartError::of(VerifyError::Mismatch(wrong), ism330dhcx::Register::WhoAmI)
            }
            ism330dhcx::InitError::ResetStuck { .. } => PartError::ResetStuck,
        })
    }

    fn verify(&mut self) -> Result<(), PartError<SPI::Error>> {
        let seen = self.verify().map(|_| ());
        seen.map_err(|error| PartError::of(error, ism330dhcx::Register::WhoAmI))
    }

    #[inline]
    fn read(&mut self) -> Result<Option<Sample>, ReadError<SPI::Error>> {
        let sample = self.read()?;
        // An accelerometer that stands still while the gyroscope goes on gives no sample.
        let whole = sample.filter(|sample| sample.acceleration_is_new);
        Ok(whole.map(|sample| Sample {
            counts: sample.acceleration,
            rate: Some(sample.rate),
        }))
    }

    fn read_temperature(&mut self) -> Result<Temperature, ReadError<SPI::Error>> {
        self.read_temperature()
    }
}
