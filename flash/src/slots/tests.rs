//! The state table row by row, and every transition cut at every operation.

use embedded_storage::nor_flash::NorFlash;

use super::*;
use crate::image::Version;
use crate::image::tests::{HARDWARE, file, file_for};
use crate::layout::{C8, RC};
use crate::nor::tests::{Bench, bench};

const OLD: Version = Version::new(1, 0, 0);
const NEW: Version = Version::new(1, 1, 0);

/// Slot A as it leaves the factory with the old version; slot B with the new one, not activated.
fn delivered() -> Bench {
    let mut nor = bench(128, 7);
    let mut factory = file(Slot::A, OLD, 64);
    factory[MARKS as usize..HEADER as usize].copy_from_slice(&factory_marks());
    for (slot, file) in [(RC.a, factory), (RC.b.unwrap(), file(Slot::B, NEW, 64))] {
        crate::access::program(&mut nor, slot.start, &file).unwrap();
    }
    nor
}

/// What a start does, as slot and reason.
fn start(nor: &mut Bench) -> Option<(Slot, Why)> {
    match boot(nor, &RC, HARDWARE) {
        Decision::Run(slot, header, why) => {
            let version = if slot == Slot::A { OLD } else { NEW };
            assert_eq!(header.version, version);
            Some((slot, why))
        }
        Decision::Stay(_) => None,
    }
}

const A_CONFIRMED: Option<(Slot, Why)> = Some((Slot::A, Why::Confirmed));
const A_ROLLED_BACK: Option<(Slot, Why)> = Some((Slot::A, Why::RolledBack));
const B_TRIAL: Option<(Slot, Why)> = Some((Slot::B, Why::Trial));
const B_CONFIRMED: Option<(Slot, Why)> = Some((Slot::B, Why::Confirmed));

#[test]
fn an_image_is_tried_and_confirmed() {
    let mut nor = delivered();
    assert_eq!(start(&mut nor), A_CONFIRMED);
    assert_eq!(activate(&mut nor, &RC, Slot::B, HARDWARE), Ok(1));
    assert_eq!(activate(&mut nor, &RC, Slot::B, HARDWARE), Ok(1));
    assert_eq!(start(&mut nor), B_TRIAL);
    confirm(&mut nor, &RC, Slot::B).unwrap();
    confirm(&mut nor, &RC, Slot::B).unwrap();
    for _ in 0..5 {
        assert_eq!(start(&mut nor), B_CONFIRMED);
    }
    assert_eq!(nor.broken_rules(), 0);
}

#[test]
fn an_image_that_is_never_confirmed_is_rolled_back_after_three_attempts() {
    let mut nor = delivered();
    activate(&mut nor, &RC, Slot::B, HARDWARE).unwrap();
    for _ in 0..ATTEMPTS {
        assert_eq!(start(&mut nor), B_TRIAL);
    }
    for _ in 0..5 {
        assert_eq!(start(&mut nor), A_ROLLED_BACK);
    }
    assert_eq!(activate(&mut nor, &RC, Slot::B, HARDWARE), Ok(1));
    assert_eq!(start(&mut nor), A_ROLLED_BACK);
    // In its last attempt an image may still be confirmed.
    confirm(&mut nor, &RC, Slot::B).unwrap();
    assert_eq!(start(&mut nor), B_CONFIRMED);
}

