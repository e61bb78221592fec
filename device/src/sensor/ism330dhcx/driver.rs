//! The ISM330DHCX on an SPI device: set-up, read-back, samples, temperature.
//!
//! In: a `SpiDevice` in mode 3 or 0, at most 10 MHz. Out: [`InertialSample`]s, or a reason. Every
//! loop is bounded and nothing here panics. Waiting happens in `init` and in the self-test only.

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use tilt::sample::{Counts, RateCounts, Temperature};

use super::super::error::{ReadError, expect};
use super::super::wire;
use super::config::{Config, Setup};
use super::error::{InitError, VerifyError};
use super::registers::{
    COUNTER_DRDY_PULSED, CTRL3_BOOT, CTRL3_IF_INC, CTRL3_SW_RESET, INT1_DRDY_G, PART_ID,
    PIN_CTRL_MASK, Register, STATUS_GDA, STATUS_XLDA,
};

/// Time from power-up until the part answers, in milliseconds: ST's example waits as long.
const BOOT_MS: u32 = 10;

/// Time between two looks at CTRL3_C during a reset, in microseconds. It takes 50 \[RECALL\].
const RESET_POLL_US: u32 = 50;

/// Looks at CTRL3_C before the reset counts as stuck: 25 ms, longer than a BOOT takes.
const RESET_POLLS: u32 = 500;

/// Time from the end of the set-up until rates are good, in milliseconds \[RECALL\].
///
/// The gyroscope's mass has to swing up first. Samples come before, and are not to be used.
pub const START_MS: u32 = 80;

/// Bytes from FUNC_CFG_ACCESS (01h) to CTRL10_C (19h).
const LOWER_BYTES: usize = 25;

/// CTRL1_XL to CTRL10_C, in the order of their addresses.
const CONTROL: [Register; 10] = [
    Register::Ctrl1Xl,
    Register::Ctrl2G,
    Register::Ctrl3C,
    Register::Ctrl4C,
    Register::Ctrl5C,
    Register::Ctrl6C,
    Register::Ctrl7G,
    Register::Ctrl8Xl,
    Register::Ctrl9Xl,
    Register::Ctrl10C,
];

/// FIFO_CTRL1 to FIFO_CTRL4, in the order of their addresses.
const FIFO_CONTROL: [Register; 4] = [
    Register::FifoCtrl1,
    Register::FifoCtrl2,
    Register::FifoCtrl3,
    Register::FifoCtrl4,
];

/// Registers of the lower burst that are the same in every configuration.
const FIXED: [(Register, u8); 6] = [
    (Register::WhoAmI, PART_ID),
    (Register::FuncCfgAccess, 0x00),
    (Register::CounterBdrReg1, COUNTER_DRDY_PULSED),
    (Register::CounterBdrReg2, 0x00),
    (Register::Int1Ctrl, INT1_DRDY_G),
    (Register::Int2Ctrl, 0x00),
];

/// The event engine, from TAP_CFG0 (56h) to MD2_CFG (5Fh): all zero.
const EVENTS: [Register; 10] = [
    Register::TapCfg0,
    Register::TapCfg1,
    Register::TapCfg2,
    Register::TapThs6d,
    Register::IntDur2,
    Register::WakeUpThs,
    Register::WakeUpDur,
    Register::FreeFall,
    Register::Md1Cfg,
    Register::Md2Cfg,
];

/// The user offsets: all zero.
const OFFSETS: [Register; 3] = [Register::XOfsUsr, Register::YOfsUsr, Register::ZOfsUsr];

/// One reading of both sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InertialSample {
    /// The accelerometer's axes; their scale is the configured full scale.
    pub acceleration: Counts,
    /// The gyroscope's axes; their scale is the configured range.
    pub rate: RateCounts,
    /// Die temperature (OUT_TEMP, 20h; 256 steps per degree, zero at 25 degC).
    pub temperature: Temperature,
    /// The acceleration is new, too. Without it the accelerometer stands still while the
    /// gyroscope goes on.
    pub acceleration_is_new: bool,
}

/// The output registers as they are.
pub(super) struct Outputs {
    /// STATUS_REG.
    pub status: u8,
    /// Everything else; nothing in it need be new.
    pub sample: InertialSample,
}

/// What the read-back saw besides a correct configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Health {
    /// Unread words in the FIFO, 0 to 512.
    pub fifo_level: u16,
    /// Words were lost because the FIFO was full; the flag is cleared by looking at it.
    pub fifo_overrun: bool,
}

