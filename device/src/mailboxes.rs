//! The transmit mailboxes of a CAN controller: which frame goes into which, and which come out.
//!
//! In: a [`Device`] with what it has to send, and what became of the frames in the mailboxes. Out:
//! frames into mailboxes and back out of them, by way of a [`Transmitter`].
//!
//! The controller sends by identifier and, for equal ones, by the number of the mailbox, so two
//! frames with one identifier never wait side by side: their order would be lost. The last free
//! mailbox is for what outranks the others. When none is free, the frame of the lowest priority is
//! taken out for one that outranks them all, and goes in again when there is room. Or an EMCY would
//! wait behind answers and heartbeats for as long as somebody floods the bus with identifiers in
//! between (the inner priority inversion of CAN controllers).
//!
//! Left out: registers, bit rates, and what a device does when it is told.

use canopen::Frame;
use instant::Instant;

use crate::device::Device;
use crate::instrument::Instrument;
use crate::objects::device_objects::Memory;
use crate::sensor::Part;

/// Mailboxes of the controller (RM0008 24.3.3).
pub const MAILBOXES: usize = 3;

/// Frames that were taken out of a mailbox and wait to go in again: one each of what does not grow
/// old of a node, SYNC, EMCY, SDO, error control, LSS. Process data that were taken out leave their
/// places within 30 ms.
const WAITING: usize = 5;

/// What became of a frame that was to be taken back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Abort {
    /// It is out of its mailbox and has not gone out.
    Done,
    /// It is on the wire, or has gone out: the controller will tell.
    Later,
}

/// What has the mailboxes. Its frames go out by identifier.
pub trait Transmitter {
    /// Puts a frame into a mailbox, which is empty.
    fn post(&mut self, mailbox: u8, frame: &Frame);
    /// Takes the frame in a mailbox back, unless it is on the wire.
    fn abort(&mut self, mailbox: u8) -> Abort;
    /// Empties the mailboxes; nothing tells of what was in them.
    fn clear(&mut self);
}

/// What is to become of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    /// It goes out when its turn comes.
    Stays,
    /// Another one needs its mailbox: it goes out now, if it is on the wire, or later.
    MakesRoom,
    /// The device took it back: it goes out now, if it is on the wire, or not at all.
    Withdrawn,
}

/// Whether there is a mailbox for a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Room {
    /// This one is empty.
    Free(u8),
    /// The frame in this one has to make room.
    Behind(u8),
    /// Not now.
    None,
}

/// An identifier that no frame has.
const NOTHING: u16 = u16::MAX;

/// What is in the mailboxes, and what was taken out of them: of an identifier one frame only.
#[derive(Clone, Debug)]
pub struct Mailboxes {
    /// The identifier in each mailbox, or [`NOTHING`]; what a device sends has 11 bits.
    ids: [u16; MAILBOXES],
    /// What is to become of the frame in each.
    fates: [Fate; MAILBOXES],
    /// The frame in each.
    frames: [Frame; MAILBOXES],
    /// Taken out to make room.
    out: [Option<(u16, Frame)>; WAITING],
    full: bool,
}

impl Default for Mailboxes {
    fn default() -> Self {
        Self::new()
    }
}

impl Mailboxes {
    /// Empty.
    #[inline(never)]
    pub const fn new() -> Self {
        Self {
            ids: [NOTHING; MAILBOXES],
            fates: [Fate::Stays; MAILBOXES],
            frames: [Frame::EMPTY; MAILBOXES],
            out: [None; WAITING],
            full: false,
        }
    }

    /// True when something waits for a mailbox: call [`Mailboxes::fill`] when a frame has gone.
    pub const fn is_full(&self) -> bool {
        self.full
    }

    /// Takes back what may not go out any more, and moves what waits into mailboxes; nothing while
    /// the node has to be `silent`.
    pub fn fill<P: Part, M: Memory, I: Instrument>(
        &mut self,
        device: &mut Device<P, M, I>,
        can: &mut impl Transmitter,
        silent: bool,
        now: Instant,
    ) {
        while let Some(id) = device.withdraw() {
            self.withdraw(id, device, can, now);
        }
        self.full = silent;
        while !self.full && self.fill_one(device, can, now) {}
    }

