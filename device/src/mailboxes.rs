//! The transmit mailboxes of a CAN controller: which frame goes into which, and which come out.
//!
//! In: a [`Device`] with what it has to say, and what became of the frames in the mailboxes. Out:
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
use embedded_hal::spi::SpiDevice;
use tilt::sample::Instant;

use crate::device::Device;
use crate::objects::panel::Memory;

/// Mailboxes of the controller (RM0008 24.3.3).
pub const MAILBOXES: usize = 3;

/// Frames here: those in the mailboxes, and one each of what does not grow old of a node: SYNC,
/// EMCY, SDO, error control, LSS. Process data that were taken out leave their places within 30 ms.
const PLACES: usize = MAILBOXES + 5;

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

/// A frame that the device has handed over.
#[derive(Clone, Copy, Debug)]
struct Held {
    /// Its identifier; what a device sends has 11 bits.
    id: u16,
    /// The mailbox that it is in; `None` when it was taken out to make room.
    mailbox: Option<u8>,
    fate: Fate,
    frame: Frame,
}

/// Whether there is a mailbox for a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Room {
    /// This one is empty.
    Free(u8),
    /// The frame of this identifier has to make room.
    Behind(u16),
    /// Not now.
    None,
}

/// An identifier that no frame has.
const NOTHING: u16 = u16::MAX;

