//! The communication profile area, 1000h to 1FFFh: which service owns which object
//! (CiA 301, 7.5.2).
//!
//! In: an address and a value. Out: what the owning service answers. The objects that describe the
//! device or its memory (1008h to 100Ah, 1018h sub 4, 1F50h to 1F57h) are the application's and
//! are answered with `None` here.
//!
//! Left out: 1010h and 1011h, which act on the whole dictionary (`storage`).

use crate::emcy::Emergency;
use crate::error_control::ErrorControl;
use crate::nmt::{ErrorBehaviour, State};
use crate::object::{Abort, Address, Dictionary, Number, Objects, Place, Value};
use crate::pdo::{PDOS, Pdos, Tpdo, Tpdos};
use crate::srdo::Safety;
use crate::sync::{self, Sync};
use instant::Instant;

/// The services that have objects of their own, and their state. The small ones come first, also in
/// memory: short instructions reach them.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Communication<T = [Tpdo; PDOS]> {
    /// The NMT state.
    pub state: State,
    /// What an error does to the NMT state (1029h).
    pub behaviour: ErrorBehaviour,
    /// Date and time of the configuration that a tool has written (1020h).
    pub configuration: [u32; 2],
    /// NMT start-up (1F80h).
    pub startup: u32,
    /// SYNC.
    pub sync: Sync,
    /// EMCY and the error register.
    pub emergency: Emergency,
    /// Heartbeat, node guarding and the supervision of others.
    pub error_control: ErrorControl,
    /// PDOs.
    pub pdo: Pdos<T>,
    /// SRDOs.
    pub safety: Safety,
}

impl<T: Tpdos> Communication<T> {
    /// Services with nothing configured.
    // Out of line: within a node all of it would stand on the stack first.
    #[inline(never)]
    pub const fn new() -> Self {
        Self {
            state: State::Initialising,
            behaviour: ErrorBehaviour::new(),
            configuration: [0; 2],
            startup: 0,
            sync: Sync::new(),
            emergency: Emergency::new(),
            error_control: ErrorControl::new(),
            pdo: Pdos::new(),
            safety: Safety::new(),
        }
    }

    /// Back to nothing configured.
    ///
    /// One service after the other, from constants where all bytes are 0, and out of line: all of
    /// them at once would stand on the stack of whoever resets, 1.4 kB of it.
    #[inline(never)]
    pub fn clear(&mut self) {
        let Self {
            state,
            error_control,
            sync,
            emergency,
            pdo,
            safety,
            behaviour,
            configuration,
            startup,
        } = self;
        *pdo = Pdos::NONE;
        *safety = Safety::NONE;
        *error_control = ErrorControl::NONE;
        *sync = Sync::new();
        *emergency = Emergency::NONE;
        *behaviour = ErrorBehaviour::new();
        *configuration = [0; 2];
        *startup = 0;
        *state = State::Initialising;
    }

    /// The number behind a row that is simply one.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn place(&mut self, at: Address) -> Option<Place<'_>> {
        match at.index {
            0x1005..=0x1007 | 0x1019 => Some(self.sync.place(at)),
            0x100C | 0x100D | 0x1016 | 0x1017 => self.error_control.place(at),
            0x1020 => {
                let part = usize::from(at.sub).wrapping_sub(1);
                self.configuration.get_mut(part).map(Place::U32)
            }
            0x1029 => self.behaviour.place(at),
            0x1F80 => Some(Place::U32(&mut self.startup)),
            _ => None,
        }
    }

    /// The value of an object that a service owns.
    pub fn read<O: Objects>(&mut self, at: Address) -> Option<Result<Number, Abort>> {
        match at.index {
            0x1001 | 0x1003 | 0x1014 | 0x1015 => self.emergency.read(at),
            0x1300..=0x13FF if O::SERVICES.safety => self.safety.read(at),
            0x1400..=0x1BFF => self.pdo.read(at),
            _ => self.place(at).map(|place| Ok(place.get())),
        }
    }

    /// Writes an object that a service owns, under all the rules that hold for an SDO.
    // Out of line it is less code: what it calls has the registers for itself.
    #[inline(never)]
    pub fn write<O: Objects>(
        &mut self,
        dictionary: &Dictionary,
        at: Address,
        value: Value,
        now: Instant,
    ) -> Option<Result<(), Abort>> {
        let operational = self.state == State::Operational;
        match at.index {
            0x1001 | 0x1003 | 0x1014 | 0x1015 => self.emergency.write(at, value),
            0x1005
                if !O::SERVICES.sync_producer && value.unsigned() as u32 & sync::PRODUCE != 0 =>
            {
                Some(Err(Abort::InvalidValue))
            }
            0x1005..=0x1007 | 0x1019 => self.sync.write(at, value, now),
            0x100C | 0x100D | 0x1016 | 0x1017 => self.error_control.write(at, value, now),
            0x1029 => self.behaviour.write(at, value),
            0x1300..=0x13FF if O::SERVICES.safety => {
                self.safety.write(dictionary, at, value, operational)
            }
            0x1400..=0x1BFF => self.pdo.write::<O>(dictionary, at, value),
            // No NMT master here, so bits of its are not taken (CiA 302-2).
            0x1F80 if value.unsigned() & !0b1100 != 0 => Some(Err(Abort::InvalidValue)),
            _ => {
                self.place(at)?.set(value);
                Some(Ok(()))
            }
        }
    }

    /// Puts a default or stored value in place, in any order and without the rules for SDOs.
    pub fn load<O: Objects>(&mut self, at: Address, value: Value) -> bool {
        match at.index {
            0x1001 | 0x1003 | 0x1014 | 0x1015 => self.emergency.load(at, value),
            0x1300..=0x13FF if O::SERVICES.safety => self.safety.load(at, value),
            0x1400..=0x1BFF => self.pdo.load(at, value),
            _ => self.place(at).map(|mut place| place.set(value)).is_some(),
        }
    }
}

impl<T: Tpdos> Default for Communication<T> {
    fn default() -> Self {
        Self::new()
    }
}
