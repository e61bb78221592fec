//! Nodes that leave services out: they answer as devices that never had them.

use super::*;
use crate::object::Dictionary;
use crate::services::Services;

/// The plant without the services whose bits are set below.
struct Lean<const OUT: u16>(Plant);

const SAFETY: u16 = 1;
const GUARDING: u16 = 1 << 1;
const HEARTBEAT_CONSUMER: u16 = 1 << 2;
const SYNC_PRODUCER: u16 = 1 << 3;
const BLOCK_UPLOAD: u16 = 1 << 4;
const BLOCK_DOWNLOAD: u16 = 1 << 5;
const LSS: u16 = 1 << 6;
const FASTSCAN: u16 = 1 << 7;
const PDO_TIMERS: u16 = 1 << 8;
const PDO_REMOTE: u16 = 1 << 9;
const DYNAMIC_MAPPING: u16 = 1 << 10;
const STORAGE: u16 = 1 << 11;
const EVERYTHING: u16 = u16::MAX;

const NO_OBJECT: u32 = 0x0602_0000;
const NO_SUB: u32 = 0x0609_0011;
const NO_COMMAND: u32 = 0x0504_0001;
const INVALID: u32 = 0x0609_0030;
const READ_ONLY: u32 = 0x0601_0002;

impl<const OUT: u16> Objects for Lean<OUT> {
    const SERVICES: Services = if OUT == EVERYTHING {
        Services::LEAST
    } else {
        Services {
            safety: OUT & SAFETY == 0,
            guarding: OUT & GUARDING == 0,
            heartbeat_consumer: OUT & HEARTBEAT_CONSUMER == 0,
            sync_producer: OUT & SYNC_PRODUCER == 0,
            block_upload: OUT & BLOCK_UPLOAD == 0,
            block_download: OUT & BLOCK_DOWNLOAD == 0,
            lss: OUT & LSS == 0,
            fastscan: OUT & FASTSCAN == 0,
            pdo_timers: OUT & PDO_TIMERS == 0,
            pdo_remote: OUT & PDO_REMOTE == 0,
            dynamic_mapping: OUT & DYNAMIC_MAPPING == 0,
            storage: OUT & STORAGE == 0,
        }
    };

    fn dictionary(&self) -> Dictionary {
        self.0.dictionary()
    }

    fn read(&mut self, at: Address) -> Result<Value, Abort> {
        self.0.read(at)
    }

    fn write(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        self.0.write(at, value)
    }

    fn open(&mut self, at: Address) -> Result<u32, Abort> {
        self.0.open(at)
    }

    fn read_at(&mut self, at: Address, offset: u32, into: &mut [u8]) -> Result<usize, Abort> {
        self.0.read_at(at, offset, into)
    }
}

impl<const OUT: u16> Application for Lean<OUT> {
    fn identity(&self) -> [u32; 4] {
        self.0.identity()
    }

    fn event(&mut self, event: Event, now: Instant) {
        self.0.event(event, now);
    }

    fn load(&mut self, at: Address, value: Value) {
        self.0.load(at, value);
    }

    fn begin_store(&mut self, group: Group) -> Result<(), Abort> {
        self.0.begin_store(group)
    }

    fn put(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        self.0.put(at, value)
    }

    fn commit_store(&mut self) -> Result<(), Abort> {
        self.0.commit_store()
    }

    fn erase(&mut self, group: Group) -> Result<(), Abort> {
        self.0.erase(group)
    }

    fn stored(&mut self, group: Group, at: Address) -> Option<Value> {
        self.0.stored(group, at)
    }

    fn store_lss(&mut self, node_id: u8, kbit_s: Option<u16>) -> bool {
        self.0.store_lss(node_id, kbit_s)
    }
}

/// A lean node and the time.
struct Site<const OUT: u16> {
    node: Node,
    app: Lean<OUT>,
    now: Instant,
}

impl<const OUT: u16> Site<OUT> {
    /// PRE-OPERATIONAL, boot-up sent.
    fn new() -> Self {
        let mut site = Self {
            node: Node::new(),
            app: Lean(Plant::new()),
            now: Instant(1_000_000),
        };
        site.node.start(&mut site.app, ID, site.now);
        assert_eq!(site.sent(), [spoken(0x705, &[0])]);
        site.app.0.events.clear();
        site
    }

    fn operational() -> Self {
        let mut site = Self::new();
        site.hears(0, &[1, ID]);
        site.sent();
        site.app.0.events.clear();
        site
    }

    /// True when the node has taken it.
    fn hears(&mut self, id: u16, bytes: &[u8]) -> bool {
        let frame = Frame::data_frame(id, bytes);
        self.node.receive(&mut self.app, &frame, self.now)
    }

