//! The device's frames in the mailboxes of a controller that is played: what goes out and in which
//! order, while frames are taken back, fail on the wire, or bus-off takes them all.

use std::collections::BTreeMap;

use crate::site::Site;
use canopen::Frame;
use canopen::node::BusState;
use device::mailboxes::{Abort, MAILBOXES, Mailboxes, Transmitter};
use device::objects::table::Channel;
use device::sensor::Config;
use instant::Instant;

const EMCY: u16 = 0x81;
const SDO: u16 = 0x581;
const HEARTBEAT: u16 = 0x701;
const LSS: u16 = 0x7E4;

/// A controller: what is in its mailboxes, and which of them is on the wire.
#[derive(Default)]
struct Controller {
    places: [Option<Frame>; MAILBOXES],
    on_wire: Option<u8>,
    /// It is not repeated when it fails.
    once: bool,
    aborts: u32,
    /// By identifier: handed over and neither gone nor lost.
    outstanding: BTreeMap<u16, Frame>,
}

fn id(frame: &Frame) -> u16 {
    frame.cob_id().unwrap()
}

/// What is told once, or asked for once: no newer frame takes its place.
fn is_lasting(id: u16) -> bool {
    [EMCY, SDO, HEARTBEAT, LSS].contains(&id)
}

impl Transmitter for Controller {
    fn post(&mut self, place: u8, frame: &Frame) {
        let mailbox = &mut self.places[usize::from(place)];
        assert!(mailbox.is_none(), "mailbox {place} is in use");
        *mailbox = Some(*frame);
        let id = id(frame);
        let twins = self
            .places
            .iter()
            .flatten()
            .filter(|f| f.id() == frame.id());
        assert_eq!(twins.count(), 1, "{id:X}h twice");
        let before = self.outstanding.insert(id, *frame);
        let replaced = before.filter(|before| is_lasting(id) && before != frame);
        assert_eq!(replaced, None, "{frame:?} overtook what had been taken out");
    }

    fn abort(&mut self, place: u8) -> Abort {
        self.aborts += 1;
        if self.on_wire == Some(place) {
            self.once = true;
            return Abort::Later;
        }
        assert!(self.places[usize::from(place)].take().is_some());
        Abort::Done
    }

    fn clear(&mut self) {
        *self = Self {
            aborts: self.aborts,
            ..Self::default()
        };
    }
}

/// Node 1 with a driver around it.
struct Bench {
    site: Site,
    mailboxes: Mailboxes,
    can: Controller,
    now: Instant,
    next_sample: Instant,
    gone: Vec<Frame>,
}

impl Bench {
    fn new() -> Self {
        let site = Site::new(Channel::A);
        let now = Instant(2_000_000);
        Self {
            site,
            mailboxes: Mailboxes::new(),
            can: Controller::default(),
            now,
            next_sample: now,
            gone: Vec::new(),
        }
    }

    fn fill(&mut self) {
        let device = &mut self.site.device;
        self.mailboxes.fill(device, &mut self.can, false, self.now);
        // What waits outranks nothing that is there, or something is about to leave.
        let waiting = device.waiting(self.now).map(|waiting| waiting.cob_id);
        let first = self.can.places.iter().flatten().map(id).min();
        if let (Some(waiting), false) = (waiting, self.can.once) {
            assert!(first <= Some(waiting), "{waiting:X}h behind {first:X?}");
        }
    }

    fn hear(&mut self, id: u16, bytes: &[u8]) {
        let frame = Frame::data_frame(id, bytes);
        self.site.device.receive(&frame, self.now);
        self.poll();
    }

