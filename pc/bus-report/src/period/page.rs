//! `report.html` of `plumb report`.
//!
//! In: a [`PeriodReport`]. Out: one page that stands alone, the verdict on top, then what happened,
//! then how it was measured, and at the end what was read and what such a report can't tell.

use super::charts;
use super::data::*;
use super::tables;
use super::verdict;
use crate::blackbox::data::{self, MemoryReport};
use output::chart::Chart;
use output::html::{self, escape};
use output::table::Table;
use output::{plural, printable};

const LEAD: &str = "What a redundant inclinometer has reported on its bus over a period: when its \
    two channels disagreed, what they measured, and with what uncertainty.";

/// The page.
pub fn page(report: &PeriodReport) -> String {
    let mut body = header(report);
    for instrument in &report.instruments {
        body.push_str(&one(report, instrument));
    }
    for (number, memory) in (1..).zip(&report.memories) {
        body.push_str(&memory_section(number, memory));
    }
    for (number, bus) in (1..).zip(&report.buses) {
        body.push_str(&bus_section(report, number, bus));
    }
    if let Some(logs) = &report.logs {
        body.push_str(&logs_section(logs));
    }
    body.push_str(&limits(report));
    body.push_str(&html::footer(&report.format, report.version, ""));
    html::page("Plumb period report", &body)
}

fn header(report: &PeriodReport) -> String {
    let mut facts = Vec::new();
    if let (Some(from), Some(to)) = (report.from_s, report.to_s) {
        let zone = if report.clock == "utc" {
            " UTC"
        } else {
            " of the log"
        };
        facts.push(("From", tables::at(report, from) + zone));
        facts.push(("To", tables::at(report, to) + zone));
        facts.push((
            "With data",
            super::clock::length(tables::ns(report.covered_s)),
        ));
    }
    facts.push(("Instruments", report.instruments.len().to_string()));
    facts.push(("Plumb", report.plumb_version.clone()));
    let mut more = html::verdict(report.clean, &report.verdict) + &html::facts(&facts);
    more.extend(report.notes.iter().map(|note| html::paragraph(note)));
    html::header("Plumb period report", LEAD, &more)
}

/// A table, or this sentence where it has no rows.
fn table_or(table: &Table, sentence: &str) -> String {
    if table.rows.is_empty() {
        return format!(
            "<h3>{}</h3>\n{}",
            escape(&table.title),
            html::paragraph(sentence)
        );
    }
    html::table(table)
}

fn one(report: &PeriodReport, instrument: &InstrumentReport) -> String {
    let ids: Vec<String> = instrument
        .channels
        .iter()
        .map(|c| c.node_id.to_string())
        .collect();
    let mut title = format!(
        "Instrument {}: nodes {}",
        instrument.number,
        ids.join(" and ")
    );
    if report.buses.len() > 1 {
        title += &format!(" on {}", printable(&instrument.interface));
    }
    let from = tables::at(report, instrument.from_s);
    let to = tables::at(report, instrument.to_s);
    let mut out = html::facts(&[
        ("From", from),
        ("To", to),
        (
            "With data",
            super::clock::length(tables::ns(instrument.covered_s)),
        ),
        ("Incidents", verdict::incidents_of(instrument).to_string()),
    ]);
    out += &what_happened(report, instrument);
    out += &what_was_measured(report, instrument);
    html::section(&title, &out)
}