    fn asked(&mut self, id: u16) -> bool {
        let frame = Frame::remote(standard(id), 1).unwrap();
        self.node.receive(&mut self.app, &frame, self.now)
    }

    fn sent(&mut self) -> Vec<Spoken> {
        self.node.poll(&mut self.app, self.now);
        let mut frames = Vec::new();
        while let Some(frame) = self.node.transmit(&mut self.app, self.now) {
            self.node.sent(&mut self.app, &frame, self.now);
            frames.push(spoken(frame.cob_id().unwrap(), frame.bytes()));
            assert!(frames.len() <= MOST);
        }
        frames
    }

    fn later(&mut self, ms: u32) -> Vec<Spoken> {
        self.now = self.now.after_ms(ms);
        self.sent()
    }

    fn sdo(&mut self, request: [u8; 8]) -> Result<u32, u32> {
        self.hears(0x605, &request);
        let sent = self.sent();
        let [(0x585, answer)] = sent.as_slice() else {
            panic!("{sent:X?}");
        };
        outcome(answer.as_slice().try_into().unwrap())
    }

    fn write(&mut self, index: u16, sub: u8, value: Value) -> Result<(), u32> {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d, ..] = value.unsigned().to_le_bytes();
        let command = 0x23 | (4 - value.bytes().len() as u8) << 2;
        self.sdo([command, low, high, sub, a, b, c, d]).map(|_| ())
    }

    fn read(&mut self, index: u16, sub: u8) -> Result<u32, u32> {
        let [low, high] = index.to_le_bytes();
        self.sdo([0x40, low, high, sub, 0, 0, 0, 0])
    }

    /// Neither can be read nor written.
    fn has_not(&mut self, index: u16, sub: u8, value: Value) {
        assert_eq!(self.read(index, sub), Err(NO_OBJECT), "{index:X}");
        assert_eq!(self.write(index, sub, value), Err(NO_OBJECT), "{index:X}");
    }
}

#[test]
fn without_safety_neither_objects_nor_frames_of_it_are_known() {
    let mut site = Site::<SAFETY>::new();
    site.has_not(0x1300, 0, Value::u8(1));
    site.has_not(0x1301, 1, Value::u8(1));
    site.has_not(0x1381, 1, Value::u32(0));
    site.has_not(0x13FE, 0, Value::u8(0xA5));
    site.has_not(0x13FF, 1, Value::u16(0));
    site.hears(0, &[1, ID]);
    site.sent();
    assert!(!site.hears(0x001, &[]));
    assert!(!site.hears(0x103, &[1, 0]));
    assert!(site.app.0.events.iter().all(|e| *e != Event::FailSafe));
    site.node.consent_to_safety(Some(site.now));
    assert_eq!(site.later(100), []);
}

#[test]
fn without_guarding_nobody_is_answered() {
    let mut site = Site::<GUARDING>::new();
    site.has_not(0x100C, 0, Value::u16(100));
    site.has_not(0x100D, 0, Value::u8(3));
    site.asked(0x705);
    assert_eq!(site.later(1000), []);
    // The heartbeat is another service.
    site.write(0x1017, 0, Value::u16(50)).unwrap();
    assert_eq!(site.later(50), [spoken(0x705, &[127])]);
}

#[test]
fn without_the_consumer_no_heartbeat_is_missed() {
    let mut site = Site::<HEARTBEAT_CONSUMER>::new();
    site.has_not(0x1016, 1, Value::u32(2 << 16 | 100));
    site.hears(0x702, &[5]);
    assert_eq!(site.later(1000), []);
    assert_eq!(site.app.0.events, []);
    // Guarding is another service.
    site.asked(0x705);
    assert_eq!(site.sent(), [spoken(0x705, &[127])]);
}

#[test]
fn without_a_producer_sync_comes_from_others_only() {
    let mut site = Site::<SYNC_PRODUCER>::new();
    site.has_not(0x1006, 0, Value::u32(10_000));
    assert_eq!(
        site.write(0x1005, 0, Value::u32(1 << 30 | 0x80)),
        Err(INVALID)
    );
    site.write(0x1005, 0, Value::u32(0x90)).unwrap();
    site.node.stand_in_for_sync(Some(10_000), site.now);
    assert_eq!(site.later(100), []);
    site.hears(0, &[1, ID]);
    assert!(site.hears(0x90, &[]));
    assert_eq!(site.sent().len(), 1);
}

