//! The consuming end of an SRDO (EN 50325-5).
//!
//! In: the two frames of a pair, and time. Out: writes of the mapped objects when both frames
//! have come, in order, in time, and agree; otherwise the reason why they cannot be relied on.
//!
//! Left out: the safe state itself, which is the application's.

use super::SrdoState;
use super::setup::Setup;
use crate::frame::Frame;
use crate::object::{Abort, Objects, Value};
use crate::time::Deadline;
use instant::Instant;

/// State of a consumer.
#[derive(Clone, Debug)]
pub struct Consumer {
    /// What is known of the producer.
    pub state: SrdoState,
    /// The plain half that waits for its twin, and when it came.
    half: Option<(u64, Instant)>,
    /// When the next pair is overdue; `None` after a loss.
    deadline: Deadline,
    /// The pair was lost by time and nobody has been told.
    lost: bool,
}

/// Both halves are held against the limits of their objects before either is written.
fn apply<O: Objects>(
    setup: &Setup,
    objects: &mut O,
    plain: u64,
    inverted: u64,
) -> Result<(), Abort> {
    setup.inverted.fits(&objects.dictionary(), inverted)?;
    setup.plain.unpack(objects, plain)?;
    setup.inverted.unpack(objects, inverted)
}

impl Consumer {
    /// Nothing has come yet: the first pair is due within a safeguard cycle, as any other is.
    pub const fn new(setup: &Setup, now: Instant) -> Self {
        Self {
            state: SrdoState::Waiting,
            half: None,
            deadline: Deadline::at(now.after_ms(setup.sct_ms as u32)),
            lost: false,
        }
    }

    /// Notes why there is nothing to rely on; true when that is news.
    // Six callers, each of which would hold a copy of it.
    #[inline(never)]
    fn lose(&mut self, state: SrdoState) -> bool {
        let news = matches!(self.state, SrdoState::Waiting | SrdoState::Running);
        self.state = state;
        self.half = None;
        self.deadline = Deadline::NONE;
        news
    }

    /// Takes the plain or the inverted frame; true when the pair is lost by it, which is told
    /// once until a good pair comes.
    pub fn receive<O: Objects>(
        &mut self,
        setup: &Setup,
        objects: &mut O,
        frame: &Frame,
        is_plain: bool,
        now: Instant,
    ) -> bool {
        let length = setup.plain.length();
        if frame.length() != length {
            return self.lose(SrdoState::Inconsistent);
        }
        let data = u64::from_le_bytes(frame.padded());
        if is_plain {
            let lost = self.half.is_some() && self.lose(SrdoState::Unpaired);
            self.half = Some((data, now));
            return lost;
        }
        let srvt_us = u64::from(setup.srvt_ms) * 1000;
        let half = self.half.take();
        let Some((plain, _)) = half.filter(|(_, came)| now.since(*came) <= srvt_us) else {
            return self.lose(SrdoState::Unpaired);
        };
        if Value::cut(!plain ^ data, length).unsigned() != 0
            || apply(setup, objects, plain, data).is_err()
        {
            return self.lose(SrdoState::Inconsistent);
        }
        self.state = SrdoState::Running;
        self.deadline = Deadline::at(now.after_ms(u32::from(setup.sct_ms)));
        false
    }

    /// Watches over both times; when to look again.
    pub fn poll(&mut self, setup: &Setup, now: Instant) -> Deadline {
        let mut first = self.deadline;
        let mut why = SrdoState::TimedOut;
        if let Some((_, came)) = self.half {
            let twin = Deadline::at(came.after_ms(u32::from(setup.srvt_ms)));
            if twin.instant() < now {
                why = SrdoState::Unpaired;
            }
            first.add(twin);
        }
        if first.is_set() && first.instant() < now {
            self.lost |= self.lose(why);
            return Deadline::NONE;
        }
        Deadline::at(first.instant().after(1))
    }

    /// True once after a pair was lost by time.
    pub fn take_lost(&mut self) -> bool {
        core::mem::take(&mut self.lost)
    }
}
