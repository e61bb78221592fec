//! The bus as a whole: how much was on it, and when.
//!
//! In: every frame with its time. Out: bits per bin of time, frames by what they are, and the
//! stretches without any frame. Bits are counted exactly, stuff bits and intermission included,
//! so that the load follows from the bit rate alone. What was on the bus and not in the log, such
//! as frames with errors, is no part of it.
//!
//! Left out: what kinds of frames there were, which `listen` counts.

use canopen::Frame;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use sim::can_bus::{INTERMISSION_BITS, frame_bits};

use super::bins::Bins;
use super::gaps::{Gap, Gaps};
use super::join::{Join, join_fields};
use bus_logs::is_dated;
use listen::GAP_NS;

/// Identifiers of 11 bits.
const COB_IDS: usize = 2048;

/// Frames whose times are dates, or those whose times are none.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Span {
    count: u64,
    first_ns: u64,
    last_ns: u64,
}

impl Span {
    const NONE: Self = Self {
        count: 0,
        first_ns: u64::MAX,
        last_ns: 0,
    };

    #[inline]
    fn take(&mut self, now_ns: u64) {
        self.count += 1;
        self.first_ns = self.first_ns.min(now_ns);
        self.last_ns = self.last_ns.max(now_ns);
    }

    fn ends_ns(&self) -> Option<(u64, u64)> {
        (self.count > 0).then_some((self.first_ns, self.last_ns))
    }
}

impl Join for Span {
    fn join(&mut self, other: &Self) {
        self.count.join(&other.count);
        self.first_ns = self.first_ns.min(other.first_ns);
        self.last_ns = self.last_ns.max(other.last_ns);
    }
}

/// The bus.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Traffic {
    /// Bits, per bin.
    pub bits: Bins<u64>,
    /// Time with data, ns.
    pub covered_ns: u64,
    /// Time without any frame.
    pub gaps: Gaps,
    /// Time with data, per bin, ns.
    covered: Bins<u64>,
    /// Bits in all.
    total_bits: u64,
    undated: Span,
    dated: Span,
    /// Data frames by their identifier.
    #[serde(serialize_with = "sparse", deserialize_with = "dense")]
    frames: Box<[u64; COB_IDS]>,
    #[serde(skip)]
    last_ns: Option<u64>,
    /// Whether bits, and the time that they took, are counted.
    has_bits: bool,
}

impl Default for Traffic {
    fn default() -> Self {
        Self {
            bits: Bins::default(),
            covered_ns: 0,
            gaps: Gaps::default(),
            covered: Bins::default(),
            total_bits: 0,
            undated: Span::NONE,
            dated: Span::NONE,
            frames: Box::new([0; COB_IDS]),
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
    #[inline]
    pub const fn is_stray(&self, now_ns: u64) -> bool {
        !is_dated(now_ns) && self.dated.count > self.undated.count
    }

    /// First and last frame, ns: of most frames, those with a date or those without one.
    pub fn span_ns(&self) -> Option<(u64, u64)> {
        let (undated, dated) = (self.undated.ends_ns(), self.dated.ends_ns());
        if self.dated.count > self.undated.count {
            dated
        } else {
            undated.or(dated)
        }
    }

    /// Frames that were taken by another clock than most of them: without a date before a logger's
    /// clock was set, or with one where fewer have one. [`Traffic::span_ns`] is without them.
    pub fn by_other_clock(&self) -> u64 {
        self.dated.count.min(self.undated.count)
    }

    /// Takes a frame; the time of the one before it, ns.
    #[inline]
    pub fn take(&mut self, now_ns: u64, frame: &Frame) -> u64 {
        self.count(frame);
        let span = if is_dated(now_ns) {
            &mut self.dated
        } else {
            &mut self.undated
        };
        span.take(now_ns);
        if self.has_bits {
            let bits = frame_bits(frame) + INTERMISSION_BITS;
            self.total_bits += bits;
            self.bits.add(now_ns, bits);
        }
        let last_ns = self.last_ns.replace(now_ns).unwrap_or(now_ns);
        let since_ns = now_ns.saturating_sub(last_ns);
        if since_ns > GAP_NS {
            return self.gap(last_ns, now_ns);
        }
        self.covered_ns += since_ns;
        if self.has_bits && since_ns > 0 {
            self.covered.add(last_ns, since_ns);
        }
        last_ns
    }

    /// Nothing was on the bus between these times; the first of them, or the second where the
    /// length of the gap is not known.
    #[cold]
    fn gap(&mut self, from_ns: u64, to_ns: u64) -> u64 {
        if is_dated(to_ns) && !is_dated(from_ns) {
            return to_ns;
        }
        self.gaps.add(Gap {
            from_ns,
            to_ns,
            whole_bus: true,
        });
        from_ns
    }

    #[inline]
    fn count(&mut self, frame: &Frame) {
        let cob_id = frame.cob_id().filter(|_| !frame.is_remote());
        if let Some(count) = cob_id.and_then(|id| self.frames.get_mut(usize::from(id))) {
            *count += 1;
        }
    }

    /// Node-ids whose frames were seen, and how many of each.
    pub fn nodes(&self) -> impl Iterator<Item = (u8, u64)> {
        let mut nodes = [0; 128];
        for (cob_id, count) in (0_u16..).zip(self.frames.iter()) {
            // From TPDO 1 to the SDOs, EMCY and error control.
            if matches!(cob_id, 0x081..=0x0FF | 0x181..=0x67F | 0x701..=0x77F) {
                let frames: &mut u64 = &mut nodes[usize::from(cob_id & 0x7F)];
                *frames = frames.saturating_add(*count);
            }
        }
        let all = (0..).zip(nodes);
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

/// The identifiers that were seen, each with its count.
/// Time between the two logs is in no gap.
impl Join for Traffic {
    fn join(&mut self, other: &Self) {
        join_fields! { self, other:
            bits, covered_ns, gaps, covered, total_bits, undated, dated, frames
        }
        self.has_bits &= other.has_bits;
    }
}

fn sparse<S: Serializer>(frames: &[u64; COB_IDS], into: S) -> Result<S::Ok, S::Error> {
    let seen = (0_u16..).zip(frames).filter(|(_, count)| **count > 0);
    into.collect_seq(seen)
}

fn dense<'de, D: Deserializer<'de>>(from: D) -> Result<Box<[u64; COB_IDS]>, D::Error> {
    let mut frames = Box::new([0; COB_IDS]);
    for (cob_id, count) in Vec::<(u16, u64)>::deserialize(from)? {
        if let Some(place) = frames.get_mut(usize::from(cob_id)) {
            *place = count;
        }
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_what_the_frames_take_and_gaps_do_not_count() {
        let mut traffic = Traffic::default();
        let frame = Frame::data_frame(0x701, &[5]);
        let bits = frame_bits(&frame) + INTERMISSION_BITS;
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
