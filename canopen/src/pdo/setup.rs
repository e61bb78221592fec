//! What a PDO is told about itself: communication and mapping parameters (CiA 301, 7.5.2.35 to
//! 7.5.2.38).
//!
//! In: reads and writes of the sub-indices. Out: values and abort codes. No write, in whatever
//! order, leaves a PDO that exists with a mapping that does not hold.
//!
//! Left out: transmission types 252 and 253 (on remote request only), and 29-bit identifiers.

use crate::frame::is_restricted;
use crate::mapping::{self, Mapping};
use crate::object::{Abort, Access, Dictionary, Number, Objects, Value};

/// Bit 31 of a COB-ID: the PDO does not exist.
pub const INVALID: u32 = 1 << 31;
/// Bit 30 of a TPDO's COB-ID: it does not answer remote frames.
const NO_REMOTE: u32 = 1 << 30;
/// Bits 0 to 29: identifier and frame format.
const IDENTIFIER: u32 = 0x3FFF_FFFF;
/// The highest synchronous transmission type: every 240th SYNC.
pub const LAST_SYNCHRONOUS: u8 = 240;

/// Highest sub-index of the communication parameters: a TPDO has a SYNC start value.
const HIGHEST_TRANSMIT: u8 = 6;
const HIGHEST_RECEIVE: u8 = 5;

/// Which of a PDO's two objects; with it [`Access::TPDO`] or [`Access::RPDO`], the direction and
/// what mapped objects must allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Communication parameters, 1400h or 1800h and following.
    Communication(Access),
    /// Mapping, 1600h or 1A00h and following.
    Mapping(Access),
}

/// The configuration of one PDO.
#[derive(Clone, Debug)]
pub struct Setup {
    /// COB-ID with bit 31 turned over. All bytes of a PDO that does not exist are 0 so, and no
    /// picture of it has to stand in the program.
    turned: u32,
    /// Transmission type.
    pub kind: u8,
    /// Least time between two frames, in 100 µs; RPDOs keep it without using it.
    pub inhibit: u16,
    /// TPDO: longest time between two frames. RPDO: deadline of the next one. In ms; 0 is off.
    pub event_ms: u16,
    /// Counter of the SYNC that counts as the first; 0 is any.
    pub sync_start: u8,
    /// What it carries.
    pub mapping: Mapping,
}

fn identifier(cob_id: u32) -> Result<(), Abort> {
    if cob_id & IDENTIFIER > 0x7FF || cob_id & INVALID == 0 && is_restricted(cob_id & 0x7FF) {
        return Err(Abort::InvalidValue);
    }
    Ok(())
}

const fn transmission_type(kind: u8) -> Result<(), Abort> {
    match kind {
        0..=LAST_SYNCHRONOUS | 254 | 255 => Ok(()),
        _ => Err(Abort::InvalidValue),
    }
}

impl Setup {
    /// A PDO that does not exist.
    pub const fn new() -> Self {
        Self {
            turned: 0,
            kind: 0,
            inhibit: 0,
            event_ms: 0,
            sync_start: 0,
            mapping: Mapping::new(),
        }
    }

    const fn cob_id(&self) -> u32 {
        self.turned ^ INVALID
    }

    const fn exists(&self) -> bool {
        self.turned & INVALID != 0
    }

    /// True when it exists and maps something.
    pub const fn is_active(&self) -> bool {
        self.exists() && self.mapping.count() > 0
    }

    /// The 11-bit identifier.
    pub const fn id(&self) -> u16 {
        self.turned as u16 & 0x7FF
    }

    /// True when a remote frame may ask for it.
    pub const fn answers_remote(&self) -> bool {
        self.turned & NO_REMOTE == 0
    }

    /// True for transmission types 0 to 240.
    pub const fn is_synchronous(&self) -> bool {
        self.kind <= LAST_SYNCHRONOUS
    }

    /// A sub-index's value.
    ///
    /// Errors: [`Abort::NoSuchSubIndex`].
    pub fn read(&self, part: Part, sub: u8) -> Result<Number, Abort> {
        let Part::Communication(access) = part else {
            return match sub.checked_sub(1) {
                None => Some(Number::u8(self.mapping.count())),
                Some(n) => self.mapping.entry(n).map(Number::u32),
            }
            .ok_or(Abort::NoSuchSubIndex);
        };
        let transmits = access == Access::TPDO;
        Ok(match sub {
            0 if transmits => Number::u8(HIGHEST_TRANSMIT),
            0 => Number::u8(HIGHEST_RECEIVE),
            1 => Number::u32(self.cob_id()),
            2 => Number::u8(self.kind),
            3 => Number::u16(self.inhibit),
            5 => Number::u16(self.event_ms),
            6 if transmits => Number::u8(self.sync_start),
            _ => return Err(Abort::NoSuchSubIndex),
        })
    }

