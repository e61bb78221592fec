//! From what was collected to the report.
//!
//! In: [`Collected`], the logs that were read, the bit rate where it is known. Out: a
//! [`PeriodReport`] without memories. Units are turned here: 0.001 deg and ns into deg and s.

use super::charts::CHANNEL_A;
use super::clock::Clock;
use super::data::*;
use super::verdict;
use crate::blackbox::data::{PlotReport, PlotRow};
use crate::totals::{
    Bins, Capture, ChannelSummary, Collected, Day, DifferenceSummary, End, Event, Extremes, Gaps,
    Identity, Instrument, Kind, Last, MotionSummary, Recorder, Summary, Tally, Traffic, Unusable,
    What,
};
use codes::words;
use listen::Round;
use output::series::{Bin, Point, rounded};

/// The percentiles that are told.
const PERCENTILES: [f64; 5] = [1.0, 5.0, 50.0, 95.0, 99.0];

/// Bars of a histogram, about.
const BARS: usize = 60;

/// A step of the rates on the bus, deg/s.
const CENTIDEGREE: f64 = 0.01;

/// Days between which those without data are told one by one; beyond them only days with data.
const MOST_DAYS: u64 = 800;

/// The report: what was collected of each interface, the logs, and the bit rate where it is known,
/// bit/s.
pub fn report(
    collected: &[(String, Collected)],
    logs: Option<LogsReport>,
    bit_rate: Option<f64>,
) -> PeriodReport {
    let spans = || {
        collected
            .iter()
            .filter_map(|(_, one)| one.traffic.span_ns())
    };
    let first = spans().map(|span| span.0).min();
    let clock = Clock::of(first.unwrap_or(0));
    let mut report = PeriodReport {
        clock: match clock {
            Clock::Utc => "utc".to_owned(),
            Clock::Relative => "relative".to_owned(),
        },
        from_s: first.map(seconds),
        to_s: spans().map(|span| span.1).max().map(seconds),
        covered_s: seconds(
            collected
                .iter()
                .map(|(_, one)| one.traffic.covered_ns)
                .max()
                .unwrap_or(0),
        ),
        logs,
        ..empty()
    };
    for (interface, one) in collected
        .iter()
        .filter(|(_, one)| one.traffic.span_ns().is_some())
    {
        // A pair of which nothing but frames of another form was seen is somebody else's nodes.
        let seen = one
            .instruments
            .iter()
            .filter(|(_, instrument)| has_slopes(instrument));
        let number = report.instruments.len() + 1;
        let instruments: Vec<_> = (number..)
            .zip(seen)
            .map(|(number, (sides, instrument))| InstrumentReport {
                interface: interface.clone(),
                ..self::one(number, sides, instrument, clock)
            })
            .collect();
        report.buses.push(BusReport {
            interface: interface.clone(),
            ..bus(one, &instruments, bit_rate)
        });
        report.instruments.extend(instruments);
    }
    report
}

/// A report that tells of nothing yet.
pub fn empty() -> PeriodReport {
    PeriodReport {
        format: FORMAT.to_owned(),
        version: VERSION,
        plumb_version: env!("CARGO_PKG_VERSION").to_owned(),
        clock: "relative".to_owned(),
        ..PeriodReport::default()
    }
}

/// Adds what it all comes to, once everything is in.
pub fn conclude(report: &mut PeriodReport) {
    (report.verdict, report.clean) = verdict::of(report);
    let notes = verdict::notes(report);
    report.notes.splice(0..0, notes);
}

fn has_slopes(instrument: &Instrument) -> bool {
    let channels = &instrument.summary.channels;
    channels.iter().any(|channel| {
        channel.usable_ns > 0
            || !channel.unusable_ns.is_empty()
            || channel.slope.iter().any(|slope| slope.count() > 0)
            || channel.boots > 0
    })
}

/// ns as s, to the microsecond.
pub fn seconds(ns: u64) -> f64 {
    (ns / 1000) as f64 / 1e6
}

fn degrees(mdeg: impl Into<f64>) -> f64 {
    rounded(mdeg.into() * 1e-3)
}

