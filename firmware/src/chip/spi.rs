//! SPI1 with the sensor's select line: an `embedded_hal` SPI device in mode 3 at 4.5 MHz.
//!
//! In: transactions of the sensor's driver. Out: the bytes that the part answers. The processor
//! waits for each byte, 1.8 us; the longest burst of a driver has 26 bytes (the read-back of the
//! ISM330DHCX), that of a sample 9 or 17. RM0008 25.3, 25.5.
//!
//! A byte that does not come within [`PATIENCE`] looks ends the transaction with an error: it
//! cannot happen while the port has its clock, and must not hold the processor if it does.

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use embedded_hal::spi::{Error, ErrorKind, ErrorType, Operation, SpiDevice};
use stm32f1xx_hal::pac::SPI1;

use super::clock::Wait;
use super::register::write;

/// CR1: 72 MHz / 16 (BR = 3), master, software select that is never active (SSM, SSI), clock idle
/// high and second edge (CPOL, CPHA), eight bits, most significant first, enabled (SPE).
///
/// LIS2DW12, DS11811 table 6, and ISM330DHCX: at most 10 MHz. The next rate up is 9 MHz: 55.6 ns
/// from the part's edge to the port's. The part's output may take 50 of them (t_v(SO)) and the port
/// wants its input 5 before (STM32F103 data sheet, t_su(MI)), which leaves nothing for a board.
const SET_UP: u16 = 3 << 3 | 1 << 2 | 1 << 9 | 1 << 8 | 1 << 1 | 1 | 1 << 6;
/// SR: a byte has come; the port is busy.
const RXNE: u16 = 1;
/// See [`RXNE`].
const BSY: u16 = 1 << 7;

/// Looks at the port before a byte counts as lost; one takes 128 cycles, a look about eight.
const PATIENCE: u16 = 1000;

/// A byte has not come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost;

impl Error for Lost {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

/// The sensor on its port, with the pin that selects it.
pub struct Sensor<CS> {
    port: SPI1,
    select: CS,
}

impl<CS: OutputPin> Sensor<CS> {
    /// Starts the port, whose peripheral clock and pins are set up; `select` is high.
    pub fn start(port: SPI1, select: CS) -> Self {
        write(port.cr1(), SET_UP);
        Self { port, select }
    }

    // On its own, so that what is waited for can be told from what is done.
    #[inline(never)]
    fn wait(&self, flag: u16, value: u16) -> Result<(), Lost> {
        for _ in 0..PATIENCE {
            if self.port.sr().read().bits() & flag == value {
                return Ok(());
            }
        }
        Err(Lost)
    }

    /// Sends a byte and returns the one that comes back.
    ///
    /// There is room for it: the byte before has come back, so it has left (RM0008 25.3.7).
    // A call for each byte would cost as much as the byte does.
    #[inline(always)]
    fn exchange(&mut self, byte: u8) -> Result<u8, Lost> {
        write(self.port.dr(), u16::from(byte));
        self.wait(RXNE, RXNE)?;
        Ok(self.port.dr().read().bits() as u8)
    }

    fn carry_out(&mut self, operation: &mut Operation<'_, u8>) -> Result<(), Lost> {
        match operation {
            Operation::Read(into) => self.exchange_each(into.iter_mut().map(|to| (0, to))),
            Operation::TransferInPlace(bytes) => {
                self.exchange_each(bytes.iter_mut().map(|to| (*to, to)))
            }
            Operation::Write(bytes) => bytes
                .iter()
                .try_for_each(|byte| self.exchange(*byte).map(|_| ())),
            Operation::Transfer(into, bytes) => {
                let longest = into.len().max(bytes.len());
                let mut out = bytes.iter();
                let mut into = into.iter_mut();
                (0..longest).try_for_each(|_| {
                    let came = self.exchange(out.next().copied().unwrap_or(0))?;
                    if let Some(to) = into.next() {
                        *to = came;
                    }
                    Ok(())
                })
            }
            Operation::DelayNs(ns) => {
                Wait.delay_ns(*ns);
                Ok(())
            }
        }
    }

    fn exchange_each<'a>(
        &mut self,
        mut bytes: impl Iterator<Item = (u8, &'a mut u8)>,
    ) -> Result<(), Lost> {
        bytes.try_for_each(|(byte, to)| {
            *to = self.exchange(byte)?;
            Ok(())
        })
    }
}

impl<CS> ErrorType for Sensor<CS> {
    type Error = Lost;
}

impl<CS: OutputPin> SpiDevice for Sensor<CS> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Lost> {
        self.select.set_low().map_err(|_| Lost)?;
        let mut operations = operations.iter_mut();
        let done = operations.try_for_each(|operation| self.carry_out(operation));
        // The select line may rise only after the last clock edge.
        let quiet = self.wait(BSY, 0);
        self.select.set_high().map_err(|_| Lost)?;
        done.and(quiet)
    }
}
