//! One node on the bus: its electronics, its CAN controller's port, and the device code.
//!
//! In: the world's events for this node (power, data-ready edges, frames, error states), each at
//! its time. Out: frames offered to the bus. This is the part that `firmware` plays on the chip:
//! it moves frames between the controller's mailboxes and the device, and does what the device
//! wishes (reset, another bit rate, return from bus-off). While a page of its flash is erased its
//! code stands still ([`Standstill`]).
//!
//! Left out: the time that code takes to run.

use canopen::Frame;
use canopen::node::BusState;
use device::bit_rate::Search;
use device::device::{BoardRequest, Device, Factory};
use device::mailboxes::{Abort, Mailboxes, Transmitter};
use device::objects::process::Shown;
use instant::Instant;
use tilt::cross_check::CrossCheck;

use super::fault::Faulty;
use super::standstill::{Held, Standstill};
use crate::can_bus::{Bus, ErrorState, Mailbox, Port};
use crate::electronics::{Driver, Electronics};
use crate::memory::{self, Memory, Program};

/// A node's code and the state of its driver.
#[derive(Debug)]
pub struct NetworkNode {
    /// Sensor, supply and clock.
    pub electronics: Electronics,
    /// The device code.
    pub device: Device<Driver, Memory>,
    /// The port on the bus.
    pub port: Port,
    /// When the device's set-up is over, ns; frames before it are not heard.
    ready_ns: u64,
    /// Powered and past its set-up.
    running: bool,
    powered: bool,
    /// What is in the controller's mailboxes.
    mailboxes: Mailboxes,
    /// When to ask the controller back from bus-off.
    recover_at: Option<Instant>,
    /// When the bit rate that LSS has activated counts, with the rate; then, when silence ends.
    switch_at: Option<(Instant, Option<Option<u16>>)>,
    delay_ms: u16,
    /// The bit rate is being looked for; nothing is sent meanwhile.
    search: Option<Search>,
    /// What goes wrong with it.
    pub(super) faulty: Faulty,
    /// What the image in the chosen slot does.
    program: Program,
    standstill: Standstill,
}

/// The controller at a port, as the driver uses it.
struct Controller<'a> {
    bus: &'a mut Bus,
    port: Port,
}

impl Transmitter for Controller<'_> {
    fn post(&mut self, place: u8, frame: &Frame) {
        let mailbox = Mailbox::ALL[usize::from(place)];
        let posted = self.bus.put(self.port, mailbox, *frame);
        debug_assert!(posted.is_ok(), "mailbox {place} is taken");
    }

    fn abort(&mut self, place: u8) -> Abort {
        let mailbox = Mailbox::ALL[usize::from(place)];
        // It has gone out during a standstill, of which the node has still to be told.
        let is_out = self.bus.waiting(self.port, mailbox).is_none();
        match !is_out && self.bus.abort(self.port, mailbox) {
            true => Abort::Done,
            false => Abort::Later,
        }
    }

    fn clear(&mut self) {
        self.bus.clear(self.port);
    }
}

fn seconds(time_ns: u64) -> f64 {
    time_ns as f64 * 1e-9
}

impl NetworkNode {
    /// A node without power: its part is drawn already, its code has not run.
    pub fn new(
        electronics: Electronics,
        check: CrossCheck,
        factory: Factory,
        memory: Memory,
        port: Port,
    ) -> Self {
        let device = Device::new(electronics.driver(), check, factory, memory);
        Self {
            electronics,
            device,
            port,
            ready_ns: 0,
            running: false,
            powered: false,
            mailboxes: Mailboxes::new(),
            recover_at: None,
            switch_at: None,
            delay_ms: 0,
            search: None,
            faulty: Faulty::default(),
            program: Program::Sound,
            standstill: Standstill::default(),
        }
    }

    /// True while the code runs and speaks.
    pub fn is_running(&self) -> bool {
        self.running
    }

    /// True while it has power.
    pub fn is_powered(&self) -> bool {
        self.powered
    }

    /// Power off: silence, and only the memory stays.
    pub fn power_off(&mut self, bus: &mut Bus) {
        self.powered = false;
        self.running = false;
        self.forget(bus);
        bus.connect(self.port, false);
    }

