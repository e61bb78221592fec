//! The period in one sentence, and what a report of this kind can't tell.
//!
//! In: the figures of the report. Out: sentences.

use super::clock::length;
use super::data::{
    BusReport, ChannelReport, EventReport, InstrumentReport, LogsReport, PeriodReport,
};
use crate::totals::Kind;
use output::plural;

/// The period in a sentence, and whether it is one without a fault.
pub fn of(report: &PeriodReport) -> (String, bool) {
    if report.instruments.is_empty() {
        return without_instrument(report);
    }
    let all = &report.instruments;
    let incidents: u64 = all.iter().map(incidents_of).fold(0, u64::saturating_add);
    let covered = amount(report);
    let share = usable_share(all).map_or(String::new(), |share| {
        format!(" The angles could be used {share} of the time with data.")
    });
    let standing = all.iter().flat_map(|one| &one.events);
    let standing = standing.filter(|event| is_open_fault(event)).count();
    let who = match all.len() {
        1 => "One instrument".to_owned(),
        count => format!("{count} instruments"),
    };
    let doubts = doubts(all);
    let sentence = match incidents {
        0 => format!("{who}, {covered}, no warning and no fault.{share}{doubts}"),
        1 => format!(
            "{who}, {covered}, one incident{}.{share}{doubts}",
            open(standing)
        ),
        count => format!(
            "{who}, {covered}, {count} incidents{}.{share}{doubts}",
            open(standing)
        ),
    };
    (sentence, incidents == 0 && doubts.is_empty())
}

/// Sentences on nodes that nobody can call faultless: nothing came of them, or their slopes were
/// not used, since their unit is not that of the data sheet.
fn doubts(all: &[InstrumentReport]) -> String {
    let mut text = String::new();
    if let Some(nodes) = nodes(all, |channel| !channel.seen) {
        text += &format!(" The logs have no frame of {nodes}.");
    }
    let other_unit = |channel: &ChannelReport| channel.unusable.iter().any(|why| why.other_unit);
    if let Some(nodes) = nodes(all, other_unit) {
        text += &format!(" Slopes of {nodes} are in another unit: give the data sheet.");
    }
    text
}

/// The nodes that are so, as "node 1" or "nodes 1, 2"; `None` where there is none.
fn nodes(all: &[InstrumentReport], is_so: impl Fn(&ChannelReport) -> bool) -> Option<String> {
    let channels = all.iter().flat_map(|one| &one.channels);
    let ids = channels.filter(|channel| is_so(channel));
    let ids: Vec<String> = ids.map(|channel| channel.node_id.to_string()).collect();
    match ids.as_slice() {
        [] => None,
        [id] => Some(format!("node {id}")),
        ids => Some(format!("nodes {}", ids.join(", "))),
    }
}

/// How much data there is, and out of what time.
fn amount(report: &PeriodReport) -> String {
    let ns = |seconds: f64| (seconds * 1e9) as u64;
    let covered = length(ns(report.covered_s));
    let span = report.from_s.zip(report.to_s).map(|(from, to)| to - from);
    match span {
        Some(span) if span > 1.01 * report.covered_s + 2.0 => {
            format!("{covered} of data out of {}", length(ns(span)))
        }
        _ => format!("{covered} of data"),
    }
}

fn without_instrument(report: &PeriodReport) -> (String, bool) {
    let entries: usize = report
        .memories
        .iter()
        .map(|memory| memory.entries.len())
        .sum();
    let boxes: usize = report
        .memories
        .iter()
        .map(|memory| memory.boxes.len())
        .sum();
    if report.memories.is_empty() {
        return (
            "No frame of an instrument was found in the logs.".to_owned(),
            false,
        );
    }
    let sentence = format!(
        "{} contain{} {}, and the samples around {boxes} of them.",
        plural(
            report.memories.len() as u64,
            "fault memory",
            "fault memories"
        ),
        if report.memories.len() == 1 { "s" } else { "" },
        plural(entries as u64, "event", "events"),
    );
    (sentence, entries == 0 && boxes == 0)
}

/// The verb behind a number.
pub const fn was(count: u64) -> &'static str {
    if count == 1 { "was" } else { "were" }
}

fn open(standing: usize) -> String {
    match standing {
        0 => String::new(),
        1 => ", one fault still standing at the end".to_owned(),
        count => format!(", {count} faults still standing at the end"),
    }
}

fn is_open_fault(event: &EventReport) -> bool {
    let fault = Kind::ALL
        .into_iter()
        .any(|kind| kind.key() == event.kind && kind.is_fault());
    fault && event.end == "standing"
}

/// Incidents of an instrument.
pub fn incidents_of(instrument: &InstrumentReport) -> u64 {
    let days = instrument.days.iter().map(|day| day.incidents);
    days.fold(0, u64::saturating_add)
}

fn usable_share(all: &[InstrumentReport]) -> Option<String> {
    let channels = || all.iter().flat_map(|one| &one.channels);
    let usable: f64 = channels().map(|channel| channel.usable_s).sum();
    let not: f64 = channels()
        .flat_map(|channel| &channel.unusable)
        .map(|why| why.time_s)
        .sum();
    (usable + not > 0.0).then(|| percent(usable / (usable + not)))
}

/// A share in per cent; only all is 100, and only nothing is 0.
pub fn percent(share: f64) -> String {
    let rounded = (share * 1e4).round() / 100.0;
    let shown = match (rounded, share) {
        (rounded, share) if rounded >= 100.0 && share < 1.0 => 99.99,
        (rounded, share) if rounded <= 0.0 && share > 0.0 => 0.01,
        (rounded, _) => rounded,
    };
    format!(
        "{} %",
        format!("{shown:.2}")
            .trim_end_matches('0')
            .trim_end_matches('.')
    )
}

