//! Instruments on a CAN bus: every node with its own part, crystal, supply and memory, one
//! housing, one bus.
//!
//! In: a [`Mover`] that gives what the housing feels, and the time up to which to go. Out: the
//! bus's events at their exact times, nodes to look into, and ports for whoever else is on the
//! bus. Events happen in the order of their times, so two runs with the same calls are the same,
//! bit for bit.
//!
//! Left out: the time that code takes to run: a node answers at the instant at which it is asked.

mod fault;
pub mod guest;
pub mod hand;
pub mod instrument;
mod node;
mod standstill;

#[cfg(test)]
mod tests;

use canopen::Frame;
use device::device::Factory;
use device::objects::process::Shown;
use tilt::cross_check::CrossCheck;

use crate::TICK_S;
use crate::can_bus::{Bus, Event, Port, Ports, Statistics, TransmitOrder};
use crate::electronics::{Electronics, whole};
use crate::memory::Memory;
use crate::motion::Mover;
use crate::rng::Rng;

use guest::Guest;

pub use node::NetworkNode;

/// A tick of the world in ns.
const TICK_NS: u64 = (TICK_S * 1e9) as u64;

/// Time between two looks at the bus load, ns.
const LOAD_NS: u64 = 1_000_000_000;

/// A node that wants nothing.
const NEVER: u64 = u64::MAX;

/// Nodes on a bus.
#[derive(Debug)]
pub struct Network {
    /// The bus.
    pub bus: Bus,
    nodes: Vec<NetworkNode>,
    /// Nodes whose code runs elsewhere.
    guests: Vec<Box<dyn Guest>>,
    /// When each node next wants the processor, ns, [`NEVER`] without power; kept while time goes
    /// on, since that is asked more often than it changes.
    due_ns: Vec<u64>,
    /// The first of them.
    first_due_ns: u64,
    /// Data-ready edges of the tick under way: time, node and time stamp, the latest first.
    edges: Vec<(u64, usize, u64)>,
    /// End of the tick under way, ns.
    tick_ns: u64,
    counted: Statistics,
    load_percent: u8,
    seed: u64,
}

impl Network {
    /// An empty bus at time 0; `seed` is for the bus's own faults and for how long erases take.
    pub fn new(bit_rate: u32, seed: u64) -> Self {
        let bus = Bus::new(bit_rate, seed);
        Self {
            counted: bus.statistics(),
            bus,
            nodes: Vec::new(),
            guests: Vec::new(),
            due_ns: Vec::new(),
            first_due_ns: NEVER,
            edges: Vec::new(),
            tick_ns: 0,
            load_percent: 0,
            seed,
        }
    }

    /// Adds a node, without power; its number.
    ///
    /// # Panics
    /// When the bus is full ([`crate::can_bus::MOST_PORTS`]).
    pub fn add(
        &mut self,
        electronics: Electronics,
        check: CrossCheck,
        factory: Factory,
        memory: Memory,
    ) -> usize {
        let port = self.bus.attach(TransmitOrder::Identifier);
        self.bus
            .set_bit_rate(port, u32::from(factory.kbit_s) * 1000);
        self.bus.connect(port, false);
        let mut node = NetworkNode::new(electronics, check, factory, memory, port);
        let label = format!("node {} erases", self.nodes.len());
        let pace = Rng::stream(self.seed, &label);
        node.device.memory().flash_mut().set_pace(pace);
        self.nodes.push(node);
        self.due_ns.push(NEVER);
        self.nodes.len() - 1
    }

    /// Attaches a host: its frames go out in the order in which they were offered.
    ///
    /// # Panics
    /// When the bus is full.
    pub fn attach_host(&mut self) -> Port {
        self.bus.attach(TransmitOrder::Offered)
    }

    /// The nodes, in the order of their adding.
    pub fn nodes(&self) -> &[NetworkNode] {
        &self.nodes
    }

