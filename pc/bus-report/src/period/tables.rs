//! The tables of a period report.
//!
//! In: a [`PeriodReport`]. Out: [`Table`]s, the same for the page and for the terminal. A table
//! without rows is left out by whoever shows it.

use super::clock::{Clock, length};
use super::data::*;
use super::verdict::percent;
use crate::totals::Kind;
use output::printable;
use output::table::{Cell, Column, Table};

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

fn lasting(seconds: f64) -> Cell {
    Cell::text(length(ns(seconds)))
}

fn count(value: u64) -> Cell {
    Cell::text(value.to_string())
}

/// Cuts a table to what people read.
fn cut(mut table: Table, left_out: u64) -> Table {
    let more = table.rows.len().saturating_sub(SHOWN);
    table.rows.truncate(SHOWN);
    if more > 0 {
        table.notes.push(format!("{more} more in report.json."));
    }
    if left_out > 0 {
        let text = format!("{left_out} more were counted and not kept one by one.");
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
        row.extend([lasting(day.covered_s), count(day.incidents)]);
        row.extend(kinds.iter().map(|kind| {
            let seen = day.kinds.iter().find(|seen| seen.kind == kind.key());
            count(seen.map_or(0, |seen| seen.count))
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
    let columns = vec![
        Column::text("When"),
        Column::text("Node"),
        Column::text("What"),
        Column::text("Blamed"),
        Column::text("Why"),
        Column::text("How long"),
        Column::number("Again"),
        Column::number("Plot"),
    ];
    let title = if faults { "Faults" } else { "Other events" };
    let mut table = Table::new(title, columns);
    let is_fault = |event: &&EventReport| {
        let kind = Kind::ALL.into_iter().find(|kind| kind.key() == event.kind);
        kind.is_some_and(Kind::is_fault) == faults
    };
    for event in instrument.events.iter().filter(is_fault) {
        let word = |text: &Option<String>| Cell::text(text.clone().unwrap_or_default());
        table.rows.push(vec![
            Cell::text(at(report, event.time_s)),
            Cell::text(format!("{} ({})", event.channel, event.node_id)),
            Cell::text(what(event)),
            word(&event.blamed),
            word(&event.reason_text),
            Cell::text(how_long(event)),
            Cell::text(if event.repeats > 0 {
                event.repeats.to_string()
            } else {
                String::new()
            }),
            Cell::text(event.plot.map_or(String::new(), |plot| plot.to_string())),
        ]);
    }
    let left_out = if faults {
        instrument.faults_left_out
    } else {
        instrument.others_left_out
    };
    cut(table, left_out)
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
    let mut columns = vec![
        Column::text("Channel"),
        Column::text("Slope"),
        Column::number("Values"),
    ];
    columns.extend(FIGURES.map(|name| Column::number(name).under("deg")));
    let mut table = Table::new("Angles while they could be used", columns);
    for channel in &instrument.channels {
        for slope in &channel.slopes {
            let mut row = vec![
                Cell::text(format!("{} ({})", channel.channel, channel.node_id)),
                Cell::text(slope.values.axis.to_uppercase()),
                count(slope.values.count),
            ];
            row.extend(figures(&slope.values, 2));
            table.rows.push(row);
        }
    }
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

/// What [`figures`] gives.
const FIGURES: [&str; 9] = [
    "Mean",
    "Std. deviation",
    "Least",
    "1 %",
    "5 %",
    "50 %",
    "95 %",
    "99 %",
    "Greatest",
];

/// Mean and deviation, least, percentiles, greatest.
fn figures(of: &AxisFigures, decimals: usize) -> Vec<Cell> {
    let cell = |value| Cell::number(value, decimals);
    let mut cells = vec![cell(of.mean_deg), cell(of.std_deg), cell(of.min_deg)];
    let wanted = [1.0, 5.0, 50.0, 95.0, 99.0];
    cells.extend(wanted.map(|percent| {
        let mut percentiles = of.percentiles.iter();
        let found = percentiles.find(|value| value.percent == percent);
        cell(found.map(|found| found.value_deg))
    }));
    cells.push(cell(of.max_deg));
    cells
}

/// The difference of the channels.
pub fn difference(instrument: &InstrumentReport) -> Table {
    let mut columns = vec![Column::text("Slope"), Column::number("SYNCs")];
    columns.extend(FIGURES.map(|name| Column::number(name).under("deg")));
    let mut table = Table::new("Channel A \u{2212} channel B at the same SYNC", columns);
    let difference = &instrument.difference;
    for slope in &difference.slopes {
        let values = &slope.values;
        if values.count == 0 {
            continue;
        }
        let mut row = vec![Cell::text(values.axis.to_uppercase()), count(values.count)];
        row.extend(figures(values, 3));
        table.rows.push(row);
    }
    table.notes = difference_notes(difference);
    table
}

fn difference_notes(difference: &DifferenceReport) -> Vec<String> {
    let mut notes = Vec::new();
    if difference.judged > 0 {
        let share = difference.above as f64 / difference.judged as f64;
        notes.push(format!(
            "Above the expanded uncertainty of the difference (k = 2): {} of {} SYNCs, {}.",
            difference.above,
            difference.judged,
            percent(share)
        ));
    }
    if difference.syncs_slopes > 0 {
        notes.push(format!(
            "{} SYNCs are compared by TPDO 1, in which presets and offsets are included and from \
             which angles that must not be used are missing; {} by TPDO 3, as measured.",
            difference.syncs_slopes, difference.syncs_measured
        ));
    }
    if let (Some(most), Some(mean), Some(off)) = (
        difference.told_max_deg,
        difference.told_off_mean_deg,
        difference.told_off_max_deg,
    ) {
        notes.push(format!(
            "The nodes' own figure (2024h, {} values) was {most:.3} deg at most; it differs from \
             the calculation here by {mean:.3} deg in the mean and {off:.3} deg at most.",
            difference.told_count
        ));
    }
    notes
}

/// For how long the angles could be used, and why not.
pub fn availability(instrument: &InstrumentReport) -> Table {
    let columns = vec![
        Column::text("Channel"),
        Column::text("Angle"),
        Column::text("State of the pair"),
        Column::text("Reason of the channel"),
        Column::number("Time"),
        Column::number("Share"),
    ];
    let mut table = Table::new("Time with and without an angle", columns);
    for channel in &instrument.channels {
        let not: f64 = channel.unusable.iter().map(|why| why.time_s).sum();
        let all = channel.usable_s + not;
        if all == 0.0 {
            continue;
        }
        let name = || Cell::text(format!("{} ({})", channel.channel, channel.node_id));
        let share = |time_s: f64| Cell::text(percent(time_s / all));
        let empty = || Cell::text("");
        table.rows.push(vec![
            name(),
            Cell::text("could be used"),
            empty(),
            empty(),
            lasting(channel.usable_s),
            share(channel.usable_s),
        ]);
        table.rows.extend(channel.unusable.iter().map(|why| {
            vec![
                name(),
                Cell::text("could not"),
                Cell::text(why.state_text.as_str()),
                Cell::text(why.reason_text.clone().unwrap_or_default()),
                lasting(why.time_s),
                share(why.time_s),
            ]
        }));
    }
    table
}

/// What each channel is, and what was counted of it.
pub fn channels(instrument: &InstrumentReport) -> Table {
    let columns = vec![
        Column::text("Channel"),
        Column::number("Node-id"),
        Column::text("Identity (1018h)"),
        Column::number("Uncertainty, deg"),
        Column::number("Temperature, degC"),
        Column::number("Boot-ups"),
        Column::number("Heartbeat lost"),
        Column::number("Not read"),
    ];
    let mut table = Table::new("Channels", columns);
    let range = |quantity: &QuantityReport, decimals: usize| match (quantity.min, quantity.max) {
        (Some(min), Some(max)) => format!("{min:.decimals$} to {max:.decimals$}"),
        _ => "-".to_owned(),
    };
    for channel in &instrument.channels {
        let lost = match channel.heartbeat_losses {
            0 => "never".to_owned(),
            times => format!("{times} x, {}", length(ns(channel.heartbeat_lost_s))),
        };
        table.rows.push(vec![
            Cell::text(channel.channel.as_str()),
            Cell::text(channel.node_id.to_string()),
            Cell::text(identity(channel)),
            Cell::text(range(&channel.uncertainty, 3)),
            Cell::text(range(&channel.temperature, 0)),
            count(channel.boots),
            Cell::text(lost),
            count(channel.malformed),
        ]);
    }
    table
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
    let columns = vec![
        Column::text("From"),
        Column::text("To"),
        Column::number("Length"),
        Column::text("What was silent"),
    ];
    let mut table = Table::new(title, columns);
    for gap in &gaps.longest {
        let who = if gap.whole_bus {
            "the whole bus, or the log"
        } else {
            "this instrument"
        };
        table.rows.push(vec![
            Cell::text(at(report, gap.from_s)),
            Cell::text(at(report, gap.to_s)),
            lasting(gap.to_s - gap.from_s),
            Cell::text(who),
        ]);
    }
    if gaps.count > 0 {
        table.notes.push(format!(
            "{} gaps of more than 2 s, {} together{}.",
            gaps.count,
            length(ns(gaps.sum_s)),
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
    let columns = vec![Column::text("On the bus"), Column::number("Frames")];
    let mut table = Table::new("Frames", columns);
    let mut row = |name: &str, value: u64, always: bool| {
        if always || value > 0 {
            table.rows.push(vec![Cell::text(name), count(value)]);
        }
    };
    row("All frames of the period", bus.frames, true);
    row("SYNC", bus.syncs, true);
    row("NMT commands", bus.commands, true);
    row(
        "Of the instruments, not of the form as delivered",
        bus.malformed,
        true,
    );
    row("With a 29-bit identifier", bus.extended, false);
    row("Remote frames", bus.remote, false);
    row("Older than the frame before", bus.backwards, true);
    row("Outside the time asked for", bus.outside, false);
    for node in bus.foreign.iter().take(20) {
        row(
            &format!("Of node {}, which is of no instrument", node.node_id),
            node.frames,
            true,
        );
    }
    table
}

/// What does not fit together in what the channels say.
pub fn findings(report: &PeriodReport, instrument: &InstrumentReport) -> Table {
    let columns = vec![
        Column::text("Channel"),
        Column::text("What"),
        Column::number("Times"),
        Column::text("First"),
    ];
    let mut table = Table::new("What does not fit together", columns);
    for channel in &instrument.channels {
        table.rows.extend(channel.findings.iter().map(|finding| {
            vec![
                Cell::text(format!("{} ({})", channel.channel, channel.node_id)),
                Cell::text(finding.text.as_str()),
                count(finding.count),
                Cell::text(at(report, finding.first_s)),
            ]
        }));
    }
    table
}

/// What was read.
pub fn files(logs: &LogsReport) -> Table {
    let columns = vec![Column::number("Log"), Column::text("File")];
    let mut table = Table::new("What was read", columns);
    let numbered = (1..).zip(&logs.files);
    table.rows = numbered
        .map(|(number, file)| vec![count(number), Cell::text(printable(file))])
        .collect();
    table.notes.push(format!("{} frames in all.", logs.frames));
    if logs.overlapping > 0 {
        table.notes.push(format!(
            "{} files begin before another one has ended; their frames were put in order of time.",
            logs.overlapping
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
    let columns = vec![
        Column::text("What was skipped"),
        Column::number("Times"),
        Column::text("First in"),
        Column::number("Line"),
    ];
    let mut table = Table::new("Skipped", columns);
    table.rows = logs
        .skipped
        .iter()
        .map(|lines| {
            vec![
                Cell::text(printable(&lines.reason)),
                count(lines.count),
                Cell::text(printable(&lines.file)),
                count(lines.first_line),
            ]
        })
        .collect();
    table
}
