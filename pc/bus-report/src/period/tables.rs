//! The tables of a period report.
//!
//! In: a [`PeriodReport`]. Out: [`Table`]s, the same for the page and for the terminal. A table
//! without rows is left out by whoever shows it.

use super::clock::{Clock, length};
use super::data::*;
use super::verdict::{percent, was};
use crate::totals::Kind;
use output::table::{Cell, Column, Rows, Table};
use output::{plural, printable};

/// Rows of a table that are shown; the JSON has them all.
const SHOWN: usize = 60;

/// The clock of a report.
pub fn clock(report: &PeriodReport) -> Clock {
    if report.clock == "relative" {
        Clock::Relative
    } else {
        Clock::Utc
    }
}

/// Seconds as ns.
pub fn ns(seconds: f64) -> u64 {
    (seconds * 1e9).round().max(0.0) as u64
}

/// An instant of the report in words.
pub fn at(report: &PeriodReport, seconds: f64) -> String {
    clock(report).text(ns(seconds))
}

fn lasting(seconds: f64) -> String {
    length(ns(seconds))
}

/// A channel with its node-id.
fn named(channel: &str, node_id: u8) -> String {
    format!("{channel} ({node_id})")
}

fn or_empty(text: Option<&String>) -> &str {
    text.map_or("", String::as_str)
}

/// Cuts a table to what people read.
fn cut(mut table: Table, left_out: u64) -> Table {
    let more = table.rows.len().saturating_sub(SHOWN);
    table.rows.truncate(SHOWN);
    if more > 0 {
        table.notes.push(format!("{more} more in report.json."));
    }
    if left_out > 0 {
        let text = format!(
            "{left_out} more {} counted and not kept one by one.",
            was(left_out)
        );
        table.notes.push(text);
    }
    table
}

/// The days: data, incidents, events by kind.
pub fn days(instrument: &InstrumentReport) -> Table {
    let happened = |kind: &Kind| {
        let kinds = instrument.days.iter().flat_map(|day| &day.kinds);
        kinds.into_iter().any(|seen| seen.kind == kind.key())
    };
    let kinds: Vec<Kind> = Kind::ALL.into_iter().filter(happened).collect();
    let mut columns = vec![
        Column::text("Day"),
        Column::number("Data"),
        Column::number("Incidents"),
    ];
    let of_kind = |kind: &Kind| Column::number(kind.text()).under("Messages by kind");
    columns.extend(kinds.iter().map(of_kind));
    columns.push(Column::number("Largest difference, deg"));
    let mut table = Table::new("Warnings and faults per day", columns);
    for day in &instrument.days {
        let mut row = vec![Cell::text(day.day.as_str())];
        if day.covered_s == 0.0 && day.syncs == 0 {
            row.push(Cell::text("no data"));
            table.rows.push(row);
            continue;
        }
        row.extend([lasting(day.covered_s), day.incidents.to_string()].map(Cell::text));
        row.extend(kinds.iter().map(|kind| {
            let seen = day.kinds.iter().find(|seen| seen.kind == kind.key());
            Cell::text(seen.map_or(0, |seen| seen.count).to_string())
        }));
        row.push(Cell::number(day.difference_max_deg, 3));
        table.rows.push(row);
    }
    table.notes.push(
        "An incident is a warning or a fault more than a second after the one before; both \
         channels report most of them, so there are more messages than incidents."
            .to_owned(),
    );
    cut(table, 0)
}

/// The faults, or all other events.
pub fn events(report: &PeriodReport, instrument: &InstrumentReport, faults: bool) -> Table {
    let is_fault = |event: &&EventReport| {
        let kind = Kind::ALL.into_iter().find(|kind| kind.key() == event.kind);
        kind.is_some_and(Kind::is_fault) == faults
    };
    let events: Vec<_> = instrument.events.iter().filter(is_fault).collect();
    let (title, left_out) = match faults {
        true => ("Faults", instrument.faults_left_out),
        false => ("Other events", instrument.others_left_out),
    };
    let again = |event: &EventReport| (event.repeats > 0).then(|| event.repeats.to_string());
    let table = Rows::of(title, &events)
        .text("When", |event| at(report, event.time_s))
        .text("Node", |event| named(&event.channel, event.node_id))
        .text("What", |event| what(event))
        .text("Blamed", |event| or_empty(event.blamed.as_ref()))
        .text("Why", |event| or_empty(event.reason_text.as_ref()))
        .text("How long", |event| how_long(event))
        .count("Again", |event| again(event).unwrap_or_default())
        .count("Plot", |event| {
            event.plot.map_or(String::new(), |plot| plot.to_string())
        });
    cut(table.table(), left_out)
}

