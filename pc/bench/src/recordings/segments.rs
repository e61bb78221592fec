//! Where a recording stands still, and the mean acceleration and reference there.
//!
//! In: a [`Recording`]. Out: [`Segment`]s in order. A sample stands still when, in a quarter of a
//! second around it, no axis scatters more than three times the sensor's own noise (or the
//! ringing that a rig is allowed after it stops), and the mean doesn't move from one quarter of a
//! second to the next. Neighbouring segments in the same pose, up to two seconds apart, are one.
//!
//! Left out: telling a standstill from a steady free fall or a steady turn, which no
//! accelerometer can; a recording's standstills are believed by their length (`scale`).

use super::recording::{Recording, Row};
use super::reference::{Attitude, Reference, angle_between_deg};
use super::windows::{Sums, Window, moving, norm, quantile};

/// What counts as standing still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Shortest segment, seconds.
    pub shortest_s: f64,
    /// Scatter of an axis that is let pass whatever the sensor's noise, g. Rigs ring after they
    /// stop; ringing has no mean, so the mean is good long before the ringing has died.
    pub ringing_g: f64,
    /// Largest step of the mean from a quarter of a second to the next, g per axis.
    pub drift_g: f64,
    /// Neighbours are merged when their means differ by no more than this, deg.
    pub same_pose_deg: f64,
}

impl Options {
    /// For poses by hand: a second at least.
    pub const POSES: Self = Self {
        shortest_s: 1.0,
        ringing_g: 0.022,
        drift_g: 0.012,
        same_pose_deg: 1.0,
    };

    /// For a machine that stops at plateaus: they are short and ring at their start.
    /// On the robot's runs all from 22 to 50 mg of ringing and 0.3 to 0.5 s find the same plateaus.
    pub const PLATEAUS: Self = Self {
        shortest_s: 0.4,
        ringing_g: 0.04,
        ..Self::POSES
    };

    /// [`Self::PLATEAUS`] where the recording has a reference, else [`Self::POSES`].
    pub fn for_recording(recording: &Recording) -> Self {
        if recording.has_reference() {
            Self::PLATEAUS
        } else {
            Self::POSES
        }
    }
}

/// The reference over a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceMean {
    /// Up vector in the body's frame: median of each component, made one long.
    pub up: [f64; 3],
    /// Standard deviation about it, deg. A reference whose clock is ahead of the sensor's leaves
    /// a plateau before the sensor does; the median does not mind.
    pub spread_deg: f64,
    /// The whole attitude in the middle of the segment, where the reference gives it.
    pub attitude: Option<Attitude>,
}

/// A span in which the sensor stood still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Time of the first sample, microseconds since the recording's first row.
    pub start_us: u64,
    /// Time of the last sample.
    pub end_us: u64,
    /// Line of the first sample.
    pub first_line: u64,
    /// Samples.
    pub count: usize,
    /// Mean acceleration in the sensor's axes, nominal g.
    pub mean_g: [f64; 3],
    /// Standard deviation of each axis, g.
    pub std_g: [f64; 3],
    /// Mean temperature in degC, if recorded.
    pub temperature_c: Option<f64>,
    /// The reference, if recorded.
    pub reference: Option<ReferenceMean>,
}

/// A stretch of a segment between two knocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Time of the first sample, microseconds since the recording's first row.
    pub start_us: u64,
    /// Time of the last sample.
    pub end_us: u64,
    /// Place of its segment in [`Standstill::segments`].
    pub segment: usize,
}

/// What was found in a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Standstill {
    /// The sensor's noise by its quietest tenth: standard deviation of each axis, g.
    pub noise_g: [f64; 3],
    /// The segments in order of time.
    pub segments: Vec<Segment>,
    /// Their undisturbed stretches in order of time.
    pub spans: Vec<Span>,
}

impl Standstill {
    /// Standard deviation of single samples at standstill, all axes together, g: the median of
    /// the segments, which neither a ringing one nor a drifting one upsets. The quietest tenth of
    /// the recording where there is no segment.
    pub fn sample_noise_g(&self) -> f64 {
        let of_one = |std: [f64; 3]| norm(std) / 3f64.sqrt();
        let scatters = self.segments.iter().map(|s| of_one(s.std_g)).collect();
        quantile(scatters, 0.5).unwrap_or_else(|| of_one(self.noise_g))
    }
}

