//! The summary of logs for people.
//!
//! In: what the logs have come to ([`Contents`]). Out: lines of text.

use std::fmt::Write as _;

use super::contents::{Contents, faults, seconds, states};
use super::foreign::Seen;
use crate::totals::{ChannelSummary, Collected, Instrument, Last, Tally};
use bus_logs::{Skip, Source, Tally as Lines, text_utc};
use output::{plural, printable};

/// The whole text.
pub fn of(contents: &Contents) -> String {
    let mut text = String::new();
    let (source, skipped) = (contents.source, contents.source.skipped());
    let files = match source.files() {
        [one] => printable(one),
        files => format!("{} logs", files.len()),
    };
    let _ = writeln!(text, "{files}: {}", frames(source.frames()));
    for (name, bus) in &contents.buses {
        about_interface(&mut text, name, bus);
    }
    for device in &contents.devices {
        about_device(&mut text, device);
    }
    if contents.outside > 0 {
        let outside = frames(contents.outside);
        let _ = writeln!(text, "Outside --from and --to: {outside}");
    }
    for (kind, lines) in skipped.kinds().filter(|(kind, _)| *kind != Skip::NoFrame) {
        about_lines(&mut text, source, ["Not used", kind.words()], lines);
    }
    if let Some((words, lines)) = contents.backwards() {
        about_lines(&mut text, source, ["Used as they came", words], lines);
    }
    for (file, damage) in &skipped.damaged {
        let file = printable(&source.name(*file));
        let _ = writeln!(text, "{file}: {}", damage.words());
    }
    for file in &skipped.undated {
        let file = printable(&source.name(*file));
        let _ = writeln!(
            text,
            "{file}: has no date; taken as following the log before"
        );
    }
    if skipped.overlapping > 0 {
        let count = skipped.overlapping;
        let _ = writeln!(
            text,
            "Overlap with another log in time and were merged: {count}"
        );
    }
    let not_logs = &skipped.not_logs;
    if !not_logs.is_empty() {
        let names: Vec<_> = not_logs.iter().take(5).map(|n| printable(n)).collect();
        let files = plural(not_logs.len() as u64, "file", "files");
        let _ = writeln!(text, "No logs: {files}, as {}", names.join(", "));
    }
    if let Some(export) = &contents.export {
        let (file, rows) = (printable(&export.file), plural(export.rows, "row", "rows"));
        let _ = writeln!(text, "Written: {file}, {rows}");
    }
    text
}

fn about_device(text: &mut String, seen: &Seen) {
    let device = &seen.device;
    let (product, file) = (printable(&device.product), printable(&device.file));
    let _ = writeln!(text, "\nnode {}: {product}, by {file}", device.node_id);
    for signal in &seen.signals {
        let name = printable(&signal.name);
        let _ = match (signal.min, signal.max) {
            (Some(min), Some(max)) => {
                writeln!(text, "    {name}: {min} to {max} ({} values)", signal.count)
            }
            _ => writeln!(text, "    {name}: not seen"),
        };
    }
    if seen.wrong_length > 0 {
        let _ = writeln!(
            text,
            "    frames too short for their PDO: {}",
            seen.wrong_length
        );
    }
    for warning in &device.warnings {
        let _ = writeln!(
            text,
            "    {file} line {}: {}",
            warning.line,
            printable(&warning.what.to_string())
        );
    }
}

/// A time, by its seconds to the microsecond, as JSON has them.
fn time(ns: u64) -> String {
    text_utc((seconds(ns) * 1e6).round() as u64 * 1000)
}

fn about_lines(text: &mut String, source: &Source, [head, words]: [&str; 2], lines: Lines) {
    let (count, file, line) = (lines.count, source.name(lines.file), lines.line);
    let file = printable(&file);
    let _ = writeln!(
        text,
        "{head}, {words}: {count}, the first in {file} line {line}"
    );
}

