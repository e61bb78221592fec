//! What one drawing shows, taken from the model at once.
//!
//! In: the shared model and what the user has chosen. Out: a copy that can be drawn while frames
//! come, or kept while the screen stands still.

use super::super::events::Event;
use super::super::model::Model;
use super::super::moment;
use super::super::reading::Shared;
use super::super::snapshot::Snapshot;
use super::super::trace::LINES;
use super::screen::{Over, SPANS_S, Screen};

/// Events that are copied for the foot of the screen, and for the list.
const FEW: usize = 12;
const MANY: usize = 1000;

/// The points of a line: seconds before now, and degrees.
pub type Points = Vec<(f64, f64)>;

/// All that is drawn.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Values.
    pub snapshot: Snapshot,
    /// Lines of the instrument that is seen, in the order of the trace.
    pub lines: [Points; LINES],
    /// Events, newest last.
    pub events: Vec<Event>,
}

impl Picture {
    /// Takes it.
    pub fn take(shared: &Shared, screen: &Screen) -> Self {
        Self::of(&shared.model(), screen)
    }

    /// Takes it from a model.
    pub fn of(model: &Model, screen: &Screen) -> Self {
        let many = screen.over == Over::Log;
        let kept = if many { MANY } else { FEW };
        let first = model.events.count().saturating_sub(kept as u64);
        Self {
            snapshot: moment::snapshot(model),
            lines: lines(model, screen),
            events: model.events.since(first).cloned().collect(),
        }
    }
}

fn lines(model: &Model, screen: &Screen) -> [Points; LINES] {
    let mut lines: [Points; LINES] = std::array::from_fn(|_| Vec::new());
    let Some(trace) = model.trace(screen.instrument) else {
        return lines;
    };
    let now_ns = model.now_ns();
    let span_s = screen.span_s().clamp(SPANS_S[0], SPANS_S[3]);
    let (width_ns, buckets) = trace.span(now_ns, span_s * 1_000_000_000);
    for bucket in buckets {
        let middle_ns = (bucket.index * width_ns).saturating_add(width_ns / 2);
        let before_s = middle_ns as f64 / 1e9 - now_ns as f64 / 1e9;
        for (points, line) in lines.iter_mut().zip(bucket.lines) {
            let Some((low, high)) = line else { continue };
            points.push((before_s, f64::from(low) / 1000.0));
            if high != low {
                points.push((before_s, f64::from(high) / 1000.0));
            }
        }
    }
    lines
}
