//! The sensor: an LIS2DW12 on SPI, from registers to counts; beside it, in [`ism330dhcx`], the
//! six-axis part of the variant with a gyroscope.
//!
//! In: an `embedded_hal::spi::SpiDevice` (mode 3, at most 10 MHz) and a [`Config`].
//! Out: [`Sample`]s in left-justified counts (1 g = 16384 at +-2 g), the die temperature in
//! 1/256 degC, the self-test's difference in mg, or the reason why there is none.
//!
//! Register facts follow the data sheet DS11811. Turning counts into an angle is `tilt`'s
//! business; deciding what a failed read-back means is the channel's.
//!
//! ```
//! use device::sensor::{Config, InitError, Lis2dw12};
//! use embedded_hal::{delay::DelayNs, spi::SpiDevice};
//!
//! fn start<S: SpiDevice>(
//!     spi: S,
//!     delay: &mut impl DelayNs,
//! ) -> Result<Lis2dw12<S>, InitError<S::Error>> {
//!     let mut sensor = Lis2dw12::new(spi);
//!     sensor.init(&Config::PRODUCT, delay)?;
//!     Ok(sensor)
//! }
//! ```

mod any_driver;
mod config;
mod error;
pub mod ism330dhcx;
mod lis2dw12;
mod part;
mod registers;
mod self_test;
mod wire;

#[cfg(test)]
mod tests;

pub use any_driver::AnyDriver;
pub use config::{Bandwidth, Config, Fifo, Rate};
pub use error::{InitError, Mismatch, ReadError, SelfTestError, VerifyError};
pub use lis2dw12::{FIFO_DEPTH, FifoRead, Health, Lis2dw12, Sample};
pub use part::{Part, PartConfig, PartError};
pub use registers::{PART_ID, Register};
pub use self_test::SelfTest;
