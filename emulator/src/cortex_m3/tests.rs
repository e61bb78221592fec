//! The core by itself: which one it is, what stops it, and that it counts exactly.

use std::cell::RefCell;
use std::rc::Rc;

use flash::layout::{RAM, RC};
use sim::lis2dw12::{self, Traits};

use super::*;
use crate::chip::Individual;

/// Encoded by hand; the comment beside each states what it is.
fn cpu(code: &[u16]) -> CortexM3 {
    let sensor = Rc::new(RefCell::new(lis2dw12::Chip::new(Traits::TYPICAL)));
    let individual = Individual {
        identity: [1, 2, 3],
        crystal: 1.0,
        lsi_hz: 40_000,
        seed: 1,
    };
    let mut cpu = CortexM3::new(Chip::new(RC, individual, sensor, 0));
    while cpu.chip_mut().can.take_action().is_some() {}
    put(&mut cpu, BASE, code);
    cpu.put_flash_right();
    cpu.set_register(Register::Sp, RAM + 0x1000);
    cpu.set_register(Register::Pc, BASE | 1);
    cpu.chip_mut().set_limit_ns(1_000_000);
    cpu
}

fn put(cpu: &mut CortexM3, address: u32, code: &[u16]) {
    let bytes: Vec<_> = code.iter().flat_map(|word| word.to_le_bytes()).collect();
    match address {
        BASE => cpu.chip_mut().flash.flash(0, &bytes).expect("in flash"),
        _ => cpu.write(address, &bytes).expect("in RAM"),
    }
}

#[test]
fn the_core_is_a_cortex_m3() {
    // SMULBB r0, r0, r0: of the DSP extension, which a Cortex-M4 or M33 has and this one has not.
    let mut cpu = cpu(&[0xFB10, 0xF000]);
    assert_eq!(cpu.run(), Stop::Fault(Fault::Undefined));
    assert_eq!(cpu.register(Register::Pc), BASE);
    // A division it has, unlike a Cortex-M0: see the next test. And CPUID is its own.
    assert_eq!(cpu.chip_mut().read(0xE000_ED00, 4), 0x411F_C231);
}

#[test]
fn a_division_by_hand_and_the_count_of_it() {
    // MOVS r0, #100; MOVS r1, #7; UDIV r2, r0, r1; WFI.
    let mut cpu = cpu(&[0x2064, 0x2107, 0xFBB0, 0xF2F1, 0xBF30]);
    assert_eq!(cpu.run(), Stop::WaitForInterrupt);
    assert_eq!(cpu.register(Register::R(2)), 14);
    assert_eq!(cpu.chip().instructions(), 4);
    assert_eq!(cpu.register(Register::Pc), BASE + 10);
}

#[test]
fn a_loop_counts_each_of_its_rounds() {
    // MOVS r0, #10; SUBS r0, #1; BNE -4; WFE.
    let mut cpu = cpu(&[0x200A, 0x3801, 0xD1FD, 0xBF20]);
    assert_eq!(cpu.run(), Stop::WaitForEvent);
    assert_eq!(cpu.chip().instructions(), 1 + 2 * 10 + 1);
    assert_eq!(cpu.register(Register::Pc), BASE + 8);
}

#[test]
fn what_an_it_block_skips_counts() {
    // CMP r0, r0; ITE NE; MOVNE r1, #1; MOVEQ r1, #2; WFI.
    let mut cpu = cpu(&[0x4280, 0xBF14, 0x2101, 0x2102, 0xBF30]);
    assert_eq!(cpu.run(), Stop::WaitForInterrupt);
    assert_eq!(cpu.register(Register::R(1)), 2);
    assert_eq!(cpu.chip().instructions(), 5);
}

#[test]
fn a_fault_in_the_middle_of_a_block_counts_what_was_executed() {
    // MOVS r0, #6; LSLS r0, r0, #28; LDR r1, [r0]; MOVS r2, #1; WFI.
    let mut cpu = cpu(&[0x2006, 0x0700, 0x6801, 0x2201, 0xBF30]);
    let address = 0x6000_0000;
    assert_eq!(cpu.run(), Stop::Fault(Fault::Bus { address }));
    assert_eq!(cpu.register(Register::Pc), BASE + 4);
    assert_eq!(cpu.chip().instructions(), 2);
    assert_eq!(cpu.register(Register::R(2)), 0);
}

#[test]
fn it_runs_up_to_its_limit_and_from_there_on() {
    // B to itself: one instruction a round, 8 MHz.
    let mut cpu = cpu(&[0xE7FE]);
    assert_eq!(cpu.run(), Stop::Wanted);
    assert_eq!(cpu.chip().instructions(), 8_000);
    cpu.chip_mut().set_limit_ns(2_000_000);
    assert_eq!(cpu.run(), Stop::Wanted);
    assert_eq!(cpu.chip().instructions(), 16_000);
}

/// The part would run it. The engine's copy of a page with code can't be relied on once a store
/// has changed it, so an image that runs code in the RAM is told, not believed.
#[test]
fn a_fetch_from_the_ram_ends_in_a_fault() {
    let mut cpu = cpu(&[0xBF00]);
    // MOVS r0, #5; WFI.
    put(&mut cpu, RAM + 0x100, &[0x2005, 0xBF30]);
    cpu.set_register(Register::Pc, (RAM + 0x100) | 1);
    let address = RAM + 0x100;
    assert_eq!(cpu.run(), Stop::Fault(Fault::Fetch { address }));
    assert_eq!(cpu.register(Register::R(0)), 0);
}

