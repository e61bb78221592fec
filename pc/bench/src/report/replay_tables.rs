//! The tables of a replay report.
//!
//! In: a [`ReplayReport`]. Out: recordings, skipped rows, calibration, accuracy, plateaus, cross
//! check and verdicts as [`Table`]s, for the terminal and for the page. A table without rows is
//! left out by whoever shows it.

use super::data::word;
use super::replay_data::*;
use super::tables::axis_name;
use output::printable;
use output::table::{Cell, Column, Table};

/// All tables in reading order, those without rows left out.
pub fn all(report: &ReplayReport) -> Vec<Table> {
    let tables = vec![
        recordings(report),
        skipped(report),
        calibration(report),
        accuracy(report),
        uncertainty(report),
        plateaus(report),
        cross_check(report),
        verdicts(report),
    ];
    tables
        .into_iter()
        .filter(|table| !table.rows.is_empty())
        .collect()
}

/// What was read.
pub fn recordings(report: &ReplayReport) -> Table {
    let columns = vec![
        Column::text("Channel"),
        Column::text("File"),
        Column::number("Rows"),
        Column::number("Skipped"),
        Column::number("Gaps"),
        Column::number("Rate, Hz"),
        Column::number("Duration, s"),
        Column::number("LSB per g"),
        Column::number("Latency, ms"),
    ];
    let mut table = Table::new("Recordings", columns);
    for channel in &report.channels {
        let skipped: u64 = channel.skipped.iter().map(|rows| rows.count).sum();
        table.rows.push(vec![
            Cell::text(channel.channel.to_string()),
            Cell::text(printable(&channel.file)),
            Cell::text(channel.rows.to_string()),
            Cell::text(skipped.to_string()),
            Cell::text(channel.gaps.to_string()),
            Cell::number(Some(channel.rate_hz), 1),
            Cell::number(Some(channel.duration_s), 1),
            Cell::number(channel.lsb_per_g, 0),
            Cell::number(channel.latency_ms, 1),
        ]);
        if !channel.ignored_columns.is_empty() {
            let names = channel.ignored_columns.join(", ");
            table
                .notes
                .push(format!("Channel {}: not used: {names}.", channel.channel));
        }
    }
    table
}

/// Rows that were left out.
pub fn skipped(report: &ReplayReport) -> Table {
    let columns = vec![
        Column::text("Channel"),
        Column::text("Reason"),
        Column::number("Rows"),
        Column::number("First line"),
    ];
    let mut table = Table::new("Skipped rows", columns);
    for channel in &report.channels {
        table.rows.extend(channel.skipped.iter().map(|rows| {
            vec![
                Cell::text(channel.channel.to_string()),
                Cell::text(rows.reason.as_str()),
                Cell::text(rows.count.to_string()),
                Cell::text(rows.first_line.to_string()),
            ]
        }));
    }
    table
}

/// How each channel was calibrated.
pub fn calibration(report: &ReplayReport) -> Table {
    let columns = vec![
        Column::text("Channel"),
        Column::text("Calibrated from"),
        Column::number("Poses"),
        Column::number("Residual, mg rms"),
        Column::number("Residual, deg rms"),
        Column::number("Condition"),
    ];
    let mut table = Table::new("Calibration", columns);
    for channel in &report.channels {
        let calibration = &channel.calibration;
        table.rows.push(vec![
            Cell::text(channel.channel.to_string()),
            Cell::text(calibration_name(calibration.kind)),
            Cell::number(calibration.poses.map(|count| count as f64), 0),
            Cell::number(calibration.residual_mg, 3),
            Cell::number(calibration.residual_deg, 3),
            Cell::number(calibration.condition, 1),
        ]);
    }
    table
}

fn calibration_name(kind: CalibrationKind) -> &'static str {
    match kind {
        CalibrationKind::Poses => "standstill poses",
        CalibrationKind::Reference => "reference columns",
        CalibrationKind::File => "calibration file",
    }
}

/// Errors against the recorded reference.
pub fn accuracy(report: &ReplayReport) -> Table {
    let columns = vec![
        Column::text("Channel"),
        Column::text("Slope"),
        Column::text("Over"),
        Column::number("Compared"),
        Column::number("Mean"),
        Column::number("RMSE"),
        Column::number("Largest"),
    ];
    let mut table = Table::new("Error against the recorded reference, deg", columns);
    for channel in &report.channels {
        for slope in &channel.slopes {
            let both = [
                ("plateaus, their means", &slope.accuracy_at_plateaus),
                ("the whole recording", &slope.accuracy),
            ];
            for (over, accuracy) in both {
                let Some(accuracy) = accuracy else { continue };
                table.rows.push(vec![
                    Cell::text(channel.channel.to_string()),
                    Cell::text(axis_name(slope.axis)),
                    Cell::text(over),
                    Cell::text(accuracy.compared.to_string()),
                    Cell::number(accuracy.mean_deg, 3),
                    Cell::number(accuracy.rmse_deg, 3),
                    Cell::number(accuracy.max_deg, 3),
                ]);
            }
        }
    }
    table
}

