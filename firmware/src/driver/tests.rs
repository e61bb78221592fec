//! A driver with a level part and a controller that only notes what it is told.

use core::convert::Infallible;
use std::vec;
use std::vec::Vec;

use device::fault::Fault;
use device::mailboxes::{Abort, MAILBOXES};
use device::memory::update::Anybody;
use device::memory::{Build, FlashMemory};
use device::objects::table::Channel;
use device::sensor::Lis2dw12;
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use flash::layout::{PAGE, Slot};
use flash::nor::{Draw, Nor, Page};
use tilt::composition::Whole;
use tilt::cross_check::CrossCheck;

use super::*;
use crate::factory::product;
use crate::inbox::Inbox;
use crate::part::LAYOUT;

/// The registers of a part that is always ready and lies level.
struct Wire([u8; 64]);

impl ErrorType for Wire {
    type Error = Infallible;
}

impl SpiDevice for Wire {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        let mut address = 0;
        for operation in operations {
            match operation {
                Operation::Write(bytes) => {
                    let [first, values @ ..] = &**bytes else {
                        continue;
                    };
                    address = usize::from(first & 0x3F);
                    for (at, value) in (address..).zip(values) {
                        // CTRL2: boot and soft reset end at once.
                        self.0[at] = if at == 0x21 { value & !0xC0 } else { *value };
                    }
                }
                Operation::Read(bytes) => {
                    // A part whose codes stand still is no part.
                    for low in [0x28, 0x2A, 0x2C] {
                        self.0[low] = self.0[low].wrapping_add(0x54);
                    }
                    bytes.copy_from_slice(&self.0[address..address + bytes.len()]);
                }
                other => panic!("the driver does not use {other:?}"),
            }
        }
        Ok(())
    }
}

/// Bits after a cut, of which there is none.
struct Zeros;

impl Draw for Zeros {
    fn draw(&mut self) -> u32 {
        0
    }
}

type Memory = FlashMemory<Nor<Vec<Page>, Zeros>>;

/// A flash from which everything was erased.
fn memory() -> Memory {
    let pages = vec![Page::new(); (LAYOUT.flash / PAGE) as usize];
    let build = Build {
        layout: &LAYOUT,
        running: Slot::A,
        hardware: LAYOUT.hardware,
    };
    FlashMemory::new(Nor::new(pages, Zeros), build, Anybody)
}

struct Hurry;

impl DelayNs for Hurry {
    fn delay_ns(&mut self, _: u32) {}
}

/// What the controller was told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    Post(u8, u16),
    Abort(u8),
    Clear,
    Recover,
    Rate(u16, bool),
    ListenTo(u8),
}

/// Notes everything; frames stay where they are until the test moves them.
#[derive(Default)]
struct Notes {
    told: Vec<Told>,
    posted: [bool; MAILBOXES],
    on_wire: Option<u8>,
}

impl Transmitter for Notes {
    fn post(&mut self, place: u8, frame: &Frame) {
        self.posted[usize::from(place)] = true;
        self.told.push(Told::Post(place, frame.cob_id().unwrap()));
    }

    fn abort(&mut self, place: u8) -> Abort {
        self.told.push(Told::Abort(place));
        match self.on_wire == Some(place) {
            true => Abort::Later,
            false => {
                self.posted[usize::from(place)] = false;
                Abort::Done
            }
        }
    }

    fn clear(&mut self) {
        self.posted = [false; MAILBOXES];
        self.told.push(Told::Clear);
    }
}

impl Controller for Notes {
    fn recover(&mut self) {
        self.told.push(Told::Recover);
    }

    fn set_rate(&mut self, kbit_s: u16, listen_only: bool) {
        self.told.push(Told::Rate(kbit_s, listen_only));
    }

    fn listen_to(&mut self, node_id: u8) {
        self.told.push(Told::ListenTo(node_id));
    }
}

struct Bench {
    driver: Driver,
    device: Device<Lis2dw12<Wire>, Memory>,
    can: Notes,
    now: Instant,
}

