//! What interrupts leave for the device's task, to be taken out in the order of its times.
//!
//! In: the controller's events and data-ready edges, each with its time. Out: the earliest of them.
//! An event that would not fit is counted: the device tells the bus how many frames were lost.
//!
//! The room kept free for what frames must not push out is never used up: each mailbox has one
//! event at a time, and a new error state is taken only when there is room.

use canopen::Frame;
use canopen::frame::{ExtendedId, Id, standard};
use device::mailboxes::MAILBOXES;
use heapless::Deque;
use instant::Instant;

use crate::driver::{ErrorState, Event};

/// Frames that are kept while the task is busy; the longest it ever is are the 20 ms of setting the
/// sensor up anew, and the erases of a store.
///
/// At 250 kbit/s 64 frames of eight bytes take 31 ms at least, at 1 Mbit/s 7 ms.
const FRAMES: u16 = 64;

/// Events that are kept.
const EVENTS: usize = FRAMES as usize + RESERVED;

/// Places that received frames do not get: one for each mailbox and one for the error state.
const RESERVED: usize = MAILBOXES + 1;

/// Something that has happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// Data-ready rose.
    Edge,
    /// The CAN controller has seen something.
    Bus(Event),
}

/// Bits of an event's time that are kept, in us: they are unmistakable for 268 s, and nothing waits
/// for more than seconds.
const TIME_BITS: u32 = 28;
/// [`Waiting::what`] is no identifier but one of the events below, with its numbers.
const OTHER: u32 = 1 << 31;
/// The identifier has 29 bits.
const EXTENDED: u32 = 1 << 30;
/// The frame is a remote one.
const REMOTE: u32 = 1 << 29;
/// The number of [`Event::Sent`] among others.
const SENT: u8 = 0;
/// The same of [`Event::GivenUp`].
const GIVEN_UP: u8 = 1;
/// The same of [`Event::Changed`].
const CHANGED: u8 = 2;

/// An event as it waits: 16 bytes, of which there are many, instead of 32 with its whole time.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    /// The identifier with its flags; of another event three numbers above [`OTHER`]'s kind.
    what: u32,
    /// The lower [`TIME_BITS`] of its time, us, and above them the length of the frame.
    at: u32,
    data: [u8; 8],
}

const _: () = assert!(size_of::<Waiting>() == 16);

impl Waiting {
    fn new(event: Event, at: Instant) -> Self {
        let other = |kind, a, b, c| (OTHER | u32::from_le_bytes([a, b, c, kind]), 0, [0; 8]);
        let (what, length, data) = match event {
            Event::Received(frame) => {
                let id = match frame.id() {
                    Id::Standard(id) => u32::from(id.as_raw()),
                    Id::Extended(id) => id.as_raw() | EXTENDED,
                };
                let remote = if frame.is_remote() { REMOTE } else { 0 };
                (id | remote, frame.length() as u32, frame.padded())
            }
            Event::Sent(place) => other(SENT, place, 0, 0),
            Event::GivenUp(place) => other(GIVEN_UP, place, 0, 0),
            Event::Changed(state, transmit, receive) => {
                other(CHANGED, state as u8, transmit, receive)
            }
        };
        let at = at.0 as u32 & !(u32::MAX << TIME_BITS) | length << TIME_BITS;
        Self { what, at, data }
    }

    fn event(&self) -> Event {
        if self.what & OTHER == 0 {
            return Event::Received(self.frame());
        }
        let [a, b, c, kind] = (self.what & !OTHER).to_le_bytes();
        match kind {
            SENT => Event::Sent(a),
            GIVEN_UP => Event::GivenUp(a),
            _ => Event::Changed(ErrorState::from_number(a), b, c),
        }
    }

    fn frame(&self) -> Frame {
        let number = self.what & !(EXTENDED | REMOTE);
        let id = match ExtendedId::new(number) {
            Some(id) if self.what & EXTENDED != 0 => Id::Extended(id),
            _ => Id::Standard(standard(number as u16)),
        };
        let is_remote = self.what & REMOTE != 0;
        Frame::of_parts(id, is_remote, (self.at >> TIME_BITS) as u8, self.data)
    }
}