    /// Posts the frame of the highest priority, or makes room for it; false when there is none.
    // Out of line: the image is smaller.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn fill_one<P: Part, M: Memory, I: Instrument>(
        &mut self,
        device: &mut Device<P, M, I>,
        can: &mut impl Transmitter,
        now: Instant,
    ) -> bool {
        let waiting = device.waiting(now);
        let new = waiting.map_or(NOTHING, |waiting| waiting.cob_id);
        let out = self.first_out();
        let first = new.min(out);
        if first == NOTHING {
            return false;
        }
        match self.room(first) {
            Room::None => self.full = true,
            Room::Behind(mailbox) => self.take_back(mailbox, Fate::MakesRoom, device, can, now),
            Room::Free(mailbox) => {
                // One that was taken out goes before a new one of its identifier.
                let frame = match waiting.filter(|_| new < out) {
                    Some(waiting) => device.hand_over(waiting, now),
                    None => self.take_out(),
                };
                return frame.is_some_and(|frame| self.post(mailbox, first, frame, can));
            }
        }
        true
    }

    /// The lowest identifier among the frames that were taken out.
    fn first_out(&self) -> u16 {
        let out = self.out.iter().flatten();
        out.fold(NOTHING, |first, (id, _)| first.min(*id))
    }

    /// Whether a frame of this identifier may go into a mailbox.
    fn room(&self, id: u16) -> Room {
        let (mut free, mut used) = (None, 0);
        let (mut first, mut last) = (NOTHING, (0, 0));
        for (mailbox, held) in (0..).zip(self.ids) {
            if held == NOTHING {
                free = free.or(Some(mailbox));
                continue;
            }
            used += 1;
            first = first.min(held);
            last = last.max((held, mailbox));
        }
        let outranks = id < first;
        match free {
            Some(mailbox) if outranks || used + 1 < MAILBOXES && !self.ids.contains(&id) => {
                Room::Free(mailbox)
            }
            None if outranks && self.may_make_room() => Room::Behind(last.1),
            _ => Room::None,
        }
    }

    /// One that is about to leave makes room without being asked; and what is taken out needs a
    /// place.
    fn may_make_room(&self) -> bool {
        let stays = |fate: &Fate| *fate == Fate::Stays;
        self.fates.iter().all(stays) && self.out.iter().any(Option::is_none)
    }

    /// Into a mailbox that is free; true, as it is then posted.
    fn post(&mut self, mailbox: u8, id: u16, frame: Frame, can: &mut impl Transmitter) -> bool {
        let n = usize::from(mailbox);
        let places = (self.ids.get_mut(n), self.frames.get_mut(n));
        let (Some(place), Some(kept)) = places else {
            return false;
        };
        can.post(mailbox, &frame);
        *place = id;
        *kept = frame;
        true
    }

    /// Empties a mailbox: what was in it, and what was to become of that; `None` when it is empty.
    fn empty(&mut self, mailbox: u8) -> Option<(u16, Fate, &Frame)> {
        let n = usize::from(mailbox);
        let id = core::mem::replace(self.ids.get_mut(n)?, NOTHING);
        let fate = core::mem::replace(self.fates.get_mut(n)?, Fate::Stays);
        (id != NOTHING).then_some((id, fate, self.frames.get(n)?))
    }

    /// Posts a frame if there is a mailbox for it; what is there stays.
    pub fn offer(&mut self, frame: &Frame, can: &mut impl Transmitter) -> bool {
        let Some(id) = frame.cob_id() else {
            return false;
        };
        match self.room(id) {
            Room::Free(mailbox) => self.post(mailbox, id, *frame, can),
            _ => false,
        }
    }

    /// A frame that was taken out to make room, no longer kept here; the lowest identifier first.
    pub fn take_out(&mut self) -> Option<Frame> {
        self.forget_out(self.first_out())
    }

    /// The frame of this identifier that was taken out, no longer kept here.
    fn forget_out(&mut self, id: u16) -> Option<Frame> {
        let is_it = |place: &&mut Option<(u16, Frame)>| place.is_some_and(|(of, _)| of == id);
        let place = self.out.iter_mut().find(is_it)?;
        place.take().map(|(_, frame)| frame)
    }

    /// The device takes back what is here of this identifier.
    fn withdraw<P: Part, M: Memory, I: Instrument>(
        &mut self,
        id: u16,
        device: &mut Device<P, M, I>,
        can: &mut impl Transmitter,
        now: Instant,
    ) {
        if self.forget_out(id).is_some() {
            return device.withdrawn(id, now);
        }
        if let Some(mailbox) = self.ids.iter().position(|held| *held == id) {
            self.take_back(mailbox as u8, Fate::Withdrawn, device, can, now);
        }
    }

    /// Takes a frame out of its mailbox, unless it is on the wire.
    fn take_back<P: Part, M: Memory, I: Instrument>(
        &mut self,
        mailbox: u8,
        fate: Fate,
        device: &mut Device<P, M, I>,
        can: &mut impl Transmitter,
        now: Instant,
    ) {
        let Some(held) = self.fates.get_mut(usize::from(mailbox)) else {
            return;
        };
        let before = core::mem::replace(held, fate);
        // It is asked for once; then it is for the controller to tell.
        if before == Fate::Stays && can.abort(mailbox) == Abort::Done {
            self.given_up(mailbox, device, now);
        }
    }

    /// The frame in a mailbox has gone out: it, to be told to the device.
    pub fn sent(&mut self, mailbox: u8) -> Option<&Frame> {
        self.empty(mailbox).map(|(_, _, frame)| frame)
    }

    /// The frame in a mailbox is out of it and has not gone out.
    pub fn given_up<P: Part, M: Memory, I: Instrument>(
        &mut self,
        mailbox: u8,
        device: &mut Device<P, M, I>,
        now: Instant,
    ) {
        let Some((id, fate, frame)) = self.empty(mailbox) else {
            return;
        };
        match fate {
            Fate::MakesRoom => {
                // There was a place when it was asked to make room, and nothing has taken it since.
                let held = Some((id, *frame));
                if let Some(place) = self.out.iter_mut().find(|place| place.is_none()) {
                    *place = held;
                }
            }
            Fate::Stays => {}
            Fate::Withdrawn => device.withdrawn(id, now),
        }
    }

    /// True while a mailbox has a frame that was to be taken back and was on the wire.
    pub fn is_leaving(&self, mailbox: u8) -> bool {
        let fate = self.fates.get(usize::from(mailbox));
        fate.is_some_and(|fate| *fate != Fate::Stays)
    }

    /// Bus-off: throws everything away. The device is told by [`Device::bus_state`].
    pub fn clear(&mut self, can: &mut impl Transmitter) {
        *self = Self::new();
        can.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Nothing;

    impl Transmitter for Nothing {
        fn post(&mut self, _: u8, _: &Frame) {}

        fn abort(&mut self, _: u8) -> Abort {
            Abort::Later
        }

        fn clear(&mut self) {}
    }

    fn holding(ids: [Option<u16>; MAILBOXES]) -> Mailboxes {
        let mut mailboxes = Mailboxes::new();
        for (mailbox, id) in (0..).zip(ids) {
            let post = |id| mailboxes.post(mailbox, id, Frame::data_frame(id, &[]), &mut Nothing);
            assert!(id.is_none_or(post));
        }
        mailboxes
    }

    #[test]
    fn the_last_mailbox_is_for_what_outranks_the_others_and_twins_wait() {
        assert_eq!(holding([None; 3]).room(0x701), Room::Free(0));
        let one = holding([Some(0x181), None, None]);
        assert_eq!(one.room(0x181), Room::None);
        assert_eq!(one.room(0x701), Room::Free(1));
        let two = holding([Some(0x181), None, Some(0x581)]);
        for id in [0x581, 0x182, 0x181] {
            assert_eq!(two.room(id), Room::None);
        }
        assert_eq!(two.room(0x80), Room::Free(1));
    }

    #[test]
    fn of_three_the_last_makes_room_for_what_outranks_them_all_and_one_at_a_time() {
        let mut three = holding([Some(0x181), Some(0x701), Some(0x581)]);
        for id in [0x701, 0x582, 0x182, 0x181] {
            assert_eq!(three.room(id), Room::None, "{id:X}");
        }
        assert_eq!(three.room(0x80), Room::Behind(1));
        three.fates[2] = Fate::Withdrawn;
        assert!(three.is_leaving(2) && !three.is_leaving(1));
        assert_eq!(three.room(0x80), Room::None);
    }

    #[test]
    fn no_frame_is_taken_out_that_there_is_no_place_for() {
        let mut three = holding([Some(0x181), Some(0x701), Some(0x581)]);
        for (place, id) in (0x7E0..0x7E5).enumerate() {
            assert_eq!(three.room(0x80), Room::Behind(1));
            three.out[place] = Some((id, Frame::data_frame(id, &[])));
        }
        assert_eq!(three.room(0x80), Room::None);
        assert_eq!(three.take_out(), Some(Frame::data_frame(0x7E0, &[])));
        assert_eq!(three.room(0x80), Room::Behind(1));
    }
}