fn what_happened(report: &PeriodReport, instrument: &InstrumentReport) -> String {
    let mut out = html::charts(&[
        charts::per_day(instrument),
        charts::difference(report, instrument),
    ]);
    out += &html::table(&tables::days(instrument));
    let faults = tables::events(report, instrument, true);
    out += &table_or(
        &faults,
        "No fault was reported, and none was found in the log.",
    );
    if !instrument.plots.is_empty() {
        out += "<h3>The SYNCs around each fault</h3>\n";
        out += &html::paragraph(
            "32 SYNCs up to the event and 16 after it, from the log: the angles as measured where \
             the channels have sent them (TPDO 3), else as reported.",
        );
        let plots = instrument.plots.iter();
        let prefix = format!("fault-{}", instrument.number);
        let all: Vec<Chart> = plots
            .flat_map(|plot| charts::around(plot, &prefix))
            .collect();
        out += &html::charts(&all);
    }
    if instrument.plots_left_out > 0 {
        let text = format!(
            "{} no plot here.",
            plural(
                instrument.plots_left_out,
                "more event has",
                "more events have"
            )
        );
        out += &html::paragraph(&text);
    }
    let others = tables::events(report, instrument, false);
    out += &table_or(&others, "No other events: no restart, no lost heartbeat.");
    out
}

fn what_was_measured(report: &PeriodReport, instrument: &InstrumentReport) -> String {
    let mut out = html::table(&tables::angles(instrument));
    out += &html::charts(&charts::slopes(report, instrument));
    let difference = tables::difference(instrument);
    out += &table_or(
        &difference,
        "Nothing could be compared: no SYNC has angles of both.",
    );
    out += &html::charts(&charts::histograms(instrument));
    let availability = tables::availability(instrument);
    out += &table_or(&availability, "No stretch of time has angles.");
    let rates = tables::rates(instrument);
    if !rates.rows.is_empty() {
        out += &html::table(&rates);
    }
    let motion = charts::motion(report, instrument);
    if !motion.is_empty() {
        out += &html::charts(&motion);
    }
    out += &html::table(&tables::channels(instrument));
    let findings = tables::findings(report, instrument);
    out += &table_or(&findings, "All data of the channels are consistent.");
    out += &html::charts(&charts::quantities(report, instrument));
    let gaps = tables::gaps(report, "Stretches without data", &instrument.gaps);
    out += &table_or(&gaps, "There is no gap of more than 2 s.");
    out
}

fn memory_section(number: usize, memory: &MemoryReport) -> String {
    let mut out = String::new();
    if memory.entries_made.is_some() {
        let entries = data::table(memory, "Fault log, newest first");
        out += &table_or(&entries, "There is no entry.");
    }
    for plot in &memory.boxes {
        out += &format!("<h3>{}</h3>\n", escape(&plot.title));
        let prefix = format!("box-{number}");
        out += &html::charts(&charts::around(plot, &prefix));
    }
    html::section(
        &format!("Fault memory: {}", printable(&memory.source)),
        &out,
    )
}

fn bus_section(report: &PeriodReport, number: usize, bus: &BusReport) -> String {
    let mut facts = Vec::new();
    if let Some(rate) = bus.rate_bit_s {
        facts.push(("Mean", format!("{:.1} kbit/s", rate * 1e-3)));
    }
    if let (Some(load), Some(most)) = (bus.load_percent, bus.bit_rate_bit_s) {
        facts.push(("Load", format!("{load:.1} % of {:.0} kbit/s", most * 1e-3)));
    }
    let mut out = html::facts(&facts);
    out += &html::charts(&[charts::load(report, number, bus)]);
    out += &html::table(&tables::bus(bus));
    let gaps = tables::gaps(report, "Stretches without any frame", &bus.gaps);
    out += &table_or(&gaps, "There is no gap of more than 2 s.");
    html::section(&format!("The bus {}", printable(&bus.interface)), &out)
}

fn logs_section(logs: &LogsReport) -> String {
    let mut out = html::table(&tables::files(logs));
    out += &table_or(&tables::skipped(logs), "Every line gave a frame.");
    html::section("The logs", &out)
}

fn limits(report: &PeriodReport) -> String {
    let limits = match report.buses.is_empty() {
        false => verdict::LIMITS.map(html::paragraph).concat(),
        true => {
            html::paragraph(verdict::LIMITS[0])
                + &html::paragraph(
                    "A node stores its last 16 events and the samples of two. Its times count \
                     from its own start, whose date is unknown.",
                )
        }
    };
    html::section("What this report cannot show", &limits)
}
