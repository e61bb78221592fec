//! The node as a whole, by conversations: what a master sends, and what it receives.

extern crate std;

mod bus_off;
mod errors;
mod fuzz;
mod memory;
mod plant;
mod services;

use std::vec::Vec;

use super::*;
use crate::frame::standard;
use crate::object::Value;
use plant::Plant;

/// The most frames that one instant can bring, whatever has happened before: an LSS answer, the
/// boot-up, a SYNC, 8 EMCYs that wait and 1 that an own SYNC can cause, 4 TPDOs before and 4
/// after an own SYNC, 2 pairs of SRDOs, a block of 127 segments with the abort behind it, an
/// answer to guarding, a heartbeat.
const MOST: usize = 1 + 1 + 1 + 9 + 8 + 4 + 128 + 2;

const ID: u8 = 5;
const SAVE: u32 = storage::SAVE;
const LOAD: u32 = storage::LOAD;

type Spoken = (u16, Vec<u8>);

fn spoken(id: u16, bytes: &[u8]) -> Spoken {
    (id, Vec::from(bytes))
}

/// A node, its device and the time.
struct Bench {
    node: Node,
    plant: Plant,
    now: Instant,
}

impl Bench {
    /// Before its boot-up message.
    fn booting() -> Self {
        let mut bench = Self {
            node: Node::new(),
            plant: Plant::new(),
            now: Instant(1_000_000),
        };
        bench.start(ID);
        bench
    }

    /// PRE-OPERATIONAL, boot-up sent.
    fn new() -> Self {
        let mut bench = Self::booting();
        assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
        bench.plant.events.clear();
        bench
    }

    fn operational() -> Self {
        let mut bench = Self::new();
        bench.nmt(1);
        bench.plant.events.clear();
        bench
    }

    fn start(&mut self, node_id: u8) {
        self.node.start(&mut self.plant, node_id, self.now);
    }

    fn hear(&mut self, frame: &Frame) {
        self.node.receive(&mut self.plant, frame, self.now);
    }

    fn hears(&mut self, id: u16, bytes: &[u8]) {
        self.hear(&Frame::data_frame(id, bytes));
    }

    fn asked(&mut self, id: u16, length: usize) {
        self.hear(&Frame::remote(standard(id), length).unwrap());
    }

    fn nmt(&mut self, specifier: u8) -> State {
        self.hears(0, &[specifier, ID]);
        self.node.state()
    }

    /// Everything that goes out now, each frame acknowledged by the bus.
    fn sent(&mut self) -> Vec<Spoken> {
        self.node.poll(&mut self.plant, self.now);
        let mut frames = Vec::new();
        while let Some(frame) = self.node.transmit(&mut self.plant, self.now) {
            self.node.sent(&mut self.plant, &frame, self.now);
            frames.push(spoken(frame.cob_id().unwrap(), frame.bytes()));
            assert!(frames.len() <= MOST);
        }
        frames
    }

    /// Lets time pass in steps of a millisecond; what went out meanwhile.
    fn wait(&mut self, ms: u32) -> Vec<Spoken> {
        let mut frames = Vec::new();
        for _ in 0..ms {
            self.now = self.now.after_ms(1);
            frames.extend(self.sent());
        }
        frames
    }

    /// One SDO request; the answer's eight bytes.
    fn sdo(&mut self, request: [u8; 8]) -> Option<[u8; 8]> {
        self.hears(0x600 + u16::from(ID), &request);
        let answer = self.sent().into_iter().find(|(id, _)| *id == 0x585);
        answer.map(|(_, bytes)| bytes.try_into().unwrap())
    }

    /// An expedited download. Errors: the abort code.
    fn write(&mut self, index: u16, sub: u8, value: Value) -> Result<(), u32> {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d, ..] = value.unsigned().to_le_bytes();
        let command = 0x23 | (4 - value.bytes().len() as u8) << 2;
        let answer = self.sdo([command, low, high, sub, a, b, c, d]).unwrap();
        outcome(answer).map(|_| ())
    }

    /// An expedited upload. Errors: the abort code.
    fn read(&mut self, index: u16, sub: u8) -> Result<u32, u32> {
        let [low, high] = index.to_le_bytes();
        outcome(self.sdo([0x40, low, high, sub, 0, 0, 0, 0]).unwrap())
    }

    fn events(&mut self) -> Vec<Event> {
        core::mem::take(&mut self.plant.events)
    }
}

fn outcome([command, _, _, _, a, b, c, d]: [u8; 8]) -> Result<u32, u32> {
    let number = u32::from_le_bytes([a, b, c, d]);
    if command == 0x80 {
        Err(number)
    } else {
        Ok(number)
    }
}

// Start and NMT.