impl Bench {
    /// Node 1, just started.
    fn booting() -> Self {
        let mut registers = [0; 64];
        (registers[0x0F], registers[0x27], registers[0x2D]) = (0x44, 0x01, 0x40);
        let factory = product(Channel::A, 7);
        let check = CrossCheck::product();
        let mut bench = Self {
            driver: Driver::new(),
            device: Device::new(Lis2dw12::new(Wire(registers)), check, factory, memory()),
            can: Notes::default(),
            now: Instant(1000),
        };
        bench.device.start_sensor(&mut Hurry, bench.now).unwrap();
        let now = bench.now;
        bench.at().start(now);
        let told = [
            Told::Rate(250, false),
            Told::Post(0, 0x701),
            Told::ListenTo(1),
        ];
        assert_eq!(bench.said(), told);
        bench
    }

    /// The same; its boot-up message has gone out, and the EMCY that reports that it is not
    /// calibrated.
    fn started() -> Self {
        let mut bench = Self::booting();
        bench.event(Event::Sent(0));
        assert_eq!(bench.said(), [Told::Post(0, 0x81)]);
        bench.empty();
        bench
    }

    /// The same in OPERATIONAL, with samples.
    fn measuring() -> Self {
        let mut bench = Self::started();
        bench.hear(0, &[1, 0]);
        bench.pass(1_000_000);
        bench.empty();
        bench
    }

    fn at(&mut self) -> DriverCall<'_, Lis2dw12<Wire>, Memory, Notes, Whole> {
        self.driver.at(&mut self.device, &mut self.can)
    }

    fn said(&mut self) -> Vec<Told> {
        core::mem::take(&mut self.can.told)
    }

    fn event(&mut self, event: Event) {
        if let Event::Sent(place) | Event::GivenUp(place) = event {
            self.can.posted[usize::from(place)] = false;
        }
        let now = self.now;
        self.at().event(event, now);
    }

    fn hear(&mut self, id: u16, bytes: &[u8]) {
        self.event(Event::Received(Frame::data_frame(id, bytes)));
    }

    /// Lets everything out that waits.
    fn empty(&mut self) {
        while let Some(place) = self.can.posted.iter().position(|posted| *posted) {
            self.event(Event::Sent(place as u8));
        }
        self.said();
    }

    /// Serves all that is in the inbox or due at `now`, as the task does.
    fn serve(&mut self, inbox: &mut Inbox, now: Instant) {
        self.now = now;
        while self.at().step(now, |until| inbox.take(until)).is_none() {}
    }

    /// Time goes by, with a sample every 2.5 ms.
    fn pass(&mut self, us: u64) {
        let end = Instant(self.now.0 + us);
        while self.now < end {
            let edge = Instant((self.now.0 / 2500 + 1) * 2500).min(end);
            while self.at().next() <= edge {
                let next = self.at().next();
                assert!(next >= self.now, "time goes forward");
                self.now = next;
                self.at().poll(next);
            }
            self.now = edge;
            self.at().data_ready(edge);
        }
    }
}

#[test]
fn an_angle_that_has_missed_its_sync_is_taken_back_and_the_next_one_goes() {
    let mut bench = Bench::measuring();
    bench.hear(0x80, &[]);
    let first = bench.said();
    let place = first.iter().position(|told| *told == Told::Post(0, 0x181));
    assert_eq!(place, Some(0), "{first:?}");
    bench.pass(10_000);
    bench.said();
    bench.hear(0x80, &[]);
    let second = bench.said();
    let abort = second.iter().position(|told| *told == Told::Abort(0));
    let again = second.iter().position(|told| *told == Told::Post(0, 0x181));
    assert!(abort.is_some() && again > abort, "{second:?}");
}

#[test]
fn a_frame_on_the_wire_keeps_its_mailbox_until_the_controller_tells() {
    for outcome in [Event::Sent(0), Event::GivenUp(0)] {
        let mut bench = Bench::measuring();
        bench.hear(0x80, &[]);
        bench.pass(10_000);
        bench.can.on_wire = Some(0);
        bench.said();
        bench.hear(0x80, &[]);
        let told = bench.said();
        assert!(told.contains(&Told::Abort(0)), "{told:?}");
        assert!(!told.contains(&Told::Post(0, 0x181)), "{told:?}");
        bench.event(outcome);
        let told = bench.said();
        let next = told.iter().any(|told| matches!(told, Told::Post(_, 0x181)));
        assert!(next, "{outcome:?}: {told:?}");
    }
}

