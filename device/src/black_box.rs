//! The black box: what both channels sent around an event, SYNC by SYNC.
//!
//! In: a [`Frame`] for each SYNC that was judged, and a trigger for each event that asks for one.
//! Out: two boxes as bytes, any part of them on demand.
//!
//! A trigger keeps the [`BEFORE`] frames up to it and the [`AFTER`] that follow. Box 1 belongs to
//! the first event and stays until it is cleared, since the first cause is what matters; box 2
//! belongs to the latest. An event while a box is being filled is in that box already. Where no
//! frame was recorded there is nothing to keep, and no box is taken.
//!
//! There is room in the RAM for one box. A complete one goes into the memory
//! ([`BlackBox::next_unsaved`]) and is read from there; until it is there it is held here:
//! - Box 2 for as long as it takes, unless a later event takes its place.
//! - Box 1 gives its place to no other. An event that comes before box 1 is stored waits where
//!   frames are recorded: its box has the [`AFTER`] frames behind the event, as many before it as
//!   are left, at least [`BEFORE`] - [`AFTER`] of those that there were, and is read once box 1 is
//!   stored. While it waits with all of these, or behind a break, no further event finds a box.
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
//! In the memory a box is in its format, and is found there after a reset or a loss of power
//! ([`BlackBox::save_at`], [`BlackBox::restore`]).
//!
//! Left out: what is an event, and the memory (`device`).

use canopen::sdo::TIMEOUT_MS;
use instant::Instant;

use crate::fault_log::{ENTRY, Entry, copy};

/// The version written.
const VERSION: u8 = 1;

/// Bytes of an encoded frame.
const FRAME: usize = 34;

/// Where in it the number of frames from after the trigger stands.
const AFTER_AT: u32 = 3;

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

/// What both channels sent at one SYNC, and what came of it.
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

/// The box that is held in the RAM.
#[derive(Clone, Debug)]
#[repr(C)]
struct Kept {
    /// Which one it is, from 1; 0 for none.
    number: u8,
    size: Size,
    /// The memory does not take it.
    refused: bool,
    period_us: u32,
    entry: Entry,
    frames: [[u8; FRAME]; BEFORE + AFTER],
}

/// Frames of a box. It is empty while it has none from before the trigger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Size {
    before: u8,
    after: u8,
}

impl Size {
    const EMPTY: Self = Self {
        before: 0,
        after: 0,
    };

    const fn frames(self) -> usize {
        self.before as usize + self.after as usize
    }

    /// Length of the box in bytes.
    const fn length(self) -> u32 {
        (HEAD + FRAME * self.frames()) as u32
    }
}

/// An event whose box waits, among what was recorded, until the first one is stored.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    entry: Entry,
    period_us: u32,
    /// Frames from after the trigger.
    after: u8,
    /// No more frames are added.
    closed: bool,
}

impl Kept {
    const NONE: Self = Self {
        number: 0,
        size: Size::EMPTY,
        refused: false,
        period_us: 0,
        entry: Entry::NONE,
        frames: [[0; FRAME]; BEFORE + AFTER],
    };

    fn head(&self, size: Size) -> [u8; HEAD] {
        let mut head = [0; HEAD];
        // Whole arrays are copied by words.
        if let Some((sizes, rest)) = head.split_first_chunk_mut()
            && let Some((period, rest)) = rest.split_first_chunk_mut()
            && let Some(entry) = rest.first_chunk_mut()
        {
            *sizes = [VERSION, FRAME as u8, size.before, size.after];
            *period = self.period_us.to_le_bytes();
            *entry = self.entry.encode();
        }
        head
    }

    /// Copies from byte `offset` of the box, of which so many frames count.
    fn read_at(&self, size: Size, offset: u32, into: &mut [u8]) -> usize {
        let frames = self.frames.get(..size.frames()).unwrap_or(&[]);
        copy(&self.head(size), frames.as_flattened(), offset, into)
    }

    /// Adds a frame from after the trigger; true when that was the last.
    fn push(&mut self, frame: &[u8; FRAME]) -> bool {
        if let Some(to) = self.frames.get_mut(self.size.frames()) {
            *to = *frame;
            self.size.after += 1;
        }
        usize::from(self.size.after) >= AFTER
    }
}

/// A box under read.
#[derive(Clone, Copy, Debug)]
struct Open {
    number: u8,
    /// The frames that there were when it was opened.
    size: Size,
    last_read: Instant,
}

