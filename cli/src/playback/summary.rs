//! All interfaces of the logs.
//!
//! In: frames with their interface. Out: a [`Bus`] for each.

use super::bus::Bus;
use crate::log::Logged;
use crate::watch::Plan;

/// What the logs have shown.
#[derive(Clone, Debug)]
pub struct Summary {
    plan: Plan,
    buses: Vec<Option<Bus>>,
}

impl Summary {
    /// Of these instruments on each interface.
    pub const fn new(plan: Plan) -> Self {
        Self {
            plan,
            buses: Vec::new(),
        }
    }

    /// Takes a frame.
    #[inline]
    pub fn take(&mut self, logged: &Logged) {
        let place = usize::from(logged.interface);
        if self.buses.len() <= place {
            self.buses.resize(place + 1, None);
        }
        if let Some(bus) = self.buses.get_mut(place) {
            let bus = bus.get_or_insert_with(|| Bus::new(&self.plan));
            bus.take(logged.time_ns, &logged.frame);
        }
    }

    /// The interfaces that frames came from, by their places.
    pub fn buses(&self) -> impl Iterator<Item = (usize, &Bus)> {
        let all = self.buses.iter().enumerate();
        all.filter_map(|(place, bus)| Some((place, bus.as_ref()?)))
    }
}
