//! Conversations on a bus, and what the watch makes of them.

use super::*;

const MS: u64 = 1_000_000;

struct Bus {
    watch: Watch,
    now_ns: u64,
}

fn bus() -> Bus {
    Bus {
        watch: Watch::new(&Plan::default()),
        now_ns: 1_700_000_000_000_000_000,
    }
}

const PLACES: [Place; 2] = [Place { pair: 0, side: 0 }, Place { pair: 0, side: 1 }];

/// TPDO 1 with X in 0.01 deg, both axes valid unless said otherwise.
fn slopes(x: i16, validity: u8, state: u8) -> Vec<u8> {
    let [low, high] = x.to_le_bytes();
    vec![low, high, 0, 0, validity, state]
}

/// TPDO 3 of an angle in 0.001 deg.
fn angle(mdeg: i32) -> Vec<u8> {
    let steps = (i64::from(mdeg) << 24) / 360_000;
    let [a, b, c, _] = (steps as i32).to_le_bytes();
    vec![a, b, c, 0, 0, 0, 0x70, 0x70]
}

/// TPDO 2 with this difference.
fn detail(mdeg: i16) -> Vec<u8> {
    let [low, high] = mdeg.to_le_bytes();
    vec![0x3F, 1, 20, 0, 30, low, high, 25]
}

impl Bus {
    fn see(&mut self, id: u16, bytes: &[u8]) -> Meaning {
        self.now_ns += 100_000;
        self.watch.take(self.now_ns, &Frame::data_frame(id, bytes))
    }

    fn pass(&mut self, ms: u64) {
        self.now_ns += ms * MS;
    }

    /// A SYNC at which A and B have these angles, 0.001 deg, and states.
    fn round(&mut self, mdeg: [i32; 2], states: [u8; 2]) {
        self.pass(10);
        self.see(0x080, &[]);
        for (id, state) in (1..).zip(states) {
            self.see(0x180 + id, &slopes(0, 0x3F, state));
        }
        for (id, mdeg) in (1..).zip(mdeg) {
            self.see(0x380 + id, &angle(mdeg));
            self.see(0x480 + id, &[0, 0, 0, 0, 0, 0x20, 0, 0]);
        }
    }

    fn found(&self, side: usize) -> Vec<(Check, u64)> {
        let checks = &self.watch.pairs()[0].sides[side].checks;
        checks
            .found()
            .map(|(check, finding)| (check, finding.count))
            .collect()
    }
}

#[test]
fn slopes_of_one_sync_make_a_difference() {
    let mut watch = Watch::new(&Plan::default());
    assert_eq!(watch.take(0, &Frame::data_frame(0x80, &[])), Meaning::Sync);
    let a = Frame::data_frame(0x181, &[0xE8, 3, 0, 0, 0x3F, 1]);
    let b = Frame::data_frame(0x182, &[0xE6, 3, 0, 0x80, 0x3D, 1]);
    assert_eq!(watch.take(1, &a), Meaning::Slopes(PLACES[0], None));
    let delta = Delta {
        time_ns: 0,
        mdeg: [Some(20), None],
    };
    assert_eq!(watch.take(2, &b), Meaning::Slopes(PLACES[1], Some(delta)));
    let slopes = watch.pairs()[0].sides[0].slopes.unwrap();
    assert_eq!(slopes.mdeg, [Some(10_000), Some(0)]);
    let cut = Frame::data_frame(0x182, &[1, 2]);
    assert_eq!(watch.take(3, &cut), Meaning::Malformed(PLACES[1]));
    assert_eq!(watch.counts().malformed, 1);
}

#[test]
fn a_slope_is_valid_by_its_bit_and_by_its_number() {
    let mut bus = bus();
    let sent = |bus: &Bus| bus.watch.pairs()[0].sides[0].slopes.unwrap().mdeg;
    // 1 deg and 0 deg: X, Y, neither may be used.
    for (validity, mdeg) in [
        (0x3D, [Some(1000), None]),
        (0x3E, [None, Some(0)]),
        (0x3C, [None; 2]),
    ] {
        bus.see(0x181, &slopes(100, validity, 1));
        assert_eq!(sent(&bus), mdeg);
    }
    bus.see(0x181, &slopes(i16::MIN, 0x3F, 1));
    assert_eq!(sent(&bus), [None, Some(0)]);
    assert!(bus.found(0).contains(&(Check::Validity, 5)));
}

