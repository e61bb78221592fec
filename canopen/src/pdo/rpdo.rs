//! One PDO that the device receives (CiA 301, 7.2.2).
//!
//! In: frames, SYNC and time. Out: writes of the mapped objects, at once for transmission types
//! 254 and 255, at the next SYNC for 0 to 240.
//!
//! Left out: which RPDO a frame belongs to (`pdo`).

use super::Received;
use super::setup::Setup;
use crate::frame::Frame;
use crate::object::Objects;
use crate::time::Deadline;
use instant::Instant;

/// An RPDO: configuration and state.
#[derive(Clone, Debug)]
pub struct Rpdo {
    /// The configuration.
    pub setup: Setup,
    /// Data that wait for SYNC.
    waiting: Option<u64>,
    /// When the next frame is overdue; `None` before the first one.
    deadline: Deadline,
    /// A frame is overdue and nobody has been told.
    missed: bool,
}

impl Rpdo {
    /// An RPDO that does not exist.
    pub const fn new() -> Self {
        Self {
            setup: Setup::new(),
            waiting: None,
            deadline: Deadline::NONE,
            missed: false,
        }
    }

    /// Forgets what waits, and begins anew.
    pub fn restart(&mut self) {
        self.waiting = None;
        self.deadline = Deadline::NONE;
        self.missed = false;
    }

    /// Takes a data frame with the identifier of this RPDO, which is number `n`.
    ///
    /// CiA 301, 7.2.2: one that is too short is not used, one that is too long is used as far as
    /// it is mapped; both are told with an EMCY.
    pub fn receive<O: Objects>(
        &mut self,
        objects: &mut O,
        n: u8,
        frame: &Frame,
        now: Instant,
    ) -> Received {
        let mapped = self.setup.mapping.length();
        if frame.length() < mapped {
            return Received::TooShort(n);
        }
        if O::SERVICES.pdo_timers {
            self.deadline = Deadline::in_ms(now, self.setup.event_ms.into());
        }
        let data = u64::from_le_bytes(frame.padded());
        let synchronous = self.setup.is_synchronous();
        if synchronous {
            self.waiting = Some(data);
        } else if self.setup.mapping.unpack(objects, data).is_err() {
            return Received::Refused(n);
        }
        match synchronous {
            _ if frame.length() > mapped => Received::TooLong(n),
            true => Received::Waiting,
            false => Received::Taken(n),
        }
    }

    /// SYNC: applies what waits; true when that has been done.
    pub fn sync<O: Objects>(&mut self, objects: &mut O) -> bool {
        let data = self.waiting.take();
        data.is_some_and(|data| self.setup.mapping.unpack(objects, data).is_ok())
    }

    /// Watches over the event timer; when to look again.
    pub fn poll(&mut self, now: Instant) -> Deadline {
        if self.deadline.is_due(now) {
            self.deadline = Deadline::NONE;
            self.missed = true;
        }
        self.deadline
    }

    /// True once after a frame has become overdue.
    pub fn take_missed(&mut self) -> bool {
        core::mem::take(&mut self.missed)
    }
}
