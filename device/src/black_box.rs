//! The black box: what both channels said around an event, SYNC by SYNC.
//!
//! In: a [`Frame`] for each SYNC that was judged, and a trigger for each event that asks for one.
//! Out: two boxes as bytes, any part of them on demand.
//!
//! A trigger keeps the [`BEFORE`] frames up to it and the [`AFTER`] that follow. Box 1 belongs to
//! the first event and stays until it is cleared, since the first cause is what matters; box 2
//! belongs to the latest. An event while a box is being filled is in that box already. Where no
//! frame was recorded there is nothing to keep, and no box is taken.
//!
//! Frames of a box follow one another: where none came for more than [`BREAK_US`] the recording
//! begins anew, and a box that was being filled stays as short as it is. SYNCs in between that
//! were not judged, because the peer was late, leave no frame.
//!
//! A box doesn't change under its reader. What is added to it after [`BlackBox::open`] is seen by
//! the next one, and no event takes it until nobody has read of it for [`LEASE_US`].
//!
//! # Format, version 1
//! Numbers are little-endian and without sign.
//!
//! | byte | content |
//! |---|---|
//! | 0 | version, 1 |
//! | 1 | length of a frame in bytes, 34 |
//! | 2 | frames before the trigger, 1 to 32; the last is of the newest SYNC that was judged |
//! | 3 | frames after the trigger, 0 to 16 |
//! | 4 to 7 | time from frame to frame at the trigger, us; 0 for a single frame |
//! | 8 to 27 | the event: an entry of `fault_log`, with time, SYNC count and EMCY code |
//!
//! Then each frame, oldest first:
//!
//! | byte | content |
//! |---|---|
//! | 0 to 7 | this channel's exchange PDO 1, as it was on the bus |
//! | 8 to 15 | this channel's exchange PDO 2 |
//! | 16 to 23 | the peer's exchange PDO 1 |
//! | 24 to 31 | the peer's exchange PDO 2 |
//! | 32 | state of the pair, as 2021h shows it |
//! | 33 | bits 6, 7: channel that is blamed, 0 none, 1 own, 2 peer; bits 0 to 5: why, 0 unknown |
//!
//! The time from frame to frame is the shorter one of the last two, so that one SYNC that was not
//! judged doesn't pass for the period.
//!
//! A complete box goes into the memory and comes back after a reset or a loss of power
//! ([`BlackBox::save_at`], [`BlackBox::restore`]); it is in its format there.
//!
//! Left out: what is an event, and the memory (`device`).

use canopen::sdo::TIMEOUT_MS;
use tilt::sample::Instant;

use crate::fault_log::{ENTRY, Entry, copy};

/// The version written.
const VERSION: u8 = 1;

/// Bytes of an encoded frame.
const FRAME: usize = 34;

/// Bytes before the first frame.
const HEAD: usize = 8 + ENTRY;

/// Frames kept from before a trigger.
pub const BEFORE: usize = 32;

/// Frames kept from after a trigger.
pub const AFTER: usize = 16;

/// Boxes.
pub const BOXES: usize = 2;

/// Bytes of a full box.
pub const BOX_LENGTH: u32 = (HEAD + FRAME * (BEFORE + AFTER)) as u32;

/// Without a frame for longer than this the recording begins anew, us.
///
/// A silent peer costs six SYNCs before it is judged, so the period of SYNC may be up to 0.8 s.
pub const BREAK_US: i64 = 5_000_000;

/// A box is its reader's until so long after the last read, us: then the SDO has timed out.
pub const LEASE_US: i64 = TIMEOUT_MS as i64 * 1000;

/// What both channels said at one SYNC, and what came of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// This channel's exchange PDOs 1 and 2.
    pub own: [u8; 16],
    /// The peer's exchange PDOs 1 and 2.
    pub peer: [u8; 16],
    /// State of the pair, as 2021h shows it.
    pub state: u8,
    /// See [`blamed_reason`].
    pub blamed_reason: u8,
}

/// The last byte of a frame: channel that is blamed, 0 to 2, and why, 0 to 63.
pub const fn blamed_reason(blamed: u8, reason: u8) -> u8 {
    blamed << 6 | reason & 0x3F
}

impl Frame {
    /// The frame in the format above.
    fn encode(&self) -> [u8; FRAME] {
        let mut bytes = [0; FRAME];
        // Whole arrays are copied by words.
        if let Some((own, rest)) = bytes.split_first_chunk_mut()
            && let Some((peer, rest)) = rest.split_first_chunk_mut()
            && let [state, blamed_reason] = rest
        {
            (*own, *peer) = (self.own, self.peer);
            (*state, *blamed_reason) = (self.state, self.blamed_reason);
        }
        bytes
    }
}

/// Frames that nobody has recorded. As a constant they are cleared where they stand; written as an
/// array of arrays they would first be made on the stack.
const NO_FRAMES: [[u8; FRAME]; BEFORE] = [[0; FRAME]; BEFORE];

/// Boxes without an event; see [`NO_FRAMES`].
const EMPTY_BOXES: [Kept; BOXES] = [Kept::EMPTY; BOXES];

