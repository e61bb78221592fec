//! The memory map of either part: what is behind the end of its flash and of its RAM.
//!
//! In: a few instructions, put into the flash of a chip without a board. Out: which of them fault.

use std::cell::RefCell;
use std::rc::Rc;

use emulator::chip::system::Blame;
use emulator::chip::{Chip, Individual};
use emulator::machine::{Kept, Machine};
use flash::layout::{BASE, C8, Layout, RAM, RC};
use sim::lis2dw12::{self, Traits};

/// Where the code begins, behind the vectors; where its one operand is; and where a fault ends.
const CODE: u32 = 0x100;
const OPERAND: u32 = CODE + 8;
const END: u32 = 0x180;

/// LDR r1, [r0]; STR r1, [r0]; BX r0.
const LOAD: u16 = 0x6801;
const STORE: u16 = 0x6001;
const JUMP: u16 = 0x4700;

/// A chip that has done this to this address, and waits.
fn done(layout: Layout, instruction: u16, address: u32) -> Machine {
    let individual = Individual {
        identity: [1, 2, 3],
        crystal: 1.0,
        lsi_hz: 40_000,
        seed: 1,
    };
    let sensor = Rc::new(RefCell::new(lis2dw12::Chip::new(Traits::TYPICAL)));
    let mut chip = Chip::new(layout, individual, sensor, 0);
    let mut put = |offset: u32, bytes: &[u8]| {
        let flashed = chip.flash.flash(offset, bytes);
        flashed.expect("it is in the flash");
    };
    let words = |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|w| w.to_le_bytes()).collect() };
    let [start, end] = [CODE, END].map(|offset| BASE + offset + 1);
    put(0, &words(&[RAM + 0x100, start, end, end]));
    // LDR r0, operand; the instruction; B to itself; NOP.
    let code = [0x4801, instruction, 0xE7FE, 0xBF00];
    put(CODE, &code.map(u16::to_le_bytes).concat());
    put(OPERAND, &words(&[address]));
    put(END, &0xE7FE_u16.to_le_bytes());
    put(layout.flash - 2, &0xBF00_u16.to_le_bytes());
    let mut machine = Machine::new(chip);
    machine.power_on(Kept::Nothing);
    // There is no bus.
    while machine.chip_mut().can.take_action().is_some() {}
    machine.run(1_000_000);
    machine
}

fn faults(layout: Layout, instruction: u16, address: u32) -> Vec<Blame> {
    let machine = done(layout, instruction, address);
    machine.faults().iter().map(|(_, blame)| *blame).collect()
}

/// Behind the last byte of flash and RAM.
fn ends(layout: Layout) -> [u32; 2] {
    [BASE + layout.flash, RAM + layout.ram]
}

#[test]
fn past_the_end_of_the_paper_s_part_is_a_fault() {
    for end in ends(C8) {
        for instruction in [LOAD, STORE] {
            assert_eq!(faults(C8, instruction, end), [Blame::Data(end)], "{end:#x}");
        }
        assert_eq!(faults(C8, LOAD, end - 4), []);
        assert_eq!(faults(C8, JUMP, end + 1), [Blame::Instruction], "{end:#x}");
    }
    assert_eq!(faults(C8, STORE, RAM + C8.ram - 4), []);
    // Code that runs on over the last half-word of the flash.
    let last = BASE + C8.flash - 2;
    assert_eq!(faults(C8, JUMP, last + 1), [Blame::Instruction]);
}

#[test]
fn the_product_s_part_goes_on_where_the_paper_s_ends_and_ends_too() {
    for end in ends(C8) {
        assert_eq!(faults(RC, LOAD, end), [], "{end:#x}");
    }
    for end in ends(RC) {
        assert_eq!(faults(RC, LOAD, end), [Blame::Data(end)], "{end:#x}");
    }
}

#[test]
fn each_part_states_its_size_and_its_density() {
    // RM0008 30.1 (F_SIZE), 31.6.1 (DBGMCU_IDCODE).
    for (layout, kilobytes, density) in [(C8, 64, 0x410), (RC, 256, 0x414)] {
        let read = |address| {
            let mut machine = done(layout, LOAD, address);
            machine.chip_mut().read(address, 4)
        };
        assert_eq!(read(0x1FFF_F7E0) & 0xFFFF, kilobytes);
        assert_eq!(read(0xE004_2000) & 0xFFF, density);
    }
}
