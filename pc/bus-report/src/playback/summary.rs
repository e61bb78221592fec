//! All interfaces of the logs.
//!
//! In: frames with their interface. Out: what each of them came to ([`Collected`]), and the signals
//! of other nodes.

use super::foreign::Foreign;
use crate::totals::{Collected, Collector};
use bus_logs::Logged;
use listen::eds::Device;
use listen::{Meaning, Plan, Watch};

/// What the logs have shown.
#[derive(Debug)]
pub struct Summary {
    plan: Plan,
    buses: Vec<Option<Collector>>,
    foreign: Foreign,
}

impl Summary {
    /// Of these instruments on each interface, and of other nodes with a data sheet.
    pub fn new(plan: Plan, devices: Vec<Device>) -> Self {
        Self {
            plan,
            buses: Vec::new(),
            foreign: Foreign::new(devices),
        }
    }

    /// Takes a frame.
    #[inline]
    pub fn take(&mut self, logged: &Logged) -> Meaning {
        let place = usize::from(logged.interface);
        if self.buses.len() <= place {
            self.buses.resize_with(place + 1, || None);
        }
        if !self.foreign.is_empty() {
            self.foreign.take(&logged.frame);
        }
        let Some(bus) = self.buses.get_mut(place) else {
            return Meaning::Other;
        };
        let bus = bus.get_or_insert_with(|| Collector::without_load(&self.plan));
        bus.take(logged.time_ns, &logged.frame)
    }

    /// What is known of the instruments at the interface of this place.
    pub fn watch(&self, place: u8) -> Option<&Watch> {
        let bus = self.buses.get(usize::from(place))?.as_ref()?;
        Some(bus.watch())
    }

    /// Other nodes.
    pub const fn foreign(&self) -> &Foreign {
        &self.foreign
    }

    /// The logs have ended: other nodes, and the interfaces that frames came from, by their places.
    pub fn finish(self) -> (Foreign, Vec<(usize, Collected)>) {
        let buses = self.buses.into_iter().enumerate();
        let buses = buses.filter_map(|(place, bus)| Some((place, bus?.finish())));
        (self.foreign, buses.collect())
    }
}