#[test]
fn boot_up_sent_with_the_wrong_state_byte() {
    let mut bench = Bench::booting();
    assert_eq!(bench.node.state(), State::Initialising);
    assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
    assert_eq!(bench.node.state(), State::PreOperational);
    assert_eq!(bench.sent(), []);
}

#[test]
fn nothing_is_answered_before_the_boot_up() {
    let mut bench = Bench::booting();
    bench.hears(0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]);
    bench.hears(0, &[1, ID]);
    bench.asked(0x705, 1);
    assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
    assert_eq!(bench.node.state(), State::PreOperational);
}

#[test]
fn commands_lead_through_the_states() {
    let mut bench = Bench::new();
    assert_eq!(bench.nmt(1), State::Operational);
    assert_eq!(bench.nmt(2), State::Stopped);
    assert_eq!(bench.nmt(128), State::PreOperational);
    assert_eq!(bench.nmt(2), State::Stopped);
    assert_eq!(bench.nmt(1), State::Operational);
    assert_eq!(bench.nmt(77), State::Operational);
    bench.hears(0, &[2, ID + 1]);
    bench.hears(0, &[2, ID, 0]);
    bench.hears(0, &[2]);
    assert_eq!(bench.node.state(), State::Operational);
    bench.hears(0, &[128, 0]);
    assert_eq!(bench.node.state(), State::PreOperational);
}

#[test]
fn nmt_command_lost_when_another_nmt_frame_follows() {
    let mut bench = Bench::new();
    bench.hears(0, &[1, ID]);
    bench.hears(0, &[2, ID + 1]);
    assert_eq!(bench.node.state(), State::Operational);
    let entered = [Event::State(State::Operational)];
    assert_eq!(bench.events(), entered);
    bench.hears(0, &[130, ID]);
    bench.hears(0, &[130, 0]);
    assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
}

#[test]
fn reset_node_is_the_device_s_and_ends_in_a_boot_up() {
    let mut bench = Bench::operational();
    bench.write(0x2000, 0, Value::u8(9)).unwrap();
    bench.nmt(129);
    assert_eq!(bench.events(), [Event::ResetNode]);
    bench.start(ID);
    assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
    assert_eq!(bench.read(0x2000, 0), Ok(7));
}

#[test]
fn reset_communication_leaves_the_device_s_own_values() {
    let mut bench = Bench::operational();
    bench.write(0x2000, 0, Value::u8(9)).unwrap();
    bench.write(0x1017, 0, Value::u16(100)).unwrap();
    bench.events();
    assert_eq!(bench.nmt(130), State::Initialising);
    assert_eq!(bench.events(), [Event::ResetCommunication]);
    assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
    assert_eq!(bench.read(0x2000, 0), Ok(9));
    assert_eq!(bench.read(0x1017, 0), Ok(0));
}

#[test]
fn nmt_startup_8_starts_the_node_by_itself() {
    let mut bench = Bench::new();
    assert_eq!(bench.write(0x1F80, 0, Value::u32(1)), Err(0x0609_0030));
    bench.write(0x1F80, 0, Value::u32(8)).unwrap();
    bench.write(0x1010, 2, Value::u32(SAVE)).unwrap();
    bench.start(ID);
    bench.events();
    assert_eq!(bench.sent().first(), Some(&spoken(0x705, &[0])));
    assert_eq!(bench.node.state(), State::Operational);
    let [before, after] = [State::PreOperational, State::Operational].map(Event::State);
    assert_eq!(bench.events(), [before, after]);
}

// What each state allows.

#[test]
fn sdo_answered_in_stopped() {
    let mut bench = Bench::new();
    let ask_type = [0x40, 0, 0x10, 0, 0, 0, 0, 0];
    assert_eq!(bench.sdo(ask_type), Some([0x43, 0, 0x10, 0, 0x9A, 1, 0, 0]));
    // An answer that still waits is not given either.
    bench.hears(0x605, &ask_type);
    bench.nmt(2);
    assert_eq!(bench.sdo(ask_type), None);
    bench.nmt(128);
    assert_eq!(bench.sent(), []);
}

#[test]
fn pdos_flow_in_operational_only() {
    let mut bench = Bench::new();
    for (specifier, pdo) in [(128, false), (1, true), (2, false)] {
        bench.nmt(specifier);
        bench.plant.events.clear();
        bench.hears(0x205, &[33]);
        let taken = bench.events().contains(&Event::Received(0));
        bench.hears(0x80, &[]);
        let sent = bench.sent().contains(&spoken(0x185, &[0, 0]));
        assert_eq!((taken, sent), (pdo, pdo), "after {specifier}");
    }
    assert_eq!(bench.plant.read(at(0x2000, 0)), Ok(Value::u8(33)));
}

