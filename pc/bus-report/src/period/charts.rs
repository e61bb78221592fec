//! The charts of a period report.
//!
//! In: a [`PeriodReport`]. Out: charts in the manner of the paper's figures: errors per day as in
//! figure 20, the difference of the channels around a fault as in figure 21, and what goes over
//! time.

use super::clock::Clock;
use super::data::*;
use super::tables;
use crate::blackbox::data::{PlotReport, PlotRow};
use output::chart::{Chart, Ink, Plot, Shape};
use output::series::{Bin, Point};

/// Steps of a time axis, s, the last ones of whole days.
const STEPS_S: [f64; 22] = [
    1.0,
    2.0,
    5.0,
    10.0,
    15.0,
    30.0,
    60.0,
    120.0,
    300.0,
    600.0,
    900.0,
    1800.0,
    3600.0,
    7200.0,
    10_800.0,
    21_600.0,
    43_200.0,
    86_400.0,
    172_800.0,
    604_800.0,
    2_592_000.0,
    31_536_000.0,
];

/// Ticks of a time axis, at most about.
const TICKS: f64 = 6.0;

/// Days whose names have room below the bars.
const NAMED_DAYS: usize = 8;

/// Days for which there is room at least.
const FEWEST_DAYS: usize = 5;

/// The colours of channel A and B.
const INKS: [Ink; 2] = [Ink::First, Ink::Second];

/// The ticks of a time axis, and what they are.
fn time_axis(report: &PeriodReport) -> (Vec<(f64, String)>, String) {
    let (from, to) = (report.from_s.unwrap_or(0.0), report.to_s.unwrap_or(0.0));
    let fits = |step: &&f64| (to - from) / **step <= TICKS;
    let step = STEPS_S
        .iter()
        .find(fits)
        .copied()
        .unwrap_or(STEPS_S[STEPS_S.len() - 1]);
    let first = (from / step).ceil() as u64;
    let clock = tables::clock(report);
    let ticks = (0..)
        .map(|n| (first + n) as f64 * step)
        .take_while(|at| *at <= to);
    let label = |at: f64| match step {
        step if step >= 86_400.0 => clock.short_day((at / 86_400.0) as u64),
        step if step >= 60.0 => Clock::minute(tables::ns(at)),
        _ => clock.text(tables::ns(at)).split_off_time(),
    };
    let name = match (clock, step >= 86_400.0) {
        (Clock::Utc, true) => "day, UTC".to_owned(),
        (Clock::Utc, false) => format!("time, UTC, from {}", clock.day((from / 86_400.0) as u64)),
        (Clock::Relative, true) => "day of the log".to_owned(),
        (Clock::Relative, false) => "time of the log".to_owned(),
    };
    (ticks.map(|at| (at, label(at))).collect(), name)
}

/// The time of day at the end of an instant in words.
trait TimeOfDay {
    fn split_off_time(self) -> String;
}

impl TimeOfDay for String {
    fn split_off_time(self) -> String {
        let time = self.rsplit(' ').next().unwrap_or_default();
        time.split('.').next().unwrap_or_default().to_owned()
    }
}

/// Bins as a band that is broken where bins are missing.
fn band(bins: &[Bin]) -> Shape {
    let steps = bins.windows(2).map(|two| two[1].0 - two[0].0);
    let width = steps.reduce(f64::min).unwrap_or(1.0);
    let mut all = Vec::with_capacity(bins.len());
    let mut last = f64::NAN;
    for Bin(at, least, most) in bins.iter().copied() {
        if at - last > 1.5 * width {
            all.push((last + width, f64::NAN, f64::NAN));
        }
        all.push((at, least, most));
        last = at;
    }
    Shape::Band(all)
}

/// A chart over the period.
fn over_time(report: &PeriodReport, id: String, title: &str, y: &str, plots: Vec<Plot>) -> Chart {
    let (x_names, x_label) = time_axis(report);
    Chart {
        id,
        title: title.to_owned(),
        description: format!("{title}, {y}, over the period; least and greatest per bin."),
        x_label,
        y_label: y.to_owned(),
        plots,
        x_names,
        x_range: report.from_s.zip(report.to_s),
        ..Chart::default()
    }
}

/// The bands of both channels, of those that have one.
fn of_channels(
    instrument: &InstrumentReport,
    bins: impl Fn(&ChannelReport) -> Option<&[Bin]>,
) -> Vec<Plot> {
    let channels = instrument.channels.iter().zip(INKS);
    let plots = channels.filter_map(|(channel, ink)| {
        let name = format!("Channel {}", channel.channel);
        Some(Plot::new(name, ink, band(bins(channel)?)))
    });
    plots.collect()
}

