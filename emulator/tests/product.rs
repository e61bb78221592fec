//! The exact images of bootloader and application, on two boards.

use std::sync::OnceLock;

use canopen::Frame;
use emulator::build::Product;
use emulator::chip::flash_controller::Dice;
use emulator::chip::rcc::Cause;
use emulator::chip::system::Blame;
use emulator::cpu::{Cpu, Register};
use emulator::pair::{Pair, SdoError};
use emulator::stopwatch::Stopwatch;
use flash::layout::{BASE, RC};
use flash::nor::{Nor, Page};
use sim::can_bus::Port;
use sim::network::guest::Switch;
use sim::network::hand::Pose;

/// "save", as 1010h wants it (CiA 301 7.5.2.13).
const SAVE: u32 = 0x6576_6173;
/// What the runtime paints the stack with.
const PAINT: u32 = 0xCCCC_CCCC;

fn product() -> &'static Product {
    static PRODUCT: OnceLock<Product> = OnceLock::new();
    PRODUCT.get_or_init(|| Product::build().expect("the images build"))
}

fn pair() -> Pair {
    Pair::new(1, &product().pieces()).expect("the image is for the flash")
}

#[test]
fn both_nodes_boot_and_report_it() {
    let mut pair = pair();
    pair.run(1.5);
    for (number, id) in [(0, 0x701), (1, 0x702)] {
        assert_eq!(pair.of_id(id)[0].frame.bytes(), [0]);
        assert_eq!(pair.board(number).machine().resets(), [Cause::Power]);
    }
    pair.send(Frame::data_frame(0, &[1, 0])).unwrap();
    pair.run_synced(100).unwrap();
    assert!(pair.of_id(0x181).len() > 90);
}

#[test]
fn two_product_nodes_run_much_faster_than_time() {
    let mut pair = pair();
    pair.run(1.0);
    pair.send(Frame::data_frame(0, &[1, 0])).unwrap();
    pair.run_synced(50).unwrap();
    let before = pair.board(0).machine().chip().instructions();
    let watch = Stopwatch::start();
    pair.run_synced(1000).unwrap();
    let times = 10.0 / watch.seconds();
    let run = pair.board(0).machine().chip().instructions() - before;
    eprintln!("two emulated nodes: {times:.1} times real time, {run} instructions in 10 s");
    // Beside everything else that a test run does a core is half as fast as alone.
    assert!(times > 3.0);
}

#[test]
fn requests_to_the_other_node_took_the_room_of_ones_own() {
    let mut pair = pair();
    pair.run(1.5);
    for (number, request) in [(0, 0x601), (1, 0x602)] {
        let can = &pair.board(number).machine().chip().can;
        // Bank 1 of the filter: FB1R1 and FB1R2 (RM0008 24.9.4), for FIFO 1 (FFA1R).
        assert_eq!([can.read(0x248), can.read(0x24C)], [request << 21; 2]);
        assert_eq!(can.read(0x214) & 0b111, 0b011);
    }
}

/// Has a stranger send this identifier without a pause; `None` ends that.
fn flood(pair: &mut Pair, stranger: Port, id: Option<u16>) {
    let frame = id.map(|id| Frame::data_frame(id, &[0xAA; 8]));
    pair.network.bus.babble(stranger, frame);
}