fn what(event: &EventReport) -> String {
    match &event.code {
        Some(code) => format!("{} ({code})", event.text),
        None => event.text.clone(),
    }
}

fn how_long(event: &EventReport) -> String {
    match (event.end.as_str(), event.duration_s) {
        ("momentary", _) => String::new(),
        ("restart", Some(seconds)) => format!("{} (restart)", length(ns(seconds))),
        (_, Some(seconds)) => length(ns(seconds)),
        _ => "still standing".to_owned(),
    }
}

/// The angles of both channels.
pub fn angles(instrument: &InstrumentReport) -> Table {
    let slopes: Vec<_> = instrument.channels.iter().flat_map(angles_of).collect();
    let rows = Rows::of("Angles while they could be used", &slopes)
        .text("Channel", |(channel, ..)| {
            named(&channel.channel, channel.node_id)
        })
        .text("Slope", |(_, when, values)| {
            values.axis.to_uppercase() + when
        })
        .count("Values", |(.., values)| values.count);
    let mut table = figures(rows, 2, |(.., values)| *values).table();
    let steps = instrument
        .channels
        .iter()
        .flat_map(|channel| &channel.slopes);
    if let Some(step) = steps.map(|slope| slope.values.step_deg).reduce(f64::max) {
        let note = format!(
            "The standard deviation is that of the machine's motion, not of the measurement. \
             Percentiles are true to {step} deg."
        );
        table.notes.push(note);
    }
    table
}

/// The slopes of a channel, then those now where it has sent them.
fn angles_of(channel: &ChannelReport) -> Vec<(&ChannelReport, &'static str, &AxisFigures)> {
    let slopes = channel.slopes.iter().map(|slope| ("", &slope.values));
    let now = channel.motion.iter().filter(|motion| motion.angles > 0);
    let now = now.flat_map(|motion| &motion.slopes);
    let all = slopes.chain(now.map(|values| (" now", values)));
    all.map(|(when, values)| (channel, when, values)).collect()
}

/// The rates of turn of channels that have sent them.
pub fn rates(instrument: &InstrumentReport) -> Table {
    let rates: Vec<_> = instrument.channels.iter().flat_map(rates_of).collect();
    Rows::of("Rates of turn", &rates)
        .text("Channel", |(channel, _)| {
            named(&channel.channel, channel.node_id)
        })
        .text("About", |(_, rate)| rate.axis.to_uppercase())
        .count("Values", |(_, rate)| rate.count)
        .number("Mean", 2, |(_, rate)| rate.mean_dps)
        .under("deg/s")
        .number("Root mean square", 2, |(_, rate)| rate.rms_dps)
        .under("deg/s")
        .number("Least", 2, |(_, rate)| rate.min_dps)
        .under("deg/s")
        .number("Greatest", 2, |(_, rate)| rate.max_dps)
        .under("deg/s")
        .table()
}

fn rates_of(channel: &ChannelReport) -> impl Iterator<Item = (&ChannelReport, &RateReport)> {
    let sent = channel.motion.iter().filter(|motion| motion.messages > 0);
    let rates = sent.flat_map(|motion| &motion.rates);
    rates.map(move |rate| (channel, rate))
}

/// A figure of an axis, deg.
type Figure = fn(&AxisFigures) -> Option<f64>;

/// Mean and deviation, least, percentiles, greatest.
const FIGURES: [(&str, Figure); 9] = [
    ("Mean", |of| of.mean_deg),
    ("Std. deviation", |of| of.std_deg),
    ("Least", |of| of.min_deg),
    ("1 %", |of| percentile(of, 1.0)),
    ("5 %", |of| percentile(of, 5.0)),
    ("50 %", |of| percentile(of, 50.0)),
    ("95 %", |of| percentile(of, 95.0)),
    ("99 %", |of| percentile(of, 99.0)),
    ("Greatest", |of| of.max_deg),
];

fn percentile(of: &AxisFigures, percent: f64) -> Option<f64> {
    let mut percentiles = of.percentiles.iter();
    let found = percentiles.find(|value| value.percent == percent)?;
    Some(found.value_deg)
}

/// Columns with the [`FIGURES`] of each row.
fn figures<'a, R>(
    rows: Rows<'a, R>,
    decimals: usize,
    of: impl Fn(&'a R) -> &'a AxisFigures,
) -> Rows<'a, R> {
    FIGURES.iter().fold(rows, |rows, (name, figure)| {
        rows.number(name, decimals, |row| figure(of(row)))
            .under("deg")
    })
}

