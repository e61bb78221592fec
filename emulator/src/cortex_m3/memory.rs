//! Loads and stores: flash, RAM, and the chip for everything else.
//!
//! Sources: RM0008 3.3 (memory map), 3.3.2 (bit-banding); ARMv7-M A3.2 (alignment). Left out: code
//! in the RAM, and stores that reach the bus later than the next instruction.

use flash::layout::{BASE, RAM};

use super::op::Kind;
use crate::chip::{Chip, bit_band};
use crate::cpu::{ALIAS, Fault, NoMemory, Stop};

/// Peripherals, the electronic signature, and the bit-band aliases of peripherals and RAM (RM0008
/// 3.3, 3.3.2); the core's own registers (PM0056 4) and those of the debug unit (RM0008 31).
const REGISTERS: [(u32, u32); 5] = [
    PERIPHERALS,
    (0xE000_0000, 0x10_0000),
    (0x1FFF_F000, 0x1000),
    (0x2200_0000, 0x10_0000),
    (0x4200_0000, 0x60_0000),
];

/// Those of the peripherals.
const PERIPHERALS: (u32, u32) = (0x4000_0000, 0x3_0000);

/// An instruction has not been executed, or it stops the core: [`Memory::stop`] has the reason.
/// It is kept there, since a result that fits a register costs less each time there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stopped;

/// Flash and RAM as the core sees them, and the chip.
#[derive(Debug)]
pub struct Memory {
    pub chip: Chip,
    pub flash: Box<[u8]>,
    pub ram: Box<[u8]>,
    /// Why the core was stopped last.
    pub stop: Stop,
}

/// Whether an address is one of so many from a base on.
#[inline(always)]
fn is_among(address: u32, (base, length): (u32, u32)) -> bool {
    address.wrapping_sub(base) < length
}

/// So many bytes of a memory that begins at `base`.
#[inline(always)]
fn piece<const N: usize>(memory: &[u8], base: u32, address: u32) -> Option<&[u8; N]> {
    let from = address.wrapping_sub(base) as usize;
    memory.get(from..from + N)?.first_chunk()
}

#[inline(always)]
fn piece_mut<const N: usize>(memory: &mut [u8], base: u32, address: u32) -> Option<&mut [u8; N]> {
    let from = address.wrapping_sub(base) as usize;
    memory.get_mut(from..from + N)?.first_chunk_mut()
}

impl Memory {
    /// Empty memories around `chip`, of the sizes that it has.
    pub fn new(chip: Chip) -> Self {
        Self {
            flash: vec![0; chip.flash_size() as usize].into(),
            ram: vec![0; chip.ram_size() as usize].into(),
            chip,
            stop: Stop::Wanted,
        }
    }

    /// Stops the core.
    #[cold]
    pub fn stopped(&mut self, stop: Stop) -> Stopped {
        self.stop = stop;
        Stopped
    }

    /// So many bytes of flash or RAM.
    #[inline(always)]
    fn bytes<const N: usize>(&self, address: u32) -> Option<&[u8; N]> {
        let ram = piece(&self.ram, RAM, address);
        ram.or_else(|| piece(&self.flash, BASE, address))
    }

    /// So many words of the RAM.
    #[inline(always)]
    pub fn words(&mut self, address: u32, count: u32) -> Option<&mut [[u8; 4]]> {
        let from = address.wrapping_sub(RAM) as usize;
        let bytes = self.ram.get_mut(from..from + 4 * count as usize)?;
        Some(bytes.as_chunks_mut().0)
    }

    /// A word of the flash, where it most likely is.
    #[inline(always)]
    pub fn literal(&mut self, address: u32) -> Result<u32, Stopped> {
        match piece(&self.flash, BASE, address) {
            Some(bytes) => Ok(u32::from_le_bytes(*bytes)),
            None => self.word(address),
        }
    }

    /// A word.
    #[inline(always)]
    pub fn word(&mut self, address: u32) -> Result<u32, Stopped> {
        match self.bytes(address) {
            Some(bytes) => Ok(u32::from_le_bytes(*bytes)),
            None => self.load_elsewhere(address, 4),
        }
    }

    /// A half-word, or a byte, as `kind` extends it.
    #[inline(always)]
    pub fn load(&mut self, kind: Kind, address: u32) -> Result<u32, Stopped> {
        Ok(match kind {
            Kind::Word => self.word(address)?,
            Kind::Half => self.half(address)?,
            Kind::Byte => self.byte(address)?,
            Kind::SignedHalf => self.half(address)? as i16 as u32,
            Kind::SignedByte => self.byte(address)? as i8 as u32,
        })
    }

    #[inline(always)]
    fn half(&mut self, address: u32) -> Result<u32, Stopped> {
        match self.bytes(address) {
            Some(bytes) => Ok(u16::from_le_bytes(*bytes).into()),
            None => self.load_elsewhere(address, 2),
        }
    }

    #[inline(always)]
    fn byte(&mut self, address: u32) -> Result<u32, Stopped> {
        match self.bytes::<1>(address) {
            Some([byte]) => Ok((*byte).into()),
            None => self.load_elsewhere(address, 1),
        }
    }

