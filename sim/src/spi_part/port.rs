//! The wires between a driver and the model: `SpiDevice` on a shared part.
//!
//! In: transactions of `embedded-hal` operations. Out: the bytes the part sends. A transaction
//! takes no virtual time except for its `DelayNs` operations; the speed of the wire is left out.

use std::cell::RefCell;
use std::rc::Rc;

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};

use super::{Fault, Slave};

/// One end of the wires. Clones talk to the same part.
#[derive(Debug)]
pub struct SpiPort<C> {
    chip: Rc<RefCell<C>>,
}

impl<C> Clone for SpiPort<C> {
    fn clone(&self) -> Self {
        Self::new(Rc::clone(&self.chip))
    }
}

impl<C> SpiPort<C> {
    /// Wires to a part that somebody else, as a rule the world, goes on feeding.
    pub fn new(chip: Rc<RefCell<C>>) -> Self {
        Self { chip }
    }

    /// The part at the other end.
    pub fn chip(&self) -> &Rc<RefCell<C>> {
        &self.chip
    }
}

impl<C> ErrorType for SpiPort<C> {
    type Error = ErrorKind;
}

impl<C: Slave> SpiDevice for SpiPort<C> {
    /// Runs the operations under one chip select.
    ///
    /// # Errors
    /// [`ErrorKind::Other`] while [`Fault::Bus`] is injected; the part then sees nothing.
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        let mut chip = self.chip.borrow_mut();
        if chip.fault() == Some(Fault::Bus) {
            return Err(ErrorKind::Other);
        }
        chip.select();
        for operation in operations {
            run(&mut *chip, operation);
        }
        chip.deselect();
        Ok(())
    }
}

/// One operation of a transaction.
fn run<C: Slave>(chip: &mut C, operation: &mut Operation<'_, u8>) {
    match operation {
        Operation::Read(bytes) => chip.read_into(bytes),
        Operation::Write(bytes) => bytes.iter().for_each(|&byte| {
            chip.exchange(byte);
        }),
        Operation::Transfer(read, write) => {
            for index in 0..read.len().max(write.len()) {
                let received = chip.exchange(write.get(index).copied().unwrap_or(0));
                if let Some(byte) = read.get_mut(index) {
                    *byte = received;
                }
            }
        }
        Operation::TransferInPlace(bytes) => {
            bytes
                .iter_mut()
                .for_each(|byte| *byte = chip.exchange(*byte));
        }
        Operation::DelayNs(ns) => chip.advance_to(chip.now_ns().saturating_add(u64::from(*ns))),
    }
}

impl<C: Slave> DelayNs for SpiPort<C> {
    /// Waits by moving this part's clock on.
    ///
    /// No sample is converted meanwhile: enough for `init`, while a self-test needs a delay
    /// that lets the world run.
    fn delay_ns(&mut self, ns: u32) {
        let mut chip = self.chip.borrow_mut();
        let until_ns = chip.now_ns().saturating_add(u64::from(ns));
        chip.advance_to(until_ns);
    }
}
