//! A part with noise, whose registers a world carries along.

#[path = "../on_a_bus/registers.rs"]
mod registers;

pub use registers::{Hurry, delivered, factory};

/// The registers of a part, and what it feels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Registers {
    registers: [u8; 64],
    /// X, Y and Z in steps of 14 bits.
    counts: [i16; 3],
    /// Where its noise has got to.
    noise: u64,
}

impl Registers {
    /// Level, always ready, 25 degC.
    pub const fn level(number: usize) -> Self {
        Self {
            registers: registers::ready(),
            counts: [0, 0, 4096],
            noise: 0x2545_F491_4F6C_DD1D + number as u64,
        }
    }

    /// Noise of 4 steps, 1 mg: about what the part has.
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
            // 14 bits stand to the left of 16.
            let code = (self.counts[axis] + self.noise()) * 4;
            let [low, high] = code.to_le_bytes();
            self.registers[OUT_X + 2 * axis] = low;
            self.registers[OUT_X + 2 * axis + 1] = high;
        }
    }
}

/// CTRL1, OUT_T, with which a sample is read, and OUT_X_L.
const CONTROL_1: usize = 0x20;
const OUT_T: usize = 0x26;
const OUT_X: usize = 0x28;

/// Standard deviation of the noise, 2^-26 g.
pub const NOISE: u32 = 65_536;

impl registers::Contents for Registers {
    fn bytes(&mut self) -> &mut [u8; 64] {
        &mut self.registers
    }

    fn read_from(&mut self, address: usize) {
        if address == OUT_T {
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

    /// A brown-out: the part is in power-down.
    pub fn power_down(&self) {
        self.with(|behind| behind.registers[CONTROL_1] = 0);
    }
}
