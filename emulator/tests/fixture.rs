//! An image that was written against another HAL runs on the emulated board.
//!
//! Where the product's drivers and the emulator's registers share a wrong reading of the manual,
//! this image does not: it is embassy's, from clock set-up to bus-off.

use std::sync::OnceLock;

use canopen::Frame;
use emulator::board::{Board, Parts};
use emulator::build::FIXTURE;
use emulator::chip::nvic::HARD_FAULT;
use emulator::chip::rcc::Cause;
use emulator::chip::system::Blame;
use emulator::image::Image;
use emulator::stopwatch::Stopwatch;
use flash::layout::{PAGE, RC};
use sim::can_bus::{Event, Port};
use sim::electronics::Electronics;
use sim::error_model::ErrorModel;
use sim::network::Network;
use sim::network::guest::Switch;
use sim::network::hand::Hand;
use sim::rng::Rng;

const SECOND_NS: u64 = 1_000_000_000;

fn image() -> &'static Image {
    static IMAGE: OnceLock<Image> = OnceLock::new();
    IMAGE.get_or_init(|| FIXTURE.image().expect("the fixture builds"))
}

/// Two boards with the fixture, channel A and B, and a host.
struct Pair {
    network: Network,
    host: Port,
    hand: Hand,
    frames: Vec<(u64, Frame)>,
}

impl Pair {
    fn new(boards: u32) -> Self {
        let mut network = Network::new(250_000, 1);
        let host = network.attach_host();
        for number in 0..boards {
            let rng = Rng::stream(1, &format!("board {number}"));
            let parts = Parts {
                layout: RC,
                electronics: Electronics::new(&ErrorModel::NOMINAL, rng),
                identity: [number, 0x1234, 0x5678],
                lsi_hz: 40_000,
                seed: 7,
                strapped: number == 1,
            };
            let mut board: Board = Board::new(parts, &mut network.bus);
            board.flash(image()).expect("the image is for the flash");
            let number = network.add_guest(Box::new(board));
            network.switch_guest(number, Switch::On);
        }
        let hand = Hand::new(Rng::stream(1, "hand"));
        Self {
            network,
            host,
            hand,
            frames: Vec::new(),
        }
    }

    fn run(&mut self, seconds: f64) {
        let until_ns = self.network.now_ns() + (seconds * SECOND_NS as f64) as u64;
        let Self {
            network,
            hand,
            frames,
            ..
        } = self;
        network.run_until(hand, until_ns, |event| {
            if let Event::Delivered { frame, at_ns, .. } = event {
                frames.push((*at_ns, *frame));
            }
        });
    }

    fn command(&mut self, command: u8) {
        let frame = Frame::data_frame(0x07E, &[command]);
        self.network
            .bus
            .offer(self.host, frame)
            .expect("a free mailbox");
    }

    fn of(&self, id: u16) -> Vec<Frame> {
        let frames = self.frames.iter().map(|(_, frame)| *frame);
        frames.filter(|frame| frame.cob_id() == Some(id)).collect()
    }

    fn board(&mut self, number: usize) -> &mut Board {
        self.network.guest_as(number).expect("a board")
    }
}

#[test]
fn the_sensor_gives_its_identity_and_a_frame_goes_out_for_each_sample() {
    let mut pair = Pair::new(1);
    pair.run(1.1);

    assert_eq!(
        pair.of(0x701).first().map(|f| f.bytes().to_vec()),
        Some(vec![0x44])
    );
    let samples = pair.of(0x181).len();
    assert!(
        (380..440).contains(&samples),
        "{samples} in a second at 400 Hz"
    );
    assert_eq!(pair.board(0).machine().resets(), [Cause::Power]);
}

#[test]
fn two_boards_with_one_image_hear_each_other() {
    let mut pair = Pair::new(2);
    pair.run(0.5);
    assert_eq!([pair.of(0x701).len(), pair.of(0x702).len()], [1, 1]);
    pair.command(4);
    pair.run(0.1);
    let heard = |pair: &Pair, id| pair.of(id).last().map(|frame| frame.bytes().to_vec());
    for id in [0x581, 0x582] {
        let answer = heard(&pair, id).expect("an answer");
        // One start and the samples of the other, as many as were asked for between its own.
        assert_eq!(answer[0], 4);
        assert!(answer[1] > 100, "{answer:?}");
    }
}

