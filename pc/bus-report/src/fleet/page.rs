//! `report.html` of a fleet.
//!
//! In: a [`FleetReport`]. Out: one page that stands alone: the verdict, the machines that need a
//! visit with a link to the page of each, and the other parts in their order.

use super::data::*;
use output::chart::{Chart, Ink, Level, Plot, Shape};
use output::html;
use output::printable;
use output::table::{Cell, Column, Rows, Table, Tone};

const LEAD: &str = "What redundant inclinometers on many machines have reported on their buses: \
    which machines need a visit and why, and how the fleet has done.";

/// The colours of the series of a chart, in their order.
const INKS: [Ink; 3] = [Ink::First, Ink::Second, Ink::Other];

/// The page.
pub fn page(report: &FleetReport) -> String {
    let mut facts: Vec<(&str, String)> = Vec::new();
    for (name, day) in [("From", &report.from), ("To", &report.to)] {
        facts.extend(day.iter().map(|day| (name, day.clone())));
    }
    let given = report.facts.iter();
    facts.extend(given.map(|(name, value)| (name.as_str(), printable(value))));
    facts.push(("Plumb", report.plumb_version.clone()));
    let head = html::verdict(report.clean, &printable(&report.verdict)) + &html::facts(&facts);
    let mut body = html::header("Plumb fleet report", LEAD, &head);
    body += &html::section("Machines that need a visit", &visits(&report.visits));
    for (number, section) in (1..).zip(&report.sections) {
        body += &html::section(&section.title, &content(number, section));
    }
    body += &html::footer(&report.format, report.version, "");
    html::page("Plumb fleet report", &body)
}

fn visits(visits: &[Visit]) -> String {
    if visits.is_empty() {
        return html::paragraph("No machine needs a visit.");
    }
    let reasons = |visit: &Visit| {
        let texts = visit.reasons.iter().map(|reason| printable(&reason.text));
        texts.collect::<Vec<_>>().join("; ")
    };
    let machine = |visit: &Visit| {
        let cell = Cell::text(printable(&visit.machine));
        match &visit.page {
            Some(url) => cell.to(url),
            None => cell,
        }
    };
    let or_dash = |text: &Option<String>| text.as_ref().map_or("-".to_owned(), |t| printable(t));
    let table = Rows::of("The most urgent first", visits)
        .column(Column::text("Machine"), machine)
        .text("Why", reasons)
        .text("Model", |visit| or_dash(&visit.model))
        .text("Firmware", |visit| or_dash(&visit.firmware))
        .table();
    html::table(&table)
}

fn content(number: usize, section: &Section) -> String {
    let mut out: String = section
        .text
        .iter()
        .map(|text| html::paragraph(&printable(text)))
        .collect();
    let charts: Vec<_> = (1..)
        .zip(&section.charts)
        .map(|(place, chart)| drawn(format!("part-{number}-{place}"), chart))
        .collect();
    if !charts.is_empty() {
        out += &html::charts(&charts);
    }
    for one in &section.tables {
        out += &html::table(&table(one));
    }
    out
}

fn table(data: &TableData) -> Table {
    let columns = data.columns.iter().map(|column| match column.number {
        true => Column::number(&column.name),
        false => Column::text(&column.name),
    });
    let mut table = Table::new(&data.title, columns.collect());
    let rows = data.rows.iter();
    table.rows = rows.map(|row| row.iter().map(cell).collect()).collect();
    table.notes.clone_from(&data.notes);
    table
}

fn cell(data: &CellData) -> Cell {
    match data {
        CellData::Text(text) => Cell::text(printable(text)),
        CellData::Marked { text, tone, link } => Cell {
            tone: match tone.as_str() {
                "pass" => Tone::Pass,
                "fail" => Tone::Fail,
                _ => Tone::Plain,
            },
            ..Cell::text(printable(text)).to(link)
        },
    }
}

fn drawn(id: String, data: &ChartData) -> Chart {
    let inks = INKS.into_iter().cycle();
    let levels = data.levels.iter().map(|level| Level {
        at: level.at,
        name: level.name.clone(),
    });
    Chart {
        id,
        title: data.title.clone(),
        description: data.description.clone(),
        x_label: data.x_label.clone(),
        y_label: data.y_label.clone(),
        plots: data
            .series
            .iter()
            .zip(inks)
            .map(|(series, ink)| Plot::new(printable(&series.name), ink, shape(series)))
            .collect(),
        levels: levels.collect(),
        x_names: data.x_names.clone(),
        ..Chart::default()
    }
}

fn shape(series: &SeriesData) -> Shape {
    let value = |point: &[Option<f64>], place| {
        let value = point.get(place).copied().flatten();
        value.unwrap_or(f64::NAN)
    };
    let points = || {
        let points = series.points.iter();
        points.map(|point| (value(point, 0), value(point, 1)))
    };
    match series.kind {
        SeriesKind::Line => Shape::Line(points().collect()),
        SeriesKind::Markers => Shape::Markers(points().collect()),
        SeriesKind::Bars => Shape::Bars(points().collect()),
        SeriesKind::Band => {
            let points = series.points.iter();
            Shape::Band(
                points
                    .map(|point| (value(point, 0), value(point, 1), value(point, 2)))
                    .collect(),
            )
        }
    }
}
