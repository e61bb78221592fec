//! The bus as a whole: how much was on it, and when.
//!
//! In: every frame with its time. Out: bits per bin of time, frames by what they are, and the
//! stretches without any frame. Bits are counted exactly, stuff bits and intermission included,
//! so that the load follows from the bit rate alone. What was on the bus and not in the log, such
//! as frames with errors, is no part of it.
//!
//! Left out: what kinds of frames there were, which `listen` counts.

use canopen::Frame;
use sim::can_bus::frame_bits;

use super::bins::Bins;
use super::gaps::{Gap, Gaps};
use bus_logs::is_dated;
use listen::GAP_NS;

/// Bits between two frames.
const INTERMISSION: u64 = 3;

/// Node-ids, 0 for what has none.
const IDS: usize = 128;

/// The bus.
#[derive(Clone, Debug)]
pub struct Traffic {
    /// Bits, per bin.
    pub bits: Bins<u64>,
    /// Time with data, per bin, ns.
    pub covered: Bins<u64>,
    /// Bits in all.
    pub total_bits: u64,
    /// Time with data, ns.
    pub covered_ns: u64,
    /// First and last frame, ns.
    pub span_ns: Option<(u64, u64)>,
    /// Time without any frame.
    pub gaps: Gaps,
    /// Frames without and with a date, with the first and last of each, ns.
    dates: [(u64, Option<(u64, u64)>); 2],
    /// Frames by the node-id in their identifier.
    nodes: Box<[u64; IDS]>,
    last_ns: Option<u64>,
    /// Whether bits are counted.
    has_bits: bool,
}

impl Default for Traffic {
    fn default() -> Self {
        Self {
            bits: Bins::default(),
            covered: Bins::default(),
            total_bits: 0,
            covered_ns: 0,
            span_ns: None,
            dates: [(0, None); 2],
            gaps: Gaps::default(),
            nodes: Box::new([0; IDS]),
            last_ns: None,
            has_bits: true,
        }
    }
}

impl Traffic {
    /// Counts no bits, so that it has no load.
    pub fn without_bits() -> Self {
        Self {
            has_bits: false,
            ..Self::default()
        }
    }

    /// Whether this is a time without a date, in a log whose times mostly have one.
    pub const fn is_stray(&self, now_ns: u64) -> bool {
        let [(undated, _), (dated, _)] = self.dates;
        !is_dated(now_ns) && dated > undated
    }

    /// The period is that of most frames: dates, or times without one.
    fn extend(&mut self, now_ns: u64) {
        let [undated, dated] = &mut self.dates;
        let (count, span) = if is_dated(now_ns) {
            &mut *dated
        } else {
            &mut *undated
        };
        *count += 1;
        let (first, latest) = span.unwrap_or((now_ns, now_ns));
        *span = Some((first.min(now_ns), latest.max(now_ns)));
        self.span_ns = if dated.0 > undated.0 {
            dated.1
        } else {
            undated.1.or(dated.1)
        };
    }

    /// Takes a frame; the time of the one before it, ns.
    pub fn take(&mut self, now_ns: u64, frame: &Frame) -> u64 {
        self.count(frame);
        if self.has_bits {
            let bits = frame_bits(frame) + INTERMISSION;
            self.total_bits += bits;
            self.bits.add(now_ns, bits);
        }
        self.extend(now_ns);
        let last = self.last_ns.replace(now_ns).unwrap_or(now_ns);
        if now_ns < last {
            return last;
        }
        if is_dated(now_ns) && !is_dated(last) {
            // Nobody knows how long it was.
            return now_ns;
        }
        let since = now_ns - last;
        if since > GAP_NS {
            self.gaps.add(Gap {
                from_ns: last,
                to_ns: now_ns,
                whole_bus: true,
            });
        } else if since > 0 {
            self.covered_ns += since;
            self.covered.add(last, since);
        }
        last
    }

    fn count(&mut self, frame: &Frame) {
        // From TPDO 1 to the SDOs, EMCY and error control.
        let of_a_node = |id: &u16| matches!(id, 0x081..=0x0FF | 0x181..=0x67F | 0x701..=0x77F);
        let cob_id = frame.cob_id().filter(|_| !frame.is_remote());
        if let Some(cob_id) = cob_id.filter(of_a_node)
            && let Some(count) = self.nodes.get_mut(usize::from(cob_id & 0x7F))
        {
            *count += 1;
        }
    }

    /// Node-ids whose frames were seen, and how many of each.
    pub fn nodes(&self) -> impl Iterator<Item = (u8, u64)> {
        let all = (0..).zip(self.nodes.iter().copied());
        all.filter(|(id, count)| *id > 0 && *count > 0)
    }

    /// Bits per second over the time with data; `None` without.
    pub fn rate(&self) -> Option<f64> {
        (self.has_bits && self.covered_ns > 0)
            .then(|| self.total_bits as f64 / (self.covered_ns as f64 * 1e-9))
    }

    /// Bits per second bin by bin: start of the bin, ns, and the rate.
    pub fn rates(&self) -> Vec<(u64, f64)> {
        let (mut bits, mut covered) = (self.bits.clone(), self.covered.clone());
        bits.align(&mut covered);
        let covered: std::collections::BTreeMap<u64, u64> =
            covered.iter().map(|(from_ns, ns)| (from_ns, *ns)).collect();
        let rate = |(from_ns, bits): (u64, &u64)| {
            let covered_ns = *covered.get(&from_ns)?;
            Some((from_ns, *bits as f64 / (covered_ns as f64 * 1e-9)))
        };
        bits.iter().filter_map(rate).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_what_the_frames_take_and_gaps_do_not_count() {
        let mut traffic = Traffic::default();
        let frame = Frame::data_frame(0x701, &[5]);
        let bits = frame_bits(&frame) + INTERMISSION;
        for n in 0..2000_u64 {
            let pause_ns = if n < 1000 { 0 } else { 600_000_000_000 };
            traffic.take(n * 10_000_000 + pause_ns, &frame);
        }
        let rate = traffic.rate().unwrap();
        assert!((rate - bits as f64 * 100.0).abs() < bits as f64, "{rate}");
        assert_eq!(traffic.gaps.count(), 1);
        assert_eq!(traffic.gaps.longest_ns(), 600_010_000_000);
        assert_eq!(traffic.nodes().collect::<Vec<_>>(), [(1, 2000)]);
        for (_, rate) in &traffic.rates()[1..9] {
            assert!(
                (rate - bits as f64 * 100.0).abs() < 1.5 * bits as f64,
                "{rate}"
            );
        }
    }
}