/// The difference of the channels.
pub fn difference(instrument: &InstrumentReport) -> Table {
    let difference = &instrument.difference;
    let slopes = difference.slopes.iter().map(|slope| &slope.values);
    let compared: Vec<_> = slopes.filter(|values| values.count > 0).collect();
    let rows = Rows::of("Channel A \u{2212} channel B at the same SYNC", &compared)
        .text("Slope", |values| values.axis.to_uppercase())
        .count("SYNCs", |values| values.count);
    let mut table = figures(rows, 3, |values| values).table();
    table.notes = difference_notes(difference);
    table
}

fn difference_notes(difference: &DifferenceReport) -> Vec<String> {
    let mut notes = Vec::new();
    if difference.judged > 0 {
        let share = difference.above as f64 / difference.judged as f64;
        notes.push(format!(
            "Above the expanded uncertainty of the difference (k = 2): {} of {}, {}.",
            difference.above,
            plural(difference.judged, "SYNC", "SYNCs"),
            percent(share)
        ));
    }
    if difference.syncs_slopes > 0 {
        notes.push(format!(
            "{} compared by TPDO 1, in which presets and offsets are included and from \
             which angles that must not be used are missing; {} by TPDO 3, as measured.",
            plural(difference.syncs_slopes, "SYNC is", "SYNCs are"),
            difference.syncs_measured
        ));
    }
    if let (Some(most), Some(mean), Some(off)) = (
        difference.told_max_deg,
        difference.told_off_mean_deg,
        difference.told_off_max_deg,
    ) {
        notes.push(format!(
            "The nodes' own figure (2024h, {}) was {most:.3} deg at most; it differs from \
             the calculation here by {mean:.3} deg in the mean and {off:.3} deg at most.",
            plural(difference.told_count, "value", "values")
        ));
    }
    notes
}

/// A stretch of a channel's time: why there was no angle, how long, out of how much.
type Stretch<'a> = (&'a ChannelReport, Option<&'a UnusableReport>, f64, f64);

fn stretches(channel: &ChannelReport) -> Vec<Stretch<'_>> {
    let without: f64 = channel.unusable.iter().map(|why| why.time_s).sum();
    let all = channel.usable_s + without;
    if all == 0.0 {
        return Vec::new();
    }
    let usable = (channel, None, channel.usable_s, all);
    let unusable = channel.unusable.iter();
    let unusable = unusable.map(|why| (channel, Some(why), why.time_s, all));
    std::iter::once(usable).chain(unusable).collect()
}

/// For how long the angles could be used, and why not.
pub fn availability(instrument: &InstrumentReport) -> Table {
    let all: Vec<_> = instrument.channels.iter().flat_map(stretches).collect();
    Rows::of("Time with and without an angle", &all)
        .text("Channel", |(channel, ..)| {
            named(&channel.channel, channel.node_id)
        })
        .text("Angle", |(_, why, ..)| match why {
            None => "could be used",
            Some(_) => "could not",
        })
        .text("State of the pair", |(_, why, ..)| {
            why.map_or("", |why| why.state_text.as_str())
        })
        .text("Reason of the channel", |(_, why, ..)| {
            or_empty(why.and_then(|why| why.reason_text.as_ref()))
        })
        .count("Time", |(.., time_s, _)| lasting(*time_s))
        .count("Share", |(.., time_s, all_s)| percent(time_s / all_s))
        .table()
}

/// What each channel is, and what was counted of it.
pub fn channels(instrument: &InstrumentReport) -> Table {
    let range = |quantity: &QuantityReport, decimals: usize| match (quantity.min, quantity.max) {
        (Some(min), Some(max)) => format!("{min:.decimals$} to {max:.decimals$}"),
        _ => "-".to_owned(),
    };
    let lost = |channel: &ChannelReport| match channel.heartbeat_losses {
        0 => "never".to_owned(),
        times => format!("{times} x, {}", lasting(channel.heartbeat_lost_s)),
    };
    Rows::of("Channels", &instrument.channels)
        .text("Channel", |channel| channel.channel.as_str())
        .count("Node-id", |channel| channel.node_id)
        .text("Identity (1018h)", identity)
        .count("Uncertainty, deg", |channel| range(&channel.uncertainty, 3))
        .count("Temperature, degC", |channel| {
            range(&channel.temperature, 0)
        })
        .count("Boot-ups", |channel| channel.boots)
        .count("Heartbeat lost", lost)
        .count("Not read", |channel| channel.malformed)
        .table()
}

