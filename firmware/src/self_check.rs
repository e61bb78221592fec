//! What the processor does when nothing else is to be done: the running program's check sum (R9),
//! the check of a new program, the depth of the stack, and the sign of life for the watchdog.
//!
//! In: the header of the image that runs, and orders by [`Background`]. Out: [`has_failed`], for
//! the device's task, what [`Background`] has found, and `STACK_UNUSED`. Everything interrupts it.
//! A step takes in [`PIECE`] bytes of the running program, at most every [`STEP_US`]: 16 kB a
//! second. A new program is checked in one go, during which the running one is not. `docs/cost.md`
//! counts what of the processor both take.

use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use device::memory::update::{Verification, is_sound};
use embedded_storage::nor_flash::{ErrorType, ReadNorFlash};
use flash::image::{Check, Verdict, header};
use flash::layout::{Region, Slot};
use tilt::sample::Instant;

use crate::chip::nor::Reader;
use crate::chip::verifier::Verifier;
use crate::chip::{clock, stack, watchdog};
use crate::guard::NorError;
use crate::node;
use crate::part::{LAYOUT, SIGNATURES};

/// Bytes that a step looks at.
const PIECE: u32 = 32;

/// Time between two steps, us.
const STEP_US: i64 = 2_000;

/// The program in flash is not the one that was linked.
static FAILED: AtomicBool = AtomicBool::new(false);

/// How the check of the new program stands: [`ASKED`] by the device's task, then [`SOUND`] or
/// [`UNSOUND`] by this one.
static NEW: AtomicU8 = AtomicU8::new(UNSOUND);
/// See [`NEW`].
const ASKED: u8 = 0;
/// See [`NEW`].
const SOUND: u8 = 1;
/// See [`NEW`].
const UNSOUND: u8 = 2;

/// Checks a new program while nothing else is to be done.
pub struct Background;

impl Verification for Background {
    fn unsigned(&self) -> bool {
        SIGNATURES.unsigned
    }

    fn begin(&mut self) {
        NEW.store(ASKED, Ordering::Relaxed);
    }

    fn outcome<F: ReadNorFlash>(&mut self, _: &mut F, _: Region, _: u32) -> Option<bool> {
        match NEW.load(Ordering::Relaxed) {
            ASKED => None,
            found => Some(found == SOUND),
        }
    }
}

/// The check of the new program, if there is one to be made.
fn check_new() {
    if NEW.load(Ordering::Relaxed) != ASKED {
        return;
    }
    let slot = LAYOUT.slot(running_slot().other());
    let sound = slot.is_some_and(|slot| is_sound(&mut Fed, slot, LAYOUT.hardware, &Verifier));
    NEW.store(if sound { SOUND } else { UNSOUND }, Ordering::Relaxed);
}

/// The watchdog hears of this task only if the device was served meanwhile.
fn feed() {
    if node::was_served() {
        watchdog::feed();
    }
}

/// The flash, to read for long: each piece is a sign of life.
struct Fed;

impl ErrorType for Fed {
    type Error = NorError;
}

impl ReadNorFlash for Fed {
    const READ_SIZE: usize = Reader::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorError> {
        feed();
        Reader.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        Reader.capacity()
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
        let found = header(&mut Fed, slot, LAYOUT.hardware);
        // Without a header that fits, nobody knows what should be there.
        FAILED.store(found.is_err(), Ordering::Relaxed);
        Self {
            slot,
            check: found.ok().map(|header| Check::new(&header)),
            next: Instant(0),
        }
    }

    /// The next step, if it is time for one; before it all of a new program's check.
    pub fn step(&mut self) {
        feed();
        check_new();
        let now = clock::now();
        let Some(check) = self.check.as_mut().filter(|_| now >= self.next) else {
            return;
        };
        self.next = now.offset(STEP_US);
        match check.step(&mut Fed, self.slot, PIECE) {
            Ok(Verdict::Running) => {}
            Ok(Verdict::Good) => stack::measure(),
            Ok(Verdict::Bad) | Err(_) => FAILED.store(true, Ordering::Relaxed),
        }
    }
}