#[test]
fn without_block_transfer_its_commands_are_not_known() {
    let upload = [0xA4, 0x08, 0x10, 0, 127, 0, 0, 0];
    let download = [0xC2, 0x00, 0x60, 0, 2, 0, 0, 0];
    let mut site = Site::<BLOCK_UPLOAD>::new();
    assert_eq!(site.sdo(upload), Err(NO_COMMAND));
    assert!(site.sdo(download).is_ok());
    let mut site = Site::<BLOCK_DOWNLOAD>::new();
    assert_eq!(site.sdo(download), Err(NO_COMMAND));
    assert!(site.sdo(upload).is_ok());
    // A string goes in segments all the same.
    assert_eq!(site.read(0x1008, 0), Ok(plant::NAME.len() as u32));
}

#[test]
fn without_lss_its_frames_are_ignored() {
    let mut site = Site::<LSS>::new();
    for request in [[0x04, 1, 0, 0, 0, 0, 0, 0], [0x5E, 0, 0, 0, 0, 0, 0, 0]] {
        site.hears(0x7E5, &request);
        assert_eq!(site.sent(), []);
    }
}

#[test]
fn without_fastscan_the_rest_of_lss_works() {
    let mut site = Site::<FASTSCAN>::new();
    site.node.start(&mut site.app, UNCONFIGURED, site.now);
    assert!(site.hears(0x7E5, &[0x51, 0, 0, 0, 0, 0x80, 0, 0]));
    assert_eq!(site.sent(), []);
    site.hears(0x7E5, &[0x4C, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(site.sent(), [spoken(0x7E4, &[0x50, 0, 0, 0, 0, 0, 0, 0])]);
}

#[test]
fn without_timers_event_driven_pdos_go_on_events_only() {
    let mut site = Site::<PDO_TIMERS>::new();
    for index in [0x1400, 0x1800] {
        assert_eq!(site.read(index, 5), Err(NO_SUB));
        assert_eq!(site.write(index, 5, Value::u16(10)), Err(NO_SUB));
    }
    assert_eq!(site.write(0x1800, 3, Value::u16(10)), Err(NO_SUB));
    site.write(0x1800, 2, Value::u8(255)).unwrap();
    site.hears(0, &[1, ID]);
    assert_eq!(site.sent().len(), 1);
    assert_eq!(site.later(10_000), []);
}

#[test]
fn without_remote_frames_no_pdo_is_asked_for() {
    let mut site = Site::<PDO_REMOTE>::operational();
    assert_eq!(
        site.write(0x1801, 1, Value::u32(1 << 31 | 0x286)),
        Err(INVALID)
    );
    site.write(0x1801, 1, Value::u32(3 << 30 | 0x286)).unwrap();
    assert!(!site.asked(0x185));
    assert_eq!(site.sent(), []);
    assert!(site.hears(0x80, &[]));
    assert_eq!(site.sent().len(), 1);
}

#[test]
fn a_mapping_that_is_fixed_is_read_only_and_works() {
    let mut site = Site::<DYNAMIC_MAPPING>::new();
    for index in [0x1600, 0x1601, 0x1A00, 0x1A01] {
        assert_eq!(site.write(index, 0, Value::u8(2)), Err(READ_ONLY));
        assert_eq!(
            site.write(index, 1, Value::u32(0x6000_0010)),
            Err(READ_ONLY)
        );
    }
    assert_eq!(site.read(0x1A00, 1), Ok(0x6010_0010));
    site.hears(0, &[1, ID]);
    assert!(site.hears(0x80, &[]));
    assert_eq!(site.sent(), [spoken(0x185, &[0, 0])]);
}

#[test]
fn without_storage_each_start_begins_with_the_defaults() {
    let mut site = Site::<STORAGE>::new();
    site.has_not(0x1010, 1, Value::u32(SAVE));
    site.has_not(0x1011, 1, Value::u32(LOAD));
    site.write(0x1017, 0, Value::u16(50)).unwrap();
    site.write(0x6000, 0, Value::u16(100)).unwrap();
    site.node.start(&mut site.app, ID, site.now);
    site.sent();
    assert_eq!(
        (site.read(0x1017, 0), site.read(0x6000, 0)),
        (Ok(0), Ok(10))
    );
}

#[test]
fn what_every_device_has_is_left() {
    let mut site = Site::<EVERYTHING>::new();
    assert_eq!(site.read(0x1000, 0), Ok(0x019A));
    assert_eq!(site.read(0x1018, 1), Err(NO_OBJECT), "the plant has none");
    site.write(0x1017, 0, Value::u16(50)).unwrap();
    assert_eq!(site.later(50), [spoken(0x705, &[127])]);
    site.hears(0, &[1, ID]);
    assert!(site.hears(0x205, &[42]));
    assert_eq!(site.read(0x2000, 0), Ok(42));
    assert!(site.hears(0x80, &[]));
    assert_eq!(site.sent(), [spoken(0x185, &[0, 0])]);
    site.hears(0, &[129, ID]);
    assert_eq!(site.app.0.events.last(), Some(&Event::ResetNode));
}
