//! The LIS2DW12 on an SPI device: set-up, read-back, samples, temperature, FIFO.
//!
//! In: a `SpiDevice` in mode 3, at most 10 MHz. Out: [`Sample`]s in left-justified counts, or a
//! reason. Every loop is bounded and nothing here panics. Waiting happens in `init` and in the
//! self-test only. Interrupt pins, the low-power modes and the event engine (tap, free fall,
//! wake-up) are left out.

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use tilt::sample::{Counts, Temperature};

use super::config::{Config, Fifo};
use super::error::{InitError, ReadError, VerifyError, expect};
use super::registers::{
    CTRL2_BOOT, CTRL2_IF_ADD_INC, CTRL2_SOFT_RESET, CTRL7_DRDY_PULSED, FIFO_SAMPLES_DIFF,
    FIFO_SAMPLES_OVR, PART_ID, Register, STATUS_DRDY,
};
use super::wire;

/// Time from power-up until the part answers, in milliseconds (data sheet: boot time 20 ms).
const BOOT_MS: u32 = 20;

/// Time between two looks at CTRL2 during a reset, in microseconds. The reset takes about 5.
const RESET_POLL_US: u32 = 50;

/// Looks at CTRL2 before the reset counts as stuck: 25 ms, longer than a BOOT takes.
const RESET_POLLS: u32 = 500;

/// Depth of the part's FIFO in samples.
pub const FIFO_DEPTH: usize = 32;

/// CTRL1 to CTRL6, in the order of their addresses.
const CONTROL: [Register; 6] = [
    Register::Ctrl1,
    Register::Ctrl2,
    Register::Ctrl3,
    Register::Ctrl4Int1,
    Register::Ctrl5Int2,
    Register::Ctrl6,
];

/// Registers above FIFO_CTRL that keep their reset value, zero.
const UNUSED: [Register; 10] = [
    Register::TapThsX,
    Register::TapThsY,
    Register::TapThsZ,
    Register::IntDur,
    Register::WakeUpThs,
    Register::WakeUpDur,
    Register::FreeFall,
    Register::XOfsUsr,
    Register::YOfsUsr,
    Register::ZOfsUsr,
];

/// Bytes from FIFO_CTRL (2Eh) to CTRL7 (3Fh).
const UPPER_BYTES: usize = 18;

/// One reading of the output registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// The three axes, left-justified; their scale is the configured full scale.
    pub counts: Counts,
    /// Die temperature in whole degC, -103 to 127 (OUT_T, 26h; offset up to +-15 degC \[DS\]).
    pub temperature_whole_c: i8,
}

/// What one call of `read_fifo` brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FifoRead {
    /// Samples written to the front of the caller's slice, oldest first; 0 to 32.
    pub count: usize,
    /// Samples that were there but found no room in the slice; 0 to 32.
    pub left: usize,
    /// Samples were lost before this read because the FIFO was full.
    pub overrun: bool,
}

/// What the read-back saw besides a correct configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Health {
    /// Unread samples in the FIFO, 0 to 32.
    pub fifo_level: u8,
    /// Samples were lost because the FIFO was full.
    pub fifo_overrun: bool,
}

/// The driver. It owns the SPI device and remembers the configuration it has to defend.
///
/// Until `init` has been called, that configuration is [`Config::PRODUCT`], which a part fresh
/// from reset does not have: `verify` then fails, as it should.
#[derive(Clone, Debug)]
pub struct Lis2dw12<SPI> {
    spi: SPI,
    config: Config,
}

impl<SPI> Lis2dw12<SPI> {
    /// A driver for the part behind `spi`. Touches nothing yet.
    pub const fn new(spi: SPI) -> Self {
        Self {
            spi,
            config: Config::PRODUCT,
        }
    }

    /// The configuration given to the last `init`.
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// Gives the SPI device back.
    pub fn release(self) -> SPI {
        self.spi
    }
}

impl<SPI: SpiDevice> Lis2dw12<SPI> {
    /// Sets the part up and reads everything back.
    ///
    /// In: the configuration, and something to wait with. Takes 20 ms plus the transfers, at
    /// most 45 ms when the reset does not end. May be called again at any time, for instance
    /// after `verify` failed.
    ///
    /// # Errors
    /// The bus failed, WHO_AM_I or a configuration register is wrong, or the reset is stuck.
    pub fn init<D: DelayNs>(
        &mut self,
        config: &Config,
        delay: &mut D,
    ) -> Result<(), InitError<SPI::Error>> {
        self.config = *config;
        delay.delay_ms(BOOT_MS);
        self.check_identity()?;
        self.reset(delay)?;
        self.apply(config)?;
        Ok(())
    }