    /// Puts a value in place as it is; false when there is no such sub-index to write.
    pub fn load(&mut self, part: Part, sub: u8, value: Value) -> bool {
        let number = value.unsigned() as u32;
        match (part, sub) {
            (Part::Mapping(_), 0) => self.mapping.set_count(number as u8),
            (Part::Mapping(_), sub) => return self.mapping.set_entry(sub.wrapping_sub(1), number),
            (_, 1) => self.turned = number ^ INVALID,
            (_, 2) => self.kind = number as u8,
            (_, 3) => self.inhibit = number as u16,
            (_, 5) => self.event_ms = number as u16,
            (Part::Communication(Access::TPDO), 6) => self.sync_start = number as u8,
            _ => return false,
        }
        true
    }

    /// Takes a value under all the rules.
    ///
    /// Errors: the abort code of the rule that it breaks; nothing has changed then.
    pub fn write<O: Objects>(
        &mut self,
        dictionary: &Dictionary,
        part: Part,
        sub: u8,
        value: Value,
    ) -> Result<(), Abort> {
        if sub == 0 && matches!(part, Part::Communication(_)) {
            return Err(Abort::ReadOnly);
        }
        let number = value.unsigned() as u32;
        // A tool may write a whole configuration back, in any order.
        if self.read(part, sub)?.bits() == number {
            return Ok(());
        }
        match part {
            Part::Mapping(_) if !O::SERVICES.dynamic_mapping => return Err(Abort::ReadOnly),
            Part::Communication(Access::TPDO)
                if !O::SERVICES.pdo_remote && sub == 1 && number & NO_REMOTE == 0 =>
            {
                return Err(Abort::InvalidValue);
            }
            Part::Mapping(access) => self.may_map(dictionary, access, sub, number)?,
            Part::Communication(_) => self.may_set(sub, number)?,
        }
        self.load(part, sub, value);
        if part == Part::Mapping(Access::RPDO) {
            self.mapping.look_ahead(dictionary);
        }
        Ok(())
    }

    /// CiA 301, 7.5.2.36 and 7.5.2.38: a mapping changes while the PDO does not exist, and its
    /// entries while none of them counts.
    fn may_map(
        &self,
        dictionary: &Dictionary,
        access: Access,
        sub: u8,
        number: u32,
    ) -> Result<(), Abort> {
        if self.exists() {
            return Err(Abort::UnsupportedAccess);
        }
        if sub == 0 {
            return self.mapping.check(dictionary, access, number as u8);
        }
        if self.mapping.count() != 0 {
            return Err(Abort::UnsupportedAccess);
        }
        if number == 0 {
            return Ok(()); // Takes an entry out, which is as good as never written.
        }
        mapping::admits(dictionary, number, access)
    }

    /// CiA 301, 7.5.2.35 and 7.5.2.37, for a number that is another one than before.
    fn may_set(&self, sub: u8, number: u32) -> Result<(), Abort> {
        let exists = self.exists();
        match sub {
            1 => {
                identifier(number)?;
                let changed = (number ^ self.cob_id()) & IDENTIFIER;
                if exists && number & INVALID == 0 && changed != 0 {
                    return Err(Abort::InvalidValue);
                }
                Ok(())
            }
            2 => transmission_type(number as u8),
            // Inhibit time and SYNC start value stay while the PDO exists.
            3 | 6 if exists => Err(Abort::UnsupportedAccess),
            6 if number > u32::from(LAST_SYNCHRONOUS) => Err(Abort::InvalidValue),
            _ => Ok(()),
        }
    }

    fn holds(&self, dictionary: &Dictionary, access: Access) -> Result<(), Abort> {
        self.mapping
            .check(dictionary, access, self.mapping.count())?;
        transmission_type(self.kind)?;
        identifier(self.cob_id())
    }

    /// Switches the PDO off, with nothing mapped, when what was loaded does not hold.
    ///
    /// Errors: what is wrong with it.
    pub fn check(&mut self, dictionary: &Dictionary, access: Access) -> Result<(), Abort> {
        let result = self.holds(dictionary, access);
        if result.is_err() {
            self.turned = 0;
            self.mapping.set_count(0);
        }
        self.mapping.look_ahead(dictionary);
        result
    }
}
