//! A memory in which nothing stays but what it was delivered with.

use device::fault_log::ENTRY;
use device::program::{Confirmation, Held, ProgramError, ProgramMemory, Running};
use device::records::{EventStore, Record, RecordStore, StoreError};
use flash::Progress;

/// Bytes that a delivered calibration takes at the most.
const ROOM: usize = 512;

/// A memory with nothing in it but a calibration, and that once: it refuses everything else.
#[derive(Clone, Copy, Debug)]
pub struct Nothing {
    delivered: [u8; ROOM],
    length: usize,
    is_whole: bool,
}

impl Nothing {
    /// Without a calibration.
    pub const NEW: Self = Self {
        delivered: [0; ROOM],
        length: 0,
        is_whole: false,
    };
}

impl RecordStore for Nothing {
    fn start(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn needs_erase(&self, _length: u32) -> bool {
        false
    }

    fn read(&mut self, record: Record, offset: u32, buffer: &mut [u8]) -> usize {
        let stored = &self.delivered[..self.length];
        let rest = stored.get(offset as usize..).unwrap_or_default();
        if record != Record::Delivered || !self.is_whole {
            return 0;
        }
        let count = rest.len().min(buffer.len());
        buffer[..count].copy_from_slice(&rest[..count]);
        count
    }

    fn begin(&mut self, record: Record, _: u32) -> Result<(), StoreError> {
        match record {
            Record::Delivered if !self.is_whole => Ok(()),
            _ => Err(StoreError::Hardware),
        }
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        let end = self.length + bytes.len();
        let room = self.delivered.get_mut(self.length..end);
        room.ok_or(StoreError::NotBegun)?.copy_from_slice(bytes);
        self.length = end;
        Ok(())
    }

    fn staged(&mut self, _: u32, _: &mut [u8]) -> usize {
        0
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        if self.is_whole || self.length == 0 {
            return Err(StoreError::NotBegun);
        }
        self.is_whole = true;
        Ok(())
    }

    fn discard(&mut self) {}

    fn erase(&mut self, _: Record) -> Result<(), StoreError> {
        Err(StoreError::Hardware)
    }
}

impl EventStore for Nothing {
    fn recall_events(&mut self, _: &mut dyn FnMut(&[u8; ENTRY])) {}

    fn keep_event(&mut self, _: &[u8; ENTRY]) -> Result<(), StoreError> {
        Err(StoreError::Hardware)
    }

    fn clear_events(&mut self) -> Result<(), StoreError> {
        Err(StoreError::Hardware)
    }

    fn needs_room(&self) -> bool {
        false
    }

    fn make_room(&mut self) -> Result<(), StoreError> {
        Ok(())
    }
}

impl ProgramMemory for Nothing {
    fn clear(&mut self) -> Result<(), ProgramError> {
        Err(ProgramError::Write)
    }

    fn erase(&mut self) -> Result<Progress, ProgramError> {
        Err(ProgramError::Write)
    }

    fn begin(&mut self, _: Option<u32>) -> Result<(), ProgramError> {
        Err(ProgramError::Write)
    }

    fn append(&mut self, _: &[u8]) -> Result<(), ProgramError> {
        Err(ProgramError::Write)
    }

    fn commit(&mut self) -> Result<(), ProgramError> {
        Err(ProgramError::Write)
    }

    fn discard(&mut self) {}

    fn activate(&mut self) -> Result<Progress, ProgramError> {
        Err(ProgramError::NoProgram)
    }

    fn held(&self) -> Option<Held> {
        None
    }

    fn running(&mut self) -> Running {
        Running {
            hardware: 0,
            version: 0,
            crc: 0,
            slot: 0,
            confirmation: Confirmation::Confirmed,
        }
    }

    fn confirm(&mut self) -> Result<(), ProgramError> {
        Ok(())
    }
}