/// What the reader should know, of this very report.
pub fn notes(report: &PeriodReport) -> Vec<String> {
    let mut notes = Vec::new();
    let mut add = |told: bool, text: String| {
        if told {
            notes.push(text);
        }
    };
    let relative = report.clock == "relative" && !report.buses.is_empty();
    add(
        relative,
        "The logs have no date: times count from their own time 0, and days are stretches of \
         24 hours since then."
            .to_owned(),
    );
    let sum = |of: fn(&BusReport) -> u64| {
        let buses = report.buses.iter().map(of);
        buses.fold(0, u64::saturating_add)
    };
    let (backwards, malformed) = (sum(|bus| bus.backwards), sum(|bus| bus.malformed));
    let outside = sum(|bus| bus.outside);
    let undated = sum(|bus| bus.undated);
    add(
        undated > 0,
        format!(
            "{} a time without a date, among others with one, and {} left out.",
            plural(undated, "frame has", "frames have"),
            was(undated)
        ),
    );
    add(
        backwards > 0,
        format!(
            "Time went backwards {}: the clock was set back, or a stretch stands in a log twice \
             and counts twice. What lies between such frames is counted in no length of time.",
            plural(backwards, "time", "times")
        ),
    );
    add(
        malformed > 0,
        format!(
            "{} another form than as delivered, and {} not read: look for another PDO mapping, or \
             for another node with such an identifier.",
            plural(
                malformed,
                "frame of the instruments has",
                "frames of the instruments have"
            ),
            was(malformed)
        ),
    );
    add(
        outside > 0,
        format!(
            "{} outside the time asked for.",
            plural(outside, "frame lies", "frames lie")
        ),
    );
    notes.extend(report.logs.iter().flat_map(notes_of_logs));
    notes
}

fn notes_of_logs(logs: &LogsReport) -> Vec<String> {
    let damaged = logs.damaged.iter();
    let mut notes: Vec<_> = damaged
        .map(|told| format!("A log is damaged: {told}."))
        .collect();
    if logs.files.len() <= 1 {
        return notes;
    }
    match logs.undated.len() {
        0 => {}
        1 => notes.push("1 of the logs has no date; it was taken in the order given.".to_owned()),
        count => notes.push(format!(
            "{count} of the logs have no date; they were taken as following one another in the \
             order given."
        )),
    }
    notes
}

/// What a report of this kind cannot show.
pub const LIMITS: [&str; 6] = [
    "Both channels sit in one housing. A motion of that housing against the machine \
     moves both alike, and no difference shows it.",
    "What was not logged is not in this report. A fault that began and ended in a gap is in the \
     fault log of the device only.",
    "A log does not name its machine. Logs of several machines with the same node-ids \
     look like one instrument; make one report for each.",
    "The uncertainty is the one that the instrument states from its calibration. Nothing here \
     was compared with a reference.",
    "A fault is reported later than its cause began: docs/faults.md lists the time to detection \
     for each cause.",
    "Times are those of the adapter or machine that wrote the log; its clock was not compared \
     with another one. All times are UTC where the log has dates.",
];

#[cfg(test)]
mod tests {
    use super::super::data::UnusableReport;
    use super::*;

    #[test]
    fn only_all_is_a_hundred_per_cent_and_only_nothing_is_none() {
        assert_eq!(percent(1.0), "100 %");
        assert_eq!(percent(0.999_999), "99.99 %");
        assert_eq!(percent(0.000_001), "0.01 %");
        assert_eq!(percent(0.0), "0 %");
        assert_eq!(percent(0.125), "12.5 %");
    }

    #[test]
    fn an_instrument_of_which_one_channel_sent_nothing_was_without_a_fault() {
        let channel = |node_id, seen| ChannelReport {
            node_id,
            seen,
            usable_s: 1.0,
            ..ChannelReport::default()
        };
        let with = |channels| {
            let report = PeriodReport {
                instruments: vec![InstrumentReport {
                    channels,
                    ..InstrumentReport::default()
                }],
                ..PeriodReport::default()
            };
            of(&report)
        };
        let (verdict, clean) = with(vec![channel(1, true), channel(2, false)]);
        assert!(
            !clean && verdict.ends_with(" The logs have no frame of node 2."),
            "{verdict}"
        );
        let (verdict, clean) = with(vec![channel(1, true), channel(2, true)]);
        assert!(clean && !verdict.contains("no frame"), "{verdict}");
        let unusable = vec![UnusableReport {
            other_unit: true,
            ..UnusableReport::default()
        }];
        let other = ChannelReport {
            unusable,
            ..channel(2, true)
        };
        let (verdict, clean) = with(vec![channel(1, true), other]);
        assert!(!clean && verdict.contains("Slopes of node 2"), "{verdict}");
    }

    #[test]
    fn one_frame_was_counted_as_1_frames() {
        let bus = BusReport {
            malformed: 1,
            undated: 1,
            outside: 1,
            backwards: 1,
            ..BusReport::default()
        };
        let report = PeriodReport {
            buses: vec![bus],
            ..PeriodReport::default()
        };
        let notes = notes(&report).join(" ");
        for wanted in [
            "1 frame has a time without a date, among others with one, and was left out.",
            "Time went backwards 1 time:",
            "1 frame of the instruments has another form than as delivered, and was not read:",
            "1 frame lies outside the time asked for.",
        ] {
            assert!(notes.contains(wanted), "{notes}");
        }
    }
}
