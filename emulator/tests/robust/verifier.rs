//! The verifier beside the bootloader: whole, damaged, erased, of another version.
//!
//! In: a bench, a small program that is signed as it has to be, and what happens to the
//! bootloader's region before it is sent. Out: whether the node starts the program, or refuses its
//! signature and goes on. A program that nobody has signed who may is refused by `cost`, and one
//! without a signature by the test `update`.

use flash::layout::{RC, SEAL};
use flash::seal::{VERIFIER, close};

use crate::bench::Bench;
use crate::update::{begin, file, send};

/// 1F57h sub 1: no program started, for its signature.
const REFUSED: u32 = 7 << 1 | 5 << 16;

/// Changes the bootloader's region.
fn change(bench: &mut Bench, how: impl FnOnce(&mut [u8])) {
    let cells = bench.cells();
    let pages = cells.pages().iter();
    let mut region: Vec<u8> = pages.flat_map(|page| *page.bytes()).collect();
    region.truncate(RC.boot.end() as usize);
    how(&mut region);
    let flash = bench.flash();
    flash.flash(RC.boot.start, &region).expect("a good flash");
    let cells = bench.cells();
    bench.start(cells);
}

/// Whether the node starts a program that is signed as it has to be.
fn takes_a_signed_program(bench: &mut Bench) -> bool {
    let boots = bench.boots();
    send(bench, &file(&[0xA5; 1024])).expect("it is received");
    begin(bench).expect("it may be started");
    for _ in 0..50 {
        bench.pair.run(0.1);
        if bench.boots() > boots {
            return true;
        }
        if bench.pair.read(1, 0x1F57, 1) == Ok(REFUSED) {
            return false;
        }
    }
    panic!("the check has no end");
}

/// The first word of the seal.
fn magic(region: &mut [u8]) -> &mut [u8] {
    let at = region.len() - SEAL as usize;
    &mut region[at..at + 4]
}

#[test]
fn a_verifier_that_is_not_whole_lets_no_program_in() {
    let mut bench = Bench::new();
    let flip = |from_end: usize| {
        move |region: &mut [u8]| {
            let at = region.len() - from_end;
            region[at] ^= 4;
        }
    };
    // A constant of the curve, an address of the seal, the check sum itself.
    for from_end in [SEAL as usize + 600, 15, 1] {
        change(&mut bench, flip(from_end));
        assert!(!takes_a_signed_program(&mut bench), "{from_end}");
        change(&mut bench, flip(from_end));
    }
    change(&mut bench, |region| {
        let at = region.len() - SEAL as usize;
        region[at..].fill(u8::MAX);
    });
    assert!(!takes_a_signed_program(&mut bench), "none");
}

#[test]
fn a_verifier_with_other_calls_is_not_called_and_the_right_one_is() {
    let mut bench = Bench::new();
    change(&mut bench, |region| {
        magic(region).copy_from_slice(&(VERIFIER + 1).to_le_bytes());
        close(region);
    });
    assert!(!takes_a_signed_program(&mut bench));
    change(&mut bench, |region| {
        magic(region).copy_from_slice(&VERIFIER.to_le_bytes());
        close(region);
    });
    assert!(takes_a_signed_program(&mut bench));
}
