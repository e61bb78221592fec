//! The server in conversation: frames in, frames out, over a small dictionary.
//!
//! In a transcript `c` is a frame of the client, `s` one of the server, `s -` its silence; bytes
//! that are left out at the end are 0. `C` is a client that doesn't wait for its answer.

extern crate std;

mod block_download;
mod block_upload;
mod expedited;
mod random;
mod segmented;

use std::collections::BTreeMap;
use std::vec::Vec;

use super::Server;
use crate::frame::Frame;
use crate::object::packed::Packed;
use crate::object::{
    Abort, Access, Address, DataType, DefaultKind, Dictionary, Entry, Objects, Table, Value, at,
};
use instant::Instant;

const READ: Access = Access::READ;
const WRITE: Access = Access::WRITE;
const BOTH: Access = Access::READ.and(Access::WRITE);

const TYPE: Address = at(0x1000, 0);
const BYTE: Address = at(0x2000, 0);
const FLAG: Address = at(0x2001, 0);
const WIDE: Address = at(0x2002, 0);
const SLOPE: Address = at(0x2003, 0);
const TEXT: Address = at(0x2004, 0);
const SECRET: Address = at(0x2005, 0);
const IMAGE: Address = at(0x2008, 1);

const fn row(at: Address, data_type: DataType, access: Access, limits: u8) -> Entry {
    Entry {
        index: at.index,
        sub: at.sub,
        last: at.sub,
        data_type,
        access,
        limits,
        default_kind: DefaultKind::Plain,
        default: 0,
    }
}

const ENTRIES: [Entry; 9] = [
    row(TYPE, DataType::Unsigned32, READ, 255),
    row(BYTE, DataType::Unsigned8, BOTH, 0),
    row(FLAG, DataType::Boolean, BOTH, 255),
    row(WIDE, DataType::Unsigned64, BOTH, 255),
    row(SLOPE, DataType::Integer16, BOTH, 1),
    row(TEXT, DataType::VisibleString, BOTH, 255),
    row(SECRET, DataType::Unsigned32, WRITE, 255),
    row(at(0x2007, 0), DataType::Unsigned8, Access::TPDO, 255),
    row(IMAGE, DataType::Domain, BOTH, 255),
];

static PACKED: Packed<9, 9> = Packed::of(&ENTRIES);
static TABLE: Table = Table {
    rows: &PACKED.rows,
    kinds: &PACKED.kinds.0,
    forms: &PACKED.forms.0,
    defaults: &PACKED.defaults.0,
    limits: &[(0, 100), (-100, 100)],
    variants: &[],
};

/// Objects that note what is done to them.
#[derive(Clone, Debug, Default, PartialEq)]
struct Mock {
    values: BTreeMap<Address, Value>,
    streams: BTreeMap<Address, Vec<u8>>,
    /// An open download: address, what has come.
    sink: Option<(Address, Vec<u8>)>,
    /// Sizes announced to `create`.
    announced: Vec<Option<u32>>,
    discards: usize,
    /// What `write`, `append` or `commit` answers when it has reasons of its own to refuse.
    refusal: Option<Abort>,
}

impl Mock {
    fn allowed(&self) -> Result<(), Abort> {
        self.refusal.map_or(Ok(()), Err)
    }

    fn stream(&self, at: Address) -> &[u8] {
        self.streams.get(&at).map_or(&[], |s| s)
    }
}

impl Objects for Mock {
    fn dictionary(&self) -> Dictionary {
        Dictionary {
            table: &TABLE,
            variant: 0,
        }
    }

    fn read(&mut self, at: Address) -> Result<Value, Abort> {
        self.values.get(&at).copied().ok_or(Abort::NoData)
    }

    fn write(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        self.allowed()?;
        self.values.insert(at, value);
        Ok(())
    }

    fn open(&mut self, at: Address) -> Result<u32, Abort> {
        Ok(self.stream(at).len() as u32)
    }

    fn read_at(&mut self, at: Address, offset: u32, into: &mut [u8]) -> Result<usize, Abort> {
        let from = self.stream(at).iter().skip(offset as usize);
        Ok(into
            .iter_mut()
            .zip(from)
            .map(|(to, from)| *to = *from)
            .count())
    }

