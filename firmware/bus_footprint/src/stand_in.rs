//! What a node needs besides the bus, as functions that the compiler does not see into.
//!
//! In and out: whatever the function behind the pointer does; none is ever called. A stand-in adds
//! a call to the code that is measured and nothing else.
//!
//! Left out: every behaviour.

use canopen::node::{Application, Event};
use canopen::object::{Abort, Address, Dictionary, Objects, Value};
use canopen::storage::Group;
use device::channel::Settings;
use device::fault_log::ENTRY;
use device::instrument::Product;
use device::objects::device_objects::Source;
use device::objects::table::{self, Channel};
use device::program::{Held, ProgramError, ProgramMemory, Running};
use device::records::{EventStore, Record, RecordStore, StoreError};
use flash::Progress;
use instant::Instant;
use tilt::chain::{Invalid, Reading};
use tilt::filter::Filtered;
use tilt::observation::Observation;
use tilt::sample::Temperature;

/// Records and programs.
pub struct Memory {
    read: fn(Record, u32, &mut [u8]) -> usize,
    staged: fn(u32, &mut [u8]) -> usize,
    record: fn(Option<Record>, &[u8]) -> Result<(), StoreError>,
    program: fn(Option<u32>, &[u8]) -> Result<(), ProgramError>,
    held: fn() -> Option<Held>,
    running: fn() -> Running,
}

impl RecordStore for Memory {
    fn start(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn needs_erase(&self, _length: u32) -> bool {
        false
    }

    fn read(&mut self, record: Record, offset: u32, into: &mut [u8]) -> usize {
        (self.read)(record, offset, into)
    }

    fn begin(&mut self, record: Record, _length: u32) -> Result<(), StoreError> {
        (self.record)(Some(record), &[])
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        (self.record)(None, bytes)
    }

    fn staged(&mut self, offset: u32, into: &mut [u8]) -> usize {
        (self.staged)(offset, into)
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        (self.record)(None, &[])
    }

    fn discard(&mut self) {
        let _ = (self.record)(None, &[]);
    }

    fn erase(&mut self, record: Record) -> Result<(), StoreError> {
        (self.record)(Some(record), &[])
    }
}

impl EventStore for Memory {
    fn recall_events(&mut self, _: &mut dyn FnMut(&[u8; ENTRY])) {}

    fn keep_event(&mut self, _: &[u8; ENTRY]) -> Result<(), StoreError> {
        (self.record)(None, &[])
    }

    fn clear_events(&mut self) -> Result<(), StoreError> {
        (self.record)(None, &[])
    }

    fn needs_room(&self) -> bool {
        false
    }

    fn make_room(&mut self) -> Result<(), StoreError> {
        Ok(())
    }
}

impl ProgramMemory for Memory {
    fn clear(&mut self) -> Result<(), ProgramError> {
        (self.program)(None, &[])
    }

    fn erase(&mut self) -> Result<Progress, ProgramError> {
        (self.program)(None, &[]).map(|()| Progress::Done)
    }

    fn begin(&mut self, size: Option<u32>) -> Result<(), ProgramError> {
        (self.program)(size, &[])
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), ProgramError> {
        (self.program)(None, bytes)
    }

    fn commit(&mut self) -> Result<(), ProgramError> {
        (self.program)(None, &[])
    }

    fn discard(&mut self) {
        let _ = (self.program)(None, &[]);
    }

    fn activate(&mut self) -> Result<Progress, ProgramError> {
        (self.program)(None, &[]).map(|()| Progress::Done)
    }

    fn held(&self) -> Option<Held> {
        (self.held)()
    }

    fn running(&mut self) -> Running {
        (self.running)()
    }

    fn confirm(&mut self) -> Result<(), ProgramError> {
        (self.program)(None, &[])
    }
}

/// A channel that measures.
pub struct Measuring {
    reading: fn(&Settings<Product>, Instant) -> Reading,
    observe: fn(&Settings<Product>, Instant) -> Observation,
    filtered: fn() -> Option<Filtered>,
    temperature: fn() -> Option<Temperature>,
    fault: fn() -> Option<Invalid>,
}

impl Source<Product> for Measuring {
    fn reading(&self, settings: &Settings<Product>, now: Instant) -> Reading {
        (self.reading)(settings, now)
    }

    fn observe(&mut self, settings: &Settings<Product>, now: Instant) -> Observation {
        (self.observe)(settings, now)
    }

    fn filtered(&self) -> Option<Filtered> {
        (self.filtered)()
    }

    fn temperature(&self) -> Option<Temperature> {
        (self.temperature)()
    }

    fn fault(&self) -> Option<Invalid> {
        (self.fault)()
    }
}

/// A device of which only the dictionary is there.
pub struct Hidden {
    channel: Channel,
    read: fn(Address) -> Result<Value, Abort>,
    write: fn(Address, Value) -> Result<(), Abort>,
    open: fn(Address) -> Result<u32, Abort>,
    read_at: fn(Address, u32, &mut [u8]) -> Result<usize, Abort>,
    create: fn(Address, Option<u32>) -> Result<(), Abort>,
    append: fn(Address, &[u8]) -> Result<(), Abort>,
    commit: fn(Address) -> Result<(), Abort>,
    discard: fn(Address),
    identity: fn() -> [u32; 4],
    told: super::Told,
    group: fn(Group) -> Result<(), Abort>,
    stored: fn(Group, Address) -> Option<Value>,
    store_lss: fn(u8, Option<u16>) -> bool,
}

impl Objects for Hidden {
    fn dictionary(&self) -> Dictionary {
        table::product(self.channel)
    }

    fn read(&mut self, at: Address) -> Result<Value, Abort> {
        (self.read)(at)
    }

    fn write(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        (self.write)(at, value)
    }

    fn open(&mut self, at: Address) -> Result<u32, Abort> {
        (self.open)(at)
    }

    fn read_at(&mut self, at: Address, offset: u32, into: &mut [u8]) -> Result<usize, Abort> {
        (self.read_at)(at, offset, into)
    }

    fn create(&mut self, at: Address, size: Option<u32>) -> Result<(), Abort> {
        (self.create)(at, size)
    }

    fn append(&mut self, at: Address, bytes: &[u8]) -> Result<(), Abort> {
        (self.append)(at, bytes)
    }

    fn commit(&mut self, at: Address) -> Result<(), Abort> {
        (self.commit)(at)
    }

    fn discard(&mut self, at: Address) {
        (self.discard)(at);
    }
}

impl Application for Hidden {
    fn identity(&self) -> [u32; 4] {
        (self.identity)()
    }

    fn event(&mut self, event: Event, now: instant::Instant) {
        (self.told)(event, now);
    }

    fn load(&mut self, at: Address, value: Value) {
        let _ = (self.write)(at, value);
    }

    fn begin_store(&mut self, group: Group) -> Result<(), Abort> {
        (self.group)(group)
    }

    fn put(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        (self.write)(at, value)
    }

    fn commit_store(&mut self) -> Result<(), Abort> {
        (self.commit)(Address { index: 0, sub: 0 })
    }

    fn erase(&mut self, group: Group) -> Result<(), Abort> {
        (self.group)(group)
    }

    fn stored(&mut self, group: Group, at: Address) -> Option<Value> {
        (self.stored)(group, at)
    }

    fn store_lss(&mut self, node_id: u8, kbit_s: Option<u16>) -> bool {
        (self.store_lss)(node_id, kbit_s)
    }
}
