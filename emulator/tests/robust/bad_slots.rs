//! Bits that go bad in a slot: in the header, the body, the marks, of the program that runs and of
//! the other one.
//!
//! In: a flash with two programs, and bits to flip. Out: which program starts, as the tables of
//! [`flash::slots`] have it: the other one where the newer is damaged, none where both are, and
//! never one that is damaged.

use emulator::chip::flash_controller::{Cells, FlashController};
use emulator::chip::rcc::Cause;
use flash::layout::{HEADER, RC, Region, Slot};
use flash::slots::{MARKS, NoStart, activate, boot, confirm};
use sim::rng::Rng;

use crate::bench::{Bench, product};
use crate::update::{NEW, body, file};

/// The marks of an activation, the attempts and the confirmation, from the start of the slot.
const ACTIVATED: u32 = MARKS;
const ATTEMPTED: u32 = MARKS + 32;
const CONFIRMED: u32 = MARKS + 40;
/// Bytes of a header that its own check sum covers, and that itself.
const FIELDS: u32 = 32;

/// A bit that is to be flipped: slot, byte of it, bit of that.
type Flip = (Slot, u32, u8);

/// How far B, the newer, has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Newer {
    Confirmed,
    Trial,
    Spent,
}

fn region(slot: Slot) -> Region {
    RC.slot(slot).expect("two slots")
}

/// A flash with the factory's program in A and the update in B.
fn two_programs(factory: &FlashController, newer: Newer) -> Cells {
    let mut flash = factory.clone();
    flash
        .flash(region(Slot::B).start, &file(&body()))
        .expect("a good flash");
    let cells = flash.cells();
    activate(cells, &RC, Slot::B, RC.hardware).expect("a whole image");
    match newer {
        Newer::Confirmed => confirm(cells, &RC, Slot::B).expect("activated"),
        Newer::Trial => {}
        Newer::Spent => (0..3).for_each(|_| {
            boot(cells, &RC, RC.hardware);
        }),
    }
    cells.clone()
}

/// A bench that sees which program's first instruction is executed.
struct Watched {
    bench: Bench,
    factory: FlashController,
    starts: [u32; 2],
}

impl Watched {
    fn new() -> Self {
        let mut bench = Bench::new();
        let b = body();
        let a = &product().update(Slot::A)[HEADER as usize..];
        let start = |body: &[u8]| u32::from_le_bytes([body[4], body[5], body[6], body[7]]) & !1;
        let starts = [start(a), start(&b)];
        bench.pair.board(0).machine_mut().chip_mut().watch(&starts);
        let factory = bench.flash().clone();
        Self {
            bench,
            factory,
            starts,
        }
    }

    /// Starts with these bits flipped.
    fn insert(&mut self, cells: &Cells, flips: &[Flip]) {
        let mut cells = cells.clone();
        for (slot, at, bit) in flips {
            cells.flip(region(*slot).start + at, 1 << bit);
        }
        let starts = self.starts;
        let chip = self.bench.pair.board(0).machine_mut().chip_mut();
        chip.watch(&starts);
        self.bench.insert(cells);
    }

    /// Which programs were started since.
    fn started(&mut self) -> Vec<Slot> {
        let [a, _] = self.starts;
        let chip = self.bench.pair.board(0).machine().chip();
        let passed = chip.passed().iter();
        passed
            .map(|(at, _)| if *at == a { Slot::A } else { Slot::B })
            .collect()
    }

    /// With these bits flipped the program in `expected` starts, nothing else before it, and
    /// reports that it runs; `standing` is 2080h sub 4.
    fn runs(&mut self, cells: &Cells, flips: &[Flip], expected: Slot, standing: u32) {
        self.insert(cells, flips);
        self.bench.boot();
        assert_eq!(self.started(), [expected], "{flips:?}");
        let [version, slot, shown] = self.bench.shown().program;
        let is_new = u32::from(expected == Slot::B);
        assert_eq!((slot, shown), (is_new, standing), "{flips:?}");
        assert_eq!(version == NEW.0, is_new == 1, "{flips:?}");
        assert_eq!(self.bench.broken_rules(), 0, "{flips:?}");
    }

