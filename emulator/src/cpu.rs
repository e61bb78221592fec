//! What the rest of the emulator asks of a processor core, so that the core can be changed.
//!
//! In: code and data in memory, a [`Chip`] that answers loads and stores outside of it. Out: why
//! the core stopped. The core executes instructions and nothing else: exceptions, priorities and
//! sleep are [`exceptions`](crate::exceptions)' business.
//!
//! Left out: everything that depends on which core it is; see [`cortex_m3`](crate::cortex_m3).

use std::fmt;

use flash::layout::BASE;

use crate::chip::Chip;

/// Alias of the flash, where the core finds its first vectors as BOOT0 is low (RM0008 3.4).
pub const ALIAS: u32 = 0;

/// A register of the core (PM0056 2.1.3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Register {
    /// R0 to R12.
    R(u8),
    /// R13, the stack pointer in use.
    Sp,
    /// R14, the link register.
    Lr,
    /// The program counter; bit 0 written is the Thumb bit.
    Pc,
    /// The program status register: flags, IT state, Thumb bit, exception number.
    Xpsr,
    /// The main stack pointer.
    Msp,
    /// The process stack pointer.
    Psp,
    /// PRIMASK: 1 keeps every exception of settable priority away.
    Primask,
    /// BASEPRI: exceptions of this priority and lower ones are kept away, 0 none.
    Basepri,
    /// FAULTMASK: 1 keeps everything but NMI away.
    Faultmask,
    /// CONTROL: which stack thread mode uses.
    Control,
}

/// Why the core stopped. Its program counter is at the next instruction to execute, but where the
/// reason is an instruction that could not be executed: then it is at that one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The chip wanted it ([`Chip::wants_stop`]).
    Wanted,
    /// It came to a WFI.
    WaitForInterrupt,
    /// It came to a WFE.
    WaitForEvent,
    /// It executed an SVC.
    SupervisorCall,
    /// It branched to this EXC_RETURN.
    ExceptionReturn(u32),
    /// Something that is a fault.
    Fault(Fault),
}

/// Bytes of the flash that are compared at once.
const PIECE: usize = 256;

/// What the core could not do (PM0056 4.4.10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A load or a store at an address where nothing answers.
    Bus {
        /// Where.
        address: u32,
    },
    /// A fetch where there is no code.
    Fetch {
        /// Where.
        address: u32,
    },
    /// An instruction that is none.
    Undefined,
    /// A load or a store that has to be aligned and is not.
    Unaligned,
    /// A BKPT without a debugger.
    Breakpoint,
}

impl From<Fault> for Stop {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

/// Nothing is mapped there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoMemory {
    /// The address asked for.
    pub address: u32,
}

/// A Cortex-M3 with its memory and the chip around it.
pub trait Cpu: fmt::Debug {
    /// A core with empty memories of this part around `chip`.
    fn new(chip: Chip) -> Self;

    /// A register's value.
    fn register(&self, register: Register) -> u32;

    /// Writes a register.
    fn set_register(&mut self, register: Register, value: u32);

    /// Reads flash or RAM.
    ///
    /// Errors: [`NoMemory`] where neither is.
    fn read(&self, address: u32, into: &mut [u8]) -> Result<(), NoMemory>;

    /// Writes flash or RAM, whatever the chip thinks of it.
    ///
    /// Errors: [`NoMemory`] where neither is.
    fn write(&mut self, address: u32, bytes: &[u8]) -> Result<(), NoMemory>;

    /// Executes until there is a reason to stop.
    fn run(&mut self) -> Stop;

    /// The chip around it.
    fn chip(&self) -> &Chip;

    /// The chip around it, to change.
    fn chip_mut(&mut self) -> &mut Chip;

    /// Takes what the flash's cells hold into the core's memory, wherever they have changed; its
    /// alias is the same memory.
    fn put_flash_right(&mut self) {
        while let Some((offset, bytes)) = self.chip_mut().take_changed_flash() {
            self.put_right(BASE.wrapping_add(offset), &bytes);
        }
    }

    /// Writes what differs only: a core that has translated code throws it away where it is
    /// written, and after a reset nearly all of it still is what it was. Pieces side by side are
    /// written at once, since each write takes the core a quarter of a million instructions.
    fn put_right(&mut self, address: u32, bytes: &[u8]) {
        let mut differing = 0..0;
        for (piece, at) in bytes.chunks(PIECE).zip((0..).step_by(PIECE)) {
            if self.holds(address.wrapping_add(at as u32), piece) {
                continue;
            }
            if differing.end != at {
                self.put_range(address, bytes, differing);
                differing = at..at;
            }
            differing.end = at + piece.len();
        }
        self.put_range(address, bytes, differing);
    }

    /// Whether the memory at `address` is these bytes, a piece at the most.
    fn holds(&self, address: u32, bytes: &[u8]) -> bool {
        let mut held = [0; PIECE];
        let held = held.get_mut(..bytes.len());
        // The flash is mapped whole, so reading it cannot fail.
        held.is_some_and(|held| self.read(address, held).is_ok() && *held == *bytes)
    }

    /// Writes this range of `bytes`, which begin at `address`.
    fn put_range(&mut self, address: u32, bytes: &[u8], range: std::ops::Range<usize>) {
        let at = address.wrapping_add(range.start as u32);
        if let Some(bytes) = bytes.get(range).filter(|bytes| !bytes.is_empty()) {
            // The flash is mapped whole, so writing it cannot fail.
            let _ = self.write(at, bytes);
        }
    }
}
