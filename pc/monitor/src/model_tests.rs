//! The model on frames made by hand: what is fresh, what is stale and why, what is told.

use canopen::{Frame, frame::ExtendedId};

use proptest::prelude::*;

use super::events::Kind;
use super::level::Level;
use super::model::{Model, Setup};
use super::moment;
use super::snapshot::{Channel, Compared, Snapshot, SourceState};
use listen::{NodePlan, PdoPlan, Plan};

const MS: u64 = 1_000_000;

/// A bus that somebody writes by hand; times in ms.
struct Bench {
    model: Model,
    time_ms: u64,
}

impl Bench {
    fn new() -> Self {
        Self::of(&Plan::default())
    }

    fn of(plan: &Plan) -> Self {
        let setup = Setup {
            name: "bench".to_owned(),
            bit_rate: Some(250_000),
        };
        Self {
            model: Model::new(plan, setup),
            time_ms: 1_000_000,
        }
    }

    fn take(&mut self, id: u16, bytes: &[u8]) {
        let frame = Frame::data_frame(id, bytes);
        self.model.take(self.time_ms * MS, &frame);
    }

    fn wait(&mut self, ms: u64) {
        self.time_ms += ms;
        self.model.pass(self.time_ms * MS);
    }

    /// A SYNC with its answers of both channels: slopes X in 0.01 deg, and the state.
    fn cycle(&mut self, x: [i16; 2], state: [u8; 2]) {
        self.take(0x80, &[]);
        for node in [0, 1] {
            let [low, high] = x[node].to_le_bytes();
            let id = 0x181 + node as u16;
            self.take(id, &[low, high, 0, 0, 0x7F, state[node]]);
        }
        self.time_ms += 10;
        self.model.pass(self.time_ms * MS);
    }

    fn heartbeats(&mut self, state: u8) {
        self.take(0x701, &[state]);
        self.take(0x702, &[state]);
    }

    fn see(&self) -> Snapshot {
        moment::snapshot(&self.model)
    }

    fn channel(&self, side: usize) -> Channel {
        self.see().instruments[0].channels[side].clone()
    }

    fn texts(&self) -> Vec<String> {
        let events = self.model.events.since(0);
        events
            .map(|event| format!("{} {}", event.channel.unwrap_or("-"), event.text))
            .collect()
    }
}

/// TPDO 3 of an angle X, in 2^-24 of a circle.
fn angle(x_mdeg: i64) -> [u8; 8] {
    let [x0, x1, x2, ..] = (x_mdeg * 16_777_216 / 360_000).to_le_bytes();
    [x0, x1, x2, 0, 0, 0, 0x70, 0x70]
}

#[test]
fn different_presets_were_shown_as_a_difference_of_a_pair_that_agrees() {
    let mut bench = Bench::new();
    bench.cycle([1000, 10_500], [1, 1]);
    let seen = bench.see();
    assert_eq!(seen.instruments[0].difference_of, Compared::Slopes);
    assert_eq!(seen.instruments[0].difference_x_deg, Some(-95.0));
    for _ in 0..3 {
        bench.cycle([1000, 10_500], [1, 1]);
        bench.take(0x381, &angle(10_000));
        bench.take(0x382, &angle(9_980));
    }
    let seen = bench.see();
    assert_eq!(seen.instruments[0].difference_of, Compared::Measured);
    let difference = seen.instruments[0].difference_x_deg.unwrap();
    assert!((difference - 0.02).abs() < 0.0015, "{difference}");
}

/// 8000h on both slopes, compared and calibrated, with this state of the pair.
fn without_slopes(state: u8) -> [u8; 6] {
    [0, 0x80, 0, 0x80, 0x70, state]
}

#[test]
fn a_pair_that_agrees_without_an_angle_that_may_be_used_was_ok() {
    let mut bench = Bench::new();
    for _ in 0..4 {
        for (id, node) in [(0x181, 0x381), (0x182, 0x382)] {
            bench.take(id, &without_slopes(1));
            bench.take(node, &angle(10_000));
        }
        bench.wait(100);
    }
    let verdict = &bench.see().instruments[0].verdict;
    assert_eq!(verdict.level, Level::Fault);
    let text = "both agree; no angle of A and B: ";
    assert!(verdict.text.starts_with(text), "{}", verdict.text);
}

