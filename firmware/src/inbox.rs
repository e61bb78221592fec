//! What interrupts leave for the device's task, to be taken out in the order of its times.
//!
//! In: the controller's events and data-ready edges, each with its time. Out: the earliest of them.
//! An event that would not fit is counted: the device tells the bus how many frames were lost.
//!
//! The room kept free for what frames must not push out is never used up: each mailbox has one
//! event at a time, and a new error state is taken only when there is room.

use heapless::Deque;
use tilt::sample::Instant;

use crate::unit::{Event, MAILBOXES, State};

/// Events that are kept. At 250 kbit/s 16 frames take 9 ms at least, at 1 Mbit/s 2 ms.
const EVENTS: usize = 16 + RESERVED;

/// Places that received frames do not get: one for each mailbox and one for the error state.
const RESERVED: usize = MAILBOXES + 1;

/// Edges that are kept: at 400 samples/s, those of 20 ms.
const EDGES: usize = 8;

/// Something that has happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// Data-ready rose.
    Edge,
    /// The CAN controller has seen something.
    Bus(Event),
}

/// Events and edges that nobody has looked at.
#[derive(Debug)]
pub struct Inbox {
    events: Deque<(Event, Instant), EVENTS>,
    edges: Deque<Instant, EDGES>,
    state: State,
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
            edges: Deque::new(),
            state: State::Active,
            lost: 0,
        }
    }

    /// An event of the controller.
    pub fn put(&mut self, event: Event, at: Instant) {
        let is_frame = matches!(event, Event::Received(_));
        let taken = self.events.len() + if is_frame { RESERVED } else { 0 };
        if taken >= EVENTS || self.events.push_back((event, at)).is_err() {
            self.lost();
        }
    }

    /// The controller is in this error state; an event only when it is another one than before.
    pub fn state(&mut self, state: State, transmit: u8, receive: u8, at: Instant) {
        let event = Event::Changed(state, transmit, receive);
        // What does not fit is told with the next interrupt: the state is still another one.
        if state != self.state && self.events.push_back((event, at)).is_ok() {
            self.state = state;
        }
    }

    /// A frame was lost on its way in.
    pub const fn lost(&mut self) {
        self.lost = self.lost.saturating_add(1);
    }

    /// Frames lost since the last call.
    pub const fn take_lost(&mut self) -> u16 {
        core::mem::replace(&mut self.lost, 0)
    }

    /// Data-ready rose. An edge for which there is no room takes the newest's place: the sample
    /// that can still be read belongs to it.
    pub fn edge(&mut self, at: Instant) {
        if self.edges.is_full() {
            self.edges.pop_back();
        }
        let _ = self.edges.push_back(at);
    }

    /// Forgets the edges: nobody was there to read their samples.
    pub fn forget_edges(&mut self) {
        self.edges.clear();
    }

    /// Takes the earliest out, if it is not after `until`; of the same instant the bus comes first.
    pub fn take(&mut self, until: Instant) -> Option<(Input, Instant)> {
        let event = self.events.front().map(|(_, at)| *at);
        let edge = self.edges.front().copied();
        let is_event = match (event, edge) {
            (Some(event), Some(edge)) => event <= edge,
            (event, _) => event.is_some(),
        };
        if is_event {
            event.filter(|at| *at <= until)?;
            let (event, at) = self.events.pop_front()?;
            Some((Input::Bus(event), at))
        } else {
            edge.filter(|at| *at <= until)?;
            self.edges.pop_front().map(|at| (Input::Edge, at))
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
        inbox.edge(Instant(25));
        assert_eq!(inbox.take(Instant(19)), None);
        let order: std::vec::Vec<_> = core::iter::from_fn(|| inbox.take(LATE)).collect();
        let expected = [
            (Input::Bus(received(0x80)), Instant(20)),
            (Input::Edge, Instant(20)),
            (Input::Edge, Instant(25)),
            (Input::Bus(Event::Sent(1)), Instant(30)),
        ];
        assert_eq!(order, expected);
    }

    #[test]
    fn a_flood_of_frames_is_counted_and_pushes_nothing_else_out() {
        let mut inbox = Inbox::new();
        (0..20).for_each(|n| inbox.put(received(n), Instant(u64::from(n))));
        (0..3).for_each(|place| inbox.put(Event::Sent(place), Instant(20)));
        inbox.state(State::Off, 255, 0, Instant(21));
        assert_eq!((inbox.take_lost(), inbox.take_lost()), (4, 0));
        let order = core::iter::from_fn(|| inbox.take(LATE));
        let rest: std::vec::Vec<_> = order.skip(16).map(|(input, _)| input).collect();
        let sent = |place| Input::Bus(Event::Sent(place));
        let off = Input::Bus(Event::Changed(State::Off, 255, 0));
        assert_eq!(rest, [sent(0), sent(1), sent(2), off]);
    }

    #[test]
    fn a_state_is_told_once_and_one_that_found_no_room_later() {
        let mut inbox = Inbox::new();
        inbox.state(State::Active, 0, 0, Instant(0));
        assert_eq!(inbox.take(LATE), None);
        (0..16).for_each(|n| inbox.put(received(n), Instant(1)));
        let states = [
            State::Warning,
            State::Passive,
            State::Active,
            State::Warning,
        ];
        for state in states {
            inbox.state(state, 1, 2, Instant(2));
        }
        inbox.state(State::Off, 1, 2, Instant(3));
        assert_eq!(
            inbox.take(LATE),
            Some((Input::Bus(received(0)), Instant(1)))
        );
        inbox.state(State::Off, 1, 2, Instant(4));
        inbox.state(State::Off, 1, 2, Instant(5));
        let last = core::iter::from_fn(|| inbox.take(LATE)).last();
        let off = Input::Bus(Event::Changed(State::Off, 1, 2));
        assert_eq!(last, Some((off, Instant(4))));
    }

    #[test]
    fn the_newest_edge_stays() {
        let mut inbox = Inbox::new();
        (0..12).for_each(|n| inbox.edge(Instant(n)));
        let kept: std::vec::Vec<_> = core::iter::from_fn(|| inbox.take(LATE)).collect();
        assert_eq!(
            (kept.len(), kept.last()),
            (8, Some(&(Input::Edge, Instant(11))))
        );
        inbox.edge(Instant(20));
        inbox.forget_edges();
        assert_eq!(inbox.take(LATE), None);
    }
}
