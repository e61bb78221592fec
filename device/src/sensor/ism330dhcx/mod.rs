//! The six-axis part of the variant with a gyroscope: an ISM330DHCX on SPI, registers to counts.
//!
//! In: an `embedded_hal::spi::SpiDevice` (mode 3 or 0, at most 10 MHz) and a [`Config`].
//! Out: [`InertialSample`]s of acceleration and rate in counts with the die temperature in
//! 1/256 degC, tagged FIFO words, the self-test's differences in mg and mdps, or the reason why
//! there is none.
//!
//! Register facts follow the data sheet DS13012 and ST's open driver; why this part was chosen,
//! and which figures could be checked, is written in `docs/gyroscope-parts.md`. Left out: the
//! second interface for image stabilisation, the sensor hub, time stamps, FIFO compression, the
//! event engine, the machine-learning core and the +-4000 deg/s range.
//!
//! ```
//! use device::sensor::ism330dhcx::{Config, InitError, Ism330dhcx};
//! use embedded_hal::{delay::DelayNs, spi::SpiDevice};
//!
//! fn start<S: SpiDevice>(
//!     spi: S,
//!     delay: &mut impl DelayNs,
//! ) -> Result<Ism330dhcx<S>, InitError<S::Error>> {
//!     let mut sensor = Ism330dhcx::new(spi);
//!     sensor.init(&Config::PRODUCT, delay)?;
//!     Ok(sensor)
//! }
//! ```

mod config;
mod driver;
mod error;
mod fifo;
mod registers;
mod self_test;

#[cfg(test)]
mod tests;

pub use config::{
    ACCELEROMETER_DELAY_MILLISAMPLES, Bandwidth, Config, DataRate, Fifo,
    GYROSCOPE_DELAY_MILLISAMPLES, RateFilter,
};
pub use driver::{Health, InertialSample, Ism330dhcx, START_MS};
pub use error::{InitError, Mismatch, SelfTestError, VerifyError};
pub use fifo::{FIFO_WORDS, FifoData, FifoRead, FifoWord};
pub use registers::{PART_ID, Register};
pub use self_test::SelfTest;
