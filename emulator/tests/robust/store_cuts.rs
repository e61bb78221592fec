//! The supply fails in every single flash operation of a store: parameters, and a calibration.
//!
//! In: one store over the bus, with what it did to the flash. Out: for each of its operations a
//! start with the flash that a cut there leaves. The node shows the old or the new and nothing
//! else has changed.

use std::time::Instant;

use device::calibration::encoding::{identity, length, read_at};
use emulator::cuts::Cuts;

use crate::bench::{Bench, SAVE, Shown, calibration};

/// Starts with the flash that each cut of `act` leaves; what `shows` saw then, and without a cut.
fn cut_each<T>(
    bench: &mut Bench,
    act: impl FnOnce(&mut Bench),
    mut shows: impl FnMut(&mut Bench) -> T,
) -> (Vec<T>, T) {
    let begun = Instant::now();
    let before = bench.cells();
    let journal = bench.journal(act);
    let count = journal.len();
    let mut cuts = Cuts::new(before, &journal);
    let shown = (0..count).map(|number| {
        bench.start_past_the_bootloader(cuts.at(number, 1));
        let shown = shows(bench);
        assert_eq!(bench.broken_rules(), 0, "cut {number}");
        shown
    });
    let shown: Vec<_> = shown.collect();
    bench.start(cuts.end());
    let seconds = begun.elapsed().as_secs_f64();
    eprintln!("{count} operations cut in {seconds:.1} s");
    (shown, shows(bench))
}

/// Parameters of each group that is stored as one, with their size, and what they are before and
/// after.
const PARAMETERS: [(u16, u8, [u32; 2]); 5] = [
    (0x1017, 2, [500, 700]),
    (0x6000, 2, [10, 100]),
    (0x6200, 2, [10, 100]),
    (0x2004, 2, [1, 2]),
    (0x2005, 1, [0, 1]),
];

fn store_parameters(bench: &mut Bench, which: usize) {
    for (index, size, values) in PARAMETERS {
        let set = bench.pair.write(1, (index, 0), size, values[which]);
        set.unwrap_or_else(|error| panic!("{index:04X}: {error:?}"));
    }
    bench.pair.write(1, (0x1010, 1), 4, SAVE).expect("stored");
}

/// Which of both values each parameter has.
fn parameters(bench: &mut Bench) -> [usize; 5] {
    PARAMETERS.map(|(index, _, values)| {
        let read = bench.read(index, 0);
        let which = values.iter().position(|value| *value == read);
        which.unwrap_or_else(|| panic!("{index:04X}: {read}"))
    })
}

#[test]
fn a_cut_at_every_operation_of_a_parameter_store_leaves_each_group_old_or_new() {
    let mut bench = Bench::new();
    store_parameters(&mut bench, 0);
    bench.pair.run(0.5);
    let old = bench.shown();
    let (shown, whole) = cut_each(
        &mut bench,
        |bench| store_parameters(bench, 1),
        |bench| {
            let shown = bench.shown();
            let same = Shown {
                heartbeat: shown.heartbeat,
                ..old
            };
            assert_eq!(shown, same);
            parameters(bench)
        },
    );
    assert_eq!(whole, [1; 5]);
    for (number, which) in shown.iter().enumerate() {
        let [_, resolution, safe, latch, alone] = which;
        assert_eq!(
            (resolution, latch),
            (safe, alone),
            "cut {number}: {which:?}"
        );
    }
    // The groups are stored one after the other, and none is forgotten again.
    let renewed = |which: &[usize; 5]| which.iter().sum::<usize>();
    assert!(shown.is_sorted_by_key(renewed));
    assert!(shown.len() > 200, "{}", shown.len());
    // The last operation of all may have all of its bits done by chance.
    let new = shown.iter().filter(|which| **which == whole).count();
    assert!(new <= 1, "{new}");
}

#[test]
fn a_cut_at_every_operation_of_a_calibration_leaves_the_old_or_the_new() {
    let [first, second] = [calibration(0.5), calibration(1.0)];
    let bytes = |calibration| {
        let mut bytes = vec![0; length(calibration) as usize];
        assert_eq!(read_at(calibration, 0, &mut bytes), bytes.len());
        bytes
    };
    let download = |bench: &mut Bench, calibration| {
        let stored = bench.pair.download(1, (0x2061, 0), &bytes(calibration));
        stored.expect("stored");
    };
    let mut bench = Bench::new();
    download(&mut bench, &first);
    bench.pair.run(0.5);
    let old = bench.shown();
    assert_eq!(old.calibration, identity(&first));
    let new = Shown {
        calibration: identity(&second),
        ..old
    };
    let (shown, whole) = cut_each(&mut bench, |bench| download(bench, &second), Bench::shown);
    assert_eq!(whole, new);
    for (number, one) in shown.iter().enumerate() {
        assert!([old, new].contains(one), "cut {number}: {one:?}");
    }
    let renewed = shown.iter().filter(|one| **one == new).count();
    assert!(renewed <= 1, "{renewed} of {}", shown.len());
}