/// As figure 20: warnings and faults per day, days without data shaded.
pub fn per_day(instrument: &InstrumentReport) -> Chart {
    let days = &instrument.days;
    let is_empty = |day: &DayReport| day.covered_s == 0.0 && day.syncs == 0;
    let numbered = || (0..).map(f64::from).zip(days);
    let bars = numbered().map(|(at, day)| {
        (
            at,
            if is_empty(day) {
                f64::NAN
            } else {
                day.incidents as f64
            },
        )
    });
    let every = days.len().div_ceil(NAMED_DAYS).max(1);
    let shaded = numbered().filter(|(_, day)| is_empty(day));
    Chart {
        id: format!("days-{}", instrument.number),
        title: "Incidents per day".to_owned(),
        description: "Warnings and faults of each day that stand apart by more than a second."
            .to_owned(),
        x_label: "day".to_owned(),
        y_label: "incidents".to_owned(),
        plots: vec![Plot::new(
            "Incidents",
            Ink::First,
            Shape::Bars(bars.collect()),
        )],
        shaded: shaded.map(|(at, _)| (at - 0.5, at + 0.5)).collect(),
        shaded_name: "no data".to_owned(),
        x_names: numbered()
            .step_by(every)
            .map(|(at, day)| (at, short(&day.day)))
            .collect(),
        // A single day needs no bar as wide as the chart.
        x_range: Some((-0.5, days.len().max(FEWEST_DAYS) as f64 - 0.5)),
        ..Chart::default()
    }
}

/// A day without its year.
fn short(day: &str) -> String {
    match day.split_once('-') {
        Some((_, rest)) => rest.to_owned(),
        None => day.trim_start_matches("day ").to_owned(),
    }
}

/// The slopes over time.
pub fn slopes(report: &PeriodReport, instrument: &InstrumentReport) -> Vec<Chart> {
    let one = |axis: usize, name: &str| {
        let plots = of_channels(instrument, |channel| {
            let slope = channel.slopes.get(axis)?;
            (slope.values.count > 0).then_some(slope.bins.as_slice())
        });
        let id = format!("slope-{}-{}", name.to_lowercase(), instrument.number);
        over_time(report, id, &format!("Slope {name}"), "deg", plots)
    };
    vec![one(0, "X"), one(1, "Y")]
}

/// How often which difference came.
pub fn histograms(instrument: &InstrumentReport) -> Vec<Chart> {
    let slopes = instrument
        .difference
        .slopes
        .iter()
        .filter(|slope| slope.values.count > 0);
    slopes
        .map(|slope| {
            let name = slope.values.axis.to_uppercase();
            let share = |point: &Point| {
                let count = point.1.unwrap_or(0.0);
                (
                    point.0,
                    if count > 0.0 {
                        100.0 * count / slope.values.count as f64
                    } else {
                        0.0
                    },
                )
            };
            Chart {
                id: format!("histogram-{}-{}", slope.values.axis, instrument.number),
                title: format!("Difference of slope {name}: how often"),
                description: format!(
                    "Share of the SYNCs in each step of {} degrees of the difference.",
                    slope.bar_deg
                ),
                x_label: "channel A \u{2212} channel B, deg".to_owned(),
                y_label: format!("% of SYNCs per {} deg", slope.bar_deg),
                plots: vec![Plot::new(
                    "Share",
                    Ink::First,
                    Shape::Bars(slope.histogram.iter().map(share).collect()),
                )],
                x_ticks_are_round: true,
                ..Chart::default()
            }
        })
        .collect()
}

/// The difference over time.
pub fn difference(report: &PeriodReport, instrument: &InstrumentReport) -> Chart {
    let plots = vec![Plot::new(
        "Difference",
        Ink::Other,
        band(&instrument.difference.bins),
    )];
    let id = format!("difference-{}", instrument.number);
    let title = "Difference of the channels, the larger of X and Y";
    over_time(report, id, title, "A \u{2212} B, deg", plots)
}

/// Uncertainty and temperature over time.
pub fn quantities(report: &PeriodReport, instrument: &InstrumentReport) -> Vec<Chart> {
    let plots = |of: fn(&ChannelReport) -> &QuantityReport| {
        of_channels(instrument, |channel| {
            let quantity = of(channel);
            (quantity.count > 0).then_some(quantity.bins.as_slice())
        })
    };
    let number = instrument.number;
    let mut charts = vec![
        over_time(
            report,
            format!("uncertainty-{number}"),
            "Standard uncertainty (k = 1)",
            "deg",
            plots(|channel| &channel.uncertainty),
        ),
        over_time(
            report,
            format!("temperature-{number}"),
            "Temperature of the sensors",
            "degC",
            plots(|channel| &channel.temperature),
        ),
    ];
    let activity = plots(|channel| &channel.activity);
    if !activity.is_empty() {
        charts.push(over_time(
            report,
            format!("vibration-{number}"),
            "Vibration: energy above 150 Hz",
            "8 steps per doubling, 64 is the own noise",
            activity,
        ));
    }
    charts
}

