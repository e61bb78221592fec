//! A channel with a check of its own, joined without a bus: what the bench and the recordings need.
//!
//! In: the part's samples, and the peer's report of the same instant. Out: readings and verdicts.
//! Left out: the bus, which has [`Device`](device::device::Device).

use device::channel::{Channel, Settings};
use device::sensor::{Part, PartError};
use embedded_hal::delay::DelayNs;
use instant::Instant;
use tilt::chain::Reading;
use tilt::cross_check::{CrossCheck, Verdict};
use tilt::observation::Observation;

/// A node's state.
#[derive(Debug)]
pub struct BenchNode<P> {
    /// The channel this node measures with.
    pub channel: Channel<P>,
    check: CrossCheck,
}

impl<P: Part> BenchNode<P> {
    /// A node that has not been started, judging by `check`.
    pub fn new(part: P, check: CrossCheck) -> Self {
        Self {
            channel: Channel::new(part),
            check,
        }
    }

    /// Starts, or resets: part, filter, latched faults and the cross-check's memory.
    ///
    /// Errors: see [`Channel::start`].
    pub fn start<D: DelayNs>(
        &mut self,
        settings: &Settings,
        delay: &mut D,
        now: Instant,
    ) -> Result<(), PartError<P::Error>> {
        self.check.reset();
        self.channel.start(settings, delay, now)
    }

    /// Judges by another check from now on, with a fresh memory.
    pub fn set_check(&mut self, check: CrossCheck) {
        self.check = check;
    }

    /// This node's reading at `now`, the instant of SYNC.
    pub fn reading(&self, settings: &Settings, now: Instant) -> Reading {
        self.channel.reading(settings, now)
    }

    /// All that this node's channel reports at `now`, the instant of SYNC.
    pub fn observe(&mut self, settings: &Settings, now: Instant) -> Observation {
        self.channel.observe(settings, now)
    }

    /// Judges what this node reports against what the peer reports of the same instant.
    pub fn judge(
        &mut self,
        own: impl Into<Observation>,
        peer: impl Into<Observation>,
        now: Instant,
    ) -> Verdict {
        self.check.step(own, peer, now)
    }
}
