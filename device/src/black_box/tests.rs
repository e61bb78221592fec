//! What a box holds after an event, and that its reader sees one event and never parts of two,
//! wherever the box is.

extern crate std;

use proptest::prelude::*;
use std::vec::Vec;

use super::*;

/// Time from SYNC to SYNC, us.
const PERIOD_US: u64 = 10_000;

/// A recorder at work: numbers its frames by SYNC, as its clock goes.
#[derive(Clone)]
struct Bench {
    recorder: BlackBox,
    now: Instant,
    sync: u32,
    /// What the memory has.
    memory: [Vec<u8>; 2],
    /// A complete box is in the memory before the next frame.
    stores: bool,
}

/// A box as a host reads it.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Seen {
    before: u8,
    period_us: u32,
    entry: Vec<u8>,
    syncs: Vec<u32>,
}

fn word(bytes: &[u8]) -> u32 {
    u32::from_le_bytes(bytes[..4].try_into().unwrap())
}

fn decode(bytes: &[u8]) -> Seen {
    assert_eq!(bytes[..2], [1, 34]);
    let frames = bytes[28..].chunks(34);
    assert_eq!(frames.len(), usize::from(bytes[2] + bytes[3]));
    Seen {
        before: bytes[2],
        period_us: word(&bytes[4..]),
        entry: bytes[8..28].to_vec(),
        syncs: frames.map(word).collect(),
    }
}

fn frame(sync: u32) -> Frame {
    let mut own = [0; 16];
    own[..4].copy_from_slice(&sync.to_le_bytes());
    Frame {
        own,
        peer: [sync as u8; 16],
        state: 0,
        blamed_reason: 0,
    }
}

fn entry(sync: u32) -> Entry {
    Entry {
        sync,
        code: 0xFF14,
        ..Entry::default()
    }
}

impl Bench {
    fn new() -> Self {
        Self {
            recorder: BlackBox::new(),
            now: Instant(1_000_000),
            sync: 0,
            memory: [Vec::new(), Vec::new()],
            stores: true,
        }
    }

    /// One whose memory has no room until [`Bench::store`].
    fn without_room() -> Self {
        Self {
            stores: false,
            ..Self::new()
        }
    }

    fn run(&mut self, frames: u32) {
        for _ in 0..frames {
            self.wait(PERIOD_US);
            self.sync += 1;
            self.recorder.record(&frame(self.sync), self.now);
            if self.stores {
                self.store();
            }
        }
    }

    /// The memory takes whatever is complete.
    fn store(&mut self) {
        while let Some(number) = self.recorder.next_unsaved(self.now) {
            let mut bytes = std::vec![0; BOX_LENGTH as usize + 1];
            let count = self.recorder.save_at(0, &mut bytes);
            bytes.truncate(count.unwrap());
            self.memory[place(number)] = bytes;
            self.recorder.saved(true);
        }
    }

    /// A reset: what the memory has is what there is.
    fn reset(&mut self) {
        self.recorder.clear();
        for number in 1..=2 {
            let memory = &self.memory[place(number)];
            self.recorder.restore(number, &mut stored(memory));
        }
    }

    fn wait(&mut self, us: u64) {
        self.now.0 += us;
    }

    fn trigger(&mut self) -> u8 {
        self.recorder.trigger(entry(self.sync), self.now)
    }

    fn read_on(&mut self, number: u8, bytes: &mut Vec<u8>, piece: usize) -> bool {
        let mut into = std::vec![0; piece];
        let offset = bytes.len() as u32;
        let memory = self.memory.get(place(number)).map_or(&[][..], |m| m);
        let now = self.now;
        let count = (self.recorder).read_at(number, offset, &mut into, now, &mut stored(memory));
        bytes.extend_from_slice(&into[..count]);
        count == piece
    }

    /// A whole box, read in one go and closed.
    fn read(&mut self, number: u8) -> Option<Vec<u8>> {
        let length = self.recorder.open(number, self.now)?;
        assert_eq!(length, self.recorder.length(number));
        let mut bytes = Vec::new();
        while self.read_on(number, &mut bytes, 889) {}
        self.recorder.close();
        assert_eq!(bytes.len(), length as usize);
        Some(bytes)
    }

