//! The dictionary as a whole: what the stack serves and what the device serves, seen as one.
//!
//! In: addresses from SDOs and PDOs. Out: whoever owns the object, with the rules that concern
//! them all: constants come from their rows, 1010h and 1011h act on groups, and any change of a
//! stored parameter invalidates 1020h.
//!
//! Left out: the owners.

use crate::communication::Communication;
use crate::nmt::State;
use crate::node::Application;
use crate::object::{Abort, Access, Address, Dictionary, Objects, Value, at};
use crate::pdo::Tpdos;
use crate::services::Services;
use crate::storage::{self, Group, LOAD, ON_COMMAND, SAVE, signed};
use instant::Instant;

/// All objects, the services' and the device's, as an SDO or PDO sees them.
pub(super) struct View<'a, A, T> {
    pub(super) communication: &'a mut Communication<T>,
    pub(super) application: &'a mut A,
    pub(super) node_id: u8,
    pub(super) now: Instant,
}

impl<A: Application, T: Tpdos> View<'_, A, T> {
    fn store(&mut self, group: Group) -> Result<(), Abort> {
        let dictionary = self.application.dictionary();
        self.application.begin_store(group)?;
        for entry in storage::rows(&dictionary, group) {
            for sub in entry.sub..=entry.last {
                let address = at(entry.index, sub);
                if A::SERVICES.serve(address).is_err() {
                    continue;
                }
                let value = self.read(address)?;
                self.application.put(address, value)?;
            }
        }
        self.application.commit_store()
    }

    /// 1010h and 1011h: a write acts on whole groups, a read tells how they are served.
    fn memory(&mut self, at: Address, value: &Value) -> Result<(), Abort> {
        let signature = if at.index == 0x1010 { SAVE } else { LOAD };
        signed(value, signature)?;
        // Erasing flash stops the code for milliseconds, so nothing is stored while the machine
        // works by these angles.
        if self.communication.state == State::Operational {
            return Err(Abort::WrongState);
        }
        for group in Group::of_sub(at.sub) {
            if at.index == 0x1010 {
                self.store(*group)?;
            } else {
                self.application.erase(*group)?;
            }
        }
        Ok(())
    }
}

impl<A: Application, T: Tpdos> Objects for View<'_, A, T> {
    const SERVICES: Services = A::SERVICES;

    fn dictionary(&self) -> Dictionary {
        self.application.dictionary()
    }

    fn read(&mut self, at: Address) -> Result<Value, Abort> {
        let dictionary = self.application.dictionary();
        let entry = dictionary.entry(at)?;
        if entry.access.has(Access::CONST)
            && let Some(value) = dictionary.default(&entry, self.node_id)
        {
            return Ok(value);
        }
        if A::SERVICES.storage && matches!(at.index, 0x1010 | 0x1011) {
            return Ok(Value::u32(ON_COMMAND));
        }
        match self.communication.read::<A>(at) {
            Some(result) => result.map(Value::from),
            None => self.application.read(at),
        }
    }

    fn write(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        if A::SERVICES.storage && matches!(at.index, 0x1010 | 0x1011) {
            return self.memory(at, &value);
        }
        let dictionary = self.application.dictionary();
        let stored = dictionary.form(at)?.access.has(Access::STORED);
        let taken = self
            .communication
            .write::<A>(&dictionary, at, value, self.now);
        match taken {
            Some(result) => result?,
            None => self.application.write(at, value)?,
        }
        // 1020h: the configuration is no longer the one that the tool had verified.
        if stored && at.index != 0x1020 {
            self.communication.configuration = [0; 2];
        }
        Ok(())
    }

    fn open(&mut self, at: Address) -> Result<u32, Abort> {
        self.application.open(at)
    }

    fn read_at(&mut self, at: Address, offset: u32, into: &mut [u8]) -> Result<usize, Abort> {
        self.application.read_at(at, offset, into)
    }

    fn create(&mut self, at: Address, size: Option<u32>) -> Result<(), Abort> {
        self.application.create(at, size)
    }

    fn append(&mut self, at: Address, bytes: &[u8]) -> Result<(), Abort> {
        self.application.append(at, bytes)
    }

    fn commit(&mut self, at: Address) -> Result<(), Abort> {
        self.application.commit(at)
    }

    fn discard(&mut self, at: Address) {
        self.application.discard(at);
    }
}

/// The objects that a PDO or SRDO can carry: the device's, and the error register.
pub(super) struct Mapped<'a, A> {
    pub(super) application: &'a mut A,
    pub(super) register: u8,
}

impl<A: Application> Objects for Mapped<'_, A> {
    const SERVICES: Services = A::SERVICES;

    fn dictionary(&self) -> Dictionary {
        self.application.dictionary()
    }

    fn read(&mut self, at: Address) -> Result<Value, Abort> {
        if at.index == 0x1001 {
            return Ok(Value::u8(self.register));
        }
        self.application.read(at)
    }

    fn write(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        self.application.write(at, value)
    }

    fn read_adjacent(&mut self, first: Address, length: usize) -> Option<Value> {
        self.application.read_adjacent(first, length)
    }

    fn write_adjacent(&mut self, first: Address, values: &Value) -> bool {
        self.application.write_adjacent(first, values)
    }
}