/// The driver. It owns the SPI device and remembers the configuration it has to defend.
///
/// Until `init` has been called, that configuration is [`Config::PRODUCT`], which a part fresh
/// from reset does not have: `verify` then fails, as it should.
#[derive(Clone, Debug)]
pub struct Ism330dhcx<SPI> {
    spi: SPI,
    config: Config,
}

impl<SPI> Ism330dhcx<SPI> {
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

impl<SPI: SpiDevice> Ism330dhcx<SPI> {
    /// Sets the part up and reads everything back.
    ///
    /// In: the configuration, and something to wait with. Takes 10 ms plus the transfers, at most
    /// 35 ms when the reset does not end. May be called again at any time, for instance after
    /// `verify` failed. Rates are good [`START_MS`] later.
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
        // First of all back to the bank in which the other addresses have their meaning.
        self.write(Register::FuncCfgAccess, 0x00)
            .map_err(InitError::Bus)?;
        self.check_identity()?;
        self.reset(delay)?;
        self.apply(&config.setup())?;
        Ok(())
    }

    /// Reads WHO_AM_I and all configuration registers back, in four bursts of 25, 10, 3 and 2
    /// bytes.
    ///
    /// Meant to be called about every 100 ms. The output registers are not touched, so no sample
    /// is lost by it.
    ///
    /// # Errors
    /// The bus failed, or the first wrong register with its expected and its actual content.
    pub fn verify(&mut self) -> Result<Health, VerifyError<SPI::Error>> {
        self.check(&self.config.setup())?;
        let (fifo_level, fifo_overrun) = self.fifo_level().map_err(VerifyError::Bus)?;
        Ok(Health {
            fifo_level,
            fifo_overrun,
        })
    }

    /// Reads the newest sample in one burst from STATUS_REG (1Eh) to OUTZ_H_A (2Dh).
    ///
    /// `None` when the gyroscope's data-ready is not set: nothing new since the last read. It
    /// counts the samples, the acceleration is the one beside it. Call it at a data-ready edge: a
    /// sample that arrives between the flag and the outputs is read and counts as old.
    ///
    /// # Errors
    /// The bus failed, or all sixteen bytes are FFh. A line stuck low reads as "no new sample",
    /// which the caller sees as a stale channel and `verify` as a wrong WHO_AM_I.
    pub fn read(&mut self) -> Result<Option<InertialSample>, ReadError<SPI::Error>> {
        let outputs = self.outputs()?;
        Ok((outputs.status & STATUS_GDA != 0).then_some(outputs.sample))
    }

    /// Reads the die temperature, with STATUS_REG before it (1Eh to 21h). No sample is lost by it.
    ///
    /// # Errors
    /// The bus failed, or all four bytes are FFh, which STATUS_REG cannot be.
    pub fn read_temperature(&mut self) -> Result<Temperature, ReadError<SPI::Error>> {
        let bytes: [u8; 4] = self.burst(Register::StatusReg).map_err(ReadError::Bus)?;
        if bytes == [0xFF; 4] {
            return Err(ReadError::StuckHigh);
        }
        let [_, _, low, high] = bytes;
        Ok(temperature([low, high]))
    }

    /// The burst of `read`, whatever is new in it.
    pub(super) fn outputs(&mut self) -> Result<Outputs, ReadError<SPI::Error>> {
        let bytes: [u8; 16] = self.burst(Register::StatusReg).map_err(ReadError::Bus)?;
        // By the first one as a rule: a comparison of arrays looks at them all.
        if bytes.iter().all(|byte| *byte == 0xFF) {
            return Err(ReadError::StuckHigh);
        }
        let [status, _, t0, t1, g0, g1, g2, g3, g4, g5, xyz @ ..] = bytes;
        let sample = InertialSample {
            acceleration: Counts(wire::axes(xyz)),
            rate: RateCounts(wire::axes([g0, g1, g2, g3, g4, g5])),
            temperature: temperature([t0, t1]),
            acceleration_is_new: status & STATUS_XLDA != 0,
        };
        Ok(Outputs { status, sample })
    }

    /// WHO_AM_I must be 6Bh.
    fn check_identity(&mut self) -> Result<(), VerifyError<SPI::Error>> {
        let [found] = self.burst(Register::WhoAmI).map_err(VerifyError::Bus)?;
        expect(Register::WhoAmI, PART_ID, found)
    }

