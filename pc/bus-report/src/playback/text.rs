//! The summary of logs for people.
//!
//! In: a [`Report`]. Out: the same as lines of text.

use std::fmt::Write as _;

use super::foreign::Seen;
use super::json::{InstrumentJson, InterfaceJson, NodeJson, Report, SkippedJson, SpreadJson};
use bus_logs::text_utc;
use output::{plural, printable};

/// The whole text.
pub fn of(report: &Report) -> String {
    let mut text = String::new();
    let files = match report.files.as_slice() {
        [one] => printable(one),
        files => format!("{} logs", files.len()),
    };
    let _ = writeln!(text, "{files}: {}", frames(report.frames));
    for interface in &report.interfaces {
        about_interface(&mut text, interface);
    }
    report
        .devices
        .iter()
        .for_each(|device| about_device(&mut text, device));
    if report.outside > 0 {
        let _ = writeln!(text, "Outside --from and --to: {}", frames(report.outside));
    }
    for kind in report
        .skipped
        .iter()
        .filter(|kind| kind.kind != "no_frames")
    {
        about_skipped(&mut text, "Not used", kind);
    }
    if let Some(backwards) = &report.backwards {
        about_skipped(&mut text, "Used as they came", backwards);
    }
    for damaged in &report.damaged {
        let _ = writeln!(text, "{}: {}", printable(&damaged.file), damaged.why);
    }
    for file in &report.undated_files {
        let file = printable(file);
        let _ = writeln!(
            text,
            "{file}: has no date; taken as following the log before"
        );
    }
    if report.overlapping_files > 0 {
        let count = report.overlapping_files;
        let _ = writeln!(
            text,
            "Overlap with another log in time and were merged: {count}"
        );
    }
    if !report.not_logs.is_empty() {
        let names: Vec<_> = report
            .not_logs
            .iter()
            .take(5)
            .map(|n| printable(n))
            .collect();
        let files = plural(report.not_logs.len() as u64, "file", "files");
        let _ = writeln!(text, "No logs: {files}, as {}", names.join(", "));
    }
    if let Some(export) = &report.export {
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

fn ns(seconds: f64) -> u64 {
    // To the microsecond, which such a number of seconds still has.
    (seconds * 1e6).round() as u64 * 1000
}

fn about_skipped(text: &mut String, head: &str, kind: &SkippedJson) {
    let (words, count) = (kind.words, kind.count);
    let (file, line) = (printable(&kind.first_file), kind.first_line);
    let _ = writeln!(
        text,
        "{head}, {words}: {count}, the first in {file} line {line}"
    );
}

fn about_interface(text: &mut String, interface: &InterfaceJson) {
    let _ = writeln!(
        text,
        "\n{}: {} in {:.1} s, {} to {}",
        printable(&interface.interface),
        frames(interface.frames),
        interface.last_time_s - interface.first_time_s,
        text_utc(ns(interface.first_time_s)),
        text_utc(ns(interface.last_time_s)),
    );
    let others = &interface.others;
    let _ = writeln!(
        text,
        "  {} SYNC, {} of a wrong form, {} of other nodes and services",
        interface.syncs, interface.malformed, others.frames
    );
    if interface.undated > 0 {
        let _ = writeln!(
            text,
            "  {} without a date among frames with one, left out",
            interface.undated
        );
    }
    if interface.other_clock > 0 {
        let _ = writeln!(
            text,
            "  {} by a clock that was set within the log, used and outside these times",
            frames(interface.other_clock)
        );
    }
    if interface.holes > 0 {
        let _ = writeln!(
            text,
            "  nothing at all for more than 2 s: {}, {:.1} s at most",
            times(interface.holes),
            interface.longest_hole_s
        );
    }
    if !others.node_ids.is_empty() {
        let ids: Vec<_> = others.node_ids.iter().map(u8::to_string).collect();
        let _ = writeln!(text, "  other nodes: {}", ids.join(", "));
    }
    interface
        .instruments
        .iter()
        .for_each(|one| about_instrument(text, one));
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

fn about_instrument(text: &mut String, one: &InstrumentJson) {
    for node in &one.nodes {
        about_node(text, node);
    }
    if one.delta.iter().any(|spread| spread.count > 0) {
        let [a, b] = &one.nodes;
        let _ = writeln!(text, "  node {} minus node {}", a.node_id, b.node_id);
        for (axis, spread) in ["X", "Y"].iter().zip(&one.delta) {
            about_spread(text, axis, spread);
        }
    }
}

fn about_node(text: &mut String, node: &NodeJson) {
    if !node.seen {
        let _ = writeln!(text, "  node {}: nothing", node.node_id);
        return;
    }
    let readings = plural(node.readings, "reading", "readings");
    let _ = writeln!(text, "  node {}: {readings}", node.node_id);
    about_spread(text, "X", &node.slope_x);
    about_spread(text, "Y", &node.slope_y);
    let with_state: u64 = node.states.iter().map(|state| state.count).sum();
    let without = node.readings.saturating_sub(with_state);
    let states = node.states.iter();
    let states = states.map(|state| format!("{} {}", state.count, state.words));
    let states: Vec<_> = states
        .chain((without > 0).then(|| format!("{without} not sent")))
        .collect();
    if !states.is_empty() {
        let _ = writeln!(text, "    states: {}", states.join(", "));
    }
    if node.heartbeats_lost > 0 {
        let now = if node.heartbeat_is_lost {
            ", and at the end"
        } else {
            ""
        };
        let _ = writeln!(
            text,
            "    heartbeat lost: {}{now}",
            times(node.heartbeats_lost)
        );
    }
    for finding in &node.findings {
        let since = ns(finding.first_time_s);
        let _ = writeln!(
            text,
            "    does not fit, {}: {}, the first at {}",
            finding.words,
            finding.count,
            text_utc(since)
        );
    }
    for fault in &node.faults {
        let now = if fault.stands {
            ", stands at the end"
        } else {
            ""
        };
        let _ = writeln!(text, "    EMCY {:04X}h {}{now}", fault.code, fault.text);
    }
}

fn about_spread(text: &mut String, axis: &str, spread: &SpreadJson) {
    if let (Some(min), Some(mean), Some(max)) = (spread.min_deg, spread.mean_deg, spread.max_deg) {
        let _ = writeln!(
            text,
            "    {axis} {mean:8.3} deg, {min:.3} to {max:.3} deg ({} values)",
            spread.count
        );
    } else {
        let _ = writeln!(text, "    {axis} no value that may be used");
    }
}