    /// What a node shows on the bus now.
    ///
    /// # Panics
    /// When there is no such node.
    pub fn shown(&self, number: usize) -> Shown<'_> {
        self.nodes[number].shown(self.now_ns())
    }

    /// A node, for faults.
    pub fn node(&mut self, number: usize) -> &mut NetworkNode {
        &mut self.nodes[number]
    }

    /// Virtual time, ns.
    pub fn now_ns(&self) -> u64 {
        self.bus.now_ns()
    }

    /// Virtual time, s.
    pub fn now_s(&self) -> f64 {
        self.now_ns() as f64 * 1e-9
    }

    /// Share of the last whole second that the bus was busy, per cent.
    pub fn load_percent(&self) -> u8 {
        self.load_percent
    }

    /// Gives a node power.
    pub fn power_on(&mut self, number: usize) {
        let now_ns = self.now_ns();
        self.nodes[number].power_on(&mut self.bus, now_ns);
    }

    /// Takes a node's power away.
    pub fn power_off(&mut self, number: usize) {
        self.nodes[number].power_off(&mut self.bus);
    }

    /// Pulls a node's reset pin: its code starts anew, its power stays. Nothing without power.
    pub fn reset(&mut self, number: usize) {
        let now_ns = self.now_ns();
        let node = &mut self.nodes[number];
        if node.is_powered() {
            node.reset(&mut self.bus, now_ns);
        }
    }

    /// Goes on to `until_ns`; `seen` gets every event of the bus in its order.
    pub fn run_until(
        &mut self,
        mover: &mut impl Mover,
        until_ns: u64,
        mut seen: impl FnMut(&Event),
    ) {
        // Whoever called may have done anything to the nodes since the last time.
        (0..self.nodes.len()).for_each(|number| self.look_at(number));
        loop {
            let next = self.next_ns().min(until_ns);
            while let Some(event) = self.bus.step(next) {
                self.hand_out(&event);
                seen(&event);
                if event.at_ns() < next {
                    break;
                }
            }
            // An event may have brought something forward; then the loop goes round again.
            let now = self.now_ns();
            self.deliver_edges(now, until_ns);
            if self.first_due_ns <= now {
                self.poll(now);
            }
            if !self.guests.is_empty() {
                self.run_guests(now, until_ns);
            }
            if now >= self.tick_ns {
                self.tick(mover);
                self.deliver_edges(now, until_ns);
            }
            if now >= until_ns && self.next_ns() > until_ns {
                return;
            }
        }
    }

    /// The next instant at which anything but the bus has something to do.
    fn next_ns(&self) -> u64 {
        let edge = self.edges.last().map_or(NEVER, |(at_ns, ..)| *at_ns);
        let first = self.tick_ns.min(edge).min(self.first_due_ns);
        let first = first.min(self.guests_next_ns());
        first.max(self.now_ns())
    }

    /// Lets the nodes run that want to.
    fn poll(&mut self, now_ns: u64) {
        for number in 0..self.nodes.len() {
            if self.due_ns[number] <= now_ns {
                self.nodes[number].poll(&mut self.bus, now_ns);
                self.look_at(number);
            }
        }
    }

    /// Notes when a node next wants the processor, after anything has happened to it.
    fn look_at(&mut self, number: usize) {
        let next = self.nodes[number].next_ns(self.bus.now_ns());
        self.due_ns[number] = next.unwrap_or(NEVER);
        self.first_due_ns = self.due_ns.iter().copied().min().unwrap_or(NEVER);
    }

    /// One tick: the housing feels its force up to the tick's end, and the parts sample.
    fn tick(&mut self, mover: &mut impl Mover) {
        self.tick_ns += TICK_NS;
        let end_s = self.tick_ns as f64 * 1e-9;
        let motion = mover.step(end_s);
        let Self { nodes, edges, .. } = self;
        for (number, node) in nodes.iter_mut().enumerate() {
            // A node that is still being set up has lived through this time already.
            if node.electronics.now_s() >= end_s {
                continue;
            }
            node.electronics.tick(&motion, end_s, |edge| {
                let [at_ns, captured_ns] = [edge.at_s, edge.captured_s].map(|s| whole(s * 1e9));
                edges.push((at_ns, number, captured_ns));
            });
        }
        self.tick_guests(&motion, end_s);
        let edges = &mut self.edges;
        if edges.len() > 1 {
            edges.sort_unstable_by(|a, b| b.cmp(a));
        }
        self.look_at_load();
    }

    fn look_at_load(&mut self) {
        if self.now_ns().saturating_sub(self.counted.at_ns) < LOAD_NS {
            return;
        }
        let now = self.bus.statistics();
        let load = now.load_since(&self.counted);
        self.load_percent = (load * 100.0).round().clamp(0.0, 100.0) as u8;
        self.counted = now;
        for node in &mut self.nodes {
            node.set_load(self.load_percent);
        }
    }

    /// Lets the nodes take the samples of edges up to now, and while nothing else can happen
    /// before them also later ones.
    #[inline]
    fn deliver_edges(&mut self, now_ns: u64, until_ns: u64) {
        if !self.edges.is_empty() {
            self.take_edges(now_ns, until_ns);
        }
    }

    fn take_edges(&mut self, now_ns: u64, until_ns: u64) {
        let undisturbed = self.bus.is_quiet() && self.guests.is_empty();
        while let Some(&(at_ns, number, captured_ns)) = self.edges.last() {
            let first = undisturbed && at_ns < self.first_due_ns && at_ns <= until_ns;
            if at_ns > now_ns && !first {
                return;
            }
            self.edges.pop();
            self.nodes[number].data_ready(captured_ns);
            // A sample puts off the instant at which it would have been missed.
            self.look_at(number);
        }
    }

    fn hand_out(&mut self, event: &Event) {
        if !self.guests.is_empty() {
            self.tell_guests(event);
        }
        match event {
            Event::Delivered {
                frame, to, at_ns, ..
            } => self.deliver(frame, *to, *at_ns),
            Event::Sent {
                port,
                mailbox: Some(mailbox),
                frame,
                end_ns,
                ..
            } => self.with_owner(*port, |node, bus| {
                node.sent(bus, mailbox.number(), frame, *end_ns);
            }),
            Event::Changed { port, state, at_ns } => self.with_owner(*port, |node, bus| {
                node.bus_changed(bus, *state, *at_ns);
            }),
            Event::Error { senders, at_ns, .. } => self.fail(*senders, *at_ns),
            Event::Sent { .. } => {}
        }
    }

    fn fail(&mut self, senders: Ports, at_ns: u64) {
        for number in 0..self.nodes.len() {
            if senders.contains(self.nodes[number].port) {
                self.nodes[number].failed(&mut self.bus, at_ns);
                self.look_at(number);
            }
        }
    }

    fn deliver(&mut self, frame: &Frame, to: Ports, at_ns: u64) {
        for number in 0..self.nodes.len() {
            if to.contains(self.nodes[number].port) {
                self.nodes[number].receive(&mut self.bus, frame, at_ns);
                self.look_at(number);
            }
        }
    }

    /// Tells the node at this port, if a node it is.
    fn with_owner(&mut self, port: Port, tell: impl FnOnce(&mut NetworkNode, &mut Bus)) {
        if let Some(number) = self.nodes.iter().position(|node| node.port == port) {
            tell(&mut self.nodes[number], &mut self.bus);
            self.look_at(number);
        }
    }
}
