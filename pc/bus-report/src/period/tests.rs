//! A report from the frames of a virtual instrument, from end to end.

use std::sync::LazyLock;

use canopen::Frame;

use super::bench::{START_NS, Site, candump};
use super::data::PeriodReport;
use super::*;
use crate::totals::join::Join;
use crate::totals::{Collector, bins};
use bus_logs::Moment;
use listen::{NodePlan, Plan};
use output::check;

/// Two hours' worth of what can happen, in half a minute: motion, a loose board on channel B that
/// is mended, channel A without supply, a gap.
fn frames() -> &'static Vec<(u64, Frame)> {
    static FRAMES: LazyLock<Vec<(u64, Frame)>> = LazyLock::new(|| {
        let mut site = Site::working();
        site.tilt(20.0, -10.0);
        site.run_ms(4000);
        site.loosen(1, 0.05);
        site.run_ms(3000);
        site.loosen(1, 0.0);
        site.run_ms(1000);
        site.send(0, &[129, 0]);
        site.run_ms(1500);
        site.send(0, &[1, 0]);
        site.run_ms(3000);
        site.network.power_off(0);
        site.run_ms(3000);
        site.network.power_on(0);
        site.run_ms(1000);
        site.send(0, &[1, 0]);
        site.run_ms(3000);
        site.frames
    });
    &FRAMES
}

fn collected(frames: &[(u64, Frame)], part: PartOptions) -> PeriodReport {
    let mut part = part.part().unwrap();
    let mut collector = Collector::new(&Plan::default());
    for (at_ns, frame) in frames {
        if part.has(START_NS + at_ns) {
            collector.take(START_NS + at_ns, frame);
        } else {
            collector.pass_over();
        }
    }
    finished(collector, Some(250e3))
}

fn finished(collector: Collector, bit_rate: Option<f64>) -> PeriodReport {
    let collected = [("can0".to_owned(), collector.finish())];
    let mut report = build::report(&collected, None, bit_rate);
    build::conclude(&mut report);
    report
}

fn report() -> &'static PeriodReport {
    static REPORT: LazyLock<PeriodReport> =
        LazyLock::new(|| collected(frames(), PartOptions::default()));
    &REPORT
}

#[test]
fn a_loose_board_and_a_lost_supply_are_told_with_node_time_and_end() {
    let [instrument] = &report().instruments[..] else {
        panic!("one instrument");
    };
    let told = |code: &str| {
        let events = instrument.events.iter();
        events
            .filter(|event| event.code.as_deref() == Some(code))
            .collect::<Vec<_>>()
    };
    let disagree = [told("FF13h"), told("FF14h"), told("FF15h")].concat();
    assert!(!disagree.is_empty(), "{:#?}", instrument.events);
    let silent = told("FF15h");
    assert!(
        silent
            .iter()
            .any(|event| event.channel == "B" && event.blamed.as_deref() == Some("A"))
    );
    assert!(instrument.channels[0].heartbeat_losses > 0);
    assert_eq!(instrument.channels[1].heartbeat_losses, 0);
    let restarts = instrument
        .events
        .iter()
        .filter(|event| event.kind == "restart");
    assert!(restarts.count() >= 2);
    assert!(verdict::incidents_of(instrument) >= 2);
    assert!(!report().clean);
}

#[test]
fn replay_and_report_counted_the_lost_heartbeats_of_one_log_differently() {
    let mut watch = listen::Watch::new(&Plan::default());
    for (at_ns, frame) in frames() {
        watch.take(START_NS + at_ns, frame);
    }
    let replayed = watch.pairs()[0].sides.each_ref();
    let replayed = replayed.map(|side| u64::from(side.heartbeat.losses()));
    let channels = report().instruments[0].channels.iter();
    let reported: Vec<_> = channels.map(|channel| channel.heartbeat_losses).collect();
    assert_eq!(reported, replayed);
}

#[test]
fn a_fault_has_the_syncs_around_it_from_the_log() {
    let instrument = &report().instruments[0];
    let plot = &instrument.plots[0];
    assert_eq!(plot.rows.len(), 48);
    assert!(plot.rows[31].since_s <= 0.02 && plot.rows[0].since_s < -0.25);
    let last = plot.rows[47]
        .difference_x_deg
        .or(plot.rows[47].difference_y_deg);
    assert!(last.is_some_and(|deg| deg.abs() > 0.5), "{plot:#?}");
}

