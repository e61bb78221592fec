//! One node at work: events go into the device in the order of their times, frames come out.
//!
//! In: data-ready edges, what the CAN controller has seen, and the time. Out: what goes into the
//! controller's mailboxes and what is taken back from there, the bit rate, and what is left for
//! the board ([`BoardAction`]).
//!
//! The device is told of each event at the time of the event, not at that of the processor's
//! getting there, and is polled at the very instants that it asks for. So the same events give the
//! same bits here and in the simulation, which serves a device in the same order.
//!
//! Left out: registers and interrupts (`chip`).

use canopen::Frame;
use canopen::node::BusState;
use device::bit_rate::Search;
use device::device::{BoardRequest, Device};
use device::instrument::Instrument;
use device::mailboxes::{Mailboxes, Transmitter};
use device::objects::device_objects::Memory;
use device::sensor::Part;
use instant::Instant;

use crate::inbox::Input;

/// What the CAN controller has seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A frame has come in.
    Received(Frame),
    /// The frame in this mailbox has gone out.
    Sent(u8),
    /// The frame in this mailbox was given up without having gone out.
    GivenUp(u8),
    /// The error state is another one, with the counters of sending and of receiving.
    Changed(ErrorState, u8, u8),
}

/// The controller's error state (RM0008 24.7.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorState {
    /// Error active, with counters below 96.
    Active,
    /// Error active, with a counter of 96 or more.
    Warning,
    /// Error passive.
    Passive,
    /// Bus-off.
    Off,
}

impl ErrorState {
    /// By its number, as `as u8` gives it; bus-off for any beyond.
    pub const fn from_number(number: u8) -> Self {
        match number {
            0 => Self::Active,
            1 => Self::Warning,
            2 => Self::Passive,
            _ => Self::Off,
        }
    }
}

/// The CAN controller as a driver uses it. What is in its mailboxes stays there but for
/// [`Transmitter`]'s methods.
pub trait Controller: Transmitter {
    /// Asks back from bus-off: after 128 times 11 recessive bits it takes part again.
    fn recover(&mut self);
    /// Goes to a bit rate; a controller that only listens sends nothing, not even an acknowledge.
    fn set_rate(&mut self, kbit_s: u16, listen_only: bool);
    /// Keeps a master's frames to this node, NMT, LSS and requests of SDO, apart from all others.
    fn listen_to(&mut self, node_id: u8);
}

/// What only the board can do, asked for by [`Driver`]'s methods.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardAction {
    /// Reset the chip.
    Reset,
    /// Call [`Device::restart_sensor`].
    Sensor,
}

/// State of the driver around a device.
#[derive(Debug)]
pub struct Driver {
    mailboxes: Mailboxes,
    /// When to ask the controller back from bus-off.
    recover_at: Option<Instant>,
    /// When the bit rate that LSS has activated counts, with the rate; then, when silence ends.
    switch_at: Option<(Instant, Option<Option<u16>>)>,
    delay_ms: u16,
    /// The bit rate is being looked for; nothing is sent meanwhile.
    search: Option<Search>,
    /// The latest instant that the device was told: its time does not go back.
    reached: Instant,
    /// The node-id that the controller listens to.
    node_id: u8,
    action: Option<BoardAction>,
}

/// Lateness that is none: the processor was busy with something else, us.
const LATE_US: u64 = 2_000;

/// The instant at which to do what was due at `next`, when it is `now`.
///
/// What was due just now is done as if it were that very instant. After the erase of a page it is
/// done now: asked at an instant of that time, the device would miss the samples of it, although
/// the last of them waits to be read.
fn punctual(next: Instant, now: Instant) -> Instant {
    if next >= now {
        return next;
    }
    overdue(next, now)
}

// Apart, because mostly nothing is due, and one look tells.
#[inline(never)]
fn overdue(next: Instant, now: Instant) -> Instant {
    let is_late = next.0.saturating_add(LATE_US) < now.0;
    if is_late { now } else { next }
}

