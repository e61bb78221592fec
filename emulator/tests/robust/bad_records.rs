//! Bits that go bad among the records: parameters, calibrations, events, in every page.
//!
//! In: a node with its own calibration beside the one delivered, parameters stored twice, and a
//! bit to flip. Out: the node comes up and measures by a calibration that was stored, or reports
//! that it has none; what it shows is what was stored last, or before, and where that is not the
//! last it is told of by an EMCY.

use std::collections::BTreeMap;

use device::calibration::encoding::{identity, length, read_at};
use emulator::chip::flash_controller::Cells;
use flash::layout::{PAGE, RC};
use sim::rng::Rng;
use tilt::chain::Calibration;

use crate::bench::{Bench, NEAR_DEG, POSE, SAVE, Shown, calibration, delivered};

/// Bits flipped in each page, and in each that has anything in it.
const FLIPS: [u32; 2] = [2, 12];
/// Bytes of a page's own header.
const HEAD: u32 = 16;
/// Bytes of a chunk's header.
const CHUNK: u32 = 16;
/// What the own calibration adds to slope X, deg.
const TURN_DEG: f64 = 5.0;

/// The codes of EMCY for what was lost: not calibrated, calibration, parameters.
const TOLD: [u16; 3] = [0xFF20, 0xFF21, 0xFF22];

fn stored(bench: &mut Bench) -> Cells {
    let own = calibration(TURN_DEG);
    let mut bytes = vec![0; length(&own) as usize];
    assert_eq!(read_at(&own, 0, &mut bytes), bytes.len());
    let done = bench.pair.download(1, (0x2061, 0), &bytes);
    done.expect("stored");
    for heartbeat in [500, 700] {
        let set = bench.pair.write(1, (0x1017, 0), 2, heartbeat);
        set.expect("a heartbeat");
        bench.pair.write(1, (0x1010, 1), 4, SAVE).expect("stored");
    }
    bench.pair.run(0.5);
    bench.cells()
}

/// Starts with these cells: what it shows, and the codes that it tells until it measures.
fn start(bench: &mut Bench, cells: Cells) -> (Shown, Vec<u16>) {
    bench.start_past_the_bootloader(cells);
    bench.pair.run(0.5);
    let shown = bench.shown();
    let told = bench.pair.of_id(0x081);
    let told = told.iter().map(|heard| {
        let [low, high, ..] = heard.frame.padded();
        u16::from_le_bytes([low, high])
    });
    (shown, told.collect())
}

/// The angle that is marked valid is the one that the calibration in force makes.
fn check_angle(bench: &mut Bench, shown: &Shown, case: &str) {
    if bench.read(0x2020, 0) & 3 != 3 {
        return;
    }
    let turned = shown.calibration == identity(&calibration(TURN_DEG));
    let roll = POSE.roll_deg;
    let turn = if turned {
        TURN_DEG * roll.to_radians().cos()
    } else {
        0.0
    };
    for (index, truth) in [(0x6010, roll + turn), (0x6020, POSE.pitch_deg)] {
        let slope = f64::from(bench.read(index, 0) as u16 as i16) / 100.0;
        assert!(
            (slope - truth).abs() < NEAR_DEG,
            "{case}: {slope}, not {truth}"
        );
    }
}

#[test]
fn a_bit_gone_bad_in_any_page_of_records_is_reported_and_no_angle_is_invented() {
    let mut bench = Bench::new();
    let default = bench.shown().heartbeat;
    let cells = stored(&mut bench);
    let (whole, told) = start(&mut bench, cells.clone());
    assert_eq!((whole.heartbeat, told), (700, vec![]));
    assert_eq!(whole.calibration, identity(&calibration(TURN_DEG)));
    let known = [calibration(TURN_DEG), delivered(), Calibration::NOMINAL];
    let known = known.map(|calibration| identity(&calibration));
    let mut rng = Rng::stream(1, "bad records");
    let (mut lost, mut silent) = (BTreeMap::new(), 0);
    for page in RC.records.start / PAGE..RC.flash / PAGE {
        let bytes = cells.pages()[page as usize].bytes();
        let used = bytes.iter().rposition(|byte| *byte != u8::MAX);
        let used = used.map_or(HEAD, |last| last as u32 + 1).max(HEAD + 1);
        for flip in 0..FLIPS[usize::from(used > HEAD + 1)] {
            // One in what looks blank, the others in what is used.
            let (from, to) = if flip == 0 {
                (used, PAGE)
            } else {
                (HEAD, used)
            };
            let at = rng.range(f64::from(from), f64::from(to)) as u32;
            let mut cells = cells.clone();
            cells.flip(page * PAGE + at.min(PAGE - 1), 1 << ((flip + at) % 8));
            let case = format!("page {page}, byte {at}");
            let (shown, told) = start(&mut bench, cells);
            let same = Shown {
                calibration: shown.calibration,
                heartbeat: shown.heartbeat,
                ..whole
            };
            assert_eq!(shown, same, "{case}");
            assert!(
                [700, 500, default].contains(&shown.heartbeat),
                "{case}: {shown:?}"
            );
            assert!(known.contains(&shown.calibration), "{case}: {shown:?}");
            check_angle(&mut bench, &shown, &case);
            let is_told = told.iter().any(|code| TOLD.contains(code));
            if shown != whole {
                *lost.entry(page).or_insert(0) += 1;
                silent += u32::from(!is_told);
            }
        }
    }
    eprintln!("lost by page: {lost:?}, {silent} of them without a word");
    assert!(!lost.is_empty());
    assert_eq!(silent, 0);
}

#[test]
fn without_the_calibration_that_was_delivered_the_node_reports_that_it_has_none() {
    let mut bench = Bench::new();
    let cells = bench.cells();
    let place = |offset: u32| RC.records.start + HEAD + CHUNK + offset;
    for offset in [0, 12, 50, length(&delivered()) - 1] {
        let mut cells = cells.clone();
        cells.flip(place(offset), 1);
        let (shown, told) = start(&mut bench, cells);
        assert_eq!(shown.calibration, identity(&Calibration::NOMINAL));
        assert_eq!(told, [0xFF20, 0xFF22], "{told:04X?}");
        // 2020h: not calibrated.
        assert_eq!(bench.read(0x2020, 0) & 0x40, 0, "byte {offset}");
    }
}
