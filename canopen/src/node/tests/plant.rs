//! A device for the node's tests: a dictionary of every kind of row, a memory, and a log of events.

extern crate std;

use std::boxed::Box;
use std::collections::BTreeMap;
use std::vec::Vec;

use crate::node::{Application, Event};
use crate::object::packed::Packed;
use crate::object::{
    Abort, Access, Address, DataType, DefaultKind, Dictionary, Entry, Objects, Table, Value,
};
use crate::storage::Group;
use DataType::{Boolean, Domain, Integer16, Unsigned8, Unsigned16, Unsigned32, Unsigned64};
use instant::Instant;

const R: Access = Access::READ;
const RW: Access = R.and(Access::WRITE);
const KEPT: Access = RW.and(Access::STORED);
const FIXED: Access = R.and(Access::CONST);
/// A bit of the default that asks for the node-id to be added.
const NODE_ID: u64 = 1 << 32;
const OFF: u64 = 1 << 31;

/// What 1008h reads: longer than a segment, and no multiple of seven.
pub const NAME: &[u8] = b"A plant with thirty characters";
/// Bytes that the DOMAIN 2001h takes at most.
pub const ROOM: usize = 300;

/// Index, first and last sub-index, type, access, default.
type Line = (u16, u8, u8, DataType, Access, u64);

fn lines() -> Vec<Line> {
    let mut lines = Vec::from([
        (0x1000, 0, 0, Unsigned32, FIXED, 0x019A),
        (0x1001, 0, 0, Unsigned8, R.and(Access::TPDO), 0),
        (0x1003, 0, 0, Unsigned8, RW, 0),
        (0x1003, 1, 8, Unsigned32, R, 0),
        (0x1005, 0, 0, Unsigned32, KEPT, 0x80),
        (0x1006, 0, 0, Unsigned32, KEPT, 0),
        (0x1007, 0, 0, Unsigned32, KEPT, 0),
        (0x1008, 0, 0, DataType::VisibleString, FIXED, 0),
        (0x100C, 0, 0, Unsigned16, KEPT, 0),
        (0x100D, 0, 0, Unsigned8, KEPT, 0),
        (0x1010, 0, 0, Unsigned8, FIXED, 4),
        (0x1010, 1, 4, Unsigned32, RW, 1),
        (0x1011, 0, 0, Unsigned8, FIXED, 4),
        (0x1011, 1, 4, Unsigned32, RW, 1),
        (0x1014, 0, 0, Unsigned32, KEPT, NODE_ID | 0x80),
        (0x1015, 0, 0, Unsigned16, KEPT, 0),
        (0x1016, 0, 0, Unsigned8, FIXED, 4),
        (0x1016, 1, 4, Unsigned32, KEPT, 0),
        (0x1017, 0, 0, Unsigned16, KEPT, 0),
        (0x1019, 0, 0, Unsigned8, KEPT, 0),
        (0x1020, 0, 0, Unsigned8, FIXED, 2),
        (0x1020, 1, 2, Unsigned32, KEPT, 0),
        (0x1029, 0, 0, Unsigned8, FIXED, 2),
        (0x1029, 1, 1, Unsigned8, KEPT, 0),
        (0x1029, 2, 2, Unsigned8, KEPT, 1),
        (0x1300, 0, 0, Unsigned8, KEPT, 0),
        (0x13FE, 0, 0, Unsigned8, KEPT, 0),
        (0x13FF, 0, 0, Unsigned8, FIXED, 2),
        (0x13FF, 1, 2, Unsigned16, KEPT, 0),
        (0x1F80, 0, 0, Unsigned32, KEPT, 0),
        (
            0x2000,
            0,
            0,
            Unsigned8,
            KEPT.and(Access::RPDO).and(Access::TPDO),
            7,
        ),
        (0x2001, 0, 0, Domain, RW, 0),
        (0x2002, 0, 0, Boolean, RW, 1),
        (0x2003, 0, 0, Unsigned64, RW, 0),
        (0x2012, 1, 2, Integer16, RW.and(Access::SRDO), 0),
        (0x6000, 0, 0, Unsigned16, KEPT, 10),
        (0x6010, 0, 0, Integer16, RW.and(Access::TPDO), 0),
        (0x6210, 0, 0, Integer16, KEPT.and(Access::SRDO), 0x0F),
        (0x6211, 0, 0, Integer16, KEPT.and(Access::SRDO), 0xFFF0),
    ]);
    (0..4).for_each(|n| pdos(&mut lines, n));
    srdo(&mut lines, 0, [1, 0x101, 0x102], [0x6210_0010, 0x6211_0010]);
    srdo(&mut lines, 1, [2, 0x103, 0x104], [0x2012_0110, 0x2012_0210]);
    lines
}

