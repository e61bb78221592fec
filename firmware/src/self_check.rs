//! What the processor does when nothing else is to be done: the running program's check sum (R9),
//! the depth of the stack, and the sign of life for the watchdog.
//!
//! In: the header of the image that runs. Out: [`has_failed`], for the device's task, and
//! `STACK_UNUSED`. Everything interrupts it. A step takes in [`PIECE`] bytes of the running
//! program, its constants among them, at most every [`STEP_US`]: 16 kB a second. `docs/cost.md`
//! counts what of the processor it takes.

use core::sync::atomic::{AtomicBool, Ordering};

use embedded_storage::nor_flash::{ErrorType, ReadNorFlash};
use flash::image::{Check, Verdict, header};
use flash::layout::{Layout, Region, Slot};
use instant::Instant;

use crate::board_node;
use crate::chip::nor::Reader;
use crate::chip::{clock, stack, watchdog};
use crate::guard::NorError;

/// Bytes that a step looks at.
const PIECE: u32 = 32;

/// Time between two steps, us.
const STEP_US: i64 = 2_000;

/// The program in flash is not the one that was linked.
static FAILED: AtomicBool = AtomicBool::new(false);

/// The watchdog hears of this task only if the device was served meanwhile.
fn feed() {
    if board_node::was_served() {
        watchdog::feed();
    }
}

/// The flash, to read for long: each piece is a sign of life.
pub(crate) struct Fed(pub &'static Layout);

impl ErrorType for Fed {
    type Error = NorError;
}

impl ReadNorFlash for Fed {
    const READ_SIZE: usize = Reader::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorError> {
        feed();
        Reader(self.0).read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        Reader(self.0).capacity()
    }
}

unsafe extern "C" {
    /// The image's vector table, from the linker.
    static __vector_table: u32;
}

/// Whether the running program was found to be another than the linked one.
pub fn has_failed() -> bool {
    FAILED.load(Ordering::Relaxed)
}

/// The slot of the part with this map that this program runs in.
pub fn running_slot(layout: &Layout) -> Slot {
    let vectors = (&raw const __vector_table) as u32;
    match layout.b {
        Some(b) if b.address() <= vectors => Slot::B,
        _ => Slot::A,
    }
}

/// The check under way.
pub struct SelfCheck {
    layout: &'static Layout,
    slot: Region,
    check: Option<Check>,
    next: Instant,
}

impl SelfCheck {
    /// Before the first byte of the program, which is linked for the part with this map.
    pub fn new(layout: &'static Layout) -> Self {
        let slot = layout.slot(running_slot(layout)).unwrap_or(layout.a);
        let found = header(&mut Fed(layout), slot, layout.hardware);
        // Without a header that fits, it is not known what should be there.
        FAILED.store(found.is_err(), Ordering::Relaxed);
        Self {
            layout,
            slot,
            check: found.ok().map(|header| Check::new(&header)),
            next: Instant(0),
        }
    }

    /// The next step, if it is time for one.
    pub fn step(&mut self) {
        feed();
        let now = clock::now();
        let Some(check) = self.check.as_mut().filter(|_| now >= self.next) else {
            return;
        };
        self.next = now.offset(STEP_US);
        match check.step(&mut Fed(self.layout), self.slot, PIECE) {
            Ok(Verdict::Running) => {}
            Ok(Verdict::Good) => stack::measure(),
            Ok(Verdict::Bad) | Err(_) => FAILED.store(true, Ordering::Relaxed),
        }
    }
}