    fn seen(&mut self, number: u8) -> Seen {
        decode(&self.read(number).unwrap())
    }
}

/// A box in the memory, to read from an offset.
fn stored(memory: &[u8]) -> impl FnMut(u32, &mut [u8]) -> usize {
    |offset, into| copy(memory, &[], offset, into)
}

fn syncs(range: core::ops::RangeInclusive<u32>) -> Vec<u32> {
    range.collect()
}

#[test]
fn each_field_stands_where_the_table_has_it() {
    let mut recorder = BlackBox::new();
    let told = Frame {
        own: core::array::from_fn(|n| n as u8),
        peer: core::array::from_fn(|n| 16 + n as u8),
        state: 32,
        blamed_reason: blamed_reason(2, 3),
    };
    recorder.record(&told, Instant(7));
    recorder.record(&told, Instant(0x2_0007));
    assert_eq!(recorder.trigger(entry(0x0403_0201), Instant(0x2_0007)), 1);
    recorder.record(&told, Instant(0x4_0007));
    let mut bytes = [0; 200];
    assert_eq!(recorder.open(1, Instant(0)), Some(28 + 3 * 34));
    assert_eq!(
        recorder.read_at(1, 0, &mut bytes, Instant(0), &mut stored(&[])),
        130
    );
    let head = [
        1, 34, 2, 1, 0, 0, 2, 0, 0, 0, 0, 0, 1, 2, 3, 4, 0x14, 0xFF, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0,
    ];
    assert_eq!(bytes[..28], head);
    for place in 0..3 {
        let frame = &bytes[28 + 34 * place..][..34];
        let expected: [u8; 34] = core::array::from_fn(|n| n as u8);
        assert_eq!(frame[..33], expected[..33]);
        assert_eq!(frame[33], 0x83);
    }
}

#[test]
fn a_box_holds_32_frames_before_and_16_after() {
    let mut bench = Bench::new();
    bench.run(100);
    assert_eq!(bench.trigger(), 1);
    bench.run(60);
    let seen = bench.seen(1);
    assert_eq!(seen.before, 32);
    assert_eq!(seen.syncs, syncs(69..=116));
    assert_eq!(seen.period_us, PERIOD_US as u32);
    let kept = Entry {
        box_number: 1,
        ..entry(100)
    };
    assert_eq!(seen.entry, kept.encode());
}

#[test]
fn an_early_event_has_fewer_frames_and_one_before_any_has_no_box() {
    let mut bench = Bench::new();
    assert_eq!(bench.trigger(), 0);
    assert_eq!(bench.recorder.boxes(), 0);
    bench.run(1);
    assert_eq!(bench.trigger(), 1);
    let alone = bench.seen(1);
    assert_eq!(
        (alone.before, alone.period_us, alone.syncs),
        (1, 0, syncs(1..=1))
    );
    bench.run(20);
    assert_eq!(bench.seen(1).syncs, syncs(1..=17));
}

#[test]
fn the_first_cause_stays_and_the_second_box_has_the_latest() {
    let mut bench = Bench::new();
    bench.run(40);
    assert_eq!(bench.trigger(), 1);
    bench.run(20);
    let first = bench.read(1);
    for last in [60, 100, 140] {
        assert_eq!(bench.trigger(), 2);
        bench.run(40);
        assert_eq!(bench.seen(2).syncs, syncs(last - 31..=last + 16));
    }
    assert_eq!(bench.read(1), first);
    assert_eq!(bench.recorder.boxes(), 2);
}

#[test]
fn an_event_while_a_box_is_filled_is_in_that_box() {
    let mut bench = Bench::new();
    bench.run(40);
    assert_eq!(bench.trigger(), 1);
    bench.run(15);
    assert_eq!(bench.trigger(), 1);
    bench.run(1);
    assert_eq!(bench.trigger(), 2);
    assert_eq!(
        bench.seen(1).entry,
        Entry {
            box_number: 1,
            ..entry(40)
        }
        .encode()
    );
}