#[test]
fn without_validity_on_the_bus_the_number_alone_counts() {
    let mut node = NodePlan::as_delivered(1);
    node.pdos[0] = PdoPlan::of(0x181, 1, &[0x6010_0010, 0x6020_0010]);
    let plan = Plan {
        nodes: vec![node],
        ..Plan::default()
    };
    let mut watch = Watch::new(&plan);
    watch.take(1, &Frame::data_frame(0x181, &[100, 0, 0, 0x80]));
    let slopes = watch.pairs()[0].sides[0].slopes.unwrap();
    assert_eq!((slopes.mdeg, slopes.validity), ([Some(1000), None], None));
}

#[test]
fn the_difference_of_slopes_went_the_longer_way_round() {
    let mut bus = bus();
    bus.see(0x080, &[]);
    bus.see(0x181, &slopes(17_999, 0x3F, 1));
    let Meaning::Slopes(_, Some(delta)) = bus.see(0x182, &slopes(-17_999, 0x3F, 1)) else {
        panic!("a difference");
    };
    assert_eq!(delta.mdeg, [Some(-20), Some(0)]);
}

#[test]
fn a_round_ends_with_the_next_sync_or_where_a_channel_sends_again() {
    let mut bus = bus();
    for _ in 0..3 {
        bus.round([0, 10], [1, 1]);
    }
    let (round, count) = bus.watch.pairs()[0].ended();
    assert_eq!((round.unwrap().is_of_measured(), count), (true, 2));
    // Nothing is sent at these.
    for _ in 0..5 {
        bus.see(0x080, &[]);
    }
    assert_eq!(bus.watch.pairs()[0].ended().1, 3);
    let mut without = self::bus();
    let times: Vec<u64> = (0..3)
        .map(|_| {
            without.see(0x181, &slopes(1, 0x3F, 1));
            let at_ns = without.now_ns;
            let told = without.see(0x182, &slopes(2, 0x3F, 1));
            assert!(matches!(told, Meaning::Slopes(_, Some(_))));
            at_ns
        })
        .collect();
    let (round, count) = without.watch.pairs()[0].ended();
    assert_eq!((round.unwrap().time_ns, count), (times[1], 2));
}

#[test]
fn a_healthy_pair_is_found_guilty_of_nothing() {
    let mut bus = bus();
    for turn in 0..500 {
        bus.round([turn * 7, turn * 7 + 35], [1, 1]);
        if turn % 10 == 9 {
            assert_eq!(bus.see(0x281, &detail(-35)), Meaning::Detail(PLACES[0]));
            bus.see(0x282, &detail(35));
        }
    }
    assert_eq!((bus.found(0), bus.found(1)), (vec![], vec![]));
    assert_eq!(bus.watch.counts().others, 0);
    let exchanged = bus.watch.pairs()[0].exchanged_mdeg;
    assert!((exchanged[0].unwrap() + 35).abs() <= 1 && exchanged[1] == Some(0));
}

#[test]
fn a_difference_that_is_not_that_of_the_angles_is_counted() {
    let mut bus = bus();
    bus.round([1000, 1050], [1, 1]);
    bus.see(0x281, &detail(-50));
    bus.see(0x282, &detail(50));
    assert_eq!((bus.found(0), bus.found(1)), (vec![], vec![]));
    bus.round([1000, 1050], [1, 1]);
    bus.see(0x281, &detail(-60));
    bus.see(0x282, &detail(-50));
    bus.round([1000, 1050], [1, 1]);
    // None said, and none known, are no contradictions.
    bus.see(0x281, &detail(i16::MIN));
    let one = vec![(Check::Difference, 1)];
    assert_eq!((bus.found(0), bus.found(1)), (one.clone(), one));
}

#[test]
fn a_difference_with_an_angle_that_its_node_no_longer_sent_did_not_fit() {
    let mut bus = bus();
    for _ in 0..4 {
        bus.round([1000, 2100], [6, 6]);
    }
    // Channel B is faulty from here on: its own angle is in its difference, and not on the bus.
    bus.pass(10);
    bus.see(0x080, &[]);
    bus.see(0x181, &slopes(0, 0x3F, 8));
    bus.see(0x182, &[0, 0x80, 0, 0x80, 0x3C, 7]);
    bus.see(0x381, &angle(1000));
    bus.see(0x382, &[0, 0, 0, 0, 0, 0, 0x0D, 0x0D]);
    bus.see(0x481, &[0, 0, 0, 0, 0, 0x20, 0, 0]);
    bus.see(0x482, &[0, 0, 0, 0, 0, 0x20, 0, 0]);
    bus.see(0x282, &detail(1120));
    assert_eq!(bus.found(1), []);
    // Four SYNCs later 2024h is of one whose angles were sent.
    for _ in 0..4 {
        bus.round([1000, 2100], [6, 6]);
    }
    bus.see(0x282, &detail(1120));
    assert_eq!(bus.found(1), [(Check::Difference, 1)]);
}

