//! An update with an image of the product's own length: heartbeats and samples go on meanwhile.
//!
//! In: two calibrated nodes, of which the one that stays makes SYNC, and the product's body as a
//! new program of the other. Out: how long the heartbeats and the samples of the updated node were
//! ever away, and that neither node made a fault of it.

use std::collections::BTreeSet;

use canopen::Frame;
use emulator::chip::tap::{Deed, Entry, TIM2};
use emulator::pair::Pair;
use sim::bench::{Mode, World};
use sim::memory;
use sim::network::instrument::Delivered;

use crate::bench::product;
use crate::update::{NEW, body, file};

/// TIM2's count (RM0008 15.4.10).
const CNT: u32 = TIM2 + 0x24;
/// How the burst begins that reads a sample: from OUT_T on (DS11811 table 17), read.
const SAMPLE: u8 = 0x80 | 0x26;
/// The longest erase, s.
const ERASE_S: f64 = 0.040;
/// A block of 127 segments, s, without a gap between them and with the PDOs of its time: all of
/// these go before a heartbeat, whose identifier is higher.
const BLOCK_S: f64 = 0.075;
/// A heartbeat is due every 0.2 s as delivered.
const HEARTBEAT_S: f64 = 0.2;
/// How long a clear may take, s.
const CLEAR_S: usize = 10;

/// Two nodes that work, SYNC of node 2 every 20 ms, node 1 set to PRE-OPERATIONAL.
fn prepared() -> Pair {
    let delivered = Delivered::calibrated(Mode::Product, &World::NOMINAL, 1, 0);
    let delivered = delivered.expect("the bench calibrates them");
    let pair = Pair::delivered(&delivered, 1, &product().pieces());
    let mut pair = pair.expect("the image is for the flash");
    pair.run(2.0);
    for (at, value) in [((0x1006, 0), 20_000), ((0x1005, 0), 0x4000_0080)] {
        let made = pair.write(2, at, 4, value);
        made.expect("node 2 makes SYNC");
    }
    pair.send(Frame::data_frame(0, &[1, 0])).expect("room");
    pair.run(2.0);
    pair.send(Frame::data_frame(0, &[0x80, 1])).expect("room");
    pair.run(1.0);
    pair
}

/// What a part of the update was like.
#[derive(Debug)]
struct Part {
    /// The longest time between two heartbeats of node 1, s.
    heartbeat_s: f64,
    /// The longest time between two of its samples, s.
    sample_s: f64,
    /// Samples that its sensor had.
    made: u64,
    /// Samples that it has read.
    read: u64,
    /// EMCY codes of both nodes.
    told: BTreeSet<(u16, u16)>,
}

/// Times at which a sample was read, s, by the clock as the code has read it.
fn samples(entries: &[Entry]) -> Vec<f64> {
    let (mut us, mut before, mut read) = (0_u64, None, Vec::new());
    for entry in entries {
        match entry.deed {
            Deed::Load(CNT, count) => {
                let last = before.replace(count).unwrap_or(count);
                us += u64::from((count as u16).wrapping_sub(last as u16));
            }
            Deed::Byte(SAMPLE, _) => read.push(us as f64 * 1e-6),
            _ => {}
        }
    }
    read
}

/// The longest of the times between neighbours.
fn longest(times: &[f64]) -> f64 {
    let gaps = times.windows(2).map(|two| two[1] - two[0]);
    gaps.fold(0.0, f64::max)
}

