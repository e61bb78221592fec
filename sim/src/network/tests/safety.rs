//! Safety frames of a pair that has been commissioned: when they begin.

use super::*;

use canopen::object::{Address, at};
use device::objects::safety::VALID;

/// The longest time from the start of a pair to its first safety frames, in SYNCs. What receives
/// them counts its SCT from entering OPERATIONAL (docs/canopen.md).
const FIRST_AFTER_SYNCS: u64 = 4;
/// The same where that is longer, ns.
const FIRST_AFTER_NS: u64 = 100 * MS;

fn store(memory: &mut Memory, record: Record, address: Address, value: u8) {
    RecordStore::begin(memory, record, record.longest()).unwrap();
    parameters::put(memory, address, &Value::u8(value)).unwrap();
    RecordStore::commit(memory).unwrap();
}

impl Site {
    /// A pair whose safety configuration was checked and stored as it is delivered.
    fn commissioned() -> Self {
        let mut site = Self::new(250);
        for node in 0..2 {
            site.network.power_off(node);
            let memory = site.network.node(node).device.memory();
            store(memory, Record::Communication, at(0x13FE, 0), VALID);
            store(memory, Record::Profile, at(0x63FE, 0), VALID);
            site.network.power_on(node);
        }
        site.run(&mut level(), 1000 * MS);
        site
    }
}

#[test]
fn a_pair_that_is_started_sends_safety_frames_when_it_has_compared() {
    for period_ms in [10, 20, 50, 100, 200] {
        let mut site = Site::commissioned();
        // A master's SYNC was there before.
        let start_ns = site.network.now_ns();
        site.send(0, &[1, 0]);
        for _ in 0..1000 / period_ms {
            site.run(&mut level(), period_ms * MS);
            site.send(0x80, &[]);
        }
        for id in [0x101, 0x102, 0x103, 0x104] {
            let first_ns = site.times_of(id)[0] - start_ns;
            println!("SYNC {period_ms} ms, {id:X}h: {} ms", first_ns / MS);
            let bound_ns = FIRST_AFTER_NS.max(FIRST_AFTER_SYNCS * period_ms * MS);
            assert!(first_ns < bound_ns, "{id:X}h: {first_ns} ns");
        }
    }
}