#[test]
fn the_difference_was_not_shown_while_the_pair_disagrees() {
    let mut bench = Bench::new();
    for _ in 0..4 {
        for (id, node, mdeg) in [(0x181, 0x381, 10_000), (0x182, 0x382, 8_800)] {
            bench.take(id, &without_slopes(6));
            bench.take(node, &angle(mdeg));
        }
        bench.wait(100);
    }
    let instrument = &bench.see().instruments[0];
    assert_eq!(instrument.difference_of, Compared::Measured);
    let difference = instrument.difference_x_deg.unwrap();
    assert!((difference - 1.2).abs() < 0.0015, "{difference}");
    assert!(instrument.verdict.text.starts_with("the channels disagree"));
}

#[test]
fn two_channels_that_had_both_fallen_silent_were_no_fault() {
    let mut bench = Bench::new();
    assert_eq!(bench.see().instruments[0].verdict.level, Level::Unknown);
    for _ in 0..8 {
        bench.heartbeats(5);
        bench.cycle([1000, 1000], [1, 1]);
        bench.wait(100);
    }
    bench.wait(5000);
    let verdict = &bench.see().instruments[0].verdict;
    assert_eq!(verdict.level, Level::Fault, "{}", verdict.text);
}

#[test]
fn slopes_of_0_1_deg_were_shown_as_a_tenth_of_the_angle_and_ok() {
    let mut bench = Bench::new();
    for _ in 0..8 {
        // 30 deg in 0.1 deg.
        bench.cycle([300, 300], [1, 1]);
        bench.take(0x381, &angle(30_000));
        bench.take(0x382, &angle(30_000));
    }
    let instrument = &bench.see().instruments[0];
    for channel in &instrument.channels {
        assert_eq!(channel.slope_x_deg, None);
        assert!(channel.slope_reason(0).contains("--eds"));
    }
    assert_eq!(instrument.difference_x_deg, Some(0.0));
    let verdict = &instrument.verdict;
    assert_eq!(verdict.level, Level::Warning);
    let text = "slopes of A and B: another unit (6000h) than taken: state it by --eds";
    assert!(verdict.text.starts_with(text), "{}", verdict.text);
    let told = bench.texts();
    assert!(
        told.iter()
            .any(|text| text.starts_with("A first of: slopes in another unit"))
    );
}

#[test]
fn what_a_mapping_does_not_have_was_0_deg_c_0_ms_and_not_compared() {
    let mapped = |id: u8| {
        let mut node = NodePlan::as_delivered(id);
        let id = u16::from(id);
        node.pdos[0] = PdoPlan::of(0x180 + id, 1, &[0x6010_0010, 0x6020_0010]);
        node.pdos[1] = PdoPlan::of(0x280 + id, 10, &[0x2022_0310]);
        node
    };
    let plan = Plan {
        nodes: vec![mapped(1), mapped(2)],
        ..Plan::default()
    };
    let mut bench = Bench::of(&plan);
    for id in [1, 2] {
        bench.take(0x180 + id, &[100, 0, 0, 0]);
        bench.take(0x280 + id, &[20, 0]);
    }
    let instrument = &bench.see().instruments[0];
    let channel = &instrument.channels[0];
    assert_eq!((channel.slope_x_deg, channel.state), (Some(1.0), None));
    assert_eq!(channel.uncertainty_deg, Some(0.04));
    assert_eq!((channel.latency_ms, channel.temperature_degc), (None, None));
    let text = "no verdict: the state of the pair (2021h) is not sent";
    assert_eq!(instrument.verdict.text, text);
    assert_eq!(instrument.verdict.level, Level::Unknown);
    assert!(bench.texts().is_empty(), "{:?}", bench.texts());
}