#[test]
fn a_difference_of_the_smaller_axis_was_taken_for_the_larger_one() {
    let mut bus = bus();
    // X is 0.050 deg apart, Y not at all.
    bus.round([1000, 1050], [1, 1]);
    bus.see(0x281, &detail(0));
    assert_eq!(bus.watch.pairs()[0].difference_off(0), Some(50));
    assert_eq!(bus.found(0), [(Check::Difference, 1)]);
}

#[test]
fn a_pair_that_reports_agreement_while_its_angles_are_apart_is_counted() {
    let mut bus = bus();
    for _ in 0..100 {
        bus.round([0, 2000], [1, 1]);
    }
    assert_eq!(bus.found(0), [], "it may last for 1.5 s");
    for _ in 0..100 {
        bus.round([0, 2000], [1, 6]);
    }
    assert!(matches!(bus.found(0)[..], [(Check::State, 20..)]));
    let mut told = self::bus();
    for _ in 0..300 {
        told.round([0, 2000], [6, 6]);
    }
    assert_eq!((told.found(0), told.found(1)), (vec![], vec![]));
}

#[test]
fn states_that_exclude_each_other_for_long_are_counted_at_both() {
    let mut bus = bus();
    for states in [[7, 8], [8, 7], [9, 9], [0, 1]] {
        (0..200).for_each(|_| bus.round([0, 0], states));
    }
    assert_eq!(bus.found(0), []);
    (0..200).for_each(|_| bus.round([0, 0], [1, 8]));
    assert!(matches!(bus.found(0)[..], [(Check::State, 20..)]));
    assert!(matches!(bus.found(1)[..], [(Check::State, 20..)]));
}

#[test]
fn numbers_and_validity_bits_that_contradict_each_other_are_counted() {
    let mut bus = bus();
    bus.see(0x181, &slopes(100, 0x3E, 1));
    bus.see(0x181, &slopes(i16::MIN, 0x3F, 1));
    bus.see(0x181, &slopes(i16::MIN, 0x3E, 1));
    assert_eq!(bus.found(0), [(Check::Validity, 2)]);
    // Out of its range a valid slope may be one that 16 bit cannot hold.
    bus.see(0x082, &[0x10, 0x50, 0x20, 1, 0, 0, 0, 1]);
    bus.see(0x182, &slopes(i16::MIN, 0x3F, 1));
    bus.see(0x080, &[]);
    bus.see(0x182, &slopes(9500, 0x3F, 1));
    assert_eq!(bus.found(1), [(Check::Range, 1)]);
}

#[test]
fn codes_without_a_meaning_are_counted() {
    let mut bus = bus();
    bus.see(0x181, &slopes(0, 0x3F, 10));
    bus.see(0x381, &[0, 0, 0, 0, 0, 0, 31, 0x70]);
    bus.see(0x081, &[0x01, 0xFF, 0x81, 0, 0, 0x80, 0, 1]);
    assert_eq!(bus.see(0x701, &[9]), Meaning::Malformed(PLACES[0]));
    assert_eq!(bus.found(0), [(Check::Reserved, 3)]);
    assert_eq!(bus.see(0x701, &[]), Meaning::Malformed(PLACES[0]));
    assert_eq!(bus.see(0x081, &[1, 2, 3]), Meaning::Malformed(PLACES[0]));
    assert_eq!(bus.found(0), [(Check::Length, 2), (Check::Reserved, 3)]);
}

#[test]
fn a_pdo_that_stays_away_is_missed_once_and_a_second_one_is_too_many() {
    let mut bus = bus();
    bus.round([0, 0], [1, 1]);
    bus.round([0, 0], [1, 1]);
    bus.see(0x181, &slopes(0, 0x3F, 1));
    for _ in 0..5 {
        bus.pass(10);
        bus.see(0x080, &[]);
        bus.see(0x181, &slopes(0, 0x3F, 1));
    }
    assert_eq!(bus.found(0), [(Check::Twice, 1), (Check::Missed, 2)]);
    assert_eq!(bus.found(1), [(Check::Missed, 3)]);
}