    /// Power on: new turn-on offsets, and the code starts.
    pub fn power_on(&mut self, bus: &mut Bus, now_ns: u64) {
        self.electronics.power_cycle();
        self.device.memory().flash_mut().nor().power_up();
        self.powered = true;
        self.reset(bus, now_ns);
    }

    fn forget(&mut self, bus: &mut Bus) {
        bus.reset(self.port);
        self.mailboxes = Mailboxes::new();
        self.recover_at = None;
        self.switch_at = None;
        self.search = None;
        self.standstill = Standstill::default();
        self.device.memory().flash_mut().take_erase_ns();
        self.faulty.forget();
        bus.listen_only(self.port, false);
    }

    /// The code stands still until a reset; the controller goes on by itself.
    pub(super) fn halt(&mut self) {
        self.running = false;
        self.ready_ns = u64::MAX;
    }

    /// The code starts anew: the part is set up first, which takes its time.
    pub fn reset(&mut self, bus: &mut Bus, now_ns: u64) {
        self.forget(bus);
        // The controller takes part once the code has set it up.
        bus.connect(self.port, false);
        self.running = false;
        self.electronics.catch_up(seconds(now_ns));
        let Some(program) = memory::boot(self.device.memory()) else {
            // The bootloader has nothing to start.
            self.ready_ns = u64::MAX;
            return;
        };
        self.program = program;
        let device = &mut self.device;
        self.electronics.run_waiting(|mut delay, now| {
            // A part that does not answer leaves its channel invalid, and the bus hears why.
            let _ = device.start_sensor(&mut delay, now);
        });
        self.ready_ns = (self.electronics.now_s() * 1e9).ceil() as u64;
    }

    /// When this node, asked at `now_ns`, next wants the processor, ns.
    pub fn next_ns(&self, now_ns: u64) -> Option<u64> {
        if !self.powered {
            return None;
        }
        if !self.running {
            return Some(self.ready_ns);
        }
        if let Some(until_ns) = self.standstill.until_ns() {
            return Some(until_ns);
        }
        let mut first = self.device.next_deadline();
        if let Some(at) = self.recover_at {
            first = first.min(at);
        }
        if let Some((at, _)) = self.switch_at {
            first = first.min(at);
        }
        if let Some(search) = &self.search {
            first = first.min(search.until());
        }
        let first_ns = self.electronics.when_ns(first);
        let faulty_ns = self.faulty.next_ns(now_ns);
        Some(faulty_ns.map_or(first_ns, |at_ns| at_ns.min(first_ns)))
    }

    fn now(&self, now_ns: u64) -> Instant {
        self.electronics.clock(seconds(now_ns))
    }