/// Events and edges that nobody has looked at.
#[derive(Debug)]
pub struct Inbox {
    events: Deque<Waiting, EVENTS>,
    /// The time of the newest event, from which those of the others follow.
    newest: Instant,
    edge: Option<Instant>,
    state: ErrorState,
    lost: u16,
}

impl Default for Inbox {
    fn default() -> Self {
        Self::new()
    }
}

impl Inbox {
    /// Empty; the controller is error active.
    pub const fn new() -> Self {
        Self {
            events: Deque::new(),
            newest: Instant(0),
            edge: None,
            state: ErrorState::Active,
            lost: 0,
        }
    }

    /// An event of the controller.
    pub fn put(&mut self, event: Event, at: Instant) {
        let is_frame = matches!(event, Event::Received(_));
        let taken = self.events.len() + if is_frame { RESERVED } else { 0 };
        if taken >= EVENTS || !self.push(event, at) {
            self.lost();
        }
    }

    /// Appends an event; false without room.
    fn push(&mut self, event: Event, at: Instant) -> bool {
        self.newest = self.newest.max(at);
        self.events.push_back(Waiting::new(event, at)).is_ok()
    }

    /// The whole time of an event, by its lower bits.
    const fn whole(&self, waiting: &Waiting) -> Instant {
        let age = (self.newest.0 as u32).wrapping_sub(waiting.at) & !(u32::MAX << TIME_BITS);
        Instant(self.newest.0.saturating_sub(age as u64))
    }

    /// The controller is in this error state; an event only when it is another one than before.
    pub fn state(&mut self, state: ErrorState, transmit: u8, receive: u8, at: Instant) {
        let event = Event::Changed(state, transmit, receive);
        // What does not fit is told with the next interrupt: the state is still another one.
        if self.is_another(state) && self.push(event, at) {
            self.state = state;
        }
    }

    /// Whether the controller was in another error state when it was last told.
    pub fn is_another(&self, state: ErrorState) -> bool {
        state != self.state
    }

    /// A frame was lost on its way in.
    pub const fn lost(&mut self) {
        self.lost = self.lost.saturating_add(1);
    }

    /// Frames lost since the last call.
    pub const fn take_lost(&mut self) -> u16 {
        core::mem::replace(&mut self.lost, 0)
    }

    /// Data-ready rose. One before that was not served is forgotten: the part keeps one sample,
    /// so what can still be read belongs to the newest edge.
    pub const fn edge(&mut self, at: Instant) {
        self.edge = Some(at);
    }

    /// Forgets the edge: nobody was there to read its sample.
    pub const fn forget_edge(&mut self) {
        self.edge = None;
    }

    /// Takes the earliest out, if it is not after `until`; of the same instant the bus comes first.
    #[inline(never)]
    pub fn take(&mut self, until: Instant) -> Option<(Input, Instant)> {
        let event = self.events.front().map(|waiting| self.whole(waiting));
        let edge = self.edge;
        let is_event = match (event, edge) {
            (Some(event), Some(edge)) => event <= edge,
            (event, _) => event.is_some(),
        };
        if is_event {
            let at = event.filter(|at| *at <= until)?;
            let waiting = self.events.pop_front()?;
            Some((Input::Bus(waiting.event()), at))
        } else {
            edge.filter(|at| *at <= until)?;
            self.edge.take().map(|at| (Input::Edge, at))
        }
    }
}

#[cfg(test)]
mod tests {
    use canopen::Frame;

    use super::*;

    const LATE: Instant = Instant(u64::MAX);

    fn received(id: u16) -> Event {
        Event::Received(Frame::data_frame(id, &[]))
    }

    #[test]
    fn what_came_first_comes_out_first_and_the_bus_before_an_edge() {
        let mut inbox = Inbox::new();
        inbox.edge(Instant(20));
        inbox.put(received(0x80), Instant(20));
        inbox.put(Event::Sent(1), Instant(30));
        assert_eq!(inbox.take(Instant(19)), None);
        let order: std::vec::Vec<_> = core::iter::from_fn(|| inbox.take(LATE)).collect();
        let expected = [
            (Input::Bus(received(0x80)), Instant(20)),
            (Input::Edge, Instant(20)),
            (Input::Bus(Event::Sent(1)), Instant(30)),
        ];
        assert_eq!(order, expected);
    }

