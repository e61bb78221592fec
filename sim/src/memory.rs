//! What a node keeps over a power cut: records and a program, in the host's memory.
//!
//! In and out: the device's own traits. Writing is whole or not at all, and every commit is
//! counted, so that a test can see that nothing is written without being asked.
//!
//! Left out: flash, with its pages, wear and cuts in the middle of a write.

use device::program::{ProgramError, ProgramMemory};
use device::records::{Record, RecordStore, StoreError};

/// Room for one record, bytes: what a pair of flash pages would give.
const RECORD_BYTES: usize = 4096;

/// Room for a program, bytes: one slot of the STM32F103CB.
const PROGRAM_BYTES: usize = 52 * 1024;

/// A node's memory.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    records: [Option<Vec<u8>>; Record::COUNT],
    staged: Option<(Record, Vec<u8>)>,
    program: Vec<u8>,
    incoming: Option<Vec<u8>>,
    commits: u32,
    broken: bool,
}

impl Memory {
    /// An empty memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// Commits so far.
    pub fn commits(&self) -> u32 {
        self.commits
    }

    /// From now on every write fails, as a worn-out flash would.
    pub fn set_broken(&mut self, broken: bool) {
        self.broken = broken;
    }

    /// The image that was downloaded last.
    pub fn program(&self) -> &[u8] {
        &self.program
    }

    /// Flips one bit of a committed record, as a cosmic ray or a bad cell does.
    pub fn flip(&mut self, record: Record, byte: usize) {
        if let Some(byte) = self.records[record as usize]
            .as_mut()
            .and_then(|r| r.get_mut(byte))
        {
            *byte ^= 1;
        }
    }

    fn sound(&self) -> Result<(), StoreError> {
        if self.broken {
            Err(StoreError::Hardware)
        } else {
            Ok(())
        }
    }
}

fn copy(from: &[u8], offset: u32, into: &mut [u8]) -> usize {
    let rest = from.get(offset as usize..).unwrap_or(&[]);
    let length = rest.len().min(into.len());
    into[..length].copy_from_slice(&rest[..length]);
    length
}

impl RecordStore for Memory {
    fn read(&self, record: Record, offset: u32, into: &mut [u8]) -> usize {
        let kept = self.records[record as usize].as_deref();
        kept.map_or(0, |bytes| copy(bytes, offset, into))
    }

    fn begin(&mut self, record: Record) -> Result<(), StoreError> {
        self.sound()?;
        self.staged = Some((record, Vec::new()));
        Ok(())
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        self.sound()?;
        let (_, staged) = self.staged.as_mut().ok_or(StoreError::NotBegun)?;
        if staged.len() + bytes.len() > RECORD_BYTES {
            return Err(StoreError::Full);
        }
        staged.extend_from_slice(bytes);
        Ok(())
    }

    fn staged(&self, offset: u32, into: &mut [u8]) -> usize {
        let staged = self.staged.as_ref();
        staged.map_or(0, |(_, bytes)| copy(bytes, offset, into))
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        self.sound()?;
        let (record, bytes) = self.staged.take().ok_or(StoreError::NotBegun)?;
        self.records[record as usize] = Some(bytes);
        self.commits += 1;
        Ok(())
    }

    fn discard(&mut self) {
        self.staged = None;
    }

    fn erase(&mut self, record: Record) -> Result<(), StoreError> {
        self.sound()?;
        self.records[record as usize] = None;
        Ok(())
    }
}

impl ProgramMemory for Memory {
    fn erase(&mut self) -> Result<(), ProgramError> {
        self.program.clear();
        self.broken
            .then_some(ProgramError::Write)
            .map_or(Ok(()), Err)
    }

    fn begin(&mut self, size: Option<u32>) -> Result<(), ProgramError> {
        if size.is_some_and(|s| s as usize > PROGRAM_BYTES) {
            return Err(ProgramError::Address);
        }
        self.incoming = Some(Vec::new());
        Ok(())
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), ProgramError> {
        let incoming = self.incoming.as_mut().ok_or(ProgramError::NotCleared)?;
        if incoming.len() + bytes.len() > PROGRAM_BYTES {
            return Err(ProgramError::Address);
        }
        incoming.extend_from_slice(bytes);
        Ok(())
    }

    fn commit(&mut self) -> Result<(), ProgramError> {
        self.program = self.incoming.take().ok_or(ProgramError::NoProgram)?;
        Ok(())
    }

    fn discard(&mut self) {
        self.incoming = None;
    }

    fn activate(&mut self) -> Result<(), ProgramError> {
        if self.program.is_empty() {
            return Err(ProgramError::NoProgram);
        }
        Ok(())
    }

    fn crc(&self) -> u32 {
        let mut crc = device::calibration::crc::Crc32::new();
        crc.add(&self.program);
        crc.value()
    }
}
