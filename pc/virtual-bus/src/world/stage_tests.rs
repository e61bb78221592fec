//! The stage as clients and words find it, in virtual time alone.

use canopen::Frame;
use canopen::nmt::State;
use device::fault::Fault;
use device::records::{Record, RecordStore};
use sim::bench::{Mode, World};
use sim::memory;
use sim::network::Network;
use sim::network::guest::Switch;
use sim::network::hand::Pose;
use sim::network::instrument::{Delivered, Fitting};

use super::adapter::Passed;
use super::effects::Done;
use super::keep::Keep;
use super::stage::Stage;
use crate::clients::round_robin::{ClientId, Incoming};
use crate::words::line::read;
use crate::words::reader::WordError;

const MS: u64 = 1_000_000;

/// A pair at 250 kbit/s, just switched on.
fn pair() -> Stage {
    let fitting = |node_id| Fitting {
        node_id,
        kbit_s: 250,
        memory: memory::blank(),
    };
    let mut network = Network::new(250_000, 1);
    let bare = Delivered::bare(Mode::Product, &World::NOMINAL, 1, 0);
    bare.join(&mut network, [fitting(1), fitting(2)]);
    let mut stage = Stage::new(network, 1);
    stage.switch(0, Switch::On);
    stage.switch(1, Switch::On);
    stage
}

fn enter(stage: &mut Stage, text: &str) -> Result<Done, WordError> {
    let line = read(text, 2).unwrap().expect("a word");
    stage.obey(&line.word)
}

fn go(stage: &mut Stage, ms: u64) -> Vec<Passed> {
    stage.run_until(stage.network.now_ns() + ms * MS)
}

fn ids(passed: &[Passed]) -> Vec<u16> {
    passed.iter().filter_map(|p| p.frame.cob_id()).collect()
}

/// Nodes whose boot-up message is among these.
fn boots(passed: &[Passed]) -> Vec<u16> {
    let boots = passed.iter().filter(|p| p.frame.bytes() == [0]);
    let nodes = boots.filter_map(|p| p.frame.cob_id()?.checked_sub(0x700));
    nodes.filter(|node| (1..=127).contains(node)).collect()
}

/// Three clients, as a hub would number them.
fn clients() -> [ClientId; 3] {
    [0, 1, 2].map(ClientId)
}

fn faults(stage: &Stage, node: usize) -> Vec<Fault> {
    let found = stage.network.nodes()[node].device.faults();
    found
        .iter()
        .filter(|fault| *fault != Fault::NotCalibrated)
        .collect()
}

#[test]
fn both_nodes_boot_and_every_client_may_see_it() {
    let mut stage = pair();
    let passed = go(&mut stage, 100);
    let mut boots = boots(&passed);
    boots.sort_unstable();
    assert_eq!(boots, [1, 2]);
    assert!(passed.iter().all(|p| p.from.is_none()), "{passed:?}");
}