    /// Both sensors to power-down, SW_RESET, then looks at CTRL3_C until it and BOOT are clear.
    fn reset<D: DelayNs>(&mut self, delay: &mut D) -> Result<(), InitError<SPI::Error>> {
        for (register, value) in [
            (Register::Ctrl1Xl, 0x00),
            (Register::Ctrl2G, 0x00),
            (Register::Ctrl3C, CTRL3_SW_RESET | CTRL3_IF_INC),
        ] {
            self.write(register, value).map_err(InitError::Bus)?;
        }
        let mut ctrl3_c = 0;
        for _ in 0..RESET_POLLS {
            delay.delay_us(RESET_POLL_US);
            [ctrl3_c] = self.burst(Register::Ctrl3C).map_err(InitError::Bus)?;
            if ctrl3_c & (CTRL3_SW_RESET | CTRL3_BOOT) == 0 {
                return Ok(());
            }
        }
        Err(InitError::ResetStuck { ctrl3_c })
    }

    /// Writes a configuration with both sensors in power-down, starts them, and reads it all back.
    ///
    /// The old sample is thrown away in between: it has the old scale, or self-test on it.
    pub(super) fn apply(&mut self, setup: &Setup) -> Result<(), VerifyError<SPI::Error>> {
        let [ctrl1_xl, ctrl2_g, common @ ..] = &setup.control;
        let [_, _, common_registers @ ..] = &CONTROL;
        let power_down = [(Register::Ctrl1Xl, 0x00), (Register::Ctrl2G, 0x00)];
        let pins = [
            (Register::CounterBdrReg1, COUNTER_DRDY_PULSED),
            (Register::Int1Ctrl, INT1_DRDY_G),
            // Bypass first: it is what empties the FIFO.
            (Register::FifoCtrl4, 0x00),
        ];
        let steps = power_down.into_iter();
        let steps = steps.chain(pairs(common_registers, common));
        let steps = steps.chain(pins).chain(pairs(&FIFO_CONTROL, &setup.fifo));
        for (register, value) in steps {
            self.write(register, value).map_err(VerifyError::Bus)?;
        }
        let _stale: [u8; 16] = self.burst(Register::StatusReg).map_err(VerifyError::Bus)?;
        for (register, value) in [(Register::Ctrl1Xl, *ctrl1_xl), (Register::Ctrl2G, *ctrl2_g)] {
            self.write(register, value).map_err(VerifyError::Bus)?;
        }
        self.check(setup)
    }

    /// The read-back of `verify`, against any set-up.
    fn check(&mut self, setup: &Setup) -> Result<(), VerifyError<SPI::Error>> {
        let lower: [u8; LOWER_BYTES] = self
            .burst(Register::FuncCfgAccess)
            .map_err(VerifyError::Bus)?;
        let set = pairs(&CONTROL, &setup.control).chain(pairs(&FIFO_CONTROL, &setup.fifo));
        for (register, expected) in FIXED.into_iter().chain(set) {
            expect(register, expected, lower_byte(&lower, register))?;
        }
        let pins = lower_byte(&lower, Register::PinCtrl) & PIN_CTRL_MASK;
        expect(Register::PinCtrl, 0x00, pins)?;
        self.expect_zero(&EVENTS)?;
        self.expect_zero(&OFFSETS)
    }

    /// One burst over neighbouring registers that have to be zero.
    fn expect_zero<const N: usize>(
        &mut self,
        registers: &[Register; N],
    ) -> Result<(), VerifyError<SPI::Error>> {
        let Some(first) = registers.first() else {
            return Ok(());
        };
        let bytes: [u8; N] = self.burst(*first).map_err(VerifyError::Bus)?;
        for (register, found) in pairs(registers, &bytes) {
            expect(register, 0x00, found)?;
        }
        Ok(())
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
    pub(super) fn burst<const N: usize>(&mut self, first: Register) -> Result<[u8; N], SPI::Error> {
        let mut bytes = [0; N];
        wire::read(&mut self.spi, first.address(), &mut bytes)?;
        Ok(bytes)
    }
}

/// Registers with their bytes.
fn pairs<'a>(
    registers: &'a [Register],
    bytes: &'a [u8],
) -> impl Iterator<Item = (Register, u8)> + use<'a> {
    registers.iter().copied().zip(bytes.iter().copied())
}

/// The byte of `register` in a burst that began at FUNC_CFG_ACCESS.
///
/// A register beyond it reads as FFh, which no register here should hold; it cannot happen with
/// the registers this file asks for.
fn lower_byte(lower: &[u8; LOWER_BYTES], register: Register) -> u8 {
    let first = Register::FuncCfgAccess.address();
    let offset = register.address().wrapping_sub(first);
    lower.get(usize::from(offset)).copied().unwrap_or(0xFF)
}

/// OUT_TEMP_L and OUT_TEMP_H: 1/256 degC above 25 degC, as they are.
fn temperature(bytes: [u8; 2]) -> Temperature {
    let above_reference = i32::from(i16::from_le_bytes(bytes));
    Temperature(Temperature::REFERENCE.0.saturating_add(above_reference))
}
