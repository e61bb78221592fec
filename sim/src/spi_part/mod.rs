//! What the register-level models of SPI parts share: the wires, the bytes of a pair, the faults.
//!
//! In: bytes on the wires of a transaction. Out: what a part's registers make of them. A part
//! implements [`Slave`] over its own registers; a driver reaches it by a [`SpiPort`]. Left out:
//! everything that differs between parts, which is their modules'.

#[cfg(test)]
pub(crate) mod bench;
mod fifo;
mod output;
mod port;
mod state;

pub use port::SpiPort;

use std::fmt::Debug;

pub(crate) use fifo::{Fifo, FifoMode};
pub(crate) use output::{Pair, quantise};
pub(crate) use state::{ADDRESSES, Registers, State};

/// The two ways outputs are known to behave after a brown-out \[DS\].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AfterBrownOut {
    /// They keep the last sample.
    Frozen,
    /// They read zero.
    Zero,
}

/// Faults of the wires and of the part that a register value cannot express.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The data line from the part reads FFh.
    MisoHigh,
    /// The data line from the part reads 00h.
    MisoLow,
    /// Writes to this address have no effect.
    WriteRefused(u8),
    /// A boot or a reset does not end.
    ResetStuck,
    /// The host's SPI reports an error.
    Bus,
}

/// What the part is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// No supply.
    Off,
    /// Loading its trimming values after power-up; answers nothing.
    PowerUp,
    /// The bit of a software reset is set; refuses writes.
    Reset,
    /// BOOT is set; refuses writes and does not convert.
    Reboot,
    /// Working.
    Ready,
}

/// Where a transaction stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// Chip select is high.
    Idle,
    /// The next byte is the command.
    Command,
    /// The next byte leaves from this address.
    Read(u8),
    /// The next byte goes to this address.
    Write(u8),
}

/// A part whose command byte is a read bit and a seven-bit address.
pub trait Slave: Debug {
    /// Where the transaction stands.
    fn wire(&mut self) -> &mut Wire;

    /// The fault injected at present.
    fn fault(&self) -> Option<Fault>;

    /// The part's time in nanoseconds.
    fn now_ns(&self) -> u64;

    /// Moves the part's time on, in nanoseconds. An earlier time than the last changes nothing.
    fn advance_to(&mut self, time_ns: u64);

    /// A byte leaves from this address, with what reading it sets off.
    fn read_register(&mut self, address: u8) -> u8;

    /// A byte arrives for this address.
    fn write_register(&mut self, address: u8, value: u8);

    /// The address after this one in a burst.
    fn next_address(&self, address: u8) -> u8;

    /// Level of the INT1 pin.
    fn int1(&self) -> bool;

    /// Width of a data-ready pulse, ns.
    fn pulse_ns(&self) -> u64;

    /// Chip select goes low: a transaction begins.
    fn select(&mut self) {
        *self.wire() = Wire::Command;
    }

    /// Chip select goes high.
    fn deselect(&mut self) {
        *self.wire() = Wire::Idle;
    }

    /// Eight clocks: takes a byte in and gives one out, 00h when the part has nothing to send.
    fn exchange(&mut self, incoming: u8) -> u8 {
        let outgoing = match *self.wire() {
            Wire::Idle => 0,
            Wire::Command => {
                let address = incoming & 0x7F;
                let read = incoming & 0x80 != 0;
                *self.wire() = if read {
                    Wire::Read(address)
                } else {
                    Wire::Write(address)
                };
                0
            }
            Wire::Read(address) => {
                let byte = self.read_register(address);
                *self.wire() = Wire::Read(self.next_address(address));
                byte
            }
            Wire::Write(address) => {
                self.write_register(address, incoming);
                *self.wire() = Wire::Write(self.next_address(address));
                0
            }
        };
        match self.fault() {
            Some(Fault::MisoHigh) => 0xFF,
            Some(Fault::MisoLow) => 0x00,
            _ => outgoing,
        }
    }

    /// As many bytes out as there is room, with zeros in.
    fn read_into(&mut self, bytes: &mut [u8]) {
        bytes.iter_mut().for_each(|byte| *byte = self.exchange(0));
    }
}
