//! Stack frames and calls of one function, read off its instructions.
//!
//! In: the bytes of a function without its tables. Out: the most that it has on the stack, and
//! whom it calls with how much of it.
//!
//! The function is gone through once from its start to its end. Behind an instruction that never
//! goes on, the depth is the one known from a branch to that place, or else the largest so far;
//! the figure may so be too large by a few bytes, never too small.
//!
//! Left out: functions called through a pointer, which are counted but not followed.

use std::collections::BTreeMap;

use super::thumb::{self, Effect};

/// What a function does with the stack.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    /// The most bytes it has on the stack, without those of the functions it calls.
    pub bytes: u32,
    /// The functions it calls or goes on in, each with the bytes on the stack at that moment.
    pub calls: Vec<(u32, u32)>,
    /// Calls through a pointer.
    pub indirect: u32,
}

/// Reads the function at `start`. `code` is its bytes; halfwords for which `is_data` holds (by
/// address) are tables between instructions.
pub fn read(start: u32, code: &[u8], is_data: impl Fn(u32) -> bool) -> Frame {
    let halfwords: Vec<u16> = code
        .chunks_exact(2)
        .map(|pair| u16::from_le_bytes([pair[0], pair[1]]))
        .collect();
    let mut walk = Walk::new(start, start + code.len() as u32);
    let mut at = 0;
    while at < halfwords.len() {
        let address = start + 2 * at as u32;
        if is_data(address) {
            at += 1;
            continue;
        }
        let second = halfwords.get(at + 1).copied().unwrap_or(0);
        let instruction = thumb::decode(address, halfwords[at], second);
        walk.step(address, instruction.effect);
        at += instruction.length as usize / 2;
    }
    walk.frame
}

struct Walk {
    start: u32,
    end: u32,
    frame: Frame,
    depth: u32,
    /// Depths at places that were branched to.
    known: BTreeMap<u32, u32>,
    /// The last instruction does not go on to the next one.
    ended: bool,
    /// Instructions left that are conditional.
    conditional: u32,
}

impl Walk {
    fn new(start: u32, end: u32) -> Self {
        Self {
            start,
            end,
            frame: Frame::default(),
            depth: 0,
            known: BTreeMap::new(),
            ended: false,
            conditional: 0,
        }
    }

    fn step(&mut self, address: u32, effect: Effect) {
        if self.ended {
            let known = self.known.get(&address).copied();
            self.depth = known.unwrap_or(self.frame.bytes);
            self.ended = false;
        }
        // What is done on a condition is not done on the way that goes on: those are returns.
        let always = self.conditional == 0;
        self.conditional = self.conditional.saturating_sub(1);
        match effect {
            Effect::None => {}
            Effect::Grow(bytes) => {
                self.depth += bytes;
                self.frame.bytes = self.frame.bytes.max(self.depth);
            }
            Effect::Shrink(bytes) if always => self.depth = self.depth.saturating_sub(bytes),
            Effect::Shrink(_) => {}
            Effect::Return | Effect::Leave => self.ended = always,
            Effect::Branch(to) => self.go(to),
            Effect::Jump(to) => {
                self.go(to);
                self.ended = always;
            }
            Effect::Call(to) => self.frame.calls.push((to, self.depth)),
            Effect::CallRegister => self.frame.indirect += 1,
            Effect::Conditional(count) => self.conditional = count,
        }
    }

    fn go(&mut self, to: u32) {
        if (self.start..self.end).contains(&to) {
            let depth = self.known.entry(to).or_insert(self.depth);
            *depth = (*depth).max(self.depth);
        } else {
            self.frame.calls.push((to, self.depth));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(halfwords: &[u16]) -> Frame {
        let code: Vec<u8> = halfwords.iter().flat_map(|h| h.to_le_bytes()).collect();
        read(0x1000, &code, |_| false)
    }

    #[test]
    fn pushes_and_room_for_locals_add_up() {
        // push {r4, lr}; sub sp, #16; bl .; add sp, #16; pop {r4, pc}
        let found = frame(&[0xB510, 0xB084, 0xF7FF, 0xFFFE, 0xB004, 0xBD10]);
        assert_eq!(found.bytes, 24);
        assert_eq!(found.calls, [(0x1004, 24)]);
    }

    #[test]
    fn behind_a_return_the_frame_is_what_the_branch_found() {
        // push {r4, lr}; cbz r0, L; sub sp, #64; add sp, #64; pop {r4, pc}; L: bl .
        let found = frame(&[0xB510, 0xB110, 0xB090, 0xB010, 0xBD10, 0xF7FF, 0xFFFE]);
        assert_eq!(found.bytes, 72);
        assert_eq!(found.calls, [(0x100A, 8)]);
    }

    #[test]
    fn a_last_call_that_does_not_come_back_counts_as_a_call() {
        // push {r4, lr}; pop.w {r4, lr}; b.w .-0x100
        let found = frame(&[0xB510, 0xE8BD, 0x4010, 0xF7FF, 0xBF7B]);
        assert_eq!(found.bytes, 8);
        assert_eq!(found.calls, [(0x0F00, 0)]);
    }

    #[test]
    fn a_return_on_a_condition_leaves_the_frame_for_the_rest() {
        // push {r7, lr}; it eq; popeq {r7, pc}; bl .
        let found = frame(&[0xB580, 0xBF08, 0xBD80, 0xF7FF, 0xFFFE]);
        assert_eq!(found.calls, [(0x1006, 8)]);
    }

    #[test]
    fn tables_between_instructions_are_not_read_as_such() {
        let code = [0xB510_u16, 0xB5FF, 0xBD10].map(u16::to_le_bytes).concat();
        assert_eq!(read(0, &code, |at| at == 2).bytes, 8);
    }

    #[test]
    fn calls_through_pointers_are_counted() {
        assert_eq!(frame(&[0xB510, 0x4798, 0xBD10]).indirect, 1);
    }
}