#[test]
fn a_damaged_image_leaves_the_other_and_two_leave_the_bootloader() {
    let mut nor = delivered();
    activate(&mut nor, &RC, Slot::B, HARDWARE).unwrap();
    confirm(&mut nor, &RC, Slot::B).unwrap();
    nor.flip(RC.b.unwrap().start + HEADER + 5, 1);
    assert_eq!(start(&mut nor), A_CONFIRMED);
    nor.flip(RC.a.start + 8, 1);
    assert_eq!(boot(&mut nor, &RC, HARDWARE), Decision::Stay(NoStart::Bad));
    assert_eq!(
        boot(&mut bench(128, 1), &RC, HARDWARE),
        Decision::Stay(NoStart::Empty)
    );
    // The part with one slot looks at that one only.
    let mut small = bench(128, 7);
    let mut factory = file_for(&C8, Slot::A, OLD, 64);
    factory[MARKS as usize..HEADER as usize].copy_from_slice(&factory_marks());
    crate::access::program(&mut small, C8.a.start, &factory).unwrap();
    let one = boot(&mut small, &C8, HARDWARE);
    assert!(matches!(one, Decision::Run(Slot::A, _, _)), "{one:?}");
    assert_eq!(boot(&mut delivered(), &RC, 1), Decision::Stay(NoStart::Bad));
    assert_eq!(
        activate(&mut delivered(), &C8, Slot::B, HARDWARE),
        Err(SlotError::Absent)
    );
}

#[test]
fn every_pair_of_states_is_decided_as_in_the_table() {
    let header = Header::parse(&file(Slot::A, OLD, 4)).unwrap();
    let with = |generation| Marks {
        generation: Some(generation),
        left: 0,
        confirmed: false,
    };
    let states = |generation| {
        let marks = with(generation);
        [
            SlotState::Absent,
            SlotState::Bad(ImageError::Magic),
            SlotState::Bad(ImageError::Body),
            SlotState::Idle(header),
            SlotState::Spent(header, marks),
            SlotState::Trial(header, marks),
            SlotState::Confirmed(header, marks),
        ]
    };
    let starts =
        |standing: &SlotState| matches!(standing, SlotState::Trial(..) | SlotState::Confirmed(..));
    for newer in states(2) {
        for older in states(1) {
            let decision = decide(&older, &newer);
            // Who sits in which slot makes no difference.
            match (decision, decide(&newer, &older)) {
                (Decision::Run(slot, _, why), Decision::Run(mirrored, _, same)) => {
                    assert_eq!((slot.other(), why), (mirrored, same));
                }
                (one, other) => assert_eq!(one, other),
            }
            let (runs, standing) = match decision {
                Decision::Run(Slot::A, ..) => (true, older),
                Decision::Run(Slot::B, ..) => (true, newer),
                Decision::Stay(_) => (false, SlotState::Absent),
            };
            assert_eq!(runs, starts(&newer) || starts(&older));
            if starts(&newer) {
                assert_eq!(standing, newer);
            } else if runs {
                assert_eq!(standing, older);
            }
            let back = matches!(decision, Decision::Run(.., Why::RolledBack));
            let spent = matches!(newer, SlotState::Spent(..));
            assert_eq!(back, spent && matches!(older, SlotState::Confirmed(..)));
        }
    }
    let idle = decide(&SlotState::Idle(header), &SlotState::Bad(ImageError::Body));
    assert_eq!(idle, Decision::Stay(NoStart::Idle));
    let spent = decide(&SlotState::Spent(header, with(3)), &SlotState::Absent);
    assert_eq!(spent, Decision::Stay(NoStart::Spent));
}

/// Cuts `step` at every operation; `judge` sees the flash and whether the step was done.
fn cut_everywhere(
    before: &Bench,
    step: impl Fn(&mut Bench) -> bool,
    judge: impl Fn(&mut Bench, bool),
) {
    for seed in 0..200 {
        for cut in 0.. {
            let mut nor = before.clone();
            nor.reseed(seed);
            nor.cut_after(cut);
            let done = step(&mut nor) && !nor.is_cut();
            nor.power_up();
            judge(&mut nor, done);
            assert_eq!(nor.broken_rules(), 0);
            if done {
                assert!(cut > 0);
                break;
            }
        }
    }
}