/// A device and what surrounds it, for one call.
pub struct DriverCall<'a, P, M, C, I: Instrument> {
    driver: &'a mut Driver,
    device: &'a mut Device<P, M, I>,
    can: &'a mut C,
}

impl Default for Driver {
    fn default() -> Self {
        Self::new()
    }
}

impl Driver {
    /// Before the bus is started.
    pub const fn new() -> Self {
        Self {
            mailboxes: Mailboxes::new(),
            recover_at: None,
            switch_at: None,
            delay_ms: 0,
            search: None,
            reached: Instant(0),
            node_id: 0,
            action: None,
        }
    }

    /// Joins device and controller for a call.
    pub const fn at<'a, P, M, C, I: Instrument>(
        &'a mut self,
        device: &'a mut Device<P, M, I>,
        can: &'a mut C,
    ) -> DriverCall<'a, P, M, C, I> {
        DriverCall {
            driver: self,
            device,
            can,
        }
    }

    /// What is left for the board to do, once.
    pub const fn take_action(&mut self) -> Option<BoardAction> {
        self.action.take()
    }

    /// The driver itself waits for something, which is seldom: it is asked before each event.
    const fn has_business(&self) -> bool {
        self.recover_at.is_some() || self.switch_at.is_some() || self.search.is_some()
    }

    /// What comes first of all that the driver and the device wait for.
    #[cold]
    fn first(&self, device: Instant) -> Instant {
        let switch = self.switch_at.map(|(at, _)| at);
        let search = self.search.as_ref().map(Search::until);
        let ours = [self.recover_at, switch, search].into_iter().flatten();
        ours.fold(device, Instant::min)
    }

    /// An instant that the device can be told: never before the one that it has.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn reach(&mut self, at: Instant) -> Instant {
        self.reached = self.reached.max(at);
        self.reached
    }
}

