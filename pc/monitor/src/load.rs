//! How busy the bus is: frames, SYNCs and bits of the last second.
//!
//! In: frames with their time. Out: rates over the last complete second, in slots of a tenth.
//! The bits of a frame are those on the wire, stuff bits and intermission included (ISO 11898-1).
//!
//! Left out: error frames, which no adapter passes on here.

use canopen::Frame;
use sim::can_bus::{INTERMISSION_BITS, frame_bits};

/// Length of a slot.
const SLOT_NS: u64 = 100_000_000;

/// Slots that are counted: one second.
const SLOTS: usize = 10;

/// What one slot, or one second, has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rates {
    /// Frames.
    pub frames: u32,
    /// SYNCs.
    pub syncs: u32,
    /// Bits on the wire.
    pub bits: u64,
}

/// The last second of a bus.
#[derive(Clone, Debug, Default)]
pub struct Load {
    done: [Rates; SLOTS],
    now: Rates,
    slot: u64,
}

impl Load {
    /// Counts a frame at its time.
    pub fn take(&mut self, time_ns: u64, frame: &Frame, is_sync: bool) {
        self.advance(time_ns);
        self.now.frames += 1;
        self.now.syncs += u32::from(is_sync);
        self.now.bits += frame_bits(frame) + INTERMISSION_BITS;
    }

    /// Time goes on without a frame.
    pub fn advance(&mut self, time_ns: u64) {
        let slot = time_ns / SLOT_NS;
        let passed = slot.saturating_sub(self.slot);
        if passed == 0 {
            return;
        }
        // The slot that has ended goes first, then the empty ones behind it.
        for step in 0..passed.min(SLOTS as u64 + 1) {
            self.done.rotate_left(1);
            let ended = if step == 0 {
                self.now
            } else {
                Rates::default()
            };
            if let Some(last) = self.done.last_mut() {
                *last = ended;
            }
        }
        self.now = Rates::default();
        self.slot = slot;
    }

    /// Begins anew at this time, for a source whose time has jumped back.
    pub fn restart(&mut self, time_ns: u64) {
        *self = Self::default();
        self.slot = time_ns / SLOT_NS;
    }

    /// What the last complete second has seen.
    pub fn per_second(&self) -> Rates {
        let start = Rates::default();
        self.done.iter().fold(start, |sum, slot| Rates {
            frames: sum.frames + slot.frames,
            syncs: sum.syncs + slot.syncs,
            bits: sum.bits + slot.bits,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn a_steady_bus_shows_its_rate_and_a_silent_one_none() {
        let mut load = Load::default();
        let frame = Frame::data_frame(0x181, &[1, 2, 3, 4, 5, 6]);
        for time in 0..2000 {
            load.take(time * MS, &frame, time % 10 == 0);
        }
        load.advance(2000 * MS);
        let rates = load.per_second();
        assert_eq!((rates.frames, rates.syncs), (1000, 100));
        assert_eq!(rates.bits, 1000 * (frame_bits(&frame) + 3));
        load.advance(2500 * MS);
        assert_eq!(load.per_second().frames, 500);
        load.advance(3100 * MS);
        assert_eq!(load.per_second(), Rates::default());
    }

    #[test]
    fn a_frame_without_stuffing_has_the_bits_of_the_standard() {
        // SOF, 11 + 7 of header, 48 of data, 15 of CRC, 10 behind it, without stuff bits.
        let plain = 1 + 18 + 48 + 15 + 10;
        let frame = Frame::data_frame(0x555, &[0x55; 6]);
        let bits = frame_bits(&frame);
        assert!((plain..plain + 8).contains(&bits), "{bits}");
    }

    #[test]
    fn a_jump_of_days_is_no_long_loop() {
        let mut load = Load::default();
        load.take(0, &Frame::data_frame(0x80, &[]), true);
        load.advance(u64::MAX);
        assert_eq!(load.per_second(), Rates::default());
        load.restart(5);
        load.advance(u64::MAX);
        assert_eq!(load.per_second().frames, 0);
    }
}
