//! What is longer than eight bytes, and what works with it: names, the calibration, the fault log
//! with its black box, and the program (1008h to 100Ah, 2060h to 2063h, 2070h and 2071h, 1F50h to
//! 1F57h).
//!
//! In: bytes in order, commands, references. Out: bytes from any offset, progress, results.
//! A downloaded calibration is staged in the memory first; it counts when all of it has come, has
//! been understood and is stored.
//!
//! Left out: the formats (`calibration::encoding`, `program`).

use canopen::nmt::State;
use canopen::object::{Abort, Address, Number, Value};

use super::communication::{HARDWARE_VERSION, NAME, SOFTWARE_VERSION};
use super::device_objects::{DeviceObjects, Memory, Source};
use tilt::composition::Place;

use crate::calibration::encoding::{self, decode_into};
use crate::calibration::motor::{Axis, Command, Outcome, StandReading};
use crate::calibration::{recall, report, stage};
use crate::instrument::Instrument;
use crate::program::Effect;
use crate::records::{Record, RecordStore, StoreError};

/// What 2072h wants: "clea".
pub const CLEAR: u32 = u32::from_le_bytes(*b"clea");

const fn text(index: u16) -> Option<&'static str> {
    match index {
        0x1008 => Some(NAME),
        0x1009 => Some(HARDWARE_VERSION),
        0x100A => Some(SOFTWARE_VERSION),
        _ => None,
    }
}

fn copy(from: &[u8], offset: u32, into: &mut [u8]) -> usize {
    let rest = from.get(offset as usize..).unwrap_or(&[]);
    let pairs = into.iter_mut().zip(rest);
    pairs.fold(0, |count, (to, byte)| {
        *to = *byte;
        count + 1
    })
}

