//! The paper's exact images, bootloader and application, on two boards with the paper's part.

use std::sync::OnceLock;

use canopen::Frame;
use emulator::build::Paper;
use emulator::chip::flash_controller::{Dice, FlashController, Operation};
use emulator::chip::rcc::Cause;
use emulator::pair::{Outfit, Pair, SdoError};
use flash::layout::{C8, RAM, SEAL};
use flash::nor::{Nor, Page};
use sim::bench::{Mode, World};
use sim::network::guest::Switch;
use sim::network::hand::Pose;
use sim::network::instrument::Delivered;

/// "save", as 1010h wants it (CiA 301 7.5.2.13).
const SAVE: u32 = 0x6576_6173;
/// What the runtime paints the stack with.
const PAINT: u32 = 0xCCCC_CCCC;
/// The motor's run.
const MOTOR: u16 = 0x2060;
/// What answers a store that the memory has refused (CiA 301, table 22: hardware error).
const REFUSED: Result<(), SdoError> = Err(SdoError::Abort(0x0606_0000));

fn paper() -> &'static Paper {
    static PAPER: OnceLock<Paper> = OnceLock::new();
    PAPER.get_or_init(|| Paper::build().expect("the images build"))
}

/// So many boards, not calibrated.
fn boards(count: usize) -> Pair {
    let pieces = paper().pieces();
    let pair = Pair::of(count, 1, Outfit::paper(&pieces));
    pair.expect("the image is for the flash")
}

/// An instrument as it comes from the bench.
fn delivered() -> Pair {
    let bench = Delivered::calibrated(Mode::Paper, &World::NOMINAL, 1, 0);
    let pieces = paper().pieces();
    let pair = Pair::delivered(&bench.expect("a good unit"), 1, Outfit::paper(&pieces));
    pair.expect("the image is for the flash")
}

fn flash(pair: &mut Pair) -> &mut FlashController {
    &mut pair.board(0).machine_mut().chip_mut().flash
}

fn cells(pair: &mut Pair) -> &mut Nor<Vec<Page>, Dice> {
    flash(pair).cells()
}

/// Power off and on, and a start.
fn restart(pair: &mut Pair) {
    pair.network.switch_guest(0, Switch::Off);
    pair.network.switch_guest(0, Switch::On);
    pair.run(1.0);
}

/// EMCY of node 1 with this error code.
fn told(pair: &Pair, code: u16) -> usize {
    let frames = pair.of_id(0x081).into_iter().map(|heard| heard.frame);
    frames
        .filter(|frame| frame.bytes().starts_with(&code.to_le_bytes()))
        .count()
}

fn slope(pair: &mut Pair, node: u8, index: u16) -> f64 {
    let slope = pair.read(node, index, 0).expect("a slope");
    f64::from(slope as u16 as i16) / 100.0
}

/// Puts the housing there and waits until it stands.
fn put(pair: &mut Pair, roll_deg: f64, pitch_deg: f64) {
    assert!(pair.hand.go(Pose {
        pitch_deg,
        roll_deg
    }));
    pair.run(5.5);
}

#[test]
fn the_paper_s_pair_boots_measures_and_agrees() {
    let mut pair = delivered();
    pair.run(1.5);
    for (number, id) in [(0, 0x701), (1, 0x702)] {
        assert_eq!(pair.of_id(id)[0].frame.bytes(), [0]);
        assert_eq!(pair.board(number).machine().resets(), [Cause::Power]);
    }
    pair.send(Frame::data_frame(0, &[1, 0])).unwrap();
    for (roll, pitch) in [(0.0, 0.0), (-40.0, 0.0), (0.0, 33.0)] {
        put(&mut pair, roll, pitch);
        pair.run_synced(100).unwrap();
        for node in [1, 2] {
            let read = [0x6010, 0x6020].map(|index| slope(&mut pair, node, index));
            let off = [read[0] - roll, read[1] - pitch];
            assert!(off.iter().all(|error| error.abs() < 0.4), "{node}: {off:?}");
            // The rule that it was built with, and nothing found.
            assert_eq!(pair.read(node, 0x2003, 0), Ok(0));
            assert_eq!(pair.read(node, 0x1001, 0), Ok(0));
        }
    }
    // TPDO 1 goes out at each SYNC, and the angle is another one with each sample, 50 a second.
    assert!(pair.of_id(0x181).len() > 290);
}

#[test]
fn the_stack_of_the_paper_s_image_never_comes_near_its_statics() {
    let mut pair = boards(1);
    pair.run(1.0);
    calibrate(&mut pair).expect("it is stored");
    let end = paper().app.symbol("_stack_end").expect("the linker's");
    let unused = pair.board(0).machine().painted_from(end, PAINT);
    let stack = RAM + C8.ram - end;
    eprintln!("stack: {} of {stack} bytes used", stack - unused);
    assert!(unused > 500, "{unused}");
}

/// Lets the motor go through both axes of node 1 and stores what it has memorised.
fn calibrate(pair: &mut Pair) -> Result<(), SdoError> {
    for (start, x, y) in [(1, 1.0, 0.0), (2, 0.0, 1.0)] {
        pair.write(1, (MOTOR, 1), 1, start)?;
        for deg in (-60..=60).step_by(30) {
            let at = f64::from(deg);
            put(pair, x * at, y * at);
            pair.write(1, (MOTOR, 2), 4, (deg * 1000) as u32)?;
        }
    }
    put(pair, 0.0, 0.0);
    pair.write(1, (MOTOR, 1), 1, 3)
}

