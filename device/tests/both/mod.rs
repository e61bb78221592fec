//! Two devices on a bus without delay, with a master: a world that can be copied at any instant.
//!
//! In: actions of a master, of a fitter and of what breaks. Out: every frame on the bus, and how
//! both nodes stand. Registers of the parts have a noise that goes along with them, so that one
//! world behaves as its copy.
//!
//! Left out: bit times and memory. A node that starts anew gets its parameters from the master.

pub mod nothing;
pub mod part;
pub mod rules;

use canopen::Frame;
use canopen::nmt::State;
use canopen::node::BusState;
use device::calibration::deliver;
use device::device::{BoardRequest, Device};
use device::mailboxes::{Abort, Mailboxes, Transmitter};
use device::objects::table::Channel;
use instant::Instant;
use tilt::cross_check::CrossCheck;

use nothing::Nothing;
use part::{Driver, Hurry, Kind, NOISE, Part, Registers, driver, factory};

/// The two nodes.
pub const NODES: [usize; 2] = [0, 1];

/// Time between two samples of the slower part, us.
pub const TICK_US: i64 = 2_500;

/// Mailboxes of a CAN controller.
#[derive(Clone, Default)]
struct Controller([Option<Frame>; 3]);

impl Transmitter for Controller {
    fn post(&mut self, mailbox: u8, frame: &Frame) {
        self.0[usize::from(mailbox)] = Some(*frame);
    }

    fn abort(&mut self, mailbox: u8) -> Abort {
        self.0[usize::from(mailbox)] = None;
        Abort::Done
    }

    fn clear(&mut self) {
        self.0 = [None; 3];
    }
}

/// The policy under test, which a master writes to both nodes.
#[derive(Clone, Copy, Debug)]
pub struct Policy {
    /// 2004h.
    pub latch_s: u16,
    /// 2005h.
    pub degraded: u8,
}

/// A node, its part and its connection.
#[derive(Clone)]
pub struct Node {
    pub device: Device<Driver, Nothing>,
    part: Part,
    registers: Registers,
    pub powered: bool,
    /// The wire to the bus is whole.
    pub wired: bool,
    /// The controller is off the bus.
    pub off: bool,
    mailboxes: Mailboxes,
    controller: Controller,
}

impl Node {
    fn new(kind: Kind, number: usize) -> Self {
        let registers = Registers::level(kind, number);
        let part = Part::new(registers);
        let check = CrossCheck::product();
        let channel = [Channel::A, Channel::B][number];
        let part_of = (kind.config(), kind.models());
        let factory = factory(part_of, channel, 1 + number as u32, NOISE);
        let mut memory = Nothing::NEW;
        // There is room for it.
        let _ = deliver(&mut memory, &kind.delivered());
        Self {
            device: Device::new(driver(kind, part.clone()), check, factory, memory),
            part,
            registers,
            powered: false,
            wired: true,
            off: false,
            mailboxes: Mailboxes::new(),
            controller: Controller::default(),
        }
    }

    /// True when the bus hears it and it hears the bus.
    pub const fn is_connected(&self) -> bool {
        self.powered && self.wired && !self.off
    }

    pub fn is_operational(&self) -> bool {
        self.powered && self.device.bus().state() == State::Operational
    }
}

/// The world.
#[derive(Clone)]
pub struct World {
    pub nodes: [Node; 2],
    pub now: Instant,
    /// Time between two samples, us.
    tick_us: i64,
    /// Time between two SYNCs, us; `None`: the master sends none.
    pub sync_us: Option<i64>,
    next_sync: Instant,
    policy: Policy,
    /// The exchange of this node gets lost once.
    lose: [bool; 2],
    /// This PDO of the exchange of a node does not arrive, by its place in [`EXCHANGE`].
    pub omitted: [Option<usize>; 2],
}

/// Identifiers of the PDOs of an exchange, for node-id 0.
pub const EXCHANGE: [u16; 3] = [0x380, 0x480, 0x400];

/// One frame and when it was on the bus; who sent it, `None` for the master.
#[derive(Clone, Copy, Debug)]
pub struct Heard {
    pub at: Instant,
    pub by: Option<usize>,
    pub frame: Frame,
}

impl World {
    /// Both nodes without power.
    pub fn new(kind: Kind, policy: Policy) -> Self {
        let now = Instant(1_000_000);
        Self {
            nodes: NODES.map(|number| Node::new(kind, number)),
            now,
            tick_us: i64::from(kind.config().period_us()),
            sync_us: Some(20_000),
            next_sync: now,
            policy,
            lose: [false; 2],
            omitted: [None; 2],
        }
    }

    /// Puts this world's registers behind the parts, before anything happens in it.
    pub fn load(&mut self) {
        for node in &mut self.nodes {
            node.part.put(node.registers);
        }
    }

    /// Takes them back, after it.
    pub fn save(&mut self) {
        for node in &mut self.nodes {
            node.registers = node.part.get();
        }
    }

    /// The part of a node.
    pub fn part(&self, number: usize) -> &Part {
        &self.nodes[number].part
    }

    /// Power on, or a reset: the code starts, and the master writes the parameters.
    pub fn boot(&mut self, number: usize) {
        let now = self.now;
        let node = &mut self.nodes[number];
        node.powered = true;
        node.off = false;
        node.mailboxes.clear(&mut node.controller);
        // The part answers at once, and so the set-up cannot fail.
        let _ = node.device.start_sensor(&mut Hurry, now);
        node.device.start_bus(now);
        self.configure(number);
    }

    pub fn power_off(&mut self, number: usize) {
        let node = &mut self.nodes[number];
        node.powered = false;
        node.mailboxes.clear(&mut node.controller);
    }

