//! The LIS2DW12 as a chip: registers, SPI, FIFO, data-ready, reset, boot and supply.
//!
//! In: bytes on the SPI wires; from the world the time in nanoseconds, and at each tick of the
//! part's own sampling clock the specific force in g and the die temperature in degC.
//! Out: bytes on the wires, the INT1 pin, and what the part is set to do (data rate, bandwidth,
//! noise density, range).
//!
//! The model only quantises and clips. Bias, scale, noise and the internal low-pass come before
//! it, in the error model, so that each term can be switched off there.
//!
//! Facts follow the data sheet DS11811 and the application note AN5038. Left out: the event
//! engine (tap, free fall, wake-up, sleep), conversion on demand, the high-pass path, user
//! offsets, the INT2 pin, the I2C side, the first samples' settling after power-up, and the time
//! a byte takes on the wire.
//!
//! ```
//! use sim::lis2dw12::{Chip, Traits};
//!
//! let mut chip = Chip::new(Traits::TYPICAL);
//! chip.power_on(0);
//! chip.advance_to(20_000_000);
//! chip.select();
//! chip.exchange(0x8F);
//! assert_eq!(chip.exchange(0), 0x44);
//! chip.deselect();
//! ```

mod burst;
mod fifo;
mod output;
mod registers;

#[cfg(test)]
mod driver_tests;
#[cfg(test)]
mod tests;

use tilt::sample::FullScale;

pub use crate::spi_part::{AfterBrownOut, Fault};
pub use fifo::DEPTH as FIFO_DEPTH;

use crate::spi_part::{self, Pair, Phase, Slave, State, Wire};
use fifo::{Fifo, FifoMode};
use registers::{
    CTRL1, CTRL2, CTRL3, CTRL4_INT1, CTRL6, CTRL7, FIFO_CTRL, FIFO_SAMPLES, Mode, OUT_T, OUT_T_H,
    OUT_T_L, OUT_X_L, OUT_Z_H, RESET, STATUS, STATUS_DUP, WRITABLE, ctrl2, flag,
};

/// Time from power-up until the part answers \[DS\].
pub const BOOT_NS: u64 = 20_000_000;

/// Time SOFT_RESET stays set: about 5 us (AN5038).
pub const SOFT_RESET_NS: u64 = 5_000;

/// Width of the data-ready pulse with DRDY_PULSED: 75 us \[RECALL\].
pub const DRDY_PULSE_NS: u64 = 75_000;

/// The thermometer is read at most 50 times a second \[RECALL\].
const TEMPERATURE_HZ: f64 = 50.0;

/// Index of the temperature among the output pairs, after X, Y and Z.
const TEMPERATURE: usize = 3;

/// What differs from one part to the next and is not in the error model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Traits {
    /// What the self-test with positive sign adds to each axis, in g; 0.07 to 1.5 \[DS\].
    pub self_test_positive_g: [f64; 3],
    /// What the self-test with negative sign adds to each axis, in g.
    pub self_test_negative_g: [f64; 3],
    /// What the output registers hold after a brown-out.
    pub after_brown_out: AfterBrownOut,
    /// Samples use all 16 bits of the register instead of 14: the quantisation switched off as
    /// far as registers allow (0.061 mg at +-2 g).
    pub full_register: bool,
}

impl Traits {
    /// A part in the middle of the data sheet's window, with 0.4 to 0.6 g of self-test \[ASSUME\].
    pub const TYPICAL: Self = Self {
        self_test_positive_g: [0.5, 0.45, 0.6],
        self_test_negative_g: [-0.48, -0.46, -0.57],
        after_brown_out: AfterBrownOut::Frozen,
        full_register: false,
    };
}

/// The wires to a part.
pub type SpiPort = spi_part::SpiPort<Chip>;

/// One part.
#[derive(Clone, Debug)]
pub struct Chip {
    traits: Traits,
    state: State,
    mode: Mode,
    fifo_mode: FifoMode,
    fifo: Fifo,
    pairs: [Pair; 4],
    sampled_ns: u64,
    temperature_every: u32,
    temperature_due: u32,
}

/// Time, supply and faults: the world's side.
impl Chip {
    /// A part without supply. [`Chip::power_on`] starts it.
    pub fn new(traits: Traits) -> Self {
        Self {
            traits,
            state: State::new(RESET),
            mode: Mode::decode(0, 0),
            fifo_mode: FifoMode::Bypass,
            fifo: Fifo::default(),
            pairs: [Pair::default(); 4],
            sampled_ns: 0,
            temperature_every: 1,
            temperature_due: 0,
        }
    }

