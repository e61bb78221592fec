//! The chip's image and the host's build of the same code come to the same frames, bit for bit.
//!
//! Two emulated nodes run on a bus, calibrated, on a board that tilts, in changing warmth, with a
//! fault; then parameters are stored, and to the product a new program comes and is found to be
//! signed with a key that they do not have. All that the code of each sees is written down: the
//! sensor's bytes, the time of each edge, what the CAN controller had to tell, and each look at the
//! clock.
//! The host's build then gets the same, and has to do the same at each step: send the same bytes to
//! the sensor and put the same frames into the same mailboxes, in the same order.

mod composition;
mod log;
mod node;

use std::collections::BTreeSet;

use canopen::Frame;
use device::objects::table::Channel;
use emulator::chip::tap::{Deed, Entry};
use emulator::pair::{Heard, Pair};
use flash::check_sum::Crc32;
use flash::image::Version;
use flash::layout::Slot;
use instant::Instant;
use sim::error_model::ErrorModel;
use sim::error_model::gyroscope::GyroscopeModel;
use sim::memory;
use sim::network::guest::Switch;
use sim::network::hand::Pose;

use composition::Composition;
use log::Log;
use node::{Cells, follow};

/// "save", as 1010h wants it (CiA 301 7.5.2.13).
const SAVE: u32 = 0x6576_6173;

/// What a run was.
struct Run {
    entries: [Vec<Entry>; 2],
    cells: [Cells; 2],
    serials: [u32; 2],
    heard: Vec<Heard>,
}

impl Run {
    /// The frames of an identifier, each once.
    fn different(&self, id: u16) -> BTreeSet<[u8; 8]> {
        let of_id = self.heard.iter().map(|heard| heard.frame);
        let of_id = of_id.filter(|frame| frame.cob_id() == Some(id));
        of_id.map(|frame| frame.padded()).collect()
    }

    /// The host's build after the chip of channel A (0) or B (1).
    fn follow<C: Composition>(&self, number: usize) -> Log {
        let channel = [Channel::A, Channel::B][number];
        let (entries, cells) = (self.entries[number].clone(), self.cells[number].clone());
        follow::<C>(entries, cells, channel, self.serials[number])
    }
}

/// Parts with the noise of the real ones, each with its own clock, but without errors.
const PARTS: ErrorModel = ErrorModel {
    white_noise: ErrorModel::NOMINAL.white_noise,
    flicker_ug: ErrorModel::NOMINAL.flicker_ug,
    clock_ratio: ErrorModel::NOMINAL.clock_ratio,
    thermometer_noise_c: ErrorModel::NOMINAL.thermometer_noise_c,
    gyroscope: GyroscopeModel {
        noise_density_dps: GyroscopeModel::NOMINAL.noise_density_dps,
        flicker_dps: GyroscopeModel::NOMINAL.flicker_dps,
        ..GyroscopeModel::PERFECT
    },
    quantisation: true,
    ..ErrorModel::PERFECT
};

/// Two nodes with power off, which have been on once and have their calibration since.
fn calibrated<C: Composition>(seed: u64) -> (Pair, [Cells; 2]) {
    let pieces = C::pieces();
    let pair = Pair::with(&PARTS, 2, seed, C::outfit(&pieces));
    let mut pair = pair.expect("the images are for the flash");
    pair.run(1.5);
    let cells = [0, 1].map(|number| {
        pair.network.switch_guest(number, Switch::Off);
        let held = pair.board(number).machine_mut().chip_mut().flash.cells();
        *held = C::calibrated(held.clone());
        held.clone()
    });
    (pair, cells)
}

/// A node gets a program that it has to refuse, and is asked for it until it has.
fn refused(pair: &mut Pair, node: u8) {
    let body = [0x5A; 4096];
    let mut image = memory::image(Slot::B, Version::new(99, 0, 0), &body);
    memory::sign(&mut image, b"nobody whom the node would know.");
    let wait = |pair: &mut Pair| {
        let busy = (0..200).find_map(|_| {
            pair.run(0.037);
            let status = pair.read(node, 0x1F57, 1).expect("the node answers");
            (status & 1 == 0).then_some(status)
        });
        busy.expect("it comes to an end")
    };
    for command in [0, 3] {
        let done = pair.write(node, (0x1F51, 1), 1, command);
        done.expect("a clear");
    }
    assert_eq!(wait(pair), 1 << 1);
    let sent = pair.download(node, (0x1F50, 1), &image);
    sent.expect("a whole image");
    let started = pair.write(node, (0x1F51, 1), 1, 1);
    started.expect("a check");
    assert_eq!(wait(pair), 7 << 1 | 5 << 16);
}

