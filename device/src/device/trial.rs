//! The program's update from inside: a clear or a check goes on, and a program on trial shows what
//! it can.
//!
//! In: the time, this channel's angle, and frames that others have acknowledged. Out: a
//! confirmation, or after [`PATIENCE_US`] without one a reset. The bootloader then starts the
//! program again, [`ATTEMPTS`](flash::slots::ATTEMPTS) times in all, and after that the one before
//! it: half a minute from the first start.
//!
//! A program has shown what it can when its channel has a valid angle and somebody has taken a
//! frame of it from the bus. That its own bits are right the bootloader has found at this start,
//! and the board has not found otherwise since.
//!
//! Left out: a program that hangs, which the watchdog ends.

use canopen::nmt::State;
use instant::Instant;

use super::{Device, Memory};
use crate::instrument::Instrument;
use crate::program::{Confirmation, Effect, ProgramMemory};
use crate::sensor::Part;

/// After so long without having shown what it can, a program on trial gives up, us.
pub const PATIENCE_US: i64 = 10_000_000;

/// Time between two pages of a clear in which requests are answered, us: a page makes the
/// processor stand still for 40 ms at most, and of the frames meanwhile three stay. The steps of a
/// check have the same time between them.
pub(super) const PAUSE_US: i64 = 20_000;

/// What a program has shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Trial {
    running: bool,
    heard: bool,
}

impl Trial {
    /// Nothing has to be shown.
    pub(super) const OVER: Self = Self {
        running: false,
        heard: false,
    };

    /// A program starts.
    pub(super) fn begin<M: ProgramMemory>(memory: &mut M) -> Self {
        Self {
            running: memory.running().confirmation == Confirmation::Trial,
            heard: false,
        }
    }

    /// Somebody has taken a frame of this node from the bus.
    pub(super) const fn heard(&mut self) {
        self.heard = true;
    }
}

impl<P: Part, M: Memory, I: Instrument> Device<P, M, I> {
    /// What is due of an update; nothing is erased while others work by the angles.
    pub(super) fn update(&mut self, now: Instant) {
        if !I::UPDATE {
            return;
        }
        if self.parts.values.state != State::Operational && now >= self.next_erase {
            self.next_erase = now.offset(PAUSE_US);
            let effect = self.parts.values.program.step(&mut self.parts.memory);
            self.parts.values.pending.reset |= effect == Effect::Reset;
        }
        if !self.trial.running {
            return;
        }
        let measures = self
            .parts
            .channel
            .reading(&self.parts.settings, now)
            .x
            .is_ok();
        let sound = measures && !self.parts.values.program_damaged;
        // One that can't be confirmed ends as one that can do nothing.
        if sound && self.trial.heard && self.parts.memory.confirm().is_ok() {
            self.trial.running = false;
        } else if now.micros_since(self.started) > PATIENCE_US {
            self.parts.values.pending.reset = true;
        }
    }
}
