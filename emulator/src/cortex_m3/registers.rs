//! The core's registers: those that code computes with, its flags, its masks, its two stacks.
//!
//! Sources: PM0056 2.1.3; ARMv7-M B1.4. Left out: privilege, of which the chip has no use (it has
//! no MPU), and bits 0 and 1 of a stack pointer that code sets to anything but a word's address.

use super::op::{NOWHERE, SP};
use crate::cpu::Register;
use crate::exceptions::{IT_STATE, Masks};

/// The Thumb bit of xPSR.
const THUMB: u32 = 1 << 24;
/// Where the exception's number is in xPSR.
const NUMBER: u32 = 0x1FF;
/// CONTROL: thread mode uses the process stack.
const PROCESS: u32 = 2;
/// The priority bits that the part has in BASEPRI (PM0056 2.1.3).
const PRIORITY: u32 = 0xF0;

/// The flags, each as it is cheapest to make.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// N is its bit 31.
    pub negative: u32,
    /// Z is set when this is 0.
    pub zero: u32,
    pub carry: bool,
    pub overflow: bool,
    /// Q.
    pub saturated: bool,
}

impl Flags {
    /// From xPSR.
    fn of(xpsr: u32) -> Self {
        let bit = |number: u32| xpsr >> number & 1 != 0;
        Self {
            negative: xpsr,
            zero: u32::from(!bit(30)),
            carry: bit(29),
            overflow: bit(28),
            saturated: bit(27),
        }
    }

    /// As they stand in xPSR.
    fn bits(self) -> u32 {
        let low = [self.saturated, self.overflow, self.carry, self.zero == 0];
        let low = (27..)
            .zip(low)
            .map(|(number, flag)| u32::from(flag) << number);
        self.negative & 1 << 31 | low.fold(0, |bits, bit| bits | bit)
    }

    /// Whether a condition holds (ARMv7-M A7.3).
    #[inline(always)]
    pub fn hold(self, condition: u8) -> bool {
        // Looked up: a branch in the emulator would be as hard to foresee as that of the code.
        let flags = self.negative >> 31 << 3
            | u32::from(self.zero == 0) << 2
            | u32::from(self.carry) << 1
            | u32::from(self.overflow);
        HOLDS[usize::from(condition & 15)] >> flags & 1 != 0
    }
}

/// Bit n of a condition's entry: it holds with flags n, N being bit 3 of n and V bit 0.
const HOLDS: [u16; 16] = [
    0xF0F0, 0x0F0F, 0xCCCC, 0x3333, 0xFF00, 0x00FF, 0xAAAA, 0x5555, 0x0C0C, 0xF3F3, 0xAA55, 0x55AA,
    0x0A05, 0xF5FA, 0xFFFF, 0xFFFF,
];

/// All of them.
#[derive(Clone, Debug)]
pub struct Registers {
    /// R0 to R14, the program counter for those who asked for it, 0, and one that nobody reads;
    /// as many as a byte can tell apart, so that a number needs no check.
    r: [u32; 256],
    pub flags: Flags,
    /// The next instruction; odd behind a branch to an even address, where this core has no
    /// instructions. So one look tells whether there is code.
    pub pc: u32,
    /// Where in an IT block the code is (ARMv7-M A7.3.3); 0 outside of any.
    pub it: u8,
    /// The number of the exception that is handled, 0 in thread mode.
    number: u32,
    pub primask: bool,
    pub faultmask: bool,
    basepri: u8,
    control: u32,
    /// The stack pointer that is not in use.
    other_stack: u32,
    /// The address of an LDREX whose STREX is to come.
    pub exclusive: Option<u32>,
}

impl Default for Registers {
    fn default() -> Self {
        Self {
            r: [0; 256],
            flags: Flags::default(),
            pc: 0,
            it: 0,
            number: 0,
            primask: false,
            faultmask: false,
            basepri: 0,
            control: 0,
            other_stack: 0,
            exclusive: None,
        }
    }
}

impl Registers {
    /// A register by its number.
    #[inline(always)]
    pub fn get(&self, number: u8) -> u32 {
        self.r[usize::from(number)]
    }

    /// Writes a register by its number; [`ZERO`](super::op::ZERO) is never written.
    #[inline(always)]
    pub fn put(&mut self, number: u8, value: u32) {
        debug_assert!(number != super::op::ZERO && number <= NOWHERE);
        self.r[usize::from(number)] = value;
    }

    /// The Thumb bit.
    pub fn is_thumb(&self) -> bool {
        self.pc & 1 == 0
    }