    /// Reads WHO_AM_I and all configuration registers back, in three bursts of 1, 6 and 18 bytes.
    ///
    /// Meant to be called about every 100 ms. The output registers are not touched, so no sample
    /// is lost by it.
    ///
    /// # Errors
    /// The bus failed, or the first wrong register with its expected and its actual content.
    pub fn verify(&mut self) -> Result<Health, VerifyError<SPI::Error>> {
        let config = self.config;
        self.check(&config)
    }

    /// Reads the newest sample in one burst from OUT_T (26h) over STATUS (27h) to OUT_Z_H (2Dh).
    ///
    /// `None` when data-ready is not set: nothing new since the last read. With the FIFO on this
    /// takes the oldest entry; use `read_fifo` then.
    ///
    /// # Errors
    /// The bus failed, or all eight bytes are FFh. A line stuck low reads as "no new sample",
    /// which the caller sees as a stale channel and `verify` as a wrong WHO_AM_I.
    pub fn read(&mut self) -> Result<Option<Sample>, ReadError<SPI::Error>> {
        let bytes: [u8; 8] = self.burst(Register::OutT).map_err(ReadError::Bus)?;
        if bytes == [0xFF; 8] {
            return Err(ReadError::StuckHigh);
        }
        let [temperature, status, xyz @ ..] = bytes;
        if status & STATUS_DRDY == 0 {
            return Ok(None);
        }
        // OUT_T counts from 25 degC, as OUT_T_L/H does.
        let temperature_whole_c = temperature.cast_signed().saturating_add(25);
        Ok(Some(Sample {
            counts: Counts(wire::axes(xyz)),
            temperature_whole_c,
        }))
    }

    /// Reads the 12-bit temperature from OUT_T_L and OUT_T_H (0Dh, 0Eh), in 1/256 degC.
    ///
    /// One step of the part is 1/16 degC; zero stands for 25 degC.
    ///
    /// # Errors
    /// The bus failed, or both bytes are FFh, which the part cannot send: its four low bits are
    /// always zero.
    pub fn read_temperature(&mut self) -> Result<Temperature, ReadError<SPI::Error>> {
        let bytes: [u8; 2] = self.burst(Register::OutTL).map_err(ReadError::Bus)?;
        if bytes == [0xFF; 2] {
            return Err(ReadError::StuckHigh);
        }
        // Left-justified by four bits, 16 steps per degree: the register is 1/256 degC as it is.
        let above_reference = i32::from(i16::from_le_bytes(bytes));
        Ok(Temperature(
            Temperature::REFERENCE.0.saturating_add(above_reference),
        ))
    }

    /// Moves what the FIFO holds into `out`, oldest first, as far as there is room.
    ///
    /// One transfer for the level, then one of six bytes per sample.
    ///
    /// # Errors
    /// The bus failed, or the level is one the part cannot have. After an error the samples
    /// already taken from the part are lost.
    pub fn read_fifo(&mut self, out: &mut [Counts]) -> Result<FifoRead, ReadError<SPI::Error>> {
        let [samples] = self.burst(Register::FifoSamples).map_err(ReadError::Bus)?;
        let level = usize::from(samples & FIFO_SAMPLES_DIFF);
        if level > FIFO_DEPTH {
            return Err(ReadError::StuckHigh);
        }
        let mut count: usize = 0;
        for slot in out.iter_mut().take(level) {
            *slot = Counts(wire::axes(
                self.burst(Register::OutXL).map_err(ReadError::Bus)?,
            ));
            count = count.saturating_add(1);
        }
        let left = level.saturating_sub(count);
        Ok(FifoRead {
            count,
            left,
            overrun: samples & FIFO_SAMPLES_OVR != 0,
        })
    }

    /// WHO_AM_I must be 44h.
    fn check_identity(&mut self) -> Result<(), VerifyError<SPI::Error>> {
        let [found] = self.burst(Register::WhoAmI).map_err(VerifyError::Bus)?;
        expect(Register::WhoAmI, PART_ID, found)
    }

