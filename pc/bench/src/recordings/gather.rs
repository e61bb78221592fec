//! From prepared recordings to the report.
//!
//! In: [`Prepared`] channels. Out: a [`ReplayReport`]: each is played through its chain once, and
//! what was seen is put in its place. Times count from the first row of channel 1.

use super::arguments::Mode;
use super::calibration_file::base_name;
use super::figures::{ChannelFigures, seconds};
use super::motion;
use super::play::play;
use super::prepare::Prepared;
use super::scale::Source;
use super::tuning;
use super::verdicts::Judge;
use crate::report::data;
use crate::report::replay_data::{
    CalibrationKind, ReplayChannel, ReplayReport, SkippedRows, SlopeSeries,
};
use output::progress::Progress;
use output::series::rounded;

/// Plays the channels and reports. `notes` are said before those that are found here.
pub fn report(
    channels: &[Prepared],
    mut notes: Vec<String>,
    mode: Mode,
    progress: &Progress,
) -> ReplayReport {
    let chains = tuning::chains(channels, mode);
    let common_us = tuning::common_latency_us(&chains);
    let origin_us = channels.first().map_or(0, |channel| channel.offset_us);
    let both = || channels.iter().zip(&chains);
    let mut figures: Vec<ChannelFigures> = both()
        .map(|(channel, chain)| ChannelFigures::new(channel, chain, origin_us))
        .collect();
    let mut judge = Judge::new(mode, origin_us, span_s(channels, origin_us));
    play(channels, &chains, mode, progress, |moment| {
        let readings = [Some(moment.own), moment.peer].into_iter().flatten();
        let mut at_rest = true;
        for (figures, reading) in figures.iter_mut().zip(readings) {
            at_rest &= figures.see(&reading);
        }
        judge.see(&moment, at_rest);
    });
    let parts = figures.into_iter().zip(both()).zip(1..);
    let reported = parts.map(|((figures, (channel, chain)), number)| {
        let (slopes, plateaus) = figures.slopes();
        let latency_ms = Some(rounded(tuning::latency_ms(chain, common_us)));
        ReplayChannel {
            latency_ms,
            slopes,
            plateaus,
            moving: motion::follow(channel),
            ..about(channel, number)
        }
    });
    let mode_word = match mode {
        Mode::Paper => data::Mode::Paper,
        Mode::Product => data::Mode::Product,
    };
    let mut report = ReplayReport::new(mode_word, reported.collect());
    let (verdicts, more) = judge.intervals();
    report.verdicts = verdicts;
    report.cross_check = (channels.len() > 1).then(|| judge.cross_check());
    notes.extend(notes_on(channels, mode));
    if more > 0 {
        notes.push(format!("{more} more verdicts followed and are not listed."));
    }
    report.notes = notes;
    report
}

/// First and last instant of any channel, in seconds of the report.
fn span_s(channels: &[Prepared], origin_us: u64) -> (f64, f64) {
    let from = channels.iter().map(|c| seconds(c.offset_us, origin_us));
    let to = channels
        .iter()
        .map(|c| seconds(c.offset_us, origin_us) + c.recording.duration_s());
    (from.fold(0.0, f64::min), to.fold(0.0, f64::max))
}

/// What is known of a channel before it is played.
fn about(channel: &Prepared, number: u8) -> ReplayChannel {
    let recording = &channel.recording;
    let skipped = recording.skips.iter().map(|(reason, count)| SkippedRows {
        reason: reason.to_string(),
        count: count.rows,
        first_line: count.first_line,
    });
    let counts = !matches!(recording.scale.source, Source::Unit);
    ReplayChannel {
        channel: number,
        file: base_name(&recording.file),
        rows: recording.data_lines,
        skipped: skipped.collect(),
        gaps: channel.gaps(),
        rate_hz: rounded(recording.rate_hz()),
        duration_s: recording.duration_s(),
        lsb_per_g: counts.then_some(recording.scale.per_g),
        ignored_columns: recording.columns.ignored.clone(),
        calibration: channel.how.clone(),
        latency_ms: None,
        slopes: Vec::<SlopeSeries>::new(),
        moving: None,
        plateaus: Vec::new(),
    }
}

fn notes_on(channels: &[Prepared], mode: Mode) -> Vec<String> {
    let mut notes: Vec<String> = channels.iter().zip(1..).flat_map(channel_notes).collect();
    let any_from = |kind| channels.iter().any(|channel| channel.how.kind == kind);
    if any_from(CalibrationKind::Poses) {
        notes.push(
            "Poses leave the mounting open: slopes are those of the sensor's own axes, without \
             their skew and scale error."
                .to_owned(),
        );
    }
    if any_from(CalibrationKind::Reference) {
        notes.push(
            "The calibration came from the recording it is judged on; replay another run with \
             --calibration to see what it is worth."
                .to_owned(),
        );
    }
    if mode == Mode::Paper {
        notes.push(
            "Paper mode here is the paper's filter, timing and cross-check. Its one-axis table \
             needs a run on a motor, so the angle is that of the three-axis correction."
                .to_owned(),
        );
    }
    notes.push(
        "The latency is that of the chain. What the recorded sensor filtered by itself is not \
         known and not in it."
            .to_owned(),
    );
    notes
}

fn channel_notes((channel, number): (&Prepared, u8)) -> Vec<String> {
    let recording = &channel.recording;
    let mut notes = Vec::new();
    if recording.scale.source == Source::Nearest {
        let per_g = recording.scale.per_g;
        notes.push(format!(
            "Channel {number}: {per_g} LSB per g was taken as the scale; the median length at \
             standstill is {:.1} LSB.",
            recording.scale.standstill_g * per_g
        ));
    }
    if let Some(steady) = &channel.steady {
        notes.push(format!(
            "Channel {number}: the times jitter; the rows were put on a steady clock of {:.1} Hz \
             on the line between the row before and the row after.",
            1e6 / steady.period_us as f64
        ));
    }
    if !recording.has_rate() {
        notes.push(format!(
            "Channel {number}: no gyroscope was recorded (`gx_radps` or `gx_dps`); its angles are \
             those of the accelerometer alone."
        ));
    } else if !motion::takes(channel) {
        notes.push(format!(
            "Channel {number}: its gyroscope was not used, which needs 100 to 2 000 rows a second."
        ));
    }
    let refers = recording.columns.reference.is_some();
    if refers && !recording.has_reference() && channel.how.kind == CalibrationKind::Poses {
        notes.push(format!(
            "Channel {number}: the reference columns are empty; the calibration came from poses \
             instead."
        ));
    }
    if recording.trailing_bytes {
        notes.push(format!(
            "Channel {number}: more bytes follow the end of the gzip stream; they were not read."
        ));
    }
    let unread = recording.unread_extras;
    if unread.rows > 0 {
        notes.push(format!(
            "Channel {number}: {} rows were used without their reference, temperature or rate, \
             which is no attitude or no number (first in line {}).",
            unread.rows, unread.first_line
        ));
    }
    notes
}