#[test]
fn r8_a_calibration_made_by_2060h_is_there_after_a_reset() {
    let mut pair = boards(1);
    pair.run(1.0);
    let before = pair.read(1, 0x2062, 1);
    calibrate(&mut pair).expect("it is stored");
    let made = pair.read(1, 0x2062, 1);
    assert_ne!(made, before);
    // Not evaluated is not 0.
    assert_eq!(pair.read(1, 0x2022, 3), Ok(0xFFFF));
    restart(&mut pair);
    assert_eq!(pair.read(1, 0x2062, 1), made);
    put(&mut pair, 20.0, 0.0);
    let error = slope(&mut pair, 1, 0x6010) - 20.0;
    // A straight line over 30 deg of a sine.
    assert!(error.abs() < 2.5, "{error}");
    assert_eq!(cells(&mut pair).broken_rules(), 0);
}

#[test]
fn r8_a_cut_in_a_store_of_the_paper_s_node_leaves_the_old_or_the_new() {
    let mut pair = boards(1);
    pair.run(1.0);
    let mut old = 500;
    pair.write(1, (0x1017, 0), 2, old).expect("a heartbeat");
    let before = cells(&mut pair).operations();
    pair.write(1, (0x1010, 1), 4, SAVE).expect("stored");
    pair.run(0.5);
    let store = cells(&mut pair).operations() - before;
    let last = store.saturating_sub(4);
    let between = (2..last).step_by(store as usize / 8 + 1);
    for cut in (0..2).chain(between).chain(last..store) {
        let new = 600 + cut as u32;
        pair.write(1, (0x1017, 0), 2, new).expect("a heartbeat");
        cells(&mut pair).cut_after(cut);
        // The answer may be lost with the supply.
        let _ = pair.write(1, (0x1010, 1), 4, SAVE);
        pair.run(0.5);
        restart(&mut pair);
        let now = pair.read(1, 0x1017, 0).expect("it runs");
        assert!(
            [old, new].contains(&now),
            "cut {cut}: {now}, not {old} or {new}"
        );
        old = now;
    }
    assert_eq!(cells(&mut pair).broken_rules(), 0);
}

#[test]
fn r9_a_flipped_bit_of_the_paper_s_program_is_reported_and_it_is_not_started_again() {
    let mut pair = boards(1);
    pair.run(1.0);
    assert_eq!(told(&pair, 0x6110), 0);
    let end = paper().factory.len() as u32 - 1;
    flash(&mut pair).flip(end, 1);
    let found = (0..30).any(|_| {
        pair.run(1.0);
        told(&pair, 0x6110) > 0
    });
    assert!(found, "a damaged program was not told of within 30 s");
    let boots = pair.of_id(0x701).len();
    restart(&mut pair);
    pair.run(3.0);
    assert_eq!(pair.of_id(0x701).len(), boots);
    let resets = pair.board(0).machine().resets();
    assert!(resets.ends_with(&[Cause::Watchdog]), "{resets:?}");
    // Right again, it starts, and tells why it did not.
    flash(&mut pair).flip(end, 1);
    pair.run(3.0);
    assert!(pair.of_id(0x701).len() > boots);
    assert_eq!(told(&pair, 0x6105), 1);
}

#[test]
fn r10_the_bootloader_erases_and_with_its_seal_damaged_nobody_does() {
    let with = |image: &emulator::image::Image| image.symbols_with(&["erase_page"]).len();
    assert_eq!([with(&paper().boot), with(&paper().app)], [1, 0]);
    let mut pair = boards(1);
    pair.run(1.0);
    let save = |pair: &mut Pair, times: u32| -> Vec<Result<(), SdoError>> {
        let saves = (0..times).map(|time| {
            pair.write(1, (0x1017, 0), 2, 500 + time)
                .expect("a heartbeat");
            let saved = pair.write(1, (0x1010, 1), 4, SAVE);
            pair.run(0.5);
            saved
        });
        saves.collect()
    };
    flash(&mut pair).begin_journal();
    assert!(save(&mut pair, 60).iter().all(Result::is_ok));
    let journal = flash(&mut pair).take_journal();
    let erased = journal.iter().filter_map(|operation| match operation {
        Operation::EraseHalf(offset) => Some(*offset),
        _ => None,
    });
    let erased: Vec<_> = erased.collect();
    let records = C8.records.start..C8.records.end();
    assert!(erased.len() > 4 && erased.iter().all(|offset| records.contains(offset)));
    let magic = C8.boot.end() - SEAL;
    flash(&mut pair).flip(magic + 8, 4);
    let saved = save(&mut pair, 60);
    assert!(saved.contains(&REFUSED), "{saved:?}");
    assert_eq!(pair.board(0).machine().resets(), [Cause::Power]);
    let lives = pair.of_id(0x701).len();
    pair.run(2.0);
    assert!(pair.of_id(0x701).len() > lives);
    assert_eq!(cells(&mut pair).broken_rules(), 0);
}