#[test]
fn a_sound_pair_shows_its_angles_its_difference_and_its_band() {
    let mut bench = Bench::new();
    bench.heartbeats(5);
    for _ in 0..120 {
        bench.cycle([1000, 998], [1, 1]);
    }
    for id in [0x281, 0x282] {
        bench.take(id, &[0x7F, 1, 30, 0, 36, 20, 0, 25]);
    }
    let seen = bench.see();
    let instrument = &seen.instruments[0];
    assert_eq!(instrument.channels[0].slope_x_deg, Some(10.0));
    assert_eq!(instrument.difference_x_deg, Some(0.02));
    // Twice the root of 0.03^2 + 0.03^2.
    assert!((instrument.band_deg.unwrap() - 0.084_85).abs() < 1e-4);
    assert_eq!(instrument.inside_band, Some(true));
    assert_eq!(instrument.verdict.level, Level::Good);
    assert_eq!(instrument.verdict.text, "both agree");
    assert_eq!(bench.channel(1).temperature_degc, Some(25));
    assert_eq!(bench.channel(1).latency_ms, Some(36));
    assert_eq!(bench.channel(1).uncertainty_deg, Some(0.06));
    assert_eq!(bench.channel(0).validity_text.as_deref(), Some("valid"));
    assert_eq!((seen.bus.syncs_per_s, seen.bus.frames_per_s), (100, 300));
    let load = seen.bus.load_percent.unwrap();
    assert!((10.0..14.0).contains(&load), "{load}");
}

#[test]
fn fresh_slopes_that_come_without_validity_were_shown_as_stale() {
    let mut node = NodePlan::as_delivered(1);
    node.pdos[0] = PdoPlan::of(0x181, 1, &[0x6010_0010, 0x6020_0010]);
    let mut bench = Bench::of(&Plan {
        nodes: vec![node],
        ..Plan::default()
    });
    bench.heartbeats(5);
    bench.take(0x80, &[]);
    bench.take(0x181, &[100, 0, 0, 0]);
    let channel = bench.channel(0);
    assert_eq!((channel.slope_x_deg, channel.stale), (Some(1.0), false));
    assert_eq!(channel.validity, None);
    assert_eq!(channel.validity_text.as_deref(), Some("not sent"));
}

#[test]
fn what_is_old_is_never_a_number() {
    let mut bench = Bench::new();
    bench.heartbeats(5);
    for _ in 0..10 {
        bench.cycle([1000, 998], [1, 1]);
    }
    bench.wait(950);
    assert_eq!(bench.channel(0).slope_x_deg, Some(10.0));
    bench.wait(100);
    let channel = bench.channel(0);
    assert_eq!((channel.slope_x_deg, channel.state), (None, None));
    assert!(channel.stale);
    let reason = channel.slope_x_reason.unwrap();
    assert!(reason.starts_with("stale, 1.1 s old: "), "{reason}");
    assert!(reason.ends_with("there is no SYNC"), "{reason}");
    let seen = bench.see();
    assert_eq!(seen.instruments[0].difference_x_deg, None);
    assert_eq!(seen.instruments[0].verdict.level, Level::Unknown);
    assert!(seen.instruments[0].difference_reason.is_some());
}

#[test]
fn slow_syncs_do_not_make_angles_stale_between_them() {
    let mut bench = Bench::new();
    for _ in 0..4 {
        bench.cycle([5, 5], [1, 1]);
        bench.wait(1990);
    }
    bench.wait(2000);
    assert_eq!(bench.channel(0).slope_x_deg, Some(0.05));
    bench.wait(2100);
    assert_eq!(bench.channel(0).slope_x_deg, None);
}

#[test]
fn a_heartbeat_that_stops_is_lost_and_before_the_first_nothing_is() {
    let mut bench = Bench::new();
    bench.wait(60_000);
    assert!(!bench.channel(0).heartbeat_lost);
    for _ in 0..5 {
        bench.heartbeats(5);
        bench.wait(200);
    }
    for _ in 0..4 {
        bench.take(0x701, &[5]);
        bench.wait(200);
    }
    assert!(!bench.channel(0).heartbeat_lost);
    assert!(bench.channel(1).heartbeat_lost);
    let lost = "B heartbeat lost: none for 0.6 s";
    assert!(
        bench.texts().contains(&lost.to_owned()),
        "{:?}",
        bench.texts()
    );
    bench.take(0x702, &[5]);
    assert!(!bench.channel(1).heartbeat_lost);
    let again = "B heartbeat is there again";
    assert!(bench.texts().contains(&again.to_owned()));
}

