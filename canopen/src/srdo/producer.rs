//! The producing end of an SRDO (EN 50325-5).
//!
//! In: time, and the mapped objects. Out: every safeguard cycle a plain and an inverted frame of
//! one and the same sample, in this order. The inverted objects are read, not computed: the
//! application has to have arrived at them its own way, and the pair is compared before any of it
//! goes out. A sample that the bus does not take in time is dropped, also when half of it has gone
//! out: to the receiver half a pair is none, while an old one looks like a new one.
//!
//! Left out: consent to send (`srdo`).

use super::setup::Setup;
use crate::frame::Frame;
use crate::object::{Objects, Value};
use instant::Instant;

/// A sample that has waited for so long is not sent any more, us; half the safeguard cycle where
/// that is less.
const LIFE_US: u64 = 10_000;

/// State of a producer.
#[derive(Clone, Debug)]
pub struct Producer {
    /// When the next pair is due.
    next: Instant,
    /// The pair that waits: the plain half, and the inverted one.
    pair: Option<(Value, Value)>,
    /// The plain half has been handed over.
    half_sent: bool,
    /// From when on the sample, waiting or handed over, may not be sent any more.
    pub stale: Instant,
    /// The last sample was consistent.
    pub consistent: bool,
}

impl Producer {
    /// The first pair is due at once.
    pub const fn new(now: Instant) -> Self {
        Self {
            next: now,
            pair: None,
            half_sent: false,
            stale: now,
            consistent: true,
        }
    }

    /// Drops what has not been handed over.
    pub fn withhold(&mut self) {
        self.pair = None;
    }

    /// Samples when it is time, unless what the application has `checked` is older than a cycle;
    /// when the next sample is due.
    pub fn poll<O: Objects>(
        &mut self,
        setup: &Setup,
        objects: &mut O,
        checked: Instant,
        now: Instant,
    ) -> Instant {
        if now < self.next {
            return self.next;
        }
        let period = u32::from(setup.sct_ms);
        self.next = match self.next.after_ms(period) {
            late if late <= now => now.after_ms(period),
            next => next,
        };
        self.half_sent = false;
        self.pair = None;
        let unchecked = checked.after_ms(period);
        if unchecked < now {
            return self.next;
        }
        self.pair = sampled(setup, objects);
        let life_us = (u64::from(period) * 500).min(LIFE_US);
        // A sample that waits grows older, and so does the check behind it.
        self.stale = now.after(life_us).min(unchecked.after(1));
        self.consistent = self.pair.is_some();
        self.next
    }

    /// The identifier of the frame that waits.
    pub fn ready(&self, setup: &Setup, now: Instant) -> Option<u16> {
        let [plain, inverted] = setup.cob_ids;
        let id = if self.half_sent { inverted } else { plain };
        (self.pair.is_some() && now < self.stale).then_some(id as u16)
    }

    /// The frame that [`Producer::ready`] told of.
    pub fn take(&mut self, setup: &Setup, now: Instant) -> Option<Frame> {
        let id = self.ready(setup, now)?;
        let (plain, inverted) = self.pair?;
        if !self.half_sent {
            self.half_sent = true;
            return Some(Frame::data_frame(id, plain.bytes()));
        }
        self.half_sent = false;
        self.pair = None;
        Some(Frame::data_frame(id, inverted.bytes()))
    }
}

/// A pair whose halves agree; `None` when they do not, or when an object cannot be read now.
fn sampled<O: Objects>(setup: &Setup, objects: &mut O) -> Option<(Value, Value)> {
    let (Ok(plain), Ok(inverted)) = (setup.plain.pack(objects), setup.inverted.pack(objects))
    else {
        return None;
    };
    let twin = Value::cut(!plain.unsigned(), plain.length().into());
    (inverted == twin).then_some((plain, inverted))
}