fn identity(channel: &ChannelReport) -> String {
    let hex = |value: Option<u32>| value.map(|value| format!("{value:08X}h"));
    let parts = [
        ("vendor", hex(channel.vendor_id)),
        ("product", hex(channel.product_code)),
        ("revision", hex(channel.revision)),
        (
            "serial",
            channel.serial_number.map(|number| number.to_string()),
        ),
    ];
    let known = parts
        .iter()
        .filter_map(|(name, value)| Some(format!("{name} {}", value.as_ref()?)));
    let known: Vec<_> = known.collect();
    if known.is_empty() {
        return "not in the log".to_owned();
    }
    known.join(", ")
}

/// Stretches without data.
pub fn gaps(report: &PeriodReport, title: &str, gaps: &GapsReport) -> Table {
    let mut table = Rows::of(title, &gaps.longest)
        .text("From", |gap| at(report, gap.from_s))
        .text("To", |gap| at(report, gap.to_s))
        .count("Length", |gap| lasting(gap.to_s - gap.from_s))
        .text("What was silent", |gap| match gap.whole_bus {
            true => "the whole bus, or the log",
            false => "this instrument",
        })
        .table();
    if gaps.count > 0 {
        table.notes.push(format!(
            "{} of more than 2 s, {}{}.",
            plural(gaps.count, "gap", "gaps"),
            match gaps.count {
                1 => length(ns(gaps.sum_s)),
                _ => format!("{} together", length(ns(gaps.sum_s))),
            },
            if gaps.count as usize > gaps.longest.len() {
                "; the longest are listed"
            } else {
                ""
            }
        ));
    }
    table
}

/// What was on the bus.
pub fn bus(bus: &BusReport) -> Table {
    let always = |name: &str, frames: u64| Some((name.to_owned(), frames));
    let where_any = |name: &str, frames: u64| always(name, frames).filter(|_| frames > 0);
    let other = "Of the instruments, not of the form as delivered";
    let kinds = [
        always("All frames of the period", bus.frames),
        always("SYNC", bus.syncs),
        always("NMT commands", bus.commands),
        always(other, bus.malformed),
        where_any("With a 29-bit identifier", bus.extended),
        where_any("Remote frames", bus.remote),
        always("Older than the frame before", bus.backwards),
        where_any("Outside the time asked for", bus.outside),
    ];
    let foreign = bus.foreign.iter().take(20).map(|node| {
        let name = format!("Of node {}, which is of no instrument", node.node_id);
        (name, node.frames)
    });
    let kinds: Vec<_> = kinds.into_iter().flatten().chain(foreign).collect();
    Rows::of("Frames", &kinds)
        .text("On the bus", |(name, _)| name)
        .count("Frames", |(_, frames)| frames)
        .table()
}

/// What does not fit together in what the channels send.
pub fn findings(report: &PeriodReport, instrument: &InstrumentReport) -> Table {
    let channels = instrument.channels.iter();
    let all: Vec<_> = channels
        .flat_map(|channel| channel.findings.iter().map(move |found| (channel, found)))
        .collect();
    Rows::of("What does not fit together", &all)
        .text("Channel", |(channel, _)| {
            named(&channel.channel, channel.node_id)
        })
        .text("What", |(_, found)| found.text.as_str())
        .count("Times", |(_, found)| found.count)
        .text("First", |(_, found)| at(report, found.first_s))
        .table()
}

/// What was read.
pub fn files(logs: &LogsReport) -> Table {
    let numbered: Vec<_> = (1_usize..).zip(&logs.files).collect();
    let mut table = Rows::of("What was read", &numbered)
        .count("Log", |(number, _)| number)
        .text("File", |(_, file)| printable(file))
        .table();
    table.notes.push(format!(
        "{} in all.",
        plural(logs.frames, "frame", "frames")
    ));
    if logs.overlapping > 0 {
        table.notes.push(format!(
            "{} before another one has ended; their frames were put in order of time.",
            plural(logs.overlapping, "file begins", "files begin")
        ));
    }
    if !logs.not_logs.is_empty() {
        let names: Vec<_> = logs
            .not_logs
            .iter()
            .take(10)
            .map(|name| printable(name))
            .collect();
        let text = format!("Left aside, since they are no logs: {}.", names.join(", "));
        table.notes.push(text);
    }
    cut(table, 0)
}

/// What gave no frame.
pub fn skipped(logs: &LogsReport) -> Table {
    Rows::of("Skipped", &logs.skipped)
        .text("What was skipped", |lines| printable(&lines.reason))
        .count("Times", |lines| lines.count)
        .text("First in", |lines| printable(&lines.file))
        .count("Line", |lines| lines.first_line)
        .table()
}
