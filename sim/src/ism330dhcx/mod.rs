//! The ISM330DHCX as a chip: registers, SPI, FIFO, data-ready, reset, boot and supply.
//!
//! In: bytes on the SPI wires; from the world the time in nanoseconds, and at each tick of the
//! part's own sampling clock the specific force in g, the rate of turn in deg/s and the die
//! temperature in degC. Out: bytes on the wires, the INT1 pin, and what the part is set to do
//! (data rates, bandwidths and delays, noise densities, ranges).
//!
//! The model only quantises and clips. Bias, scale, noise and the internal low-passes come before
//! it, in the error models, so that each term can be switched off there.
//!
//! Facts follow the data sheet DS13012 and ST's open driver; what is recalled or assumed is marked.
//! Left out: the gyroscope's start-up and its first samples' settling, the low-power modes,
//! high-pass paths, the event engine, user offsets, time stamps, sensor hub, embedded functions
//! (other register banks read zero), image stabilisation, the INT2 pin, the I2C side, and the time
//! a byte takes on the wire.
//!
//! ```
//! use sim::ism330dhcx::{Chip, Traits};
//! use sim::spi_part::Slave;
//!
//! let mut chip = Chip::new(Traits::TYPICAL);
//! chip.power_on(0);
//! chip.advance_to(10_000_000);
//! chip.select();
//! chip.exchange(0x8F);
//! assert_eq!(chip.exchange(0), 0x6B);
//! chip.deselect();
//! ```

mod fifo;
mod output;
mod registers;

#[cfg(test)]
mod driver_tests;
#[cfg(test)]
mod tests;

use tilt::sample::{FullScale, RateRange};

use crate::low_pass::delay_s;
use crate::spi_part::{self, FifoMode, Pair, Phase, Slave, State, Wire};

pub use crate::spi_part::{AfterBrownOut, Fault};
pub use fifo::WORDS as FIFO_WORDS;

use fifo::{Tag, Words};
use registers::{
    COUNTER_BDR_REG1, CTRL1_XL, CTRL2_G, CTRL3_C, CTRL4_C, CTRL5_C, CTRL6_C, CTRL8_XL, FIFO_CTRL1,
    FIFO_CTRL2, FIFO_CTRL3, FIFO_CTRL4, FIFO_DATA_OUT_TAG, FIFO_DATA_OUT_Z_H, FIFO_STATUS1,
    FIFO_STATUS2, FUNC_CFG_ACCESS, INT1_CTRL, Mode, OUT_TEMP_L, OUTZ_H_A, RESET, STATUS_REG,
    WRITABLE, ctrl3, flag, odr_hz,
};

/// Time from power-up until the part answers: ST's example waits as long.
pub const BOOT_NS: u64 = 10_000_000;

/// Time SW_RESET stays set: 50 us \[RECALL\].
pub const SW_RESET_NS: u64 = 50_000;

/// Width of the data-ready pulse with dataready_pulsed: 75 us \[RECALL\].
pub const DRDY_PULSE_NS: u64 = 75_000;

/// White noise density of the accelerometer in high-performance mode, ug/rtHz (DS13012 rev 6,
/// table 2, typical; 100 at most).
const NOISE_DENSITY_UG: f64 = 60.0;

/// White noise density of the gyroscope in high-performance mode, dps/rtHz (as above, typical).
const RATE_NOISE_DENSITY_DPS: f64 = 0.005;

/// ODR field of the thermometer, 52 Hz \[RECALL\]: slower only where the sensors are.
const TEMPERATURE_ODR: u32 = 3;

/// Index of the temperature among the output pairs; rates follow, then accelerations.
const TEMPERATURE: usize = 0;
/// Index of the gyroscope's X.
const RATE: usize = 1;
/// Index of the accelerometer's X.
const ACCELERATION: usize = 4;

/// The wires to a part.
pub type SpiPort = spi_part::SpiPort<Chip>;

/// What differs from one part to the next and is not in the error models.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Traits {
    /// What the self-test with positive sign adds to each axis, in g; 0.09 to 1.7 (ST's example).
    pub self_test_positive_g: [f64; 3],
    /// What the self-test with negative sign adds to each axis, in g.
    pub self_test_negative_g: [f64; 3],
    /// What the self-test with positive sign adds to each rate, in deg/s; 150 to 700.
    pub self_test_positive_dps: [f64; 3],
    /// What the self-test with negative sign adds to each rate, in deg/s.
    pub self_test_negative_dps: [f64; 3],
    /// What the output registers hold after a brown-out.
    pub after_brown_out: AfterBrownOut,
}

