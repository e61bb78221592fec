//! A part of which only the registers are there, and the factory of a device that has it.
//!
//! In: what the driver writes. Out: what stands in the registers, which a test may change. Left
//! out: time; the part is always ready.

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;

use device::calibration::motor::{MOTOR, TableSettings};
use device::channel::Setup;
use device::device::Factory;
use device::objects::device_objects::Identity;
use device::objects::table::{Channel, Models};
use device::sensor::PartConfig;
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use tilt::chain::{Calibration, Timing};
use tilt::filter::LowPass;
use tilt::table::Rule;
use tilt::uncertainty::{Budget, Span, Uncertainty};

/// What the part has in it.
pub trait Contents {
    /// The registers themselves, as many as the address on the wires has room for.
    fn bytes(&mut self) -> &mut [u8];

    /// What stays in the register of `address` of a value that is written: a bit that starts
    /// something clears itself when that has ended, which it does at once.
    fn kept(&self, address: usize, value: u8) -> u8 {
        // CTRL2 of an LIS2DW12: boot and soft reset.
        match address {
            0x21 => value & !0xC0,
            _ => value,
        }
    }

    /// The driver reads from `address` on.
    fn read_from(&mut self, _address: usize) {}
}

impl Contents for [u8; 64] {
    fn bytes(&mut self) -> &mut [u8] {
        self
    }
}

/// The registers of a part that is always ready, at 25 degC, and feels nothing.
pub const fn ready() -> [u8; 64] {
    let mut registers = [0; 64];
    registers[0x0F] = 0x44;
    registers[0x27] = 0x01;
    registers
}

/// The wires to a part. Copies share it.
#[derive(Clone, Debug)]
pub struct Part<R = [u8; 64]>(Rc<RefCell<R>>);

impl<R: Contents> Part<R> {
    pub fn new(registers: R) -> Self {
        Self(Rc::new(RefCell::new(registers)))
    }

    /// Does something to the registers behind the driver.
    pub fn with<T>(&self, act: impl FnOnce(&mut R) -> T) -> T {
        act(&mut self.0.borrow_mut())
    }

    fn take(&self, bytes: &[u8], address: &mut usize) {
        let Some((first, values)) = bytes.split_first() else {
            return;
        };
        let last = self.with(|registers| registers.bytes().len() - 1);
        *address = usize::from(*first) & last;
        for value in values {
            self.with(|registers| {
                registers.bytes()[*address] = registers.kept(*address, *value);
            });
            *address = (*address + 1) & last;
        }
    }
}

impl<R> ErrorType for Part<R> {
    type Error = Infallible;
}

impl<R: Contents> SpiDevice for Part<R> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        let mut address = 0;
        for operation in operations {
            match operation {
                Operation::Write(bytes) => self.take(bytes, &mut address),
                Operation::Read(bytes) => {
                    self.with(|registers| {
                        registers.read_from(address);
                        let behind = registers.bytes();
                        for byte in bytes.iter_mut() {
                            *byte = behind[address];
                            address = (address + 1) & (behind.len() - 1);
                        }
                    });
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

/// The calibration that such an instrument is delivered with: that of a perfect part.
pub fn delivered() -> Calibration {
    Calibration {
        budget: Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::CHAMBER),
        ..Calibration::NOMINAL
    }
}

/// The instrument of a perfect part whose noise has this standard deviation, 2^-26 g.
pub fn factory(
    (part, models): (PartConfig, Models),
    channel: Channel,
    serial: u32,
    noise: u32,
) -> Factory {
    Factory {
        identity: Identity {
            channel,
            serial,
            models,
        },
        node_id: channel.node_id(),
        kbit_s: 250,
        table_settings: TableSettings {
            rule: Rule::Nearest,
            reference: MOTOR,
        },
        setup: Setup {
            part,
            filter: LowPass::PRODUCT,
            timing: Timing::Aligned { latency_us: 25_000 },
            noise,
        },
    }
}