#[test]
fn an_emcy_waited_behind_three_frames_that_it_outranks() {
    let mut bench = Bench::started();
    bench.hear(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    bench.hear(0x7E5, &[0x5E, 0, 0, 0, 0, 0, 0, 0]);
    bench.pass(200_000);
    bench.hear(0x601, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]);
    let low = [
        Told::Post(0, 0x7E4),
        Told::Post(1, 0x701),
        Told::Post(2, 0x581),
    ];
    assert_eq!(bench.said(), low);
    // A SYNC with a counter, which nobody has announced.
    bench.hear(0x80, &[1]);
    assert_eq!(bench.said(), [Told::Abort(0), Told::Post(0, 0x81)]);
    bench.event(Event::Sent(0));
    assert_eq!(bench.said(), []);
    bench.event(Event::Sent(2));
    assert_eq!(bench.said(), [Told::Post(0, 0x7E4)]);
}

#[test]
fn a_boot_up_message_that_bus_off_took_was_never_sent_again() {
    let mut bench = Bench::booting();
    bench.event(Event::Changed(ErrorState::Off, 255, 0));
    assert_eq!(bench.said(), [Told::Clear, Told::Post(0, 0x701)]);
    bench.event(Event::Sent(0));
    assert_eq!(bench.said(), [Told::Post(0, 0x81)]);
    bench.empty();
    bench.event(Event::Changed(ErrorState::Off, 255, 0));
    assert_eq!(bench.said(), [Told::Clear]);
}

#[test]
fn bus_off_empties_the_mailboxes_and_lasts_until_the_device_ends_it() {
    let mut bench = Bench::measuring();
    bench.hear(0x80, &[]);
    bench.said();
    bench.event(Event::Changed(ErrorState::Off, 255, 0));
    assert_eq!(bench.said().first(), Some(&Told::Clear));
    let wait_us = bench.device.recovery(bench.now).unwrap().0 - bench.now.0;
    bench.pass(wait_us - 1);
    assert!(!bench.said().contains(&Told::Recover));
    bench.pass(1);
    assert!(bench.said().contains(&Told::Recover));
}

#[test]
fn a_new_bit_rate_comes_after_silence_and_before_silence() {
    let mut bench = Bench::started();
    bench.hear(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    bench.hear(0x7E5, &[19, 0, 2, 0, 0, 0, 0, 0]);
    bench.empty();
    bench.pass(100_000);
    bench.empty();
    bench.hear(0x7E5, &[21, 10, 0, 0, 0, 0, 0, 0]);
    bench.said();
    bench.pass(9_999);
    assert_eq!(bench.said(), []);
    bench.pass(1);
    assert_eq!(bench.said(), [Told::Rate(500, false)]);
    bench.hear(0x601, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]);
    bench.pass(9_999);
    assert_eq!(bench.said(), []);
    bench.pass(1);
    assert_eq!(bench.said(), [Told::Post(0, 0x581)]);
}