#[test]
fn a_node_that_has_restarted_shows_no_angle_of_before() {
    let mut bench = Bench::new();
    bench.cycle([1000, 998], [1, 1]);
    bench.take(0x082, &[0x13, 0xFF, 0x80, 0, 0x10, 0, 0, 6]);
    assert_eq!(
        bench.channel(1).faults[0].text,
        "the channels differ for too long"
    );
    bench.wait(30);
    bench.take(0x702, &[0]);
    bench.take(0x702, &[127]);
    let channel = bench.channel(1);
    assert_eq!((channel.slope_x_deg, channel.boots), (None, 1));
    let reason = channel.slope_x_reason.unwrap();
    assert_eq!(reason, "it is pre-operational, start it (NMT)");
    assert!(channel.faults.is_empty());
    assert_eq!(bench.channel(0).slope_x_deg, Some(10.0));
}

#[test]
fn the_blamed_channel_and_the_reason_are_named() {
    let mut bench = Bench::new();
    bench.cycle([1000, 998], [1, 1]);
    // B finds that it is faulty: faults 13 and 21, own blame, gravity of the wrong length.
    bench.take(0x082, &[0x08, 0xFF, 0x80, 0, 0x20, 0x20, 0x40 | 13, 7]);
    bench.cycle([1000, i16::MIN], [8, 7]);
    let seen = bench.see();
    let verdict = &seen.instruments[0].verdict;
    assert_eq!(verdict.text, "channel B is faulty");
    assert_eq!(verdict.blamed, ["B"]);
    let why = "moved alone, or gravity of the wrong length";
    assert_eq!(verdict.reason.as_deref(), Some(why));
    let channel = bench.channel(1);
    assert_eq!(
        channel.slope_x_reason.as_deref(),
        Some("this channel is faulty")
    );
    assert_eq!(channel.faults.len(), 2);
    let texts = bench.texts().join("\n");
    assert!(
        texts.contains(
            "B EMCY FF08h: this channel moved alone, or its gravity is of the wrong length"
        )
    );
    // TPDO 3 has it for each axis.
    bench.take(0x382, &[0, 0, 0, 0, 0, 0, 13, 13]);
    assert_eq!(bench.channel(1).slope_x_reason.as_deref(), Some(why));
    assert_eq!(
        seen.instruments[0].difference_reason.as_deref(),
        Some("no angle of B")
    );
}

#[test]
fn what_has_gone_is_named_in_the_event() {
    let mut bench = Bench::new();
    bench.take(0x081, &[0x13, 0xFF, 0x80, 0, 0x10, 0, 0, 6]);
    bench.take(0x081, &[0, 0, 0, 0, 0, 0, 0, 1]);
    let texts = bench.texts();
    let gone = "A gone: the channels differ for too long";
    assert_eq!(texts.last().map(String::as_str), Some(gone));
    assert!(bench.channel(0).faults.is_empty());
}

#[test]
fn a_fault_that_goes_while_another_comes_was_not_named() {
    let mut bench = Bench::new();
    bench.take(0x081, &[0x13, 0xFF, 0x80, 0, 0x10, 0, 0, 6]);
    // The peer is faulty instead: the new one is told first, and its set has the old one no more.
    bench.take(0x081, &[0x15, 0xFF, 0x80, 0, 0x40, 0, 0x80 | 13, 8]);
    bench.take(0x081, &[0, 0, 0x80, 0, 0x40, 0, 0x80 | 13, 8]);
    let texts = bench.texts();
    let gone = "A gone: the channels differ for too long";
    assert_eq!(texts.last().map(String::as_str), Some(gone));
}

