//! The last seconds, minutes and hours of the angles, in a memory that does not grow.
//!
//! In: slopes and differences with their time. Out: for a span of time a row of buckets of equal
//! width with the least and the greatest value of each line in it, so that no spike is lost.
//! Three rows are kept, of a tenth, one and ten seconds per bucket.
//!
//! Left out: how it is drawn.

use std::collections::VecDeque;

/// Lines of a trace: slope X and Y of A, of B, and the difference in X and Y.
pub const LINES: usize = 6;

/// Buckets per row.
pub const BUCKETS: usize = 600;

/// Width of a bucket in each row.
pub const WIDTHS_NS: [u64; 3] = [100_000_000, 1_000_000_000, 10_000_000_000];

/// What fell into one bucket of time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bucket {
    /// Its time in widths since the source's zero.
    pub index: u64,
    /// Least and greatest value of each line, 0.001 deg; `None` where there was none.
    pub lines: [Option<(i32, i32)>; LINES],
}

impl Bucket {
    fn add(&mut self, line: usize, mdeg: i32) {
        let Some(place) = self.lines.get_mut(line) else {
            return;
        };
        let (low, high) = place.unwrap_or((mdeg, mdeg));
        *place = Some((low.min(mdeg), high.max(mdeg)));
    }
}

/// One row of buckets of the same width.
#[derive(Clone, Debug)]
struct Row {
    width_ns: u64,
    buckets: VecDeque<Bucket>,
}

impl Row {
    fn new(width_ns: u64) -> Self {
        Self {
            width_ns,
            buckets: VecDeque::with_capacity(BUCKETS),
        }
    }

    fn add(&mut self, time_ns: u64, line: usize, mdeg: i32) {
        let index = time_ns / self.width_ns;
        // A frame that is a little late belongs to the newest bucket; only time goes on here.
        if self.buckets.back().is_none_or(|last| last.index < index) {
            if self.buckets.len() == BUCKETS {
                self.buckets.pop_front();
            }
            let lines = [None; LINES];
            self.buckets.push_back(Bucket { index, lines });
        }
        if let Some(last) = self.buckets.back_mut() {
            last.add(line, mdeg);
        }
    }
}

/// The trace of one instrument.
#[derive(Clone, Debug)]
pub struct Trace {
    rows: [Row; WIDTHS_NS.len()],
}

impl Default for Trace {
    fn default() -> Self {
        Self {
            rows: WIDTHS_NS.map(Row::new),
        }
    }
}

impl Trace {
    /// Takes the values that are there, the first for the line `from`.
    pub fn add(&mut self, time_ns: u64, from: usize, mdeg: &[Option<i32>]) {
        for (line, value) in (from..).zip(mdeg) {
            let Some(value) = value else { continue };
            for row in &mut self.rows {
                row.add(time_ns, line, *value);
            }
        }
    }

    /// Forgets everything, for a source whose time has jumped back.
    pub fn clear(&mut self) {
        self.rows.iter_mut().for_each(|row| row.buckets.clear());
    }

    /// The finest row that reaches over `span_ns`: the width of its buckets, and those that are
    /// younger than the span, oldest first.
    pub fn span(&self, now_ns: u64, span_ns: u64) -> (u64, impl Iterator<Item = &Bucket>) {
        let reaches = |row: &&Row| row.width_ns * BUCKETS as u64 >= span_ns;
        let [.., coarsest] = &self.rows;
        let row = self.rows.iter().find(reaches).unwrap_or(coarsest);
        let from = now_ns.saturating_sub(span_ns) / row.width_ns;
        let young = row.buckets.iter().filter(move |b| b.index >= from);
        (row.width_ns, young)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    #[test]
    fn a_spike_survives_in_every_row() {
        let mut trace = Trace::default();
        for ms in 0..20_000 {
            let value = if ms == 5_000 { 9_000 } else { 10 };
            trace.add(ms * 1_000_000, 0, &[Some(value), None]);
        }
        for span in [60 * S, 600 * S, 6000 * S] {
            let (_, buckets) = trace.span(20 * S, span);
            let high = buckets.filter_map(|b| b.lines[0]).map(|(_, high)| high);
            assert_eq!(high.max(), Some(9_000));
        }
    }

    #[test]
    fn the_memory_does_not_grow_with_the_hours() {
        let mut trace = Trace::default();
        for second in 0..100_000 {
            trace.add(second * S, 4, &[Some(1), Some(2)]);
        }
        assert!(trace.rows.iter().all(|row| row.buckets.len() == BUCKETS));
        let (width, buckets) = trace.span(100_000 * S, 600 * S);
        assert_eq!((width, buckets.count()), (S, 600));
    }

    #[test]
    fn what_is_older_than_the_span_is_left_out() {
        let mut trace = Trace::default();
        trace.add(S, 0, &[Some(1)]);
        trace.add(100 * S, 0, &[Some(2)]);
        let (width, buckets) = trace.span(100 * S, 10 * S);
        assert_eq!((width, buckets.count()), (S / 10, 1));
        trace.clear();
        assert_eq!(trace.span(100 * S, 6000 * S).1.count(), 0);
    }

    #[test]
    fn a_late_value_goes_to_the_newest_bucket() {
        let mut trace = Trace::default();
        trace.add(10 * S, 0, &[Some(5)]);
        trace.add(9 * S, 0, &[Some(-5)]);
        let (_, buckets) = trace.span(10 * S, S);
        let lines: Vec<_> = buckets.map(|b| b.lines[0]).collect();
        assert_eq!(lines, [Some((-5, 5))]);
    }
}