    fn is_on_process_stack(&self) -> bool {
        self.number == 0 && self.control & PROCESS != 0
    }

    /// Changes what decides which stack is used, and changes stacks with it.
    fn change_mode(&mut self, number: u32, control: u32) {
        let before = self.is_on_process_stack();
        (self.number, self.control) = (number, control & 3);
        if self.is_on_process_stack() != before {
            let used = self.get(SP);
            self.put(SP, self.other_stack);
            self.other_stack = used;
        }
    }

    fn stack(&mut self, process: bool) -> &mut u32 {
        match self.is_on_process_stack() == process {
            true => &mut self.r[usize::from(SP)],
            false => &mut self.other_stack,
        }
    }

    /// The masks that keep exceptions away.
    pub fn masks(&self) -> Masks {
        Masks {
            primask: self.primask,
            faultmask: self.faultmask,
            basepri: self.basepri,
        }
    }

    fn xpsr(&self) -> u32 {
        let it = u32::from(self.it);
        let it = (it & 3) << 25 | (it >> 2) << 10;
        let thumb = if self.is_thumb() { THUMB } else { 0 };
        self.flags.bits() | it | thumb | self.number
    }

    fn set_xpsr(&mut self, value: u32) {
        self.flags = Flags::of(value);
        let it = value & IT_STATE;
        self.it = (it >> 25 & 3 | it >> 8 & 0xFC) as u8;
        self.pc = self.pc & !1 | u32::from(value & THUMB == 0);
        // An exception begins or ends: what another has read may be stale (ARMv7-M A3.4.4).
        self.exclusive = None;
        self.change_mode(value & NUMBER, self.control);
    }

    /// A register by its name.
    pub fn named(&self, register: Register) -> u32 {
        let process = self.is_on_process_stack();
        match register {
            Register::R(number) => self.get(number.min(12)),
            Register::Sp => self.get(SP),
            Register::Lr => self.get(super::op::LR),
            Register::Pc => self.pc & !1,
            Register::Xpsr => self.xpsr(),
            Register::Msp if process => self.other_stack,
            Register::Psp if !process => self.other_stack,
            Register::Msp | Register::Psp => self.get(SP),
            Register::Primask => self.primask.into(),
            Register::Basepri => self.basepri.into(),
            Register::Faultmask => self.faultmask.into(),
            Register::Control => self.control,
        }
    }

    /// Writes a register by its name.
    pub fn set_named(&mut self, register: Register, value: u32) {
        match register {
            Register::R(number) => self.put(number.min(12), value),
            Register::Sp => self.put(SP, value & !3),
            Register::Lr => self.put(super::op::LR, value),
            Register::Pc => self.pc = value ^ 1,
            Register::Xpsr => self.set_xpsr(value),
            Register::Msp => *self.stack(false) = value & !3,
            Register::Psp => *self.stack(true) = value & !3,
            Register::Primask => self.primask = value & 1 != 0,
            Register::Basepri => self.basepri = (value & PRIORITY) as u8,
            Register::Faultmask => self.faultmask = value & 1 != 0,
            Register::Control => self.change_mode(self.number, value),
        }
    }

    /// What MRS reads (ARMv7-M B5.2.2).
    pub fn special(&self, number: u8) -> u32 {
        match number {
            // APSR, IPSR and both; EPSR reads as 0.
            0..=7 => {
                let exception = if number & 1 != 0 { self.number } else { 0 };
                let flags = if number & 4 == 0 {
                    self.flags.bits()
                } else {
                    0
                };
                exception | flags
            }
            8 => self.named(Register::Msp),
            9 => self.named(Register::Psp),
            16 => self.primask.into(),
            17 | 18 => self.basepri.into(),
            19 => self.faultmask.into(),
            20 => self.control,
            _ => 0,
        }
    }

    /// What MSR writes (ARMv7-M B5.2.3).
    pub fn set_special(&mut self, number: u8, value: u32) {
        match number {
            0..=3 => self.flags = Flags::of(value),
            8 => self.set_named(Register::Msp, value),
            9 => self.set_named(Register::Psp, value),
            16 => self.primask = value & 1 != 0,
            17 => self.basepri = (value & PRIORITY) as u8,
            18 => {
                let raised = (value & PRIORITY) as u8;
                if raised != 0 && (self.basepri == 0 || raised < self.basepri) {
                    self.basepri = raised;
                }
            }
            19 => self.faultmask = value & 1 != 0,
            // A handler does not choose its stack.
            20 if self.number != 0 => self.control = self.control & PROCESS | value & 1,
            20 => self.change_mode(self.number, value),
            _ => {}
        }
    }
}