#[test]
fn channels_that_see_the_pair_differently_are_both_heard() {
    let mut bench = Bench::new();
    bench.cycle([0, 0], [1, 2]);
    let verdict = bench.see().instruments[0].verdict.clone();
    assert_eq!(verdict.level, Level::Warning);
    let expected = "A reports: both agree; B reports: the channels differ for a short time";
    assert_eq!(verdict.text, expected);
    let told = bench.texts();
    assert!(told.contains(&"B the channels differ for a short time".to_owned()));
}

#[test]
fn one_channel_that_falls_silent_is_named_with_the_cause() {
    let mut bench = Bench::new();
    for _ in 0..10 {
        bench.heartbeats(5);
        bench.cycle([0, 0], [1, 1]);
    }
    for _ in 0..200 {
        bench.take(0x701, &[5]);
        bench.take(0x80, &[]);
        bench.take(0x181, &[0, 0, 0, 0, 0x7F, 8]);
        bench.wait(10);
    }
    let verdict = bench.see().instruments[0].verdict.clone();
    assert_eq!(verdict.level, Level::Fault);
    let start = "channel B is faulty; nothing from B: stale, 2.0 s old: its heartbeat is lost";
    assert_eq!(verdict.text, start);
    assert_eq!(verdict.blamed, ["B"]);
}

#[test]
fn silence_of_the_bus_is_told_and_its_end_too() {
    let mut bench = Bench::new();
    assert_eq!(bench.see().bus.state, SourceState::Waiting);
    bench.take(0x80, &[]);
    assert_eq!(bench.see().bus.state, SourceState::Running);
    bench.model.advise(Some("is the bus powered?".to_owned()));
    bench.wait(12_500);
    let bus = bench.see().bus;
    assert_eq!(bus.state, SourceState::Silent);
    let text = bus.state_text.unwrap();
    assert_eq!(text, "nothing has come for 12 s: is the bus powered?");
    bench.take(0x80, &[]);
    let texts = bench.texts();
    let again = "- received again after 12.5 s";
    assert_eq!(texts.iter().filter(|text| *text == again).count(), 1);
}

#[test]
fn a_gap_in_a_log_is_shown_without_waiting_for_it() {
    let mut bench = Bench::new();
    bench.cycle([0, 0], [1, 1]);
    bench.time_ms += 3_600_000;
    bench.cycle([0, 0], [1, 1]);
    let again = "- received again after 3600.0 s";
    assert!(
        bench.texts().contains(&again.to_owned()),
        "{:?}",
        bench.texts()
    );
    assert_eq!(bench.channel(0).slope_x_deg, Some(0.0));
}

#[test]
fn time_that_goes_back_makes_nothing_fresh() {
    let mut bench = Bench::new();
    bench.heartbeats(5);
    bench.cycle([1000, 1000], [1, 1]);
    bench.time_ms -= 500_000;
    bench.take(0x80, &[]);
    let seen = bench.see();
    assert_eq!(seen.instruments[0].channels[0].slope_x_deg, None);
    assert_eq!(seen.instruments[0].difference_x_deg, None);
    assert_eq!(seen.bus.backwards, 1);
    assert!(
        bench
            .texts()
            .iter()
            .any(|text| text.contains("goes back by 500"))
    );
    bench.cycle([1100, 1000], [1, 1]);
    assert_eq!(bench.see().instruments[0].difference_x_deg, Some(1.0));
}

#[test]
fn strangers_and_malformed_frames_are_counted_and_told_once() {
    let mut bench = Bench::new();
    for _ in 0..5 {
        bench.take(0x705, &[5]);
        bench.take(0x182, &[1, 2]);
        bench.wait(10);
    }
    let long = Frame::with(ExtendedId::new(0x181).unwrap(), &[1; 6]).unwrap();
    bench.model.take(bench.time_ms * MS, &long);
    let bus = bench.see().bus;
    assert_eq!((bus.malformed, bus.others), (5, 6));
    let texts = bench.texts();
    assert_eq!(texts.len(), 2, "{texts:?}");
    assert_eq!(texts[0], "- node 5 is also on the bus and is not monitored");
    let second = bench.model.events.since(1).next().unwrap().clone();
    assert_eq!((second.kind, second.times), (Kind::Stranger, 5));
}