/// One box. It is empty while it has no frame from before the trigger.
#[derive(Clone, Debug)]
#[repr(C)]
struct Kept {
    before: u8,
    after: u8,
    /// The memory has it.
    saved: bool,
    period_us: u32,
    entry: Entry,
    frames: [[u8; FRAME]; BEFORE + AFTER],
}

impl Kept {
    const EMPTY: Self = Self {
        entry: Entry::NONE,
        period_us: 0,
        before: 0,
        after: 0,
        saved: false,
        frames: [[0; FRAME]; BEFORE + AFTER],
    };

    /// Length in bytes while `after` frames from after the trigger count.
    fn length(&self, after: u8) -> u32 {
        HEAD as u32 + FRAME as u32 * (u32::from(self.before) + u32::from(after))
    }

    fn head(&self, after: u8) -> [u8; HEAD] {
        let mut head = [0; HEAD];
        // Whole arrays are copied by words.
        if let Some((sizes, rest)) = head.split_first_chunk_mut()
            && let Some((period, rest)) = rest.split_first_chunk_mut()
            && let Some(entry) = rest.first_chunk_mut()
        {
            *sizes = [VERSION, FRAME as u8, self.before, after];
            *period = self.period_us.to_le_bytes();
            *entry = self.entry.encode();
        }
        head
    }

    fn read_at(&self, after: u8, offset: u32, into: &mut [u8]) -> usize {
        let count = usize::from(self.before) + usize::from(after);
        let frames = self.frames.get(..count).unwrap_or(&[]);
        copy(&self.head(after), frames.as_flattened(), offset, into)
    }
}

/// A box under read.
#[derive(Clone, Copy, Debug)]
struct Open {
    number: u8,
    /// Frames from after the trigger that there were when it was opened.
    after: u8,
    last_read: Instant,
}

/// The recorder and its boxes: their state. What is large comes last, as in `Device`.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct BlackBox {
    next: u8,
    recorded: u8,
    /// The box that is being filled; 0 for none.
    filling: u8,
    /// Between the last two frames, us; `u32::MAX` with fewer than two.
    gap_us: u32,
    /// Time from frame to frame, us; 0 while it is not known.
    period_us: u32,
    /// When the last frame was.
    last: Instant,
    open: Option<Open>,
    /// The last frames, of which `recorded` count, up to the one before `next`.
    ring: [[u8; FRAME]; BEFORE],
    kept: [Kept; BOXES],
}

/// Place of box `number` among the boxes; beyond them for 0.
const fn place(number: u8) -> usize {
    (number as usize).wrapping_sub(1)
}

impl BlackBox {
    /// Nothing recorded, both boxes empty.
    #[inline(never)]
    pub const fn new() -> Self {
        Self {
            ring: NO_FRAMES,
            next: 0,
            recorded: 0,
            last: Instant(0),
            gap_us: u32::MAX,
            period_us: 0,
            kept: EMPTY_BOXES,
            filling: 0,
            open: None,
        }
    }

    /// Takes what was said at the SYNC of `at`, which was just judged.
    pub fn record(&mut self, frame: &Frame, at: Instant) {
        self.measure(at);
        let bytes = frame.encode();
        if let Some(to) = self.ring.get_mut(usize::from(self.next)) {
            *to = bytes;
        }
        self.next = (self.next + 1) % BEFORE as u8;
        self.recorded = (self.recorded + 1).min(BEFORE as u8);
        let Some(kept) = self.kept.get_mut(place(self.filling)) else {
            return;
        };
        let end = usize::from(kept.before) + usize::from(kept.after);
        if let Some(to) = kept.frames.get_mut(end) {
            *to = bytes;
            kept.after += 1;
        }
        if usize::from(kept.after) >= AFTER {
            self.filling = 0;
        }
    }

    /// The time since the last frame, which may be too long.
    fn measure(&mut self, at: Instant) {
        self.break_off(at);
        let gap = at.micros_since(self.last) as u32;
        self.last = at;
        if self.recorded == 0 {
            self.gap_us = u32::MAX;
            self.period_us = 0;
        } else {
            self.period_us = gap.min(self.gap_us);
            self.gap_us = gap;
        }
    }

    /// Frames from before a long silence don't belong to what happens now.
    fn break_off(&mut self, now: Instant) {
        if !(0..=BREAK_US).contains(&now.micros_since(self.last)) {
            self.recorded = 0;
            self.filling = 0;
        }
    }

    /// An event: keeps the frames around it. The number of the box that they are in, from 1.
    ///
    /// 0 where there is none: no frame was recorded, or box 2 is under read.
    pub fn trigger(&mut self, mut entry: Entry, now: Instant) -> u8 {
        self.break_off(now);
        if self.filling != 0 || self.recorded == 0 {
            return self.filling;
        }
        let number = if self.is_kept(1) { 2 } else { 1 };
        if let Some(open) = self.open.filter(|open| open.number == number) {
            if now.micros_since(open.last_read) <= LEASE_US {
                return 0;
            }
            // A reader who comes back late gets nothing rather than half of each.
            self.open = None;
        }
        entry.box_number = number;
        self.keep(number, entry);
        number
    }

