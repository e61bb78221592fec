//! How deep the stack has been: what of the paint put there before `main` is left.
//!
//! In: nothing. Out: bytes never used since the start. The runtime paints everything between the
//! statics and the stack; the deepest call scrapes it off.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m_rt::STACK_PAINT_VALUE;

/// Bytes of the stack never used since the start, as [`measure`] last found them; for a debugger
/// and for the emulator.
#[unsafe(no_mangle)]
pub static STACK_UNUSED: AtomicU32 = AtomicU32::new(0);

unsafe extern "C" {
    /// The lowest word of the stack, from the linker.
    static _stack_end: u32;
    /// The word behind the stack, from the linker.
    static _stack_start: u32;
}

/// Counts the words that still have their paint, from the stack's end upwards.
pub fn measure() {
    let (mut at, top) = (&raw const _stack_end, &raw const _stack_start);
    let mut unused = 0;
    // SAFETY: the linker's symbols enclose RAM that nothing but the stack uses; a volatile read
    // of a word that the stack is about to use is only an old value.
    while at < top && unsafe { at.read_volatile() } == STACK_PAINT_VALUE {
        at = at.wrapping_add(1);
        unused += 4;
    }
    STACK_UNUSED.store(unused, Ordering::Relaxed);
}