    /// The supply goes away: the part answers 00h and forgets everything.
    pub fn power_off(&mut self) {
        self.pairs = [Pair::default(); 4];
        self.reset_registers();
        self.state.power_off();
    }

    /// The supply comes at this time; 20 ms later the part answers, in power-down.
    pub fn power_on(&mut self, time_ns: u64) {
        self.power_off();
        self.advance_to(time_ns);
        self.state.enter(Phase::PowerUp, BOOT_NS);
    }

    /// The supply was below 1.62 V \[DS\] and is back at this time: all registers have their reset
    /// values, so the part is in power-down and data-ready stays away; the outputs freeze or
    /// read zero ([`Traits::after_brown_out`]). It boots like after a power-up.
    pub fn brown_out(&mut self, time_ns: u64) {
        if self.traits.after_brown_out == AfterBrownOut::Zero {
            self.pairs = [Pair::default(); 4];
        }
        self.reset_registers();
        self.advance_to(time_ns);
        self.state.enter(Phase::PowerUp, BOOT_NS);
    }

    /// Moves the part's time on, in nanoseconds. An earlier time than the last changes nothing.
    pub fn advance_to(&mut self, time_ns: u64) {
        if self.state.advance_to(time_ns) {
            self.state.clear(CTRL2, ctrl2::BOOT | ctrl2::SOFT_RESET);
        }
    }

    /// The part's time in nanoseconds.
    pub fn now_ns(&self) -> u64 {
        self.state.now_ns
    }

    /// Takes a sample now: called by the world at each tick of the part's sampling clock.
    ///
    /// In: specific force in g, as the part feels it after its error model, and the temperature
    /// in degC that its thermometer reports. Without supply, in power-down or while booting
    /// nothing happens.
    pub fn convert(&mut self, force_g: [f64; 3], die_c: f64) {
        self.convert_through(force_g, die_c, |codes| codes);
    }

    /// [`Chip::convert`], with `path` between the converter and the outputs: for faults there.
    #[inline]
    pub fn convert_through(
        &mut self,
        force_g: [f64; 3],
        die_c: f64,
        path: impl FnOnce([i16; 3]) -> [i16; 3],
    ) {
        if self.state.phase != Phase::Ready || self.mode.odr_hz.is_none() {
            return;
        }
        let felt_g = self.with_self_test(force_g);
        let counts = output::counts(felt_g, &self.mode, self.traits.full_register).0;
        self.latch(path(counts).map(i16::to_le_bytes));
        self.sampled_ns = self.state.now_ns;
        if self.temperature_due == 0 {
            self.temperature_due = self.temperature_every;
            self.latch_temperature(output::temperature_bytes(die_c));
        }
        self.temperature_due -= 1;
    }

    /// Whether the next [`Chip::convert`] reads the thermometer too; others don't use its
    /// temperature.
    pub fn reads_temperature(&self) -> bool {
        self.temperature_due == 0
    }

    /// Whether INT1 is asserted by what CTRL4 routes to it: data-ready, FIFO threshold, FIFO full.
    pub fn data_ready(&self) -> bool {
        let routed = self.state.register(CTRL4_INT1);
        let pulsed = self.state.register(CTRL7) & 0x80 != 0;
        let pulse_over =
            pulsed && self.state.now_ns >= self.sampled_ns.saturating_add(DRDY_PULSE_NS);
        let ready = self.state.register(STATUS) & flag::DRDY != 0 && !pulse_over;
        let threshold = self.state.register(FIFO_SAMPLES) & flag::FIFO_FTH != 0;
        let full = self.fifo.count() == FIFO_DEPTH;
        (routed & 0x01 != 0 && ready)
            || (routed & 0x02 != 0 && threshold)
            || (routed & 0x04 != 0 && full)
    }

    /// Level of the INT1 pin: [`Chip::data_ready`], turned over by H_LACTIVE in CTRL3.
    pub fn int1(&self) -> bool {
        self.data_ready() != (self.state.register(CTRL3) & 0x08 != 0)
    }

    /// Nominal data rate in Hz; `None` when the part does not convert: no supply, boot,
    /// power-down, conversion on demand. The true rate is this times the part's clock factor.
    pub fn odr_hz(&self) -> Option<f64> {
        if self.state.phase == Phase::Ready {
            self.mode.odr_hz
        } else {
            None
        }
    }

