//! What an SRDO is told about itself: communication and mapping parameters, 1301h and 1381h and
//! following, and the signature over them (EN 50325-5).
//!
//! In: reads and writes of the sub-indices. Out: values, abort codes, the signature, and whether
//! the parameters go together.
//!
//! Left out: when they may be written, and 13FEh (`srdo`).

use crate::crc;
use crate::mapping::{self, ENTRIES, Mapping};
use crate::object::{Abort, Access, Dictionary, Number, Value};

/// Information direction: the SRDO does not exist.
pub const OFF: u8 = 0;
/// Information direction: the device produces it.
pub const PRODUCE: u8 = 1;
/// Information direction: the device consumes it.
pub const CONSUME: u8 = 2;

/// The only transmission type there is.
const TRANSMISSION_TYPE: u8 = 254;
/// Highest sub-index of the communication parameters.
const HIGHEST: u8 = 6;
/// Plain and inverted entries together.
const PAIRED_ENTRIES: u8 = 2 * ENTRIES;

/// Which of an SRDO's two objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Communication parameters, 1301h and following.
    Communication,
    /// Mapping, 1381h and following.
    Mapping,
}

/// The configuration of one SRDO.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Information direction.
    pub direction: u8,
    /// Safeguard cycle time in ms: a producer's period, a consumer's deadline.
    pub sct_ms: u16,
    /// Safety-related validation time in ms: from the plain frame to the inverted one.
    pub srvt_ms: u8,
    kind: u8,
    /// Identifiers of the plain and the inverted frame.
    pub cob_ids: [u32; 2],
    /// What the plain frame carries: the odd sub-indices.
    pub plain: Mapping,
    /// What the inverted frame carries: the even sub-indices.
    pub inverted: Mapping,
    /// The signature as it was written to 13FFh.
    pub signature: u16,
}

/// Identifiers FFh + 2 id and 100h + 2 id, for ids 1 to 64.
const fn is_identifier(id: u32, plain: bool) -> bool {
    id >= 0x101 && id <= 0x180 && (id & 1 == 1) == plain
}

impl Setup {
    /// An SRDO that does not exist; all bytes are 0, so that no picture of it has to stand in the
    /// program.
    pub const fn new() -> Self {
        Self {
            direction: OFF,
            sct_ms: 0,
            srvt_ms: 0,
            kind: 0,
            cob_ids: [0; 2],
            plain: Mapping::new(),
            inverted: Mapping::new(),
            signature: 0,
        }
    }

    const fn count(&self) -> u8 {
        self.plain.count().saturating_add(self.inverted.count())
    }

    /// The mapping entry at sub-index `sub`, from 1; `None` above 16.
    fn entry(&self, sub: u8) -> Option<u32> {
        let n = sub.checked_sub(1)?;
        let half = if n & 1 == 0 {
            &self.plain
        } else {
            &self.inverted
        };
        half.entry(n >> 1)
    }

    /// A sub-index's value.
    ///
    /// Errors: [`Abort::NoSuchSubIndex`].
    pub fn read(&self, part: Part, sub: u8) -> Result<Number, Abort> {
        let [plain, inverted] = self.cob_ids;
        Ok(match (part, sub) {
            (Part::Mapping, 0) => Number::u8(self.count()),
            (Part::Mapping, sub) => Number::u32(self.entry(sub).ok_or(Abort::NoSuchSubIndex)?),
            (_, 0) => Number::u8(HIGHEST),
            (_, 1) => Number::u8(self.direction),
            (_, 2) => Number::u16(self.sct_ms),
            (_, 3) => Number::u8(self.srvt_ms),
            (_, 4) => Number::u8(self.kind),
            (_, 5) => Number::u32(plain),
            (_, 6) => Number::u32(inverted),
            _ => return Err(Abort::NoSuchSubIndex),
        })
    }

    /// Puts a value in place as it is; false when there is no such sub-index to write.
    pub fn load(&mut self, part: Part, sub: u8, value: Value) -> bool {
        let number = value.unsigned() as u32;
        let [plain, inverted] = &mut self.cob_ids;
        match (part, sub) {
            (Part::Mapping, 0) => {
                // An odd count leaves the halves unlike, which no check lets pass.
                let count = number as u8;
                self.plain.set_count(count - (count >> 1));
                self.inverted.set_count(count >> 1);
            }
            (Part::Mapping, sub) => {
                let n = sub.wrapping_sub(1);
                let half = if n & 1 == 0 {
                    &mut self.plain
                } else {
                    &mut self.inverted
                };
                return half.set_entry(n >> 1, number);
            }
            (_, 1) => self.direction = number as u8,
            (_, 2) => self.sct_ms = number as u16,
            (_, 3) => self.srvt_ms = number as u8,
            (_, 4) => self.kind = number as u8,
            (_, 5) => *plain = number,
            (_, 6) => *inverted = number,
            _ => return false,
        }
        true
    }