/// Does something and looks at what went on meanwhile.
fn part(pair: &mut Pair, name: &str, act: impl FnOnce(&mut Pair)) -> Part {
    let heard = pair.heard.len();
    let made = pair.board(0).samples();
    pair.board(0).machine_mut().chip_mut().tap().start();
    let begin = pair.network.now_ns();
    act(pair);
    let end = pair.network.now_ns();
    let entries = pair.board(0).machine_mut().chip_mut().tap().take();
    let made = pair.board(0).samples() - made;
    let read = samples(&entries);
    let heard = &pair.heard[heard..];
    let mut beats = vec![begin as f64 * 1e-9];
    let of = |id| heard.iter().filter(move |h| h.frame.cob_id() == Some(id));
    beats.extend(of(0x701).map(|heard| heard.at_ns as f64 * 1e-9));
    beats.push(end as f64 * 1e-9);
    let codes = [0x081, 0x082].into_iter().flat_map(|id| {
        of(id).map(move |heard| {
            let [low, high, ..] = heard.frame.padded();
            (id, u16::from_le_bytes([low, high]))
        })
    });
    let part = Part {
        heartbeat_s: longest(&beats),
        sample_s: longest(&read),
        made,
        read: read.len() as u64,
        told: codes.collect(),
    };
    eprintln!("{name}: {:.2} s, {part:X?}", (end - begin) as f64 * 1e-9);
    part
}

fn order(pair: &mut Pair, command: u32) {
    let done = pair.write(1, (0x1F51, 1), 1, command);
    done.unwrap_or_else(|error| panic!("command {command}: {error:?}"));
}

/// Waits until bit 0 of 1F57h is gone; what it reads then.
fn wait(pair: &mut Pair, seconds: usize) -> u32 {
    for _ in 0..20 * seconds {
        pair.run(0.05);
        match pair.read(1, 0x1F57, 1) {
            Ok(1) => {}
            Ok(status) => return status,
            Err(error) => panic!("a poll was not answered: {error:?}"),
        }
    }
    panic!("busy for {seconds} s");
}

/// Heartbeats come as they do without an update, but for what may `hold` one up, s.
fn beats_on(part: &Part, hold: f64) {
    assert!(part.heartbeat_s < HEARTBEAT_S + hold + 0.01, "{part:X?}");
}

/// Every sample is read, each within a period of the part, and nobody is blamed.
fn measures_on(part: &Part, hold: f64) {
    beats_on(part, hold);
    assert_eq!(part.told, BTreeSet::new());
    assert!(part.sample_s < 0.003, "{part:X?}");
    assert!(part.read.abs_diff(part.made) <= 1, "{part:X?}");
}

#[test]
fn a_whole_image_kept_heartbeats_and_samples_waiting_for_its_signature() {
    let mut pair = prepared();
    let image = file(&body());
    let mut forged = image.clone();
    memory::sign(&mut forged, b"nobody whom the node would know.");
    for (name, image, outcome) in [("forged", &forged, 7 << 1 | 5 << 16), ("signed", &image, 1)] {
        let cleared = part(&mut pair, "clear", |pair| {
            order(pair, 0);
            order(pair, 3);
            assert_eq!(wait(pair, CLEAR_S), 1 << 1);
            pair.run(0.5);
        });
        beats_on(&cleared, ERASE_S);
        assert!(cleared.sample_s < ERASE_S + 0.005, "{cleared:X?}");
        // In an erase more frames come than the controller holds.
        let told = cleared.told.iter().all(|told| *told == (0x081, 0x8110));
        assert!(told, "{cleared:X?}");
        let sent = part(&mut pair, "download", |pair| {
            pair.download(1, (0x1F50, 1), image).expect("a whole image");
        });
        measures_on(&sent, BLOCK_S);
        let checked = part(&mut pair, name, |pair| {
            order(pair, 1);
            if outcome != 1 {
                assert_eq!(wait(pair, 3), outcome);
                return;
            }
            // Up to the last moment of the check, a step before the reset.
            for _ in 0..18 {
                pair.run(0.05);
                assert_eq!(pair.read(1, 0x1F57, 1), Ok(1));
            }
        });
        measures_on(&checked, ERASE_S);
    }
    let boots = |pair: &Pair| {
        let boots = pair.of_id(0x701).into_iter();
        boots.filter(|heard| heard.frame.bytes() == [0]).count()
    };
    let before = boots(&pair);
    for _ in 0..100 {
        pair.run(0.01);
        if boots(&pair) > before {
            break;
        }
    }
    pair.run(2.0);
    assert_eq!(boots(&pair), before + 1);
    assert_eq!(pair.read(1, 0x2080, 2), Ok(NEW.0));
    assert_eq!(pair.read(1, 0x2080, 4), Ok(0));
}