    /// Copies what the recorder has into box `number`, which is filled from now on.
    fn keep(&mut self, number: u8, entry: Entry) {
        let Some(kept) = self.kept.get_mut(place(number)) else {
            return;
        };
        kept.entry = entry;
        kept.period_us = self.period_us;
        kept.before = self.recorded;
        kept.after = 0;
        kept.saved = false;
        let oldest = usize::from(self.next.wrapping_sub(self.recorded)) % BEFORE;
        let wanted = kept.frames.iter_mut().take(usize::from(self.recorded));
        for (to, place) in wanted.zip(oldest..) {
            if let Some(frame) = self.ring.get(place % BEFORE) {
                *to = *frame;
            }
        }
        self.filling = number;
    }

    fn kept(&self, number: u8) -> Option<&Kept> {
        let kept = self.kept.get(place(number))?;
        (kept.before != 0).then_some(kept)
    }

    fn is_kept(&self, number: u8) -> bool {
        self.kept(number).is_some()
    }

    /// How many boxes hold an event, 0 to 2.
    pub fn boxes(&self) -> u8 {
        u8::from(self.is_kept(1)) + u8::from(self.is_kept(2))
    }

    /// Length in bytes of box `number`, from 1, as [`BlackBox::open`] would find it; 0 if empty.
    pub fn length(&self, number: u8) -> u32 {
        self.kept(number).map_or(0, |kept| kept.length(kept.after))
    }

    /// Opens box `number`, from 1, for [`BlackBox::read_at`]; its length in bytes.
    ///
    /// `None`: it is empty. A box that was open is closed.
    pub fn open(&mut self, number: u8, now: Instant) -> Option<u32> {
        self.open = None;
        let kept = self.kept(number)?;
        let (after, length) = (kept.after, kept.length(kept.after));
        self.open = Some(Open {
            number,
            after,
            last_read: now,
        });
        Some(length)
    }

    /// Reads box `number` from byte `offset` on; how many bytes, fewer only at the end.
    ///
    /// None when it is not the open one, or was taken for another event since.
    pub fn read_at(&mut self, number: u8, offset: u32, into: &mut [u8], now: Instant) -> usize {
        let Some(open) = self.open.as_mut().filter(|open| open.number == number) else {
            return 0;
        };
        open.last_read = now;
        let after = open.after;
        let kept = self.kept.get(place(number));
        kept.map_or(0, |kept| kept.read_at(after, offset, into))
    }

    /// Closes the box under read, if there is one.
    pub const fn close(&mut self) {
        self.open = None;
    }

    /// A box that is complete and not in the memory yet, with the event that it was kept for.
    pub fn next_unsaved(&mut self, now: Instant) -> Option<(u8, Entry)> {
        self.break_off(now);
        let complete = |number: &u8| *number != self.filling;
        (1..=BOXES as u8).filter(complete).find_map(|number| {
            let kept = self.kept(number).filter(|kept| !kept.saved)?;
            Some((number, kept.entry))
        })
    }

    /// Copies bytes of box `number` from `offset` on for the memory; how many, fewer only at the
    /// end. `None` when it is not the box of `event` any more.
    pub fn save_at(
        &self,
        number: u8,
        event: &Entry,
        offset: u32,
        into: &mut [u8],
    ) -> Option<usize> {
        let kept = self.kept(number).filter(|kept| kept.entry == *event)?;
        Some(kept.read_at(kept.after, offset, into))
    }

    /// The memory has box `number` now, or never will.
    pub fn saved(&mut self, number: u8) {
        if let Some(kept) = self.kept.get_mut(place(number)) {
            kept.saved = true;
        }
    }

    /// Fills the empty box `number` with what `source` gives: offset and room in, the number of
    /// bytes out. It stays empty where that is no box.
    pub fn restore(&mut self, number: u8, source: &mut dyn FnMut(u32, &mut [u8]) -> usize) {
        let Some(kept) = self.kept.get_mut(place(number)) else {
            return;
        };
        let (mut sizes, mut entry) = ([0; 8], [0; ENTRY]);
        if source(0, &mut sizes) < sizes.len() || source(8, &mut entry) < ENTRY {
            return;
        }
        let [version, size, before, after, period @ ..] = sizes;
        let known = version == VERSION && usize::from(size) == FRAME;
        let fits = (1..=BEFORE).contains(&usize::from(before)) && usize::from(after) <= AFTER;
        let count = usize::from(before) + usize::from(after);
        let Some(frames) = kept.frames.get_mut(..count).filter(|_| known && fits) else {
            return;
        };
        if source(HEAD as u32, frames.as_flattened_mut()) < FRAME * count {
            return;
        }
        kept.period_us = u32::from_le_bytes(period);
        kept.entry = Entry::decode(&entry);
        (kept.before, kept.after, kept.saved) = (before, after, true);
    }

    /// Empties both boxes and begins the recording anew, as a reset does.
    pub fn clear(&mut self) {
        for kept in &mut self.kept {
            kept.before = 0;
            kept.after = 0;
        }
        self.recorded = 0;
        self.filling = 0;
        self.open = None;
    }
}

impl Default for BlackBox {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests;
