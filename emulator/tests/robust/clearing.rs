//! Erasing a slot while the bus works: the processor stands still for each page.
//!
//! In: two nodes, SYNC every 20 ms, one of them cleared for a new program. Out: no fault that is
//! none, and answers.

use canopen::Frame;
use emulator::pair::Pair;
use sim::bench::{Mode, World};
use sim::network::instrument::Delivered;

use crate::bench::product;

/// Error codes of a sensor that gives no samples and of a store that failed.
const FALSE_ALARMS: [u16; 2] = [0xFF02, 0xFF22];

/// SYNCs after which a request that was not answered is repeated: half a second.
const ASKED_AGAIN: usize = 25;

/// Goes on for so many SYNCs of 20 ms.
fn sync(pair: &mut Pair, syncs: usize) {
    for _ in 0..syncs {
        pair.send(Frame::data_frame(0x080, &[])).expect("room");
        pair.run(0.02);
    }
}

/// Asks node 1 for 1F57h sub 1, with SYNC on; the answer and how often it was asked.
fn status(pair: &mut Pair) -> (u32, usize) {
    for asked in 1..=4 {
        let before = pair.of_id(0x581).len();
        let poll = [0x40, 0x57, 0x1F, 1, 0, 0, 0, 0];
        pair.send(Frame::data_frame(0x601, &poll)).expect("room");
        for _ in 0..ASKED_AGAIN {
            sync(pair, 1);
            if let Some(heard) = pair.of_id(0x581).get(before) {
                let [0x43, _, _, _, status @ ..] = heard.frame.padded() else {
                    panic!("{heard:?}");
                };
                return (u32::from_le_bytes(status), asked);
            }
        }
    }
    panic!("not answered");
}

/// Two nodes as they come from the bench that measure in OPERATIONAL with SYNC.
fn working() -> Pair {
    let delivered = Delivered::calibrated(Mode::Product, &World::NOMINAL, 1, 0);
    let delivered = delivered.expect("the bench calibrates them");
    let pair = Pair::delivered(&delivered, 1, &product().pieces());
    let mut pair = pair.expect("the image is for the flash");
    pair.run(2.0);
    pair.send(Frame::data_frame(0, &[1, 0])).expect("room");
    sync(&mut pair, 50);
    pair
}

/// Node 1 is set to PRE-OPERATIONAL and told to clear its other slot.
fn begin(pair: &mut Pair) {
    pair.send(Frame::data_frame(0, &[0x80, 1])).expect("room");
    sync(pair, 5);
    for command in [0, 3] {
        let done = pair.write(1, (0x1F51, 1), 1, command);
        assert_eq!(done, Ok(()), "command {command}");
    }
}

#[test]
fn each_page_that_was_erased_made_an_emergency_of_a_silent_sensor() {
    let mut pair = working();
    begin(&mut pair);
    let mut asked = Vec::new();
    loop {
        let (status, times) = status(&mut pair);
        asked.push(times);
        if status != 1 {
            assert_eq!(status, 2);
            break;
        }
    }
    sync(&mut pair, 50);
    eprintln!("{asked:?}");
    let told: Vec<_> = pair
        .of_id(0x081)
        .iter()
        .map(|h| (h.at_ns / 1_000_000, h.frame.padded()))
        .collect();
    eprintln!("{told:02X?}");
    eprintln!(
        "{:02X?}",
        pair.of_id(0x082)
            .iter()
            .map(|h| (h.at_ns / 1_000_000, h.frame.padded()))
            .collect::<Vec<_>>()
    );
    let told = told
        .iter()
        .map(|(_, bytes)| u16::from_le_bytes([bytes[0], bytes[1]]));
    let mut alarms = told.filter(|code| FALSE_ALARMS.contains(code));
    assert_eq!(alarms.next(), None);
    assert!(asked.iter().all(|times| *times <= 2), "{asked:?}");
}