impl<M: Memory, S: Source<I>, I: Instrument> DeviceObjects<'_, M, S, I> {
    pub(super) fn open_stream(&mut self, at: Address) -> Result<u32, Abort> {
        if let Some(text) = text(at.index) {
            return Ok(text.len() as u32);
        }
        match at.index {
            0x2061 => Ok(encoding::length(&self.parts.settings.chain.calibration)),
            0x2063 => {
                let identity = self.parts.values.calibration_sum;
                let belongs = report::belongs(&mut self.parts.memory, identity);
                if belongs {
                    Ok(report::HASH)
                } else {
                    Err(Abort::NoData)
                }
            }
            0x2070 if I::HISTORY => Ok(self.parts.log.open()),
            0x2071 if I::HISTORY => self
                .parts
                .black_box
                .open(at.sub, self.now)
                .ok_or(Abort::NoData),
            _ => Err(Abort::NoSuchObject),
        }
    }

    pub(super) fn read_stream(
        &mut self,
        at: Address,
        offset: u32,
        into: &mut [u8],
    ) -> Result<usize, Abort> {
        if let Some(text) = text(at.index) {
            return Ok(copy(text.as_bytes(), offset, into));
        }
        match at.index {
            0x2061 => Ok(encoding::read_at(
                &self.parts.settings.chain.calibration,
                offset,
                into,
            )),
            0x2063 => Ok(report::read_at(&mut self.parts.memory, offset, into)),
            0x2070 if I::HISTORY => Ok(self.parts.log.read_at(offset, into)),
            0x2071 if I::HISTORY => Ok(self.read_box(at.sub, offset, into)),
            _ => Err(Abort::NoSuchObject),
        }
    }

    fn read_box(&mut self, number: u8, offset: u32, into: &mut [u8]) -> usize {
        let memory = &mut self.parts.memory;
        let mut stored =
            |offset, into: &mut [u8]| memory.read(Record::of_box(number), offset, into);
        let black_box = &mut self.parts.black_box;
        black_box.read_at(number, offset, into, self.now, &mut stored)
    }

    pub(super) fn create_stream(&mut self, at: Address, size: Option<u32>) -> Result<(), Abort> {
        match at.index {
            0x1F50 if I::UPDATE => self
                .parts
                .values
                .program
                .create(size, &mut self.parts.memory),
            0x2061 | 0x2063 => {
                self.may_change_calibration()?;
                let is_hash = at.index == 0x2063;
                let longest = match is_hash {
                    true => report::HASH,
                    false => encoding::MAX_LENGTH,
                };
                let length = size.unwrap_or(longest);
                if length > longest {
                    return Err(Abort::LengthTooHigh);
                }
                let begun = match is_hash {
                    true => {
                        report::begin(&mut self.parts.memory, self.parts.values.calibration_sum)
                    }
                    false => {
                        RecordStore::begin(&mut self.parts.memory, Record::Calibration, length)
                    }
                };
                self.note(begun)?;
                self.parts.values.receiving = true;
                Ok(())
            }
            _ => Err(Abort::NoSuchObject),
        }
    }

    pub(super) fn append_stream(&mut self, at: Address, bytes: &[u8]) -> Result<(), Abort> {
        match at.index {
            0x1F50 if I::UPDATE => self
                .parts
                .values
                .program
                .append(bytes, &mut self.parts.memory),
            0x2061 | 0x2063 => {
                let appended = RecordStore::append(&mut self.parts.memory, bytes);
                self.note(appended)
            }
            _ => Err(Abort::NoSuchObject),
        }
    }

    pub(super) fn commit_stream(&mut self, at: Address) -> Result<(), Abort> {
        match at.index {
            0x1F50 if I::UPDATE => self.parts.values.program.commit(&mut self.parts.memory),
            0x2061 | 0x2063 => {
                self.parts.values.receiving = false;
                match at.index {
                    0x2061 => self.take_calibration(),
                    _ => self.take_hash(),
                }
            }
            _ => Err(Abort::NoSuchObject),
        }
    }

    pub(super) fn discard_stream(&mut self, at: Address) {
        match at.index {
            0x1F50 if I::UPDATE => self.parts.values.program.discard(),
            0x2061 | 0x2063 => {
                self.parts.values.receiving = false;
                RecordStore::discard(&mut self.parts.memory);
            }
            _ => {}
        }
    }

    /// A calibration changes only where nobody works by the angles, and not under a motor's run.
    fn may_change_calibration(&self) -> Result<(), Abort> {
        if self.parts.values.state == State::Operational || self.parts.work.is_running() {
            return Err(Abort::WrongState);
        }
        Ok(())
    }

    /// All bytes of 2061h are staged: put in force, then stored, or all is as it was.
    fn take_calibration(&mut self) -> Result<(), Abort> {
        self.may_change_calibration()?;
        let memory = &mut self.parts.memory;
        let calibration = &mut self.parts.settings.chain.calibration;
        let understood = decode_into(calibration, &mut |offset, into| memory.staged(offset, into));
        let understood = understood.map_err(|_| Abort::CannotStore);
        self.keep_calibration(understood, true)
    }

    /// All bytes of 2063h are staged: stored when they are one hash.
    fn take_hash(&mut self) -> Result<(), Abort> {
        if !report::is_whole(&mut self.parts.memory) {
            RecordStore::discard(&mut self.parts.memory);
            return Err(Abort::CannotStore);
        }
        let stored = RecordStore::commit(&mut self.parts.memory);
        self.note(stored)
    }

    /// The calibration in force was changed by something that ended with `made`: holds it against
    /// the slopes, stages it unless it is staged already, stores it, and takes the stored one back
    /// when any of it fails.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn keep_calibration(&mut self, made: Result<(), Abort>, is_staged: bool) -> Result<(), Abort> {
        let fits =
            made.and_then(|()| self.slopes_hold(&self.parts.settings.chain.calibration.correction));
        let kept = fits.and_then(|()| {
            let stored = self.store_calibration(is_staged);
            self.note(stored)
        });
        match kept {
            Ok(()) => {
                self.parts.values.calibrated = true;
                // What the channel has found so far belongs to the calibration before.
                self.parts.values.pending.sensor = true;
            }
            Err(_) => {
                RecordStore::discard(&mut self.parts.memory);
                let calibration = &mut self.parts.settings.chain.calibration;
                self.parts.values.calibrated =
                    recall(&mut self.parts.memory, calibration).calibrated;
            }
        }
        self.parts.values.calibration_sum =
            encoding::identity(&self.parts.settings.chain.calibration);
        kept
    }

    fn store_calibration(&mut self, is_staged: bool) -> Result<(), StoreError> {
        if !is_staged {
            let made = &self.parts.settings.chain.calibration;
            stage(&mut self.parts.memory, Record::Calibration, made)?;
        }
        RecordStore::commit(&mut self.parts.memory)
    }

    pub(super) fn read_calibration(&self, at: Address) -> Result<Number, Abort> {
        let correction = &self.parts.settings.chain.calibration.correction;
        if at.index == 0x2060 {
            return self.read_motor(at.sub);
        }
        Ok(match (at.index, at.sub) {
            // 0: two slopes, 1: one angle of 360 deg.
            (0x2030, _) => Number::u8(u8::from(encoding::kind(correction) == 2)),
            (0x2062, 1) => Number::u32(encoding::identity(&self.parts.settings.chain.calibration)),
            (0x2062, 2) => Number::u8(encoding::kind(correction)),
            _ => return Err(Abort::NoSuchSubIndex),
        })
    }

    fn read_motor(&self, sub: u8) -> Result<Number, Abort> {
        let motor = self.parts.work.motor.as_ref().ok_or(Abort::NoSuchObject)?;
        let progress = motor.get().progress();
        Ok(match sub {
            1 => Number::u8(self.parts.values.command),
            2 => Number::i32(self.parts.values.reference),
            3 => Number::u8(match progress.axis {
                None => 0,
                Some(Axis::X) => 1,
                Some(Axis::Y) => 2,
            }),
            4 => Number::u8(progress.points.x),
            5 => Number::u8(progress.points.y),
            6 => Number::i32(progress.residual.ok_or(Abort::NoData)?),
            7 => Number::u32(progress.worst),
            8 => Number::u8(self.parts.values.result),
            _ => return Err(Abort::NoSuchSubIndex),
        })
    }

    pub(super) fn write_calibration(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        if self.parts.values.state == State::Operational {
            return Err(Abort::WrongState);
        }
        match at.sub {
            1 => self.command_motor(value.unsigned() as u8),
            2 => self.memorise(value.signed_32()),
            _ => Err(Abort::ReadOnly),
        }
    }

    fn command_motor(&mut self, number: u8) -> Result<(), Abort> {
        let command = Command::from_number(number).ok_or(Abort::InvalidValue)?;
        let work = &mut self.parts.work;
        let motor = work.motor.as_mut().ok_or(Abort::NoSuchObject)?;
        let outcome = motor.get_mut().command(
            command,
            &work.table_settings,
            &mut self.parts.settings.chain.calibration,
        );
        self.parts.values.result = outcome.err().map_or(0, |error| error.code());
        let outcome = outcome.map_err(|_| Abort::WrongState)?;
        self.parts.values.command = number;
        if outcome == Outcome::Finished {
            self.keep_calibration(Ok(()), false)?;
        }
        Ok(())
    }

    fn memorise(&mut self, reference: i32) -> Result<(), Abort> {
        let sight = StandReading {
            filtered: self.parts.channel.filtered(),
            temperature: self.parts.channel.temperature(),
            reading: self.parts.channel.reading(&self.parts.settings, self.now),
        };
        let motor = self.parts.work.motor.as_mut().ok_or(Abort::NoSuchObject)?;
        let taken = motor
            .get_mut()
            .memorise(reference, &self.parts.settings.chain, &sight);
        self.parts.values.result = taken.err().map_or(0, |error| error.code());
        taken.map_err(|_| Abort::WrongState)?;
        self.parts.values.reference = reference;
        Ok(())
    }

    /// 2072h: forgets what happened, in the RAM and in the memory.
    pub(super) fn clear_history(&mut self, value: Value) -> Result<(), Abort> {
        if value.unsigned() != u64::from(CLEAR) {
            return Err(Abort::CannotStore);
        }
        if self.parts.values.state == State::Operational {
            return Err(Abort::WrongState);
        }
        self.parts.log.clear();
        self.parts.black_box.clear();
        let cleared = self.clear_kept();
        self.note(cleared)
    }

    fn clear_kept(&mut self) -> Result<(), StoreError> {
        if self.parts.memory.clear_events() == Err(StoreError::Full) {
            self.parts.memory.make_room()?;
            self.parts.memory.clear_events()?;
        }
        RecordStore::erase(&mut self.parts.memory, Record::Box1)?;
        RecordStore::erase(&mut self.parts.memory, Record::Box2)
    }

    pub(super) fn read_program(&mut self, at: Address) -> Result<Number, Abort> {
        Ok(match at.index {
            0x1F51 => Number::u8(self.parts.values.program.control()),
            0x1F56 => Number::u32(
                self.parts
                    .values
                    .program
                    .identification(&mut self.parts.memory),
            ),
            0x1F57 => Number::u32(self.parts.values.program.status()),
            0x2080 => return self.read_update(at.sub),
            _ => return Err(Abort::WriteOnly),
        })
    }

    fn read_update(&mut self, sub: u8) -> Result<Number, Abort> {
        let held = self.parts.memory.held();
        let running = self.parts.memory.running();
        Ok(match sub {
            1 => Number::u32(running.hardware),
            2 => Number::u32(running.version),
            3 => Number::u8(running.slot),
            4 => Number::u8(running.confirmation as u8),
            5 => Number::u32(held.map_or(0, |held| held.identity)),
            6 => Number::u32(held.map_or(0, |held| held.bytes)),
            _ => return Err(Abort::NoSuchSubIndex),
        })
    }

    /// 2080h sub 6.
    pub(super) fn resume_program(&mut self, value: Value) -> Result<(), Abort> {
        let bytes = value.unsigned() as u32;
        self.parts.values.program.resume(bytes, &self.parts.memory)
    }

    /// 1F51h. The program is not changed under a machine that works.
    pub(super) fn control_program(&mut self, value: Value) -> Result<(), Abort> {
        if self.parts.values.state != State::PreOperational {
            return Err(Abort::WrongState);
        }
        let command = value.unsigned() as u8;
        let effect = self
            .parts
            .values
            .program
            .set_control(command, &mut self.parts.memory)?;
        self.parts.values.pending.restart |= effect == Effect::Reset;
        Ok(())
    }
}