#[test]
fn rpdo_received_in_pre_operational_applied_at_start() {
    let mut bench = Bench::new();
    bench.write(0x1400, 2, Value::u8(1)).unwrap();
    bench.hears(0x205, &[33]);
    bench.nmt(1);
    bench.hears(0x80, &[]);
    assert_eq!(bench.read(0x2000, 0), Ok(7));
    bench.hears(0x205, &[34]);
    assert_eq!(bench.read(0x2000, 0), Ok(7));
    bench.hears(0x80, &[]);
    assert_eq!(bench.read(0x2000, 0), Ok(34));
}

#[test]
fn two_syncs_collapsed_into_one() {
    let mut bench = Bench::operational();
    bench.hears(0x80, &[]);
    bench.hears(0x80, &[]);
    assert_eq!(bench.events(), [Event::Sync, Event::Sync]);
    // The sample of the first gave way to that of the second, and that is counted.
    assert_eq!(bench.sent(), [spoken(0x185, &[0, 0])]);
    assert_eq!(bench.node.overruns(), 1);
}

#[test]
fn own_sync_happens_when_it_has_gone_out() {
    let mut bench = Bench::operational();
    bench.write(0x1006, 0, Value::u32(10_000)).unwrap();
    bench.write(0x1005, 0, Value::u32(0x4000_0080)).unwrap();
    bench.now = bench.now.after_ms(10);
    let sync = bench.node.transmit(&mut bench.plant, bench.now).unwrap();
    assert_eq!((sync.cob_id(), sync.length()), (Some(0x80), 0));
    assert_eq!(bench.events(), []);
    assert_eq!(bench.sent(), []);
    bench.now = bench.now.after(130);
    bench.node.sent(&mut bench.plant, &sync, bench.now);
    assert_eq!(bench.events(), [Event::Sync]);
    assert_eq!(bench.sent(), [spoken(0x185, &[0, 0])]);
    let frames = bench.wait(20);
    assert_eq!(frames.iter().filter(|(id, _)| *id == 0x80).count(), 2);
}

#[test]
fn a_pdo_with_the_identifier_of_sync_answering_itself_without_end() {
    let mut bench = Bench::new();
    bench.write(0x1005, 0, Value::u32(0x185)).unwrap();
    bench.nmt(1);
    bench.hears(0x185, &[]);
    assert_eq!(bench.sent().len(), 1);
    // The same of EMCY, whose length is wrong for a SYNC, which is worth another EMCY.
    bench.write(0x1005, 0, Value::u32(0x85)).unwrap();
    bench.node.overrun(1);
    assert_eq!(bench.sent().len(), 1);
}

#[test]
fn the_lowest_identifier_goes_first() {
    let mut bench = Bench::operational();
    bench.write(0x1017, 0, Value::u16(10)).unwrap();
    bench.now = bench.now.after_ms(10);
    bench.hears(0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]);
    bench.hears(0x80, &[]);
    bench.node.overrun(1);
    bench.node.stand_in_for_sync(Some(1000), bench.now);
    bench.now = bench.now.after_ms(1);
    let ids: Vec<u16> = bench.sent().iter().map(|(id, _)| *id).collect();
    assert_eq!(ids, [0x80, 0x85, 0x185, 0x585, 0x705]);
}

#[test]
fn a_synchronous_window_drops_what_is_late() {
    let mut bench = Bench::operational();
    bench.write(0x1007, 0, Value::u32(500)).unwrap();
    bench.hears(0x80, &[]);
    bench.now = bench.now.after(500);
    assert_eq!(bench.sent(), [spoken(0x185, &[0, 0])]);
    bench.hears(0x80, &[]);
    bench.now = bench.now.after(501);
    assert_eq!(bench.sent(), []);
    // The window is a stored parameter, and holds from the start.
    bench.nmt(128);
    bench.write(0x1010, 2, Value::u32(SAVE)).unwrap();
    bench.nmt(130);
    assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
    bench.nmt(1);
    bench.hears(0x80, &[]);
    bench.now = bench.now.after(501);
    assert_eq!(bench.sent(), []);
}

#[test]
fn guarding_is_answered_with_the_state_and_a_toggle_bit() {
    let mut bench = Bench::new();
    bench.asked(0x705, 1);
    assert_eq!(bench.sent(), [spoken(0x705, &[0x7F])]);
    bench.nmt(2);
    bench.asked(0x705, 1);
    assert_eq!(bench.sent(), [spoken(0x705, &[0x84])]);
}

#[test]
fn every_communication_row_can_be_read() {
    let mut bench = Bench::new();
    let rows = bench.plant.dictionary().entries();
    for row in rows.filter(|row| row.data_type.size().is_some()) {
        for sub in row.sub..=row.last {
            let no_error_yet = row.index == 0x1003 && sub > 0;
            let expected = if no_error_yet {
                Err(0x0800_0024)
            } else {
                Ok(())
            };
            let answer = bench.read(row.index, sub).map(|_| ());
            assert_eq!(answer, expected, "{:04X}.{sub}", row.index);
        }
    }
}