    /// With these bits flipped nothing starts, the watchdog resets, and once the first of them is
    /// right again a program starts and tells for which reason none did.
    fn stays(&mut self, cells: &Cells, flips: &[Flip], why: NoStart) {
        let before = self.bench.resets().len();
        self.insert(cells, flips);
        self.bench.pair.run(4.0);
        assert_eq!(self.started(), [], "{flips:?}");
        assert!(self.bench.pair.heard.is_empty(), "{flips:?}");
        let resets = &self.bench.resets()[before..];
        assert_eq!(resets[0], Cause::Power);
        assert!(resets.len() > 2, "{resets:?}");
        assert!(resets[1..].iter().all(|cause| *cause == Cause::Watchdog));
        let (slot, at, bit) = flips[0];
        self.bench.flash().flip(region(slot).start + at, 1 << bit);
        assert!(self.bench.comes_up_within(2.5), "{flips:?}");
        self.bench.pair.run(0.05);
        let told = self.bench.pair.of_id(0x081);
        let told: Vec<_> = told.iter().map(|heard| heard.frame.padded()).collect();
        let told_why = |frame: &[u8; 8]| frame[..4] == [0x05, 0x61, frame[2], why as u8];
        assert!(told.iter().any(told_why), "{flips:?}: {told:02X?}");
    }
}

/// A bit of every byte of the header that counts, and bits of the body.
fn damage(slot: Slot, inside: usize, rng: &mut Rng) -> Vec<Flip> {
    let length = body().len() as f64;
    let mut bit = {
        let mut rng = rng.fork();
        move || rng.range(0.0, 8.0) as u8
    };
    let header = (0..FIELDS).map(|at| (slot, at, bit()));
    let mut flips: Vec<_> = header.collect();
    for _ in 0..inside {
        let at = HEADER + rng.range(0.0, length - 1.0) as u32;
        flips.push((slot, at, bit()));
    }
    flips
}

#[test]
fn damage_to_the_newer_program_starts_the_older_one() {
    let mut watched = Watched::new();
    let mut rng = Rng::stream(1, "bad slots");
    let cells = two_programs(&watched.factory, Newer::Confirmed);
    watched.runs(&cells, &[], Slot::B, 0);
    for flip in damage(Slot::B, 8, &mut rng) {
        watched.runs(&cells, &[flip], Slot::A, 0);
    }
    // First and last byte of the body; then an activation that is void.
    for at in [
        HEADER,
        HEADER + body().len() as u32 - 1,
        ACTIVATED,
        ACTIVATED + 7,
    ] {
        watched.runs(&cells, &[(Slot::B, at, 3)], Slot::A, 0);
    }
    // What does not count: attempts and single marks of a confirmed one, signature, padding.
    for at in [ATTEMPTED, CONFIRMED, CONFIRMED + 7, 40, 100, 511] {
        watched.runs(&cells, &[(Slot::B, at, 3)], Slot::B, 0);
    }
}

#[test]
fn damage_to_the_older_program_changes_nothing() {
    let mut watched = Watched::new();
    let mut rng = Rng::stream(2, "bad slots");
    let cells = two_programs(&watched.factory, Newer::Confirmed);
    let flips = damage(Slot::A, 4, &mut rng);
    let marks = [ACTIVATED, ATTEMPTED, CONFIRMED].map(|at| (Slot::A, at, 1));
    for flip in flips.into_iter().step_by(5).chain(marks) {
        watched.runs(&cells, &[flip], Slot::B, 0);
    }
}

#[test]
fn a_program_on_trial_with_a_bit_gone_bad_is_not_tried() {
    let mut watched = Watched::new();
    let trial = two_programs(&watched.factory, Newer::Trial);
    let body = |slot| (slot, HEADER + 5000, 6);
    watched.runs(&trial, &[], Slot::B, 1);
    watched.runs(&trial, &[body(Slot::B)], Slot::A, 0);
    watched.runs(&trial, &[(Slot::B, ACTIVATED, 0)], Slot::A, 0);
    // An attempt that is lost, and a confirmation of one bit.
    watched.runs(&trial, &[(Slot::B, ATTEMPTED, 0)], Slot::B, 1);
    watched.runs(&trial, &[(Slot::B, CONFIRMED, 0)], Slot::B, 1);
    // The only one that is whole is tried, too.
    watched.runs(&trial, &[body(Slot::A)], Slot::B, 1);
    let spent = two_programs(&watched.factory, Newer::Spent);
    watched.runs(&spent, &[], Slot::A, 2);
}

#[test]
fn with_both_programs_bad_the_bootloader_stays_and_reports_why_later() {
    let mut watched = Watched::new();
    let body = |slot| (slot, HEADER + 70_000, 2);
    let confirmed = two_programs(&watched.factory, Newer::Confirmed);
    watched.stays(&confirmed, &[body(Slot::A), body(Slot::B)], NoStart::Bad);
    let magic = |slot| (slot, 1, 0);
    watched.stays(
        &confirmed,
        &[magic(Slot::B), magic(Slot::A)],
        NoStart::Empty,
    );
    let idle = (Slot::B, ACTIVATED, 0);
    watched.stays(&confirmed, &[body(Slot::A), idle], NoStart::Idle);
    let spent = two_programs(&watched.factory, Newer::Spent);
    watched.stays(&spent, &[body(Slot::A)], NoStart::Spent);
}