    fn create(&mut self, at: Address, size: Option<u32>) -> Result<(), Abort> {
        assert_eq!(self.sink, None, "a download was left open");
        self.announced.push(size);
        self.sink = Some((at, Vec::new()));
        Ok(())
    }

    fn append(&mut self, at: Address, bytes: &[u8]) -> Result<(), Abort> {
        self.allowed()?;
        let sink = self.sink.as_mut().filter(|s| s.0 == at).expect("is open");
        sink.1.extend_from_slice(bytes);
        let announced = self.announced.last().copied().flatten();
        let room = announced.map_or(usize::MAX, |size| size as usize);
        assert!(sink.1.len() <= room, "more than announced was let through");
        Ok(())
    }

    fn commit(&mut self, at: Address) -> Result<(), Abort> {
        self.allowed()?;
        let (open, bytes) = self.sink.take().expect("is open");
        assert_eq!(open, at);
        self.streams.insert(at, bytes);
        Ok(())
    }

    fn discard(&mut self, at: Address) {
        let (open, _) = self.sink.take().expect("is open");
        assert_eq!(open, at);
        self.discards += 1;
    }
}

/// A server with its objects and a clock.
#[derive(Clone, Debug, Default)]
struct Bench {
    server: Server,
    objects: Mock,
    now: Instant,
}

impl Bench {
    fn new() -> Self {
        let mut bench = Self::default();
        let values = &mut bench.objects.values;
        values.insert(TYPE, Value::u32(0x0004_019A));
        values.insert(BYTE, Value::u8(42));
        values.insert(FLAG, Value::u8(1));
        values.insert(WIDE, Value::cut(0x0807_0605_0403_0201, 8));
        values.insert(SLOPE, Value::i16(-5));
        bench
    }

    fn with(at: Address, bytes: &[u8]) -> Self {
        let mut bench = Self::new();
        bench.objects.streams.insert(at, bytes.to_vec());
        bench
    }

    fn send(&mut self, data: &[u8]) {
        let frame = Frame::data_frame(0x605, data);
        self.server.request(&mut self.objects, &frame, self.now);
    }

    fn receive(&mut self) -> Option<[u8; 8]> {
        self.server.transmit(&mut self.objects, self.now)
    }

    fn wait_ms(&mut self, millis: u32) -> Option<Instant> {
        self.now = self.now.after_ms(millis);
        self.server.poll(&mut self.objects, self.now).get()
    }

    /// Plays a conversation and compares the server's side of it.
    fn talk(&mut self, transcript: &str) {
        let lines = transcript.lines().map(str::trim).filter(|l| !l.is_empty());
        for line in lines {
            let (who, bytes) = line.split_at(1);
            match who {
                "c" => {
                    assert!(!self.server.is_pending(), "unexpected answer before {line}");
                    self.send(&frame(bytes));
                }
                "C" => self.send(&frame(bytes)),
                _ if bytes.trim() == "-" => assert_eq!(self.receive(), None, "{line}"),
                _ => assert_eq!(self.receive(), Some(frame(bytes)), "{line}"),
            }
        }
        assert!(!self.server.is_pending(), "unexpected answer at the end");
    }

    /// The same, and nothing may have changed in the objects, nor stay open.
    fn talk_in_vain(&mut self, transcript: &str) {
        let before = self.objects.clone();
        self.talk(transcript);
        assert_eq!(self.objects.values, before.values);
        assert_eq!(self.objects.streams, before.streams);
        assert_eq!(self.objects.sink, None);
    }

    /// Still there for the next client: the device type can be read.
    fn assert_usable(&mut self) {
        self.talk("c 40 00 10 00\n s 43 00 10 00 9A 01 04 00");
    }
}

/// Eight bytes from hexadecimal text.
fn frame(text: &str) -> [u8; 8] {
    let mut data = [0; 8];
    for (to, byte) in data.iter_mut().zip(text.split_whitespace()) {
        *to = u8::from_str_radix(byte, 16).expect("a transcript holds bytes");
    }
    data
}

/// Bytes that differ from their neighbours.
fn pattern(length: usize) -> Vec<u8> {
    (0..length).map(|n| (n * 31 + n / 7) as u8).collect()
}

#[test]
fn the_server_is_small() {
    assert!(size_of::<Server>() <= 200, "{} bytes", size_of::<Server>());
}