fn bus(
    collected: &Collected,
    instruments: &[InstrumentReport],
    bit_rate: Option<f64>,
) -> BusReport {
    let (traffic, counts) = (&collected.traffic, &collected.counts);
    let channels = instruments.iter().flat_map(|one| &one.channels);
    let ours: Vec<u8> = channels.map(|channel| channel.node_id).collect();
    let foreign = traffic.nodes().filter(|(id, _)| !ours.contains(id));
    let rate = traffic.rate();
    BusReport {
        interface: String::new(),
        frames: counts.frames,
        syncs: counts.syncs,
        outside: collected.outside,
        undated: collected.undated,
        backwards: counts.backwards,
        malformed: instruments
            .iter()
            .flat_map(|one| &one.channels)
            .map(|c| c.malformed)
            .fold(0, u64::saturating_add),
        extended: counts.extended,
        remote: counts.remote,
        commands: counts.nmt,
        foreign: foreign
            .map(|(node_id, frames)| ForeignNode { node_id, frames })
            .collect(),
        rate_bit_s: rate.map(rounded),
        bit_rate_bit_s: bit_rate,
        load_percent: rate
            .zip(bit_rate)
            .map(|(rate, most)| rounded(100.0 * rate / most)),
        rate_bins: rate_bins(traffic),
        bin_s: seconds(traffic.bits.width_ns()),
        gaps: gaps(&traffic.gaps),
    }
}

fn rate_bins(traffic: &Traffic) -> Vec<Point> {
    let half = 0.5 * seconds(traffic.bits.width_ns());
    let rates = traffic.rates().into_iter();
    rates
        .map(|(from_ns, rate)| Point(seconds(from_ns) + half, Some(rounded(rate))))
        .collect()
}

fn gaps(gaps: &Gaps) -> GapsReport {
    let longest = gaps.in_time().into_iter().map(|gap| GapReport {
        from_s: seconds(gap.from_ns),
        to_s: seconds(gap.to_ns),
        whole_bus: gap.whole_bus,
    });
    GapsReport {
        count: gaps.count(),
        sum_s: seconds(gaps.sum_ns()),
        longest: longest.collect(),
    }
}

fn one(
    number: usize,
    sides: &[Last; 2],
    instrument: &Instrument,
    clock: Clock,
) -> InstrumentReport {
    let summary = &instrument.summary;
    let ids = [0, 1].map(|side: usize| sides[side].node_id);
    let span = instrument.span_ns.unwrap_or_default();
    let [faults_left_out, others_left_out] = instrument.events.left_out();
    InstrumentReport {
        number,
        interface: String::new(),
        from_s: seconds(span.0),
        to_s: seconds(span.1),
        covered_s: seconds(summary.covered_ns()),
        gaps: gaps(&summary.gaps),
        channels: (0..2)
            .zip(sides)
            .zip(&summary.channels)
            .map(|((side, last), channel)| self::channel(side, last, channel, instrument))
            .collect(),
        difference: difference(&summary.difference),
        days: days(summary, clock),
        events: instrument
            .events
            .concluded()
            .iter()
            .map(|event| self::event(event, ids))
            .collect(),
        faults_left_out,
        others_left_out,
        plots: plots(&instrument.recorder, clock),
        plots_left_out: instrument.recorder.left_out(),
    }
}

fn channel(
    side: usize,
    last: &Last,
    channel: &ChannelSummary,
    instrument: &Instrument,
) -> ChannelReport {
    let identity = instrument.identity(side);
    let numbers = identity.map_or([None; 5], Identity::numbers);
    let [vendor_id, product_code, revision, serial_number, sum] = numbers;
    let axes = channel.slope.iter().zip(&channel.slope_bins);
    let codes = channel.emergencies.iter();
    ChannelReport {
        channel: words::channel(side).to_owned(),
        node_id: last.node_id,
        seen: last.seen,
        vendor_id,
        product_code,
        revision,
        serial_number,
        software: identity.and_then(Identity::software).map(str::to_owned),
        calibration_crc32: sum.map(|sum| format!("{sum:08X}")),
        report_sha256: identity.and_then(Identity::report_hash).map(str::to_owned),
        slopes: (0..)
            .zip(axes)
            .map(|(axis, (tally, bins))| slope(axis, tally, bins))
            .collect(),
        usable_s: seconds(channel.usable_ns),
        unusable: channel
            .unusable_ns
            .iter()
            .map(|(why, ns)| unusable(*why, *ns))
            .collect(),
        uncertainty: quantity(&channel.uncertainty, &channel.uncertainty_bins, 1e-3),
        uncertainty_unknown: channel.uncertainty_unknown,
        temperature: quantity(&channel.temperature, &channel.temperature_bins, 1.0),
        activity: quantity(&channel.activity, &channel.activity_bins, 1.0),
        motion: channel.motion.as_deref().map(motion),
        emergencies: codes
            .map(|(code, count)| CodeReport {
                code: format!("{code:04X}h"),
                text: words::code(*code).into_owned(),
                count: *count,
            })
            .collect(),
        boots: channel.boots,
        heartbeat_losses: channel.heartbeat_losses,
        heartbeat_lost_s: seconds(channel.heartbeat_lost_ns),
        malformed: channel.malformed,
        findings: channel
            .checks
            .found()
            .map(|(check, finding)| FindingReport {
                check: check.name().to_owned(),
                text: check.words().to_owned(),
                count: finding.count,
                first_s: seconds(finding.first_ns),
            })
            .collect(),
    }
}

