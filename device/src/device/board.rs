//! What the board tells the device of itself: why it came up, and what it found wrong.
//!
//! In: the cause of the last reset, frames that were lost before the device saw them, and the
//! result of the running program's check. Out: EMCY and an entry of the fault log.
//!
//! Left out: how the board finds out.

use instant::Instant;

use super::{Device, Memory};
use crate::fault_log::Entry;
use crate::instrument::Instrument;
use crate::sensor::Part;

impl<P: Part, M: Memory, I: Instrument> Device<P, M, I> {
    /// The program before this start has ended by itself; call it after [`Device::start_bus`].
    ///
    /// `code` is one of CiA 301's 61xxh, internal software, and `detail` goes into bytes 3 to 7 of
    /// the EMCY. It is told once and stands in the fault log; no fault remains, since the program
    /// that runs now has done nothing wrong.
    pub fn came_up_after(&mut self, code: u16, detail: [u8; 5], now: Instant) {
        let bits = self.faults.register();
        let (bus, mut objects) = self.split(now);
        bus.report(&mut objects, code, bits, detail, now);
        if I::HISTORY {
            self.parts.log.add(Entry {
                code,
                at_ms: self.uptime_ms(now),
                ..Entry::default()
            });
        }
        self.after(now);
    }

    /// Frames were lost on their way to the device: they came faster than they were taken.
    pub fn frames_lost(&mut self, count: u16, now: Instant) {
        self.bus.overrun(count);
        self.after(now);
    }

    /// The running program is not what was linked (R9): a fault until the next start.
    pub const fn program_damaged(&mut self) {
        self.parts.values.program_damaged = true;
    }
}