    /// Corner of the internal low-pass in Hz; `None` when the part does not convert.
    pub fn bandwidth_hz(&self) -> Option<f64> {
        if self.state.phase == Phase::Ready {
            self.mode.bandwidth_hz
        } else {
            None
        }
    }

    /// White noise density in ug/rtHz for the mode the part is in \[DS\]: 90 and 110 in
    /// high-performance mode with and without low-noise, 130 to 450 in the low-power modes.
    pub fn noise_density_ug(&self) -> f64 {
        self.mode.noise_density_ug
    }

    /// Measuring range.
    pub fn full_scale(&self) -> FullScale {
        self.mode.full_scale
    }

    /// Overwrites a register from outside, also a read-only one: a flipped bit, another part.
    ///
    /// The part acts on the new content. Bits of CTRL2 that start a boot or a reset are only
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
impl Chip {
    /// Chip select goes low: a transaction begins.
    pub fn select(&mut self) {
        Slave::select(self);
    }

    /// Chip select goes high.
    pub fn deselect(&mut self) {
        Slave::deselect(self);
    }

    /// Eight clocks: takes a byte in and gives one out, 00h when the part has nothing to send.
    pub fn exchange(&mut self, incoming: u8) -> u8 {
        Slave::exchange(self, incoming)
    }

    /// The address after this one in a burst: the same one without IF_ADD_INC; with the FIFO on
    /// the six output bytes form a ring, so a burst can run through many levels \[RECALL\].
    fn next(&self, address: u8) -> u8 {
        if self.state.register(CTRL2) & ctrl2::IF_ADD_INC == 0 {
            address
        } else if address == OUT_Z_H && self.fifo_mode != FifoMode::Bypass {
            OUT_X_L
        } else {
            address.wrapping_add(1) & 0x7F
        }
    }

    /// A byte leaves, with what reading it sets off.
    fn read(&mut self, address: u8) -> u8 {
        if !self.state.answers() {
            return 0;
        }
        if address == OUT_X_L && self.fifo_mode != FifoMode::Bypass {
            self.take_fifo_level();
        }
        let byte = self.state.register(address);
        match address {
            OUT_X_L..=OUT_Z_H => {
                self.read_pair(usize::from(address - OUT_X_L) / 2, address & 1);
                if address & 1 == 1 {
                    self.state.clear(STATUS, flag::DRDY);
                    self.state.clear(STATUS_DUP, flag::DRDY);
                }
            }
            OUT_T_L => self.read_pair(TEMPERATURE, 0),
            OUT_T_H => {
                self.read_pair(TEMPERATURE, 1);
                self.state.clear(STATUS_DUP, flag::DRDY_T);
            }
            _ => {}
        }
        // Three-wire SPI does not drive the separate data-out line.
        if self.state.register(CTRL2) & ctrl2::SIM != 0 {
            0
        } else {
            byte
        }
    }

    /// A byte arrives. Only writable bits take it, and only while the part is ready.
    fn write(&mut self, address: u8, value: u8) {
        if !self.state.accept(address, value, &WRITABLE) {
            return;
        }
        self.act_on(address);
        if address == CTRL2 && value & ctrl2::SOFT_RESET != 0 {
            self.reset_registers();
            self.state.set(CTRL2, ctrl2::SOFT_RESET);
            self.state.enter(Phase::Reset, SOFT_RESET_NS);
        } else if address == CTRL2 && value & ctrl2::BOOT != 0 {
            self.state.enter(Phase::Reboot, BOOT_NS);
        }
    }
}

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
        self.read(address)
    }

    fn write_register(&mut self, address: u8, value: u8) {
        self.write(address, value);
    }

    fn next_address(&self, address: u8) -> u8 {
        self.next(address)
    }

    fn read_into(&mut self, bytes: &mut [u8]) {
        Chip::read_into(self, bytes);
    }
}

/// Inside.
impl Chip {
    /// All registers to their reset values. The outputs keep what the pairs hold.
    fn reset_registers(&mut self) {
        self.state.registers = RESET;
        self.fifo.clear();
        for address in [CTRL1, FIFO_CTRL] {
            self.act_on(address);
        }
        for pair in 0..self.pairs.len() {
            self.show_pair(pair);
        }
        self.state.registers[usize::from(OUT_T)] = self.pairs[TEMPERATURE].bytes[1];
    }

