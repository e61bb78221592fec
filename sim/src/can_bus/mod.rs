//! The CAN bus: frames in virtual time, with arbitration, acknowledgement and errors.
//!
//! In: frames offered by controllers, faults on demand. Out: [`Event`]s at their exact times in
//! ns. The model is one of frames (ISO 11898-1, classical CAN): the length of each is counted in
//! bits, stuffing included, and what a single bit would do is worked out when its frame begins.
//! Nothing depends on a clock; the same calls give the same [`Bus::fingerprint`].
//!
//! A world offers frames at [`Bus::now_ns`], then calls [`Bus::step`] with the time up to which it
//! wants to go until that gives `None`. Who offers at the instant at which the bus falls idle
//! takes part in that arbitration: a frame begins only once time passes that instant.
//!
//! Left out: CAN FD; overload frames, but for the answer to an error in the last bits; propagation
//! delay and the drift of clocks; a node cut off from the bus that talks to itself, whose
//! counters stand still here; and a change of who acknowledges within one frame.
//!
//! ```
//! use canopen::Frame;
//! use sim::can_bus::{Bus, Event, TransmitOrder};
//! let mut bus = Bus::new(500_000, 1);
//! let (node, _host) =
//!     (bus.attach(TransmitOrder::Identifier), bus.attach(TransmitOrder::Identifier));
//! bus.offer(node, Frame::data_frame(0x701, &[0])).unwrap();
//! // 19 header, 8 data, 15 CRC and 4 stuff bits, then 9 more, each of 2 us.
//! let first = bus.step(1_000_000);
//! assert!(matches!(first, Some(Event::Delivered { at_ns: 110_000, .. })), "{first:?}");
//! ```

mod attempt;
mod confinement;
mod controller;
mod event;
mod faults;
mod ports;
mod progress;
mod statistics;
mod wire;

#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use canopen::Frame;

use attempt::{Attempt, FLAG_BITS};
use controller::{Controller, Source};

pub use confinement::{Counters, ErrorState};
pub use controller::{Busy, MAILBOXES, Mailbox, TransmitOrder};
pub use event::{ErrorKind, Event};
pub use faults::{Fault, Faults, Rates};
pub use ports::{MOST_PORTS, Port, Ports};
pub use statistics::Statistics;
pub use wire::{INTERMISSION_BITS, frame_bits, priority};

/// An error passive sender waits so long after the intermission, unless another one begins.
const SUSPEND_BITS: u64 = 8;
/// What a controller has to see before it leaves bus-off, so often...
const RECOVERY_SEQUENCES: u64 = 128;
/// ...and so many recessive bits each time; every frame ends with as many.
const RECOVERY_BITS: u64 = 11;

/// The offset basis of FNV-1a.
const FINGERPRINT_START: u64 = 0xcbf2_9ce4_8422_2325;

/// What the bus is doing.
#[derive(Clone, Debug)]
enum Phase {
    /// A frame may begin from this time on, ns.
    Idle { since_ns: u64 },
    /// A frame is on the wire.
    Busy(Box<Attempt>),
    /// The wires are held dominant.
    Held(Held),
}

/// A bus that is shorted to dominant.
#[derive(Clone, Copy, Debug)]
struct Held {
    start_ns: u64,
    until_ns: u64,
    next_ns: u64,
    /// When the first error flag began; `None` before.
    flagged_ns: Option<u64>,
    /// Who was sending when it began.
    senders: Ports,
}

/// Whether all who are on the bus get on with each other, so that a lone sender's frame goes well.
#[derive(Clone, Copy, Debug)]
enum Harmony {
    /// A setting has changed since that was looked at.
    Unknown,
    /// Bit rates differ, or somebody only listens or flags errors passively.
    Not,
    /// These hear each other, at this length of a bit.
    Among(Ports, u64),
}

/// One bus with its controllers.
#[derive(Clone, Debug)]
pub struct Bus {
    now_ns: u64,
    bit_ns: u64,
    controllers: Vec<Controller>,
    /// Who has a frame to send.
    pending: Ports,
    /// What is known of the controllers while their settings stay.
    harmony: Harmony,
    /// Who is on its way back from bus-off.
    recovering: Ports,
    phase: Phase,
    /// Room for the next attempt: that of the last one.
    spare: Option<Box<Attempt>>,
    events: VecDeque<Event>,
    faults: Faults,
    /// `busy_ns` counts to the end of the last frame, `at_ns` isn't kept.
    statistics: Statistics,
    fingerprint: u64,
}

/// A bit at this rate, rounded to whole ns, at least 1.
fn bit_ns(bit_rate: u32) -> u64 {
    let rate = u64::from(bit_rate.max(1));
    ((1_000_000_000 + rate / 2) / rate).max(1)
}

