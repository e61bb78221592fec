//! One node of the instrument: its own channel, and the check against its peer's reading.
//!
//! The paper's instrument has two of these, each on its own microcontroller (R11). Where the
//! peer's reading comes from is the caller's business: a bus once the `canopen` crate is here (its
//! place is between [`Node::reading`], which goes out, and [`Node::judge`], which takes the
//! peer's), or the simulation directly.

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use tilt::chain::Reading;
use tilt::cross_check::{CrossCheck, Verdict};
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

    /// Judges this node's reading against the peer's for the same instant.
    pub fn judge(&mut self, own: Reading, peer: Reading, now: Instant) -> Verdict {
        self.check.step(own, peer, now)
    }
}