#[test]
fn a_store_into_locked_flash_changes_nothing_and_is_reported() {
    // MOVS r0, #8; LSLS r0, r0, #24; MOVS r1, #0; STRH r1, [r0, #32]; NOP; WFI.
    let mut cpu = cpu(&[0x2008, 0x0600, 0x2100, 0x8401, 0xBF00, 0xBF30]);
    assert_eq!(cpu.run(), Stop::WaitForInterrupt);
    assert!(cpu.chip_mut().take_bad_store());
    let mut held = [0; 2];
    cpu.read(BASE + 32, &mut held).expect("in flash");
    assert_eq!(held, [0xFF; 2]);
}

#[test]
fn a_return_from_an_exception_is_reported_with_its_code() {
    // MOVS r0, #6; MVNS r0, r0; BX r0: FFFF FFF9h.
    let mut cpu = cpu(&[0x2006, 0x43C0, 0x4700]);
    assert_eq!(cpu.run(), Stop::ExceptionReturn(0xFFFF_FFF9));
    assert_eq!(cpu.chip().instructions(), 3);
}

#[test]
fn a_supervisor_call_leaves_the_counter_behind_it() {
    // SVC #1.
    let mut cpu = cpu(&[0xDF01]);
    assert_eq!(cpu.run(), Stop::SupervisorCall);
    assert_eq!(cpu.register(Register::Pc), BASE + 2);
}

#[test]
fn undefined_and_unaligned_are_faults() {
    let mut broken = cpu(&[0xDE00]);
    assert_eq!(broken.run(), Stop::Fault(Fault::Undefined));
    assert_eq!(broken.register(Register::Pc), BASE);
    // MOVS r0, #1; LSLS r0, r0, #29; ADDS r0, #1; LDREX r1, [r0].
    let mut unaligned = cpu(&[0x2001, 0x0740, 0x3001, 0xE850, 0x1F00]);
    assert_eq!(unaligned.run(), Stop::Fault(Fault::Unaligned));
}

#[test]
fn a_bit_of_the_ram_is_set_by_its_alias() {
    // LDR r0, =0x22000028 (bit 10 of 2000 0000h); MOVS r1, #1; STR r1, [r0]; WFI; pad; literal.
    let mut cpu = cpu(&[0x4801, 0x2101, 0x6001, 0xBF30, 0x0028, 0x2200]);
    cpu.write(RAM, &[0; 4]).expect("in RAM");
    assert_eq!(cpu.run(), Stop::WaitForInterrupt);
    let mut held = [0; 4];
    cpu.read(RAM, &mut held).expect("in RAM");
    assert_eq!(u32::from_le_bytes(held), 1 << 10);
}

#[test]
fn instructions_between_two_addresses_are_counted_exactly() {
    // MOVS r0, #10; SUBS r0, #1; BNE -4; NOP; WFI. From the SUBS to the NOP: twenty.
    let mut cpu = cpu(&[0x200A, 0x3801, 0xD1FD, 0xBF00, 0xBF30]);
    cpu.chip_mut().watch(&[BASE + 2, BASE + 6]);
    assert_eq!(cpu.run(), Stop::WaitForInterrupt);
    let passed = cpu.chip().passed();
    assert_eq!(passed.first(), Some(&(BASE + 2, 1)));
    assert_eq!(passed.last(), Some(&(BASE + 6, 21)));
    assert_eq!(passed.len(), 11);
}

/// The engine asks what a page is for at the first store into it, and forgot to leave the IT block
/// that the store was in: what came after it was taken for a part of that one, which sets no flags.
#[test]
fn a_first_store_within_an_it_block_made_the_next_block_conditional() {
    // MOVS r0, #32; LSLS r0, #24; CMP r0, r0; IT EQ; STREQ r1, [r0]; B next;
    // next: MOVS r1, #5; BEQ end; MOVS r2, #1; end: WFI.
    let mut cpu = cpu(&[
        0x2020, 0x0600, 0x4280, 0xBF08, 0x6001, 0xE7FF, 0x2105, 0xD000, 0x2201, 0xBF30,
    ]);
    assert_eq!(cpu.run(), Stop::WaitForInterrupt);
    assert_eq!(cpu.register(Register::R(2)), 1);
}

/// The engine asks what a page is for at the first fetch from it, and an IT block that went on from
/// the page before was left then: what it should have skipped was executed.
#[test]
fn an_it_block_ended_at_the_end_of_a_page() {
    // CMP r0, r0; B 3FCh.
    let mut cpu = cpu(&[0x4280, 0xE1FB]);
    // NOP; IT NE; in the next page: MOVNE r1, #1; WFI.
    put(&mut cpu, BASE + 0x3FC, &[0xBF00, 0xBF18, 0x2101, 0xBF30]);
    cpu.put_flash_right();
    assert_eq!(cpu.run(), Stop::WaitForInterrupt);
    assert_eq!(cpu.register(Register::R(1)), 0);
}
