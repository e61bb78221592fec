//! A part with noise, whose registers a world carries along: an accelerometer, or one with a
//! gyroscope.

#[path = "../on_a_bus/registers.rs"]
mod registers;

use device::objects::table::Models;
use device::sensor::ism330dhcx::{self, Ism330dhcx, PART_ID, Register};
use device::sensor::{AnyDriver, Config, Lis2dw12, PartConfig};
use tilt::chain::Calibration;
use tilt::rate::RateCorrection;

pub use registers::{Hurry, factory};

/// Which part a node has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The product's: LIS2DW12.
    Lis2dw12,
    /// That of the variant with a gyroscope: ISM330DHCX.
    Ism330dhcx,
}

impl Kind {
    /// How it is set up.
    pub const fn config(self) -> PartConfig {
        match self {
            Self::Lis2dw12 => PartConfig::Lis2dw12(Config::PRODUCT),
            Self::Ism330dhcx => PartConfig::Ism330dhcx(ism330dhcx::Config::PRODUCT),
        }
    }

    /// Whose objects the node has.
    pub const fn models(self) -> Models {
        match self {
            Self::Lis2dw12 => Models::WHOLE,
            Self::Ism330dhcx => Models::DYNAMIC,
        }
    }

    /// How many PDOs its exchange has.
    pub const fn pdos(self) -> usize {
        match self {
            Self::Lis2dw12 => 2,
            Self::Ism330dhcx => 3,
        }
    }

    /// The calibration that it is delivered with: that of a perfect part.
    pub fn delivered(self) -> Calibration {
        Calibration {
            rates: match self {
                Self::Lis2dw12 => None,
                Self::Ism330dhcx => Some(RateCorrection::IDENTITY),
            },
            ..registers::delivered()
        }
    }

    /// The registers of a part that is always ready and feels nothing.
    fn ready(self) -> [u8; 128] {
        let mut ready = [0; 128];
        match self {
            Self::Lis2dw12 => ready[..64].copy_from_slice(&registers::ready()),
            Self::Ism330dhcx => {
                ready[usize::from(Register::WhoAmI.address())] = PART_ID;
                ready[STATUS] = 0x03;
            }
        }
        ready
    }

    /// The first register of the acceleration.
    const fn acceleration(self) -> usize {
        match self {
            Self::Lis2dw12 => 0x28,
            Self::Ism330dhcx => STATUS + 10,
        }
    }

    /// The register from which a sample is read.
    const fn sample(self) -> usize {
        match self {
            Self::Lis2dw12 => 0x26,
            Self::Ism330dhcx => STATUS,
        }
    }

    /// By how much the output registers change for 1/4096 g.
    const fn step(self) -> i16 {
        match self {
            // 14 bits stand to the left of 16: +-2 g.
            Self::Lis2dw12 => 4,
            // 16 bits: +-4 g.
            Self::Ism330dhcx => 2,
        }
    }
}

/// STATUS_REG of an ISM330DHCX, with which a sample is read: temperature, rates, accelerations.
const STATUS: usize = 0x1E;

/// CTRL1 of an LIS2DW12.
const CONTROL_1: usize = 0x20;

/// Standard deviation of the noise of an acceleration, 2^-26 g.
pub const NOISE: u32 = 65_536;

/// The registers of a part, and what it feels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Registers {
    kind: Kind,
    registers: [u8; 128],
    /// X, Y and Z, 1/4096 g.
    counts: [i16; 3],
    /// About X, Y and Z, in steps of 17.5 mdeg/s.
    rates: [i16; 3],
    /// Where its noise has got to.
    noise: u64,
}

impl Registers {
    /// Level, always ready, 25 degC.
    pub fn level(kind: Kind, number: usize) -> Self {
        Self {
            kind,
            registers: kind.ready(),
            counts: [0, 0, 4096],
            rates: [0; 3],
            noise: 0x2545_F491_4F6C_DD1D + number as u64,
        }
    }

    /// Noise of 4 steps, 1 mg or 0.07 deg/s: about what the parts have.
    fn noise(&mut self) -> i16 {
        self.noise ^= self.noise << 13;
        self.noise ^= self.noise >> 7;
        self.noise ^= self.noise << 17;
        // Twelve numbers from 0 to 31: a mean of 186 and a standard deviation of 32. They are the
        // digits of one draw, since a draw for each takes a quarter of the search's time.
        let digits = (0..12).map(|place| (self.noise >> (4 + 5 * place) & 31) as i16);
        (digits.sum::<i16>() - 186) / 8
    }

    /// A new sample stands in the output registers.
    fn sample(&mut self) {
        for axis in 0..3 {
            let code = (self.counts[axis] + self.noise()) * self.kind.step();
            self.put_code(self.kind.acceleration() + 2 * axis, code);
        }
        if self.kind == Kind::Ism330dhcx {
            for axis in 0..3 {
                let code = self.rates[axis] + self.noise();
                self.put_code(STATUS + 4 + 2 * axis, code);
            }
        }
    }

    fn put_code(&mut self, at: usize, code: i16) {
        self.registers[at..at + 2].copy_from_slice(&code.to_le_bytes());
    }
}

impl registers::Contents for Registers {
    fn bytes(&mut self) -> &mut [u8] {
        match self.kind {
            Kind::Lis2dw12 => &mut self.registers[..64],
            Kind::Ism330dhcx => &mut self.registers,
        }
    }

    fn kept(&self, address: usize, value: u8) -> u8 {
        match (self.kind, address) {
            // CTRL2, boot and soft reset; CTRL3_C, the same.
            (Kind::Lis2dw12, 0x21) => value & !0xC0,
            (Kind::Ism330dhcx, 0x12) => value & !0x81,
            _ => value,
        }
    }

    fn read_from(&mut self, address: usize) {
        if address == self.kind.sample() {
            self.sample();
        }
    }
}

/// The wires to a part. Copies of a device share them, so the world puts its registers behind them
/// before anything happens in it.
pub type Part = registers::Part<Registers>;

impl Part {
    pub fn put(&self, registers: Registers) {
        self.with(|behind| *behind = registers);
    }

    pub fn get(&self) -> Registers {
        self.with(|behind| *behind)
    }

    /// The offset along X, mg.
    pub fn set_offset(&self, mg: i16) {
        // 0.244 mg a step.
        let counts = (f64::from(mg) / 0.244).round() as i16;
        self.with(|behind| behind.counts[0] = counts);
    }

    /// The bias of the gyroscope about Y, deg/s: the angle of X turns by it.
    pub fn set_rate(&self, dps: i16) {
        let steps = (f64::from(dps) / 0.0175).round() as i16;
        self.with(|behind| behind.rates[1] = steps);
    }

    /// A brown-out: the part is in power-down.
    pub fn power_down(&self) {
        self.with(|behind| {
            let control = match behind.kind {
                Kind::Lis2dw12 => CONTROL_1,
                Kind::Ism330dhcx => usize::from(Register::Ctrl1Xl.address()),
            };
            behind.registers[control] = 0;
        });
    }
}

/// The driver of either part.
pub type Driver = AnyDriver<Part, Part>;

/// The driver of the part of this kind behind these wires.
pub fn driver(kind: Kind, part: Part) -> Driver {
    match kind {
        Kind::Lis2dw12 => Driver::Lis2dw12(Lis2dw12::new(part)),
        Kind::Ism330dhcx => Driver::Ism330dhcx(Ism330dhcx::new(part)),
    }
}
