//! Error control: boot-up, heartbeat, node and life guarding (CiA 301, 7.2.8.2 and 7.2.8.3;
//! objects 100Ch, 100Dh, 1016h, 1017h).
//!
//! In: heartbeats of others, guarding requests, the time. Out: this node's heartbeat or its answer
//! to guarding, and events when another node or the guarding master falls silent or comes back.
//! A heartbeat has precedence: while 1017h is not 0 nobody is answered by guarding.
//!
//! Left out: what a lost node means to the device.

use crate::frame::{Frame, standard};
use crate::nmt::State;
use crate::object::{Abort, Address, Objects, Place, Value};
use crate::time::Deadline;
use instant::Instant;

/// Nodes that can be supervised (1016h).
pub const SUPERVISED: usize = 4;

/// Identifier of error control for node-id 0.
pub(crate) const ERROR_CONTROL: u16 = 0x700;

/// What has been noticed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A supervised node's heartbeat has begun or come back, or has stopped.
    Heartbeat {
        /// Entry of 1016h, from 0.
        slot: u8,
        /// The node.
        node: u8,
        /// True while it is heard.
        alive: bool,
    },
    /// The master guards this node again, or has stopped.
    LifeGuarding {
        /// True while it guards.
        alive: bool,
    },
}

/// The boot-up message: state byte 0, whatever state follows (CiA 301, 7.2.8.3.3).
pub fn boot_up(node_id: u8) -> Frame {
    Frame::data_frame(ERROR_CONTROL + u16::from(node_id), &[0])
}

/// An entry of 1016h.
#[derive(Clone, Copy, Debug)]
struct Consumer(u32);

impl Consumer {
    const fn node(self) -> u8 {
        (self.0 >> 16) as u8
    }

    const fn time_ms(self) -> u32 {
        self.0 & 0xFFFF
    }

    const fn is_on(self) -> bool {
        self.time_ms() != 0 && matches!(self.node(), 1..=127)
    }
}

/// Error control: parameters and state.
#[derive(Clone, Debug)]
pub struct ErrorControl {
    producer_ms: u16,
    guard_ms: u16,
    life_factor: u8,
    /// A guarding request waits for its answer.
    asked: bool,
    /// An answer to guarding is in the controller, and has not gone out.
    answered: bool,
    toggle: bool,
    /// Who is silent: bits 0 to 3 the nodes of 1016h, bit 4 the master that guards.
    lost: u8,
    consumers: [Consumer; SUPERVISED],
    /// When each of the same five is silent for too long; it was heard.
    silent_at: [Deadline; SUPERVISED + 1],
    heartbeat_at: Deadline,
}

/// Place of the master that guards among those who can fall silent.
const MASTER: usize = SUPERVISED;

impl ErrorControl {
    /// As [`ErrorControl::new`], and a constant for the reason that [`crate::pdo::Pdos`] has.
    pub(crate) const NONE: Self = Self {
        producer_ms: 0,
        guard_ms: 0,
        life_factor: 0,
        asked: false,
        answered: false,
        toggle: false,
        lost: 0,
        consumers: [Consumer(0); SUPERVISED],
        silent_at: [Deadline::NONE; SUPERVISED + 1],
        heartbeat_at: Deadline::NONE,
    };

    /// Nothing produced, nobody supervised.
    // Within a whole node it would be cleared by a second and third form of the library's memclr.
    #[inline(never)]
    pub const fn new() -> Self {
        Self::NONE
    }

    /// Boot-up has gone out: the heartbeat begins, and guarding starts with toggle 0.
    pub fn start(&mut self, now: Instant) {
        self.toggle = false;
        self.asked = false;
        self.answered = false;
        self.heartbeat_at = Deadline::in_ms(now, self.producer_ms.into());
    }