impl<P: Part, M: Memory, C: Controller, I: Instrument> DriverCall<'_, P, M, C, I> {
    /// The bus begins: the sensor has been set up.
    pub fn start(&mut self, now: Instant) {
        let now = self.driver.reach(now);
        self.device.start_bus(now);
        self.set_rate(self.device.bit_rate(), now);
        self.poll(now);
    }

    /// Does the one thing that comes first in time; when nothing is due, when it will be.
    ///
    /// `take` gives what has come in up to an instant, the earliest first.
    pub fn step(
        &mut self,
        now: Instant,
        take: impl FnOnce(Instant) -> Option<(Input, Instant)>,
    ) -> Option<Instant> {
        let due = self.next();
        let next = punctual(due, now);
        if next != due {
            self.device.stood_still(now);
        }
        match take(next) {
            Some((Input::Edge, at)) => self.data_ready(at),
            Some((Input::Bus(event), at)) => self.event(event, at),
            None if next <= now => self.poll(next),
            None => return Some(next),
        }
        None
    }

    /// When [`DriverCall::poll`] is next due.
    pub fn next(&self) -> Instant {
        let driver = &self.driver;
        let device = self.device.next_deadline();
        let next = if driver.has_business() {
            driver.first(device)
        } else {
            device
        };
        next.max(driver.reached)
    }

    /// A data-ready edge of `captured`: a sample is taken, and nothing else.
    pub fn data_ready(&mut self, captured: Instant) {
        self.driver.reach(captured);
        self.device.data_ready(captured);
    }

    /// Does what is due at `now`, which is what [`DriverCall::next`] has returned.
    pub fn poll(&mut self, now: Instant) {
        let now = self.driver.reach(now);
        if self.driver.recover_at.is_some_and(|at| at <= now) {
            self.driver.recover_at = None;
            self.can.recover();
        }
        self.switch(now);
        if let Some(search) = &mut self.driver.search
            && search.poll(now)
        {
            self.can.set_rate(search.kbit_s(), true);
        }
        if self.device.next_deadline() <= now {
            self.device.poll(now);
        }
        self.pump(now);
    }

    /// The controller has seen something at `at`.
    // Apart, because most calls are for a sample, which would set up what only frames need.
    #[inline(never)]
    pub fn event(&mut self, event: Event, at: Instant) {
        let at = self.driver.reach(at);
        match event {
            Event::Received(frame) => self.received(&frame, at),
            Event::Sent(place) => self.sent(place, at),
            Event::GivenUp(place) => {
                self.driver.mailboxes.given_up(place, self.device, at);
                self.pump(at);
            }
            Event::Changed(state, transmit, receive) => self.changed(state, transmit, receive, at),
        }
    }

    // Out of line: the image is smaller.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn received(&mut self, frame: &Frame, at: Instant) {
        let found = self.driver.search;
        if let Some(found) = found {
            self.set_rate(Some(found.kbit_s()), at);
        }
        self.device.receive(frame, at);
        // What the device wants to do about it is done at once.
        if found.is_some() || self.device.next_deadline() <= at {
            self.poll(at);
        }
    }

    fn sent(&mut self, place: u8, at: Instant) {
        let Some(frame) = self.driver.mailboxes.sent(place) else {
            return;
        };
        self.device.sent(frame, at);
        if self.device.next_deadline() <= at {
            self.poll(at);
        } else if self.driver.mailboxes.is_full() {
            self.pump(at);
        }
    }

    fn changed(&mut self, state: ErrorState, transmit: u8, receive: u8, at: Instant) {
        let state = match state {
            ErrorState::Active | ErrorState::Warning => BusState::Active,
            ErrorState::Passive => BusState::Passive,
            ErrorState::Off => BusState::Off,
        };
        if state == BusState::Off {
            self.driver.mailboxes.clear(self.can);
            self.driver.recover_at = self.device.recovery(at);
        }
        self.device.bus_state(state, transmit, receive, at);
        self.pump(at);
    }

    /// Goes to a bit rate, or starts to look for it by listening.
    fn set_rate(&mut self, kbit_s: Option<u16>, now: Instant) {
        let search = kbit_s.is_none().then(|| Search::new(now));
        let rate = search.map_or(kbit_s, |s| Some(s.kbit_s()));
        self.driver.search = search;
        self.can.set_rate(rate.unwrap_or(0), search.is_some());
        self.device.set_bit_rate(kbit_s.unwrap_or(0));
    }

    /// LSS "activate bit timing": silence, the new rate, silence again (CiA 305).
    fn switch(&mut self, now: Instant) {
        match self.driver.switch_at {
            Some((at, Some(kbit_s))) if at <= now => {
                self.set_rate(kbit_s, now);
                let later = now.offset(i64::from(self.driver.delay_ms) * 1000);
                self.driver.switch_at = Some((later, None));
            }
            Some((at, None)) if at <= now => self.driver.switch_at = None,
            _ => {}
        }
    }

    /// Moves frames into mailboxes, and does what the device wishes.
    // Its callers would each hold a copy of it.
    #[inline(never)]
    fn pump(&mut self, now: Instant) {
        let driver = &mut *self.driver;
        let silent = driver.switch_at.is_some() || driver.search.is_some();
        driver.mailboxes.fill(self.device, self.can, silent, now);
        let node_id = self.device.bus().node_id();
        if node_id != core::mem::replace(&mut driver.node_id, node_id) {
            self.can.listen_to(node_id);
        }
        self.wish(now);
    }

    fn wish(&mut self, now: Instant) {
        match self.device.take_request() {
            None => {}
            Some(BoardRequest::Reset) => self.driver.action = Some(BoardAction::Reset),
            Some(BoardRequest::Sensor) => self.driver.action = Some(BoardAction::Sensor),
            Some(BoardRequest::BitRate { kbit_s, delay_ms }) => {
                self.driver.delay_ms = delay_ms;
                let at = now.offset(i64::from(delay_ms) * 1000);
                self.driver.switch_at = Some((at, Some(kbit_s)));
            }
        }
    }
}

#[cfg(test)]
mod tests;
