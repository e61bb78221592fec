//! Saves at any moment: the processor stands still while they are programmed and for the page that
//! is erased behind them.
//!
//! In: a node in PRE-OPERATIONAL, SYNC every 20 ms, saves at phases that go through the sensor's
//! period. Out: no fault, and heartbeats that come.

use canopen::Frame;
use emulator::pair::Pair;

use crate::bench::{PARTS, SAVE, pieces};

/// Saves for each duration of an erase.
const SAVES: u32 = 40;
/// How much later each of them comes in the period of 2.5 ms than the one before, s.
const PHASE_S: f64 = 0.000_37;
/// Erases of these durations, ns, and as drawn.
const ERASES_NS: [Option<u64>; 3] = [Some(20_000_000), Some(40_000_000), None];
/// A master that waits for heartbeats waits for so long, ns.
const CONSUMER_NS: u64 = 500_000_000;

/// Goes on with a SYNC every 20 ms, for so many of them.
fn sync(pair: &mut Pair, times: usize) {
    for _ in 0..times {
        pair.send(Frame::data_frame(0x080, &[])).expect("room");
        pair.run(0.02);
    }
}

#[test]
fn three_saves_of_forty_made_an_emergency_of_a_silent_sensor() {
    let pair = Pair::with(&PARTS, 1, 2, &pieces());
    let mut pair = pair.expect("the image is for the flash");
    pair.run(3.0);
    let begun = pair.heard.len();
    let before: u32 = erases(&mut pair);
    for erase_ns in ERASES_NS {
        let chip = pair.board(0).machine_mut().chip_mut();
        chip.flash.set_erase_ns(erase_ns);
        for number in 0..SAVES {
            sync(&mut pair, 10);
            pair.run(0.01 + PHASE_S * f64::from(number));
            let saved = pair.write(1, (0x1010, 1), 4, SAVE);
            saved.unwrap_or_else(|error| panic!("{number}, {erase_ns:?}: {error:?}"));
        }
    }
    let erased = erases(&mut pair) - before;
    assert!(erased > SAVES, "{erased}");
    let heard = &pair.heard[begun..];
    let told: Vec<_> = (heard.iter().filter(|h| h.frame.cob_id() == Some(0x081)))
        .map(|heard| heard.frame)
        .collect();
    assert_eq!(told, []);
    let beats: Vec<_> = (heard.iter().filter(|h| h.frame.cob_id() == Some(0x701)))
        .map(|heard| heard.at_ns)
        .collect();
    let gaps = beats.windows(2).map(|two| two[1] - two[0]);
    let longest = gaps.max().expect("heartbeats");
    eprintln!(
        "{erased} erases, heartbeats {} ms apart at most",
        longest / 1_000_000
    );
    assert!(longest < CONSUMER_NS, "{longest}");
}

fn erases(pair: &mut Pair) -> u32 {
    let cells = pair.board(0).machine_mut().chip_mut().flash.cells();
    cells.pages().iter().map(flash::nor::Page::erases).sum()
}
