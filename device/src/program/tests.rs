//! Updates as a master goes through them, and the ways in which they go wrong.

extern crate std;

use std::vec::Vec;

use canopen::object::Abort;
use proptest::prelude::*;

use flash::Progress;

use super::{Confirmation, Effect, Held, Program, ProgramError, ProgramMemory, Running};

/// A memory that takes images ending in 0xA5, of eight bytes at most, and starts those that don't
/// begin with 0xEE.
#[derive(Debug, Default)]
struct Memory {
    image: Vec<u8>,
    pages: u8,
    erased: bool,
    checks: u8,
    active: bool,
    worn: bool,
    secured: bool,
}

impl ProgramMemory for Memory {
    fn clear(&mut self) -> Result<(), ProgramError> {
        if self.secured {
            return Err(ProgramError::Secured);
        }
        self.image.clear();
        self.pages = 3;
        Ok(())
    }

    fn erase(&mut self) -> Result<Progress, ProgramError> {
        if self.worn {
            return Err(ProgramError::Write);
        }
        self.pages -= 1;
        self.erased = self.pages == 0;
        Ok(if self.erased {
            Progress::Done
        } else {
            Progress::More
        })
    }

    fn begin(&mut self, size: Option<u32>) -> Result<(), ProgramError> {
        if size.is_some_and(|size| size > 8) {
            return Err(ProgramError::Address);
        }
        assert!(self.erased, "a download into a memory that is not erased");
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

    fn activate(&mut self) -> Result<Progress, ProgramError> {
        assert_eq!(self.image.last(), Some(&0xA5), "an image that is not whole");
        self.checks += 1;
        if self.checks < 3 {
            return Ok(Progress::More);
        }
        self.checks = 0;
        if self.image[0] == 0xEE {
            return Err(ProgramError::Signature);
        }
        self.active = true;
        Ok(Progress::Done)
    }

    fn held(&self) -> Option<Held> {
        let bytes = self.image.len() as u32;
        (bytes > 0).then_some(Held {
            crc: 7,
            identity: 8,
            bytes,
        })
    }

    fn running(&mut self) -> Running {
        Running {
            hardware: 1,
            version: 2,
            crc: 3,
            slot: 0,
            confirmation: Confirmation::Confirmed,
        }
    }

    fn confirm(&mut self) -> Result<(), ProgramError> {
        Ok(())
    }
}

/// Three pages, of which the status tells until the last.
fn clear(program: &mut Program, memory: &mut Memory) {
    for _ in 0..3 {
        assert_eq!((program.control(), program.status()), (3, 1));
        program.step(memory);
    }
    assert_eq!(program.status(), 1 << 1);
}

/// Stopped and cleared.
fn ready() -> (Program, Memory) {
    let (mut program, mut memory) = (Program::new(), Memory::default());
    assert_eq!(program.set_control(0, &mut memory), Ok(Effect::None));
    assert_eq!(program.set_control(3, &mut memory), Ok(Effect::None));
    clear(&mut program, &mut memory);
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
    assert_eq!(program.set_control(1, &mut memory), Ok(Effect::None));
    check(&mut program, &mut memory);
    assert_eq!(program.step(&mut memory), Effect::Reset);
    assert!(memory.active);
    // Busy until the reset comes.
    assert_eq!(program.status(), 1);
}

/// All steps of a check but the last: the node is busy, and shows which image it is about.
fn check(program: &mut Program, memory: &mut Memory) {
    for _ in 0..2 {
        assert_eq!((program.control(), program.status()), (0, 1));
        assert_eq!(program.identification(memory), 7);
        for command in 0..4 {
            let refused = program.set_control(command, memory);
            assert_eq!(refused, Err(Abort::WrongState), "{command}");
        }
        assert_eq!(program.create(None, memory), Err(Abort::WrongState));
        assert_eq!(program.resume(4, memory), Err(Abort::WrongState));
        program.discard();
        assert_eq!(program.step(memory), Effect::None);
    }
    assert!(!memory.active);
}

#[test]
fn a_wrong_signature_is_told_by_the_status_and_the_image_stays() {
    let (mut program, mut memory) = ready();
    program.create(Some(2), &mut memory).unwrap();
    program.append(&[0xEE, 0xA5], &mut memory).unwrap();
    program.commit(&mut memory).unwrap();
    for _ in 0..2 {
        assert_eq!(program.set_control(1, &mut memory), Ok(Effect::None));
        check(&mut program, &mut memory);
        assert_eq!(program.step(&mut memory), Effect::None);
        assert_eq!(program.status(), 7 << 1 | 5 << 16);
        assert_eq!((program.control(), memory.active), (0, false));
    }
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
fn a_broken_download_goes_on_behind_what_has_come() {
    let (mut program, mut memory) = ready();
    program.create(Some(4), &mut memory).unwrap();
    program.append(&[1, 2], &mut memory).unwrap();
    assert_eq!(program.resume(2, &memory), Err(Abort::WrongState));
    program.discard();
    assert_eq!(program.status(), 3 << 1);
    assert_eq!(program.resume(1, &memory), Err(Abort::InvalidValue));
    assert_eq!(program.resume(2, &memory), Ok(()));
    program.create(Some(2), &mut memory).unwrap();
    program.append(&[3, 0xA5], &mut memory).unwrap();
    assert_eq!(program.identification(&mut memory), 3);
    program.commit(&mut memory).unwrap();
    assert_eq!(program.identification(&mut memory), 7);
    assert_eq!(memory.image, [1, 2, 3, 0xA5]);
    assert_eq!(program.resume(4, &memory), Err(Abort::WrongState));
}

#[test]
fn what_was_found_wrong_cannot_be_resumed() {
    let (mut program, mut memory) = ready();
    program.create(None, &mut memory).unwrap();
    program.append(&[1, 2], &mut memory).unwrap();
    assert_eq!(program.commit(&mut memory), Err(Abort::CannotStore));
    assert_eq!(program.resume(2, &memory), Err(Abort::WrongState));
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
    program.discard();
    assert_eq!(program.create(None, &mut memory), Err(Abort::WrongState));
    assert_eq!(program.status(), 4 << 1);
    assert_eq!(program.set_control(3, &mut memory), Ok(Effect::None));
    assert_eq!(program.create(None, &mut memory), Err(Abort::WrongState));
    clear(&mut program, &mut memory);
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

/// 1F51h then read 3, no program there, of a node whose only program went on to run.
#[test]
fn a_clear_that_was_refused_changed_the_state() {
    let (mut program, mut memory) = (Program::new(), Memory::default());
    memory.secured = true;
    program.set_control(0, &mut memory).unwrap();
    let refused = program.set_control(3, &mut memory);
    assert_eq!(refused, Err(Abort::LocalControl));
    assert_eq!((program.control(), program.status()), (0, 7 << 1));
    assert_eq!(program.set_control(1, &mut memory), Ok(Effect::None));
    assert_eq!(program.control(), 1);
}

#[test]
fn an_erase_that_fails_leads_nowhere() {
    let (mut program, mut memory) = (Program::new(), Memory::default());
    memory.worn = true;
    program.set_control(0, &mut memory).unwrap();
    assert_eq!(program.set_control(3, &mut memory), Ok(Effect::None));
    program.step(&mut memory);
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
    fn no_sequence_starts_what_is_not_whole(steps in prop::collection::vec(0..16u8, 0..60)) {
        let (mut program, mut memory) = (Program::new(), Memory::default());
        for step in steps {
            let _ = match step {
                0..=4 => program.set_control(step, &mut memory).map(drop),
                5 => program.create(Some(3), &mut memory),
                6 => program.append(&[7, 0xA5], &mut memory),
                7 => program.append(&[0xA5], &mut memory),
                8 => program.commit(&mut memory),
                9 => program.resume(4, &memory),
                10 => program.resume(2, &memory),
                11 => {
                    program.discard();
                    Ok(())
                }
                _ => {
                    let started = program.step(&mut memory) == Effect::Reset;
                    prop_assert_eq!(started, memory.active);
                    memory.active = false;
                    Ok(())
                }
            };
            prop_assert!(matches!(program.control(), 0 | 1 | 3));
            prop_assert!(program.status() & 0xFF <= 7 << 1);
        }
    }
}
