//! One node of the instrument: its own channel, and the check against its peer's reading.
//!
//! The paper's instrument has two of these, each on its own microcontroller (R11). Where the
//! peer's reading comes from is the caller's business: the bus (`device`, between
//! [`Node::observe`], which goes out, and [`Node::judge`], which takes the peer's), or the
//! simulation directly.

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use tilt::chain::Reading;
use tilt::cross_check::{CrossCheck, Latch, Verdict};
use tilt::observation::Observation;
use tilt::sample::Instant;

use crate::channel::{Channel, Settings};
use crate::sensor::InitError;

/// A node's state.
#[derive(Debug)]
pub struct Node<SPI> {
    /// The channel this node measures with.
    pub channel: Channel<SPI>,
    check: CrossCheck,
}

impl<SPI: SpiDevice> Node<SPI> {
    /// A node that has not been started, judging by `check`.
    #[inline(never)]
    pub fn new(spi: SPI, check: CrossCheck) -> Self {
        Self {
            channel: Channel::new(spi),
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
    ) -> Result<(), InitError<SPI::Error>> {
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

    /// All that this node's channel says at `now`, the instant of SYNC.
    pub fn observe(&mut self, settings: &Settings, now: Instant) -> Observation {
        self.channel.observe(settings, now)
    }

    /// Judges what this node says against what the peer says of the same instant.
    pub fn judge(
        &mut self,
        own: impl Into<Observation>,
        peer: impl Into<Observation>,
        now: Instant,
    ) -> Verdict {
        self.check.step(own, peer, now)
    }

    /// How long the product's check holds what it finds, from now on.
    pub const fn set_latch(&mut self, latch: Latch) {
        if let CrossCheck::Product(check, _) = &mut self.check {
            check.latch = latch;
        }
    }

    /// A pair could not be compared.
    pub fn pair_lost(&mut self) {
        self.check.pair_lost();
    }

    /// The peer has been started anew.
    pub fn peer_restarted(&mut self) {
        self.check.peer_restarted();
    }

    /// Own minus peer, low-passed, 2^-26 g per step.
    pub fn residual(&self) -> [i32; 3] {
        self.check.residual()
    }
}
