//! Exceptions as the core takes and leaves them: entry, return, masks.
//!
//! In: a core and the number of an exception. Out: the core at its handler, eight words deeper in
//! its stack; or back where it was. The chip's [`Nvic`] gives which exception is first.
//!
//! Sources: PM0056 2.3.6 and 2.3.7; ARMv7-M B1.5.6 to B1.5.8. Left out: lazy stacking (this core
//! has no FPU), late arrival and tail-chaining as savings of time: they give the same state.

use crate::chip::nvic::{Nvic, Waiting};
use crate::cpu::{Cpu, NoMemory, Register};

/// The bits of xPSR that hold where in an IT block the code is (ARMv7-M B1.4.2).
pub const IT_STATE: u32 = 0x0600_FC00;
/// The Thumb bit of xPSR.
const THUMB: u32 = 1 << 24;
/// xPSR of the frame: the stack was moved by 4 to be aligned (ARMv7-M B1.5.7).
const MOVED: u32 = 1 << 9;
/// Where the exception's number is in xPSR.
const NUMBER: u32 = 0x1FF;
/// Bytes of a frame.
const FRAME: u32 = 32;
/// EXC_RETURN: to a handler, with the main stack (PM0056 table 18).
const TO_HANDLER: u32 = 0xFFFF_FFF1;
/// EXC_RETURN: to the thread, with the main stack.
const TO_THREAD: u32 = 0xFFFF_FFF9;
/// EXC_RETURN: to the thread, with the process stack.
const TO_THREAD_PROCESS: u32 = 0xFFFF_FFFD;

/// The core's masks (PM0056 2.1.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Masks {
    /// PRIMASK.
    pub primask: bool,
    /// FAULTMASK.
    pub faultmask: bool,
    /// BASEPRI, 0 for none.
    pub basepri: u8,
}

impl Masks {
    /// The masks as they stand in the core.
    pub fn of(cpu: &impl Cpu) -> Self {
        Self {
            primask: cpu.register(Register::Primask) != 0,
            faultmask: cpu.register(Register::Faultmask) != 0,
            basepri: cpu.register(Register::Basepri) as u8,
        }
    }

    /// Whether the exception that waits is taken despite them.
    pub fn let_through(&self, waiting: Waiting, nvic: &Nvic) -> bool {
        if waiting.priority < 0 {
            return !self.faultmask || waiting.priority < -1;
        }
        !self.primask && !self.faultmask && self.wakes(waiting, nvic)
    }

    /// Whether it ends a WFI: as if PRIMASK were 0 (PM0056 2.5.2).
    pub fn wakes(&self, waiting: Waiting, nvic: &Nvic) -> bool {
        let base = nvic.group(self.basepri);
        self.basepri == 0 || waiting.priority < i16::from(base)
    }
}

/// Goes to the handler of exception `number`.
///
/// Errors: [`NoMemory`] when the frame does not go onto the stack or there is no vector.
pub fn enter(cpu: &mut impl Cpu, number: u32, vectors: u32) -> Result<(), NoMemory> {
    let xpsr = cpu.register(Register::Xpsr);
    let process = cpu.register(Register::Control) & 2 != 0;
    let link = match (xpsr & NUMBER, process) {
        (0, true) => TO_THREAD_PROCESS,
        (0, false) => TO_THREAD,
        _ => TO_HANDLER,
    };
    let before = cpu.register(Register::Sp);
    let moved = before & 4;
    let stack = before.wrapping_sub(FRAME + moved) & !7;
    let saved = [0, 1, 2, 3, 12].map(|number| cpu.register(Register::R(number)));
    let [r0, r1, r2, r3, r12] = saved;
    let (lr, pc) = (cpu.register(Register::Lr), cpu.register(Register::Pc));
    let status = xpsr & !MOVED | THUMB | if moved != 0 { MOVED } else { 0 };
    let mut frame = [0; FRAME as usize];
    let words = [r0, r1, r2, r3, r12, lr, pc, status];
    for (place, word) in frame.as_chunks_mut::<4>().0.iter_mut().zip(words) {
        *place = word.to_le_bytes();
    }
    cpu.write(stack, &frame)?;
    let mut vector = [0; 4];
    cpu.read(vectors.wrapping_add(4 * number), &mut vector)?;
    cpu.set_register(Register::Sp, stack);
    let flags = xpsr & !(IT_STATE | NUMBER);
    cpu.set_register(Register::Xpsr, flags | THUMB | number);
    cpu.set_register(Register::Lr, link);
    cpu.set_register(Register::Pc, u32::from_le_bytes(vector));
    Ok(())
}

/// Returns by `link`; the number of the exception that has ended.
///
/// Errors: [`NoMemory`] when there is no frame.
pub fn leave(cpu: &mut impl Cpu, link: u32) -> Result<u32, NoMemory> {
    let ended = cpu.register(Register::Xpsr) & NUMBER;
    let from = match link {
        TO_THREAD_PROCESS => Register::Psp,
        _ => Register::Msp,
    };
    let stack = cpu.register(from);
    let mut frame = [0; FRAME as usize];
    cpu.read(stack, &mut frame)?;
    let mut words = [0; 8];
    for (word, bytes) in words.iter_mut().zip(frame.as_chunks::<4>().0) {
        *word = u32::from_le_bytes(*bytes);
    }
    let [r0, r1, r2, r3, r12, lr, pc, xpsr] = words;
    for (number, value) in [(0, r0), (1, r1), (2, r2), (3, r3), (12, r12)] {
        cpu.set_register(Register::R(number), value);
    }
    let moved = if xpsr & MOVED != 0 { 4 } else { 0 };
    cpu.set_register(from, stack.wrapping_add(FRAME + moved));
    // FAULTMASK goes with any return but that from NMI (PM0056 2.1.3).
    if ended != 2 {
        cpu.set_register(Register::Faultmask, 0);
    }
    cpu.set_register(Register::Xpsr, xpsr & !MOVED);
    cpu.set_register(Register::Lr, lr);
    cpu.set_register(Register::Pc, pc | 1);
    Ok(ended)
}