/// What each channel says of its uncertainty at standstill, beside what was seen.
pub fn uncertainty(report: &ReplayReport) -> Table {
    let columns = vec![
        Column::text("Channel"),
        Column::text("Slope"),
        Column::number("Readings"),
        Column::number("Uncertainty").under("Reported"),
        Column::number("Noise in it").under("Reported"),
        Column::number("Scatter").under("Observed"),
    ];
    let mut table = Table::new("Standard uncertainty at standstill, deg", columns);
    for channel in &report.channels {
        for slope in &channel.slopes {
            let Some(found) = &slope.standstill else {
                continue;
            };
            table.rows.push(vec![
                Cell::text(channel.channel.to_string()),
                Cell::text(axis_name(slope.axis)),
                Cell::text(found.readings.to_string()),
                Cell::number(Some(found.uncertainty_deg), 3),
                Cell::number(Some(found.noise_deg), 3),
                Cell::number(Some(found.scatter_deg), 3),
            ]);
        }
    }
    table
}

/// Mean angles at standstill.
pub fn plateaus(report: &ReplayReport) -> Table {
    let columns = vec![
        Column::text("Channel"),
        Column::number("From, s"),
        Column::number("To, s"),
        Column::number("X").under("Measured"),
        Column::number("Y").under("Measured"),
        Column::number("X").under("Reference"),
        Column::number("Y").under("Reference"),
    ];
    let mut table = Table::new("Standstill plateaus, mean angles in deg", columns);
    for channel in &report.channels {
        table.rows.extend(channel.plateaus.iter().map(|plateau| {
            let angles = [
                plateau.x_deg,
                plateau.y_deg,
                plateau.reference_x_deg,
                plateau.reference_y_deg,
            ];
            let mut cells = vec![
                Cell::text(channel.channel.to_string()),
                Cell::number(Some(plateau.from_s), 1),
                Cell::number(Some(plateau.to_s), 1),
            ];
            cells.extend(angles.map(|angle| Cell::number(angle, 3)));
            cells
        }));
    }
    table
}

/// The comparison of two channels.
pub fn cross_check(report: &ReplayReport) -> Table {
    let columns = vec![
        Column::text("Slope"),
        Column::number("RMS difference"),
        Column::number("RMS at standstill"),
        Column::number("Largest"),
        Column::number("Warnings"),
    ];
    let mut table = Table::new("Channel 1 - channel 2, deg", columns);
    let Some(check) = &report.cross_check else {
        return table;
    };
    for slope in &check.slopes {
        table.rows.push(vec![
            Cell::text(axis_name(slope.axis)),
            Cell::number(slope.rms_deg, 3),
            Cell::number(slope.standstill_rms_deg, 3),
            Cell::number(slope.max_deg, 3),
            Cell::text(slope.warnings.to_string()),
        ]);
    }
    table.notes.push(format!(
        "Pairs compared: {}, threshold: {} deg, stops: {}, faults: {}.",
        check.compared,
        Cell::number(Some(check.threshold_deg), 2).text,
        check.stops,
        check.faults
    ));
    table
}

/// Verdicts over time. A long list is cut, and says so.
pub fn verdicts(report: &ReplayReport) -> Table {
    /// More lines than this are not read by anybody; the JSON holds them all.
    const SHOWN: usize = 40;
    let columns = vec![
        Column::number("From, s"),
        Column::number("To, s"),
        Column::text("Verdict"),
        Column::text("Angle may be used"),
    ];
    let mut table = Table::new("Verdicts", columns);
    table.rows = report
        .verdicts
        .iter()
        .take(SHOWN)
        .map(|interval| {
            vec![
                Cell::number(Some(interval.from_s), 2),
                Cell::number(Some(interval.to_s), 2),
                Cell::text(interval.verdict.as_str()),
                Cell::verdict(interval.trusted, "yes", "NO"),
            ]
        })
        .collect();
    let more = report.verdicts.len().saturating_sub(SHOWN);
    if more > 0 {
        table.notes.push(format!("{more} more in report.json."));
    }
    table
}

/// "paper mode" or "product mode", for a heading.
pub fn mode_words(report: &ReplayReport) -> String {
    format!("{} mode", word(report.mode))
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;

    #[test]
    fn two_channels_give_every_table_and_one_gives_no_comparison() {
        let mut report = sample::replay();
        let titles: Vec<String> = all(&report).into_iter().map(|table| table.title).collect();
        assert_eq!(titles.len(), 8);
        report.cross_check = None;
        report.channels.truncate(1);
        let titles: Vec<String> = all(&report).into_iter().map(|table| table.title).collect();
        assert!(!titles.iter().any(|title| title.starts_with("Channel 1 -")));
    }

    #[test]
    fn skipped_rows_are_told_with_reason_and_line() {
        let table = skipped(&sample::replay());
        let first: Vec<&str> = table.rows[0]
            .iter()
            .map(|cell| cell.text.as_str())
            .collect();
        assert_eq!(first, ["1", "all-zero row", "1", "2"]);
    }

    #[test]
    fn a_long_list_of_verdicts_is_cut_and_says_so() {
        let mut report = sample::replay();
        report.verdicts = vec![report.verdicts[0].clone(); 45];
        let table = verdicts(&report);
        assert_eq!(table.rows.len(), 40);
        assert_eq!(table.notes, ["5 more in report.json."]);
    }

    #[test]
    fn every_row_fills_its_columns() {
        for table in all(&sample::replay()) {
            for row in &table.rows {
                assert_eq!(row.len(), table.columns.len(), "{}", table.title);
            }
        }
    }

    #[test]
    fn a_file_name_can_not_upset_the_terminal() {
        let mut report = sample::replay();
        report.channels[0].file = "a\nb\u{1b}[2J\u{202e}.csv".to_owned();
        let text = recordings(&report).to_text();
        assert!(text.contains("a\\nb\\u{1b}[2J\\u{202e}.csv"), "{text}");
    }
}
