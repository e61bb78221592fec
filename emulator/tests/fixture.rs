//! An image that was written against another HAL runs on the emulated board.
//!
//! Where the product's drivers and the emulator's registers share a wrong reading of the manual,
//! this image does not: it is embassy's, from clock set-up to bus-off.

use std::sync::OnceLock;

use canopen::Frame;
use emulator::board::{Board, Parts};
use emulator::build::FIXTURE;
use emulator::chip::rcc::Cause;
use emulator::image::Image;
use flash::layout::CB;
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
                layout: CB,
                electronics: Electronics::new(&ErrorModel::NOMINAL, rng),
                identity: [number, 0x1234, 0x5678],
                lsi_hz: 40_000,
                seed: 7,
                strapped: number == 1,
            };
            let mut board = Board::new(parts, &mut network.bus);
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
fn the_sensor_says_who_it_is_and_a_frame_goes_out_for_each_sample() {
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
