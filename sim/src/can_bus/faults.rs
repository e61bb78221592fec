//! Faults on demand: which attempt to send goes wrong, and how.
//!
//! In: a plan (the nth attempt on the bus, from 0), rates per attempt with a seed, and controllers
//! whose frames all go wrong. Out: at most
//! one [`Fault`] for each attempt. Left out: shorts, cut lines and babble, which last; the bus has
//! calls for them.

use std::collections::BTreeMap;

use super::ports::{Port, Ports};
use crate::rng::Rng;

/// Bits a drawn corruption may hit; a longer number than any frame, so each bit is as likely.
const DRAWN_BITS: f64 = 65_536.0;

/// Which bit of a frame goes wrong that a spoiled controller sends: behind the identifier, so the
/// arbitration is over.
const SPOILED_BIT: u16 = 16;

/// What goes wrong with one attempt to send a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A bit turns over for everybody: `bit` counts from the start of frame, stuff bits included,
    /// and begins anew after the CRC.
    Corrupt {
        /// Which bit.
        bit: u16,
    },
    /// One receiver finds a CRC error. While it is error active its flag makes everybody drop the
    /// frame and the sender repeat it; error passive it alone misses the frame.
    Local(Port),
    /// One receiver sees a dominant last-but-one bit of the end of frame: the others have already
    /// taken the frame, the sender repeats it, so they get it twice; and they alone have it
    /// should the sender die before it repeats.
    LastButOne(Port),
    /// One receiver acknowledges the frame but has no room for it; nobody learns of that.
    Overrun(Port),
}

/// How often each fault strikes, per attempt, 0 to 1; their sum is at most 1.
///
/// The receiver it strikes is drawn, all alike.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    /// [`Fault::Corrupt`] at a bit that is drawn too.
    pub corrupt: f64,
    /// [`Fault::Local`].
    pub local: f64,
    /// [`Fault::LastButOne`].
    pub last_but_one: f64,
    /// [`Fault::Overrun`].
    pub overrun: f64,
}

/// The plan and the rates of one bus.
#[derive(Clone, Debug)]
pub struct Faults {
    planned: BTreeMap<u64, Fault>,
    rates: Rates,
    spoiled: Ports,
    rng: Rng,
}

impl Faults {
    /// None at all; `seed` is for [`Faults::set_rates`].
    pub(super) fn none(seed: u64) -> Self {
        Self {
            planned: BTreeMap::new(),
            rates: Rates::default(),
            spoiled: Ports::NONE,
            rng: Rng::stream(seed, "can bus faults"),
        }
    }

    /// Plans a fault for an attempt, counted from 0 since the bus was made; the last plan holds.
    pub fn plan(&mut self, attempt: u64, fault: Fault) {
        self.planned.insert(attempt, fault);
    }

    /// From now on faults strike at these rates; the default is none.
    pub fn set_rates(&mut self, rates: Rates) {
        self.rates = rates;
    }

    /// From now on every frame that this controller sends is corrupted, or none is.
    pub fn spoil(&mut self, port: Port, on: bool) {
        if on {
            self.spoiled.insert(port);
        } else {
            self.spoiled.remove(port);
        }
    }

    /// True when none can strike.
    pub(super) fn are_none(&self) -> bool {
        self.spoiled.is_empty() && self.planned.is_empty() && self.rates == Rates::default()
    }

    /// The fault of this attempt by `senders`; `receivers` are those who listen at its bit rate.
    pub(super) fn strike(
        &mut self,
        attempt: u64,
        senders: Ports,
        receivers: Ports,
    ) -> Option<Fault> {
        if !self.spoiled.among(senders).is_empty() {
            return Some(Fault::Corrupt { bit: SPOILED_BIT });
        }
        if !self.planned.is_empty()
            && let Some(fault) = self.planned.remove(&attempt)
        {
            return Some(fault);
        }
        if self.rates == Rates::default() {
            return None;
        }
        self.draw(receivers)
    }

    fn draw(&mut self, receivers: Ports) -> Option<Fault> {
        let chance = self.rng.uniform();
        let rates = self.rates;
        let mut limit = rates.corrupt;
        if chance < limit {
            let bit = (self.rng.uniform() * DRAWN_BITS) as u16;
            return Some(Fault::Corrupt { bit });
        }
        limit += rates.local;
        if chance < limit {
            return self.receiver(receivers).map(Fault::Local);
        }
        limit += rates.last_but_one;
        if chance < limit {
            return self.receiver(receivers).map(Fault::LastButOne);
        }
        limit += rates.overrun;
        let struck = chance < limit;
        struck.then(|| self.receiver(receivers).map(Fault::Overrun))?
    }

    fn receiver(&mut self, receivers: Ports) -> Option<Port> {
        let drawn = (self.rng.uniform() * receivers.count() as f64) as usize;
        receivers.iter().nth(drawn)
    }
}
