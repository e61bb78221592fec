//! Conversations with the bus: what is heard, what goes out.

use super::*;
use crate::frame::standard;
use crate::mapping::shelf::Shelf;
use crate::object::at;

pub(super) const OFF: u32 = 0x8000_0000;
pub(super) const X: u32 = 0x6010_0010;
pub(super) const Y: u32 = 0x6020_0010;
pub(super) const KNOB: u32 = 0x2050_0008;
pub(super) const PERCENT: u32 = 0x2051_0008;

/// Milliseconds.
pub(super) const fn ms(n: u64) -> Instant {
    Instant(n * 1000)
}

pub(super) struct Bench {
    pub pdo: Pdos,
    pub shelf: Shelf,
}

impl Bench {
    pub fn new() -> Self {
        Self {
            pdo: Pdos::new(),
            shelf: Shelf::new(),
        }
    }

    pub fn write(&mut self, index: u16, sub: u8, number: u32) -> Result<(), Abort> {
        let dictionary = self.shelf.dictionary();
        let value = Value::u32(number);
        self.pdo
            .write::<Shelf>(&dictionary, at(index, sub), value)
            .unwrap()
    }

    pub fn read(&self, index: u16, sub: u8) -> u64 {
        self.pdo
            .clone()
            .read(at(index, sub))
            .unwrap()
            .unwrap()
            .unsigned()
    }

    pub fn map(&mut self, index: u16, entries: &[u32]) -> Result<(), Abort> {
        self.write(index, 0, 0)?;
        for (sub, entry) in (1..).zip(entries) {
            self.write(index, sub, *entry)?;
        }
        self.write(index, 0, entries.len() as u32)
    }

    /// Sets a PDO up the way a configuration tool does.
    pub fn set_up(&mut self, index: u16, cob_id: u32, kind: u8, entries: &[u32]) {
        self.write(index, 1, cob_id | OFF).unwrap();
        self.write(index, 2, u32::from(kind)).unwrap();
        self.map(index + 0x200, entries).unwrap();
        self.write(index, 1, cob_id).unwrap();
    }

    /// A node with one TPDO of identifier 181h that carries X.
    pub fn with_tpdo(kind: u8) -> Self {
        let mut bench = Self::new();
        bench.set_up(0x1800, 0x181, kind, &[X]);
        bench
    }

    /// A node with one RPDO of identifier 201h that carries a knob.
    pub fn with_rpdo(kind: u8) -> Self {
        let mut bench = Self::new();
        bench.set_up(0x1400, 0x201, kind, &[KNOB]);
        bench
    }

    pub fn x(&mut self, number: u64) {
        self.shelf.put(0x6010, 0, number);
    }

    pub fn knob(&self) -> u64 {
        self.shelf.get(0x2050, 0)
    }

    pub fn sync(&mut self, now: Instant) -> u8 {
        self.pdo.sync(&mut self.shelf, None, now)
    }

    pub fn poll(&mut self, now: Instant) -> Option<Instant> {
        self.pdo.poll(&mut self.shelf, now).get()
    }

    pub fn event(&mut self, now: Instant) {
        self.pdo.event(&mut self.shelf, now);
    }

    pub fn hear(&mut self, id: u16, bytes: &[u8], now: Instant) -> Option<Received> {
        let frame = Frame::data_frame(id, bytes);
        self.pdo.receive(&mut self.shelf, &frame, now)
    }

    pub fn ask(&mut self, id: u16, now: Instant) -> Option<Received> {
        let frame = Frame::remote(standard(id), 2).unwrap();
        self.pdo.receive(&mut self.shelf, &frame, now)
    }

    /// The X that goes out now, and is at once on the bus and through; `None` for silence.
    pub fn sent(&mut self, now: Instant) -> Option<u8> {
        let number = self.handed_over(now)?;
        self.pdo.sent(0x181, now);
        Some(number)
    }

