//! Reports of instruments that are not as delivered: another unit of slopes, other mappings.

use canopen::Frame;

use super::bench::{START_NS, Site};
use super::data::{ChannelReport, PeriodReport};
use super::{build, page};
use crate::totals::Collector;
use listen::{NodePlan, PdoPlan, Plan};

fn report(frames: &[(u64, Frame)], plan: &Plan) -> PeriodReport {
    let mut collector = Collector::new(plan);
    for (at_ns, frame) in frames {
        collector.take(START_NS + at_ns, frame);
    }
    let mut report = build::report(&[("can0".to_owned(), collector.finish())], None, None);
    build::conclude(&mut report);
    report
}

/// 6000h of both nodes, 0.001 deg.
fn set_unit(site: &mut Site, mdeg: u8) {
    for id in [0x601, 0x602] {
        site.send(id, &[0x2B, 0x00, 0x60, 0, mdeg, 0, 0, 0]);
        site.run_ms(100);
    }
}

fn units_found(channel: &ChannelReport) -> u64 {
    let mut findings = channel.findings.iter();
    let found = findings.find(|finding| finding.check == "unit");
    found.map_or(0, |finding| finding.count)
}

#[test]
fn slopes_of_0_1_deg_were_reported_as_a_tenth_of_the_angle() {
    let mut site = Site::working();
    site.tilt(20.0, -10.0);
    site.run_ms(3000);
    set_unit(&mut site, 100);
    let set = site.frames.len();
    site.run_ms(3000);
    let still = report(&site.frames[set..], &Plan::default());
    site.tilt(-20.0, 10.0);
    site.run_ms(3000);
    for report in [still, report(&site.frames[set..], &Plan::default())] {
        for channel in &report.instruments[0].channels {
            let used = channel.slopes[0].values.count;
            assert!(used <= 5, "{used} slopes were used");
            assert!(units_found(channel) > 250);
            let unusable = &channel.unusable[0];
            assert!(unusable.other_unit && unusable.time_s > 2.5, "{unusable:?}");
            assert!(unusable.reason_text.as_ref().unwrap().contains("--eds"));
        }
        assert!(page::page(&report).contains("state it by --eds"));
    }
}

#[test]
fn an_instrument_that_turns_and_is_zeroed_has_the_unit_that_it_has() {
    let mut site = Site::working();
    for (roll, pitch) in [(20.0, -15.0), (-20.0, 15.0), (10.0, 40.0), (0.0, 0.0)] {
        site.tilt(roll, pitch);
        // While it turns.
        site.run_ms(1000);
        // 6012h and 6022h, of both nodes at once.
        for index in [0x12, 0x22] {
            for id in [0x601, 0x602] {
                site.send(id, &[0x2B, index, 0x60, 0, 0, 0, 0, 0]);
            }
            site.run_ms(20);
        }
        site.run_ms(4000);
    }
    let report = report(&site.frames, &Plan::default());
    for channel in &report.instruments[0].channels {
        assert_eq!(units_found(channel), 0);
        assert!(channel.slopes[0].values.count > 1000);
    }
}

#[test]
fn an_instrument_without_temperature_and_state_was_at_0_deg_c_and_not_compared() {
    let mapped = |id: u8| {
        let mut node = NodePlan::as_delivered(id);
        let id = u16::from(id);
        node.pdos[0] = PdoPlan::of(0x180 + id, 1, &[0x6110_0020, 0x6120_0020]);
        node.pdos[1] = PdoPlan::of(0x280 + id, 10, &[0x2022_0310]);
        node
    };
    let plan = Plan {
        nodes: vec![mapped(1), mapped(2)],
        ..Plan::default()
    };
    let mut frames = Vec::new();
    for round in 0..100_u64 {
        let mut see = |id: u16, bytes: &[u8]| {
            let at_ns = round * 10_000_000 + u64::from(id) * 1000;
            frames.push((at_ns, Frame::data_frame(id, bytes)));
        };
        see(0x080, &[]);
        for id in [1, 2] {
            // From half of the time on there is no angle.
            let slope = if round < 50 {
                [100, 0, 0, 0]
            } else {
                [0, 0, 0, 0x80]
            };
            see(0x180 + id, &[slope, slope].concat());
            see(0x280 + id, &[20, 0]);
        }
    }
    let report = report(&frames, &plan);
    let channel = &report.instruments[0].channels[0];
    assert_eq!(
        (channel.temperature.count, channel.uncertainty.count),
        (0, 100)
    );
    assert_eq!(channel.temperature.min, None);
    let why = &channel.unusable[0];
    assert_eq!((why.state, why.state_text.as_str()), (None, "not sent"));
}