    /// SOFT_RESET, then looks at CTRL2 until it and BOOT are clear.
    fn reset<D: DelayNs>(&mut self, delay: &mut D) -> Result<(), InitError<SPI::Error>> {
        self.write(Register::Ctrl2, CTRL2_SOFT_RESET | CTRL2_IF_ADD_INC)
            .map_err(InitError::Bus)?;
        let mut ctrl2 = 0;
        for _ in 0..RESET_POLLS {
            delay.delay_us(RESET_POLL_US);
            [ctrl2] = self.burst(Register::Ctrl2).map_err(InitError::Bus)?;
            if ctrl2 & (CTRL2_SOFT_RESET | CTRL2_BOOT) == 0 {
                return Ok(());
            }
        }
        Err(InitError::ResetStuck { ctrl2 })
    }

    /// Writes a configuration with the part in power-down, starts it, and reads it all back.
    ///
    /// The old sample is thrown away in between: it has the old scale, or self-test on it.
    pub(super) fn apply(&mut self, config: &Config) -> Result<(), VerifyError<SPI::Error>> {
        let [ctrl1, ctrl2, ctrl3, ctrl4, _, ctrl6] = config.control();
        let steps = [
            (Register::Ctrl1, 0x00),
            (Register::Ctrl2, ctrl2),
            (Register::Ctrl3, ctrl3),
            (Register::Ctrl6, ctrl6),
            (Register::Ctrl4Int1, ctrl4),
            (Register::Ctrl7, CTRL7_DRDY_PULSED),
            // Bypass first: it is what empties the FIFO.
            (Register::FifoCtrl, Fifo::Bypass.control()),
            (Register::FifoCtrl, config.fifo.control()),
        ];
        for (register, value) in &steps {
            self.write(*register, *value).map_err(VerifyError::Bus)?;
        }
        let _stale: [u8; 6] = self.burst(Register::OutXL).map_err(VerifyError::Bus)?;
        self.write(Register::Ctrl1, ctrl1)
            .map_err(VerifyError::Bus)?;
        self.check(config).map(|_| ())
    }

    /// The read-back of `verify`, against any configuration.
    fn check(&mut self, config: &Config) -> Result<Health, VerifyError<SPI::Error>> {
        self.check_identity()?;
        let control: [u8; 6] = self.burst(Register::Ctrl1).map_err(VerifyError::Bus)?;
        let pairs = config.control();
        let pairs = pairs.iter().zip(&control);
        for (register, (expected, found)) in CONTROL.iter().zip(pairs) {
            expect(*register, *expected, *found)?;
        }
        let upper: [u8; UPPER_BYTES] = self.burst(Register::FifoCtrl).map_err(VerifyError::Bus)?;
        expect(
            Register::FifoCtrl,
            config.fifo.control(),
            upper_byte(&upper, Register::FifoCtrl),
        )?;
        expect(
            Register::Ctrl7,
            CTRL7_DRDY_PULSED,
            upper_byte(&upper, Register::Ctrl7),
        )?;
        for register in &UNUSED {
            expect(*register, 0x00, upper_byte(&upper, *register))?;
        }
        let samples = upper_byte(&upper, Register::FifoSamples);
        Ok(Health {
            fifo_level: samples & FIFO_SAMPLES_DIFF,
            fifo_overrun: samples & FIFO_SAMPLES_OVR != 0,
        })
    }

    /// Writes one register and reads it back.
    pub(super) fn set(
        &mut self,
        register: Register,
        value: u8,
    ) -> Result<(), VerifyError<SPI::Error>> {
        self.write(register, value).map_err(VerifyError::Bus)?;
        let [found] = self.burst(register).map_err(VerifyError::Bus)?;
        expect(register, value, found)
    }

    /// Writes one register.
    fn write(&mut self, register: Register, value: u8) -> Result<(), SPI::Error> {
        wire::write(&mut self.spi, register.address(), value)
    }

    /// Reads `N` bytes from `first` on, in one transaction.
    fn burst<const N: usize>(&mut self, first: Register) -> Result<[u8; N], SPI::Error> {
        let mut bytes = [0; N];
        self.fill(first, &mut bytes)?;
        Ok(bytes)
    }

    /// As [`Self::burst`], and once for any number of bytes.
    fn fill(&mut self, first: Register, bytes: &mut [u8]) -> Result<(), SPI::Error> {
        wire::read(&mut self.spi, first.address(), bytes)
    }
}

/// The byte of `register` in a burst that began at FIFO_CTRL.
///
/// A register below the burst or beyond it reads as FFh, which no register here should hold;
/// it cannot happen with the registers this file asks for.
fn upper_byte(upper: &[u8; UPPER_BYTES], register: Register) -> u8 {
    let offset = register
        .address()
        .wrapping_sub(Register::FifoCtrl.address());
    upper.get(usize::from(offset)).copied().unwrap_or(0xFF)
}