    /// The X that the controller gets now; `None` for silence.
    pub fn handed_over(&mut self, now: Instant) -> Option<u8> {
        let frame = self.pdo.transmit(now)?;
        assert_eq!((frame.cob_id(), frame.length()), (Some(0x181), 2));
        frame.bytes().first().copied()
    }
}

// Transmission at SYNC.

#[test]
fn nothing_happens_outside_operational() {
    let mut bench = Bench::with_tpdo(1);
    bench.sync(ms(1));
    bench.event(ms(1));
    assert_eq!(bench.poll(ms(1)), None);
    assert_eq!((bench.sent(ms(1)), bench.ask(0x181, ms(1))), (None, None));
    bench.pdo.start(ms(2));
    bench.sync(ms(3));
    bench.pdo.stop();
    assert_eq!(bench.sent(ms(4)), None);
}

#[test]
fn type_n_is_not_sent_on_every_sync() {
    let mut bench = Bench::with_tpdo(3);
    bench.pdo.start(ms(0));
    let mut turns = [None; 7];
    for (n, turn) in (1..).zip(&mut turns) {
        bench.x(n);
        bench.sync(ms(n));
        *turn = bench.sent(ms(n));
    }
    assert_eq!(turns, [None, None, Some(3), None, None, Some(6), None]);
}

#[test]
fn type_0_is_not_sent_on_every_sync() {
    let mut bench = Bench::with_tpdo(0);
    bench.pdo.start(ms(0));
    bench.sync(ms(1));
    assert_eq!(bench.sent(ms(1)), None);
    bench.x(5);
    bench.event(ms(2));
    assert_eq!(bench.sent(ms(2)), None);
    bench.x(6);
    bench.sync(ms(3));
    assert_eq!(bench.sent(ms(3)), Some(6));
    bench.event(ms(4));
    bench.sync(ms(5));
    assert_eq!(bench.sent(ms(5)), None);
}

#[test]
fn two_syncs_in_a_row_give_two_pdos() {
    let mut bench = Bench::with_tpdo(1);
    bench.pdo.start(ms(0));
    bench.x(1);
    bench.sync(ms(1));
    assert_eq!(bench.sent(ms(1)), Some(1));
    bench.x(2);
    bench.sync(ms(1));
    assert_eq!((bench.sent(ms(1)), bench.sent(ms(1))), (Some(2), None));
    assert_eq!(bench.pdo.overruns(), 0);
}

#[test]
fn the_newest_sample_replaces_one_that_the_bus_did_not_take() {
    let mut bench = Bench::with_tpdo(1);
    bench.pdo.start(ms(0));
    for n in [1, 2, 3] {
        bench.x(n);
        bench.sync(ms(n));
    }
    assert_eq!((bench.sent(ms(4)), bench.sent(ms(4))), (Some(3), None));
    assert_eq!(bench.pdo.overruns(), 2);
}

#[test]
fn a_sample_is_of_the_sync_and_not_of_the_transmission() {
    let mut bench = Bench::with_tpdo(1);
    bench.pdo.start(ms(0));
    bench.x(1);
    bench.sync(ms(1));
    bench.x(2);
    bench.event(ms(1));
    assert_eq!(bench.sent(ms(2)), Some(1));
}

#[test]
fn a_sample_that_misses_the_synchronous_window_is_dropped() {
    let mut bench = Bench::with_tpdo(1);
    bench.pdo.window_us = 500;
    bench.pdo.start(ms(0));
    bench.sync(ms(1));
    assert_eq!(bench.poll(ms(1)), Some(Instant(1501)));
    assert_eq!(bench.poll(Instant(1500)), Some(Instant(1501)));
    assert_eq!(bench.sent(Instant(1500)), Some(0));
    bench.sync(ms(2));
    assert_eq!(bench.sent(Instant(2501)), None);
    assert_eq!(bench.poll(Instant(2501)), None);
    assert_eq!(bench.pdo.overruns(), 1);
}