impl Traits {
    /// A part in the middle of the windows \[ASSUME\].
    pub const TYPICAL: Self = Self {
        self_test_positive_g: [0.5, 0.45, 0.6],
        self_test_negative_g: [-0.48, -0.46, -0.57],
        self_test_positive_dps: [380.0, 410.0, 350.0],
        self_test_negative_dps: [-390.0, -400.0, -360.0],
        after_brown_out: AfterBrownOut::Frozen,
    };
}

/// One part.
#[derive(Clone, Debug)]
pub struct Chip {
    traits: Traits,
    state: State,
    mode: Mode,
    fifo_mode: FifoMode,
    fifo: Words,
    pairs: [Pair; 7],
    sampled_ns: u64,
    /// Ticks of the sampling clock since a rate was set.
    ticks: u32,
}

/// Time, supply and faults: the world's side.
impl Chip {
    /// A part without supply. [`Chip::power_on`] starts it.
    pub fn new(traits: Traits) -> Self {
        Self {
            traits,
            state: State::new(RESET),
            mode: Mode::decode(&RESET),
            fifo_mode: FifoMode::Bypass,
            fifo: Words::default(),
            pairs: [Pair::default(); 7],
            sampled_ns: 0,
            ticks: 0,
        }
    }

    /// The supply goes away: the part answers 00h and forgets everything.
    pub fn power_off(&mut self) {
        self.pairs = [Pair::default(); 7];
        self.reset_registers();
        self.state.power_off();
    }

    /// The supply comes at this time; 10 ms later the part answers, in power-down.
    pub fn power_on(&mut self, time_ns: u64) {
        self.power_off();
        self.boot(time_ns);
    }

    /// The supply was too low and is back at this time: all registers have their reset values, so
    /// both sensors are in power-down and data-ready stays away; the outputs freeze or read zero
    /// ([`Traits::after_brown_out`]). It boots like after a power-up \[ASSUME\], as the LIS2DW12.
    pub fn brown_out(&mut self, time_ns: u64) {
        if self.traits.after_brown_out == AfterBrownOut::Zero {
            self.pairs = [Pair::default(); 7];
        }
        self.reset_registers();
        self.boot(time_ns);
    }

    fn boot(&mut self, time_ns: u64) {
        self.advance_to(time_ns);
        self.state.enter(Phase::PowerUp, BOOT_NS);
    }

    /// Moves the part's time on, in nanoseconds. An earlier time than the last changes nothing.
    pub fn advance_to(&mut self, time_ns: u64) {
        if self.state.advance_to(time_ns) {
            self.state.clear(CTRL3_C, ctrl3::BOOT | ctrl3::SW_RESET);
        }
    }

    /// The part's time in nanoseconds.
    pub fn now_ns(&self) -> u64 {
        self.state.now_ns
    }

    /// Takes a sample now: called by the world at each tick of the part's sampling clock, which is
    /// that of the faster sensor ([`Chip::odr_hz`]); the slower one samples at each second, fourth,
    /// ... tick.
    ///
    /// In: specific force in g and rate of turn in deg/s, as the part feels them after its error
    /// models, and the temperature in degC that its thermometer reports. Without supply, with both
    /// sensors in power-down or while booting nothing happens.
    pub fn convert(&mut self, force_g: [f64; 3], rate_dps: [f64; 3], die_c: f64) {
        self.convert_through(force_g, rate_dps, die_c, |codes| codes);
    }

    /// [`Chip::convert`], with `path` between the converters and the outputs, for faults there:
    /// accelerations and rates in counts in, and out.
    pub fn convert_through(
        &mut self,
        force_g: [f64; 3],
        rate_dps: [f64; 3],
        die_c: f64,
        path: impl FnOnce([[i16; 3]; 2]) -> [[i16; 3]; 2],
    ) {
        if self.odr_hz().is_none() {
            return;
        }
        let (force_g, rate_dps) = self.with_self_test(force_g, rate_dps);
        let acceleration = output::counts(force_g, self.mode.full_scale).0;
        let rate = output::rate_counts(rate_dps, self.mode.range).0;
        let [acceleration, rate] = path([acceleration, rate]);
        if self.reads_temperature() {
            self.latch(TEMPERATURE, &[output::temperature_bytes(die_c)], flag::TDA);
        }
        self.fifo.next_slot();
        if self.is_due(self.mode.gyroscope_odr) {
            let bytes = rate.map(i16::to_le_bytes);
            self.latch(RATE, &bytes, flag::GDA);
            let batch = self.state.register(FIFO_CTRL3) >> 4;
            self.batch(Tag::Rate, bytes, self.mode.gyroscope_odr, batch);
        }
        if self.is_due(self.mode.accelerometer_odr) {
            let bytes = acceleration.map(i16::to_le_bytes);
            self.latch(ACCELERATION, &bytes, flag::XLDA);
            let batch = self.state.register(FIFO_CTRL3) & 0x0F;
            self.batch(Tag::Acceleration, bytes, self.mode.accelerometer_odr, batch);
        }
        self.sampled_ns = self.state.now_ns;
        self.ticks = self.ticks.wrapping_add(1);
    }