#[test]
fn the_controller_listens_to_the_node_id_of_now() {
    let mut bench = Bench::started();
    bench.hear(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    bench.hear(0x7E5, &[17, 5, 0, 0, 0, 0, 0, 0]);
    bench.hear(0x7E5, &[4, 0, 0, 0, 0, 0, 0, 0]);
    bench.empty();
    bench.hear(0, &[130, 1]);
    assert!(bench.said().contains(&Told::ListenTo(5)));
    bench.hear(0, &[130, 5]);
    assert!(
        !bench
            .said()
            .iter()
            .any(|told| matches!(told, Told::ListenTo(_)))
    );
}

#[test]
fn a_reset_over_the_bus_is_the_boards_business() {
    let mut bench = Bench::measuring();
    assert_eq!(bench.driver.take_action(), None);
    bench.hear(0, &[129, 1]);
    assert_eq!(bench.driver.take_action(), Some(BoardAction::Reset));
    assert_eq!(bench.driver.take_action(), None);
}

#[test]
fn an_event_late_by_a_stall_does_not_turn_time_back() {
    let mut bench = Bench::measuring();
    let before = bench.now;
    bench.pass(30_000);
    bench.at().event(Event::Sent(0), before);
    let next = bench.at().next();
    assert!(next >= bench.now, "{next:?}");
    assert_eq!(vec![bench.driver.reached], vec![bench.now]);
}

#[test]
fn after_erases_the_sensor_was_called_silent_at_instants_that_were_over() {
    let mut bench = Bench::measuring();
    let faults: Vec<_> = bench.device.faults().iter().collect();
    assert_eq!(faults, [Fault::NotCalibrated]);
    // The processor stands still; the last edge of that time is kept.
    let mut inbox = Inbox::new();
    inbox.edge(Instant(bench.now.0 + 129_000));
    let over = Instant(bench.now.0 + 130_000);
    bench.serve(&mut inbox, over);
    for edge in 1..20 {
        let now = Instant(over.0 - 1_000 + edge * 2_500);
        inbox.edge(now);
        bench.serve(&mut inbox, now);
    }
    let told = bench.said();
    let emergency = told.iter().any(|told| matches!(told, Told::Post(_, 0x81)));
    assert!(!emergency, "{told:?}");
}

#[test]
fn what_is_due_just_now_is_done_at_its_own_instant() {
    let now = Instant(100_000);
    assert_eq!(punctual(Instant(98_000), now), Instant(98_000));
    assert_eq!(punctual(Instant(97_999), now), now);
    assert_eq!(punctual(Instant(u64::MAX), now), Instant(u64::MAX));
}

#[test]
fn the_sensor_was_blamed_for_the_time_that_the_processor_stood_still() {
    let mut bench = Bench::measuring();
    bench.hear(0, &[0x80, 1]);
    bench.pass(100_000);
    let silent = |bench: &Bench| bench.device.faults().has(Fault::SensorSilent);
    // An edge has just replaced the one before it, and a frame has come between the two.
    let later = |us| Instant(bench.now.0 + us);
    let [frame, edge, end] = [later(40_010), later(40_020), later(40_030)];
    let mut inbox = Inbox::new();
    inbox.put(Event::Received(Frame::data_frame(0x80, &[])), frame);
    inbox.edge(edge);
    bench.serve(&mut inbox, end);
    assert!(!silent(&bench));
    bench.pass(100_000);
    assert!(!silent(&bench));
    // One that really is silent is found though page after page is erased.
    for _ in 0..2 {
        assert!(!silent(&bench));
        for us in [40_000, 1000] {
            let end = Instant(bench.now.0 + us);
            bench.serve(&mut inbox, end);
        }
    }
    assert!(silent(&bench));
}

/// A save programs for some tens of ms, and behind it a page is erased: two standstills with one
/// sample between them, and a frame that has come just before the last edge.
#[test]
fn the_second_standstill_of_a_save_made_a_silent_sensor() {
    for edge_us in (0..2_500).step_by(50) {
        for erase_us in [20_000, 40_000] {
            let mut bench = Bench::measuring();
            bench.hear(0, &[0x80, 1]);
            bench.pass(100_000);
            let mut inbox = Inbox::new();
            let saved = Instant(bench.now.0 + 39_000);
            inbox.edge(Instant(saved.0 - edge_us));
            bench.serve(&mut inbox, saved);
            let erased = Instant(saved.0 + erase_us);
            let sync = Event::Received(Frame::data_frame(0x80, &[]));
            inbox.put(sync, erased);
            inbox.edge(Instant(erased.0 + 500));
            bench.serve(&mut inbox, Instant(erased.0 + 800));
            bench.pass(30_000);
            let told = bench.said();
            let emergency = told.iter().any(|told| matches!(told, Told::Post(_, 0x81)));
            assert!(!emergency, "{edge_us}, {erase_us}: {told:?}");
        }
    }
}