#[test]
fn a_sample_that_the_bus_did_not_take_went_out_seconds_later() {
    let mut bench = Bench::with_tpdo(1);
    bench.pdo.start(ms(0));
    bench.sync(ms(1));
    assert_eq!(bench.pdo.expires(0x181), Some(ms(31)));
    assert_eq!(bench.poll(ms(20)), Some(Instant(31_001)));
    bench.poll(Instant(31_001));
    assert_eq!(bench.sent(ms(32)), None);
    assert_eq!(bench.pdo.expires(0x182), None);
}

#[test]
fn a_sample_of_long_ago_was_the_answer_to_a_remote_frame() {
    let mut bench = Bench::with_tpdo(1);
    bench.pdo.start(ms(0));
    bench.x(1);
    bench.sync(ms(1));
    assert_eq!(bench.sent(ms(2)), Some(1));
    bench.x(2);
    bench.ask(0x181, ms(31));
    assert_eq!(bench.sent(ms(31)), Some(1));
    bench.ask(0x181, ms(32));
    assert_eq!(bench.sent(ms(32)), Some(2));
}

#[test]
fn an_event_whose_frame_was_taken_back_is_told_again_as_it_is_then() {
    let mut bench = Bench::with_tpdo(254);
    bench.pdo.start(ms(0));
    bench.x(1);
    bench.poll(ms(0));
    assert_eq!(bench.sent(ms(0)), Some(1));
    bench.x(2);
    bench.pdo.withdrawn(0x181);
    bench.pdo.withdrawn(0x201);
    assert_eq!(bench.pdo.overruns(), 1, "a sample that was lost");
    bench.poll(ms(30));
    assert_eq!(bench.sent(ms(30)), Some(2));
    bench.poll(ms(40));
    assert_eq!(bench.sent(ms(40)), None);
}

#[test]
fn the_sync_start_value_sets_which_sync_is_the_first() {
    let mut bench = Bench::with_tpdo(1);
    bench.write(0x1800, 1, OFF).unwrap();
    bench.write(0x1800, 6, 2).unwrap();
    bench.write(0x1800, 2, 4).unwrap();
    bench.write(0x1800, 1, 0x181).unwrap();
    bench.pdo.start(ms(0));
    let mut sent = 0_u32;
    for (n, counter) in [4, 1, 2, 3, 4, 1, 2, 3].into_iter().enumerate() {
        bench.pdo.sync(&mut bench.shelf, Some(counter), ms(1));
        sent |= u32::from(bench.sent(ms(1)).is_some()) << n;
    }
    assert_eq!(sent, 0b0100_0100);
}

#[test]
fn without_a_counter_the_sync_start_value_is_of_no_effect() {
    let mut bench = Bench::with_tpdo(1);
    bench.write(0x1800, 1, OFF).unwrap();
    bench.write(0x1800, 6, 2).unwrap();
    bench.write(0x1800, 1, 0x181).unwrap();
    bench.pdo.start(ms(0));
    bench.sync(ms(1));
    assert_eq!(bench.sent(ms(1)), Some(0));
}

#[test]
fn the_lowest_identifier_goes_first() {
    let mut bench = Bench::with_tpdo(1);
    bench.set_up(0x1803, 0x0F0, 1, &[Y]);
    bench.pdo.start(ms(0));
    bench.sync(ms(1));
    for id in [0x0F0, 0x181] {
        assert_eq!(bench.pdo.next_cob_id(ms(1)), Some(id));
        assert_eq!(bench.pdo.transmit(ms(1)).unwrap().cob_id(), Some(id));
    }
    assert_eq!(bench.pdo.next_cob_id(ms(1)), None);
}

#[test]
fn what_cannot_be_read_is_not_sent() {
    let mut bench = Bench::with_tpdo(1);
    bench.set_up(0x1801, 0x281, 255, &[X]);
    bench.shelf.unreadable = Some(at(0x6010, 0));
    bench.pdo.start(ms(0));
    bench.poll(ms(0));
    bench.sync(ms(1));
    bench.event(ms(1));
    assert_eq!(bench.pdo.transmit(ms(1)), None);
}

