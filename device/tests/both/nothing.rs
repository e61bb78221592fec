//! A memory in which nothing stays.

use device::fault_log::ENTRY;
use device::program::{Held, ProgramError, ProgramMemory, Running, Standing};
use device::records::{EventStore, Record, RecordStore, StoreError};
use flash::Progress;

/// A memory with nothing in it, which refuses everything.
#[derive(Clone, Copy, Debug)]
pub struct Nothing;

impl RecordStore for Nothing {
    fn start(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn needs_erase(&self, _length: u32) -> bool {
        false
    }

    fn read(&mut self, _: Record, _: u32, _: &mut [u8]) -> usize {
        0
    }

    fn begin(&mut self, _: Record, _: u32) -> Result<(), StoreError> {
        Err(StoreError::Hardware)
    }

    fn append(&mut self, _: &[u8]) -> Result<(), StoreError> {
        Err(StoreError::NotBegun)
    }

    fn staged(&mut self, _: u32, _: &mut [u8]) -> usize {
        0
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        Err(StoreError::NotBegun)
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

    fn activate(&mut self) -> Result<(), ProgramError> {
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
            standing: Standing::Confirmed,
        }
    }

    fn confirm(&mut self) -> Result<(), ProgramError> {
        Ok(())
    }
}
