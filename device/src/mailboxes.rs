//! The transmit mailboxes of a CAN controller: which frame goes into which, and which come out.
//!
//! In: a [`Device`] with what it has to say, and what became of the frames in the mailboxes. Out:
//! frames into mailboxes and back out of them, by way of a [`Transmitter`].
//!
//! The controller sends by identifier and, for equal ones, by the number of the mailbox, so two
//! frames with one identifier never wait side by side: their order would be lost. The last free
//! mailbox is for what outranks the others. When none is free, the frame of the lowest priority is
//! taken out for one that outranks them all, and goes in again when there is room: or an EMCY
//! would wait behind three heartbeats for as long as somebody floods the bus with identifiers
//! between the two (the inner priority inversion of ISO 11898-1 controllers).
//!
//! Left out: registers, bit rates, and what a device does when it is told.

use canopen::Frame;
use embedded_hal::spi::SpiDevice;
use heapless::Vec;
use tilt::sample::Instant;

use crate::device::Device;
use crate::objects::panel::Memory;

/// Mailboxes of the controller (RM0008 24.3.3).
pub const MAILBOXES: usize = 3;

/// Identifiers of a node that may be out of the mailboxes at once: SYNC, EMCY, four TPDOs, two
/// frames of two SRDOs each, SDO, error control and LSS, without the three in the mailboxes.
const PREEMPTED: usize = 10;

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
    /// Puts a frame into mailbox `place`, which is empty.
    fn post(&mut self, place: u8, frame: &Frame);
    /// Takes the frame in mailbox `place` back, unless it is on the wire.
    fn abort(&mut self, place: u8) -> Abort;
    /// Empties the mailboxes; nothing tells of what was in them.
    fn clear(&mut self);
}

/// What is to become of a frame in a mailbox.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    /// It goes out.
    Stays,
    /// It was on the wire when the device took it back: it goes out now or not at all.
    Withdrawn,
    /// It was on the wire when another one needed its mailbox: it goes out now or later.
    Preempted,
}

/// A frame in a mailbox.
#[derive(Clone, Copy, Debug)]
struct Posted {
    /// Its identifier; what a device sends has 11 bits.
    id: u16,
    frame: Frame,
    fate: Fate,
}

/// Whether there is a mailbox for a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Room {
    /// This one is empty.
    Free(u8),
    /// In this one is what has to make room.
    Behind(u8),
    /// Not now.
    None,
}

/// What is in the mailboxes, and what was taken out to make room.
#[derive(Clone, Debug)]
pub struct Mailboxes {
    posted: [Option<Posted>; MAILBOXES],
    /// No two of one identifier: such a frame goes before a new one of the device.
    preempted: Vec<Frame, PREEMPTED>,
    full: bool,
}

impl Default for Mailboxes {
    fn default() -> Self {
        Self::new()
    }
}

impl Mailboxes {
    /// Empty.
    pub const fn new() -> Self {
        Self {
            posted: [None; MAILBOXES],
            preempted: Vec::new(),
            full: false,
        }
    }

    /// True when something waits for a mailbox: call [`Mailboxes::fill`] when a frame has gone.
    pub const fn is_full(&self) -> bool {
        self.full
    }

    /// Takes back what may not go out any more, and moves what waits into mailboxes; nothing while
    /// the node has to be `silent`.
    pub fn fill<SPI: SpiDevice, M: Memory>(
        &mut self,
        device: &mut Device<SPI, M>,
        can: &mut impl Transmitter,
        silent: bool,
        now: Instant,
    ) {
        self.withdraw(device, can, now);
        self.full = silent;
        while !self.full && self.fill_one(device, can, now) {}
    }

    /// Makes room for the frame of the highest priority and posts it; false when there is none.
    fn fill_one<SPI: SpiDevice, M: Memory>(
        &mut self,
        device: &mut Device<SPI, M>,
        can: &mut impl Transmitter,
        now: Instant,
    ) -> bool {
        let preempted = self.first_preempted();
        let waiting = device.waiting(now);
        let waiting = waiting.filter(|new| preempted.is_none_or(|(_, id)| new.cob_id < id));
        let Some(id) = waiting
            .map(|new| new.cob_id)
            .or(preempted.map(|(_, id)| id))
        else {
            return false;
        };
        match self.room(id) {
            Room::Free(place) => {
                let frame = match (waiting, preempted) {
                    (Some(waiting), _) => device.hand_over(waiting, now),
                    (None, Some((n, _))) => Some(self.preempted.swap_remove(n)),
                    (None, None) => None,
                };
                frame.is_some_and(|frame| self.post(place, &frame, can))
            }
            Room::Behind(place) => {
                self.full = !self.take_back(place, Fate::Preempted, device, can, now);
                true
            }
            Room::None => {
                self.full = true;
                true
            }
        }
    }

    /// The one of the highest priority among those that were taken out, with its place there.
    fn first_preempted(&self) -> Option<(usize, u16)> {
        let ids = self.preempted.iter().filter_map(Frame::cob_id);
        ids.enumerate().min_by_key(|(_, id)| *id)
    }