/// RPDO and TPDO number `n`, from 0. The first pair is on, the others are off.
fn pdos(lines: &mut Vec<Line>, n: u16) {
    let off = if n == 0 { 0 } else { OFF };
    let (rx, tx) = (0x200 + 0x100 * u64::from(n), 0x180 + 0x100 * u64::from(n));
    let used = u64::from(n == 0);
    for (index, cob_id, kind) in [(0x1400, rx, 255), (0x1800, tx, 1)] {
        let index = index + n;
        let last = if index < 0x1800 { 5 } else { 6 };
        lines.push((index, 0, 0, Unsigned8, FIXED, last));
        lines.push((index, 1, 1, Unsigned32, KEPT, NODE_ID | off | cob_id));
        lines.push((index, 2, 2, Unsigned8, KEPT, kind));
        lines.push((index, 5, 5, Unsigned16, KEPT, 0));
    }
    lines.push((0x1800 + n, 3, 3, Unsigned16, KEPT, 0));
    lines.push((0x1800 + n, 6, 6, Unsigned8, KEPT, 0));
    for (index, entry) in [(0x1600, 0x2000_0008), (0x1A00, 0x6010_0010)] {
        lines.push((index + n, 0, 0, Unsigned8, KEPT, used));
        lines.push((index + n, 1, 1, Unsigned32, KEPT, entry * used));
        lines.push((index + n, 2, 8, Unsigned32, KEPT, 0));
    }
}

fn srdo(lines: &mut Vec<Line>, n: u16, [direction, plain, inverted]: [u64; 3], map: [u64; 2]) {
    let (parameter, mapping) = (0x1301 + n, 0x1381 + n);
    let access = KEPT.and(Access::SAFETY);
    lines.push((parameter, 0, 0, Unsigned8, FIXED, 6));
    lines.push((parameter, 1, 1, Unsigned8, access, direction));
    lines.push((parameter, 2, 2, Unsigned16, access, 25));
    lines.push((parameter, 3, 3, Unsigned8, access, 20));
    lines.push((parameter, 4, 4, Unsigned8, access, 254));
    lines.push((parameter, 5, 5, Unsigned32, access, plain));
    lines.push((parameter, 6, 6, Unsigned32, access, inverted));
    let [a, b] = map;
    lines.push((mapping, 0, 0, Unsigned8, access, 2));
    lines.push((mapping, 1, 1, Unsigned32, access, a));
    lines.push((mapping, 2, 2, Unsigned32, access, b));
    lines.push((mapping, 3, 16, Unsigned32, access, 0));
}

fn table() -> &'static Table {
    let mut lines = lines();
    lines.sort_by_key(|(index, sub, ..)| (*index, *sub));
    let entry = |(index, sub, last, data_type, access, default): Line| Entry {
        index,
        sub,
        last,
        data_type,
        access,
        limits: 255,
        default_kind: if default & NODE_ID != 0 {
            DefaultKind::PlusNodeId
        } else {
            DefaultKind::Plain
        },
        default: default as u32,
    };
    let entries: Vec<_> = lines.into_iter().map(entry).collect();
    let packed: &Packed<200, 200> = Box::leak(Box::new(Packed::of(&entries)));
    Box::leak(Box::new(Table {
        rows: &packed.rows[..entries.len()],
        kinds: &packed.kinds.0,
        forms: &packed.forms.0,
        defaults: &packed.defaults.0,
        limits: &[],
        variants: &[],
    }))
}