// Transmission by events.

#[test]
fn event_driven_types_are_sent_once_at_start_and_then_when_data_change() {
    for kind in [254, 255] {
        let mut bench = Bench::with_tpdo(kind);
        bench.x(1);
        bench.pdo.start(ms(0));
        assert_eq!(bench.poll(ms(0)), None);
        assert_eq!(bench.sent(ms(0)), Some(1));
        bench.event(ms(1));
        bench.sync(ms(1));
        assert_eq!(bench.sent(ms(1)), None);
        bench.x(2);
        bench.event(ms(2));
        assert_eq!((bench.sent(ms(2)), bench.sent(ms(2))), (Some(2), None));
    }
}

#[test]
fn the_inhibit_time_holds_back_and_the_newest_data_go() {
    let mut bench = inhibited();
    assert_eq!(bench.sent(ms(1)), Some(0));
    for n in [2, 3] {
        bench.x(n);
        bench.event(ms(n));
        assert_eq!(bench.sent(ms(n)), None);
        assert_eq!(bench.poll(ms(n)), Some(ms(6)));
    }
    assert_eq!(bench.sent(ms(6)), Some(3));
    assert_eq!(bench.pdo.overruns(), 0);
}

/// A TPDO of X on events, of an inhibit time of 5 ms.
fn inhibited() -> Bench {
    let mut bench = Bench::with_tpdo(255);
    bench.write(0x1800, 1, OFF).unwrap();
    bench.write(0x1800, 3, 50).unwrap();
    bench.write(0x1800, 1, 0x181).unwrap();
    bench.pdo.start(ms(0));
    bench.poll(ms(0));
    bench
}

#[test]
fn a_frame_that_came_late_onto_the_bus_shortened_the_inhibit_time() {
    let mut bench = inhibited();
    assert_eq!(bench.handed_over(ms(0)), Some(0));
    // The bus is busy, for longer than the inhibit time.
    for n in [2, 8] {
        bench.x(n);
        bench.event(ms(n));
        assert_eq!((bench.poll(ms(n)), bench.handed_over(ms(n))), (None, None));
    }
    assert!(bench.pdo.sent(0x181, ms(9)));
    assert_eq!(
        (bench.poll(ms(9)), bench.handed_over(ms(13))),
        (Some(ms(14)), None)
    );
    assert_eq!(bench.sent(ms(14)), Some(8));
    // Nothing waits for the end of this one.
    assert!(!bench.pdo.sent(0x181, ms(14)));
    assert_eq!(bench.pdo.overruns(), 0);
}

#[test]
fn a_frame_that_never_went_out_ends_the_wait_for_it() {
    let ends: [fn(&mut Pdos); 2] = [|pdo| pdo.withdrawn(0x181), Pdos::bus_off];
    for end in ends {
        let mut bench = inhibited();
        assert_eq!(bench.handed_over(ms(0)), Some(0));
        end(&mut bench.pdo);
        bench.poll(ms(1));
        assert_eq!(bench.handed_over(ms(1)), Some(0));
        bench.x(2);
        bench.event(ms(2));
        assert_eq!(bench.handed_over(ms(2)), None);
        end(&mut bench.pdo);
        assert_eq!(bench.handed_over(ms(2)), Some(2));
    }
}

#[test]
fn two_pdos_of_one_identifier_both_go_on() {
    let mut bench = inhibited();
    bench.set_up(0x1801, 0x181, 255, &[X]);
    bench.write(0x1801, 1, OFF).unwrap();
    bench.write(0x1801, 3, 50).unwrap();
    bench.write(0x1801, 1, 0x181).unwrap();
    for n in [10, 20, 30] {
        bench.x(n);
        bench.event(ms(n));
        bench.poll(ms(n));
        let sent = [bench.sent(ms(n)), bench.sent(ms(n)), bench.sent(ms(n + 5))];
        assert_eq!(sent.iter().flatten().count(), 2, "{n}: {sent:?}");
    }
}