#[test]
fn an_emcy_waited_behind_three_frames_for_as_long_as_a_flood_lasted() {
    let mut pair = pair();
    pair.run(1.0);
    let stranger = pair.network.attach_host();
    // LSS answer and heartbeat wait behind 650h, and then the SDO answer behind 100h.
    for request in [[4, 1, 0, 0, 0, 0, 0, 0], [0x5E, 0, 0, 0, 0, 0, 0, 0]] {
        pair.send(Frame::data_frame(0x7E5, &request)).unwrap();
    }
    pair.run(0.000_9);
    flood(&mut pair, stranger, Some(0x650));
    pair.run(0.21);
    let request = Frame::data_frame(0x602, &[0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
    pair.send(request).unwrap();
    while pair.of_id(0x602).is_empty() {
        pair.run(0.000_01);
        if pair.network.bus.on_wire(pair.host).is_some() {
            flood(&mut pair, stranger, Some(0x100));
        }
    }
    let low = [0x582, 0x702, 0x7E4];
    let before = low.map(|id| pair.of_id(id).len());
    pair.run(0.1);
    assert_eq!(low.map(|id| pair.of_id(id).len()), before);
    let told = pair.of_id(0x082).len();
    // A SYNC with a counter, which nobody has announced, is worth an EMCY.
    for count in 1..=3 {
        pair.send(Frame::data_frame(0x080, &[1])).unwrap();
        pair.run(0.005);
        assert_eq!(pair.of_id(0x082).len(), told + count);
    }
    flood(&mut pair, stranger, None);
    pair.run(0.05);
    // Nothing is lost and nothing comes twice; the other node has an LSS answer, too.
    let after = low.map(|id| pair.of_id(id).len());
    assert_eq!((after[0] - before[0], after[2] - before[2]), (1, 2));
    assert!(after[1] > before[1]);
}

#[test]
fn a_boot_up_message_that_bus_off_took_was_never_sent_again() {
    let mut pair = pair();
    pair.run(1.0);
    let port = pair.board(1).port();
    pair.network.bus.faults().spoil(port, true);
    pair.network.switch_guest(1, Switch::Reset);
    let before = pair.of_id(0x702).len();
    pair.run(4.0);
    assert_eq!(pair.of_id(0x702).len(), before);
    pair.network.bus.faults().spoil(port, false);
    pair.run(2.0);
    let said = pair.of_id(0x702);
    let said: Vec<_> = said[before..].iter().map(|h| h.frame.bytes()).collect();
    let boots = said.iter().filter(|bytes| **bytes == [0]).count();
    assert_eq!((said[0], boots), (&[0][..], 1));
}

/// Sends a node's code astray: to a loop, or to where no code is.
fn astray(pair: &mut Pair, number: usize, at: u32) {
    let cpu = pair.board(number).machine_mut().cpu_mut();
    // B to itself, where the flash is blank.
    cpu.write(LOOP, &[0xFE, 0xE7]).expect("in the flash");
    cpu.set_register(Register::Primask, 1);
    cpu.set_register(Register::Pc, at | 1);
    pair.board(number).machine_mut().wake();
}

/// The last word before the records: nothing is in slot B.
const LOOP: u32 = BASE + RC.records.start - 4;

#[test]
fn code_that_loops_is_ended_by_the_watchdog_and_the_other_node_measures_on() {
    let mut pair = pair();
    pair.run(1.0);
    astray(&mut pair, 0, LOOP);
    pair.run(3.0);
    let resets = [0, 1].map(|number| pair.board(number).machine().resets().to_vec());
    assert_eq!(
        resets,
        [vec![Cause::Power, Cause::Watchdog], vec![Cause::Power]]
    );
    let boots = |id| {
        pair.of_id(id)
            .iter()
            .filter(|h| h.frame.bytes() == [0])
            .count()
    };
    assert_eq!([boots(0x701), boots(0x702)], [2, 1]);
}

#[test]
fn a_hard_fault_resets_at_once_and_is_reported() {
    let mut pair = pair();
    pair.run(1.0);
    let before = pair.of_id(0x081).len();
    astray(&mut pair, 0, 0x6000_0000);
    pair.run(0.5);
    let machine = pair.board(0).machine();
    let (resets, faults) = (machine.resets().to_vec(), machine.faults().to_vec());
    assert_eq!(resets, [Cause::Power, Cause::Software]);
    assert_eq!(faults, [(0x6000_0000, Blame::Instruction)]);
    let told: Vec<_> = pair.of_id(0x081)[before..]
        .iter()
        .map(|h| h.frame)
        .collect();
    eprintln!("{told:?}");
    assert!(!told.is_empty());
}

#[test]
fn the_stack_never_comes_near_the_statics() {
    let mut pair = pair();
    pair.run(1.0);
    pair.send(Frame::data_frame(0, &[1, 0])).unwrap();
    pair.run_synced(100).unwrap();
    // In OPERATIONAL nothing is stored: it would have to wait for the flash.
    let refused = pair.write(1, (0x1010, 1), 4, SAVE);
    assert_eq!(refused, Err(SdoError::Abort(0x0800_0022)));
    pair.send(Frame::data_frame(0, &[0x80, 0])).unwrap();
    pair.run(0.01);
    pair.write(1, (0x1010, 1), 4, SAVE).expect("stored");
    pair.run(1.0);
    let symbol = |name| product().app.symbol(name).expect("the linker's");
    let (end, start) = (symbol("_stack_end"), symbol("_stack_start"));
    for number in [0, 1] {
        let unused = pair.board(number).machine().painted_from(end, PAINT);
        eprintln!(
            "stack: {} of {} bytes used",
            start - end - unused,
            start - end
        );
        assert!(unused > 1024);
    }
}

#[test]
fn the_image_answers_over_sdo() {
    let mut pair = pair();
    pair.run(0.5);
    for node in [1, 2] {
        assert_eq!(
            pair.read(node, 0x1000, 0).map(|kind| kind & 0xFFFF),
            Ok(410)
        );
        assert_eq!(pair.read(node, 0x1008, 0), Err(SdoError::Form(0x41)));
        assert_eq!(
            pair.read(node, 0x5FFF, 0),
            Err(SdoError::Abort(0x0602_0000))
        );
    }
}

/// How many operations of the flash a store of the parameters has.
fn store_operations(pair: &mut Pair) -> u64 {
    let before = cells(pair).operations();
    pair.write(1, (0x1017, 0), 2, FIRST).expect("a heartbeat");
    pair.write(1, (0x1010, 1), 4, SAVE).expect("stored");
    pair.run(0.5);
    cells(pair).operations() - before
}

fn cells(pair: &mut Pair) -> &mut Nor<Vec<Page>, Dice> {
    pair.board(0).machine_mut().chip_mut().flash.cells()
}

/// The heartbeat time that is stored before the first cut, ms.
const FIRST: u32 = 500;

/// Stores another heartbeat time for each of these operations, with a cut there.
fn cut_at(pair: &mut Pair, cuts: impl Iterator<Item = u64>) {
    let mut old = FIRST;
    for cut in cuts {
        let new = 600 + cut as u32;
        pair.write(1, (0x1017, 0), 2, new).expect("a heartbeat");
        cells(pair).cut_after(cut);
        // The answer may be lost with the supply.
        let _ = pair.write(1, (0x1010, 1), 4, SAVE);
        pair.run(0.5);
        pair.network.switch_guest(0, Switch::Off);
        pair.network.switch_guest(0, Switch::On);
        pair.run(0.4);
        let now = pair.read(1, 0x1017, 0).expect("it runs");
        assert!(
            [old, new].contains(&now),
            "cut {cut}: {now}, not {old} or {new}"
        );
        old = now;
    }
    assert_eq!(cells(pair).broken_rules(), 0);
}

fn lone_node() -> Pair {
    let mut pair = Pair::of(1, 2, &product().pieces()).expect("the image is for the flash");
    pair.run(0.4);
    pair
}

#[test]
fn a_cut_in_a_store_of_the_image_leaves_the_old_or_the_new() {
    let mut pair = lone_node();
    let store = store_operations(&mut pair);
    eprintln!("a store: {store} operations of the flash");
    // The first and the last, where the state changes, and some between.
    let last = store.saturating_sub(6);
    let between = (4..last).step_by(store as usize / 6 + 1);
    cut_at(&mut pair, (0..4).chain(between).chain(last..store));
}

#[test]
#[ignore = "takes minutes; run it when the stores change"]
fn a_cut_at_every_operation_of_a_store_of_the_image_leaves_the_old_or_the_new() {
    let mut pair = lone_node();
    let store = store_operations(&mut pair);
    cut_at(&mut pair, 0..store);
}

#[test]
fn r9_a_flipped_bit_of_the_running_program_is_reported() {
    let mut pair = pair();
    pair.run(1.0);
    let told = |pair: &Pair| {
        let codes = pair.of_id(0x081).into_iter().map(|heard| heard.frame);
        codes
            .filter(|frame| frame.bytes()[..2] == [0x10, 0x61])
            .count()
    };
    assert_eq!(told(&pair), 0);
    // The last byte of the program: data that nothing uses while all is well.
    let end = product().factory.len() as u32 - 1;
    pair.board(0).machine_mut().chip_mut().flash.flip(end, 1);
    for _ in 0..30 {
        pair.run(1.0);
        if told(&pair) > 0 {
            return;
        }
    }
    panic!("a damaged program was not told of within 30 s");
}

#[test]
fn a_request_was_lost_behind_other_frames_while_a_page_was_erased() {
    let mut pair = pair();
    pair.run(1.0);
    for control in [0, 3] {
        pair.write(1, (0x1F51, 1), 1, control).expect("a clear");
    }
    // Within an erase of 20 ms: more than a FIFO of the controller holds, then the request.
    for round in 0..4 {
        let answered = pair.of_id(0x581).len();
        for id in 0x123..0x129 {
            pair.send(Frame::data_frame(id, &[0; 8])).expect("room");
            pair.run(0.0006);
        }
        let request = [0x40, 0, 0x10, 0, 0, 0, 0, 0];
        pair.send(Frame::data_frame(0x601, &request)).expect("room");
        pair.run(0.45);
        assert_eq!(pair.of_id(0x581).len(), answered + 1, "round {round}");
    }
}

/// Puts the housing there and waits until it stands and the filters have settled.
fn put(pair: &mut Pair, pose: Pose) {
    assert!(pair.hand.go(pose));
    // The longest way is 97 deg at 20 deg/s, and the filters settle.
    pair.run(5.5);
}

/// Slopes of both nodes that are off by more than 1.96 of their uncertainties (2022h), with error
/// and uncertainty in deg, over some poses; nothing of an uncertainty of 0 counts as within.
fn outside(pair: &mut Pair) -> Vec<(u8, Pose, f64, f64)> {
    let mut outside = Vec::new();
    for (roll_deg, pitch_deg) in [
        (0.0, 0.0),
        (-33.0, 0.0),
        (50.0, 0.0),
        (0.0, 12.0),
        (0.0, -47.0),
    ] {
        let pose = Pose {
            pitch_deg,
            roll_deg,
        };
        put(pair, pose);
        for node in [1, 2] {
            for (index, sub, truth) in [(0x6010, 1, roll_deg), (0x6020, 2, pitch_deg)] {
                let slope = pair.read(node, index, 0).expect("a slope") as u16 as i16;
                let error = f64::from(slope) / 100.0 - truth;
                let told = pair.read(node, 0x2022, sub).expect("an uncertainty");
                let u = f64::from(told as u16) / 1000.0;
                if u == 0.0 || error.abs() > 1.96 * u {
                    outside.push((node, pose, error, u));
                }
            }
        }
    }
    outside
}

#[test]
fn without_a_calibration_the_image_stated_an_uncertainty_of_0() {
    let mut pair = pair();
    // 40 slopes, of which one in twenty may be outside.
    let uncalibrated = [outside(&mut pair), outside(&mut pair)].concat();
    assert!(uncalibrated.len() <= 2, "{uncalibrated:?}");
}