impl Bus {
    /// A bus at time 0 without controllers; those attached get this bit rate, bit/s.
    ///
    /// A bit lasts a whole number of ns, which is exact for every rate of CiA 301. `seed` decides
    /// nothing until [`Faults::set_rates`].
    pub fn new(bit_rate: u32, seed: u64) -> Self {
        Self {
            now_ns: 0,
            bit_ns: bit_ns(bit_rate),
            controllers: Vec::new(),
            pending: Ports::NONE,
            harmony: Harmony::Unknown,
            recovering: Ports::NONE,
            phase: Phase::Idle { since_ns: 0 },
            spare: None,
            events: VecDeque::new(),
            faults: Faults::none(seed),
            statistics: Statistics::default(),
            fingerprint: FINGERPRINT_START,
        }
    }

    /// Connects one more controller, error active, with empty mailboxes.
    ///
    /// # Panics
    /// When there are [`MOST_PORTS`] already.
    pub fn attach(&mut self, order: TransmitOrder) -> Port {
        let port = Port::new(self.controllers.len());
        let port = port.expect("a bus has at most 128 controllers: attach fewer");
        self.controllers.push(Controller::new(self.bit_ns, order));
        self.harmony = Harmony::Unknown;
        port
    }

    /// The time up to which everything has happened, ns.
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Puts a frame into the first free mailbox, now. A controller that is cut off, off the bus or
    /// in listen-only mode keeps it until it may send.
    pub fn offer(&mut self, port: Port, frame: Frame) -> Result<Mailbox, Busy> {
        self.place(port, frame, false)
    }

    /// Puts a frame into this mailbox, as a driver does that has chosen it. Errors: it is taken.
    pub fn put(&mut self, port: Port, mailbox: Mailbox, frame: Frame) -> Result<(), Busy> {
        self.controller(port).put(mailbox, frame, false)?;
        self.pending.insert(port);
        Ok(())
    }

    /// [`Bus::offer`] of a frame that is not repeated when its attempt on the wire fails (bxCAN,
    /// NART = 1); one that loses an arbitration waits on.
    pub fn offer_once(&mut self, port: Port, frame: Frame) -> Result<Mailbox, Busy> {
        self.place(port, frame, true)
    }

    fn place(&mut self, port: Port, frame: Frame, once: bool) -> Result<Mailbox, Busy> {
        let mailbox = self.controller(port).offer(frame, once)?;
        self.pending.insert(port);
        Ok(mailbox)
    }

    /// The mailbox whose frame is on the wire from this controller.
    pub fn on_wire(&self, port: Port) -> Option<Mailbox> {
        match self.controllers[port.index()].sending? {
            Source::Mailbox(mailbox) => Some(mailbox),
            Source::Babble => None,
        }
    }

    /// What waits in a mailbox, or is on the wire from it.
    pub fn waiting(&self, port: Port, mailbox: Mailbox) -> Option<Frame> {
        self.controllers[port.index()].frame_in(mailbox)
    }

    /// Empties a mailbox. `false` when its frame is on the wire: it may still be sent, but is not
    /// repeated.
    pub fn abort(&mut self, port: Port, mailbox: Mailbox) -> bool {
        let empty = self.controller(port).abort(mailbox);
        self.settle(port);
        empty
    }

    /// Empties every mailbox of a controller.
    pub fn clear(&mut self, port: Port) {
        self.controller(port).abort_all();
        self.settle(port);
    }

    /// From now on this controller sends the frame without a pause; `None` ends that.
    pub fn babble(&mut self, port: Port, frame: Option<Frame>) {
        self.controller(port).babble(frame);
        self.settle(port);
    }

    /// Sets a controller's bit rate, bit/s, from the next frame on.
    pub fn set_bit_rate(&mut self, port: Port, bit_rate: u32) {
        self.controller(port).bit_ns = bit_ns(bit_rate);
        self.harmony = Harmony::Unknown;
    }

    /// In listen-only mode a controller neither sends nor acknowledges nor flags errors; it
    /// receives and counts. From the next frame on.
    pub fn listen_only(&mut self, port: Port, on: bool) {
        self.controller(port).listen_only = on;
        self.harmony = Harmony::Unknown;
    }

    /// Cuts a controller off the wires, or connects it again. A frame it was sending breaks off,
    /// and stays in its mailbox.
    pub fn connect(&mut self, port: Port, connected: bool) {
        self.controller(port).connected = connected;
        self.harmony = Harmony::Unknown;
        if !connected {
            self.silence(port);
            self.controller(port).fail();
            self.settle(port);
        }
    }

