//! All interfaces of the logs.
//!
//! In: frames with their interface. Out: a [`Bus`] for each.

use super::bus::Bus;
use super::foreign::Foreign;
use bus_logs::Logged;
use listen::{Meaning, Plan};

/// What the logs have shown.
#[derive(Clone, Debug)]
pub struct Summary {
    plan: Plan,
    buses: Vec<Option<Bus>>,
    foreign: Foreign,
}

impl Summary {
    /// Of these instruments on each interface, and of other nodes with a data sheet.
    pub const fn new(plan: Plan, foreign: Foreign) -> Self {
        Self {
            plan,
            buses: Vec::new(),
            foreign,
        }
    }

    /// Takes a frame.
    #[inline]
    pub fn take(&mut self, logged: &Logged) -> Meaning {
        let place = usize::from(logged.interface);
        if self.buses.len() <= place {
            self.buses.resize(place + 1, None);
        }
        if !self.foreign.is_empty() {
            self.foreign.take(&logged.frame);
        }
        let Some(bus) = self.buses.get_mut(place) else {
            return Meaning::Other;
        };
        let bus = bus.get_or_insert_with(|| Bus::new(&self.plan));
        bus.take(logged.time_ns, &logged.frame)
    }

    /// The interface at this place.
    pub fn bus(&self, place: u8) -> Option<&Bus> {
        self.buses.get(usize::from(place))?.as_ref()
    }

    /// The interfaces that frames came from, by their places.
    pub fn buses(&self) -> impl Iterator<Item = (usize, &Bus)> {
        let all = self.buses.iter().enumerate();
        all.filter_map(|(place, bus)| Some((place, bus.as_ref()?)))
    }

    /// Other nodes.
    pub const fn foreign(&self) -> &Foreign {
        &self.foreign
    }
}