/// Rates of turn and the uncertainty of the angle now over time, each where a channel has sent it.
pub fn motion(report: &PeriodReport, instrument: &InstrumentReport) -> Vec<Chart> {
    type Of = fn(&MotionReport) -> (u64, &[Bin]);
    let rates: Of = |motion| (motion.messages, &motion.fastest_bins);
    let now: Of = |motion| (motion.angles, &motion.uncertainty.bins);
    let number = instrument.number;
    let kinds = [
        (
            format!("rate-{number}"),
            "Rate of turn about the fastest axis",
            "deg/s",
            rates,
        ),
        (
            format!("uncertainty-now-{number}"),
            "Standard uncertainty of the angle now (k = 1)",
            "deg",
            now,
        ),
    ];
    let charts = kinds.into_iter().filter_map(|(id, title, unit, of)| {
        let plots = of_channels(instrument, |channel| {
            let (messages, bins) = of(channel.motion.as_ref()?);
            (messages > 0).then_some(bins)
        });
        (!plots.is_empty()).then(|| over_time(report, id, title, unit, plots))
    });
    charts.collect()
}

/// What was on the bus over time.
pub fn load(report: &PeriodReport, number: usize, bus: &BusReport) -> Chart {
    let (unit, y) = match bus.bit_rate_bit_s {
        Some(rate) => (100.0 / rate, "% of the bit rate"),
        None => (1e-3, "kbit/s"),
    };
    let bins: Vec<Bin> = bus
        .rate_bins
        .iter()
        .filter_map(|point| {
            let rate = point.1? * unit;
            Some(Bin(point.0, 0.0, rate))
        })
        .collect();
    let plots = vec![Plot::new("Load", Ink::First, band(&bins))];
    over_time(
        report,
        format!("load-{number}"),
        "Load of the bus",
        y,
        plots,
    )
}

/// The name of channel A in a plot out of a log; in a box it is not known which channel is which.
pub const CHANNEL_A: &str = "Channel A";

/// As figure 21: both channels around an event, and the difference between them.
pub fn around(plot: &PlotReport, prefix: &str) -> Vec<Chart> {
    let is_y = larger(plot, |row| row.difference_y_deg) > larger(plot, |row| row.difference_x_deg);
    let (axis, a, b): (&str, Of, Of) = if is_y {
        ("Y", |row| row.a_y_deg, |row| row.b_y_deg)
    } else {
        ("X", |row| row.a_x_deg, |row| row.b_x_deg)
    };
    let lines = |name: &str, ink, of: Of| {
        let points = plot
            .rows
            .iter()
            .map(|row| (row.since_s * 1e3, of(row).unwrap_or(f64::NAN)));
        Plot::new(name, ink, Shape::Markers(points.collect()))
    };
    let (word, minus) = match plot.names[0].as_str() {
        CHANNEL_A => ("Plot", "A \u{2212} B, deg"),
        _ => ("Box", "this \u{2212} other, deg"),
    };
    let chart = |kind: &str, title: String, y: &str, plots| Chart {
        id: format!("{prefix}-{}-{kind}", plot.number),
        description: format!("{title}, {y}, at the SYNCs around the event."),
        title,
        x_label: "time since the event, ms".to_owned(),
        y_label: y.to_owned(),
        plots,
        ..Chart::default()
    };
    vec![
        chart(
            "angle",
            format!("{word} {}: slope {axis} of both channels", plot.number),
            "deg",
            vec![
                lines(&plot.names[0], Ink::First, a),
                lines(&plot.names[1], Ink::Second, b),
            ],
        ),
        chart(
            "difference",
            format!("{word} {}: difference", plot.number),
            minus,
            vec![
                lines("X", Ink::First, |row| row.difference_x_deg),
                lines("Y", Ink::Second, |row| row.difference_y_deg),
            ],
        ),
    ]
}

type Of = fn(&PlotRow) -> Option<f64>;

fn larger(plot: &PlotReport, of: Of) -> f64 {
    let sizes = plot.rows.iter().filter_map(of).map(f64::abs);
    sizes.reduce(f64::max).unwrap_or(0.0)
}