#[test]
fn a_cut_while_activating_leaves_the_old_or_the_trial() {
    let step = |nor: &mut Bench| activate(nor, &RC, Slot::B, HARDWARE).is_ok();
    cut_everywhere(&delivered(), step, |nor, done| {
        let started = start(nor);
        assert!(started == B_TRIAL || (started == A_CONFIRMED && !done));
        // A second try works.
        activate(nor, &RC, Slot::B, HARDWARE).unwrap();
        assert_eq!(start(nor), B_TRIAL);
    });
}

#[test]
fn a_cut_while_confirming_leaves_the_trial_or_the_confirmed() {
    let mut before = delivered();
    activate(&mut before, &RC, Slot::B, HARDWARE).unwrap();
    start(&mut before);
    let step = |nor: &mut Bench| confirm(nor, &RC, Slot::B).is_ok();
    cut_everywhere(&before, step, |nor, done| {
        let started = start(nor);
        assert!(started == B_CONFIRMED || (started == B_TRIAL && !done));
        // Whatever the first cut left, it stays so from start to start, and can be completed.
        assert_eq!(start(nor), started);
        confirm(nor, &RC, Slot::B).unwrap();
        assert_eq!(start(nor), B_CONFIRMED);
    });
}

#[test]
fn a_cut_while_an_attempt_is_taken_leaves_one_less_or_as_many() {
    let mut before = delivered();
    activate(&mut before, &RC, Slot::B, HARDWARE).unwrap();
    for attempts in 0..ATTEMPTS {
        let step = |nor: &mut Bench| start(nor) == B_TRIAL;
        cut_everywhere(&before, step, |nor, done| {
            let left = marks(nor, RC.b.unwrap()).unwrap().left;
            let old = ATTEMPTS - attempts;
            assert!(left == old - 1 || (left == old && !done));
            for _ in 0..left {
                assert_eq!(start(nor), B_TRIAL);
            }
            assert_eq!(start(nor), A_ROLLED_BACK);
        });
        start(&mut before);
    }
}

#[test]
fn one_bad_bit_in_the_marks_confirms_nothing_and_takes_one_attempt_at_most() {
    let mut trial = delivered();
    activate(&mut trial, &RC, Slot::B, HARDWARE).unwrap();
    start(&mut trial);
    let b = RC.b.unwrap();
    let clean = marks(&mut trial, b).unwrap();
    for at in MARKS..HEADER {
        for bit in 0..8 {
            let mut nor = trial.clone();
            nor.flip(b.start + at, 1 << bit);
            let now = marks(&mut nor, b).unwrap();
            assert!(!now.confirmed);
            assert!(now.generation == clean.generation || now.generation.is_none());
            assert!(now.left.abs_diff(clean.left) <= 1);
            // Of a confirmed image it takes nothing but its activation.
            let mut nor = delivered();
            nor.flip(RC.a.start + at, 1 << bit);
            let now = marks(&mut nor, RC.a).unwrap();
            assert!(now.confirmed);
        }
    }
}

#[test]
fn an_attempt_that_is_not_held_passes_the_image_over() {
    let mut nor = delivered();
    activate(&mut nor, &RC, Slot::B, HARDWARE).unwrap();
    // The flash loses its supply for good: reading works, writing does not.
    let mut read_only = ReadOnly(nor);
    let decision = boot(&mut read_only, &RC, HARDWARE);
    assert!(matches!(
        decision,
        Decision::Run(Slot::A, _, Why::RolledBack)
    ));
}

/// A flash that is protected against writing.
struct ReadOnly(Bench);

impl embedded_storage::nor_flash::ErrorType for ReadOnly {
    type Error = crate::nor::NorError;
}

impl ReadNorFlash for ReadOnly {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for ReadOnly {
    const WRITE_SIZE: usize = 2;
    const ERASE_SIZE: usize = crate::layout::PAGE as usize;

    fn erase(&mut self, _: u32, _: u32) -> Result<(), Self::Error> {
        Err(crate::nor::NorError::NoPower)
    }

    fn write(&mut self, _: u32, _: &[u8]) -> Result<(), Self::Error> {
        Err(crate::nor::NorError::NoPower)
    }
}