/// What is in the mailboxes, and what was taken out of them: of an identifier one frame only.
#[derive(Clone, Debug)]
pub struct Mailboxes {
    held: [Option<Held>; PLACES],
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
            held: [None; PLACES],
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
        while let Some(id) = device.withdraw() {
            self.take_back(id, Fate::Withdrawn, device, can, now);
        }
        self.full = silent;
        while !self.full && self.fill_one(device, can, now) {}
    }

    /// Posts the frame of the highest priority, or makes room for it; false when there is none.
    fn fill_one<SPI: SpiDevice, M: Memory>(
        &mut self,
        device: &mut Device<SPI, M>,
        can: &mut impl Transmitter,
        now: Instant,
    ) -> bool {
        let waiting = device.waiting(now);
        let new = waiting.map_or(NOTHING, |waiting| waiting.cob_id);
        let out = self.first_out();
        if new == NOTHING && out == NOTHING {
            return false;
        }
        match self.room(new.min(out)) {
            Room::None => self.full = true,
            Room::Behind(id) => self.take_back(id, Fate::MakesRoom, device, can, now),
            Room::Free(mailbox) => {
                // One that was taken out goes before a new one of its identifier.
                if let Some(waiting) = waiting.filter(|_| new < out) {
                    let frame = device.hand_over(waiting, now);
                    return frame.is_some_and(|frame| self.post(mailbox, frame, can));
                }
                self.put(out, mailbox, can);
            }
        }
        true
    }

    /// Puts a frame that is held into a mailbox that is free.
    fn put(&mut self, id: u16, mailbox: u8, can: &mut impl Transmitter) {
        if let Some(held) = self.of(id) {
            held.mailbox = Some(mailbox);
            can.post(mailbox, &held.frame);
        }
    }

    /// The lowest identifier among the frames that were taken out.
    fn first_out(&self) -> u16 {
        let out = self
            .held
            .iter()
            .flatten()
            .filter(|held| held.mailbox.is_none());
        out.fold(NOTHING, |first, held| first.min(held.id))
    }

    fn of(&mut self, id: u16) -> Option<&mut Held> {
        self.held.iter_mut().flatten().find(|held| held.id == id)
    }

    /// Whether a frame of this identifier may go into a mailbox.
    fn room(&self, id: u16) -> Room {
        let (mut used, mut count, mut spare) = (0u8, 0, false);
        let (mut first, mut last) = (NOTHING, 0);
        let (mut twin, mut leaving) = (false, false);
        for held in &self.held {
            let Some(held) = held else {
                spare = true;
                continue;
            };
            let Some(mailbox) = held.mailbox else {
                continue;
            };
            used |= 1 << mailbox;
            count += 1;
            first = first.min(held.id);
            last = last.max(held.id);
            twin |= held.id == id;
            leaving |= held.fate != Fate::Stays;
        }
        let outranks = id < first;
        let free = (0..MAILBOXES as u8).find(|mailbox| used >> mailbox & 1 == 0);
        match free {
            Some(mailbox) if outranks || count + 1 < MAILBOXES && !twin => Room::Free(mailbox),
            // One that is about to leave makes room without being asked.
            None if outranks && spare && !leaving => Room::Behind(last),
            _ => Room::None,
        }
    }

    /// Into a mailbox that is free; true when that could be done.
    fn post(&mut self, mailbox: u8, frame: Frame, can: &mut impl Transmitter) -> bool {
        let place = self.held.iter_mut().find(|place| place.is_none());
        let (Some(id), Some(place)) = (frame.cob_id(), place) else {
            return false;
        };
        *place = Some(Held {
            id,
            mailbox: None,
            fate: Fate::Stays,
            frame,
        });
        self.put(id, mailbox, can);
        true
    }

    /// Posts a frame if there is a mailbox for it; what is there stays.
    pub fn offer(&mut self, frame: &Frame, can: &mut impl Transmitter) -> bool {
        match frame.cob_id().map(|id| self.room(id)) {
            Some(Room::Free(mailbox)) => self.post(mailbox, *frame, can),
            _ => false,
        }
    }

    /// A frame that was taken out to make room, no longer kept here; the lowest identifier first.
    pub fn take_out(&mut self) -> Option<Frame> {
        let first = self.first_out();
        let is_first = |place: &&mut Option<Held>| place.is_some_and(|held| held.id == first);
        let held = self.held.iter_mut().find(is_first)?.take()?;
        Some(held.frame)
    }

    /// Takes a frame out of its mailbox, unless it is on the wire.
    fn take_back<SPI: SpiDevice, M: Memory>(
        &mut self,
        id: u16,
        fate: Fate,
        device: &mut Device<SPI, M>,
        can: &mut impl Transmitter,
        now: Instant,
    ) {
        let Some(held) = self.of(id) else {
            return;
        };
        let before = core::mem::replace(&mut held.fate, fate);
        let is_out = match held.mailbox {
            None => true,
            // It is asked for once; then it is for the controller to tell.
            Some(mailbox) => before == Fate::Stays && can.abort(mailbox) == Abort::Done,
        };
        if is_out {
            self.leave(id, device, now);
        }
    }

    /// A frame is out of its mailbox and has not gone out.
    fn leave<SPI: SpiDevice, M: Memory>(
        &mut self,
        id: u16,
        device: &mut Device<SPI, M>,
        now: Instant,
    ) {
        for place in &mut self.held {
            let Some(held) = place.as_mut().filter(|held| held.id == id) else {
                continue;
            };
            match held.fate {
                Fate::MakesRoom => (held.mailbox, held.fate) = (None, Fate::Stays),
                Fate::Stays => *place = None,
                Fate::Withdrawn => {
                    *place = None;
                    device.withdrawn(id, now);
                }
            }
            return;
        }
    }

    /// The frame in a mailbox has gone out: it, to be told to the device.
    // Within its caller it is more code.
    #[inline(never)]
    pub fn sent(&mut self, mailbox: u8) -> Option<Frame> {
        let is_in = |place: &&mut Option<Held>| place.is_some_and(|h| h.mailbox == Some(mailbox));
        let held = self.held.iter_mut().find(is_in)?.take()?;
        Some(held.frame)
    }

    /// The frame in a mailbox is out of it and has not gone out.
    pub fn given_up<SPI: SpiDevice, M: Memory>(
        &mut self,
        mailbox: u8,
        device: &mut Device<SPI, M>,
        now: Instant,
    ) {
        let mut held = self.held.iter().flatten();
        if let Some(held) = held.find(|held| held.mailbox == Some(mailbox)) {
            self.leave(held.id, device, now);
        }
    }

    /// True while a mailbox has a frame that was to be taken back and was on the wire.
    pub fn is_leaving(&self, mailbox: u8) -> bool {
        let mut held = self.held.iter().flatten();
        held.any(|held| held.mailbox == Some(mailbox) && held.fate != Fate::Stays)
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
            let frame = id.map(|id| Frame::data_frame(id, &[]));
            frame.map(|frame| mailboxes.post(mailbox, frame, &mut Nothing));
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
        assert_eq!(three.room(0x80), Room::Behind(0x701));
        if let Some(held) = three.of(0x581) {
            held.fate = Fate::Withdrawn;
        }
        assert!(three.is_leaving(2) && !three.is_leaving(1));
        assert_eq!(three.room(0x80), Room::None);
    }

    #[test]
    fn no_frame_is_taken_out_that_there_is_no_place_for() {
        let mut three = holding([Some(0x181), Some(0x701), Some(0x581)]);
        for id in 0x7E0..0x7E5 {
            assert_eq!(three.room(0x80), Room::Behind(0x701));
            assert!(three.post(0, Frame::data_frame(id, &[]), &mut Nothing));
            if let Some(held) = three.of(id) {
                held.mailbox = None;
            }
        }
        assert_eq!(three.room(0x80), Room::None);
        assert_eq!(three.take_out(), Some(Frame::data_frame(0x7E0, &[])));
        assert_eq!(three.room(0x80), Room::Behind(0x701));
    }
}