/// The recorder and its boxes: their state. What is large comes last, as in `Device`.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct BlackBox {
    next: u8,
    recorded: u8,
    /// The box that is held is being filled.
    filling: bool,
    /// It is on its way into the memory.
    saving: bool,
    /// The boxes that the memory has.
    stored: [Size; BOXES],
    /// Between the last two frames, us; `u32::MAX` with fewer than two.
    gap_us: u32,
    /// Time from frame to frame, us; 0 while it is not known.
    period_us: u32,
    /// When the last frame was.
    last: Instant,
    open: Option<Open>,
    waiting: Option<Waiting>,
    /// The last frames, of which `recorded` count, up to the one before `next`.
    ring: [[u8; FRAME]; BEFORE],
    held: Kept,
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
            next: 0,
            recorded: 0,
            filling: false,
            saving: false,
            stored: [Size::EMPTY; BOXES],
            gap_us: u32::MAX,
            period_us: 0,
            last: Instant(0),
            open: None,
            waiting: None,
            ring: NO_FRAMES,
            held: Kept::NONE,
        }
    }

    /// Takes what was sent at the SYNC of `at`, which was just judged.
    pub fn record(&mut self, frame: &Frame, at: Instant) {
        self.measure(at);
        if let Some(waiting) = &mut self.waiting {
            if waiting.closed {
                return;
            }
            waiting.after += 1;
            waiting.closed = usize::from(waiting.after) >= AFTER;
        }
        let bytes = frame.encode();
        if let Some(to) = self.ring.get_mut(usize::from(self.next)) {
            *to = bytes;
        }
        self.next = (self.next + 1) % BEFORE as u8;
        self.recorded = (self.recorded + 1).min(BEFORE as u8);
        if self.filling {
            self.filling = !self.held.push(&bytes);
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
        if (0..=BREAK_US).contains(&now.micros_since(self.last)) {
            return;
        }
        self.filling = false;
        match &mut self.waiting {
            // They belong to the box that waits.
            Some(waiting) => waiting.closed = true,
            None => self.recorded = 0,
        }
    }

    /// An event: keeps the frames around it. The number of the box that they are in, from 1.
    ///
    /// 0 where there is none: no frame was recorded, box 2 is under read, or it waits for box 1 to
    /// be stored.
    pub fn trigger(&mut self, mut entry: Entry, now: Instant) -> u8 {
        self.break_off(now);
        if self.filling {
            return self.held.number;
        }
        if let Some(waiting) = &self.waiting {
            return if waiting.closed { 0 } else { BOXES as u8 };
        }
        if self.recorded == 0 {
            return 0;
        }
        let number = if self.size(1).is_some() { 2 } else { 1 };
        if let Some(open) = self.open.filter(|open| open.number == number) {
            if now.micros_since(open.last_read) <= LEASE_US {
                return 0;
            }
            // A reader who comes back late gets nothing rather than half of each.
            self.open = None;
        }
        entry.box_number = number;
        let event = Waiting {
            entry,
            period_us: self.period_us,
            after: 0,
            closed: false,
        };
        if self.held.number == 1 {
            self.waiting = Some(event);
        } else {
            self.keep(number, &event);
        }
        number
    }

    /// Copies what the recorder has into box `number`, which is filled from now on.
    fn keep(&mut self, number: u8, event: &Waiting) {
        let held = &mut self.held;
        held.number = number;
        held.entry = event.entry;
        held.period_us = event.period_us;
        held.size.before = self.recorded.saturating_sub(event.after);
        held.size.after = event.after;
        held.refused = false;
        let oldest = usize::from(self.next.wrapping_sub(self.recorded)) % BEFORE;
        let wanted = held.frames.iter_mut().take(usize::from(self.recorded));
        for (to, place) in wanted.zip(oldest..) {
            if let Some(frame) = self.ring.get(place % BEFORE) {
                *to = *frame;
            }
        }
        self.filling = true;
        self.saving = false;
    }

    /// The box that waited is held now.
    fn keep_waiting(&mut self) {
        let Some(event) = self.waiting.take() else {
            return;
        };
        let number = event.entry.box_number;
        // Whoever reads the one before gets nothing rather than half of each.
        self.open = self.open.filter(|open| open.number != number);
        self.keep(number, &event);
        if event.closed {
            self.filling = false;
            self.recorded = 0;
        }
    }

    /// The frames of box `number` as far as they can be read; `None` when it is empty.
    fn size(&self, number: u8) -> Option<Size> {
        let size = match number {
            0 => return None,
            _ if number == self.held.number => self.held.size,
            _ => *self.stored.get(place(number))?,
        };
        (size.before != 0).then_some(size)
    }

    /// How many boxes hold an event, 0 to 2.
    pub fn boxes(&self) -> u8 {
        (1..=BOXES as u8).filter_map(|n| self.size(n)).count() as u8
    }

    /// Length in bytes of box `number`, from 1, as [`BlackBox::open`] would find it; 0 if empty.
    pub fn length(&self, number: u8) -> u32 {
        self.size(number).map_or(0, Size::length)
    }

    /// Opens box `number`, from 1, for [`BlackBox::read_at`]; its length in bytes.
    ///
    /// `None`: it is empty. A box that was open is closed.
    pub fn open(&mut self, number: u8, now: Instant) -> Option<u32> {
        self.open = None;
        let size = self.size(number)?;
        self.open = Some(Open {
            number,
            size,
            last_read: now,
        });
        Some(size.length())
    }

    /// Reads box `number` from byte `offset` on; how many bytes, fewer only at the end.
    ///
    /// `stored` reads the box from the memory: offset and room in, the number of bytes out. None
    /// when it is not the open one, or was taken for another event since.
    pub fn read_at(
        &mut self,
        number: u8,
        offset: u32,
        into: &mut [u8],
        now: Instant,
        stored: &mut dyn FnMut(u32, &mut [u8]) -> usize,
    ) -> usize {
        let Some(open) = self.open.as_mut().filter(|open| open.number == number) else {
            return 0;
        };
        open.last_read = now;
        let size = open.size;
        if self.held.number == number {
            return self.held.read_at(size, offset, into);
        }
        let rest = size.length().saturating_sub(offset) as usize;
        let wanted = rest.min(into.len());
        let count = stored(offset, into.get_mut(..wanted).unwrap_or_default());
        // It may have grown since it was opened.
        let after = AFTER_AT.checked_sub(offset).map(|at| at as usize);
        if let Some(after) = after.and_then(|at| into.get_mut(at)) {
            *after = size.after;
        }
        count
    }

    /// Closes the box under read, if there is one.
    pub const fn close(&mut self) {
        self.open = None;
    }

    /// The number of a box that is complete and not in the memory yet: [`BlackBox::save_at`] copies
    /// it from now on.
    pub fn next_unsaved(&mut self, now: Instant) -> Option<u8> {
        self.break_off(now);
        let held = &self.held;
        self.saving = held.number != 0 && !self.filling && !held.refused;
        self.saving.then_some(held.number)
    }

    /// Copies bytes of that box from `offset` on for the memory; how many, fewer only at the end.
    /// `None` when another event has taken its place.
    pub fn save_at(&self, offset: u32, into: &mut [u8]) -> Option<usize> {
        let held = &self.held;
        self.saving.then(|| held.read_at(held.size, offset, into))
    }

    /// The memory has that box now, or, if not `taken`, never will: then it stays here.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn saved(&mut self, taken: bool) {
        if !core::mem::take(&mut self.saving) {
            return;
        }
        self.held.refused = !taken;
        if taken && let Some(stored) = self.stored.get_mut(place(self.held.number)) {
            *stored = self.held.size;
            self.held.number = 0;
            self.keep_waiting();
        }
    }

    /// The memory has box `number`, of which `source` gives offset and room in, the number of bytes
    /// out. It is empty where that is no box.
    pub fn restore(&mut self, number: u8, source: &mut dyn FnMut(u32, &mut [u8]) -> usize) {
        let Some(stored) = self.stored.get_mut(place(number)) else {
            return;
        };
        let mut sizes = [0; 4];
        if source(0, &mut sizes) < sizes.len() {
            return;
        }
        let [version, frame, before, after] = sizes;
        let known = version == VERSION && usize::from(frame) == FRAME;
        let fits = (1..=BEFORE).contains(&usize::from(before)) && usize::from(after) <= AFTER;
        let size = Size { before, after };
        let last = size.length().saturating_sub(1);
        if known && fits && source(last, &mut [0]) == 1 {
            *stored = size;
        }
    }

    /// Empties both boxes and begins the recording anew, as a reset does.
    pub const fn clear(&mut self) {
        self.stored = [Size::EMPTY; BOXES];
        self.held.number = 0;
        self.waiting = None;
        self.recorded = 0;
        self.filling = false;
        self.saving = false;
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
