//! The tables of a replay report.
//!
//! In: a [`ReplayReport`]. Out: recordings, skipped rows, calibration, accuracy, plateaus, cross
//! check and verdicts as [`Table`]s, for the terminal and for the page. A table without rows is
//! left out by whoever shows it.

use super::data::word;
use super::replay_data::*;
use super::tables::axis_name;
use output::printable;
use output::table::{Rows, Table, format_number};

/// All tables in reading order, those without rows left out.
pub fn all(report: &ReplayReport) -> Vec<Table> {
    let tables = [
        recordings(report),
        skipped(report),
        calibration(report),
        accuracy(report),
        moving(report),
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

/// What each channel has of something, with the channel.
fn of_each<'a, T: 'a, I: IntoIterator<Item = T>>(
    report: &'a ReplayReport,
    of: impl Fn(&'a ReplayChannel) -> I,
) -> Vec<(&'a ReplayChannel, T)> {
    let with = |channel| of(channel).into_iter().map(move |found| (channel, found));
    let channels = report.channels.iter();
    channels.flat_map(|c| with(c).collect::<Vec<_>>()).collect()
}

/// What was read.
pub fn recordings(report: &ReplayReport) -> Table {
    let skipped = |c: &ReplayChannel| c.skipped.iter().map(|rows| rows.count).sum::<u64>();
    let mut table = Rows::of("Recordings", &report.channels)
        .text("Channel", |c| c.channel)
        .text("File", |c| printable(&c.file))
        .count("Rows", |c| c.rows)
        .count("Skipped", skipped)
        .count("Gaps", |c| c.gaps)
        .number("Rate, Hz", 1, |c| c.rate_hz)
        .number("Duration, s", 1, |c| c.duration_s)
        .number("LSB per g", 0, |c| c.lsb_per_g)
        .number("Latency, ms", 1, |c| c.latency_ms)
        .table();
    let with_strangers = report.channels.iter();
    for channel in with_strangers.filter(|c| !c.ignored_columns.is_empty()) {
        let names = channel.ignored_columns.join(", ");
        table = table.noted(format!("Channel {}: not used: {names}.", channel.channel));
    }
    table
}

/// Rows that were left out.
pub fn skipped(report: &ReplayReport) -> Table {
    Rows::of("Skipped rows", &of_each(report, |channel| &channel.skipped))
        .text("Channel", |(c, _)| c.channel)
        .text("Reason", |(_, rows)| &rows.reason)
        .count("Rows", |(_, rows)| rows.count)
        .count("First line", |(_, rows)| rows.first_line)
        .table()
}

/// How each channel was calibrated.
pub fn calibration(report: &ReplayReport) -> Table {
    Rows::of(
        "Calibration",
        &of_each(report, |channel| [&channel.calibration]),
    )
    .text("Channel", |(c, _)| c.channel)
    .text("Calibrated from", |(_, by)| calibration_name(by.kind))
    .number("Poses", 0, |(_, by)| by.poses.map(|count| count as f64))
    .number("Residual, mg rms", 3, |(_, by)| by.residual_mg)
    .number("Residual, deg rms", 3, |(_, by)| by.residual_deg)
    .number("Condition", 1, |(_, by)| by.condition)
    .table()
}

fn calibration_name(kind: CalibrationKind) -> &'static str {
    match kind {
        CalibrationKind::Poses => "standstill poses",
        CalibrationKind::Reference => "reference columns",
        CalibrationKind::File => "calibration file",
        CalibrationKind::Nominal => "none, nominal",
    }
}

/// Errors against the recorded reference.
pub fn accuracy(report: &ReplayReport) -> Table {
    let rows = of_each(report, |channel| {
        channel.slopes.iter().flat_map(|slope| {
            let axis = axis_name(slope.axis);
            let plateaus = slope.accuracy_at_plateaus.iter();
            let plateaus = plateaus.map(move |found| (axis, "plateaus, their means", found));
            let whole = slope.accuracy.iter();
            plateaus.chain(whole.map(move |found| (axis, "the whole recording", found)))
        })
    });
    Rows::of("Error against the recorded reference, deg", &rows)
        .text("Channel", |(c, _)| c.channel)
        .text("Slope", |(_, (axis, ..))| axis)
        .text("Over", |(_, (_, over, _))| over)
        .count("Compared", |(_, (.., found))| found.compared)
        .number("Mean", 3, |(_, (.., found))| found.mean_deg)
        .number("RMSE", 3, |(_, (.., found))| found.rmse_deg)
        .number("Largest", 3, |(_, (.., found))| found.max_deg)
        .table()
}

/// The vertical with the gyroscope.
pub fn moving(report: &ReplayReport) -> Table {
    Rows::of(
        "Vertical with the gyroscope against the recorded reference",
        &of_each(report, |channel| &channel.moving),
    )
    .text("Channel", |(c, _)| c.channel)
    .count("Compared", |(_, found)| found.compared)
    .count("Without", |(_, found)| found.without)
    .number("RMS, deg", 3, |(_, found)| found.rms_deg)
    .number("Largest, deg", 3, |(_, found)| found.max_deg)
    .number("Stated, deg", 3, |(_, found)| found.uncertainty_deg)
    .under("Standard uncertainty")
    .number("Within k = 2, %", 1, |(_, found)| found.within_2u_percent)
    .under("Standard uncertainty")
    .number("k = 3, %", 1, |(_, found)| found.within_3u_percent)
    .under("Standard uncertainty")
    .table()
}

/// What each channel reports of its uncertainty at standstill, beside what was seen.
pub fn uncertainty(report: &ReplayReport) -> Table {
    let rows = of_each(report, |channel| {
        let slopes = channel.slopes.iter();
        slopes.filter_map(|slope| Some((axis_name(slope.axis), slope.standstill.as_ref()?)))
    });
    Rows::of("Standard uncertainty at standstill, deg", &rows)
        .text("Channel", |(c, _)| c.channel)
        .text("Slope", |(_, (axis, _))| axis)
        .count("Readings", |(_, (_, found))| found.readings)
        .number("Uncertainty", 3, |(_, (_, found))| found.uncertainty_deg)
        .under("Reported")
        .number("Noise in it", 3, |(_, (_, found))| found.noise_deg)
        .under("Reported")
        .number("Scatter", 3, |(_, (_, found))| found.scatter_deg)
        .under("Observed")
        .table()
}

/// Mean angles at standstill.
pub fn plateaus(report: &ReplayReport) -> Table {
    Rows::of(
        "Standstill plateaus, mean angles in deg",
        &of_each(report, |channel| &channel.plateaus),
    )
    .text("Channel", |(c, _)| c.channel)
    .number("From, s", 1, |(_, p)| p.from_s)
    .number("To, s", 1, |(_, p)| p.to_s)
    .number("X", 3, |(_, p)| p.x_deg)
    .under("Measured")
    .number("Y", 3, |(_, p)| p.y_deg)
    .under("Measured")
    .number("X", 3, |(_, p)| p.reference_x_deg)
    .under("Reference")
    .number("Y", 3, |(_, p)| p.reference_y_deg)
    .under("Reference")
    .table()
}

/// The comparison of two channels.
pub fn cross_check(report: &ReplayReport) -> Table {
    let slopes = report.cross_check.iter().flat_map(|check| &check.slopes);
    let table = Rows::of("Channel 1 - channel 2, deg", &slopes.collect::<Vec<_>>())
        .text("Slope", |slope| axis_name(slope.axis))
        .number("RMS difference", 3, |slope| slope.rms_deg)
        .number("RMS at standstill", 3, |slope| slope.standstill_rms_deg)
        .number("Largest", 3, |slope| slope.max_deg)
        .count("Warnings", |slope| slope.warnings)
        .table();
    let Some(check) = &report.cross_check else {
        return table;
    };
    table.noted(format!(
        "Pairs compared: {}, threshold: {} deg, stops: {}, faults: {}.",
        check.compared,
        format_number(Some(check.threshold_deg), 2),
        check.stops,
        check.faults
    ))
}

/// Verdicts over time. A long list is cut, with a note of it.
pub fn verdicts(report: &ReplayReport) -> Table {
    /// More lines than this are not read by anybody; the JSON holds them all.
    const SHOWN: usize = 40;
    let shown = report.verdicts.len().min(SHOWN);
    let (shown, more) = report.verdicts.split_at(shown);
    let table = Rows::of("Verdicts", shown)
        .number("From, s", 2, |interval| interval.from_s)
        .number("To, s", 2, |interval| interval.to_s)
        .text("Verdict", |interval| &interval.verdict)
        .verdict("Angle may be used", ["yes", "NO"], |i| i.trusted)
        .table();
    match more.len() {
        0 => table,
        more => table.noted(format!("{more} more in report.json.")),
    }
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
        assert_eq!(titles.len(), 9);
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
    fn a_long_list_of_verdicts_is_cut_with_a_note() {
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