#[test]
fn what_does_not_fit_together_is_counted_and_told_once() {
    let mut bench = Bench::new();
    for _ in 0..3 {
        bench.take(0x80, &[]);
        // By the validity both may be used, and X is none.
        bench.take(0x181, &[0, 0x80, 0, 0, 0x7F, 1]);
        bench.wait(10);
    }
    let findings = bench.channel(0).findings;
    assert_eq!((findings[0].name, findings[0].count), ("validity", 3));
    let told = "A first of: slopes that contradict their validity bit";
    let texts = bench.texts();
    assert_eq!(
        texts.iter().filter(|text| *text == told).count(),
        1,
        "{texts:?}"
    );
}

#[test]
fn without_a_bit_rate_there_is_no_load_but_a_reason() {
    let mut model = Model::new(&Plan::default(), Setup::default());
    model.take(0, &Frame::data_frame(0x80, &[]));
    let bus = moment::snapshot(&model).bus;
    assert_eq!(bus.load_percent, None);
    assert!(bus.load_reason.unwrap().contains("--bitrate"));
}

#[test]
fn two_instruments_are_told_apart() {
    let plan = Plan::of(vec![[1, 2], [3, 4]]);
    let mut model = Model::new(&plan, Setup::default());
    model.take(0, &Frame::data_frame(0x80, &[]));
    model.take(1, &Frame::data_frame(0x183, &[100, 0, 0, 0, 0x7F, 1]));
    model.take(
        2,
        &Frame::data_frame(0x084, &[0x13, 0xFF, 0x80, 0, 0x10, 0, 0, 6]),
    );
    let seen = moment::snapshot(&model);
    assert_eq!(seen.instruments[0].channels[0].slope_x_deg, None);
    assert_eq!(seen.instruments[1].channels[0].slope_x_deg, Some(1.0));
    assert_eq!(seen.instruments[1].channels[1].faults.len(), 1);
    let event = model.events.since(0).last().unwrap().clone();
    assert_eq!((event.instrument, event.channel), (Some(2), Some("B")));
}

#[test]
fn a_snapshot_is_one_json_object_that_names_itself_first() {
    let text = serde_json::to_string(&Bench::new().see()).unwrap();
    let start = r#"{"format":"plumb-monitor","version":1,"record":"state","#;
    assert!(text.starts_with(start), "{text}");
    assert!(text.contains(r#""slope_x_deg":null"#));
    assert!(!text.contains("NaN"));
}

proptest! {
    /// Any frames at any times: no panic, a snapshot with a form in JSON, bounded lists, and no
    /// angle that nobody has sent.
    #[test]
    fn whatever_comes_the_model_keeps_its_word(
        frames in prop::collection::vec(
            (
                any::<u64>(),
                0_u64..3_000_000_000,
                prop_oneof![0_u16..0x800, 0x180_u16..0x184, 0x281_u16..0x283, 0x700_u16..0x704],
                prop::collection::vec(any::<u8>(), 0..9),
            ),
            0..200,
        ),
        jumps in any::<bool>(),
    ) {
        let mut model = Model::new(&Plan::default(), Setup::default());
        let mut time_ns = 0_u64;
        let mut sent = false;
        for (any_ns, step_ns, id, bytes) in frames {
            time_ns = if jumps { any_ns } else { time_ns.saturating_add(step_ns) };
            sent |= matches!(id, 0x181 | 0x182);
            model.take(time_ns, &Frame::data_frame(id, &bytes));
            model.pass(time_ns.saturating_add(step_ns));
            let seen = moment::snapshot(&model);
            for channel in &seen.instruments[0].channels {
                prop_assert!(sent || channel.slope_x_deg.is_none());
                prop_assert_eq!(channel.slope_x_deg.is_none(), channel.slope_x_reason.is_some());
                prop_assert_eq!(channel.slope_y_deg.is_none(), channel.slope_y_reason.is_some());
            }
        }
        prop_assert!(model.events.since(0).count() <= 1000);
        let text = serde_json::to_string(&moment::snapshot(&model)).unwrap();
        prop_assert!(serde_json::from_str::<serde_json::Value>(&text).is_ok());
        super::plain::state(&moment::snapshot(&model));
    }
}
