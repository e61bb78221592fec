//! A node whose code does not run here: on an emulated processor, for one.
//!
//! In: the world's events for it, each at its time. Out: what it does to the bus. A guest runs on
//! by itself for a while; whatever it wants to do to the bus it does when the network's time has
//! come to its own, so that everything on the bus happens in order.
//!
//! Left out: how its code runs.

use std::any::Any;
use std::fmt::Debug;

use super::{NEVER, Network};
use crate::can_bus::{Bus, Event};
use crate::electronics::{Electronics, whole};
use crate::motion::Motion;

/// No guest runs further ahead of the others than this, ns: less than the shortest frame takes, so
/// that nothing that another one does can have reached it yet.
const LOOK_AHEAD_NS: u64 = 20_000;

/// A node that brings its own processor.
pub trait Guest: Any + Debug {
    /// Sensor, supply and clock of its side.
    fn electronics(&mut self) -> &mut Electronics;

    /// Takes the force of a tick up to `end_s`; its part samples, and edges come later.
    fn tick(&mut self, motion: &Motion, end_s: f64);

    /// Something has happened on the bus.
    fn hear(&mut self, event: &Event, bus: &mut Bus);

    /// Its own time, or when it next does anything if it sleeps, ns; `u64::MAX` without power.
    fn next_ns(&self) -> u64;

    /// Does what it wants to do to the bus, now, and runs on to `until_ns`, or to where it next
    /// wants something of the bus.
    fn run(&mut self, bus: &mut Bus, until_ns: u64);

    /// Power comes, now.
    fn power_on(&mut self, bus: &mut Bus);

    /// Power goes, now.
    fn power_off(&mut self, bus: &mut Bus);

    /// Its reset pin is pulled, now.
    fn reset(&mut self, bus: &mut Bus);

    /// True while it has power.
    fn is_powered(&self) -> bool;

    /// Its bus wires are cut, or connected again.
    fn wire(&mut self, bus: &mut Bus, connected: bool);
}

/// What is done to a guest's supply and wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// It comes.
    On,
    /// It goes.
    Off,
    /// It stays, and the reset pin is pulled.
    Reset,
    /// The bus wires are cut.
    Cut,
    /// They are connected again.
    Connect,
}

impl Network {
    /// Adds a guest, which has attached itself to the bus; its number among the guests.
    pub fn add_guest(&mut self, guest: Box<dyn Guest>) -> usize {
        self.guests.push(guest);
        self.guests.len() - 1
    }

    /// How many guests there are.
    pub fn guest_count(&self) -> usize {
        self.guests.len()
    }

    /// Nodes and guests together.
    pub fn node_count(&self) -> usize {
        self.nodes.len() + self.guests.len()
    }

    /// The number among the guests of the node with this number; guests come after the others.
    pub fn as_guest(&self, node: usize) -> Option<usize> {
        let number = node.checked_sub(self.nodes.len())?;
        (number < self.guests.len()).then_some(number)
    }

    /// Whether the node with this number has power, if it is a guest.
    pub fn guest_power(&self, node: usize) -> Option<bool> {
        Some(self.guests[self.as_guest(node)?].is_powered())
    }

    /// The electronics of a node, be it a guest or not.
    pub fn electronics(&mut self, node: usize) -> &mut Electronics {
        match self.as_guest(node) {
            Some(number) => self.guests[number].electronics(),
            None => &mut self.nodes[node].electronics,
        }
    }

    /// A guest.
    pub fn guest(&mut self, number: usize) -> &mut dyn Guest {
        &mut *self.guests[number]
    }

    /// The guest with this number, if it is a `G`.
    pub fn guest_as<G: Guest>(&mut self, number: usize) -> Option<&mut G> {
        let guest: &mut dyn Any = self.guest(number);
        guest.downcast_mut()
    }

    /// Does something to a guest's supply or wires.
    pub fn switch_guest(&mut self, number: usize, switch: Switch) {
        let guest = &mut self.guests[number];
        match switch {
            Switch::On => guest.power_on(&mut self.bus),
            Switch::Off => guest.power_off(&mut self.bus),
            Switch::Reset => guest.reset(&mut self.bus),
            Switch::Cut => guest.wire(&mut self.bus, false),
            Switch::Connect => guest.wire(&mut self.bus, true),
        }
    }

    /// When the first guest has something to do, ns.
    pub(super) fn guests_next_ns(&self) -> u64 {
        self.guests
            .iter()
            .map(|guest| guest.next_ns())
            .min()
            .unwrap_or(NEVER)
    }

    /// Lets the guests run whose time has come.
    pub(super) fn run_guests(&mut self, now_ns: u64, until_ns: u64) {
        for number in 0..self.guests.len() {
            if self.guests[number].next_ns() > now_ns {
                continue;
            }
            let event_ns = self.bus.next_event().unwrap_or(NEVER);
            let next_ns = (now_ns + LOOK_AHEAD_NS).min(event_ns).min(self.tick_ns);
            let next_ns = next_ns.min(self.first_due_ns).min(until_ns).max(now_ns + 1);
            self.guests[number].run(&mut self.bus, next_ns);
        }
    }

    /// Tells the guests what has happened on the bus.
    pub(super) fn tell_guests(&mut self, event: &Event) {
        let Self { guests, bus, .. } = self;
        for guest in guests {
            guest.hear(event, bus);
        }
    }

    /// Lets the guests' parts live through a tick.
    pub(super) fn tick_guests(&mut self, motion: &Motion, end_s: f64) {
        for guest in &mut self.guests {
            guest.tick(motion, end_s);
        }
    }
}

/// A time in s as the bus counts it, ns.
pub fn nanoseconds(time_s: f64) -> u64 {
    whole(time_s * 1e9)
}
