//! Updates as a master goes through them, and the ways in which they go wrong.

extern crate std;

use std::vec::Vec;

use canopen::object::Abort;
use proptest::prelude::*;

use super::{Effect, Program, ProgramError, ProgramMemory};

/// A memory that takes images ending in 0xA5, of eight bytes at most.
#[derive(Debug, Default)]
struct Memory {
    image: Vec<u8>,
    erased: bool,
    active: bool,
    worn: bool,
}

impl ProgramMemory for Memory {
    fn erase(&mut self) -> Result<(), ProgramError> {
        if self.worn {
            return Err(ProgramError::Write);
        }
        self.image.clear();
        self.erased = true;
        Ok(())
    }

    fn begin(&mut self, size: Option<u32>) -> Result<(), ProgramError> {
        if size.is_some_and(|size| size > 8) {
            return Err(ProgramError::Address);
        }
        assert!(self.erased, "a download into a memory that is not erased");
        self.erased = false;
        Ok(())
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), ProgramError> {
        if self.image.len() + bytes.len() > 8 {
            return Err(ProgramError::Address);
        }
        self.image.extend_from_slice(bytes);
        Ok(())
    }

    fn commit(&mut self) -> Result<(), ProgramError> {
        if self.image.last() == Some(&0xA5) {
            Ok(())
        } else {
            Err(ProgramError::Damaged)
        }
    }

    fn discard(&mut self) {
        self.image.clear();
    }

    fn activate(&mut self) -> Result<(), ProgramError> {
        assert_eq!(self.image.last(), Some(&0xA5), "an image that is not whole");
        self.active = true;
        Ok(())
    }

    fn crc(&mut self) -> u32 {
        self.image.len() as u32
    }
}

/// Stopped and cleared.
fn ready() -> (Program, Memory) {
    let (mut program, mut memory) = (Program::new(), Memory::default());
    assert_eq!(program.set_control(0, &mut memory), Ok(Effect::None));
    assert_eq!(program.set_control(3, &mut memory), Ok(Effect::None));
    (program, memory)
}

#[test]
fn stop_clear_download_start() {
    let (mut program, mut memory) = ready();
    assert_eq!((program.control(), program.status()), (3, 1 << 1));
    program.create(Some(4), &mut memory).unwrap();
    assert_eq!(program.status(), 1);
    program.append(&[1, 2, 3], &mut memory).unwrap();
    program.append(&[0xA5], &mut memory).unwrap();
    program.commit(&mut memory).unwrap();
    assert_eq!((program.control(), program.status()), (0, 0));
    assert_eq!(program.set_control(1, &mut memory), Ok(Effect::Reset));
    assert!(memory.active);
}

#[test]
fn an_incomplete_image_is_not_started() {
    let (mut program, mut memory) = ready();
    assert_eq!(program.set_control(1, &mut memory), Err(Abort::WrongState));
    program.create(Some(4), &mut memory).unwrap();
    assert_eq!(program.set_control(1, &mut memory), Err(Abort::WrongState));
    program.append(&[1, 2, 0xA5], &mut memory).unwrap();
    assert_eq!(program.commit(&mut memory), Err(Abort::LengthTooLow));
    assert_eq!(program.status(), 3 << 1);
    assert_eq!(program.set_control(1, &mut memory), Err(Abort::WrongState));
    assert_eq!(program.status(), 3 << 1);
    assert!(!memory.active);
}

#[test]
fn a_zero_length_download_is_no_program() {
    let (mut program, mut memory) = ready();
    program.create(Some(0), &mut memory).unwrap();
    assert_eq!(program.commit(&mut memory), Err(Abort::LengthTooLow));
}

#[test]
fn each_download_needs_a_clear_of_its_own() {
    let (mut program, mut memory) = ready();
    program.create(None, &mut memory).unwrap();
    program.append(&[1], &mut memory).unwrap();
    program.discard(&mut memory);
    assert_eq!(program.create(None, &mut memory), Err(Abort::WrongState));
    assert_eq!(program.status(), 4 << 1);
    assert_eq!(program.set_control(3, &mut memory), Ok(Effect::None));
    assert_eq!(program.create(None, &mut memory), Ok(()));
}

#[test]
fn a_running_program_is_neither_cleared_nor_written_over() {
    let (mut program, mut memory) = (Program::new(), Memory::default());
    assert_eq!(program.set_control(3, &mut memory), Err(Abort::WrongState));
    assert_eq!(program.create(None, &mut memory), Err(Abort::WrongState));
    assert_eq!(program.control(), 1);
}

#[test]
fn more_than_announced_and_more_than_fits_are_refused() {
    let (mut program, mut memory) = ready();
    assert_eq!(
        program.create(Some(9), &mut memory),
        Err(Abort::OutOfMemory)
    );
    assert_eq!(program.status(), 6 << 1);
    program.create(Some(2), &mut memory).unwrap();
    let refused = program.append(&[1, 2, 3], &mut memory);
    assert_eq!(refused, Err(Abort::LengthTooHigh));
    assert_eq!(program.append(&[1], &mut memory), Err(Abort::WrongState));
}

#[test]
fn an_erase_that_fails_leads_nowhere() {
    let (mut program, mut memory) = (Program::new(), Memory::default());
    memory.worn = true;
    program.set_control(0, &mut memory).unwrap();
    assert_eq!(program.set_control(3, &mut memory), Err(Abort::Hardware));
    assert_eq!(program.status(), 5 << 1);
    assert_eq!(program.create(None, &mut memory), Err(Abort::WrongState));
}

#[test]
fn unknown_commands_are_no_values_of_the_object() {
    let (mut program, mut memory) = (Program::new(), Memory::default());
    assert_eq!(
        program.set_control(4, &mut memory),
        Err(Abort::InvalidValue)
    );
    assert_eq!(program.set_control(2, &mut memory), Ok(Effect::Reset));
}

proptest! {
    /// The memory's own assertions watch over order; here it must also answer legally.
    #[test]
    fn no_sequence_starts_what_is_not_whole(steps in prop::collection::vec(0..10u8, 0..60)) {
        let (mut program, mut memory) = (Program::new(), Memory::default());
        for step in steps {
            let _ = match step {
                0..=4 => program.set_control(step, &mut memory).map(drop),
                5 => program.create(Some(3), &mut memory),
                6 => program.append(&[7, 0xA5], &mut memory),
                7 => program.append(&[0xA5], &mut memory),
                8 => program.commit(&mut memory),
                _ => {
                    program.discard(&mut memory);
                    Ok(())
                }
            };
            prop_assert!(matches!(program.control(), 0 | 1 | 3));
            prop_assert!(program.status() <= 7 << 1);
        }
    }
}
