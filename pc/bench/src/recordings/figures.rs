//! What is counted of one channel while it is played.
//!
//! In: [`Reading`]s in order of time. Out: the parts of the report that belong to one channel:
//! bins of angle, uncertainty and reference, the errors against the reference, and means and
//! scatter over each standstill. Memory grows with the number of standstills alone.
//!
//! An angle belongs to the instant [`Measurement::at`], and it is compared with the reference and
//! drawn at that instant, not when it was asked for.

use tilt::chain::{Chain, Measurement, Reading};

use super::prepare::Prepared;
use super::recording::{GAP_PERIODS, Row};
use super::reference::slopes_deg;
use super::segments::Segment;
use crate::report::data::Axis;
use crate::report::replay_data::{Accuracy, Plateau, SlopeSeries, StandstillUncertainty};
use output::series::{Binner, MAX_BINS, rounded};

/// Count, mean, mean square and greatest size of values that come one by one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Values.
    pub count: u64,
    mean: f64,
    /// Sum of squares about the mean.
    about_mean: f64,
    square: f64,
    largest: f64,
}

impl Sums {
    /// Takes one value.
    pub fn push(&mut self, value: f64) {
        self.count += 1;
        let off = value - self.mean;
        self.mean += off / self.count as f64;
        self.about_mean += off * (value - self.mean);
        self.square += value * value;
        self.largest = self.largest.max(value.abs());
    }

    fn when_any(&self, value: f64) -> Option<f64> {
        (self.count > 0).then(|| rounded(value))
    }

    /// Mean.
    pub fn mean(&self) -> Option<f64> {
        self.when_any(self.mean)
    }

    /// Root mean square.
    pub fn rms(&self) -> Option<f64> {
        self.when_any((self.square / self.count as f64).sqrt())
    }

    /// Greatest size.
    pub fn largest(&self) -> Option<f64> {
        self.when_any(self.largest)
    }

    fn accuracy(&self) -> Option<Accuracy> {
        (self.count > 0).then(|| Accuracy {
            compared: self.count,
            mean_deg: self.mean(),
            rmse_deg: self.rms(),
            max_deg: self.largest(),
        })
    }
}

/// One slope over one standstill.
#[derive(Clone, Copy, Debug, Default)]
struct AtRest {
    angle: Sums,
    uncertainty: Sums,
}

/// One slope over the whole recording.
struct Slope {
    angle: Binner,
    uncertainty: Binner,
    reference: Binner,
    error: Sums,
}

/// The figures of one channel, as they grow.
pub struct ChannelFigures<'a> {
    channel: &'a Prepared,
    noise_deg: f64,
    /// The instant 0 of the report, on the common clock.
    origin_us: u64,
    slopes: [Slope; 2],
    at_rest: Vec<[AtRest; 2]>,
    span: usize,
    row: usize,
}

impl<'a> ChannelFigures<'a> {
    /// Nothing seen yet. `origin_us` is the instant 0 of the report, on the common clock.
    pub fn new(channel: &'a Prepared, chain: &Chain, origin_us: u64) -> Self {
        let from_s = seconds(channel.offset_us, origin_us);
        let to_s = from_s + channel.recording.duration_s();
        let bins = || Binner::new(from_s, to_s, MAX_BINS);
        let slope = || Slope {
            angle: bins(),
            uncertainty: bins(),
            reference: bins(),
            error: Sums::default(),
        };
        Self {
            channel,
            noise_deg: chain.calibration.budget.noise_only(&chain.filter).degrees(),
            origin_us,
            slopes: [slope(), slope()],
            at_rest: vec![<[AtRest; 2]>::default(); channel.standstill.segments.len()],
            span: 0,
            row: 0,
        }
    }

    /// Takes one reading; true when it belongs to an instant at which the channel stood still.
    pub fn see(&mut self, reading: &Reading) -> bool {
        let mut still = false;
        for (axis, measured) in [reading.x, reading.y].into_iter().enumerate() {
            let Ok(measurement) = measured else { continue };
            // An instant before the first row has nothing to be compared with.
            let own_us = measurement.at.0.checked_sub(self.channel.offset_us);
            let Some(own_us) = own_us else { continue };
            let segment = self.segment_at(own_us);
            still |= segment.is_some();
            self.see_axis(axis, &measurement, own_us, segment);
        }
        still
    }

    fn see_axis(&mut self, axis: usize, m: &Measurement, own_us: u64, segment: Option<usize>) {
        let (angle, uncertainty) = (m.angle.degrees(), m.uncertainty.degrees());
        let reference = self.reference_at(own_us, axis);
        let time_s = seconds(m.at.0, self.origin_us);
        if let Some(slope) = self.slopes.get_mut(axis) {
            slope.angle.push(time_s, angle);
            slope.uncertainty.push(time_s, uncertainty);
            if let Some(reference) = reference {
                slope.reference.push(time_s, reference);
                slope.error.push(angle - reference);
            }
        }
        let at_rest = segment.and_then(|segment| self.at_rest.get_mut(segment));
        if let Some(at_rest) = at_rest.and_then(|both| both.get_mut(axis)) {
            at_rest.angle.push(angle);
            at_rest.uncertainty.push(uncertainty);
        }
    }