fn motion(summary: &MotionSummary) -> MotionReport {
    let slopes = (0..).zip(&summary.slope);
    let rates = ["x", "y", "z"].into_iter().zip(&summary.rate);
    MotionReport {
        angles: summary.angles,
        slopes: slopes.map(|(axis, tally)| figures(axis, tally)).collect(),
        uncertainty: quantity(&summary.uncertainty, &summary.uncertainty_bins, 1e-3),
        messages: summary.rates,
        rates: rates.map(|(axis, tally)| rate(axis, tally)).collect(),
        fastest_bins: bins(&summary.fastest_bins, CENTIDEGREE),
    }
}

fn rate(axis: &str, tally: &Tally) -> RateReport {
    let scaled = |value: f64| rounded(value * CENTIDEGREE);
    RateReport {
        axis: axis.to_owned(),
        count: tally.count(),
        min_dps: tally.extremes().map(|both| scaled(both.0.into())),
        max_dps: tally.extremes().map(|both| scaled(both.1.into())),
        mean_dps: tally.mean().map(scaled),
        rms_dps: tally.rms().map(scaled),
    }
}

/// Why slopes that the channel marks as valid are not used.
const OTHER_UNIT: &str = "its slopes are in another unit (6000h) than taken: state it by --eds";

fn unusable(why: Unusable, ns: u64) -> UnusableReport {
    UnusableReport {
        state: why.state,
        state_text: why.state.map_or("not sent".into(), |state| {
            words::state(state, words::CHANNELS).into_owned()
        }),
        reason: why.reason,
        reason_text: match why.other_unit {
            true => Some(OTHER_UNIT.to_owned()),
            false => words::reason(why.reason).map(Into::into),
        },
        other_unit: why.other_unit,
        time_s: seconds(ns),
    }
}

/// Whom a channel blames: itself, the other one, both.
const fn blamed_by(side: usize) -> [&'static str; 3] {
    match side {
        0 => ["A", "B", "A and B"],
        _ => ["B", "A", "A and B"],
    }
}

fn axis_name(axis: usize) -> String {
    if axis == 0 { "x" } else { "y" }.to_owned()
}

fn slope(axis: usize, tally: &Tally, over_time: &Bins<Extremes>) -> SlopeReport {
    SlopeReport {
        values: figures(axis, tally),
        bins: bins(over_time, 1e-3),
    }
}

fn figures(axis: usize, tally: &Tally) -> AxisFigures {
    AxisFigures {
        axis: axis_name(axis),
        count: tally.count(),
        min_deg: tally.extremes().map(|both| degrees(both.0)),
        max_deg: tally.extremes().map(|both| degrees(both.1)),
        mean_deg: tally.mean_angle().map(degrees),
        std_deg: tally.angle_deviation().map(degrees),
        percentiles: percentiles(tally),
        step_deg: degrees(tally.histogram.step_mdeg() as f64),
    }
}

fn percentiles(tally: &Tally) -> Vec<Percentile> {
    let values = PERCENTILES.into_iter().filter_map(|percent| {
        let mdeg = tally.histogram.percentile(percent / 100.0)?;
        // The middle of a step may lie beyond the last value in it.
        let (least, most) = tally.extremes()?;
        let mdeg = mdeg.clamp(i64::from(least), i64::from(most));
        Some(Percentile {
            percent,
            value_deg: degrees(mdeg as f64),
        })
    });
    values.collect()
}

fn bins(over_time: &Bins<Extremes>, unit: f64) -> Vec<Bin> {
    let half = 0.5 * seconds(over_time.width_ns());
    let scaled = |value: i32| rounded(f64::from(value) * unit);
    let bins = over_time.iter();
    bins.map(|(from_ns, both)| {
        Bin(
            seconds(from_ns) + half,
            scaled(both.least),
            scaled(both.most),
        )
    })
    .collect()
}

fn quantity(tally: &Tally, over_time: &Bins<Extremes>, unit: f64) -> QuantityReport {
    let scaled = |value: i32| rounded(f64::from(value) * unit);
    QuantityReport {
        count: tally.count(),
        min: tally.extremes().map(|both| scaled(both.0)),
        max: tally.extremes().map(|both| scaled(both.1)),
        mean: tally.mean().map(|mean| rounded(mean * unit)),
        bins: bins(over_time, unit),
    }
}