    pub fn bus_off(&mut self, number: usize) {
        let now = self.now;
        let node = &mut self.nodes[number];
        node.off = true;
        node.mailboxes.clear(&mut node.controller);
        node.device.bus_state(BusState::Off, 255, 0, now);
    }

    pub fn recover(&mut self, number: usize) {
        let now = self.now;
        let node = &mut self.nodes[number];
        node.off = false;
        node.device.bus_state(BusState::Active, 0, 0, now);
    }

    /// The next exchange of a node gets lost.
    pub fn lose_exchange(&mut self, number: usize) {
        self.lose[number] = true;
    }

    /// 2004h, 2005h and the safety frames as delivered, by SDO.
    fn configure(&mut self, number: usize) {
        let [low, high] = self.policy.latch_s.to_le_bytes();
        let writes = [
            [0x2B, 0x04, 0x20, 0, low, high, 0, 0],
            [0x2F, 0x05, 0x20, 0, self.policy.degraded, 0, 0, 0],
            [0x2F, 0xFE, 0x13, 0, 0xA5, 0, 0, 0],
            [0x2F, 0xFE, 0x63, 0, 0xA5, 0, 0, 0],
        ];
        // Boot-up first: before it nothing is served.
        self.flush(number);
        for write in writes {
            let request = Frame::data_frame(0x601 + number as u16, &write);
            self.nodes[number].device.receive(&request, self.now);
            assert!(self.flush(number), "{write:X?}");
        }
    }

    /// Everything that a node has to send goes to the master alone; true when it has agreed to a
    /// write.
    fn flush(&mut self, number: usize) -> bool {
        let device = &mut self.nodes[number].device;
        let mut agreed = false;
        while let Some(frame) = device.transmit(self.now) {
            device.sent(&frame, self.now);
            agreed |= frame.bytes().first() == Some(&0x60);
        }
        agreed
    }

    /// A frame of the master.
    pub fn command(&mut self, id: u16, bytes: &[u8], heard: &mut dyn FnMut(&Self, Heard)) {
        let frame = Frame::data_frame(id, bytes);
        self.deliver(None, frame, heard);
        self.pump(heard);
    }

    /// Time passes; `heard` gets every frame.
    pub fn run(&mut self, us: i64, heard: &mut dyn FnMut(&Self, Heard)) {
        let until = self.now.offset(us);
        while self.now < until {
            self.now = self.now.offset(self.tick_us);
            for node in self.nodes.iter_mut().filter(|node| node.powered) {
                node.device.data_ready(self.now);
            }
            self.pump(heard);
            if let Some(period_us) = self.sync_us
                && self.now >= self.next_sync
            {
                self.next_sync = self.next_sync.offset(period_us);
                self.command(0x80, &[], heard);
            }
        }
    }

    /// SYNC comes at this period from now on, or not at all.
    pub fn set_sync(&mut self, sync_us: Option<i64>) {
        self.sync_us = sync_us;
        self.next_sync = self.now.offset(sync_us.unwrap_or(0));
    }

    /// Lets both do what is due until neither has anything left to send.
    fn pump(&mut self, heard: &mut dyn FnMut(&Self, Heard)) {
        for number in NODES {
            self.serve(number);
        }
        while let Some((number, frame)) = self.arbitrate() {
            self.deliver(Some(number), frame, heard);
            for number in NODES {
                self.serve(number);
            }
        }
    }

    fn serve(&mut self, number: usize) {
        let now = self.now;
        let node = &mut self.nodes[number];
        if !node.powered {
            return;
        }
        if node.device.next_deadline() <= now {
            node.device.poll(now);
        }
        let Node {
            device,
            mailboxes,
            controller,
            off,
            ..
        } = node;
        mailboxes.fill(device, controller, *off, now);
        match node.device.take_request() {
            Some(BoardRequest::Reset) => self.boot(number),
            Some(BoardRequest::Sensor) => {
                let _ = node.device.restart_sensor(&mut Hurry, now);
            }
            Some(BoardRequest::BitRate { .. }) | None => {}
        }
    }

    /// The frame of the lowest identifier that a connected node has.
    fn arbitrate(&mut self) -> Option<(usize, Frame)> {
        let connected = |number: &usize| self.nodes[*number].is_connected();
        let first = |number: usize| {
            let frames = self.nodes[number].controller.0.iter().enumerate();
            let frames =
                frames.filter_map(|(place, frame)| Some((frame.as_ref()?.cob_id(), place)));
            let (id, place) = frames.min()?;
            Some((id, number, place))
        };
        let (_, number, place) = NODES
            .into_iter()
            .filter(connected)
            .filter_map(first)
            .min()?;
        let node = &mut self.nodes[number];
        node.mailboxes.sent(place as u8);
        Some((number, node.controller.0[place].take()?))
    }

    /// Nobody receives this frame of a node.
    fn loses(&mut self, number: usize, frame: &Frame) -> bool {
        let is = |pdo: u16| frame.cob_id() == Some(pdo + number as u16 + 1);
        let once = is(EXCHANGE[0]) && std::mem::take(&mut self.lose[number]);
        once || self.omitted[number].is_some_and(|pdo| is(EXCHANGE[pdo]))
    }

    fn deliver(&mut self, by: Option<usize>, frame: Frame, heard: &mut dyn FnMut(&Self, Heard)) {
        let at = self.now;
        if let Some(number) = by {
            self.nodes[number].device.sent(&frame, at);
        }
        let lost = by.is_some_and(|number| self.loses(number, &frame));
        for number in NODES {
            if Some(number) != by && self.nodes[number].is_connected() && !lost {
                self.nodes[number].device.receive(&frame, at);
            }
        }
        heard(self, Heard { at, by, frame });
    }
}
