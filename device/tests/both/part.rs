//! A part of which only the registers are there, and the device's factory.

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;

use device::calibration::motor::Terms;
use device::channel::Settings;
use device::device::Factory;
use device::objects::panel::Identity;
use device::objects::table::Channel;
use device::sensor::Config;
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use tilt::chain::{Calibration, Chain, PART_DELAY_Q16, Timing};
use tilt::filter::LowPass;
use tilt::sample::FullScale;
use tilt::table::Rule;
use tilt::uncertainty::{Budget, Span, Uncertainty};

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
        let mut registers = [0; 64];
        registers[0x0F] = 0x44;
        registers[0x27] = 0x01;
        Self {
            registers,
            counts: [0, 0, 4096],
            noise: 0x2545_F491_4F6C_DD1D + number as u64,
        }
    }

    /// Noise of 4 steps, 1 mg: about what the part has.
    fn noise(&mut self) -> i16 {
        let mut sum = 0;
        for _ in 0..12 {
            self.noise ^= self.noise << 13;
            self.noise ^= self.noise >> 7;
            self.noise ^= self.noise << 17;
            sum += (self.noise >> 59) as i16;
        }
        // Twelve numbers from 0 to 31: a mean of 186 and a standard deviation of 32.
        (sum - 186) / 8
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
const NOISE: u32 = 65_536;

/// The wires to a part. Copies of a device share them, so the world puts its registers behind them
/// before anything happens in it.
#[derive(Clone, Debug)]
pub struct Part(Rc<RefCell<Registers>>);

impl Part {
    pub fn new(registers: Registers) -> Self {
        Self(Rc::new(RefCell::new(registers)))
    }

    pub fn put(&self, registers: Registers) {
        *self.0.borrow_mut() = registers;
    }

    pub fn get(&self) -> Registers {
        *self.0.borrow()
    }

    /// The offset along X, mg.
    pub fn set_offset(&self, mg: i16) {
        // 0.244 mg a step.
        self.0.borrow_mut().counts[0] = (f64::from(mg) / 0.244).round() as i16;
    }

    /// A brown-out: the part is in power-down.
    pub fn power_down(&self) {
        self.0.borrow_mut().registers[CONTROL_1] = 0;
    }

    fn take(&self, bytes: &[u8], address: &mut usize) {
        let Some((first, values)) = bytes.split_first() else {
            return;
        };
        *address = usize::from(first & 0x3F);
        for value in values {
            // CTRL2: boot and soft reset end at once.
            let kept = if *address == 0x21 {
                value & !0xC0
            } else {
                *value
            };
            self.0.borrow_mut().registers[*address] = kept;
            *address = (*address + 1) & 0x3F;
        }
    }
}

impl ErrorType for Part {
    type Error = Infallible;
}

impl SpiDevice for Part {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        let mut address = 0;
        for operation in operations {
            match operation {
                Operation::Write(bytes) => self.take(bytes, &mut address),
                Operation::Read(bytes) => {
                    if address == OUT_T {
                        self.0.borrow_mut().sample();
                    }
                    for byte in bytes.iter_mut() {
                        *byte = self.0.borrow().registers[address];
                        address = (address + 1) & 0x3F;
                    }
                }
                other => panic!("the driver does not use {other:?}"),
            }
        }
        Ok(())
    }
}

/// A delay that takes no time.
pub struct Hurry;

impl DelayNs for Hurry {
    fn delay_ns(&mut self, _ns: u32) {}
}

/// Node `number` of the instrument, from 0.
pub fn factory(number: usize) -> Factory {
    let part = Config::PRODUCT;
    let chain = Chain {
        filter: LowPass::PRODUCT,
        full_scale: FullScale::G2,
        period_us: part.rate.period_us(),
        part_delay_q16: PART_DELAY_Q16,
        timing: Timing::Aligned { latency_us: 25_000 },
        calibration: Calibration {
            budget: Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::CHAMBER),
            ..Calibration::NOMINAL
        },
    };
    let channel = [Channel::A, Channel::B][number];
    Factory {
        identity: Identity {
            channel,
            serial: 1 + number as u32,
        },
        node_id: channel.node_id(),
        kbit_s: 250,
        terms: Terms {
            rule: Rule::Nearest,
            reference: Uncertainty(0),
        },
        settings: Settings {
            part,
            chain,
            noise: NOISE,
        },
    }
}