    /// Takes a frame of error control; `node_id` is this node's.
    pub fn receive<O: Objects>(
        &mut self,
        frame: &Frame,
        node_id: u8,
        now: Instant,
    ) -> Option<Event> {
        let id = frame.cob_id()?.checked_sub(ERROR_CONTROL)?;
        let node = u8::try_from(id).ok().filter(|n| (1..=127).contains(n))?;
        if frame.is_remote() {
            let asked = O::SERVICES.guarding && node == node_id;
            return asked.then(|| self.guarded(now)).flatten();
        }
        if !O::SERVICES.heartbeat_consumer {
            return None;
        }
        let &[state] = frame.bytes() else {
            return None;
        };
        // A boot-up message is not a heartbeat: the node has just been away.
        if state & 0x7F == 0 {
            return None;
        }
        self.heard(node, now)
    }

    fn guarded(&mut self, now: Instant) -> Option<Event> {
        if self.producer_ms != 0 {
            return None;
        }
        self.asked = true;
        let was_lost = self.is_back(MASTER, self.life_ms(), now) & 1 << MASTER;
        (was_lost != 0).then_some(Event::LifeGuarding { alive: true })
    }

    const fn life_ms(&self) -> u32 {
        self.guard_ms as u32 * self.life_factor as u32
    }

    /// One of the five was heard, and has to be heard again within that time; who was lost before.
    fn is_back(&mut self, place: usize, within_ms: u32, now: Instant) -> u8 {
        if let Some(silent_at) = self.silent_at.get_mut(place) {
            *silent_at = Deadline::in_ms(now, within_ms);
        }
        let lost = self.lost;
        self.lost = lost & !(1 << place);
        lost
    }

    /// Up to `now` frames may have been lost that were sent: whoever is supervised has all of its
    /// time again.
    pub fn excuse(&mut self, now: Instant) {
        let life_ms = self.life_ms();
        let times = self.consumers.iter().map(|consumer| consumer.time_ms());
        for (silent_at, ms) in self.silent_at.iter_mut().zip(times.chain([life_ms])) {
            if silent_at.is_set() {
                *silent_at = Deadline::in_ms(now, ms);
            }
        }
    }

    /// Supervision of a node starts at its first heartbeat (CiA 301, 7.2.8.2.2.3).
    fn heard(&mut self, node: u8, now: Instant) -> Option<Event> {
        let mut event = None;
        for (slot, consumer) in self.consumers.into_iter().enumerate() {
            if consumer.node() == node && consumer.is_on() {
                let first = self.silent_at.get(slot).is_some_and(|at| !at.is_set());
                self.is_back(slot, consumer.time_ms(), now);
                let (slot, alive) = (slot as u8, true);
                event = first.then_some(Event::Heartbeat { slot, node, alive });
            }
        }
        event
    }

    /// One silence that has lasted too long by `now`; call until `None`.
    pub fn expired(&mut self, now: Instant) -> Option<Event> {
        let mut all = self.silent_at.iter_mut();
        let slot = all.position(|at| {
            let is_due = at.is_due(now);
            if is_due {
                *at = Deadline::NONE;
            }
            is_due
        })?;
        self.lost |= 1 << slot;
        let alive = false;
        Some(match self.consumers.get(slot) {
            Some(consumer) => Event::Heartbeat {
                slot: slot as u8,
                node: consumer.node(),
                alive,
            },
            None => Event::LifeGuarding { alive },
        })
    }

    /// What is lost and still supervised: bits 0 to 3 the nodes of 1016h, bit 4 guarding.
    pub const fn lost(&self) -> u8 {
        self.lost
    }

    /// When to look again.
    pub fn poll(&self) -> Deadline {
        let mut first = self.heartbeat_at;
        self.silent_at.iter().for_each(|at| first.add(*at));
        first
    }

    /// True when [`ErrorControl::transmit`] has something.
    pub fn is_due(&self, now: Instant) -> bool {
        self.asked || self.heartbeat_at.is_due(now)
    }