const HALF_WINDOW_US: u64 = 125_000;
const FLOOR_SHARE: f64 = 0.1;
const TIMES_FLOOR: f64 = 3.0;

/// Finds the segments.
pub fn find(recording: &Recording, options: Options) -> Standstill {
    let rows = &recording.rows;
    let times: Vec<u64> = rows.iter().map(|row| row.time_us).collect();
    let sums = Sums::new(rows.iter().map(|row| row.accel_g));
    // A slow recording needs a longer window to have a scatter at all.
    let half = HALF_WINDOW_US.max(4 * recording.period_us);
    let windows = moving(&times, &sums, half);
    let noise_g = noise_floor(&windows);
    let limit = noise_g.map(|floor| (TIMES_FLOOR * floor).max(options.ringing_g));
    let quiet = |i: usize| {
        windows.get(i).is_some_and(|window| {
            window.count >= 5
                && window
                    .std
                    .iter()
                    .zip(limit)
                    .all(|(std, limit)| *std <= limit)
        }) && !drifts(&windows, &times, i, half, options.drift_g)
    };
    let poses = merge(runs(rows, quiet), &times, &sums, options.same_pose_deg);
    let mut found = Standstill {
        noise_g,
        segments: Vec::new(),
        spans: Vec::new(),
    };
    let long = |pose: &&Pose| pose.still_s(&times) >= options.shortest_s;
    for pose in poses.iter().filter(long) {
        if let Some(segment) = pose.describe(rows, &sums) {
            found.spans.extend(pose.spans(&times, found.segments.len()));
            found.segments.push(segment);
        }
    }
    found
}

/// Runs of quiet rows, as ranges. A gap ends a run: nobody saw what happened in it.
fn runs(rows: &[Row], quiet: impl Fn(usize) -> bool) -> Vec<(usize, usize)> {
    let mut runs = Vec::new();
    let mut start = None;
    for i in 0..=rows.len() {
        let goes_on = i < rows.len() && quiet(i);
        let breaks = rows.get(i).is_some_and(|row| row.starts_anew);
        if let Some(from) = start.filter(|_| !goes_on || breaks) {
            runs.push((from, i));
            start = None;
        }
        if goes_on && start.is_none() {
            start = Some(i);
        }
    }
    runs
}

/// The tenth part of the way up the scatters of each axis, which a sensor reaches only at rest.
fn noise_floor(windows: &[Window]) -> [f64; 3] {
    let mut floor = [0.0; 3];
    for (axis, floor) in floor.iter_mut().enumerate() {
        let full = windows.iter().filter(|window| window.count >= 5);
        let scatters = full
            .filter_map(|window| window.std.get(axis).copied())
            .collect();
        *floor = quantile(scatters, FLOOR_SHARE).unwrap_or(0.0);
    }
    floor
}

/// Whether the mean moves between half a window before and half a window after a sample.
fn drifts(windows: &[Window], times: &[u64], i: usize, half_us: u64, most: f64) -> bool {
    let Some(&centre) = times.get(i) else {
        return true;
    };
    let before = times.partition_point(|&t| t.saturating_add(half_us) < centre);
    let after = times
        .partition_point(|&t| t <= centre.saturating_add(half_us))
        .max(1)
        - 1;
    match (windows.get(before), windows.get(after)) {
        (Some(a), Some(b)) => a.mean.iter().zip(b.mean).any(|(a, b)| (a - b).abs() > most),
        _ => true,
    }
}

/// Runs of quiet rows in one pose.
#[derive(Clone, Debug)]
struct Pose {
    runs: Vec<(usize, usize)>,
}

impl Pose {
    fn still_s(&self, times: &[u64]) -> f64 {
        self.runs.iter().map(|&run| span_s(times, run)).sum()
    }

    /// The runs as spans of the segment that is to stand at `segment`.
    fn spans(&self, times: &[u64], segment: usize) -> impl Iterator<Item = Span> {
        self.runs.iter().filter_map(move |&(from, to)| {
            Some(Span {
                start_us: *times.get(from)?,
                end_us: *times.get(to.checked_sub(1)?)?,
                segment,
            })
        })
    }

