//! A node that erases pages: its processor stands still for each, and goes on where it was.

use super::*;
use crate::memory::ERASE_NS;

/// Writes an object of node 1, of up to four bytes: its answer.
fn write(site: &mut Site, [low, high, sub]: [u8; 3], value: u32, size: u8) -> Vec<u8> {
    let [a, b, c, d] = value.to_le_bytes();
    let command = 0x23 | (4 - size) << 2;
    site.send(0x601, &[command, low, high, sub, a, b, c, d]);
    site.run(&mut level(), 60 * MS);
    let answers = site.trace.iter().rev();
    let mut answers = answers.filter(|(_, frame)| frame.cob_id() == Some(0x581));
    let (_, answer) = answers.next().expect("an answer");
    answer.bytes().to_vec()
}

/// Node 1 in PRE-OPERATIONAL, told to clear its other slot after so long, ns.
fn clearing(after_ns: u64) -> Site {
    let mut site = Site::working(250);
    site.send(0, &[0x80, 1]);
    site.run(&mut level(), 100 * MS + after_ns);
    for command in [0, 3] {
        let answer = write(&mut site, [0x51, 0x1F, 1], command, 1);
        assert_eq!(answer[0], 0x60, "{answer:02X?}");
    }
    site
}

#[test]
fn a_clear_costs_no_heartbeat_and_blames_nobody() {
    let mut drawn = Vec::new();
    for phase in 0..10 {
        let mut site = clearing(phase * 250_000);
        let begun = site.trace.len();
        let from_ns = site.network.now_ns();
        while site.network.nodes()[0].device.values().program.status() == 1 {
            site.send(0x80, &[]);
            site.run(&mut level(), 20 * MS);
        }
        let pages = f64::from(flash::layout::RC.a.length / flash::layout::PAGE);
        let [least, most] = ERASE_NS;
        let took = (site.network.now_ns() - from_ns) as f64;
        // Behind each page there are 20 ms, and a look every 10 ms.
        let [least, most] = [least + 20e6, most + 30e6].map(|page| page * (pages - 3.0));
        assert!((least..most).contains(&took), "{took}");
        drawn.push(site.network.now_ns());
        site.run(&mut level(), 500 * MS);
        let beats: Vec<_> = site.trace[begun..]
            .iter()
            .filter(|(_, frame)| frame.cob_id() == Some(0x701))
            .map(|(at, _)| *at)
            .collect();
        let gap = beats.windows(2).map(|two| two[1] - two[0]).max();
        assert!(gap.is_some_and(|gap| gap < 242 * MS), "{gap:?}");
        let told = site.trace[begun..]
            .iter()
            .filter(|(_, frame)| frame.cob_id() == Some(0x81))
            .map(|(_, frame)| u16::from_le_bytes([frame.padded()[0], frame.padded()[1]]))
            .filter(|code| *code != 0x8110);
        assert_eq!(told.collect::<Vec<_>>(), [] as [u16; 0]);
    }
    drawn.dedup();
    assert!(drawn.len() > 1, "erases of the same length each time");
}

#[test]
fn while_a_page_is_erased_nothing_is_answered_and_three_requests_stay() {
    let mut site = clearing(0);
    let mut latest = 0;
    for _ in 0..200 {
        let asked = site.network.now_ns();
        let before = site.times_of(0x581).len();
        site.send(0x601, &[0x40, 0x57, 0x1F, 1, 0, 0, 0, 0]);
        site.run(&mut level(), 45 * MS);
        let answers = site.times_of(0x581);
        assert_eq!(answers.len(), before + 1);
        latest = latest.max(answers[before] - asked);
    }
    assert!(latest > 15 * MS, "{latest}");
}

#[test]
fn a_save_at_any_moment_blames_nobody() {
    let mut site = Site::working(250);
    site.send(0, &[0x80, 0]);
    site.run(&mut level(), 200 * MS);
    let begun = site.trace.len();
    for phase in 0..40 {
        site.run(&mut level(), 100 * MS + phase * 370_000);
        site.send(0x80, &[]);
        let answer = write(&mut site, [0x10, 0x10, 1], 0x6576_6173, 4);
        assert_eq!(answer[0], 0x60, "{phase}: {answer:02X?}");
    }
    let told = site.trace[begun..]
        .iter()
        .filter(|(_, frame)| frame.cob_id() == Some(0x81))
        .map(|(_, frame)| *frame);
    assert_eq!(told.collect::<Vec<_>>(), []);
}

#[test]
fn a_frame_went_into_a_mailbox_that_its_driver_had_not_chosen_after_a_standstill() {
    for phase in 0..20 {
        let mut site = clearing(phase * 490_000);
        let answer = write(&mut site, [0x17, 0x10, 0], 10, 2);
        assert_eq!(answer[0], 0x60, "{answer:02X?}");
        let before = site.times_of(0x581).len();
        // An answer is on the wire when a page begins to be erased, and a heartbeat becomes due.
        // The answer is gone when the processor goes on, and its driver has not been told yet.
        let mut asked = 0;
        while site.network.nodes()[0].device.values().program.status() == 1 {
            site.send(0x601, &[0x40, 0x57, 0x1F, 1, 0, 0, 0, 0]);
            site.run(&mut level(), 45 * MS + 130_000);
            asked += 1;
        }
        // None is lost, none doubled.
        assert_eq!(site.times_of(0x581).len() - before, asked);
    }
}