fn difference(summary: &DifferenceSummary) -> DifferenceReport {
    let size = |tally: &Tally| {
        let both = tally.extremes()?;
        Some(degrees(both.0.unsigned_abs().max(both.1.unsigned_abs())))
    };
    DifferenceReport {
        syncs_measured: summary.by_measured,
        syncs_slopes: summary.by_slopes,
        slopes: (0..)
            .zip(&summary.own)
            .map(|(axis, tally)| slope_difference(axis, tally))
            .collect(),
        bins: bins(&summary.bins, 1e-3),
        judged: summary.judged,
        above: summary.above,
        told_count: summary.told.count(),
        told_max_deg: size(&summary.told),
        told_off_mean_deg: summary.told_off.mean().map(degrees),
        told_off_max_deg: size(&summary.told_off),
    }
}

fn slope_difference(axis: usize, tally: &Tally) -> SlopeDifference {
    let bars = tally.histogram.bars(BARS);
    SlopeDifference {
        values: figures(axis, tally),
        bar_deg: bars.first().map_or(0.0, |bar| degrees(bar.1 as f64)),
        histogram: bars
            .iter()
            .map(|(middle, _, count)| Point(degrees(*middle as f64), Some(*count as f64)))
            .collect(),
    }
}

/// Every day from the first to the last one with data.
fn days(summary: &Summary, clock: Clock) -> Vec<DayReport> {
    let Some((first, last)) = summary.days.ends() else {
        return Vec::new();
    };
    let none = Day::default();
    if last - first > MOST_DAYS {
        let days = summary.days.iter();
        return days
            .map(|(number, day)| self::day(clock, number, day))
            .collect();
    }
    (first..=last)
        .map(|number| day(clock, number, summary.days.get(number).unwrap_or(&none)))
        .collect()
}

fn day(clock: Clock, number: u64, day: &Day) -> DayReport {
    let kinds = Kind::ALL.into_iter().zip(day.events);
    DayReport {
        day: clock.day(number),
        covered_s: seconds(day.covered_ns),
        syncs: day.syncs,
        incidents: day.incidents,
        kinds: kinds
            .filter(|(_, count)| *count > 0)
            .map(|(kind, count)| KindReport {
                kind: kind.key().to_owned(),
                count,
            })
            .collect(),
        difference_max_deg: day.largest_mdeg.map(degrees),
    }
}

fn event(event: &Event, ids: [u8; 2]) -> EventReport {
    let side = usize::from(event.side);
    let (code, text) = match event.what {
        What::Emergency(code) => (Some(format!("{code:04X}h")), words::code(code)),
        What::HeartbeatLost => (None, "the heartbeat stayed away".into()),
        What::Restart => (None, "the node restarted".into()),
    };
    let (end, until_ns) = match event.end {
        End::Momentary => ("momentary", None),
        End::Over(at_ns) => ("over", Some(at_ns)),
        End::Restarted(at_ns) => ("restart", Some(at_ns)),
        End::Standing => ("standing", None),
    };
    EventReport {
        time_s: seconds(event.at_ns),
        channel: words::channel(side).to_owned(),
        node_id: ids.get(side).copied().unwrap_or_default(),
        kind: event.what.kind().key().to_owned(),
        code,
        text: text.into_owned(),
        blamed: words::blamed(event.blamed, blamed_by(side)).map(str::to_owned),
        reason_text: words::reason(event.reason).map(Into::into),
        state: event.state,
        end: end.to_owned(),
        duration_s: until_ns.map(|ns| seconds(ns.saturating_sub(event.at_ns))),
        repeats: event.repeats,
        plot: event.plot.map(|plot| plot.saturating_add(1)),
    }
}

fn plots(recorder: &Recorder, clock: Clock) -> Vec<PlotReport> {
    let captures = (1..).zip(recorder.captures());
    captures
        .map(|(number, capture)| PlotReport {
            number,
            title: clock.text(capture.at_ns),
            names: [CHANNEL_A, "Channel B"].map(str::to_owned),
            time_s: seconds(capture.at_ns),
            rows: capture
                .rows
                .iter()
                .map(|row| plot_row(row, capture))
                .collect(),
        })
        .collect()
}

fn plot_row(row: &Round, capture: &Capture) -> PlotRow {
    let angle = |side, axis| row.angle(side, axis).map(degrees);
    PlotRow {
        since_s: rounded(row.time_ns.wrapping_sub(capture.at_ns) as i64 as f64 * 1e-9),
        a_x_deg: angle(0, 0),
        a_y_deg: angle(0, 1),
        b_x_deg: angle(1, 0),
        b_y_deg: angle(1, 1),
        difference_x_deg: row.difference(0).map(degrees),
        difference_y_deg: row.difference(1).map(degrees),
    }
}
