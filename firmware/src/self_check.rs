//! What the processor does when nothing else is to be done: the running program's check sum (R9),
//! the depth of the stack, and the sign of life for the watchdog.
//!
//! In: the header of the image that runs. Out: [`has_failed`], for the device's task, and
//! `STACK_UNUSED`. A step takes in [`PIECE`] bytes, at most every [`STEP_US`] and interrupted by
//! everything: 16 kB a second. `docs/cost.md` counts what of the processor that takes.

use core::sync::atomic::{AtomicBool, Ordering};

use flash::image::{Check, Verdict, header};
use flash::layout::{Region, Slot};
use tilt::sample::Instant;

use crate::chip::nor::Reader;
use crate::chip::{clock, stack, watchdog};
use crate::node;
use crate::part::LAYOUT;

/// Bytes that a step looks at.
const PIECE: u32 = 32;

/// Time between two steps, us.
const STEP_US: i64 = 2_000;

/// The program in flash is not the one that was linked.
static FAILED: AtomicBool = AtomicBool::new(false);

unsafe extern "C" {
    /// The image's vector table, from the linker.
    static __vector_table: u32;
}

/// Whether the running program was found to be another than the linked one.
pub fn has_failed() -> bool {
    FAILED.load(Ordering::Relaxed)
}

/// The slot that this program runs in.
pub fn running_slot() -> Slot {
    let vectors = (&raw const __vector_table) as u32;
    match LAYOUT.b {
        Some(b) if b.address() <= vectors => Slot::B,
        _ => Slot::A,
    }
}

/// The check under way.
pub struct SelfCheck {
    slot: Region,
    check: Option<Check>,
    next: Instant,
}

impl Default for SelfCheck {
    fn default() -> Self {
        Self::new()
    }
}

impl SelfCheck {
    /// Before the first byte.
    pub fn new() -> Self {
        let slot = LAYOUT.slot(running_slot()).unwrap_or(LAYOUT.a);
        let found = header(&mut Reader, slot, LAYOUT.hardware);
        // Without a header that fits, nobody knows what should be there.
        FAILED.store(found.is_err(), Ordering::Relaxed);
        Self {
            slot,
            check: found.ok().map(|header| Check::new(&header)),
            next: Instant(0),
        }
    }

    /// The next step, if it is time for one. The watchdog hears of it only if the device was served
    /// meanwhile.
    pub fn step(&mut self) {
        if node::was_served() {
            watchdog::feed();
        }
        let now = clock::now();
        let Some(check) = self.check.as_mut().filter(|_| now >= self.next) else {
            return;
        };
        self.next = now.offset(STEP_US);
        match check.step(&mut Reader, self.slot, PIECE) {
            Ok(Verdict::Running) => {}
            Ok(Verdict::Good) => stack::measure(),
            Ok(Verdict::Bad) | Err(_) => FAILED.store(true, Ordering::Relaxed),
        }
    }
}