fn about_interface(text: &mut String, name: &str, bus: &Collected) {
    let (counts, traffic) = (&bus.counts, &bus.traffic);
    let (first_ns, last_ns) = traffic.span_ns().unwrap_or_default();
    let _ = writeln!(
        text,
        "\n{}: {} in {:.1} s, {} to {}",
        printable(name),
        frames(counts.frames),
        seconds(last_ns) - seconds(first_ns),
        time(first_ns),
        time(last_ns),
    );
    let _ = writeln!(
        text,
        "  {} SYNC, {} of a wrong form, {} of other nodes and services",
        counts.syncs, counts.malformed, counts.others
    );
    if bus.undated > 0 {
        let _ = writeln!(
            text,
            "  {} without a date among frames with one, left out",
            bus.undated
        );
    }
    if traffic.by_other_clock() > 0 {
        let _ = writeln!(
            text,
            "  {} by a clock that was set within the log, used and outside these times",
            frames(traffic.by_other_clock())
        );
    }
    if traffic.gaps.count() > 0 {
        let _ = writeln!(
            text,
            "  nothing at all for more than 2 s: {}, {:.1} s at most",
            times(traffic.gaps.count()),
            seconds(traffic.gaps.longest_ns())
        );
    }
    if !bus.strangers.is_empty() {
        let ids: Vec<_> = bus.strangers.iter().map(u8::to_string).collect();
        let _ = writeln!(text, "  other nodes: {}", ids.join(", "));
    }
    for (last, one) in &bus.instruments {
        about_instrument(text, last, one);
    }
}

fn frames(count: u64) -> String {
    plural(count, "frame", "frames")
}

fn times(count: impl Into<u64>) -> String {
    match count.into() {
        1 => "once".to_owned(),
        count => format!("{count} times"),
    }
}

fn about_instrument(text: &mut String, last: &[Last; 2], one: &Instrument) {
    for (last, channel) in last.iter().zip(&one.summary.channels) {
        about_node(text, last, channel);
    }
    let difference = &one.summary.difference.own;
    if difference.iter().any(|axis| axis.count() > 0) {
        let [a, b] = last;
        let _ = writeln!(text, "  node {} minus node {}", a.node_id, b.node_id);
        about_spreads(text, difference);
    }
}

fn about_node(text: &mut String, last: &Last, channel: &ChannelSummary) {
    if !last.seen {
        let _ = writeln!(text, "  node {}: nothing", last.node_id);
        return;
    }
    let readings = plural(channel.readings, "reading", "readings");
    let _ = writeln!(text, "  node {}: {readings}", last.node_id);
    about_spreads(text, &channel.slope);
    let with_state: u64 = channel.states.iter().sum();
    let without = channel.readings.saturating_sub(with_state);
    let states = states(channel).map(|(_, words, count)| format!("{count} {words}"));
    let states: Vec<_> = states
        .chain((without > 0).then(|| format!("{without} not sent")))
        .collect();
    if !states.is_empty() {
        let _ = writeln!(text, "    states: {}", states.join(", "));
    }
    if channel.heartbeat_losses > 0 {
        let now = match last.heartbeat_is_lost {
            true => ", and at the end",
            false => "",
        };
        let lost = times(channel.heartbeat_losses);
        let _ = writeln!(text, "    heartbeat lost: {lost}{now}");
    }
    for (check, finding) in channel.checks.found() {
        let _ = writeln!(
            text,
            "    does not fit, {}: {}, the first at {}",
            check.words(),
            finding.count,
            time(finding.first_ns)
        );
    }
    for (fault, stands) in faults(last, channel) {
        let (code, words) = (fault.report().0, fault.text());
        let now = if stands { ", stands at the end" } else { "" };
        let _ = writeln!(text, "    EMCY {code:04X}h {words}{now}");
    }
}

fn about_spreads(text: &mut String, axes: &[Tally; 2]) {
    for (axis, of) in ["X", "Y"].iter().zip(axes) {
        let _ = match (of.extremes(), of.mean_angle()) {
            (Some((least, most)), Some(mean)) => {
                let [min, max] = [least, most].map(|mdeg| f64::from(mdeg) / 1000.0);
                let (mean, count) = (mean / 1000.0, of.count());
                writeln!(
                    text,
                    "    {axis} {mean:8.3} deg, {min:.3} to {max:.3} deg ({count} values)"
                )
            }
            _ => writeln!(text, "    {axis} no value that may be used"),
        };
    }
}