#[test]
fn angles_are_those_of_the_housing() {
    let slope = &report().instruments[0].channels[1].slopes[0];
    // For some SYNCs the loose board is believed: the greatest value is off by that.
    let [least, .., most] = &slope.values.percentiles[..] else {
        panic!("percentiles");
    };
    assert!((most.value_deg - 20.0).abs() < 0.3, "{slope:?}");
    assert!(least.value_deg.abs() < 0.3);
    let difference = &report().instruments[0].difference;
    assert!(difference.slopes[0].values.percentiles[2].value_deg.abs() < 0.1);
    assert!(difference.syncs_measured > 1000);
    assert!(difference.judged > 0 && difference.above < difference.judged);
    assert!(
        difference.told_off_mean_deg.unwrap() < 0.02,
        "{difference:?}"
    );
}

#[test]
fn a_pdo_of_the_exchange_with_another_cob_id_was_taken_for_the_other_one() {
    let mut plan = Plan {
        nodes: [1, 2].map(NodePlan::as_delivered).into(),
        ..Plan::default()
    };
    // TPDO 3 and TPDO 4 change their identifiers.
    for pdo in plan.nodes.iter_mut().flat_map(|node| &mut node.pdos) {
        pdo.cob_id = swapped(pdo.cob_id);
    }
    let mut collector = Collector::new(&plan);
    for (at_ns, frame) in frames() {
        let cob_id = frame.cob_id().expect("11 bit");
        let frame = Frame::data_frame(swapped(cob_id), frame.bytes());
        collector.take(START_NS + at_ns, &frame);
    }
    let other = finished(collector, None);
    let [one, other] = [report(), &other].map(|report| report.instruments[0].difference.clone());
    assert_eq!(other.syncs_measured, one.syncs_measured);
    assert_eq!((other.judged, other.above), (one.judged, one.above));
}

fn swapped(cob_id: u16) -> u16 {
    match cob_id & 0x780 {
        0x380 => cob_id + 0x100,
        0x480 => cob_id - 0x100,
        _ => cob_id,
    }
}

#[test]
fn time_with_and_without_an_angle_adds_up() {
    for channel in &report().instruments[0].channels {
        let not: f64 = channel.unusable.iter().map(|why| why.time_s).sum();
        let all = channel.usable_s + not;
        assert!((10.0..23.0).contains(&all), "{all}");
        assert!(channel.usable_s > 8.0 && not > 0.5, "{channel:?}");
    }
}

#[test]
fn the_window_leaves_out_what_is_outside() {
    let part = PartOptions {
        from: Some(Moment::At(START_NS + 4_000_000_000)),
        to: Some(Moment::At(START_NS + 6_000_000_000)),
    };
    let report = collected(frames(), part);
    assert!(report.covered_s <= 2.0 && report.covered_s > 1.9);
    assert!(report.buses[0].outside > 1000);
    assert!(report.clean, "{}", report.verdict);
}

#[test]
fn the_load_is_that_of_the_virtual_bus() {
    let load = report().buses[0].load_percent.unwrap();
    assert!((10.0..100.0).contains(&load), "{load}");
}

#[test]
fn the_page_is_whole_and_fetches_nothing() {
    let html = page::page(report());
    check::assert_balanced(&html);
    check::assert_stands_alone(&html);
    for sentence in [
        "What this report cannot show",
        "Incidents per day",
        "Plot 1",
    ] {
        assert!(html.contains(sentence), "{sentence}");
    }
}