    /// Brings the decoded settings in line with a register that has changed.
    fn act_on(&mut self, address: u8) {
        match address {
            CTRL1 | CTRL6 => {
                self.mode = Mode::decode(self.state.register(CTRL1), self.state.register(CTRL6));
                let odr_hz = self.mode.odr_hz.unwrap_or(0.0);
                self.temperature_every = f64::max(odr_hz / TEMPERATURE_HZ, 1.0) as u32;
                self.temperature_due = 0;
            }
            FIFO_CTRL => {
                self.fifo_mode = fifo::decode(self.state.register(FIFO_CTRL));
                if self.fifo_mode == FifoMode::Bypass {
                    self.fifo.clear();
                }
                self.show_fifo();
            }
            OUT_X_L..=OUT_Z_H => {
                let pair = usize::from(address - OUT_X_L) / 2;
                self.pairs[pair].bytes[usize::from(address & 1)] = self.state.register(address);
            }
            OUT_T_L | OUT_T_H => {
                let byte = usize::from(address - OUT_T_L);
                self.pairs[TEMPERATURE].bytes[byte] = self.state.register(address);
            }
            _ => {}
        }
    }

    /// The force with the self-test's deflection on it (CTRL3, ST: 01 positive, 10 negative).
    fn with_self_test(&self, force_g: [f64; 3]) -> [f64; 3] {
        let deflection_g = match self.state.register(CTRL3) >> 6 {
            0b01 => self.traits.self_test_positive_g,
            0b10 => self.traits.self_test_negative_g,
            _ => return force_g,
        };
        let ([x, y, z], [dx, dy, dz]) = (force_g, deflection_g);
        [x + dx, y + dy, z + dz]
    }

    /// A new sample: into the FIFO, or into the outputs when there is none.
    fn latch(&mut self, sample: [[u8; 2]; 3]) {
        if self.fifo_mode == FifoMode::Bypass {
            let block_data_update = self.state.register(CTRL2) & ctrl2::BDU != 0;
            for (pair, bytes) in sample.into_iter().enumerate() {
                self.pairs[pair].update(bytes, block_data_update);
                self.show_pair(pair);
            }
        } else {
            let [[xl, xh], [yl, yh], [zl, zh]] = sample;
            self.fifo.push(self.fifo_mode, [xl, xh, yl, yh, zl, zh]);
            self.show_fifo();
        }
        self.state.set(STATUS, flag::DRDY);
        self.state.set(STATUS_DUP, flag::DRDY);
    }

    /// A new temperature.
    fn latch_temperature(&mut self, bytes: [u8; 2]) {
        let block_data_update = self.state.register(CTRL2) & ctrl2::BDU != 0;
        self.pairs[TEMPERATURE].update(bytes, block_data_update);
        self.show_pair(TEMPERATURE);
        self.state.registers[usize::from(OUT_T)] = bytes[1];
        self.state.set(STATUS_DUP, flag::DRDY_T);
    }

    fn read_pair(&mut self, pair: usize, which: u8) {
        self.pairs[pair].read(which);
        self.show_pair(pair);
    }

    /// Copies a pair to the registers where the bus sees it.
    fn show_pair(&mut self, pair: usize) {
        let low = if pair == TEMPERATURE {
            OUT_T_L
        } else {
            OUT_X_L + 2 * pair as u8
        };
        let low = usize::from(low);
        self.state.registers[low..low + 2].copy_from_slice(&self.pairs[pair].bytes);
    }

    /// Puts the oldest FIFO level into the outputs; an empty FIFO leaves the last one there.
    fn take_fifo_level(&mut self) {
        if let Some([xl, xh, yl, yh, zl, zh]) = self.fifo.pop() {
            for (pair, bytes) in [[xl, xh], [yl, yh], [zl, zh]].into_iter().enumerate() {
                self.pairs[pair].load(bytes);
                self.show_pair(pair);
            }
            self.show_fifo();
        }
    }

    /// Copies the FIFO's level and flags to FIFO_SAMPLES, STATUS and STATUS_DUP.
    fn show_fifo(&mut self) {
        let level = self.fifo.count() as u8;
        let threshold = self.state.register(FIFO_CTRL) & 0x1F;
        let reached = threshold > 0 && level >= threshold;
        let overrun = self.fifo.overrun();
        let when = |condition: bool, bit: u8| if condition { bit } else { 0 };
        self.state.registers[usize::from(FIFO_SAMPLES)] =
            level | when(reached, flag::FIFO_FTH) | when(overrun, flag::FIFO_OVR);
        self.state.clear(STATUS, flag::FIFO_THS);
        self.state.set(STATUS, when(reached, flag::FIFO_THS));
        self.state.clear(STATUS_DUP, flag::OVR);
        self.state.set(STATUS_DUP, when(overrun, flag::OVR));
    }
}