    /// Mean and scatter over all runs, each run's scatter about its own mean.
    fn window(&self, sums: &Sums) -> Window {
        let parts = self.runs.iter().map(|&(from, to)| sums.window(from, to));
        let mut pooled = Window::default();
        for part in parts {
            let (old, new) = (pooled.count as f64, part.count as f64);
            let share = new / (old + new).max(1.0);
            pooled.count += part.count;
            for axis in 0..3 {
                pooled.mean[axis] += share * (part.mean[axis] - pooled.mean[axis]);
                let square = |std: f64| std * std;
                let (a, b) = (square(pooled.std[axis]), square(part.std[axis]));
                pooled.std[axis] = (a + share * (b - a)).max(0.0).sqrt();
            }
        }
        pooled
    }

    fn describe(&self, rows: &[Row], sums: &Sums) -> Option<Segment> {
        let window = self.window(sums);
        let still: Vec<&Row> = self
            .runs
            .iter()
            .filter_map(|&(from, to)| rows.get(from..to))
            .flatten()
            .collect();
        let (first, last) = (still.first()?, still.last()?);
        let temperatures: Vec<f64> = still.iter().filter_map(|row| row.temperature_c).collect();
        let temperature_c = (!temperatures.is_empty())
            .then(|| temperatures.iter().sum::<f64>() / temperatures.len() as f64);
        Some(Segment {
            start_us: first.time_us,
            end_us: last.time_us,
            first_line: first.line,
            count: window.count,
            mean_g: window.mean,
            std_g: window.std,
            temperature_c,
            reference: reference(&still),
        })
    }
}

fn span_s(times: &[u64], (from, to): (usize, usize)) -> f64 {
    match (times.get(from), times.get(to.saturating_sub(1))) {
        (Some(first), Some(last)) => last.saturating_sub(*first) as f64 / 1e6,
        _ => 0.0,
    }
}

/// Joins neighbours in the same pose that are parted by a knock at most, not by a journey from
/// which the sensor came back. Runs too short to show where they are don't take part.
fn merge(runs: Vec<(usize, usize)>, times: &[u64], sums: &Sums, same_deg: f64) -> Vec<Pose> {
    const SHORTEST_RUN_S: f64 = 0.1;
    const LONGEST_KNOCK_S: f64 = 2.0;
    let knock = |last: &Pose, from: usize| {
        last.runs
            .last()
            .is_some_and(|&(_, to)| span_s(times, (to, from + 1)) <= LONGEST_KNOCK_S)
    };
    let mut poses: Vec<Pose> = Vec::new();
    for run in runs
        .into_iter()
        .filter(|&run| span_s(times, run) >= SHORTEST_RUN_S)
    {
        let new = Pose { runs: vec![run] };
        match poses.last_mut() {
            Some(last)
                if knock(last, run.0) && same(&last.window(sums), &new.window(sums), same_deg) =>
            {
                last.runs.push(run);
            }
            _ => poses.push(new),
        }
    }
    poses
}

fn same(a: &Window, b: &Window, same_deg: f64) -> bool {
    let longer = (norm(a.mean) - norm(b.mean)).abs();
    angle_between_deg(a.mean, b.mean) <= same_deg && longer <= same_deg.to_radians()
}

fn reference(rows: &[&Row]) -> Option<ReferenceMean> {
    let known: Vec<Reference> = rows.iter().filter_map(|row| row.reference).collect();
    let ups: Vec<[f64; 3]> = known.iter().filter_map(Reference::up).collect();
    let mut up = [0.0; 3];
    for (axis, component) in up.iter_mut().enumerate() {
        *component = quantile(ups.iter().map(|up| up[axis]).collect(), 0.5)?;
    }
    let length = norm(up);
    let up = up.map(|c| c / length.max(f64::MIN_POSITIVE));
    let squares = ups
        .iter()
        .map(|other| angle_between_deg(*other, up).powi(2));
    let spread_deg = (squares.sum::<f64>() / ups.len() as f64).sqrt();
    let attitude = match known.get(known.len() / 2) {
        Some(Reference::Attitude(attitude)) => Some(*attitude),
        _ => None,
    };
    Some(ReferenceMean {
        up,
        spread_deg,
        attitude,
    })
}

#[cfg(test)]
#[path = "segments_tests.rs"]
mod tests;
