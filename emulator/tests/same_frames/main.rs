//! The chip's image and the host's build of the same code come to the same frames, bit for bit.
//!
//! Two emulated nodes run on a bus, calibrated, on a board that tilts, in changing warmth, with a
//! fault. All that the code of each sees is written down: the sensor's bytes, the time of each
//! edge, what the CAN controller had to tell, and each look at the clock. The host's build then
//! gets the same, and has to do the same at each step: ask the sensor for the same bytes and put the
//! same frames into the same mailboxes, in the same order.

mod log;
mod node;

use canopen::Frame;
use device::calibration::deliver;
use device::objects::table::Channel;
use emulator::build::Product;
use emulator::chip::tap::{Deed, Entry};
use emulator::pair::Pair;
use emulator_golden::calibration;
use flash::check_sum::Crc32;
use sim::network::guest::Switch;
use sim::network::hand::Pose;

use log::Log;
use node::{Cells, follow, memory};

/// What a run was.
struct Run {
    entries: [Vec<Entry>; 2],
    cells: [Cells; 2],
    serials: [u32; 2],
}

impl Run {
    /// The host's build after the chip of channel A (0) or B (1).
    fn follow(&self, number: usize) -> Log {
        let channel = [Channel::A, Channel::B][number];
        let (entries, cells) = (self.entries[number].clone(), self.cells[number].clone());
        follow(entries, cells, channel, self.serials[number])
    }
}

/// Two nodes with power off, which have been on once and have their calibration since.
fn calibrated(seed: u64) -> (Pair, [Cells; 2]) {
    let product = Product::build().expect("the images build");
    let mut pair = Pair::new(seed, &product.pieces()).expect("the images are for the flash");
    pair.run(1.5);
    let cells = [0, 1].map(|number| {
        pair.network.switch_guest(number, Switch::Off);
        let held = pair.board(number).machine_mut().chip_mut().flash.cells();
        let mut memory = memory(held.clone());
        deliver(&mut memory, &calibration()).expect("there is room in the records");
        *held = memory.flash().clone();
        held.clone()
    });
    (pair, cells)
}

/// So many seconds of it, and one of them with a sensor that has lost its supply.
fn run(seconds: u32) -> Run {
    let seed = 3;
    let (mut pair, cells) = calibrated(seed);
    for number in [0, 1] {
        pair.board(number).machine_mut().chip_mut().tap().start();
        pair.network.switch_guest(number, Switch::On);
    }
    pair.run(1.0);
    pair.send(Frame::data_frame(0, &[1, 0])).expect("room");
    for second in 0..seconds {
        let sign = if second % 2 == 0 { 1.0 } else { -1.0 };
        pair.hand.go(Pose {
            pitch_deg: sign * f64::from(second % 7) * 5.0,
            roll_deg: f64::from(second % 11) * 4.0 - 20.0,
        });
        for number in [0, 1] {
            let electronics = pair.network.electronics(number);
            electronics.set_die_temperature(20.0 + 0.5 * f64::from(second));
            if second == seconds / 2 && number == 1 {
                electronics.power_cycle();
            }
        }
        pair.run_synced(100).expect("the bus takes a SYNC");
        let temperature = pair.read(1 + second as u8 % 2, 0x1001, 0);
        temperature.expect("the node answers");
    }
    let mut entries = [0, 1].map(|n| pair.board(n).machine_mut().chip_mut().tap().take());
    entries
        .iter_mut()
        .for_each(|entries| entries.shrink_to_fit());
    let serials = [0u32, 1].map(|number| {
        let identity = [seed as u32, (seed >> 32) as u32, number];
        Crc32::of(&identity.map(u32::to_le_bytes).concat())
    });
    Run {
        entries,
        cells,
        serials,
    }
}

#[test]
fn the_chip_and_the_host_send_the_same_frames_bit_for_bit() {
    let mut run = run(std::env::var("SECS").map_or(30, |s| s.parse().unwrap()));
    for number in [0, 1] {
        let log = run.follow(number);
        assert_eq!(log.difference(), None, "node {number}");
        assert!(log.reached().0 > 31_000_000, "{:?}", log.reached());
        assert!(log.frames() > 3 * 2_900, "{}", log.frames());
    }
    // One bit of one sample in the middle is another one: the frames after it are not the same.
    let entries = &mut run.entries[0];
    let middle = entries.len() / 2;
    let of_sample = |entry: &Entry| matches!(entry.deed, Deed::Byte(0, _));
    let place = entries[middle..].iter().position(of_sample);
    let entry = &mut entries[middle + place.expect("there are samples")];
    if let Deed::Byte(_, answer) = &mut entry.deed {
        *answer ^= 0x10;
    }
    assert!(run.follow(0).difference().is_some());
}
