//! What a node keeps, until the stores in flash take its place: nothing.
//!
//! In: the device's requests. Out: no record, and a refusal of every write, so that nobody takes
//! for stored what a reset would lose.

use device::program::{ProgramError, ProgramMemory};
use device::records::{Record, RecordStore, StoreError};

/// A memory that holds nothing.
#[derive(Debug, Default)]
pub struct Memory;

impl RecordStore for Memory {
    fn read(&self, _: Record, _: u32, _: &mut [u8]) -> usize {
        0
    }

    fn begin(&mut self, _: Record) -> Result<(), StoreError> {
        Err(StoreError::Hardware)
    }

    fn append(&mut self, _: &[u8]) -> Result<(), StoreError> {
        Err(StoreError::NotBegun)
    }

    fn staged(&self, _: u32, _: &mut [u8]) -> usize {
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

impl ProgramMemory for Memory {
    fn erase(&mut self) -> Result<(), ProgramError> {
        Err(ProgramError::Secured)
    }

    fn begin(&mut self, _: Option<u32>) -> Result<(), ProgramError> {
        Err(ProgramError::NotCleared)
    }

    fn append(&mut self, _: &[u8]) -> Result<(), ProgramError> {
        Err(ProgramError::NotCleared)
    }

    fn commit(&mut self) -> Result<(), ProgramError> {
        Err(ProgramError::NoProgram)
    }

    fn discard(&mut self) {}

    fn activate(&mut self) -> Result<(), ProgramError> {
        Err(ProgramError::NoProgram)
    }

    fn crc(&self) -> u32 {
        0
    }
}