    /// Stores what `kind` has of `value`.
    #[inline(always)]
    pub fn store(&mut self, kind: Kind, address: u32, value: u32) -> Result<(), Stopped> {
        match kind {
            Kind::Word => self.store_bytes(address, value.to_le_bytes(), value),
            Kind::Half | Kind::SignedHalf => {
                self.store_bytes(address, (value as u16).to_le_bytes(), value)
            }
            Kind::Byte | Kind::SignedByte => self.store_bytes(address, [value as u8], value),
        }
    }

    #[inline(always)]
    fn store_bytes<const N: usize>(
        &mut self,
        address: u32,
        bytes: [u8; N],
        value: u32,
    ) -> Result<(), Stopped> {
        match piece_mut(&mut self.ram, RAM, address) {
            Some(place) => {
                *place = bytes;
                Ok(())
            }
            None => self.store_elsewhere(address, N as u32, value),
        }
    }

    #[inline(never)]
    fn load_elsewhere(&mut self, address: u32, size: u32) -> Result<u32, Stopped> {
        // Code that waits for a peripheral loads from it again and again.
        if is_among(address, PERIPHERALS) && address & (size - 1) == 0 {
            return Ok(self.chip.read_peripheral(address, size));
        }
        if let Some(bytes) = self.alias(address, size) {
            return Ok(bytes
                .iter()
                .rev()
                .fold(0, |word, byte| word << 8 | u32::from(*byte)));
        }
        self.registers(address, size)?;
        if let Some((byte, bit)) = bit_band::in_ram(address) {
            let held = self.ram.get(byte.wrapping_sub(RAM) as usize);
            return Ok(held.map_or(0, |held| u32::from(held >> bit & 1)));
        }
        Ok(self.chip.read(address, size))
    }

    /// The flash where the core has its first vectors.
    fn alias(&self, address: u32, size: u32) -> Option<&[u8]> {
        let from = address.checked_sub(ALIAS)? as usize;
        self.flash.get(from..from + size as usize)
    }

    #[inline(never)]
    fn store_elsewhere(&mut self, address: u32, size: u32, value: u32) -> Result<(), Stopped> {
        let flash = self.flash.len();
        let offset = address.wrapping_sub(BASE) as usize;
        if (address as usize) < flash || offset < flash {
            let mask = u32::MAX >> (32 - 8 * size);
            self.chip.store_in_flash(address, size, value & mask);
            return Ok(());
        }
        self.registers(address, size)?;
        if let Some((byte, bit)) = bit_band::in_ram(address) {
            if let Some(held) = self.ram.get_mut(byte.wrapping_sub(RAM) as usize) {
                *held = *held & !(1 << bit) | ((value & 1) as u8) << bit;
            }
            return Ok(());
        }
        self.chip.write(address, size, value);
        Ok(())
    }

    /// Tells the chip of the block of `size` bytes at `at`, for those who watch addresses.
    #[cold]
    #[inline(never)]
    pub fn observe(&mut self, at: u32, size: u16) {
        let offset = at.checked_sub(BASE).unwrap_or(at) as usize;
        let bytes = self.flash.get(offset..offset + usize::from(size));
        self.chip.pass_watched(at, bytes.unwrap_or(&[]));
    }

    /// Reads flash or RAM.
    ///
    /// Errors: [`NoMemory`] where neither is.
    pub fn read(&self, address: u32, into: &mut [u8]) -> Result<(), NoMemory> {
        for (memory, base) in [(&self.ram, RAM), (&self.flash, BASE), (&self.flash, ALIAS)] {
            let from = address.wrapping_sub(base) as usize;
            let held = memory.get(from..).and_then(|rest| rest.get(..into.len()));
            if let Some(held) = held {
                into.copy_from_slice(held);
                return Ok(());
            }
        }
        Err(NoMemory { address })
    }

    /// Writes flash or RAM; the offset in the flash where that was it.
    ///
    /// Errors: [`NoMemory`] where neither is.
    pub fn write(&mut self, address: u32, bytes: &[u8]) -> Result<Option<usize>, NoMemory> {
        let ram = address.wrapping_sub(RAM) as usize;
        let place = self.ram.get_mut(ram..);
        if let Some(place) = place.and_then(|rest| rest.get_mut(..bytes.len())) {
            place.copy_from_slice(bytes);
            return Ok(None);
        }
        for base in [BASE, ALIAS] {
            let from = address.wrapping_sub(base) as usize;
            let place = self.flash.get_mut(from..);
            if let Some(place) = place.and_then(|rest| rest.get_mut(..bytes.len())) {
                place.copy_from_slice(bytes);
                return Ok(Some(from));
            }
        }
        Err(NoMemory { address })
    }

    /// Errors: where there are no registers, or where the access lies across two of them.
    fn registers(&mut self, address: u32, size: u32) -> Result<(), Stopped> {
        if !REGISTERS.into_iter().any(|among| is_among(address, among)) {
            return Err(self.stopped(Fault::Bus { address }.into()));
        }
        match address % size {
            0 => Ok(()),
            _ => Err(self.stopped(Fault::Unaligned.into())),
        }
    }
}