    /// The standstill at an instant of the recording. Instants come in order.
    fn segment_at(&mut self, own_us: u64) -> Option<usize> {
        let spans = &self.channel.standstill.spans;
        while spans.get(self.span).is_some_and(|s| s.end_us < own_us) {
            self.span += 1;
        }
        let span = spans.get(self.span)?;
        (span.start_us <= own_us).then_some(span.segment)
    }

    /// The reference at an instant, on the line between the rows before and after it.
    fn reference_at(&mut self, own_us: u64, axis: usize) -> Option<f64> {
        let rows = &self.channel.recording.rows;
        while rows.get(self.row + 1).is_some_and(|r| r.time_us <= own_us) {
            self.row += 1;
        }
        let (before, after) = (rows.get(self.row)?, rows.get(self.row + 1)?);
        let span_us = after.time_us - before.time_us;
        let known = before.time_us <= own_us
            && own_us <= after.time_us
            && span_us <= GAP_PERIODS * self.channel.recording.period_us;
        let of = |row: &Row| row.reference?.slopes_deg().get(axis).copied().flatten();
        let (a, b) = (of(before)?, of(after)?);
        let way = (own_us - before.time_us.min(own_us)) as f64 / span_us as f64;
        known.then_some(a + way * (b - a))
    }

    /// Both slopes, for the report.
    pub fn slopes(self) -> (Vec<SlopeSeries>, Vec<Plateau>) {
        let plateaus = self.plateaus();
        let (segments, at_rest) = (&self.channel.standstill.segments, &self.at_rest);
        let noise_deg = self.noise_deg;
        let named = self.slopes.into_iter().enumerate().zip([Axis::X, Axis::Y]);
        let series = |((index, slope), axis): ((usize, Slope), Axis)| SlopeSeries {
            axis,
            angle: slope.angle.finish(),
            uncertainty: slope.uncertainty.finish(),
            reference: slope.reference.finish(),
            accuracy: slope.error.accuracy(),
            accuracy_at_plateaus: plateau_errors(segments, at_rest, index).accuracy(),
            standstill: scatter(at_rest, index, noise_deg),
        };
        (named.map(series).collect(), plateaus)
    }

    fn plateaus(&self) -> Vec<Plateau> {
        let from_s = |us: u64| seconds(us.saturating_add(self.channel.offset_us), self.origin_us);
        let segments = self.channel.standstill.segments.iter();
        segments
            .zip(&self.at_rest)
            .map(|(segment, [x, y])| {
                let reference = reference_slopes(segment);
                Plateau {
                    from_s: from_s(segment.start_us),
                    to_s: from_s(segment.end_us),
                    x_deg: x.angle.mean(),
                    y_deg: y.angle.mean(),
                    reference_x_deg: reference.map(|[x, _]| rounded(x)),
                    reference_y_deg: reference.map(|[_, y]| rounded(y)),
                }
            })
            .collect()
    }
}

/// Seconds from `origin_us` to `at_us`, negative when it is the earlier.
pub fn seconds(at_us: u64, origin_us: u64) -> f64 {
    (at_us as f64 - origin_us as f64) / 1e6
}

fn reference_slopes(segment: &Segment) -> Option<[f64; 2]> {
    segment.reference.map(|reference| slopes_deg(reference.up))
}

/// Mean angle minus reference over the plateaus, each counting once.
fn plateau_errors(segments: &[Segment], at_rest: &[[AtRest; 2]], axis: usize) -> Sums {
    let mut errors = Sums::default();
    for (segment, both) in segments.iter().zip(at_rest) {
        let reference = reference_slopes(segment).and_then(|slopes| slopes.get(axis).copied());
        let measured = both.get(axis).and_then(|one| one.angle.mean());
        if let (Some(reference), Some(measured)) = (reference, measured) {
            errors.push(measured - reference);
        }
    }
    errors
}

/// Scatter about the mean of each standstill and the uncertainty said meanwhile, pooled.
fn scatter(at_rest: &[[AtRest; 2]], axis: usize, noise_deg: f64) -> Option<StandstillUncertainty> {
    let (mut readings, mut freedom, mut about, mut said) = (0, 0, 0.0, 0.0);
    for one in at_rest.iter().filter_map(|both| both.get(axis)) {
        readings += one.angle.count;
        freedom += one.angle.count.saturating_sub(1);
        about += one.angle.about_mean;
        said += one.uncertainty.square;
    }
    (freedom > 0).then(|| StandstillUncertainty {
        readings,
        uncertainty_deg: rounded((said / readings as f64).sqrt()),
        noise_deg: rounded(noise_deg),
        scatter_deg: rounded((about / freedom as f64).sqrt()),
    })
}