    /// The heartbeat or the answer to guarding that is due.
    pub fn transmit(&mut self, node_id: u8, state: State, now: Instant) -> Option<Frame> {
        let id = ERROR_CONTROL + u16::from(node_id);
        if core::mem::take(&mut self.asked) {
            let toggle = u8::from(self.toggle) << 7;
            self.answered = true;
            return Some(Frame::data_frame(id, &[toggle | state as u8]));
        }
        if !self.heartbeat_at.is_due(now) {
            return None;
        }
        let period_us = u64::from(self.producer_ms) * 1000;
        self.heartbeat_at = self.heartbeat_at.in_step(period_us, now);
        Some(Frame::data_frame(id, &[state as u8]))
    }

    /// A frame of [`ErrorControl::transmit`] has gone out. The toggle bit alternates from one
    /// answer on the bus to the next: after one that the controller has lost it stays.
    ///
    /// A heartbeat may look like an answer, and 1017h may have changed while either was in the
    /// controller; so what was handed over counts. Where both are in the controller it does not
    /// matter which of them goes out first.
    pub fn sent(&mut self) {
        self.toggle ^= core::mem::take(&mut self.answered);
    }

    /// Bus-off took what the controller had.
    pub fn bus_off(&mut self) {
        self.answered = false;
    }

    /// The request that a master guards this node with.
    pub fn request(node_id: u8) -> Option<Frame> {
        Frame::remote(standard(ERROR_CONTROL + u16::from(node_id)), 1)
    }

    /// 100Ch, 100Dh, 1016h, 1017h.
    pub fn place(&mut self, at: Address) -> Option<Place<'_>> {
        Some(match at.index {
            0x100C => Place::U16(&mut self.guard_ms),
            0x100D => Place::U8(&mut self.life_factor),
            0x1017 => Place::U16(&mut self.producer_ms),
            _ => Place::U32(&mut self.consumer(at.sub)?.0),
        })
    }

    /// The one that a sub-index of 1016h tells of.
    fn consumer(&mut self, sub: u8) -> Option<&mut Consumer> {
        self.consumers.get_mut(usize::from(sub).wrapping_sub(1))
    }

    /// A write by SDO; a new time counts from now.
    pub fn write(&mut self, at: Address, value: Value, now: Instant) -> Option<Result<(), Abort>> {
        let refused = match at.index {
            0x1016 => self.refuse_entry(at.sub, value.unsigned() as u32),
            _ => None,
        };
        if let Some(abort) = refused {
            return Some(Err(abort));
        }
        if let Some(mut place) = self.place(at) {
            place.set(value);
        }
        if at.index == 0x1017 {
            self.heartbeat_at = Deadline::in_ms(now, self.producer_ms.into());
            self.asked = false;
        }
        // Supervision with the new times begins at the next heartbeat, guarding at the master's
        // next request.
        if at.index != 0x1016 {
            self.is_back(MASTER, 0, now);
        } else if let Some(place @ ..MASTER) = usize::from(at.sub).checked_sub(1) {
            self.is_back(place, 0, now);
        }
        Some(Ok(()))
    }

    /// No node twice, and nothing in the reserved bits. An entry without a time, or with a node-id
    /// that no node has, is one that is not used (CiA 301, 7.5.2.19).
    fn refuse_entry(&self, sub: u8, entry: u32) -> Option<Abort> {
        let new = Consumer(entry);
        if entry >> 24 != 0 {
            return Some(Abort::InvalidValue);
        }
        let others = (1..).zip(&self.consumers).filter(|(n, _)| *n != sub);
        let twice = new.is_on()
            && others
                .map(|(_, other)| other)
                .any(|other| other.is_on() && other.node() == new.node());
        twice.then_some(Abort::ParameterIncompatible)
    }
}

impl Default for ErrorControl {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::shelf::Shelf;
    use crate::object::at;

    const PRE: State = State::PreOperational;

    fn ms(ms: u32) -> Instant {
        Instant(0).after_ms(ms)
    }

    fn write(control: &mut ErrorControl, index: u16, sub: u8, value: Value) -> Result<(), Abort> {
        control.write(at(index, sub), value, ms(0)).unwrap()
    }

    fn heartbeat(node: u16, state: u8) -> Frame {
        Frame::data_frame(0x700 + node, &[state])
    }