    #[test]
    fn a_flood_of_frames_is_counted_and_pushes_nothing_else_out() {
        let mut inbox = Inbox::new();
        (0..FRAMES + 4).for_each(|n| inbox.put(received(n), Instant(u64::from(n))));
        (0..3).for_each(|place| inbox.put(Event::Sent(place), Instant(90)));
        inbox.state(ErrorState::Off, 255, 0, Instant(91));
        assert_eq!((inbox.take_lost(), inbox.take_lost()), (4, 0));
        let order = core::iter::from_fn(|| inbox.take(LATE));
        let rest: std::vec::Vec<_> = order.skip(FRAMES.into()).map(|(input, _)| input).collect();
        let sent = |place| Input::Bus(Event::Sent(place));
        let off = Input::Bus(Event::Changed(ErrorState::Off, 255, 0));
        assert_eq!(rest, [sent(0), sent(1), sent(2), off]);
    }

    #[test]
    fn a_state_is_told_once_and_one_that_found_no_room_later() {
        let mut inbox = Inbox::new();
        inbox.state(ErrorState::Active, 0, 0, Instant(0));
        assert_eq!(inbox.take(LATE), None);
        (0..FRAMES).for_each(|n| inbox.put(received(n), Instant(1)));
        let states = [
            ErrorState::Warning,
            ErrorState::Passive,
            ErrorState::Active,
            ErrorState::Warning,
        ];
        for state in states {
            inbox.state(state, 1, 2, Instant(2));
        }
        inbox.state(ErrorState::Off, 1, 2, Instant(3));
        assert_eq!(
            inbox.take(LATE),
            Some((Input::Bus(received(0)), Instant(1)))
        );
        inbox.state(ErrorState::Off, 1, 2, Instant(4));
        inbox.state(ErrorState::Off, 1, 2, Instant(5));
        let last = core::iter::from_fn(|| inbox.take(LATE)).last();
        let off = Input::Bus(Event::Changed(ErrorState::Off, 1, 2));
        assert_eq!(last, Some((off, Instant(4))));
    }

    #[test]
    fn events_keep_their_time_when_its_lower_bits_begin_anew() {
        const ROUND: u64 = 1 << TIME_BITS;
        let mut inbox = Inbox::new();
        let times = [ROUND - 2, ROUND - 1, ROUND, 2 * ROUND - 3].map(Instant);
        for at in times {
            inbox.put(received(1), at);
        }
        for at in times {
            assert_eq!(inbox.take(Instant(at.0 - 1)), None);
            assert_eq!(inbox.take(at), Some((Input::Bus(received(1)), at)));
        }
    }

    #[test]
    fn every_event_comes_out_as_it_went_in() {
        let ids = [
            Id::Standard(standard(0)),
            Id::Standard(standard(0x7FF)),
            Id::Extended(ExtendedId::ZERO),
            Id::Extended(ExtendedId::MAX),
        ];
        let mut events = std::vec![
            Event::Sent(2),
            Event::GivenUp(1),
            Event::Changed(ErrorState::Active, 0, 127),
            Event::Changed(ErrorState::Warning, 96, 0),
            Event::Changed(ErrorState::Passive, 128, 255),
            Event::Changed(ErrorState::Off, 255, 1),
        ];
        for (id, length) in ids.iter().flat_map(|id| (0..=8).map(move |n| (*id, n))) {
            let bytes = [0xFF, 1, 2, 3, 4, 5, 6, 0x80];
            let frames = [Frame::with(id, &bytes[..length]), Frame::remote(id, length)];
            events.extend(frames.map(|frame| Event::Received(frame.unwrap())));
        }
        for event in events {
            let mut inbox = Inbox::new();
            inbox.put(event, Instant(u64::MAX - 3));
            assert_eq!(
                inbox.take(LATE),
                Some((Input::Bus(event), Instant(u64::MAX - 3)))
            );
        }
    }

    #[test]
    fn the_sample_after_an_erase_was_taken_for_the_first_of_those_that_were_lost() {
        let mut inbox = Inbox::new();
        (0..12).for_each(|n| inbox.edge(Instant(n)));
        assert_eq!(inbox.take(Instant(10)), None);
        assert_eq!(inbox.take(LATE), Some((Input::Edge, Instant(11))));
        inbox.edge(Instant(20));
        inbox.forget_edge();
        assert_eq!(inbox.take(LATE), None);
    }
}
