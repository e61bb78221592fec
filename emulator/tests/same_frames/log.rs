//! What a chip's code has seen, read again in its order.
//!
//! In: the entries of a [`Tap`](emulator::chip::tap::Tap). Out: for each thing that the device's
//! task asks of a register, what the chip's code was answered there; what interrupts left in the
//! inbox, at the place in the order where they did. What the task does otherwise than the chip's
//! code did is a [`Difference`], and the end.
//!
//! It follows `firmware::chip::{clock, can}`, which use registers and so don't run on a host.

use canopen::Frame;
use canopen::frame::{ExtendedId, Id, StandardId};
use emulator::chip::tap::{CAN, Deed, Entry, TIM2};
use firmware::driver::{ErrorState, Event};
use firmware::inbox::{Inbox, Input};
use firmware::ticks;
use instant::Instant;

/// The exception of TIM2, whose handler takes edges, and of TIM3, whose handler is the task.
const EDGES: u32 = 16 + 28;
const TASK: u32 = 16 + 29;
/// The four exceptions of CAN.
const BUS: std::ops::RangeInclusive<u32> = 16 + 19..=16 + 22;

/// Registers (RM0008 15.4, 24.9.5).
pub mod register {
    use super::{CAN, TIM2};

    pub const SR: u32 = TIM2 + 0x10;
    pub const CNT: u32 = TIM2 + 0x24;
    pub const CCR1: u32 = TIM2 + 0x34;
    pub const CCR2: u32 = TIM2 + 0x38;
    pub const MCR: u32 = CAN;
    pub const MSR: u32 = CAN + 0x04;
    pub const TSR: u32 = CAN + 0x08;
    pub const RF0R: u32 = CAN + 0x0C;
    pub const RF1R: u32 = CAN + 0x10;
    pub const ESR: u32 = CAN + 0x18;
    pub const BTR: u32 = CAN + 0x1C;
    pub const FA1R: u32 = CAN + 0x21C;
    pub const FB1R1: u32 = CAN + 0x248;
    pub const FB1R2: u32 = CAN + 0x24C;
    pub const TIR: u32 = CAN + 0x180;
    pub const TDTR: u32 = CAN + 0x184;
    pub const TDLR: u32 = CAN + 0x188;
    pub const TDHR: u32 = CAN + 0x18C;
    pub const RI0R: u32 = CAN + 0x1B0;
    pub const RDT0R: u32 = CAN + 0x1B4;
    pub const RDL0R: u32 = CAN + 0x1B8;
    pub const RDH0R: u32 = CAN + 0x1BC;
    pub const RI1R: u32 = CAN + 0x1C0;
    pub const RDT1R: u32 = CAN + 0x1C4;
    pub const RDL1R: u32 = CAN + 0x1C8;
    pub const RDH1R: u32 = CAN + 0x1CC;
}
use register::*;

/// The host has done something else than the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The time of the device's task then.
    pub at: Instant,
    /// What the chip did; `None` at the end of what was written down.
    pub chip: Option<Deed>,
    /// What the host did.
    pub host: Deed,
}

/// Entries with the place that the task has come to.
#[derive(Debug)]
pub struct Log {
    entries: Vec<Entry>,
    at: usize,
    overflows: u32,
    now: Instant,
    inbox: Inbox,
    difference: Option<Difference>,
    ended: bool,
    frames: usize,
    /// Times of the edges, as the chip's code has found them.
    edges: Vec<Instant>,
    /// The latest time that the chip's code has read, in whatever handler, and the earlier one that
    /// it has read behind it, if it ever did.
    latest: Instant,
    back: Option<(Instant, Instant)>,
}

impl Log {
    /// From the first entry on.
    pub fn new(entries: Vec<Entry>) -> Self {
        Self {
            entries,
            at: 0,
            overflows: 0,
            now: Instant(0),
            inbox: Inbox::new(),
            difference: None,
            ended: false,
            frames: 0,
            edges: Vec::new(),
            latest: Instant(0),
            back: None,
        }
    }

    /// Times of the edges, as the chip's code has found them.
    pub fn edges(&self) -> &[Instant] {
        &self.edges
    }