    /// Whether a frame of this identifier may go into a mailbox.
    fn room(&self, id: u16) -> Room {
        let (mut free, mut count) = (None, 0);
        let (mut first, mut last) = (u16::MAX, None);
        let (mut twin, mut leaving) = (false, false);
        for (place, posted) in (0..).zip(&self.posted) {
            let Some(posted) = posted else {
                free = free.or(Some(place));
                count += 1;
                continue;
            };
            first = first.min(posted.id);
            last = last.max(Some((posted.id, place)));
            twin |= posted.id == id;
            leaving |= posted.fate != Fate::Stays;
        }
        let outranks = id < first;
        match (free, last) {
            (Some(place), _) if outranks || count > 1 && !twin => Room::Free(place),
            // One that is about to leave makes room without being asked.
            (None, Some((_, place))) if outranks && !leaving && !self.preempted.is_full() => {
                Room::Behind(place)
            }
            _ => Room::None,
        }
    }

    fn place(&mut self, place: u8) -> Option<&mut Option<Posted>> {
        self.posted.get_mut(usize::from(place))
    }

    /// Into a mailbox that is free; true when that could be done.
    fn post(&mut self, place: u8, frame: &Frame, can: &mut impl Transmitter) -> bool {
        let (Some(id), Some(mailbox)) = (frame.cob_id(), self.place(place)) else {
            return false;
        };
        *mailbox = Some(Posted {
            id,
            frame: *frame,
            fate: Fate::Stays,
        });
        can.post(place, frame);
        true
    }

    /// Posts a frame if there is a mailbox for it; what is there stays.
    pub fn offer(&mut self, frame: &Frame, can: &mut impl Transmitter) -> bool {
        match frame.cob_id().map(|id| self.room(id)) {
            Some(Room::Free(place)) => self.post(place, frame, can),
            _ => false,
        }
    }

    /// A frame that was taken out to make room, no longer kept here.
    pub fn take_preempted(&mut self) -> Option<Frame> {
        let (n, _) = self.first_preempted()?;
        Some(self.preempted.swap_remove(n))
    }

    /// Takes a frame out of its mailbox; false while it is on the wire.
    fn take_back<SPI: SpiDevice, M: Memory>(
        &mut self,
        place: u8,
        fate: Fate,
        device: &mut Device<SPI, M>,
        can: &mut impl Transmitter,
        now: Instant,
    ) -> bool {
        if let Some(Some(posted)) = self.place(place) {
            posted.fate = fate;
        }
        let done = can.abort(place) == Abort::Done;
        if done {
            self.given_up(place, device, now);
        }
        done
    }

    /// Takes back what may not go out any more.
    pub fn withdraw<SPI: SpiDevice, M: Memory>(
        &mut self,
        device: &mut Device<SPI, M>,
        can: &mut impl Transmitter,
        now: Instant,
    ) {
        while let Some(id) = device.withdraw() {
            let mut posted = (0..).zip(&mut self.posted);
            let posted = posted.find_map(|(place, posted)| {
                let posted = posted.as_mut().filter(|posted| posted.id == id)?;
                Some((place, posted))
            });
            match posted {
                Some((_, posted)) if posted.fate != Fate::Stays => posted.fate = Fate::Withdrawn,
                Some((place, _)) => {
                    self.take_back(place, Fate::Withdrawn, device, can, now);
                }
                None => {
                    let before = self.preempted.len();
                    self.preempted.retain(|frame| frame.cob_id() != Some(id));
                    if self.preempted.len() < before {
                        device.withdrawn(id, now);
                    }
                }
            }
        }
    }

    /// The frame in a mailbox has gone out: it, to be told to the device.
    pub fn sent(&mut self, place: u8) -> Option<Frame> {
        let posted = self.place(place)?.take()?;
        Some(posted.frame)
    }

    /// The frame in a mailbox is out of it and has not gone out.
    pub fn given_up<SPI: SpiDevice, M: Memory>(
        &mut self,
        place: u8,
        device: &mut Device<SPI, M>,
        now: Instant,
    ) {
        let Some(posted) = self.place(place).and_then(Option::take) else {
            return;
        };
        match posted.fate {
            Fate::Stays => {}
            Fate::Withdrawn => device.withdrawn(posted.id, now),
            Fate::Preempted => {
                // There is room: that was looked at before it was taken out.
                let _ = self.preempted.push(posted.frame);
            }
        }
    }

    /// True while a mailbox has a frame that was to be taken back and was on the wire.
    pub fn is_leaving(&self, place: u8) -> bool {
        let posted = self.posted.get(usize::from(place));
        let posted = posted.and_then(Option::as_ref);
        posted.is_some_and(|posted| posted.fate != Fate::Stays)
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
        for (place, id) in (0..).zip(ids) {
            let posted = id.map(|id| Frame::data_frame(id, &[]));
            posted.map(|frame| mailboxes.post(place, &frame, &mut Nothing));
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
        if let Some(Some(posted)) = three.place(2) {
            posted.fate = Fate::Withdrawn;
        }
        assert_eq!(three.room(0x80), Room::None);
    }

    #[test]
    fn no_frame_is_taken_out_that_there_is_no_place_for() {
        let mut three = holding([Some(0x181), Some(0x701), Some(0x581)]);
        while three.preempted.push(Frame::data_frame(0x7E4, &[])).is_ok() {}
        assert_eq!(three.room(0x80), Room::None);
    }
}