#[test]
fn frames_from_before_a_long_silence_are_in_no_box() {
    let mut bench = Bench::new();
    bench.run(40);
    assert_eq!(bench.trigger(), 1);
    bench.run(3);
    bench.wait(BREAK_US as u64 + 1);
    bench.run(5);
    assert_eq!(bench.seen(1).syncs, syncs(9..=43));
    assert_eq!(bench.trigger(), 2);
    bench.run(16);
    assert_eq!(bench.seen(2).syncs, syncs(44..=64));
    bench.wait(BREAK_US as u64 + 1);
    assert_eq!(bench.trigger(), 0);
}

#[test]
fn a_sync_that_was_not_judged_does_not_pass_for_the_period() {
    let mut bench = Bench::new();
    bench.run(10);
    bench.wait(6 * PERIOD_US);
    bench.run(1);
    bench.trigger();
    assert_eq!(bench.seen(1).period_us, PERIOD_US as u32);
}

#[test]
fn a_box_is_empty_after_it_was_cleared_and_takes_the_next_event() {
    let mut bench = Bench::new();
    bench.run(40);
    bench.trigger();
    bench.run(5);
    bench.recorder.open(1, bench.now);
    bench.recorder.clear();
    assert!(!bench.read_on(1, &mut Vec::new(), 8));
    assert_eq!((bench.recorder.boxes(), bench.recorder.length(1)), (0, 0));
    assert_eq!(bench.read(1), None);
    bench.run(4);
    assert_eq!(bench.trigger(), 1);
    assert_eq!(bench.seen(1).syncs, syncs(46..=49));
}

#[test]
fn a_number_that_is_no_box_is_empty() {
    let mut bench = Bench::new();
    bench.run(40);
    bench.trigger();
    for number in [0, 2, 3, 255] {
        assert_eq!(bench.recorder.open(number, bench.now), None);
        assert_eq!(bench.recorder.length(number), 0);
        assert!(!bench.read_on(number, &mut Vec::new(), 8));
    }
}

/// Both boxes kept, and one piece of box 2 read.
fn half_read() -> (Bench, Vec<u8>) {
    let mut bench = Bench::new();
    for _ in 0..2 {
        bench.run(40);
        bench.trigger();
        bench.run(20);
    }
    bench.recorder.open(2, bench.now);
    let mut bytes = Vec::new();
    bench.read_on(2, &mut bytes, 500);
    (bench, bytes)
}

#[test]
fn no_event_takes_a_box_from_under_its_reader() {
    let (mut bench, mut bytes) = half_read();
    bench.run(100);
    assert_eq!(bench.trigger(), 0);
    bench.wait(LEASE_US as u64 - 100 * PERIOD_US);
    assert_eq!(bench.trigger(), 0);
    while bench.read_on(2, &mut bytes, 500) {}
    assert_eq!(decode(&bytes).syncs, syncs(69..=116));
    bench.recorder.close();
    assert_eq!(bench.trigger(), 2);
}

#[test]
fn a_reader_who_comes_back_late_gets_nothing_rather_than_half_of_each() {
    let (mut bench, mut bytes) = half_read();
    bench.run(LEASE_US as u32 / PERIOD_US as u32 + 1);
    assert_eq!(bench.trigger(), 2);
    assert!(!bench.read_on(2, &mut bytes, 500));
    assert_eq!(bytes.len(), 500);
    assert_eq!(bench.seen(2).syncs.last(), Some(&bench.sync));
}

#[test]
fn a_box_that_is_being_filled_is_read_as_it_was_when_opened() {
    let mut bench = Bench::new();
    bench.run(40);
    bench.trigger();
    bench.run(3);
    assert_eq!(bench.recorder.open(1, bench.now), Some(28 + 35 * 34));
    bench.run(30);
    let mut bytes = Vec::new();
    while bench.read_on(1, &mut bytes, 100) {}
    assert_eq!(decode(&bytes).syncs, syncs(9..=43));
    assert_eq!(bench.seen(1).syncs, syncs(9..=56));
}