    /// The first time that went back, behind which one, if any did.
    pub fn back(&self) -> Option<(Instant, Instant)> {
        self.back
    }

    /// The time by a count and the flags that were read behind it.
    fn time(&mut self, count: u16, flags: u32) -> Instant {
        let at = ticks::join(self.overflows, flags & 1 != 0, count);
        if at < self.latest {
            self.back.get_or_insert((self.latest, at));
        }
        self.latest = at;
        at
    }

    /// True when there is nothing more to follow.
    pub fn has_ended(&self) -> bool {
        self.ended
    }

    /// Where the host went its own way.
    pub fn difference(&self) -> Option<Difference> {
        self.difference
    }

    /// Frames so far that went into a mailbox, all as on the chip.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// The latest time that the task has read.
    pub fn reached(&self) -> Instant {
        self.now
    }

    /// The inbox.
    pub fn inbox(&mut self) -> &mut Inbox {
        &mut self.inbox
    }

    fn peek(&self) -> Option<Entry> {
        self.entries.get(self.at).copied()
    }

    /// The next thing that the task's code did. Interrupts before it leave what they have.
    fn task(&mut self) -> Option<Deed> {
        loop {
            let entry = self.peek()?;
            match (entry.exception, entry.deed) {
                (EDGES, _) => self.edge(),
                (exception, _) if BUS.contains(&exception) => self.bus(exception),
                // The alarm, which is set to what the device asks for.
                (TASK, Deed::Store(TIM2..CAN, _)) => self.at += 1,
                (TASK, deed) => return Some(deed),
                _ => self.at += 1,
            }
        }
    }

    /// The task does this; on the chip it did the same, or the end is here.
    ///
    /// Of what the chip was answered there is no more than a default then.
    fn follow(&mut self, host: Deed, same: impl Fn(Deed) -> bool) -> Option<Deed> {
        if self.ended {
            return None;
        }
        let chip = self.task();
        match chip.filter(|deed| same(*deed)) {
            Some(deed) => {
                self.at += 1;
                Some(deed)
            }
            None => {
                self.ended = true;
                let at = self.now;
                self.difference = chip.map(|_| Difference { at, chip, host });
                None
            }
        }
    }

    /// The task loads a register.
    pub fn load(&mut self, address: u32) -> u32 {
        let same = |deed| matches!(deed, Deed::Load(at, _) if at == address);
        match self.follow(Deed::Load(address, 0), same) {
            Some(Deed::Load(_, value)) => value,
            _ => 0,
        }
    }

    /// The task stores into a register.
    pub fn store(&mut self, address: u32, value: u32) {
        let deed = Deed::Store(address, value);
        self.follow(deed, |chip| chip == deed);
        self.frames += usize::from(!self.ended && (address - CAN) & !0x30 == TIR - CAN);
    }

    /// The task selects the sensor, or lets it go.
    pub fn select(&mut self, selected: bool) {
        let deed = Deed::Select(selected);
        self.follow(deed, |chip| chip == deed);
    }

    /// The task exchanges a byte with the sensor.
    pub fn exchange(&mut self, byte: u8) -> u8 {
        let same = |deed| matches!(deed, Deed::Byte(out, _) if out == byte);
        match self.follow(Deed::Byte(byte, 0), same) {
            Some(Deed::Byte(_, answer)) => answer,
            _ => 0,
        }
    }

    /// The task looks at the clock. After the end a second passes between two looks, so that
    /// nobody waits for ever.
    pub fn now(&mut self) -> Instant {
        let (count, flags) = (self.load(CNT), self.load(SR));
        self.now = match self.ended {
            true => self.now.offset(1_000_000),
            false => self.time(count as u16, flags),
        };
        self.now
    }

    /// What is in the inbox up to `until`, as the chip's code found it after it had seen `now`.
    pub fn take(&mut self, until: Instant, now: Instant) -> Option<(Input, Instant)> {
        let found = self.inbox.take(until);
        if found.is_some() || until <= now || self.sets_alarm() {
            return found;
        }
        // Something came in between its look at the clock and that into the inbox.
        let _ = self.task();
        self.inbox.take(until)
    }