#[test]
fn the_event_timer_keeps_its_rhythm() {
    let mut bench = Bench::with_tpdo(254);
    bench.write(0x1800, 5, 10).unwrap();
    bench.pdo.start(ms(0));
    assert_eq!(bench.poll(ms(0)), Some(ms(10)));
    assert_eq!(bench.sent(ms(0)), Some(0));
    bench.poll(ms(9));
    assert_eq!(bench.sent(ms(9)), None);
    bench.x(1);
    assert_eq!(bench.poll(Instant(10_700)), Some(ms(20)));
    assert_eq!(bench.sent(ms(11)), Some(1));
    bench.x(2);
    bench.event(ms(15));
    assert_eq!(bench.sent(ms(15)), Some(2));
    assert_eq!(bench.poll(ms(20)), Some(ms(25)));
    assert_eq!(bench.sent(ms(20)), None);
}

#[test]
fn an_event_timer_that_was_not_served_for_long_does_not_catch_up() {
    let mut bench = Bench::with_tpdo(254);
    bench.write(0x1800, 5, 10).unwrap();
    bench.pdo.start(ms(0));
    bench.poll(ms(0));
    assert_eq!(bench.poll(ms(95)), Some(ms(105)));
}

#[test]
fn a_pdo_that_comes_into_being_in_operational_is_served() {
    let mut bench = Bench::new();
    bench.pdo.start(ms(0));
    bench.set_up(0x1800, 0x181, 255, &[X]);
    bench.poll(ms(1));
    assert_eq!(bench.sent(ms(1)), Some(0));
    bench.write(0x1800, 1, 0x181 | OFF).unwrap();
    bench.x(1);
    bench.event(ms(2));
    assert_eq!(bench.sent(ms(2)), None);
}

// Remote frames.

#[test]
fn a_remote_frame_is_answered_with_the_current_data() {
    let mut bench = Bench::with_tpdo(255);
    bench.pdo.start(ms(0));
    bench.poll(ms(0));
    bench.sent(ms(0));
    bench.x(7);
    assert_eq!(bench.ask(0x181, ms(1)), Some(Received::Requested));
    assert_eq!((bench.sent(ms(1)), bench.sent(ms(1))), (Some(7), None));
    assert_eq!(bench.ask(0x182, ms(1)), None);
}

#[test]
fn a_synchronous_pdo_answers_a_remote_frame_with_its_last_sample() {
    let mut bench = Bench::with_tpdo(1);
    bench.pdo.start(ms(0));
    bench.x(7);
    bench.sync(ms(1));
    assert_eq!(bench.sent(ms(1)), Some(7));
    bench.x(8);
    assert_eq!(bench.ask(0x181, ms(2)), Some(Received::Requested));
    assert_eq!(bench.sent(ms(2)), Some(7));
}

#[test]
fn bit_30_forbids_remote_frames() {
    let mut bench = Bench::new();
    bench.set_up(0x1800, 0x4000_0181, 1, &[X]);
    bench.pdo.start(ms(0));
    assert_eq!(bench.ask(0x181, ms(1)), None);
    assert_eq!(bench.sent(ms(1)), None);
}

// Reception.

#[test]
fn an_rpdo_writes_at_once() {
    let mut bench = Bench::with_rpdo(255);
    bench.pdo.start(ms(0));
    assert_eq!(bench.hear(0x201, &[9], ms(1)), Some(Received::Taken(0)));
    assert_eq!(bench.knob(), 9);
    assert_eq!(bench.hear(0x202, &[8], ms(1)), None);
    let long = embedded_can::ExtendedId::new(0x201).unwrap();
    let frame = Frame::with(long, &[8]).unwrap();
    assert_eq!(bench.pdo.receive(&mut bench.shelf, &frame, ms(1)), None);
    assert_eq!(bench.knob(), 9);
}

