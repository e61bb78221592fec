//! The check of a new program, when nothing else is to be done.
//!
//! In: orders by [`Background`]. Out: what it has found. A new program is checked in one go, which
//! everything interrupts and during which the running one is not looked at. `docs/cost.md` counts
//! what of the processor it takes.

use core::sync::atomic::{AtomicU8, Ordering};

use device::memory::update::{Verification, is_sound};
use embedded_storage::nor_flash::ReadNorFlash;
use flash::layout::Region;

use crate::chip::verifier::Verifier;
use crate::part::{LAYOUT, SIGNATURES};
use crate::self_check::{Fed, running_slot};

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
pub fn check_new() {
    if NEW.load(Ordering::Relaxed) != ASKED {
        return;
    }
    let slot = LAYOUT.slot(running_slot(&LAYOUT).other());
    let sound =
        slot.is_some_and(|slot| is_sound(&mut Fed(&LAYOUT), slot, LAYOUT.hardware, &Verifier));
    NEW.store(if sound { SOUND } else { UNSOUND }, Ordering::Relaxed);
}