    /// Power-on reset of a controller: mailboxes empty, counters 0, no recovery needed. A frame it
    /// was sending breaks off. Its bit rate, mode and wiring stay.
    pub fn reset(&mut self, port: Port) {
        self.silence(port);
        let controller = self.controller(port);
        controller.abort_all();
        controller.counters = Counters::default();
        controller.ready_ns = 0;
        self.recovering.remove(port);
        self.settle(port);
        self.tell(port);
    }

    /// Asks a controller that is off the bus to come back; others ignore it. It does after 128
    /// sequences of 11 recessive bits, with both counters 0 and its mailboxes as they were.
    pub fn recover(&mut self, port: Port) {
        let (now_ns, recovering) = (self.now_ns, self.recovering.contains(port));
        let controller = self.controller(port);
        if controller.told != ErrorState::BusOff || recovering {
            return;
        }
        controller.recovery_left = RECOVERY_SEQUENCES;
        controller.recovery_from_ns = now_ns;
        self.recovering.insert(port);
    }

    /// Holds the bus dominant from now until a time, ns; does nothing when that has passed.
    pub fn short_until(&mut self, until_ns: u64) {
        if until_ns <= self.now_ns {
            return;
        }
        let (start_ns, senders, wait_bits) = match &mut self.phase {
            Phase::Held(held) => {
                held.until_ns = held.until_ns.max(until_ns);
                return;
            }
            // A sender soon reads dominant where it sent recessive, a receiver after six bits.
            Phase::Busy(attempt) => (attempt.start_ns, attempt.senders.with(attempt.dropped), 1),
            Phase::Idle { since_ns } => {
                // The intermission already counted as busy ends here.
                let uncounted_ns = since_ns.saturating_sub(self.now_ns);
                self.statistics.busy_ns -= uncounted_ns.min(self.statistics.busy_ns);
                (self.now_ns, Ports::NONE, FLAG_BITS)
            }
        };
        self.pass_idle(self.now_ns);
        self.phase = Phase::Held(Held {
            start_ns,
            until_ns,
            next_ns: self.now_ns + wait_bits * self.bit_ns,
            flagged_ns: None,
            senders,
        });
    }

    /// The faults planned and drawn for this bus.
    pub fn faults(&mut self) -> &mut Faults {
        &mut self.faults
    }

    /// A controller's error counters.
    pub fn counters(&self, port: Port) -> Counters {
        self.controllers[port.index()].counters
    }

    /// A controller's error state.
    pub fn state(&self, port: Port) -> ErrorState {
        self.controllers[port.index()].told
    }

    /// The counts up to now; the load of a window is that between two snapshots.
    pub fn statistics(&self) -> Statistics {
        let busy_ns = self.statistics.busy_ns;
        let busy_ns = match &self.phase {
            Phase::Idle { since_ns } => busy_ns - since_ns.saturating_sub(self.now_ns).min(busy_ns),
            Phase::Busy(attempt) => busy_ns + (self.now_ns - attempt.start_ns),
            Phase::Held(held) => busy_ns + (self.now_ns - held.start_ns),
        };
        Statistics {
            at_ns: self.now_ns,
            busy_ns,
            ..self.statistics
        }
    }

    /// A hash over every event so far; two runs with the same one were the same.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// No event comes before this time, ns, unless something is offered or changed; `None`: never.
    ///
    /// It lies after now, or is now when events wait. It may pass without an event.
    pub fn next_event(&self) -> Option<u64> {
        match self.events.front() {
            Some(_) => Some(self.now_ns),
            None => self.due().map(|due| match due {
                // A frame begins after its instant has passed, so that all may offer at it.
                Due::Start(at_ns) => at_ns + 1,
                Due::Recovery(at_ns, _) | Due::Wire(at_ns) => at_ns,
            }),
        }
    }

    /// Goes to the next event, but not past `limit_ns`; `None` once the bus has come there, which
    /// leaves [`Bus::now_ns`] at the limit.
    #[inline]
    pub fn step(&mut self, limit_ns: u64) -> Option<Event> {
        // The most frequent case by far.
        if self.is_quiet() {
            self.now_ns = self.now_ns.max(limit_ns);
            return None;
        }
        self.go_on(limit_ns)
    }

    /// [`Bus::step`] where something may happen.
    fn go_on(&mut self, limit_ns: u64) -> Option<Event> {
        loop {
            if let Some(event) = self.events.pop_front() {
                return Some(event);
            }
            match self.due() {
                Some(Due::Wire(at_ns)) if at_ns <= limit_ns => self.advance(at_ns),
                Some(Due::Recovery(at_ns, port)) if at_ns <= limit_ns => {
                    self.now_ns = self.now_ns.max(at_ns);
                    self.recovered(port);
                }
                Some(Due::Start(at_ns)) if at_ns < limit_ns => self.begin(at_ns),
                _ => {
                    self.now_ns = self.now_ns.max(limit_ns);
                    return None;
                }
            }
        }
    }
}

