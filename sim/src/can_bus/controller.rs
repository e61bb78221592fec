//! One controller on the bus: its mailboxes, its settings and its error counters.
//!
//! In: frames to send. Out: the one it would send next. Left out: acceptance filters and receive
//! FIFOs; those stand between the bus's events and the node.

use canopen::Frame;

use super::confinement::{Counters, ErrorState};
use super::wire;

/// Transmit mailboxes of one controller, as the bxCAN of the STM32F1 has.
pub const MAILBOXES: usize = 3;

/// Which of its mailboxes a controller sends first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TransmitOrder {
    /// The one that would win the bus; at the same identifier the one with the lower number, so
    /// two frames of one identifier may swap (bxCAN, TXFP = 0).
    #[default]
    Identifier,
    /// The one that was offered first (bxCAN, TXFP = 1).
    Offered,
}

/// A transmit mailbox of one controller: 0, 1 or 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mailbox(pub(super) u8);

impl Mailbox {
    /// All there are.
    pub const ALL: [Self; MAILBOXES] = [Self(0), Self(1), Self(2)];

    /// Its number, 0 to 2.
    pub const fn number(self) -> usize {
        self.0 as usize
    }
}

/// All mailboxes hold a frame: wait for [`Event::Sent`](super::Event::Sent), or abort one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;

/// A frame that waits, with what arbitration and timing need of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waiting {
    pub(super) frame: Frame,
    pub(super) priority: u32,
    pub(super) stuffed_bits: u64,
    /// Position in the sequence of offers.
    number: u64,
    /// It is not repeated when the attempt on the wire fails.
    once: bool,
}

impl Waiting {
    fn new(frame: Frame, number: u64) -> Self {
        Self {
            frame,
            priority: wire::priority(&frame),
            stuffed_bits: wire::stuffed_bits(&frame),
            number,
            once: false,
        }
    }
}

/// What is on the wire for a controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    Mailbox(Mailbox),
    Babble,
}

#[derive(Clone, Debug)]
pub(super) struct Controller {
    pub(super) bit_ns: u64,
    pub(super) connected: bool,
    pub(super) listen_only: bool,
    pub(super) counters: Counters,
    /// What was last told of `counters`.
    pub(super) told: ErrorState,
    /// Own frames wait until then: suspend transmission of an error passive sender.
    pub(super) ready_ns: u64,
    /// Sequences of 11 recessive bits still to be seen before a controller leaves bus-off.
    pub(super) recovery_left: u64,
    /// From when on they count.
    pub(super) recovery_from_ns: u64,
    pub(super) sending: Option<Source>,
    order: TransmitOrder,
    mailboxes: [Option<Waiting>; MAILBOXES],
    babble: Option<Waiting>,
    offers: u64,
}

impl Controller {
    pub(super) fn new(bit_ns: u64, order: TransmitOrder) -> Self {
        Self {
            bit_ns,
            connected: true,
            listen_only: false,
            counters: Counters::default(),
            told: ErrorState::Active,
            ready_ns: 0,
            recovery_left: 0,
            recovery_from_ns: 0,
            sending: None,
            order,
            mailboxes: [None; MAILBOXES],
            babble: None,
            offers: 0,
        }
    }

    pub(super) fn offer(&mut self, frame: Frame, once: bool) -> Result<Mailbox, Busy> {
        let numbered = self.mailboxes.iter_mut().zip(0..);
        let free = numbered.into_iter().find(|(slot, _)| slot.is_none());
        let (_, number) = free.ok_or(Busy)?;
        self.put(Mailbox(number), frame, once)?;
        Ok(Mailbox(number))
    }

    pub(super) fn put(&mut self, mailbox: Mailbox, frame: Frame, once: bool) -> Result<(), Busy> {
        let slot = &mut self.mailboxes[mailbox.number()];
        if slot.is_some() {
            return Err(Busy);
        }
        let waiting = Waiting::new(frame, self.offers);
        *slot = Some(Waiting { once, ..waiting });
        self.offers += 1;
        Ok(())
    }

    pub(super) fn babble(&mut self, frame: Option<Frame>) {
        self.babble = frame.map(|frame| Waiting::new(frame, 0));
    }

    pub(super) fn frame_in(&self, mailbox: Mailbox) -> Option<Frame> {
        Some(self.mailboxes[mailbox.number()]?.frame)
    }

    pub(super) fn has_frames(&self) -> bool {
        self.babble.is_some() || self.mailboxes.iter().any(Option::is_some)
    }

    /// The frame it would send now, and from where.
    pub(super) fn next(&self) -> Option<(Source, &Waiting)> {
        if let Some(babble) = &self.babble {
            return Some((Source::Babble, babble));
        }
        // A loop, because this runs at every frame and iterators of options are not free.
        let mut first: Option<(u8, &Waiting)> = None;
        for (slot, number) in self.mailboxes.iter().zip(0..) {
            if let Some(waiting) = slot
                && first.is_none_or(|(_, before)| self.is_before(waiting, before))
            {
                first = Some((number, waiting));
            }
        }
        first.map(|(number, waiting)| (Source::Mailbox(Mailbox(number)), waiting))
    }

    #[inline]
    fn is_before(&self, one: &Waiting, other: &Waiting) -> bool {
        match self.order {
            TransmitOrder::Identifier => one.priority < other.priority,
            TransmitOrder::Offered => one.number < other.number,
        }
    }

    /// Takes the frame out of its mailbox, unless it is on the wire: then it is not repeated.
    pub(super) fn abort(&mut self, mailbox: Mailbox) -> bool {
        let slot = &mut self.mailboxes[mailbox.number()];
        if self.sending == Some(Source::Mailbox(mailbox)) {
            slot.iter_mut().for_each(|waiting| waiting.once = true);
            return false;
        }
        *slot = None;
        true
    }

    pub(super) fn abort_all(&mut self) {
        self.mailboxes = [None; MAILBOXES];
        self.babble = None;
        self.sending = None;
    }

    /// The frame went out; its mailbox is free. `None` for a babbling controller.
    pub(super) fn finish(&mut self) -> Option<(Mailbox, Frame)> {
        let Some(Source::Mailbox(mailbox)) = self.sending.take() else {
            return None;
        };
        let waiting = self.mailboxes[mailbox.number()].take()?;
        Some((mailbox, waiting.frame))
    }

    /// The attempt failed: the frame stays for the next one, unless it was aborted meanwhile.
    pub(super) fn fail(&mut self) {
        if let Some(Source::Mailbox(mailbox)) = self.sending.take() {
            let slot = &mut self.mailboxes[mailbox.number()];
            if slot.is_some_and(|waiting| waiting.once) {
                *slot = None;
            }
        }
    }

    /// It is wired, and not off the bus.
    pub(super) fn hears(&self) -> bool {
        self.connected && self.told != ErrorState::BusOff
    }

    /// It may pull the bus dominant.
    pub(super) fn speaks(&self) -> bool {
        self.hears() && !self.listen_only
    }

    /// Its error flags are dominant.
    pub(super) fn flags(&self) -> bool {
        self.speaks() && self.told < ErrorState::Passive
    }
}