    /// What the device shows on the bus at `now_ns`.
    pub fn shown(&self, now_ns: u64) -> Shown<'_> {
        self.device.shown(self.now(now_ns))
    }

    /// A data-ready edge of `captured_ns` gets here: a sample is taken, and nothing else.
    pub fn data_ready(&mut self, captured_ns: u64) {
        // A program that is sick on purpose never gets to its samples.
        if self.running && self.program != Program::Sick && !self.takes(Held::Edge(captured_ns)) {
            self.device.data_ready(self.now(captured_ns));
        }
    }

    /// Runs what is due at `now_ns`.
    pub fn poll(&mut self, bus: &mut Bus, now_ns: u64) {
        let now = self.now(now_ns);
        if self.powered && !self.running && now_ns >= self.ready_ns {
            self.running = true;
            self.device.start_bus(now);
            self.set_rate(bus, self.device.bit_rate(), now);
            bus.connect(self.port, true);
        }
        if !self.running {
            return;
        }
        match self.standstill.until_ns() {
            Some(until_ns) if now_ns < until_ns => return,
            Some(_) => return self.go_on(bus, now_ns),
            None => {}
        }
        if self.recover_at.is_some_and(|at| at <= now) {
            self.recover_at = None;
            bus.recover(self.port);
        }
        self.switch(bus, now);
        self.faulty.poll(bus, self.port, now_ns);
        if let Some(search) = &mut self.search
            && search.poll(now)
        {
            bus.set_bit_rate(self.port, u32::from(search.kbit_s()) * 1000);
        }
        if self.device.next_deadline() <= now {
            self.electronics.settle(seconds(now_ns));
            self.device.poll(now);
            if self.stands_still(now_ns) {
                return;
            }
        }
        self.pump(bus, now_ns);
    }

    /// Whether the device has erased pages just now: then the processor stands still for them.
    fn stands_still(&mut self, now_ns: u64) -> bool {
        let erase_ns = self.device.memory().flash_mut().take_erase_ns();
        if erase_ns != 0 {
            self.standstill.begin(now_ns + erase_ns);
        }
        erase_ns != 0
    }

    /// The pages are erased: what was under way is ended, then comes what has waited.
    fn go_on(&mut self, bus: &mut Bus, now_ns: u64) {
        let lost = self.standstill.end();
        self.pump(bus, now_ns);
        let now = self.now(now_ns);
        if lost != 0 {
            self.device.frames_lost(lost, now);
        }
        self.device.stood_still(now);
        while self.running
            && let Some(held) = self.standstill.next()
        {
            match held {
                Held::Edge(captured_ns) => self.data_ready(captured_ns),
                Held::Sent(mailbox, frame) => self.sent(bus, mailbox, &frame, now_ns),
                Held::Received(frame) => self.receive(bus, &frame, now_ns),
                Held::Changed(state) => self.bus_changed(bus, state, now_ns),
            }
        }
    }

    /// Goes to a bit rate, or starts to look for it by listening.
    fn set_rate(&mut self, bus: &mut Bus, kbit_s: Option<u16>, now: Instant) {
        self.search = kbit_s.is_none().then(|| Search::new(now));
        let rate = self.search.map_or(kbit_s, |s| Some(s.kbit_s()));
        bus.listen_only(self.port, self.search.is_some());
        bus.set_bit_rate(self.port, u32::from(rate.unwrap_or(0)) * 1000);
        self.device.set_bit_rate(kbit_s.unwrap_or(0));
    }

    /// LSS "activate bit timing": silence, the new rate, silence again.
    fn switch(&mut self, bus: &mut Bus, now: Instant) {
        match self.switch_at {
            Some((at, Some(kbit_s))) if at <= now => {
                self.set_rate(bus, kbit_s, now);
                let later = now.offset(i64::from(self.delay_ms) * 1000);
                self.switch_at = Some((later, None));
            }
            Some((at, None)) if at <= now => self.switch_at = None,
            _ => {}
        }
    }

    /// True while the processor stands still, in which case it gets this later.
    fn takes(&mut self, held: Held) -> bool {
        self.standstill.takes(held, self.device.bus().node_id())
    }

    /// A frame has ended that this node's controller took.
    pub fn receive(&mut self, bus: &mut Bus, frame: &Frame, at_ns: u64) {
        let sync = &self.device.bus().communication().sync;
        if self.faulty.is_deaf_to_sync() && sync.recognises(frame) {
            return;
        }
        if self.running && !self.takes(Held::Received(*frame)) {
            let now = self.now(at_ns);
            let found = self.search;
            if let Some(found) = found {
                self.set_rate(bus, Some(found.kbit_s()), now);
            }
            self.device.receive(frame, now);
            if self.stands_still(at_ns) {
                return;
            }
            // What the device wants to do about it is done at once.
            if found.is_some() || self.device.next_deadline() <= now {
                self.poll(bus, at_ns);
            }
        }
    }

    /// One of this node's frames has gone out.
    pub fn sent(&mut self, bus: &mut Bus, mailbox: usize, frame: &Frame, at_ns: u64) {
        if self.running && self.takes(Held::Sent(mailbox, *frame)) {
            return;
        }
        self.mailboxes.sent(mailbox as u8);
        if self.running {
            let now = self.now(at_ns);
            self.device.sent(frame, now);
            if self.device.next_deadline() <= now {
                self.poll(bus, at_ns);
            } else if self.mailboxes.is_full() {
                self.pump(bus, at_ns);
            }
        }
    }

    /// The controller's error state is another one.
    pub fn bus_changed(&mut self, bus: &mut Bus, state: ErrorState, at_ns: u64) {
        if !self.running || self.takes(Held::Changed(state)) {
            return;
        }
        let now = self.now(at_ns);
        let counters = bus.counters(self.port);
        let state = match state {
            ErrorState::Active | ErrorState::Warning => BusState::Active,
            ErrorState::Passive => BusState::Passive,
            ErrorState::BusOff => BusState::Off,
        };
        if state == BusState::Off {
            let port = self.port;
            self.mailboxes.clear(&mut Controller { bus, port });
            self.recover_at = self.device.recovery(now);
        }
        let [sending, receiving] =
            [counters.transmit(), counters.receive()].map(|c| c.min(255) as u8);
        self.device.bus_state(state, sending, receiving, now);
        self.pump(bus, at_ns);
    }

    /// Shows the device how busy the bus is, per cent.
    pub fn set_load(&mut self, percent: u8) {
        self.device.set_bus_load(percent);
    }

    /// Moves frames into mailboxes, and does what the device wishes.
    fn pump(&mut self, bus: &mut Bus, now_ns: u64) {
        let now = self.now(now_ns);
        self.give_up(bus, now);
        let silent = self.switch_at.is_some() || self.search.is_some();
        let late = self.faulty.is_late() && !silent;
        let port = self.port;
        let mut can = Controller { bus, port };
        let Self {
            mailboxes, device, ..
        } = self;
        mailboxes.fill(device, &mut can, silent || late, now);
        if late {
            self.pump_late(&mut can, now, now_ns);
        }
        self.wish(bus, now, now_ns);
    }

    /// A frame that was to be taken back when it was on the wire, and was not sent, is no longer
    /// in its mailbox. Nor is one that was sent during a standstill, of which the node has still
    /// to be told.
    fn give_up(&mut self, bus: &Bus, now: Instant) {
        for (place, mailbox) in (0..).zip(Mailbox::ALL) {
            let is_out = bus.waiting(self.port, mailbox).is_none();
            let is_sent = self.standstill.has_sent(mailbox.number());
            if self.mailboxes.is_leaving(place) && is_out && !is_sent {
                self.mailboxes.given_up(place, &mut self.device, now);
            }
        }
    }

    /// An attempt to send has failed; one that was taken back meanwhile is not repeated.
    pub fn failed(&mut self, bus: &mut Bus, at_ns: u64) {
        let leaving = (0..)
            .zip(Mailbox::ALL)
            .any(|(n, _)| self.mailboxes.is_leaving(n));
        if self.running && self.standstill.until_ns().is_none() && leaving {
            self.pump(bus, at_ns);
        }
    }

    /// [`NetworkNode::pump`] of a node whose frames get to the controller late.
    fn pump_late(&mut self, can: &mut Controller<'_>, now: Instant, now_ns: u64) {
        while let Some(frame) = self.mailboxes.take_out() {
            self.faulty.delay(frame, now_ns);
        }
        while let Some(frame) = self.device.transmit(now) {
            self.faulty.delay(frame, now_ns);
        }
        while let Some(frame) = self.faulty.arriving(now_ns)
            && self.mailboxes.offer(&frame, can)
        {
            self.faulty.arrived();
        }
    }

    fn wish(&mut self, bus: &mut Bus, now: Instant, now_ns: u64) {
        match self.device.take_request() {
            None => {}
            Some(BoardRequest::Reset) => self.reset(bus, now_ns),
            Some(BoardRequest::Sensor) => {
                self.electronics.catch_up(seconds(now_ns));
                let device = &mut self.device;
                self.electronics.run_waiting(|mut delay, now| {
                    // A part that still does not answer leaves its channel invalid.
                    let _ = device.restart_sensor(&mut delay, now);
                });
            }
            Some(BoardRequest::BitRate { kbit_s, delay_ms }) => {
                self.delay_ms = delay_ms;
                let at = now.offset(i64::from(delay_ms) * 1000);
                self.switch_at = Some((at, Some(kbit_s)));
            }
        }
    }
}