    /// Takes a value under the rules that hold for it alone.
    ///
    /// Errors: the abort code of the rule that it breaks; nothing has changed then.
    pub fn write(
        &mut self,
        dictionary: &Dictionary,
        part: Part,
        sub: u8,
        value: Value,
    ) -> Result<(), Abort> {
        let old = self.read(part, sub)?.bits();
        let number = value.unsigned() as u32;
        if part == Part::Communication && sub == 0 {
            return Err(Abort::ReadOnly);
        }
        // A tool may download a whole configuration again, in any order.
        if old == number {
            return Ok(());
        }
        match part {
            Part::Mapping => self.may_map(dictionary, sub, number)?,
            Part::Communication => Self::may_set(sub, number)?,
        }
        self.load(part, sub, value);
        Ok(())
    }

    fn may_map(&self, dictionary: &Dictionary, sub: u8, number: u32) -> Result<(), Abort> {
        if sub != 0 {
            return match (self.count(), number) {
                (0, 0) => Ok(()),
                (0, entry) => mapping::admits(dictionary, entry, Access::SRDO),
                _ => Err(Abort::UnsupportedAccess),
            };
        }
        if number > u32::from(PAIRED_ENTRIES) {
            return Err(Abort::PdoTooLong);
        }
        if number & 1 == 1 {
            return Err(Abort::InvalidValue);
        }
        let half = (number >> 1) as u8;
        self.together([half; 2], dictionary, Access::SRDO)
    }

    /// Whether both halves go together if as many entries of each counted.
    fn together(
        &self,
        [plain, inverted]: [u8; 2],
        dictionary: &Dictionary,
        access: Access,
    ) -> Result<(), Abort> {
        self.plain.check(dictionary, access, plain)?;
        self.inverted.check(dictionary, access, inverted)?;
        if plain != inverted || !self.plain.are_twins(&self.inverted, plain) {
            return Err(Abort::ParameterIncompatible);
        }
        Ok(())
    }

    fn may_set(sub: u8, number: u32) -> Result<(), Abort> {
        let good = match sub {
            1 => number <= u32::from(CONSUME),
            2 | 3 => number != 0,
            4 => number == u32::from(TRANSMISSION_TYPE),
            _ => is_identifier(number, sub == 5),
        };
        good.then_some(()).ok_or(Abort::InvalidValue)
    }

    /// Whether all parameters go together, so that 13FEh may be A5h. One that is off always does.
    ///
    /// Errors: what is wrong with the mapping, else [`Abort::ParameterIncompatible`].
    pub fn check(&self, dictionary: &Dictionary) -> Result<(), Abort> {
        let access = match self.direction {
            OFF => return Ok(()),
            PRODUCE => Access::SRDO.and(Access::READ),
            CONSUME => Access::SRDO.and(Access::WRITE),
            _ => return Err(Abort::ParameterIncompatible),
        };
        let counts = [self.plain.count(), self.inverted.count()];
        self.together(counts, dictionary, access)?;
        let [plain, inverted] = self.cob_ids;
        let sound = self.sct_ms != 0
            && self.srvt_ms != 0
            && self.kind == TRANSMISSION_TYPE
            && self.plain.count() != 0
            && is_identifier(plain, true)
            && inverted.checked_sub(1) == Some(plain)
            && self.signature == self.computed();
        sound.then_some(()).ok_or(Abort::ParameterIncompatible)
    }

    /// The signature over the parameters as they are: each in little-endian order, the mapping
    /// entries with their sub-indices before them. The transmission type is no part of it.
    pub fn computed(&self) -> u16 {
        let feed = |sum, part, sub| match self.read(part, sub) {
            Ok(number) => crc::update(sum, Value::from(number).bytes()),
            Err(_) => sum,
        };
        let mut sum = 0;
        for sub in [1, 2, 3, 5, 6] {
            sum = feed(sum, Part::Communication, sub);
        }
        for sub in 0..=self.count() {
            if sub != 0 {
                sum = crc::update(sum, &[sub]);
            }
            sum = feed(sum, Part::Mapping, sub);
        }
        sum
    }
}