#[test]
fn log_and_boxes_take_no_more_than_3_6_kb() {
    let both = size_of::<BlackBox>() + size_of::<crate::fault_log::FaultLog>();
    assert!(both <= 3600, "{both}");
}

#[test]
fn a_box_in_the_memory_is_the_same_and_comes_back_after_a_reset() {
    let mut bench = Bench::without_room();
    let mut held = Vec::new();
    for _ in 0..2 {
        bench.run(40);
        bench.trigger();
        bench.run(20);
        held.push(bench.read(held.len() as u8 + 1).unwrap());
        bench.store();
    }
    for _ in 0..2 {
        assert_eq!([1, 2].map(|n| bench.read(n).unwrap())[..], held);
        bench.reset();
    }
    // What is no box, or not a whole one, is none.
    bench.memory[0].pop();
    bench.memory[1][2] = 33;
    bench.reset();
    assert_eq!(bench.recorder.boxes(), 0);
}

#[test]
fn the_latest_event_is_held_where_the_memory_has_no_room() {
    let mut bench = Bench::new();
    bench.run(40);
    bench.trigger();
    bench.run(20);
    bench.stores = false;
    for last in [60, 100, 140] {
        assert_eq!(bench.trigger(), 2);
        bench.run(40);
        assert_eq!(bench.seen(2).syncs, syncs(last - 31..=last + 16));
    }
    assert_eq!(bench.seen(1).syncs, syncs(9..=56));
    bench.store();
    bench.reset();
    assert_eq!(bench.seen(2).syncs, syncs(109..=156));
}

#[test]
fn an_event_before_the_first_box_is_stored_has_half_of_what_was_before_it_at_least() {
    for frames in 0..60 {
        let mut bench = Bench::without_room();
        bench.run(40);
        assert_eq!(bench.trigger(), 1);
        bench.run(30);
        let first = bench.read(1);
        assert_eq!(bench.trigger(), 2);
        bench.run(frames);
        assert_eq!(bench.trigger(), if frames < 16 { 2 } else { 0 });
        assert_eq!((bench.read(1), bench.read(2)), (first.clone(), None));
        bench.store();
        bench.run(60);
        bench.store();
        let until = frames.min(16);
        assert_eq!(bench.seen(2).syncs, syncs(39 + until..=86), "{frames}");
        assert_eq!(u32::from(bench.seen(2).before), 32 - until);
        assert_eq!(bench.read(1), first);
        assert_eq!(bench.trigger(), 2);
        bench.run(16);
        let end = bench.sync;
        assert_eq!(bench.seen(2).syncs, syncs(end - 47..=end));
    }
}

#[test]
fn a_silence_closes_a_box_that_waits() {
    let mut bench = Bench::without_room();
    bench.run(40);
    bench.trigger();
    bench.run(16);
    assert_eq!(bench.trigger(), 2);
    bench.run(5);
    bench.wait(BREAK_US as u64 + 1);
    assert_eq!(bench.trigger(), 0);
    bench.run(5);
    bench.store();
    assert_eq!(bench.seen(2).syncs, syncs(30..=61));
    assert_eq!(bench.trigger(), 0, "nothing is recorded while it waits");
    bench.run(3);
    assert_eq!(bench.trigger(), 2);
    assert_eq!(bench.seen(2).syncs, syncs(67..=69));
}

#[test]
fn a_memory_that_takes_nothing_leaves_the_first_event_and_no_room_for_others() {
    let mut bench = Bench::without_room();
    bench.run(40);
    bench.trigger();
    bench.run(16);
    assert_eq!(bench.recorder.next_unsaved(bench.now), Some(1));
    bench.recorder.saved(false);
    let first = bench.read(1);
    assert_eq!(bench.recorder.next_unsaved(bench.now), None);
    assert_eq!(bench.trigger(), 2);
    bench.run(60);
    assert_eq!(bench.trigger(), 0);
    assert_eq!((bench.read(1), bench.read(2)), (first, None));
}