// LSS.

#[test]
fn a_node_without_node_id_speaks_lss_only() {
    let mut bench = Bench::booting();
    bench.start(UNCONFIGURED);
    bench.hears(0, &[1, 0]);
    bench.hears(0x80, &[]);
    bench.hears(0x6FF, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]);
    assert_eq!(bench.wait(1000), []);
    bench.hears(0x7E5, &[0x4C, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bench.sent(), [spoken(0x7E4, &[0x50, 0, 0, 0, 0, 0, 0, 0])]);
    bench.hears(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    bench.hears(0x7E5, &[0x11, 9, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bench.sent(), [spoken(0x7E4, &[0x11, 0, 0, 0, 0, 0, 0, 0])]);
    assert_eq!(bench.node.node_id(), UNCONFIGURED);
    bench.hears(0x7E5, &[4, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bench.sent(), [spoken(0x709, &[0])]);
    assert_eq!(bench.node.node_id(), 9);
}

#[test]
fn lss_node_id_active_before_reset() {
    let mut bench = Bench::new();
    bench.hears(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    bench.hears(0x7E5, &[0x11, 9, 0, 0, 0, 0, 0, 0]);
    bench.sent();
    bench.hears(0x7E5, &[0x17, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bench.sent(), [spoken(0x7E4, &[0x17, 0, 0, 0, 0, 0, 0, 0])]);
    assert_eq!(bench.plant.lss, Some((9, None)));
    bench.hears(0x7E5, &[4, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bench.node.node_id(), ID);
    assert_eq!(bench.read(0x1014, 0), Ok(0x85));
    bench.nmt(130);
    assert_eq!(bench.sent(), [spoken(0x709, &[0])]);
    bench.hears(0x609, &[0x40, 0x14, 0x10, 0, 0, 0, 0, 0]);
    assert_eq!(
        bench.sent(),
        [spoken(0x589, &[0x43, 0x14, 0x10, 0, 0x89, 0, 0, 0])]
    );
}

#[test]
fn lss_keeps_out_of_a_machine_that_works() {
    let mut bench = Bench::operational();
    bench.hears(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    bench.hears(0x7E5, &[0x5E, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bench.sent(), []);
}

#[test]
fn a_memory_that_fails_is_told_to_the_lss_master() {
    let mut bench = Bench::new();
    bench.plant.broken = true;
    bench.hears(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    bench.hears(0x7E5, &[0x17, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bench.sent(), [spoken(0x7E4, &[0x17, 2, 0, 0, 0, 0, 0, 0])]);
}

#[test]
fn sync_counter_goes_on_after_stopped() {
    let mut bench = Bench::new();
    bench.write(0x1019, 0, Value::u8(240)).unwrap();
    bench.write(0x1006, 0, Value::u32(10_000)).unwrap();
    bench.write(0x1005, 0, Value::u32(1 << 30 | 0x80)).unwrap();
    let syncs = |frames: Vec<Spoken>| -> Vec<Spoken> {
        frames.into_iter().filter(|(id, _)| *id == 0x80).collect()
    };
    let before = syncs(bench.wait(20));
    assert_eq!(before, [spoken(0x80, &[1]), spoken(0x80, &[2])]);
    bench.nmt(2);
    assert_eq!(syncs(bench.wait(100)), []);
    bench.nmt(128);
    assert_eq!(syncs(bench.wait(10)), [spoken(0x80, &[1])]);
}

#[test]
fn lss_configuration_state_survives_a_machine_that_worked() {
    let mut bench = Bench::new();
    bench.hears(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    bench.nmt(1);
    bench.nmt(128);
    bench.hears(0x7E5, &[0x11, 9, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bench.sent(), []);
}

#[test]
fn a_node_tells_frames_of_concern_from_others() {
    let mut bench = Bench::operational();
    let mut concerns = |id: u16, bytes: &[u8]| {
        let frame = Frame::data_frame(id, bytes);
        bench.node.receive(&mut bench.plant, &frame, bench.now)
    };
    assert!(concerns(0x080, &[]));
    assert!(concerns(
        0x600 + u16::from(ID),
        &[0x40, 0, 0x10, 0, 0, 0, 0, 0]
    ));
    assert!(concerns(0x000, &[2, ID]));
    // Error control looks at every heartbeat, whoever is supervised.
    assert!(concerns(0x70A, &[5]));
    assert!(!concerns(0x000, &[2, ID + 1]));
    assert!(!concerns(0x60A, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]));
    assert!(!concerns(0x38A, &[1, 2, 3]));
    let foreign = Frame::with(embedded_can::ExtendedId::new(0x80).unwrap(), &[]).unwrap();
    assert!(!bench.node.receive(&mut bench.plant, &foreign, bench.now));
}