#[test]
fn a_page_is_erased_and_programmed() {
    let mut pair = Pair::new(1);
    pair.run(0.2);
    pair.command(1);
    pair.run(0.1);
    // The core has stood still for longer than the sensor's data-ready stays away, so an edge is
    // missed as well and told of.
    let exercised = |f: &Frame| f.bytes() == [1, 16];
    assert!(pair.of(0x581).iter().any(exercised));
    let cells = pair.board(0).machine_mut().chip_mut().flash.cells();
    assert_eq!(cells.broken_rules(), 0);
    let page = &cells.pages()[(RC.records.start / PAGE) as usize];
    assert_eq!(page.bytes()[..4], [0, 17, 34, 51]);
    // Once by the programmer's hand would be 0: this page is beyond the image.
    assert_eq!(page.erases(), 1);
}

#[test]
fn unfed_the_watchdog_starts_the_image_anew() {
    let mut pair = Pair::new(1);
    pair.run(0.2);
    pair.command(2);
    pair.run(1.0);
    let board = pair.board(0);
    assert_eq!(
        board.machine().resets()[..2],
        [Cause::Power, Cause::Watchdog]
    );
    // The flags of the power's reset are still there: nobody has removed them.
    assert_eq!(board.machine().chip().reset_flags() >> 26, 0b1011);
    assert!(pair.of(0x701).len() >= 2);
}

#[test]
fn a_load_where_nothing_is_ends_in_a_hard_fault_with_its_address() {
    let mut pair = Pair::new(1);
    pair.run(0.2);
    pair.command(3);
    pair.run(0.1);
    let machine = pair.board(0).machine();
    let blames: Vec<_> = machine.faults().iter().map(|(_, blame)| *blame).collect();
    assert_eq!(blames, [Blame::Data(0x6000_0000)]);
    assert!(machine.chip().nvic.is_active(HARD_FAULT));
    pair.run(0.6);
    assert_eq!(
        pair.board(0).machine().resets().last(),
        Some(&Cause::Watchdog)
    );
}

#[test]
fn the_image_can_ask_for_a_reset() {
    let mut pair = Pair::new(1);
    pair.run(0.2);
    pair.command(5);
    pair.run(0.2);
    assert_eq!(
        pair.board(0).machine().resets(),
        [Cause::Power, Cause::Software]
    );
    assert_eq!(pair.of(0x701).len(), 2);
}

#[test]
fn a_cut_in_the_erase_leaves_a_part_that_starts_again() {
    let mut pair = Pair::new(1);
    pair.run(0.2);
    pair.board(0)
        .machine_mut()
        .chip_mut()
        .flash
        .cells()
        .cut_after(0);
    pair.command(1);
    pair.run(0.2);
    assert!(pair.board(0).is_cut());
    pair.network.switch_guest(0, Switch::On);
    pair.run(0.2);
    assert_eq!(pair.of(0x701).len(), 2);
    pair.command(1);
    pair.run(0.2);
    // The core has stood still for longer than the sensor's data-ready stays away, so an edge is
    // missed as well and told of.
    let exercised = |f: &Frame| f.bytes() == [1, 16];
    assert!(pair.of(0x581).iter().any(exercised));
}

#[test]
fn two_runs_are_the_same_bit_for_bit() {
    let run = || {
        let mut pair = Pair::new(2);
        pair.run(1.0);
        let counted = [0, 1].map(|number| pair.board(number).machine().chip().instructions());
        (pair.network.bus.fingerprint(), counted)
    };
    assert_eq!(run(), run());
}

#[test]
fn two_boards_run_much_faster_than_time() {
    let mut pair = Pair::new(2);
    pair.run(0.5);
    let watch = Stopwatch::start();
    pair.run(10.0);
    let times = 10.0 / watch.seconds();
    eprintln!("two emulated boards: {times:.0} times real time");
    // Beside everything else that a test run does a core is half as fast as alone.
    assert!(times > 5.0);
}

#[test]
fn a_node_whose_frames_nobody_acknowledges_goes_passive_and_comes_back() {
    let mut pair = Pair::new(1);
    let host = pair.host;
    pair.run(0.2);
    pair.network.bus.connect(host, false);
    pair.run(0.1);
    let status = pair.board(0).machine_mut().chip_mut().read(0x4000_6418, 4);
    // Error passive, last code: nobody has acknowledged (RM0008 24.9.2).
    assert_eq!(status & 0x77, 0x33, "{status:#x}");
    pair.network.bus.connect(host, true);
    let before = pair.of(0x181).len();
    pair.run(0.1);
    assert!(pair.of(0x181).len() > before + 30);
}
