//! What a browser is told: the state, and of trace and events what it has not got.
//!
//! In: the model, and in a [`Cursor`] how far a browser has come. Out: values for JSON.

use serde::Serialize;

use super::super::events::Event;
use super::super::model::Model;
use super::super::moment;
use super::super::snapshot::Snapshot;
use super::super::trace::{BUCKETS, Bucket, LINES, WIDTHS_NS};

/// Events that a browser gets when it comes.
const EVENTS_AT_FIRST: u64 = 200;

/// A time in s, then least and greatest value of each line in degrees.
pub type Point = [Option<f64>; 1 + 2 * LINES];

/// One message.
#[derive(Debug, Serialize)]
pub struct Update {
    /// Everything at this moment.
    pub state: Snapshot,
    /// Events that are new to the browser.
    pub events: Vec<Event>,
    /// True when these are all that it is to show.
    pub events_anew: bool,
    /// For each instrument what is new of its trace.
    pub traces: Vec<Piece>,
}

/// What is new of a trace.
#[derive(Debug, Serialize)]
pub struct Piece {
    /// True when the points before are of another time.
    pub anew: bool,
    /// New points.
    pub points: Vec<Point>,
}

/// A trace as it is asked for.
#[derive(Debug, Serialize)]
pub struct Whole {
    /// Width of a bucket, s.
    pub width_s: f64,
    /// All points.
    pub points: Vec<Point>,
}

/// How far a browser has come.
#[derive(Debug, Default)]
pub struct Cursor {
    begun: bool,
    event: u64,
    /// For each instrument the first bucket that it has not got.
    buckets: Vec<u64>,
}

impl Cursor {
    /// What comes next.
    pub fn next(&mut self, model: &Model) -> Update {
        let count = model.events.count();
        let from = self.event.max(count.saturating_sub(EVENTS_AT_FIRST));
        let events = model.events.since(from).cloned().collect();
        self.event = count;
        let events_anew = !std::mem::replace(&mut self.begun, true);
        self.buckets.resize(model.instruments(), 0);
        let now = model.now_ns() / WIDTHS_NS[0];
        let cursors = self.buckets.iter_mut().enumerate();
        let traces = cursors.map(|(n, cursor)| piece(model, n, now, cursor));
        Update {
            traces: traces.collect(),
            state: moment::snapshot(model),
            events,
            events_anew,
        }
    }
}

/// The buckets that are whole and that a browser has not got.
fn piece(model: &Model, instrument: usize, now: u64, cursor: &mut u64) -> Piece {
    // Time has gone back: what the browser has is of another time.
    let anew = *cursor == 0 || *cursor > now;
    let from = if anew { 0 } else { *cursor };
    let span_ns = WIDTHS_NS[0] * BUCKETS as u64;
    let trace = model.trace(instrument);
    let buckets = trace.map(|trace| trace.span(model.now_ns(), span_ns).1);
    let new = buckets.into_iter().flatten();
    let new = new.filter(|bucket| (from..now).contains(&bucket.index));
    let points = new.map(|bucket| point(bucket, WIDTHS_NS[0])).collect();
    *cursor = now.max(1);
    Piece { anew, points }
}

/// The trace of an instrument over a span.
pub fn trace(model: &Model, instrument: usize, span_s: u64) -> Whole {
    let span_ns = span_s.saturating_mul(1_000_000_000);
    let Some(trace) = model.trace(instrument) else {
        return Whole {
            width_s: 0.0,
            points: Vec::new(),
        };
    };
    let (width_ns, buckets) = trace.span(model.now_ns(), span_ns);
    Whole {
        width_s: width_ns as f64 / 1e9,
        points: buckets.map(|bucket| point(bucket, width_ns)).collect(),
    }
}

fn point(bucket: &Bucket, width_ns: u64) -> Point {
    let mut point = [None; 1 + 2 * LINES];
    let middle_ms = bucket.index * (width_ns / 1_000_000) + width_ns / 2_000_000;
    let (time, values) = point.split_at_mut(1);
    time.fill(Some(middle_ms as f64 / 1000.0));
    for (pair, line) in values.chunks_exact_mut(2).zip(bucket.lines) {
        let Some((low, high)) = line else { continue };
        if let [to_low, to_high] = pair {
            *to_low = Some(f64::from(low) / 1000.0);
            *to_high = Some(f64::from(high) / 1000.0);
        }
    }
    point
}