/// What the bus does next by itself, and when, ns.
enum Due {
    Start(u64),
    Recovery(u64, Port),
    Wire(u64),
}

impl Bus {
    /// True when nothing happens by itself: nothing to tell or to send, nobody on the way back.
    pub(crate) fn is_quiet(&self) -> bool {
        let idle = matches!(self.phase, Phase::Idle { .. });
        idle && self.pending.with(self.recovering).is_empty() && self.events.is_empty()
    }

    fn controller(&mut self, port: Port) -> &mut Controller {
        &mut self.controllers[port.index()]
    }

    fn emit(&mut self, event: Event) {
        self.fingerprint = event.hash(self.fingerprint);
        self.events.push_back(event);
    }

    /// Tells when a controller's state is no more what was told last.
    fn tell(&mut self, port: Port) {
        let at_ns = self.now_ns;
        let controller = self.controller(port);
        let state = controller.counters.state();
        if state != controller.told {
            controller.told = state;
            self.harmony = Harmony::Unknown;
            self.emit(Event::Changed { port, state, at_ns });
        }
    }

    /// Notes whether a controller still has something to send.
    fn settle(&mut self, port: Port) {
        if self.controllers[port.index()].has_frames() {
            self.pending.insert(port);
        } else {
            self.pending.remove(port);
        }
    }

    fn silence(&mut self, port: Port) {
        let now_ns = self.now_ns;
        match &mut self.phase {
            Phase::Busy(attempt) => attempt.cut(port, now_ns),
            Phase::Held(held) => held.senders.remove(port),
            Phase::Idle { .. } => {}
        }
    }

    fn due(&self) -> Option<Due> {
        match &self.phase {
            Phase::Busy(attempt) => attempt.next_ns().map(Due::Wire),
            Phase::Held(held) => Some(Due::Wire(held.next_ns)),
            Phase::Idle { since_ns } => self.due_when_idle(*since_ns),
        }
    }

    fn due_when_idle(&self, since_ns: u64) -> Option<Due> {
        let mut ready_ns = None;
        for port in self.pending.iter() {
            let controller = &self.controllers[port.index()];
            if controller.speaks() {
                let before_ns = ready_ns.unwrap_or(u64::MAX);
                ready_ns = Some(controller.ready_ns.min(before_ns));
            }
        }
        let start = ready_ns.map(|ready_ns| ready_ns.max(since_ns).max(self.now_ns));
        if self.recovering.is_empty() {
            return start.map(Due::Start);
        }
        let recovery = (self.recovering.iter())
            .map(|port| (self.recovery_ns(port, since_ns), port))
            .min();
        match (start, recovery) {
            (Some(start), Some((at_ns, _))) if start < at_ns => Some(Due::Start(start)),
            (_, Some((at_ns, port))) => Some(Due::Recovery(at_ns, port)),
            (start, None) => start.map(Due::Start),
        }
    }

    /// When a controller will have seen enough of an idle bus, ns.
    fn recovery_ns(&self, port: Port, since_ns: u64) -> u64 {
        let controller = &self.controllers[port.index()];
        let bits = controller.recovery_left * RECOVERY_BITS;
        since_ns.max(controller.recovery_from_ns) + bits * controller.bit_ns
    }

    fn recovered(&mut self, port: Port) {
        self.recovering.remove(port);
        let controller = self.controller(port);
        controller.recovery_left = 0;
        controller.counters = Counters::default();
        self.tell(port);
    }

    /// Counts the recessive bits of an idle bus that ends now.
    fn pass_idle(&mut self, at_ns: u64) {
        let Phase::Idle { since_ns } = self.phase else {
            return;
        };
        for port in self.recovering.iter() {
            let controller = &mut self.controllers[port.index()];
            let from_ns = since_ns.max(controller.recovery_from_ns);
            let sequences = at_ns.saturating_sub(from_ns) / (RECOVERY_BITS * controller.bit_ns);
            controller.recovery_left = controller.recovery_left.saturating_sub(sequences);
        }
    }

    /// A frame or an error frame is over; the next may begin at `since_ns`.
    fn fall_idle(&mut self, start_ns: u64, since_ns: u64) {
        self.statistics.busy_ns += since_ns - start_ns;
        self.phase = Phase::Idle { since_ns };
        for port in self.recovering.iter() {
            let controller = self.controller(port);
            // The end of every frame, intermission included, is one such sequence.
            let tail_ns = RECOVERY_BITS * controller.bit_ns;
            if controller.recovery_from_ns + tail_ns <= since_ns {
                controller.recovery_left = controller.recovery_left.saturating_sub(1);
            }
        }
    }
}