    /// Whether the next [`Chip::convert`] reads the thermometer too; others don't use its
    /// temperature.
    pub fn reads_temperature(&self) -> bool {
        self.is_due(TEMPERATURE_ODR.min(self.mode.odr()))
    }

    /// Whether INT1 is asserted by what INT1_CTRL routes to it: data-ready of either sensor, FIFO
    /// threshold, overrun, full.
    pub fn data_ready(&self) -> bool {
        let routed = self.state.register(INT1_CTRL);
        let pulsed = self.state.register(COUNTER_BDR_REG1) & 0x80 != 0;
        let pulse_over =
            pulsed && self.state.now_ns >= self.sampled_ns.saturating_add(DRDY_PULSE_NS);
        let new = self.state.register(STATUS_REG) & (flag::XLDA | flag::GDA);
        let status = self.state.register(FIFO_STATUS2);
        (routed & new != 0 && !pulse_over)
            || (routed & flag::INT1_FIFO_TH != 0 && status & flag::FIFO_WTM != 0)
            || (routed & flag::INT1_FIFO_OVR != 0 && status & flag::FIFO_OVR != 0)
            || (routed & flag::INT1_FIFO_FULL != 0 && status & flag::FIFO_FULL != 0)
    }

    /// Level of the INT1 pin: [`Chip::data_ready`], turned over by H_LACTIVE in CTRL3_C.
    pub fn int1(&self) -> bool {
        self.data_ready() != (self.state.register(CTRL3_C) & ctrl3::H_LACTIVE != 0)
    }

    /// Nominal rate of the sampling clock in Hz, that of the faster sensor; `None` when neither
    /// converts: no supply, boot, power-down. The true rate is this times the part's clock factor.
    pub fn odr_hz(&self) -> Option<f64> {
        self.working(self.mode.odr())
    }

    /// Nominal data rate of the accelerometer in Hz; `None` when it does not convert.
    pub fn accelerometer_odr_hz(&self) -> Option<f64> {
        self.working(self.mode.accelerometer_odr)
    }

    /// Nominal data rate of the gyroscope in Hz; `None` when it does not convert.
    pub fn gyroscope_odr_hz(&self) -> Option<f64> {
        self.working(self.mode.gyroscope_odr)
    }

    /// Corner of the accelerometer's internal low-pass in Hz; `None` when it does not convert.
    pub fn accelerometer_bandwidth_hz(&self) -> Option<f64> {
        self.accelerometer_odr_hz()?;
        Some(self.mode.accelerometer_bandwidth_hz)
    }

    /// Corner of the gyroscope's internal low-passes in Hz; `None` when it does not convert.
    pub fn gyroscope_bandwidth_hz(&self) -> Option<f64> {
        self.gyroscope_odr_hz()?;
        Some(self.mode.gyroscope_bandwidth_hz)
    }

    /// How late the accelerometer's path is on slow signals, s: that of a second-order low-pass of
    /// its bandwidth \[ASSUME\], as [`crate::low_pass`] has it.
    pub fn accelerometer_delay_s(&self) -> Option<f64> {
        self.accelerometer_bandwidth_hz().map(delay_s)
    }

    /// How late the gyroscope's path is on slow signals, s; as the accelerometer's \[ASSUME\].
    pub fn gyroscope_delay_s(&self) -> Option<f64> {
        self.gyroscope_bandwidth_hz().map(delay_s)
    }

    /// White noise density of the accelerometer in ug/rtHz.
    pub fn noise_density_ug(&self) -> f64 {
        NOISE_DENSITY_UG
    }

    /// White noise density of the gyroscope in dps/rtHz, in every range.
    pub fn rate_noise_density_dps(&self) -> f64 {
        RATE_NOISE_DENSITY_DPS
    }

    /// Measuring range of the accelerometer.
    pub fn full_scale(&self) -> FullScale {
        self.mode.full_scale
    }

    /// Measuring range of the gyroscope.
    pub fn rate_range(&self) -> RateRange {
        self.mode.range
    }