/// So many seconds of it, in the middle of which a sensor loses its supply for a moment.
fn run<C: Composition>(seconds: u32) -> Run {
    let seed = 3;
    let (mut pair, cells) = calibrated::<C>(seed);
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
            electronics.set_die_temperature(25.0 + 0.1 * f64::from(second));
            if second == seconds / 2 && number == 1 {
                electronics.power_cycle();
            }
        }
        pair.run_synced(100).expect("the bus takes a SYNC");
        let errors = pair.read(1 + second as u8 % 2, 0x1001, 0);
        errors.expect("the node answers");
    }
    // A store stops the chip for the erases of pages: what was due meanwhile is done late.
    pair.send(Frame::data_frame(0, &[0x80, 0])).expect("room");
    pair.run(0.01);
    for node in [1, 2] {
        let stored = pair.write(node, (0x1010, 1), 4, SAVE);
        stored.expect("the node stores");
    }
    pair.run(1.0);
    C::end(&mut pair);
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
        heard: pair.heard,
    }
}

/// Edges that are not some periods of the part behind the one before them, or more than an erase.
fn misdated(edges: &[Instant]) -> Vec<[Instant; 2]> {
    let gap = |two: &[Instant]| two[1].0.wrapping_sub(two[0].0) as f64;
    let mut gaps: Vec<_> = edges.windows(2).map(gap).collect();
    gaps.sort_by(f64::total_cmp);
    let period = gaps[gaps.len() / 2];
    let is_whole = |two: &&[Instant]| {
        let periods = gap(two) / period;
        periods > 0.5 && periods < 30.0 && (periods - periods.round()).abs() < 0.05
    };
    // Before the first second the part is being set up.
    let steady = edges.windows(2).skip(400);
    let off = steady.filter(|two| !is_whole(two));
    off.map(|two| [two[0], two[1]]).collect()
}

#[test]
fn the_chip_and_the_host_send_the_same_frames_bit_for_bit() {
    alike::<composition::Product>();
}

#[test]
fn the_paper_s_chip_and_the_host_send_the_same_frames_bit_for_bit() {
    alike::<composition::Paper>();
}

#[test]
fn the_chip_with_a_gyroscope_and_the_host_send_the_same_frames_bit_for_bit() {
    alike::<composition::Dynamic>();
}

fn alike<C: Composition>() {
    let mut run = run::<C>(30);
    // Angles that were compared, of a board that tilts; and the fault of node 2's sensor.
    let angles = run.different(0x181).len();
    assert!(angles > C::ANGLES, "{angles}");
    let supply = |frame: &[u8; 8]| frame.starts_with(&C::FAULT.to_le_bytes());
    let told = run.different(0x82);
    assert!(told.iter().any(supply), "{told:02X?}");
    for number in [0, 1] {
        let log = run.follow::<C>(number);
        assert_eq!(log.difference(), None, "node {number}");
        assert_eq!(log.back(), None, "node {number}");
        let misdated = misdated(log.edges());
        assert!(misdated.is_empty(), "node {number}: {misdated:?}");
        assert!(log.reached().0 > 31_000_000, "{:?}", log.reached());
        eprintln!("node {number}: {} frames, each bit the same", log.frames());
        assert!(log.frames() > 3 * 2_900, "{}", log.frames());
    }
    // One bit of one sample in the middle is another one: the frames after it are not the same.
    let entries = &mut run.entries[0];
    let middle = entries.len() / 2;
    let (command, high_of_x) = C::SAMPLE;
    // A shorter burst may begin like it.
    let is_sample = |burst: &[Entry]| {
        let bytes = |entry: &Entry| matches!(entry.deed, Deed::Byte(0, _));
        burst[0].deed == Deed::Byte(command, 0) && burst[1..].iter().all(bytes)
    };
    let place = entries[middle..].windows(1 + high_of_x).position(is_sample);
    let entry = &mut entries[middle + place.expect("there are samples") + high_of_x];
    let Deed::Byte(0, answer) = &mut entry.deed else {
        panic!("{entry:?} is no byte of a sample");
    };
    *answer ^= 1;
    assert!(run.follow::<C>(0).difference().is_some());
}
