//! The summary of logs as one JSON object.
//!
//! In: what the logs have come to ([`Contents`]). Out: an object that serde writes. It is a
//! projection of the totals, as the text is; each field is described in `docs/logs.md`.

use serde::Serialize;

use super::contents::{Contents, faults, seconds, states};
use crate::totals::{ChannelSummary, Collected, Instrument, Last, Tally};
use bus_logs::Tally as Lines;
use output::object;

/// Name of the format, the field `format`.
const FORMAT: &str = "plumb-log";
/// Version of the format. It rises when a field changes its meaning or goes away.
const VERSION: u32 = 2;

/// All of it.
pub fn of(contents: &Contents) -> impl Serialize {
    let (source, skipped) = (contents.source, contents.source.skipped());
    let name = |file: &usize| source.name(*file);
    let lines = |kind: &'static str, words: &'static str, lines: Lines| {
        object! {
            kind: kind,
            words: words,
            count: lines.count,
            first_file: name(&lines.file),
            first_line: lines.line,
        }
    };
    let kinds = skipped.kinds();
    let kinds = kinds.map(|(kind, of)| lines(kind.name(), kind.words(), of));
    let backwards = contents.backwards();
    let damaged = skipped.damaged.iter();
    let damaged = damaged.map(|(file, how)| object! { file: name(file), why: how.words() });
    let buses = contents.buses.iter();
    object! {
        format: FORMAT,
        version: VERSION,
        files: source.files(),
        frames: source.frames(),
        skipped: kinds.collect::<Vec<_>>(),
        backwards: backwards.map(|(words, of)| lines("backwards", words, of)),
        damaged: damaged.collect::<Vec<_>>(),
        not_logs: &skipped.not_logs,
        overlapping_files: skipped.overlapping,
        undated_files: skipped.undated.iter().map(name).collect::<Vec<_>>(),
        outside: contents.outside,
        interfaces: buses.map(|(name, bus)| interface(name, bus)).collect::<Vec<_>>(),
        devices: &contents.devices,
        export: &contents.export,
    }
}

fn interface(name: &str, bus: &Collected) -> impl Serialize {
    let (counts, traffic) = (&bus.counts, &bus.traffic);
    let (first_ns, last_ns) = traffic.span_ns().unwrap_or_default();
    let instruments = bus.instruments.iter();
    object! {
        interface: name,
        // Since 1970, or since the start of a log without a date.
        first_time_s: seconds(first_ns),
        last_time_s: seconds(last_ns),
        frames: counts.frames,
        syncs: counts.syncs,
        malformed: counts.malformed,
        undated: bus.undated,
        other_clock: traffic.by_other_clock(),
        others: object! {
            frames: counts.others,
            nmt: counts.nmt,
            sdo: counts.sdo,
            services: counts.services,
            unplanned: counts.unplanned,
            strangers: counts.strangers,
            extended: counts.extended,
            remote: counts.remote,
            node_ids: &bus.strangers,
        },
        holes: traffic.gaps.count(),
        longest_hole_s: seconds(traffic.gaps.longest_ns()),
        instruments: instruments.map(|(last, one)| instrument(last, one)).collect::<Vec<_>>(),
    }
}

fn instrument([last_a, last_b]: &[Last; 2], one: &Instrument) -> impl Serialize {
    let [a, b] = &one.summary.channels;
    object! {
        nodes: [node(last_a, a), node(last_b, b)],
        delta: one.summary.difference.own.each_ref().map(spread),
    }
}

fn node(last: &Last, channel: &ChannelSummary) -> impl Serialize {
    let temperature_degc = channel.temperature.extremes();
    let uncertainty_mdeg = channel.uncertainty.extremes();
    let states = states(channel).map(|(state, words, count)| {
        object! { state: state, words: words, count: count }
    });
    let findings = channel.checks.found().map(|(check, finding)| {
        object! {
            check: check.name(),
            words: check.words(),
            count: finding.count,
            first_time_s: seconds(finding.first_ns),
        }
    });
    let faults = faults(last, channel).map(|(fault, stands)| {
        object! {
            fault: fault as u8,
            code: fault.report().0,
            text: fault.text(),
            stands: stands,
        }
    });
    object! {
        node_id: last.node_id,
        seen: last.seen,
        readings: channel.readings,
        slope_x: spread(&channel.slope[0]),
        slope_y: spread(&channel.slope[1]),
        largest_uncertainty_deg: uncertainty_mdeg.map(|(_, most)| f64::from(most) / 1000.0),
        lowest_temperature_degc: temperature_degc.map(|(least, _)| least),
        highest_temperature_degc: temperature_degc.map(|(_, most)| most),
        states: states.collect::<Vec<_>>(),
        findings: findings.collect::<Vec<_>>(),
        heartbeats_lost: channel.heartbeat_losses,
        heartbeat_is_lost: last.heartbeat_is_lost,
        boots: channel.boots,
        emergencies: channel.emergencies.values().sum::<u64>(),
        faults: faults.collect::<Vec<_>>(),
    }
}

fn spread(of: &Tally) -> impl Serialize + use<> {
    let extremes = of.extremes();
    object! {
        count: of.count(),
        min_deg: extremes.map(|(least, _)| f64::from(least) / 1000.0),
        mean_deg: of.mean_angle().map(|mdeg| mdeg / 1000.0),
        max_deg: extremes.map(|(_, most)| f64::from(most) / 1000.0),
        rms_deg: of.rms().map(|mdeg| mdeg / 1000.0),
    }
}