/// The device.
pub struct Plant {
    table: &'static Table,
    values: BTreeMap<Key, Value>,
    stored: BTreeMap<Key, Value>,
    staged: BTreeMap<Key, Value>,
    /// Committed content of 2001h.
    pub domain: Vec<u8>,
    incoming: Vec<u8>,
    /// What has happened since the test last looked.
    pub events: Vec<Event>,
    /// Node-id and bit rate as LSS has stored them.
    pub lss: Option<(u8, Option<u16>)>,
    /// The memory does not take anything.
    pub broken: bool,
}

type Key = (u16, u8);

const fn key(at: Address) -> Key {
    (at.index, at.sub)
}

impl Plant {
    pub fn new() -> Self {
        Self {
            table: table(),
            values: BTreeMap::new(),
            stored: BTreeMap::new(),
            staged: BTreeMap::new(),
            domain: Vec::from(*b"domain"),
            incoming: Vec::new(),
            events: Vec::new(),
            lss: None,
            broken: false,
        }
    }

    fn whole(&self) -> Result<(), Abort> {
        if self.broken {
            Err(Abort::Hardware)
        } else {
            Ok(())
        }
    }
}

impl Objects for Plant {
    fn dictionary(&self) -> Dictionary {
        Dictionary {
            table: self.table,
            variant: 0,
        }
    }

    fn read(&mut self, at: Address) -> Result<Value, Abort> {
        if let Some(value) = self.values.get(&key(at)) {
            return Ok(*value);
        }
        let dictionary = self.dictionary();
        let entry = dictionary.entry(at)?;
        dictionary.default(&entry, 0).ok_or(Abort::NoSuchObject)
    }

    fn write(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        self.values.insert(key(at), value);
        Ok(())
    }

    fn open(&mut self, at: Address) -> Result<u32, Abort> {
        let content = if at.index == 0x1008 {
            NAME
        } else {
            &self.domain
        };
        Ok(content.len() as u32)
    }

    fn read_at(&mut self, at: Address, offset: u32, into: &mut [u8]) -> Result<usize, Abort> {
        let content = if at.index == 0x1008 {
            NAME
        } else {
            &self.domain
        };
        let rest = content.get(offset as usize..).unwrap_or(&[]);
        let pairs = into.iter_mut().zip(rest);
        Ok(pairs.map(|(to, from)| *to = *from).count())
    }

    fn create(&mut self, _at: Address, _size: Option<u32>) -> Result<(), Abort> {
        self.incoming.clear();
        Ok(())
    }

    fn append(&mut self, _at: Address, bytes: &[u8]) -> Result<(), Abort> {
        if self.incoming.len() + bytes.len() > ROOM {
            return Err(Abort::OutOfMemory);
        }
        self.incoming.extend_from_slice(bytes);
        Ok(())
    }

    fn commit(&mut self, _at: Address) -> Result<(), Abort> {
        self.domain = core::mem::take(&mut self.incoming);
        Ok(())
    }

    fn discard(&mut self, _at: Address) {
        self.incoming.clear();
    }
}

impl Application for Plant {
    fn identity(&self) -> [u32; 4] {
        [1, 2, 3, 4]
    }

    fn event(&mut self, event: Event, _now: Instant) {
        self.events.push(event);
    }

    fn load(&mut self, at: Address, value: Value) {
        self.values.insert(key(at), value);
    }

    fn begin_store(&mut self, group: Group) -> Result<(), Abort> {
        self.staged = self.stored.clone();
        self.staged.retain(|(index, _), _| !group.holds(*index));
        self.whole()
    }

    fn put(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        self.staged.insert(key(at), value);
        Ok(())
    }

    fn commit_store(&mut self) -> Result<(), Abort> {
        self.stored = core::mem::take(&mut self.staged);
        Ok(())
    }

    fn erase(&mut self, group: Group) -> Result<(), Abort> {
        self.stored.retain(|(index, _), _| !group.holds(*index));
        self.whole()
    }

    fn stored(&mut self, _group: Group, at: Address) -> Option<Value> {
        self.stored.get(&key(at)).copied()
    }

    fn store_lss(&mut self, node_id: u8, kbit_s: Option<u16>) -> bool {
        self.lss = Some((node_id, kbit_s));
        !self.broken
    }
}