#[test]
fn a_box_goes_into_the_memory_under_its_reader() {
    for when in 0..1661 {
        let mut bench = Bench::without_room();
        bench.run(40);
        bench.trigger();
        bench.run(7);
        let whole = bench.read(1).unwrap();
        bench.recorder.open(1, bench.now);
        let mut bytes = Vec::new();
        bench.read_on(1, &mut bytes, when % whole.len());
        bench.run(9);
        bench.store();
        while bench.read_on(1, &mut bytes, 100) {}
        assert_eq!(bytes, whole, "{when}");
        assert_eq!(bench.seen(1).syncs, syncs(9..=56));
    }
}

/// What may happen to a recorder.
#[derive(Clone, Copy, Debug)]
enum Step {
    Run(u32),
    Wait(u64),
    Trigger,
    Open(u8),
    Read(u8, usize),
    Store,
    Stores(bool),
    Clear,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        6 => (1..60_u32).prop_map(Step::Run),
        1 => (0..8_000_000_u64).prop_map(Step::Wait),
        5 => Just(Step::Trigger),
        2 => (0..4_u8).prop_map(Step::Open),
        6 => ((0..4_u8), (1..900_usize)).prop_map(|(number, piece)| Step::Read(number, piece)),
        3 => Just(Step::Store),
        2 => any::<bool>().prop_map(Step::Stores),
        1 => Just(Step::Clear),
    ]
}

/// A box has one event: frames in a row, without a long silence, up to and after its SYNC.
fn is_whole(seen: &Seen, times: &[Instant]) {
    let at = word(&seen.entry[4..]);
    let first = at + 1 - u32::from(seen.before);
    let expected: Vec<u32> = (first..).take(seen.syncs.len()).collect();
    assert_eq!(seen.syncs, expected);
    let gaps = expected.windows(2).map(|pair| {
        let [a, b] = [pair[0], pair[1]].map(|sync| times[sync as usize]);
        b.micros_since(a)
    });
    gaps.for_each(|gap| assert!(gap <= BREAK_US));
}

/// A reader in the middle of a box, and what it should get in the end.
struct Reader {
    number: u8,
    whole: Vec<u8>,
    got: Vec<u8>,
}

impl Reader {
    fn open(bench: &mut Bench, number: u8) -> Option<Self> {
        let whole = bench.read(number)?;
        bench.recorder.open(number, bench.now);
        Some(Self {
            number,
            whole,
            got: Vec::new(),
        })
    }

    /// Whatever has happened meanwhile, what comes is the next of the box that was opened.
    fn read(&mut self, bench: &mut Bench, piece: usize) {
        bench.read_on(self.number, &mut self.got, piece);
        assert!(self.whole.starts_with(&self.got));
    }
}

proptest! {
    #[test]
    fn a_box_always_holds_the_frames_around_its_event(
        steps in proptest::collection::vec(step(), 0..80),
    ) {
        let mut bench = Bench::new();
        let (mut times, mut reader) = (std::vec![Instant(0)], None::<Reader>);
        for step in steps {
            match step {
                Step::Run(frames) => (0..frames).for_each(|_| {
                    bench.run(1);
                    times.push(bench.now);
                }),
                Step::Wait(us) => bench.wait(us),
                Step::Trigger => {
                    let number = bench.trigger();
                    let waits = bench.recorder.waiting.is_some();
                    prop_assert!(number == 0 || waits || bench.recorder.length(number) > 28);
                }
                Step::Open(number) => reader = Reader::open(&mut bench, number),
                Step::Read(number, piece) => match &mut reader {
                    Some(reader) => reader.read(&mut bench, piece),
                    None => prop_assert!(!bench.read_on(number, &mut Vec::new(), piece)),
                },
                Step::Store => bench.store(),
                Step::Stores(stores) => bench.stores = stores,
                Step::Clear => bench.recorder.clear(),
            }
            // The recorder is looked into by a second bench, so that the reader isn't disturbed.
            let mut other = bench.clone();
            for number in 1..=2 {
                other.read(number).iter().for_each(|bytes| is_whole(&decode(bytes), &times));
            }
        }
    }
}
