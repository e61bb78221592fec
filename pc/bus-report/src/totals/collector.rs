//! From the frames of one interface to what is kept of each instrument on it.
//!
//! In: frames with their time, in ns, in the order of the log. Out: an [`Instrument`] per pair of
//! the plan, and the [`Traffic`] of the bus. Memory does not grow with the log.
//!
//! Left out: where frames come from (`bus-logs`), and what a frame means (`listen`).

use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

use canopen::Frame;

use super::instrument::{Instrument, Moment};
use super::join::{Join, join_fields};
use super::traffic::Traffic;
use listen::{Counts, Meaning, Place, Plan, Side, Watch};

/// A boot-up this soon after NMT 130 is its answer, ns.
const ANSWER_NS: u64 = 2_000_000_000;

/// NMT: reset of communication (CiA 301, 7.3.2.2.1.3).
const RESET_COMMUNICATION: u8 = 130;

/// Everything under way.
#[derive(Debug)]
pub struct Collector {
    watch: Watch,
    instruments: Vec<Instrument>,
    traffic: Traffic,
    outside: u64,
    undated: u64,
    /// The last NMT 130: when, and to whom; 0 for all.
    reset: Option<(u64, u8)>,
}

impl Collector {
    /// Nothing yet of the instruments of this plan.
    pub fn new(plan: &Plan) -> Self {
        Self {
            watch: Watch::new(plan),
            instruments: plan.pairs.iter().map(|_| Instrument::default()).collect(),
            traffic: Traffic::default(),
            outside: 0,
            undated: 0,
            reset: None,
        }
    }

    /// The same without the load of the bus, whose bits take as long to count as a frame to read.
    pub fn without_load(plan: &Plan) -> Self {
        Self {
            traffic: Traffic::without_bits(),
            ..Self::new(plan)
        }
    }

    /// What is known of the instruments by now.
    pub const fn watch(&self) -> &Watch {
        &self.watch
    }

    /// A frame that is outside the time which was asked for.
    pub const fn pass_over(&mut self) {
        self.outside += 1;
    }

    /// Takes a frame; its meaning, which one without a date among those with one has not.
    #[inline]
    pub fn take(&mut self, time_ns: u64, frame: &Frame) -> Meaning {
        if self.traffic.is_stray(time_ns) {
            self.undated += 1;
            return Meaning::Other;
        }
        let at = Moment {
            now_ns: time_ns,
            before_ns: self.traffic.take(time_ns, frame),
        };
        let news = self.watch.take(time_ns, frame);
        match news {
            Meaning::Sync => {
                let all = self.watch.pairs().iter().zip(&mut self.instruments);
                all.for_each(|(pair, instrument)| instrument.rounds(pair));
            }
            Meaning::Other => self.other(time_ns, frame),
            _ => self.hand_on(at, news),
        }
        news
    }

    #[inline]
    fn hand_on(&mut self, at: Moment, news: Meaning) {
        let Some(place) = place_of(&news) else {
            return;
        };
        let (number, side) = (usize::from(place.pair), usize::from(place.side));
        let (Some(pair), Some(instrument)) = (
            self.watch.pairs().get(number),
            self.instruments.get_mut(number),
        ) else {
            return;
        };
        let keeps = matches!(news, Meaning::Heartbeat(..))
            && self.reset.is_some_and(|(at_ns, node)| {
                let is_it = |side: &Side| node == 0 || node == side.node_id;
                pair.sides.get(side).is_some_and(is_it) && at.now_ns.abs_diff(at_ns) < ANSWER_NS
            });
        instrument.take(at, news, side, pair, keeps);
    }

    fn other(&mut self, now_ns: u64, frame: &Frame) {
        let Some(cob_id) = frame.cob_id().filter(|_| !frame.is_remote()) else {
            return;
        };
        if let (0, &[RESET_COMMUNICATION, node]) = (cob_id, frame.bytes()) {
            self.reset = Some((now_ns, node));
        }
        if cob_id & 0x780 != 0x580 {
            return;
        }
        let id = (cob_id & 0x7F) as u8;
        for (pair, instrument) in self.watch.pairs().iter().zip(&mut self.instruments) {
            if let Some(side) = pair.sides.iter().position(|side| side.node_id == id) {
                instrument.sdo(now_ns, side, frame.bytes());
            }
        }
    }