    /// Overwrites a register from outside, also a read-only one: a flipped bit, another part.
    ///
    /// The part acts on the new content. Bits of CTRL3_C that start a boot or a reset are only
    /// shown. A reset or a power cycle undoes it.
    pub fn upset(&mut self, address: u8, value: u8) {
        self.state.put(address, value);
        self.act_on(address);
    }

    /// Injects a fault, or ends it with `None`.
    pub fn set_fault(&mut self, fault: Option<Fault>) {
        self.state.fault = fault;
    }

    /// The fault injected at present.
    pub fn fault(&self) -> Option<Fault> {
        self.state.fault
    }
}

/// The wires.
impl Slave for Chip {
    fn wire(&mut self) -> &mut Wire {
        &mut self.state.wire
    }

    fn fault(&self) -> Option<Fault> {
        self.state.fault
    }

    fn int1(&self) -> bool {
        self.int1()
    }

    fn pulse_ns(&self) -> u64 {
        DRDY_PULSE_NS
    }

    fn now_ns(&self) -> u64 {
        self.state.now_ns
    }

    fn advance_to(&mut self, time_ns: u64) {
        Chip::advance_to(self, time_ns);
    }

    fn read_register(&mut self, address: u8) -> u8 {
        let silent = !self.state.answers();
        // Three-wire SPI does not drive the separate data-out line.
        let undriven = self.state.register(CTRL3_C) & ctrl3::SIM != 0;
        if silent || undriven || !self.in_user_bank(address) {
            return 0;
        }
        if address == FIFO_DATA_OUT_TAG {
            self.take_word();
        }
        let byte = self.state.register(address);
        match address {
            OUT_TEMP_L..=OUTZ_H_A => self.read_output(address),
            FIFO_STATUS2 => {
                self.fifo.take_lost();
                self.show_fifo();
            }
            _ => {}
        }
        byte
    }

    /// Only writable bits take it, and only while the part is ready.
    fn write_register(&mut self, address: u8, value: u8) {
        if !self.in_user_bank(address) || !self.state.accept(address, value, &WRITABLE) {
            return;
        }
        self.act_on(address);
        if address == CTRL3_C && value & ctrl3::SW_RESET != 0 {
            self.reset_registers();
            self.state.set(CTRL3_C, ctrl3::SW_RESET);
            self.state.enter(Phase::Reset, SW_RESET_NS);
        } else if address == CTRL3_C && value & ctrl3::BOOT != 0 {
            self.state.enter(Phase::Reboot, BOOT_NS);
        }
    }

    /// The same address without IF_INC; the bytes of a FIFO word form a ring, so a burst can run
    /// through many words \[RECALL\].
    fn next_address(&self, address: u8) -> u8 {
        if self.state.register(CTRL3_C) & ctrl3::IF_INC == 0 {
            address
        } else if address == FIFO_DATA_OUT_Z_H {
            FIFO_DATA_OUT_TAG
        } else {
            address.wrapping_add(1) & 0x7F
        }
    }
}

/// Inside.
impl Chip {
    /// The rate of an ODR field, when the part is ready.
    fn working(&self, odr: u32) -> Option<f64> {
        let ready = self.state.phase == Phase::Ready;
        ready.then(|| odr_hz(odr)).flatten()
    }

    /// Whether a sensor of this ODR field samples at the coming tick.
    fn is_due(&self, odr: u32) -> bool {
        odr > 0 && self.ticks.is_multiple_of(1 << (self.mode.odr() - odr))
    }

    /// FUNC_CFG_ACCESS is in all banks, everything else modelled in the user's alone.
    fn in_user_bank(&self, address: u8) -> bool {
        address == FUNC_CFG_ACCESS || self.state.register(FUNC_CFG_ACCESS) & 0xC0 == 0
    }

    /// All registers to their reset values. The outputs keep what the pairs hold.
    fn reset_registers(&mut self) {
        self.state.registers = RESET;
        self.fifo.clear();
        for address in [CTRL1_XL, FIFO_CTRL4] {
            self.act_on(address);
        }
        for pair in 0..self.pairs.len() {
            self.show_pair(pair);
        }
    }

    /// Brings the decoded settings in line with a register that has changed.
    fn act_on(&mut self, address: u8) {
        match address {
            CTRL1_XL | CTRL2_G | CTRL4_C | CTRL6_C | CTRL8_XL => {
                let before = self.mode.odr();
                self.mode = Mode::decode(&self.state.registers);
                if self.mode.odr() != before {
                    self.ticks = 0;
                }
            }
            FIFO_CTRL1 | FIFO_CTRL2 => self.show_fifo(),
            FIFO_CTRL4 => {
                self.fifo_mode = fifo::decode(self.state.register(FIFO_CTRL4));
                if self.fifo_mode == FifoMode::Bypass {
                    self.fifo.clear();
                }
                self.show_fifo();
            }
            OUT_TEMP_L..=OUTZ_H_A => {
                let pair = usize::from(address - OUT_TEMP_L) / 2;
                self.pairs[pair].bytes[usize::from(address & 1)] = self.state.register(address);
            }
            _ => {}
        }
    }

