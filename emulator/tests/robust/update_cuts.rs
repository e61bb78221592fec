//! The supply fails in the middle of an update: erasing, download, activation, trial, confirmation.
//!
//! In: one update over the bus from the first command to the confirmation, with what it did to the
//! flash. Out: for its operations a start with the flash that a cut there leaves. The old program
//! runs, or the new one, on trial or confirmed; never a third, and what is stored stays.
//!
//! A download has some 50 000 operations, nearly all of them half-words of the body, one like the
//! other, and a start takes a tenth of a second. So every operation is cut that erases, belongs to
//! the header, the marks or the records, or is the first of its page; and of the others a sample.

use std::time::Instant;

use emulator::chip::flash_controller::Operation;
use emulator::cuts::Cuts;
use flash::layout::{HEADER, PAGE, RC};

use crate::bench::{Bench, Shown};
use crate::update::{NEW, RENEWED, begin, body, file, send};

/// Half-words of the body that are cut inside a page.
const SAMPLE: usize = 24;

/// A whole update.
fn update(bench: &mut Bench) {
    send(bench, &file(&body())).expect("a whole image");
    begin(bench).expect("a signed one");
    assert!(bench.comes_up_within(5.0));
    bench.pair.run(2.0);
}

/// Whether an operation is cut whatever the sample has.
fn is_edge(operation: &Operation) -> bool {
    let b = RC.b.expect("two slots");
    let body = b.start + HEADER..b.end();
    match operation {
        Operation::Erase(_) | Operation::EraseHalf(_) => true,
        Operation::Program(at, _) => !body.contains(at) || at % PAGE == 0,
    }
}

#[test]
fn a_cut_in_an_update_leaves_the_old_program_or_the_new() {
    let begun = Instant::now();
    let mut bench = Bench::new();
    let old = bench.shown();
    let before = bench.cells();
    let journal = bench.journal(update);
    assert_eq!(bench.shown().program, RENEWED);
    let inside: Vec<_> = (0..journal.len())
        .filter(|number| !is_edge(&journal[*number]))
        .collect();
    let sampled: Vec<_> = (0..SAMPLE)
        .map(|n| inside[(n * 2 + 1) * inside.len() / (2 * SAMPLE) + n % 7])
        .collect();
    let mut cuts = Cuts::new(before, &journal);
    let mut seen = Vec::new();
    for (number, operation) in journal.iter().enumerate() {
        if !is_edge(operation) && !sampled.contains(&number) {
            continue;
        }
        bench.start(cuts.at(number, 2));
        let shown = bench.shown();
        let [version, slot, standing] = shown.program;
        let is_new = version == NEW.0 && slot == 1 && standing < 2;
        let program = if is_new { shown.program } else { old.program };
        let expected = Shown { program, ..old };
        assert_eq!(shown, expected, "cut {number}, {operation:?}");
        if is_new {
            bench.pair.run(1.0);
            let program = bench.shown().program;
            assert_eq!(program, RENEWED, "cut {number}, {operation:?}");
        }
        assert_eq!(bench.broken_rules(), 0, "cut {number}, {operation:?}");
        seen.push(is_new);
    }
    let renewed = seen.iter().filter(|new| **new).count();
    eprintln!(
        "{} of {} operations cut, {renewed} times the new, {:.1} s",
        seen.len(),
        journal.len(),
        begun.elapsed().as_secs_f64()
    );
    // Once it is activated it stays; attempt and confirmation come behind that.
    assert!(seen.is_sorted() && (4..40).contains(&renewed), "{seen:?}");
}