#[test]
fn in_a_log_without_sync_every_pdo_came_twice() {
    let mut bus = bus();
    for _ in 0..5 {
        bus.see(0x181, &slopes(0, 0x3F, 1));
        bus.see(0x381, &angle(0));
    }
    assert_eq!(bus.found(0), []);
}

/// Node 1 with these mappings of its TPDO 1 and 2.
fn mapped(slopes: &[u32], detail: &[u32]) -> Bus {
    let mut node = NodePlan::as_delivered(1);
    node.pdos[0] = PdoPlan::of(0x181, 1, slopes);
    node.pdos[1] = PdoPlan::of(0x281, 1, detail);
    let plan = Plan {
        nodes: vec![node],
        ..Plan::default()
    };
    Bus {
        watch: Watch::new(&plan),
        ..bus()
    }
}

#[test]
fn a_state_that_no_pdo_carries_was_not_compared() {
    let mut bus = mapped(&[0x6110_0020, 0x6120_0020], &[0x2022_0310]);
    bus.see(0x181, &[100, 0, 0, 0, 0, 0, 0, 0]);
    bus.see(0x182, &slopes(100, 0x3F, 8));
    let state = |bus: &Bus| bus.watch.pairs()[0].sides[0].slopes.unwrap().state;
    assert_eq!(state(&bus), None);
    bus.see(0x281, &[20, 0]);
    let detail = bus.watch.pairs()[0].sides[0].detail.unwrap();
    assert_eq!((detail.latency_ms, detail.temperature_degc), (None, None));
    assert_eq!(bus.found(1), [], "with no state there is no contradiction");
}

#[test]
fn a_state_in_another_pdo_stayed_for_ever() {
    let mut bus = mapped(&[0x6110_0020, 0x6120_0020], &[0x2021_0008, 0x2022_0310]);
    let state = |bus: &Bus| bus.watch.pairs()[0].sides[0].slopes.unwrap().state;
    bus.see(0x281, &[6, 20, 0]);
    bus.see(0x181, &[0; 8]);
    assert_eq!(state(&bus), Some(6));
    bus.pass(1_100);
    bus.see(0x181, &[0; 8]);
    assert_eq!(state(&bus), None);
    bus.see(0x281, &[6, 20, 0]);
    bus.see(0x701, &[0]);
    bus.see(0x181, &[0; 8]);
    assert_eq!(state(&bus), None, "that was of before its restart");
}

#[test]
fn supervision_of_a_heartbeat_begins_with_the_first_one() {
    let mut bus = bus();
    for _ in 0..20 {
        bus.pass(100);
        bus.see(0x701, &[5]);
    }
    let side = |bus: &Bus, n: usize| {
        let side = &bus.watch.pairs()[0].sides[n];
        let heartbeat = &side.heartbeat;
        (heartbeat.losses(), heartbeat.lost_since_ns().is_some())
    };
    assert_eq!((side(&bus, 0), side(&bus, 1)), ((0, false), (0, false)));
    for _ in 0..2 {
        bus.pass(100);
        bus.see(0x701, &[5]);
        bus.see(0x702, &[127]);
    }
    for _ in 0..10 {
        bus.pass(100);
        bus.see(0x701, &[5]);
    }
    assert_eq!((side(&bus, 0), side(&bus, 1)), ((0, false), (1, true)));
    bus.see(0x702, &[127]);
    assert_eq!(side(&bus, 1), (1, false));
    for _ in 0..6 {
        bus.pass(100);
        bus.see(0x080, &[]);
    }
    assert_eq!((side(&bus, 0), side(&bus, 1)), ((1, true), (2, true)));
}

#[test]
fn a_hole_in_the_log_is_no_lost_heartbeat() {
    let mut bus = bus();
    for _ in 0..2 {
        bus.round([0, 0], [1, 1]);
        bus.see(0x701, &[5]);
    }
    bus.pass(60_000);
    bus.round([0, 0], [1, 1]);
    let losses = |bus: &Bus| bus.watch.pairs()[0].sides[0].heartbeat.losses();
    assert_eq!(losses(&bus), 0);
    bus.now_ns -= 3_600_000 * MS;
    bus.round([0, 0], [1, 1]);
    assert_eq!(bus.watch.counts().backwards, 1);
    assert_eq!(bus.found(0), []);
    // From here on it counts again.
    for _ in 0..60 {
        bus.round([0, 0], [1, 1]);
    }
    assert_eq!(losses(&bus), 1);
}