    #[test]
    fn boot_up_has_state_byte_0() {
        assert_eq!(boot_up(5), Frame::data_frame(0x705, &[0]));
    }

    #[test]
    fn the_heartbeat_keeps_its_pace() {
        let mut control = ErrorControl::new();
        write(&mut control, 0x1017, 0, Value::u16(100)).unwrap();
        control.start(ms(7));
        assert!(!control.is_due(ms(106)) && control.is_due(ms(107)));
        let told = control.transmit(5, PRE, ms(110));
        assert_eq!(told, Some(heartbeat(5, 127)));
        assert_eq!(control.poll().get(), Some(ms(207)));
        assert_eq!(
            control.transmit(5, State::Operational, ms(207)),
            Some(heartbeat(5, 5))
        );
    }

    #[test]
    fn heartbeats_that_were_lost_in_an_erase_were_held_against_their_node() {
        let mut control = ErrorControl::new();
        write(&mut control, 0x1016, 1, Value::u32(2 << 16 | 300)).unwrap();
        write(&mut control, 0x1016, 2, Value::u32(3 << 16 | 300)).unwrap();
        control.receive::<Shelf>(&heartbeat(2, 127), 1, ms(0));
        control.excuse(ms(290));
        assert_eq!(control.expired(ms(589)), None);
        // Who was never heard stays so.
        let lost = Event::Heartbeat {
            slot: 0,
            node: 2,
            alive: false,
        };
        assert_eq!(control.expired(ms(590)), Some(lost));
        assert_eq!(control.expired(ms(10_000)), None);
        // One that is lost already does not come back by it.
        control.excuse(ms(600));
        assert_eq!((control.lost(), control.poll().get()), (1, None));
    }

    #[test]
    fn a_request_to_guard_that_was_lost_in_an_erase_was_held_against_the_master() {
        let mut control = ErrorControl::new();
        write(&mut control, 0x100C, 0, Value::u16(100)).unwrap();
        write(&mut control, 0x100D, 0, Value::u8(3)).unwrap();
        let guard = ErrorControl::request(1).unwrap();
        control.receive::<Shelf>(&guard, 1, ms(0));
        control.excuse(ms(290));
        assert_eq!(control.expired(ms(589)), None);
        let lost = Event::LifeGuarding { alive: false };
        assert_eq!(control.expired(ms(590)), Some(lost));
        control.excuse(ms(600));
        assert_eq!(control.poll().get(), None);
    }

    #[test]
    fn supervision_starts_at_the_first_heartbeat() {
        let mut control = ErrorControl::new();
        write(&mut control, 0x1016, 1, Value::u32(2 << 16 | 300)).unwrap();
        assert_eq!(control.expired(ms(10_000)), None);
        // A boot-up message does not start it.
        assert_eq!(control.receive::<Shelf>(&heartbeat(2, 0), 1, ms(0)), None);
        assert_eq!(control.expired(ms(10_000)), None);
        let node = |alive| {
            Some(Event::Heartbeat {
                slot: 0,
                node: 2,
                alive,
            })
        };
        assert_eq!(
            control.receive::<Shelf>(&heartbeat(2, 127), 1, ms(0)),
            node(true)
        );
        assert_eq!(
            control.receive::<Shelf>(&heartbeat(2, 127), 1, ms(200)),
            None
        );
        assert_eq!(control.expired(ms(499)), None);
        assert_eq!(control.expired(ms(500)), node(false));
        assert_eq!(control.expired(ms(500)), None);
        assert_eq!(
            control.receive::<Shelf>(&heartbeat(2, 5), 1, ms(900)),
            node(true)
        );
    }