    /// Whether the task set the alarm next: it had found nothing.
    fn sets_alarm(&self) -> bool {
        let rest = self.entries.get(self.at..).unwrap_or_default();
        let next = rest.iter().find(|entry| entry.exception == TASK);
        matches!(
            next.map(|entry| entry.deed),
            Some(Deed::Store(CCR2, _)) | None
        )
    }

    /// The next entry, if it is one of this exception.
    fn of(&mut self, exception: u32) -> Option<Deed> {
        let entry = self.peek().filter(|entry| entry.exception == exception)?;
        self.at += 1;
        Some(entry.deed)
    }

    /// The handler of TIM2: an overflow, an edge, or both.
    fn edge(&mut self) {
        let (mut flags, mut captured, mut count) = (None, None, 0);
        while let Some(deed) = self.of(EDGES) {
            match (deed, captured) {
                (Deed::Load(SR, value), Some(edge)) => {
                    let edge = ticks::captured(edge, self.time(count, value));
                    self.edges.push(edge);
                    self.inbox.edge(edge);
                }
                (Deed::Load(SR, value), None) => flags = Some(value),
                (Deed::Load(CCR1, value), _) => captured = Some(value as u16),
                (Deed::Load(CNT, value), _) => count = value as u16,
                (Deed::Store(SR, _), _) => break,
                _ => {}
            }
        }
        let late = flags.unwrap_or(0) & 1;
        self.overflows = self.overflows.wrapping_add(late);
    }

    /// A handler of CAN, which ends with a look at the error state.
    fn bus(&mut self, exception: u32) {
        let (mut count, mut at, mut words) = (0, Instant(0), [0; 4]);
        while let Some(deed) = self.of(exception) {
            match deed {
                Deed::Load(CNT, value) => count = value as u16,
                Deed::Load(SR, flags) => at = self.time(count, flags),
                Deed::Load(TSR, flags) => self.completed(flags, at),
                Deed::Load(RF0R | RF1R, flags) if flags & 1 << 4 != 0 => self.inbox.lost(),
                Deed::Load(RI0R | RI1R, value) => words[0] = value,
                Deed::Load(RDT0R | RDT1R, value) => words[1] = value,
                Deed::Load(RDL0R | RDL1R, value) => words[2] = value,
                Deed::Load(RDH0R | RDH1R, value) => {
                    words[3] = value;
                    if let Some(frame) = frame(words) {
                        self.inbox.put(Event::Received(frame), at);
                    }
                }
                Deed::Load(ESR, value) => {
                    self.tell(error_state(value), at);
                    return;
                }
                _ => {}
            }
        }
    }

    fn completed(&mut self, flags: u32, at: Instant) {
        for place in 0..3u8 {
            let flags = flags >> (8 * u32::from(place));
            let event = match flags & 3 {
                3 => Event::Sent(place),
                1 => Event::GivenUp(place),
                _ => continue,
            };
            self.inbox.put(event, at);
        }
    }

    /// Tells the inbox of the error state and its counters.
    pub fn tell(&mut self, (state, transmit, receive): (ErrorState, u8, u8), at: Instant) {
        self.inbox.state(state, transmit, receive, at);
    }
}

/// What ESR holds (RM0008 24.9.2): the error state, and the counters of sending and receiving.
pub fn error_state(esr: u32) -> (ErrorState, u8, u8) {
    let state = match esr {
        esr if esr & 4 != 0 => ErrorState::Off,
        esr if esr & 2 != 0 => ErrorState::Passive,
        esr if esr & 1 != 0 => ErrorState::Warning,
        _ => ErrorState::Active,
    };
    (state, (esr >> 16) as u8, (esr >> 24) as u8)
}

/// The frame in a receive mailbox (RM0008 24.9.4).
fn frame([rir, rdtr, low, high]: [u32; 4]) -> Option<Frame> {
    let id: Id = match rir & 4 != 0 {
        true => ExtendedId::new(rir >> 3)?.into(),
        false => StandardId::new((rir >> 21) as u16)?.into(),
    };
    let length = (rdtr as usize & 0xF).min(8);
    if rir & 2 != 0 {
        return Frame::remote(id, length);
    }
    let bytes = (u64::from(high) << 32 | u64::from(low)).to_le_bytes();
    Frame::with(id, bytes.get(..length)?)
}
