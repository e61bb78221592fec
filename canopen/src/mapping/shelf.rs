//! A device made of a shelf of numbers, for the tests of PDOs and SRDOs.

use crate::object::packed::Packed;
use crate::object::{
    Abort, Access, Address, DataType, DefaultKind, Dictionary, Entry, Objects, Table, Value, at,
};
use DataType::{Boolean, Domain, Integer16, Unsigned8, Unsigned32, Unsigned64};

const READ: Access = Access::READ;
const IN: Access = READ.and(Access::WRITE).and(Access::RPDO);
const OUT: Access = READ.and(Access::TPDO);
const BOTH: Access = IN.and(Access::TPDO);
const SAFE: Access = READ.and(Access::WRITE).and(Access::SRDO);
const SAFE_OUT: Access = READ.and(Access::SRDO);

const fn row(index: u16, data_type: DataType, access: Access) -> Entry {
    Entry {
        index,
        sub: 0,
        last: 0,
        data_type,
        access,
        limits: 255,
        default_kind: DefaultKind::Plain,
        default: 0,
    }
}

const fn run(index: u16, data_type: DataType, access: Access) -> Entry {
    Entry {
        sub: 1,
        last: 2,
        ..row(index, data_type, access)
    }
}

const ROWS: [Entry; 19] = [
    row(0x2021, Unsigned8, OUT),
    row(0x2030, Unsigned32, OUT),
    row(0x2040, Unsigned64, BOTH),
    row(0x2050, Unsigned8, IN),
    Entry {
        limits: 0,
        ..row(0x2051, Unsigned8, IN)
    },
    row(0x2060, Boolean, OUT),
    row(0x2061, Domain, BOTH),
    row(0x2070, Integer16, SAFE),
    row(0x2071, Integer16, SAFE),
    row(0x2072, Integer16, SAFE),
    Entry {
        limits: 0,
        ..row(0x2073, Integer16, SAFE)
    },
    row(0x6010, Integer16, OUT),
    row(0x6011, Unsigned8, READ.and(Access::WRITE)),
    row(0x6020, Integer16, OUT),
    // The vectors of the signature map these: bytes of 16-bit slopes, and the slopes.
    row(0x6210, Integer16, SAFE_OUT),
    run(0x6210, Unsigned8, SAFE_OUT),
    row(0x6211, Integer16, SAFE_OUT),
    row(0x6220, Integer16, SAFE_OUT),
    row(0x6221, Integer16, SAFE_OUT),
];

static PACKED: Packed<19, 19> = Packed::of(&ROWS);
static TABLE: Table = Table {
    rows: &PACKED.rows,
    kinds: &PACKED.kinds.0,
    forms: &PACKED.forms.0,
    defaults: &PACKED.defaults.0,
    limits: &[(0, 100)],
    variants: &[],
};

/// Numbers by address; everything that is not there reads 0.
#[derive(Clone, Debug)]
pub(crate) struct Shelf {
    numbers: heapless::Vec<(Address, u64), 24>,
    /// An object that answers [`Abort::NoData`] to a read.
    pub unreadable: Option<Address>,
    /// An object that answers [`Abort::LocalControl`] to a write.
    pub unwritable: Option<Address>,
}

impl Shelf {
    pub fn new() -> Self {
        Self {
            numbers: heapless::Vec::new(),
            unreadable: None,
            unwritable: None,
        }
    }

    pub fn put(&mut self, index: u16, sub: u8, number: u64) {
        let at = at(index, sub);
        match self.numbers.iter_mut().find(|(key, _)| *key == at) {
            Some((_, old)) => *old = number,
            None => self.numbers.push((at, number)).unwrap(),
        }
    }

    pub fn get(&self, index: u16, sub: u8) -> u64 {
        let found = self.numbers.iter().find(|(key, _)| *key == at(index, sub));
        found.map_or(0, |(_, number)| *number)
    }
}

impl Objects for Shelf {
    fn dictionary(&self) -> Dictionary {
        Dictionary {
            table: &TABLE,
            variant: 0,
        }
    }

    fn read(&mut self, at: Address) -> Result<Value, Abort> {
        if self.unreadable == Some(at) {
            return Err(Abort::NoData);
        }
        let size = self.dictionary().entry(at)?.data_type.size();
        Ok(Value::cut(self.get(at.index, at.sub), size.unwrap()))
    }

    fn write(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        if self.unwritable == Some(at) {
            return Err(Abort::LocalControl);
        }
        self.put(at.index, at.sub, value.unsigned());
        Ok(())
    }
}