#[test]
fn one_frame_with_an_older_time_was_a_lost_heartbeat_of_all() {
    let mut bus = bus();
    for _ in 0..5 {
        bus.pass(100);
        bus.see(0x701, &[5]);
    }
    bus.now_ns -= 1500 * MS;
    bus.see(0x080, &[]);
    bus.now_ns += 1500 * MS;
    bus.see(0x080, &[]);
    let side = &bus.watch.pairs()[0].sides[0];
    assert_eq!(
        (side.heartbeat.losses(), bus.watch.counts().backwards),
        (0, 1)
    );
}

#[test]
fn the_end_of_a_fault_of_the_bus_left_no_fault_of_the_instrument() {
    let mut bus = bus();
    bus.see(0x081, &[0x14, 0xFF, 0x81, 0, 0x20, 0, 0x4F, 7]);
    bus.see(0x081, &[0x30, 0x81, 0x91, 2, 0, 0, 0, 0]);
    let faults = |bus: &Bus| bus.watch.pairs()[0].sides[0].faults;
    assert_eq!(faults(&bus), 1 << 13);
    // 0000h of 8130h: bytes 3 to 7 are 0, and byte 2 tells that something is left.
    bus.see(0x081, &[0, 0, 0x81, 0, 0, 0, 0, 0]);
    assert_eq!(faults(&bus), 1 << 13);
    bus.see(0x081, &[0, 0, 0, 0, 0, 0, 0, 1]);
    assert_eq!(faults(&bus), 0);
    bus.see(0x081, &[0x02, 0x61, 0x81, 0xFF, 0xFF, 0xFF, 0xFF, 1]);
    assert_eq!((faults(&bus), bus.found(0)), (0, vec![]));
}

#[test]
fn frames_that_are_nobodys_are_told_apart() {
    use canopen::frame::{ExtendedId, standard};
    let mut bus = bus();
    for id in [
        0x000, 0x100, 0x581, 0x601, 0x7E4, 0x501, 0x705, 0x185, 0x6F0,
    ] {
        assert_eq!(bus.see(id, &[1]), Meaning::Other);
    }
    let extended = Frame::with(ExtendedId::new(0x181).unwrap(), &[0; 6]).unwrap();
    let remote = Frame::remote(standard(0x181), 6).unwrap();
    bus.watch.take(bus.now_ns, &extended);
    bus.watch.take(bus.now_ns, &remote);
    let counts = bus.watch.counts();
    let told = [
        counts.nmt,
        counts.services,
        counts.sdo,
        counts.unplanned,
        counts.strangers,
    ];
    assert_eq!(
        (told, counts.extended, counts.remote),
        ([1, 2, 2, 1, 3], 1, 1)
    );
    assert_eq!(counts.others, 11);
    assert_eq!(bus.watch.strangers().collect::<Vec<_>>(), [5]);
}

#[test]
fn how_far_a_channel_has_turned_is_a_message_of_that_channel() {
    let mut bus = bus();
    assert_eq!(bus.see(0x402, &[1; 8]), Meaning::Turned(PLACES[1]));
    assert_eq!(bus.see(0x402, &[1; 7]), Meaning::Malformed(PLACES[1]));
    let pair = &bus.watch.pairs()[0];
    let is_seen = pair.sides.each_ref().map(|side| side.seen_ns.is_some());
    assert_eq!(is_seen, [false, true]);
    assert_eq!(bus.watch.counts().unplanned, 0);
}

#[test]
fn a_fault_of_the_start_that_overtook_its_boot_up_message_was_taken_back_by_it() {
    let mut bus = bus();
    let faults = |bus: &Bus| bus.watch.pairs()[0].sides[0].faults;
    let emcy = [0x10, 0xFF, 0x81, 4, 0, 0, 0x40, 6];
    bus.see(0x081, &emcy);
    bus.pass(5);
    bus.see(0x701, &[0]);
    assert_eq!(faults(&bus), 4);
    // One from before the start is over.
    bus.pass(20);
    bus.see(0x701, &[0]);
    assert_eq!(faults(&bus), 0);
}
