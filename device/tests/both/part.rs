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

/// The registers of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Registers(pub [u8; 64]);

impl Registers {
    /// Level, always ready, 25 degC.
    pub const LEVEL: Self = {
        let mut registers = [0; 64];
        registers[0x0F] = 0x44;
        registers[0x27] = 0x01;
        registers[0x2D] = 0x40;
        Self(registers)
    };
}

/// CTRL1, and OUT_X_L.
const CONTROL_1: usize = 0x20;
const OUT_X: usize = 0x28;

/// The wires to a part. Copies of a device share them, so the world puts its registers behind them
/// before anything happens in it.
#[derive(Clone, Debug)]
pub struct Part(Rc<RefCell<Registers>>);

impl Part {
    pub fn shared(_number: usize) -> Self {
        Self(Rc::new(RefCell::new(Registers::LEVEL)))
    }

    pub fn put(&self, registers: Registers) {
        *self.0.borrow_mut() = registers;
    }

    pub fn get(&self) -> Registers {
        *self.0.borrow()
    }

    /// The offset along X, mg.
    pub fn set_offset(&self, mg: i16) {
        // 0.244 mg a step of 14 bits, which stand to the left of 16.
        let counts = (f64::from(mg) / 0.244).round() as i16 * 4;
        let [low, high] = counts.to_le_bytes();
        let registers = &mut self.0.borrow_mut().0;
        registers[OUT_X] = low;
        registers[OUT_X + 1] = high;
    }

    /// A brown-out: the part is in power-down.
    pub fn power_down(&self) {
        self.0.borrow_mut().0[CONTROL_1] = 0;
    }

    fn take(&self, bytes: &[u8], address: &mut usize) {
        let Some((first, values)) = bytes.split_first() else {
            return;
        };
        *address = usize::from(first & 0x3F);
        for value in values {
            // CTRL2: boot and soft reset end at once.
            let kept = if *address == 0x21 { value & !0xC0 } else { *value };
            self.0.borrow_mut().0[*address] = kept;
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
                    for byte in bytes.iter_mut() {
                        *byte = self.0.borrow().0[address];
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
        calibration: Calibration::NOMINAL,
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
            budget: chain.calibration.budget,
        },
        // This part's codes stand still, as those of one without noise may.
        settings: Settings {
            part,
            chain,
            noise: 1,
        },
    }
}