    #[test]
    fn a_node_is_not_supervised_twice() {
        let mut control = ErrorControl::new();
        write(&mut control, 0x1016, 1, Value::u32(2 << 16 | 300)).unwrap();
        let twice = write(&mut control, 0x1016, 2, Value::u32(2 << 16 | 100));
        assert_eq!(twice, Err(Abort::ParameterIncompatible));
        assert_eq!(write(&mut control, 0x1016, 2, Value::u32(2 << 16)), Ok(()));
        assert_eq!(
            write(&mut control, 0x1016, 1, Value::u32(2 << 16 | 400)),
            Ok(())
        );
        let reserved = write(&mut control, 0x1016, 3, Value::u32(1 << 24 | 3 << 16 | 100));
        assert_eq!(reserved, Err(Abort::InvalidValue));
    }

    #[test]
    fn a_node_id_that_no_node_has_was_refused_instead_of_an_unused_entry() {
        let mut control = ErrorControl::new();
        for (sub, node) in (1..).zip([0, 128, 255, 255]) {
            let entry = Value::u32(node << 16 | 300);
            assert_eq!(write(&mut control, 0x1016, sub, entry), Ok(()), "{node}");
            let read = control.place(at(0x1016, sub)).map(|place| place.get());
            assert_eq!(read.map(Value::from), Some(entry));
        }
        // Nobody is supervised by it, not even what looks like a heartbeat of node 0.
        for id in [0, 127] {
            assert_eq!(control.receive::<Shelf>(&heartbeat(id, 5), 1, ms(0)), None);
        }
        assert_eq!(
            (control.poll().get(), control.expired(ms(10_000))),
            (None, None)
        );
    }

    #[test]
    fn guarding_is_answered_with_a_toggle_that_starts_at_0() {
        let mut control = ErrorControl::new();
        control.start(ms(0));
        let request = ErrorControl::request(5).unwrap();
        for toggle in [0, 0x80, 0] {
            assert_eq!(control.receive::<Shelf>(&request, 5, ms(1)), None);
            assert!(control.is_due(ms(1)));
            let answer = control.transmit(5, PRE, ms(1));
            assert_eq!(answer, Some(heartbeat(5, toggle | 127)));
            control.sent();
        }
        assert!(!control.is_due(ms(1)));
        control.start(ms(2));
        control.receive::<Shelf>(&request, 5, ms(3));
        assert_eq!(control.transmit(5, PRE, ms(3)), Some(heartbeat(5, 127)));
    }

    #[test]
    fn a_guarding_answer_that_bus_off_took_turned_the_toggle_bit_all_the_same() {
        let mut control = ErrorControl::new();
        control.start(ms(0));
        let request = ErrorControl::request(5).unwrap();
        for (toggle, lost) in [
            (0, true),
            (0, false),
            (0x80, true),
            (0x80, false),
            (0, false),
        ] {
            control.receive::<Shelf>(&request, 5, ms(1));
            let answer = control.transmit(5, PRE, ms(1)).unwrap();
            assert_eq!(answer, heartbeat(5, toggle | 127));
            if lost {
                control.bus_off();
            } else {
                control.sent();
            }
        }
    }

    #[test]
    fn a_heartbeat_takes_precedence_over_guarding() {
        let mut control = ErrorControl::new();
        write(&mut control, 0x1017, 0, Value::u16(100)).unwrap();
        control.receive::<Shelf>(&ErrorControl::request(5).unwrap(), 5, ms(1));
        assert!(!control.is_due(ms(1)));
    }

    #[test]
    fn life_guarding_notices_a_master_that_stops_and_returns() {
        let mut control = ErrorControl::new();
        write(&mut control, 0x100C, 0, Value::u16(100)).unwrap();
        write(&mut control, 0x100D, 0, Value::u8(3)).unwrap();
        let request = ErrorControl::request(5).unwrap();
        assert_eq!(control.expired(ms(1000)), None);
        control.receive::<Shelf>(&request, 5, ms(1000));
        assert_eq!(control.expired(ms(1299)), None);
        let lost = Event::LifeGuarding { alive: false };
        assert_eq!(control.expired(ms(1300)), Some(lost));
        let back = Event::LifeGuarding { alive: true };
        assert_eq!(control.receive::<Shelf>(&request, 5, ms(1400)), Some(back));
    }
}