#[test]
fn a_synchronous_rpdo_waits_for_the_next_sync() {
    for kind in [0, 1, 240] {
        let mut bench = Bench::with_rpdo(kind);
        bench.pdo.start(ms(0));
        assert_eq!(bench.hear(0x201, &[8], ms(1)), Some(Received::Waiting));
        assert_eq!(bench.hear(0x201, &[9], ms(1)), Some(Received::Waiting));
        assert_eq!(bench.knob(), 0);
        assert_eq!(bench.sync(ms(2)), 0b0001);
        assert_eq!(bench.knob(), 9);
        assert_eq!(bench.sync(ms(3)), 0);
    }
}

#[test]
fn at_sync_what_was_received_counts_before_samples_are_taken() {
    let mut bench = Bench::new();
    bench.set_up(0x1400, 0x201, 1, &[0x2040_0040]);
    bench.set_up(0x1800, 0x181, 1, &[0x2040_0040]);
    bench.pdo.start(ms(0));
    bench.hear(0x201, &[1, 2, 3, 4, 5, 6, 7, 8], ms(1));
    bench.sync(ms(2));
    let frame = bench.pdo.transmit(ms(2)).unwrap();
    assert_eq!(frame.bytes(), [1, 2, 3, 4, 5, 6, 7, 8]);
}

#[test]
fn an_rpdo_received_in_pre_operational_is_not_applied_at_start() {
    for kind in [1, 255] {
        let mut bench = Bench::with_rpdo(kind);
        assert_eq!(bench.hear(0x201, &[9], ms(1)), None);
        bench.pdo.start(ms(2));
        bench.poll(ms(2));
        bench.sync(ms(3));
        assert_eq!(bench.knob(), 0);
    }
}

#[test]
fn an_rpdo_that_waited_when_the_node_was_stopped_is_forgotten() {
    let mut bench = Bench::with_rpdo(1);
    bench.pdo.start(ms(0));
    bench.hear(0x201, &[9], ms(1));
    bench.pdo.stop();
    bench.pdo.start(ms(2));
    assert_eq!((bench.sync(ms(3)), bench.knob()), (0, 0));
}

#[test]
fn too_short_is_not_used_and_too_long_is_used_as_far_as_mapped() {
    let mut bench = Bench::with_rpdo(255);
    bench.pdo.start(ms(0));
    assert_eq!(bench.hear(0x201, &[], ms(1)), Some(Received::TooShort(0)));
    assert_eq!(bench.knob(), 0);
    assert_eq!(
        bench.hear(0x201, &[5, 6], ms(1)),
        Some(Received::TooLong(0))
    );
    assert_eq!(bench.knob(), 5);
}

#[test]
fn values_out_of_range_are_refused_as_a_whole() {
    let mut bench = Bench::new();
    bench.set_up(0x1402, 0x401, 255, &[KNOB, PERCENT]);
    bench.pdo.start(ms(0));
    assert_eq!(
        bench.hear(0x401, &[1, 101], ms(1)),
        Some(Received::Refused(2))
    );
    assert_eq!(bench.knob(), 0);
    bench.shelf.unwritable = Some(at(0x2050, 0));
    assert_eq!(
        bench.hear(0x401, &[1, 100], ms(1)),
        Some(Received::Refused(2))
    );
}

#[test]
fn an_rpdo_that_stays_away_is_told_once_after_the_first() {
    let mut bench = Bench::with_rpdo(255);
    bench.write(0x1400, 5, 10).unwrap();
    bench.pdo.start(ms(0));
    assert_eq!((bench.poll(ms(50)), bench.pdo.take_missed()), (None, None));
    bench.hear(0x201, &[1], ms(60));
    assert_eq!(bench.poll(ms(69)), Some(ms(70)));
    assert_eq!(bench.pdo.take_missed(), None);
    assert_eq!(bench.poll(ms(70)), None);
    assert_eq!(bench.pdo.take_missed(), Some(0));
    assert_eq!(bench.pdo.take_missed(), None);
    bench.hear(0x201, &[1], ms(80));
    assert_eq!(bench.poll(ms(80)), Some(ms(90)));
}