#[test]
fn a_client_asks_and_the_node_answers_a_frame_later() {
    let mut stage = pair();
    go(&mut stage, 100);
    let [client, ..] = clients();
    let ask = Frame::data_frame(0x601, &[0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
    let asked_ns = stage.network.now_ns();
    stage.offer(Incoming { client, frame: ask });
    let passed = go(&mut stage, 10);
    let [first, second] = [0x601, 0x581].map(|id| {
        let found = passed.iter().find(|p| p.frame.cob_id() == Some(id));
        *found.expect("on the bus")
    });
    assert_eq!((first.frame, first.from), (ask, Some(client)));
    assert_eq!((second.frame.bytes()[0], second.from), (0x43, None));
    // Two frames of about 120 bits each, 4 us a bit.
    assert!(second.at_ns - asked_ns < 1_200_000, "{second:?}");
}

#[test]
fn frames_of_clients_follow_each_other_without_a_gap_and_in_their_order() {
    let mut stage = pair();
    go(&mut stage, 100);
    let [a, b, _] = clients();
    let frames = (0..40).map(|n| Incoming {
        client: if n % 3 == 0 { a } else { b },
        frame: Frame::data_frame(0x7F0 - n, &[n as u8; 2]),
    });
    let all: Vec<Incoming> = frames.clone().collect();
    frames.for_each(|incoming| stage.offer(incoming));
    let passed = go(&mut stage, 40);
    let own: Vec<_> = passed.iter().filter(|p| p.from.is_some()).collect();
    assert_eq!(own.len(), all.len());
    for client in [a, b] {
        let wanted = all.iter().filter(|one| one.client == client);
        let wanted: Vec<_> = wanted.map(|one| one.frame).collect();
        let seen = own.iter().filter(|p| p.from == Some(client));
        let seen: Vec<_> = seen.map(|p| p.frame).collect();
        assert_eq!(seen, wanted);
    }
    // Past the mailboxes of the first, in turn, until one has no more.
    let turns = own.iter().skip(3).take(20).map(|p| p.from);
    let turns: Vec<_> = turns.collect();
    assert!(turns.windows(2).all(|two| two[0] != two[1]), "{turns:?}");
    let longest = own.windows(2).map(|w| w[1].at_ns - w[0].at_ns).max();
    // At most 80 bits with stuffing and intermission, of 4 us each.
    assert!(longest.unwrap() <= 320_000, "{longest:?}");
}

#[test]
fn beside_a_client_that_floods_another_waited_for_all_of_its_frames() {
    let mut stage = pair();
    go(&mut stage, 300);
    let [flooder, guest, _] = clients();
    let flood = Frame::data_frame(0x7FF, &[0; 8]);
    while stage.has_room(flooder) {
        stage.offer(Incoming {
            client: flooder,
            frame: flood,
        });
    }
    go(&mut stage, 5);
    let asked_ns = stage.network.now_ns();
    stage.offer(Incoming {
        client: guest,
        frame: Frame::data_frame(0x601, &[0x40, 0x18, 0x10, 4, 0, 0, 0, 0]),
    });
    let passed = go(&mut stage, 30);
    let answer = passed.iter().find(|p| p.frame.cob_id() == Some(0x581));
    let waited_us = (answer.unwrap().at_ns - asked_ns) / 1000;
    // The frame on the wire and two in mailboxes, the request, one more of the flood, the answer:
    // six frames of at most 135 bits each, 4 us a bit.
    assert!(waited_us < 6 * 135 * 4, "{waited_us} us");
    let floods = passed.iter().filter(|p| p.from == Some(flooder));
    assert!(floods.count() > 40);
}

#[test]
fn a_queue_reports_no_room_before_it_is_full() {
    let mut stage = pair();
    let [client, ..] = clients();
    let frame = Frame::data_frame(0x7FF, &[0; 8]);
    let mut taken = 0;
    while stage.has_room(client) {
        stage.offer(Incoming { client, frame });
        taken += 1;
        assert!(taken < 1000);
    }
    go(&mut stage, 100);
    assert!(stage.has_room(client));
}

#[test]
fn power_and_wire_off_are_silence_and_on_again_a_boot() {
    for (off, on, started) in [
        ("power b off", "power b on", &[2][..]),
        ("wire b off", "wire b on", &[][..]),
    ] {
        let mut stage = pair();
        go(&mut stage, 200);
        enter(&mut stage, off).unwrap();
        enter(&mut stage, "reset a").unwrap();
        let heard = go(&mut stage, 1500);
        assert_eq!(boots(&heard), [1], "{off}");
        assert!(!ids(&heard).contains(&0x702), "{off}");
        enter(&mut stage, on).unwrap();
        let heard = go(&mut stage, 1500);
        assert_eq!(boots(&heard), started, "{on}");
        assert!(ids(&heard).contains(&0x702), "{on}");
        assert_eq!(enter(&mut stage, on), Ok(Done::Quietly));
        assert_eq!(boots(&go(&mut stage, 200)), [0; 0], "{on} twice");
    }
}

#[test]
fn what_breaks_is_found_by_its_node_and_not_by_the_other() {
    for (word, fault) in [
        ("fault b stuck", Fault::SensorBus),
        ("fault b silent", Fault::SensorBus),
        ("fault b spi", Fault::SensorBus),
        ("fault b brown-out", Fault::SensorSupply),
    ] {
        let mut stage = pair();
        go(&mut stage, 500);
        enter(&mut stage, word).unwrap();
        go(&mut stage, 1000);
        assert!(faults(&stage, 1).contains(&fault), "{word}");
        assert!(!faults(&stage, 0).contains(&fault), "{word}");
        // Healed, a latched fault stays until the reset.
        enter(&mut stage, "heal b").unwrap();
        enter(&mut stage, "reset b").unwrap();
        go(&mut stage, 1000);
        assert!(!faults(&stage, 1).contains(&fault), "{word} healed");
    }
}

#[test]
fn a_loose_board_reads_another_slope() {
    let mut stage = pair();
    let rolls = |stage: &mut Stage| {
        go(stage, 1000);
        [0, 1].map(|node| {
            let slope = stage.network.shown(node).slope(0);
            slope.expect("valid").degrees()
        })
    };
    let before = rolls(&mut stage);
    enter(&mut stage, "fault b offset 100mg").unwrap();
    let after = rolls(&mut stage);
    let [a, b] = [0, 1].map(|node| after[node] - before[node]);
    // atan(0.1) is 5.7 deg.
    assert!(
        a.abs() < 0.2 && (b.abs() - 5.7).abs() < 0.5,
        "{before:?} {after:?}"
    );
}

#[test]
fn a_short_throws_the_adapter_off_the_bus_and_it_comes_back() {
    let mut stage = pair();
    go(&mut stage, 100);
    let [client, ..] = clients();
    let frame = Frame::data_frame(0x7FE, &[1]);
    stage.offer(Incoming { client, frame });
    enter(&mut stage, "bus short 0.05").unwrap();
    assert!(!ids(&go(&mut stage, 50)).contains(&0x7FE));
    // 128 times 11 recessive bits are 5.6 ms.
    assert!(ids(&go(&mut stage, 50)).contains(&0x7FE));
}

#[test]
fn the_adapter_follows_a_bit_rate_set_by_lss() {
    let mut stage = pair();
    go(&mut stage, 100);
    let [client, ..] = clients();
    // LSS: all to configuration; bit timing 2 (500 kbit/s); activate with a delay of 20 ms.
    for bytes in [[0x04, 1, 0], [0x13, 0, 2], [0x15, 20, 0]] {
        let frame = Frame::data_frame(0x7E5, &[bytes[0], bytes[1], bytes[2], 0, 0, 0, 0, 0]);
        stage.offer(Incoming { client, frame });
        go(&mut stage, 5);
    }
    enter(&mut stage, "bit-rate 500").unwrap();
    let heard = ids(&go(&mut stage, 1000));
    assert!(
        heard.contains(&0x701) && heard.contains(&0x702),
        "{heard:x?}"
    );
    let (sent, errors) = {
        let counts = stage.network.bus.statistics();
        (counts.sent, counts.errors)
    };
    assert!(sent > 10 && errors == 0, "{sent} {errors}");
}

#[test]
fn a_stranger_babbles_until_told_not_to() {
    let mut stage = pair();
    go(&mut stage, 100);
    enter(&mut stage, "babble 001").unwrap();
    let heard = ids(&go(&mut stage, 20));
    assert!(
        heard.len() > 20 && heard.iter().all(|id| *id == 1),
        "{heard:x?}"
    );
    enter(&mut stage, "babble off").unwrap();
    go(&mut stage, 2);
    assert!(!ids(&go(&mut stage, 20)).contains(&1));
}

#[test]
fn the_chamber_takes_its_time_unless_told_otherwise() {
    let mut stage = pair();
    enter(&mut stage, "temp -10").unwrap();
    go(&mut stage, 3000);
    let (_, [air_c, die_c]) = stage.truth();
    assert!(
        (air_c - 24.9).abs() < 0.01 && die_c > 24.99,
        "{air_c} {die_c}"
    );
    let shown = |stage: &Stage| {
        let device = &stage.network.nodes()[0].device;
        device.values().process.temperature_c
    };
    let before_c = shown(&stage);
    enter(&mut stage, "temp 60 now").unwrap();
    go(&mut stage, 1000);
    // No die jumps like this, so the thermometer is not believed before a reset.
    assert!(faults(&stage, 0).contains(&Fault::Thermometer));
    enter(&mut stage, "reset all").unwrap();
    go(&mut stage, 20_000);
    // The thermometer has an offset, which cancels, and smooths.
    let change = shown(&stage) - before_c;
    assert!((33..=37).contains(&change), "{before_c} {change}");
}

#[test]
fn words_are_refused_without_a_change() {
    let mut stage = pair();
    enter(&mut stage, "pitch 60").unwrap();
    let impossible = Pose {
        pitch_deg: 60.0,
        roll_deg: 40.0,
    };
    assert_eq!(
        enter(&mut stage, "roll 40"),
        Err(WordError::Impossible(impossible))
    );
    assert_eq!(enter(&mut stage, "wait 3"), Err(WordError::ScriptOnly));
    go(&mut stage, 5000);
    let ([x, y], _) = stage.truth();
    assert!(stage.is_still() && x.abs() < 1e-9 && (y - 60.0).abs() < 1e-9);
}

#[test]
fn the_status_tells_truth_and_nodes() {
    let mut stage = pair();
    enter(&mut stage, "pitch 30").unwrap();
    enter(&mut stage, "power b off").unwrap();
    go(&mut stage, 4000);
    let Ok(Done::Told(text)) = enter(&mut stage, "status") else {
        panic!("status tells");
    };
    assert!(
        text.starts_with("4.000 s: pitch 30.000 deg, roll 0.000 deg"),
        "{text}"
    );
    assert!(
        text.contains("  a   node-id 1, pre-operational, pitch "),
        "{text}"
    );
    assert!(text.contains("  b   without power"), "{text}");
}

#[test]
fn the_truth_of_an_instrument_with_one_axis_was_folded_at_90_deg() {
    let mut stage = pair();
    stage.one_axis = true;
    enter(&mut stage, "rate 400").unwrap();
    enter(&mut stage, "roll 170").unwrap();
    go(&mut stage, 3000);
    let ([x, y], _) = stage.truth();
    assert!((x - 170.0).abs() < 1e-6 && y.abs() < 1e-6, "{x} {y}");
    enter(&mut stage, "roll -30").unwrap();
    enter(&mut stage, "pitch 40").unwrap();
    go(&mut stage, 3000);
    let ([x, y], _) = stage.truth();
    // x is -0.5 and z sqrt(1 - 0.25 - sin(40 deg)^2).
    assert!(
        (x + 40.746).abs() < 0.001 && (y - 40.0).abs() < 1e-6,
        "{x} {y}"
    );
    stage.one_axis = false;
    let ([x, _], _) = stage.truth();
    assert!((x + 30.0).abs() < 1e-6, "{x}");
}

#[test]
fn what_a_node_stores_is_in_the_folder_and_comes_back() {
    let folder = std::env::temp_dir().join(format!("plumb-stage-{}", std::process::id()));
    let mut keep = Keep::open(&folder, 2).unwrap();
    let mut stage = pair();
    go(&mut stage, 100);
    let [client, ..] = clients();
    // "save" to 1010h sub 1.
    let frame = Frame::data_frame(0x602, &[0x23, 0x10, 0x10, 1, b's', b'a', b'v', b'e']);
    stage.offer(Incoming { client, frame });
    let answer = go(&mut stage, 50);
    let answer = answer.iter().find(|p| p.frame.cob_id() == Some(0x582));
    assert_eq!(answer.map(|p| p.frame.bytes()[0]), Some(0x60));
    assert_eq!(
        stage.network.nodes()[1].device.bus().state(),
        State::PreOperational
    );
    keep.save(&mut stage).unwrap();
    let again = Keep::open(&folder, 2).unwrap();
    let length = |node, record| again.memory(node).read(record, 0, &mut [0; 16]);
    assert_eq!(length(0, Record::Communication), 0);
    assert_eq!(length(1, Record::Communication), 16);
    std::fs::remove_dir_all(&folder).unwrap();
}