    fn ask_lss(&mut self) {
        self.hear(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
        self.hear(0x7E5, &[0x5E, 0, 0, 0, 0, 0, 0, 0]);
    }

    fn ask_sdo(&mut self) {
        self.hear(0x601, &[0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
    }

    fn fault(&mut self) {
        self.site.device.frames_lost(1, self.now);
        self.poll();
    }

    fn poll(&mut self) {
        if self.site.device.next_deadline() <= self.now {
            self.site.device.poll(self.now);
        }
        self.fill();
    }

    /// Time with its samples.
    fn pass(&mut self, us: i64) {
        let until = self.now.offset(us);
        while self.now < until {
            self.now = self.next_sample.min(until);
            if self.now == self.next_sample {
                let period = i64::from(Config::PRODUCT.rate.period_us());
                self.next_sample = self.now.offset(period);
                self.site.device.data_ready(self.now);
            }
            self.poll();
        }
    }

    /// The frame that wins goes onto the wire, if none is there.
    fn begin(&mut self) {
        let posted = (0..).zip(&self.can.places);
        let posted = posted.filter_map(|(place, frame)| Some((id(frame.as_ref()?), place)));
        let first = posted.min().map(|(_, place)| place);
        self.can.on_wire = self.can.on_wire.or(first);
    }

    /// The frame on the wire has gone out, or has failed.
    fn end(&mut self, sent: bool) {
        let Some(place) = self.can.on_wire.take() else {
            return;
        };
        let once = std::mem::take(&mut self.can.once);
        let device = &mut self.site.device;
        if sent {
            let frame = *self.mailboxes.sent(place).unwrap();
            assert_eq!(self.can.places[usize::from(place)].take(), Some(frame));
            self.can.outstanding.remove(&id(&frame));
            device.sent(&frame, self.now);
            self.gone.push(frame);
        } else if once {
            self.can.places[usize::from(place)] = None;
            self.mailboxes.given_up(place, device, self.now);
        }
        self.poll();
    }

    /// Everything goes out that waits, one frame after the other.
    fn drain(&mut self) -> Vec<u16> {
        let before = self.gone.len();
        loop {
            self.begin();
            if self.can.on_wire.is_none() {
                break;
            }
            self.end(true);
        }
        self.gone.iter().skip(before).map(id).collect()
    }

    fn goes_off(&mut self) {
        self.mailboxes.clear(&mut self.can);
        for state in [BusState::Off, BusState::Active] {
            self.site.device.bus_state(state, 0, 0, self.now);
            self.poll();
        }
    }

    /// LSS, heartbeat and SDO, in the order in which all three get a mailbox.
    fn with_three_low_frames() -> Self {
        let mut bench = Self::new();
        bench.poll();
        bench.drain();
        bench.ask_lss();
        bench.pass(200_000);
        bench.ask_sdo();
        let posted = bench.can.places.map(|frame| frame.as_ref().map(id));
        assert_eq!(posted, [Some(LSS), Some(HEARTBEAT), Some(SDO)]);
        bench
    }
}

#[test]
fn an_emcy_waited_behind_three_frames_that_it_outranks() {
    let mut bench = Bench::with_three_low_frames();
    bench.fault();
    bench.begin();
    bench.end(true);
    let last = bench.gone.last().map(id);
    assert_eq!((last, bench.can.aborts), (Some(EMCY), 1));
    // And nothing of the others is lost, or comes twice.
    assert_eq!(bench.drain(), [SDO, HEARTBEAT, LSS]);
}

#[test]
fn a_frame_on_the_wire_that_has_to_make_room_goes_out_now_or_later() {
    for sent in [true, false] {
        let mut bench = Bench::with_three_low_frames();
        // The LSS answer is on the wire: the others were posted after it had begun.
        bench.can.on_wire = Some(0);
        bench.fault();
        bench.fault();
        assert_eq!(bench.can.aborts, 1);
        bench.end(sent);
        let order: &[u16] = match sent {
            true => &[EMCY, EMCY, SDO, HEARTBEAT],
            false => &[EMCY, EMCY, SDO, HEARTBEAT, LSS],
        };
        assert_eq!(bench.drain(), order, "{sent}");
    }
}

#[test]
fn a_restart_whose_answer_bus_off_took_was_never_done() {
    let mut bench = Bench::new();
    bench.poll();
    bench.drain();
    bench.hear(0x601, &[0x2F, 0x51, 0x1F, 1, 2, 0, 0, 0]);
    assert_eq!(bench.site.device.take_request(), None);
    bench.goes_off();
    let wish = bench.site.device.take_request();
    assert_eq!(wish, Some(device::device::BoardRequest::Reset));
}

/// xorshift: enough for choosing what happens.
fn roll(state: &mut u64, below: u64) -> u64 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    (*state >> 16) % below
}

#[test]
fn whatever_the_controller_does_no_frame_is_lost_doubled_or_overtaken_by_its_successor() {
    let (mut aborts, mut gone) = (0, BTreeMap::<u16, usize>::new());
    for seed in 1..=40 {
        let mut dice = seed << 32 | 0x7F4A_7C15;
        let mut bench = Bench::new();
        bench.poll();
        bench.hear(0, &[if seed % 2 == 0 { 1 } else { 128 }, 0]);
        for _ in 0..2000 {
            match roll(&mut dice, 24) {
                0..=2 => bench.hear(0x80, &[]),
                3..=5 => bench.ask_sdo(),
                6 => bench.ask_lss(),
                7 => bench.fault(),
                8 if roll(&mut dice, 20) == 0 => bench.goes_off(),
                8..=12 => bench.pass(1 + roll(&mut dice, 30_000) as i64),
                13..=17 => bench.begin(),
                18..=20 => bench.end(false),
                _ => bench.end(true),
            }
        }
        bench.drain();
        let lost: Vec<_> = bench.can.outstanding.keys().collect();
        let lost: Vec<_> = lost.into_iter().filter(|id| is_lasting(**id)).collect();
        assert!(lost.is_empty(), "seed {seed}: {lost:X?}");
        aborts += bench.can.aborts;
        for frame in &bench.gone {
            *gone.entry(id(frame)).or_default() += 1;
        }
    }
    assert!(aborts > 100, "{aborts}");
    for id in [EMCY, 0x181, 0x381, 0x481, SDO, HEARTBEAT, LSS] {
        assert!(gone.get(&id).is_some_and(|count| *count > 9), "{gone:X?}");
    }
}