    /// The log has ended.
    pub fn finish(mut self) -> Collected {
        let span_ns = self.traffic.span_ns();
        let pairs = self.watch.pairs().iter();
        for (pair, instrument) in pairs.zip(&mut self.instruments) {
            if let Some((_, last_ns)) = span_ns {
                instrument.finish(last_ns, pair);
            }
        }
        let pairs = self.watch.pairs().iter();
        let last = pairs.map(|pair| {
            pair.sides.each_ref().map(|side| Last {
                node_id: side.node_id,
                seen: side.seen_ns.is_some(),
                heartbeat_is_lost: side.heartbeat.lost_since_ns().is_some(),
                faults: side.faults,
            })
        });
        Collected {
            instruments: last.zip(self.instruments).collect(),
            traffic: self.traffic,
            counts: *self.watch.counts(),
            strangers: self.watch.strangers().collect(),
            outside: self.outside,
            undated: self.undated,
        }
    }
}

/// How a channel was at the end.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Last {
    /// Its node-id.
    pub node_id: u8,
    /// Whether anything of it was seen.
    pub seen: bool,
    /// Whether its heartbeat is lost.
    pub heartbeat_is_lost: bool,
    /// The faults that stand, bit n for fault n of `device::fault`.
    pub faults: u32,
}

/// What the frames of an interface came to.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Collected {
    /// Each instrument of the plan, with how channel A and B were at the end.
    pub instruments: Vec<([Last; 2], Instrument)>,
    /// The bus.
    pub traffic: Traffic,
    /// How many frames of what there were.
    pub counts: Counts,
    /// Node-ids that are not in the plan and have sent a PDO, an EMCY or a heartbeat.
    pub strangers: Vec<u8>,
    /// Frames outside the time that was asked for.
    pub outside: u64,
    /// Frames without a date among those with one.
    pub undated: u64,
}

impl Last {
    /// Takes how the channel was at the end of another log; `order` tells whether that ended
    /// before, with or after this one.
    fn merge(&mut self, other: &Self, order: Ordering) {
        self.seen |= other.seen;
        match order {
            Ordering::Less => {}
            Ordering::Equal => {
                self.heartbeat_is_lost |= other.heartbeat_is_lost;
                self.faults |= other.faults;
            }
            Ordering::Greater => {
                self.heartbeat_is_lost = other.heartbeat_is_lost;
                self.faults = other.faults;
            }
        }
    }
}

impl Collected {
    /// Leaves out instruments of which nothing was seen.
    pub fn drop_empty(&mut self) {
        self.instruments
            .retain(|(_, instrument)| !instrument.is_empty());
    }

    /// Takes what another log of the same bus came to. In whatever order and groups logs are
    /// merged, the result is the same.
    pub fn merge(&mut self, other: &Self) {
        for (last, instrument) in &other.instruments {
            let ids = last.map(|side| side.node_id);
            let own = self.instruments.iter_mut();
            let own = own
                .into_iter()
                .find(|(own, _)| own.map(|side| side.node_id) == ids);
            match own {
                Some((own, its)) => {
                    let end = |instrument: &Instrument| instrument.span_ns.map(|span| span.1);
                    let order = end(instrument).cmp(&end(its));
                    let sides = own.iter_mut().zip(last);
                    sides.for_each(|(own, other)| own.merge(other, order));
                    its.merge(instrument);
                }
                None => self.instruments.push((*last, instrument.clone())),
            }
        }
        let ids = |(last, _): &([Last; 2], Instrument)| last.map(|side| side.node_id);
        self.instruments.sort_by_key(ids);
        self.strangers.extend(&other.strangers);
        self.strangers.sort_unstable();
        self.strangers.dedup();
        join_fields! { self, other: traffic, counts, outside, undated }
    }
}

fn place_of(news: &Meaning) -> Option<Place> {
    match news {
        Meaning::Slopes(place, _)
        | Meaning::Detail(place)
        | Meaning::Angle(place)
        | Meaning::Rates(place)
        | Meaning::Turned(place)
        | Meaning::Exchange(place, _)
        | Meaning::Emergency(place, _)
        | Meaning::Heartbeat(place, _)
        | Meaning::Malformed(place) => Some(*place),
        Meaning::Sync | Meaning::Other => None,
    }
}