#[test]
fn a_log_of_many_days_is_no_larger_than_one_of_a_minute() {
    let day_ns = 86_400_000_000_000;
    let mut collector = Collector::new(&Plan::default());
    // Of every day some seconds; the third and fourth have none.
    for day in (0..60).filter(|day| !matches!(day, 2 | 3)) {
        for (at_ns, frame) in frames().iter().take(6000) {
            collector.take(START_NS + day * day_ns + at_ns, frame);
        }
    }
    let long = finished(collector, None);
    let instrument = &long.instruments[0];
    assert_eq!(instrument.days.len(), 60);
    assert_eq!(instrument.days[2].syncs, 0);
    assert_eq!(instrument.gaps.count, 57);
    assert_eq!(instrument.gaps.longest.len(), 40);
    assert!(instrument.channels[0].slopes[0].bins.len() <= bins::MOST);
    let size = serde_json::to_string(&long).unwrap().len();
    assert!(size < 400_000, "{size}");
    let table = tables::days(instrument);
    assert_eq!(table.rows[2][1].text, "no data");
}

#[test]
fn candump_text_gives_the_same_report() {
    let folder = std::env::temp_dir().join(format!("plumb-period-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("trip.log");
    std::fs::write(&path, candump(frames(), 0)).unwrap();
    let mut collector = Collector::new(&Plan::default());
    let take = |_, at_ns, frame: &Frame| {
        collector.take(at_ns, frame);
    };
    let source = Source::open(&[path], &Progress::hidden()).unwrap();
    let logs = input::read(source, take).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(logs.report.frames, frames().len() as u64);
    let read = finished(collector, Some(250e3));
    assert_eq!(read.instruments[0].days, report().instruments[0].days);
}

/// A report of these frames, one each 10 ms.
fn of_frames(frames: &[Frame]) -> PeriodReport {
    let mut collector = Collector::new(&Plan::default());
    for (number, frame) in (0..).zip(frames) {
        collector.take(START_NS + number * 10_000_000, frame);
    }
    finished(collector, None)
}

const SLOPES: [u8; 6] = [1, 0, 2, 0, 0x7F, 1];

#[test]
fn frames_of_others_are_counted_and_the_identity_is_taken_where_it_passes() {
    use canopen::frame::{ExtendedId, StandardId};

    let data = |id, bytes: &[u8]| Frame::data_frame(id, bytes);
    let serial = [0x43, 0x18, 0x10, 4, 0x2A, 0, 0, 0];
    let report = of_frames(&[
        data(0x181, &SLOPES),
        data(0x181, &SLOPES[..3]),
        data(0x199, &[0; 8]),
        data(0x582, &serial),
        Frame::with(ExtendedId::new(0x181).unwrap(), &SLOPES).unwrap(),
        Frame::remote(StandardId::new(0x701).unwrap(), 1).unwrap(),
        data(0x000, &[1, 0]),
    ]);
    let (bus, instrument) = (&report.buses[0], &report.instruments[0]);
    assert_eq!((bus.frames, bus.extended, bus.remote), (7, 1, 1));
    assert_eq!((bus.commands, bus.malformed), (1, 1));
    let foreign: Vec<_> = bus.foreign.iter().map(|node| node.node_id).collect();
    assert_eq!(foreign, [25]);
    assert_eq!(instrument.channels[1].serial_number, Some(42));
    assert_eq!(instrument.channels[1].vendor_id, None);
    assert_eq!(instrument.channels[0].malformed, 1);
}

#[test]
fn a_channel_of_which_only_its_turns_are_seen_is_seen() {
    let slopes = Frame::data_frame(0x181, &SLOPES);
    let turns = Frame::data_frame(0x402, &[0; 8]);
    let seen_with = |frames: &[Frame]| of_frames(frames).instruments[0].channels[1].seen;
    assert!(!seen_with(&[slopes]));
    assert!(seen_with(&[slopes, turns]));
    let report = of_frames(&[slopes, turns]);
    assert!(report.buses[0].foreign.is_empty());
}

#[test]
fn a_reset_of_communication_takes_no_fault_back_and_one_of_the_node_does() {
    let data = |id, bytes: &[u8]| Frame::data_frame(id, bytes);
    let ends = |command: u8| {
        let disagree = [0x13, 0xFF, 0x81, 0, 0x10, 0, 0, 6];
        let mut frames = vec![
            data(0x181, &SLOPES),
            data(0x182, &SLOPES),
            data(0x181, &SLOPES),
            data(0x081, &disagree),
            data(0x182, &SLOPES),
            data(0x182, &SLOPES),
        ];
        frames.extend([data(0x000, &[command, 1]), data(0x701, &[0])]);
        let report = of_frames(&frames);
        let events = &report.instruments[0].events;
        let kinds: Vec<_> = events.iter().map(|event| event.kind.clone()).collect();
        assert_eq!(kinds, ["disagreement", "restart"]);
        events[0].end.clone()
    };
    assert_eq!(ends(130), "standing");
    assert_eq!(ends(129), "restart");
}

#[test]
fn time_that_goes_backwards_is_told_and_upsets_nothing() {
    let frame = Frame::data_frame(0x181, &SLOPES);
    let mut collector = Collector::new(&Plan::default());
    for at_s in [100, 101, 102, 5, 6, 200, 0] {
        collector.take(at_s * 1_000_000_000, &frame);
    }
    let report = finished(collector, None);
    assert_eq!(report.clock, "relative");
    assert_eq!((report.from_s, report.to_s), (Some(0.0), Some(200.0)));
    assert!((report.covered_s - 3.0).abs() < 1e-9);
    let told = report
        .notes
        .iter()
        .any(|note| note.contains("backwards 2 times"));
    assert!(told, "{:?}", report.notes);
    assert!(
        report.verdict.contains("out of 3 min 20 s"),
        "{}",
        report.verdict
    );
}

#[test]
fn a_log_that_was_appended_to_itself_counts_twice_and_the_page_states_it() {
    let appended = [frames().as_slice(), frames()].concat();
    let twice = collected(&appended, PartOptions::default());
    assert!(twice.covered_s > 1.9 * report().covered_s);
    let told = "Time went backwards 1 time: the clock was set back, or a stretch stands in a log \
                twice and counts twice.";
    assert!(page::page(&twice).contains(told), "{:?}", twice.notes);
}

#[test]
fn a_single_small_time_made_a_whole_log_undated() {
    let frame = Frame::data_frame(0x181, &SLOPES);
    let told = |times_s: &[u64]| {
        let mut collector = Collector::new(&Plan::default());
        for at_s in times_s {
            collector.take(at_s * 1_000_000_000, &frame);
        }
        let report = finished(collector, None);
        let span = [report.from_s, report.to_s].map(Option::unwrap);
        (report.clock, span, report.buses[0].undated)
    };
    let dated = [1_700_000_000.0, 1_700_000_002.0];
    let middle = [1_700_000_000, 1_700_000_001, 1, 1_700_000_002];
    assert_eq!(told(&middle), ("utc".to_owned(), dated, 1));
    let first = [1, 1_700_000_000, 1_700_000_001, 1_700_000_002];
    assert_eq!(told(&first), ("utc".to_owned(), dated, 0));
    // And a single date no dated one of a log that has none.
    let other = [1, 2, 3, 1_700_000_000, 4, 5];
    assert_eq!(told(&other), ("relative".to_owned(), [1.0, 5.0], 0));
}

/// A report in which every list has something.
fn full() -> PeriodReport {
    use super::data::{FindingReport, ForeignNode, LogsReport, Skipped};
    use crate::blackbox::data::MemoryReport;

    let mut report = report().clone();
    report.logs = Some(LogsReport {
        files: vec!["a<b>.log".to_owned()],
        frames: 5,
        skipped: vec![Skipped {
            reason: "lines cut short".to_owned(),
            count: 1,
            file: "a<b>.log".to_owned(),
            first_line: 7,
        }],
        not_logs: vec!["c<d>".to_owned()],
        ..LogsReport::default()
    });
    let finding = FindingReport {
        check: "missed".to_owned(),
        text: "PDOs missing after a SYNC".to_owned(),
        count: 3,
        first_s: 1.5,
    };
    report.instruments[0].channels[1].findings.push(finding);
    report.buses[0].foreign.push(ForeignNode {
        node_id: 9,
        frames: 1,
    });
    let bytes: Vec<u8> = [1, 20, 1, 200].into_iter().chain([0xFF; 20]).collect();
    let path = std::env::temp_dir().join(format!("plumb-fault-log-{}", std::process::id()));
    std::fs::write(&path, bytes).unwrap();
    let mut memory: MemoryReport = crate::blackbox::from_file(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    memory.boxes.push(report.instruments[0].plots[0].clone());
    report.memories.push(memory);
    report.instruments[0].gaps.longest.push(data::GapReport {
        from_s: 1.0,
        to_s: 9.0,
        whole_bus: false,
    });
    report
}

#[test]
fn a_page_with_memories_is_whole_and_names_can_not_upset_it() {
    let html = page::page(&full());
    check::assert_balanced(&html);
    check::assert_stands_alone(&html);
    assert!(html.contains("a&lt;b&gt;.log") && html.contains("Fault memory: "));
}

#[test]
fn every_table_fills_its_columns() {
    let report = full();
    let instrument = &report.instruments[0];
    let all = [
        tables::events(&report, instrument, true),
        tables::events(&report, instrument, false),
        tables::angles(instrument),
        tables::difference(instrument),
        tables::availability(instrument),
        tables::channels(instrument),
        tables::gaps(&report, "Gaps", &instrument.gaps),
        tables::bus(&report.buses[0]),
        tables::findings(&report, instrument),
        tables::files(report.logs.as_ref().unwrap()),
        tables::skipped(report.logs.as_ref().unwrap()),
        crate::blackbox::data::table(&report.memories[0], "Log"),
    ];
    for table in all {
        assert!(!table.rows.is_empty(), "{}", table.title);
        for row in &table.rows {
            assert_eq!(row.len(), table.columns.len(), "{}", table.title);
        }
    }
}

mod documented {
    //! `docs/period-report.md` has every field, and no other.

    use output::check::{documented, keys};

    const DOCUMENT: &str = include_str!("../../../../docs/period-report.md");

    #[test]
    fn every_field_is_documented_and_no_other() {
        let mut found = keys(&super::full());
        found.insert("saved".to_owned());
        let turned = super::collected(super::turned(), super::PartOptions::default());
        found.extend(keys(&turned));
        let documented = documented(DOCUMENT);
        let missing: Vec<_> = found.difference(&documented).collect();
        assert!(missing.is_empty(), "not documented: {missing:?}");
        let stale: Vec<_> = documented.difference(&found).collect();
        assert!(stale.is_empty(), "only documented: {stale:?}");
    }

    #[test]
    fn limits_in_the_document_are_those_of_the_code() {
        use crate::totals::{bins, capture, events, gaps, histogram};

        let words: Vec<&str> = DOCUMENT.split_whitespace().collect();
        let text = words.join(" ");
        for sentence in [
            format!(
                "{} faults and {} other",
                events::MOST_FAULTS,
                events::MOST_OTHERS
            ),
            format!("{} before and {} after", capture::BEFORE, capture::AFTER),
            format!("for {} faults of each", capture::MOST),
            format!("at most {} bins", bins::MOST),
            format!("at most {} steps", histogram::MOST),
            format!("the {} longest", gaps::MOST),
            format!("gaps of more than {} s", listen::GAP_NS / 1_000_000_000),
        ] {
            assert!(text.contains(&sentence), "{sentence}");
        }
    }

    #[test]
    fn every_kind_is_documented() {
        for kind in crate::totals::Kind::ALL {
            assert!(DOCUMENT.contains(&format!("`{}`", kind.key())), "{kind:?}");
        }
    }

    #[test]
    fn it_begins_with_format_and_version() {
        let text = serde_json::to_string(&super::full()).unwrap();
        assert!(text.starts_with("{\"format\":\"plumb-period\",\"version\":1,"));
    }
}

/// A housing with gyroscopes that turns by 20 deg at 20 deg/s.
fn turned() -> &'static Vec<(u64, Frame)> {
    static FRAMES: LazyLock<Vec<(u64, Frame)>> = LazyLock::new(|| {
        let mut site = Site::of(sim::bench::Mode::Dynamic);
        for (index, base) in [(0x04, 0x02), (0x05, 0x03)] {
            for node in [1, 2] {
                // TPDO 5 and 6 are off as delivered (1804h and 1805h sub 1).
                let on = [0x23, index, 0x18, 1, node, base, 0, 0];
                site.send(0x600 + u16::from(node), &on);
                site.run_ms(20);
            }
        }
        site.tilt(20.0, 0.0);
        site.run_ms(3000);
        site.frames
    });
    &FRAMES
}

#[test]
fn angle_now_and_rates_of_turn_are_in_the_report_of_an_instrument_with_a_gyroscope() {
    let report = collected(turned(), PartOptions::default());
    let [instrument] = &report.instruments[..] else {
        panic!("one instrument");
    };
    for channel in &instrument.channels {
        let motion = channel.motion.as_ref().unwrap();
        let [x, y] = &motion.slopes[..] else {
            panic!("two slopes");
        };
        let last = motion.uncertainty.bins.last().unwrap();
        assert!(x.count > 200 && motion.angles >= x.count, "{motion:?}");
        assert!((x.max_deg.unwrap() - 20.0).abs() < 0.5, "{x:?}");
        assert!(y.max_deg.unwrap().abs() < 0.5, "{y:?}");
        assert!(last.2 < 1.0, "{last:?}");
        let size = |dps: Option<f64>| dps.unwrap().abs();
        let rates = motion.rates.iter();
        let sizes = rates.flat_map(|rate| [size(rate.min_dps), size(rate.max_dps)]);
        let fastest = sizes.fold(0.0, f64::max);
        assert!((fastest - 20.0).abs() < 2.0, "{fastest}");
        let most = motion.fastest_bins.iter().map(|bin| bin.2);
        assert_eq!(most.fold(0.0, f64::max), fastest);
    }
    assert_eq!(tables::angles(instrument).rows.len(), 8);
    assert_eq!(tables::rates(instrument).rows.len(), 6);
    let page = page::page(&report);
    check::assert_balanced(&page);
    check::assert_stands_alone(&page);
    assert!(page.contains("Rate of turn about the fastest axis"));
    assert!(page.contains("X now"));
}

/// A fault of this page: rows and charts without a value stood for the TPDO that is not in the log.
#[test]
fn where_only_one_of_tpdo_5_and_6_is_sent_nothing_stands_for_the_other() {
    let shown = |left_out: [u16; 2]| {
        let mut frames = turned().clone();
        frames.retain(|(_, frame)| !left_out.iter().any(|id| frame.cob_id() == Some(*id)));
        let report = collected(&frames, PartOptions::default());
        let instrument = &report.instruments[0];
        let rows = [tables::angles(instrument), tables::rates(instrument)];
        let page = page::page(&report);
        check::assert_balanced(&page);
        assert!(!page.contains("No data:"));
        let texts = ["X now", "of the angle now", "Rate of turn"].map(|text| page.contains(text));
        (rows.map(|table| table.rows.len()), texts)
    };
    assert_eq!(shown([0x201, 0x202]), ([4, 6], [false, false, true]));
    assert_eq!(shown([0x301, 0x302]), ([8, 0], [true, true, false]));
    assert_eq!(shown([0x202, 0x301]), ([6, 3], [true, true, true]));
}

#[test]
fn the_report_of_an_instrument_without_gyroscopes_has_no_motion() {
    let channels = &report().instruments[0].channels;
    assert!(channels.iter().all(|channel| channel.motion.is_none()));
    assert!(!page::page(report()).contains("Rate of turn"));
}

/// The motion of two halves, merged in either order, is that of the whole.
#[test]
fn motion_merges_as_all_else_does() {
    let collect = |frames: &[(u64, Frame)]| {
        let mut collector = Collector::new(&Plan::default());
        for (at_ns, frame) in frames {
            collector.take(START_NS + at_ns, frame);
        }
        let collected = collector.finish();
        let (_, instrument) = collected.instruments.into_iter().next().unwrap();
        instrument.summary
    };
    let (first, second) = turned().split_at(turned().len() / 2);
    let [first, second] = [collect(first), collect(second)];
    let whole = collect(turned());
    for (mut one, other) in [(first.clone(), &second), (second.clone(), &first)] {
        one.join(other);
        for (own, whole) in one.channels.iter().zip(&whole.channels) {
            assert!(own.motion.is_some());
            assert_eq!(own.motion, whole.motion);
        }
    }
}