    /// The force and the rate with the self-tests' deflections on them (CTRL5_C: ST_XL 01 and 10,
    /// ST_G 01 and 11 are positive and negative).
    fn with_self_test(&self, force_g: [f64; 3], rate_dps: [f64; 3]) -> ([f64; 3], [f64; 3]) {
        let ctrl5_c = self.state.register(CTRL5_C);
        let force_g = match ctrl5_c & 3 {
            0b01 => crate::motion::add(force_g, self.traits.self_test_positive_g),
            0b10 => crate::motion::add(force_g, self.traits.self_test_negative_g),
            _ => force_g,
        };
        let rate_dps = match (ctrl5_c >> 2) & 3 {
            0b01 => crate::motion::add(rate_dps, self.traits.self_test_positive_dps),
            0b11 => crate::motion::add(rate_dps, self.traits.self_test_negative_dps),
            _ => rate_dps,
        };
        (force_g, rate_dps)
    }

    /// New values for the pairs from `first` on, and their flag in STATUS_REG.
    fn latch(&mut self, first: usize, values: &[[u8; 2]], flag: u8) {
        let block_data_update = self.state.register(CTRL3_C) & ctrl3::BDU != 0;
        for (pair, bytes) in (first..).zip(values) {
            self.pairs[pair].update(*bytes, block_data_update);
            self.show_pair(pair);
        }
        self.state.set(STATUS_REG, flag);
    }

    /// A sample of a sensor to the FIFO, if its batch rate asks for it at this tick: each one, or
    /// each second, fourth, ... where the batch rate is lower than the sensor's.
    fn batch(&mut self, tag: Tag, bytes: [[u8; 2]; 3], odr: u32, batch: u8) {
        let batch = u32::from(batch).min(odr);
        if self.fifo_mode != FifoMode::Bypass && self.is_due(batch) {
            self.fifo.push(self.fifo_mode, tag, bytes);
            self.show_fifo();
        }
    }

    /// An output byte leaves: its pair takes note, and the high one clears the sensor's flag.
    fn read_output(&mut self, address: u8) {
        let pair = usize::from(address - OUT_TEMP_L) / 2;
        self.pairs[pair].read(address & 1);
        self.show_pair(pair);
        if address & 1 == 1 {
            let flag = match pair {
                TEMPERATURE => flag::TDA,
                RATE..ACCELERATION => flag::GDA,
                _ => flag::XLDA,
            };
            self.state.clear(STATUS_REG, flag);
        }
    }

    /// Copies a pair to the registers where the bus sees it.
    fn show_pair(&mut self, pair: usize) {
        let low = usize::from(OUT_TEMP_L) + 2 * pair;
        self.state.registers[low..low + 2].copy_from_slice(&self.pairs[pair].bytes);
    }

    /// Puts the oldest word into FIFO_DATA_OUT; an empty FIFO shows tag 0 before the last word.
    fn take_word(&mut self) {
        let first = usize::from(FIFO_DATA_OUT_TAG);
        match self.fifo.pop() {
            Some(word) => self.state.registers[first..first + word.len()].copy_from_slice(&word),
            None => self.state.registers[first] = 0,
        }
        self.show_fifo();
    }

    /// Copies the FIFO's level and flags to FIFO_STATUS1 and FIFO_STATUS2.
    fn show_fifo(&mut self) {
        let [low, high] = (self.fifo.count() as u16).to_le_bytes();
        let threshold = [
            self.state.register(FIFO_CTRL1),
            self.state.register(FIFO_CTRL2) & 1,
        ];
        let threshold = usize::from(u16::from_le_bytes(threshold));
        let reached = threshold > 0 && self.fifo.count() >= threshold;
        let when = |condition: bool, bit: u8| if condition { bit } else { 0 };
        self.state.registers[usize::from(FIFO_STATUS1)] = low;
        self.state.registers[usize::from(FIFO_STATUS2)] = high
            | when(reached, flag::FIFO_WTM)
            | when(self.fifo.overrun(), flag::FIFO_OVR)
            | when(self.fifo.count() == FIFO_WORDS, flag::FIFO_FULL)
            | when(self.fifo.lost(), flag::FIFO_OVR_LATCHED);
    }
}
