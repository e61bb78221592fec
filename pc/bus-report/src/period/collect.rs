//! From the frames of a log to what is kept of each instrument.
//!
//! In: frames with their time, in ns, in the order of the log. Out: an [`Instrument`] per pair of
//! the plan, and the [`Traffic`] of the bus. Memory does not grow with the log.
//!
//! Left out: where frames come from (`input`), and what a frame says (`watch`).

use canopen::Frame;

use super::instrument::{Instrument, Moment};
use super::traffic::Traffic;
use crate::blackbox::exchange::Measured;
use bus_logs::Part;
use listen::{Checks, Counts, Meaning, Place, Plan, Watch};

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

    /// Takes a frame where its time is in the part that was asked for.
    pub fn take_part(&mut self, part: &mut Part, time_ns: u64, frame: &Frame) {
        if part.has(time_ns) {
            self.take(time_ns, frame);
        } else {
            self.outside += 1;
        }
    }

    /// Takes a frame.
    pub fn take(&mut self, time_ns: u64, frame: &Frame) {
        if self.traffic.is_stray(time_ns) {
            self.undated += 1;
            return;
        }
        let at = Moment {
            now_ns: time_ns,
            before_ns: self.traffic.take(time_ns, frame),
        };
        let news = self.watch.take(time_ns, frame);
        self.hand_on(at, news, frame);
    }

    fn hand_on(&mut self, at: Moment, news: Meaning, frame: &Frame) {
        let now_ns = at.now_ns;
        match news {
            Meaning::Sync => {
                let all = self.instruments.iter_mut();
                return all.for_each(|instrument| instrument.sync(now_ns));
            }
            Meaning::Other => return self.other(now_ns, frame),
            _ => {}
        }
        let Some(place) = place_of(&news) else {
            return;
        };
        let (number, side) = (usize::from(place.pair), usize::from(place.side));
        let pair = self.watch.pairs().get(number);
        let told = pair.and_then(|pair| pair.sides.get(side));
        let (Some(instrument), Some(told)) = (self.instruments.get_mut(number), told) else {
            return;
        };
        match news {
            Meaning::Slopes(..) => {
                if let Some(slopes) = &told.slopes {
                    instrument.slopes(now_ns, side, slopes);
                }
            }
            Meaning::Detail(_) => {
                if let Some(detail) = &told.detail {
                    instrument.detail(now_ns, side, detail);
                }
            }
            Meaning::Exchange(_, part) if part.has_angles() => {
                if let Some(told) = told.told {
                    instrument.measured(now_ns, side, Measured::of(&told.exchange));
                }
            }
            Meaning::Emergency(_, told) => instrument.emergency(now_ns, side, &told),
            Meaning::Heartbeat(_, beat) => {
                let keeps = self.reset.is_some_and(|(at_ns, node)| {
                    (node == 0 || node == told.node_id) && now_ns.abs_diff(at_ns) < ANSWER_NS
                });
                instrument.heartbeat(now_ns, side, beat, keeps);
            }
            Meaning::Malformed(_) => return instrument.malformed(side),
            _ => {}
        }
        instrument.seen(at, side);
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
                instrument.sdo(side, frame.bytes());
            }
        }
    }

    /// The log has ended.
    pub fn finish(mut self) -> Collected {
        if let Some((_, last_ns)) = self.traffic.span_ns {
            for (pair, instrument) in self.watch.pairs().iter().zip(&mut self.instruments) {
                let lost = pair
                    .sides
                    .each_ref()
                    .map(|side| side.heartbeat.lost_since_ns());
                instrument.finish(last_ns, lost);
            }
        }
        let pairs = self.watch.pairs().iter();
        let told = pairs.map(|pair| {
            [0, 1].map(|side: usize| Told {
                node_id: pair.sides[side].node_id,
                checks: pair.sides[side].checks,
            })
        });
        Collected {
            instruments: told.zip(self.instruments).collect(),
            traffic: self.traffic,
            counts: *self.watch.counts(),
            outside: self.outside,
            undated: self.undated,
        }
    }
}

/// What `watch` knows of a channel.
#[derive(Clone, Copy, Debug)]
pub struct Told {
    /// Its node-id.
    pub node_id: u8,
    /// What does not fit together in what it says.
    pub checks: Checks,
}

/// What a log came to.
#[derive(Debug)]
pub struct Collected {
    /// Each instrument of the plan, with what `watch` knows of channel A and B.
    pub instruments: Vec<([Told; 2], Instrument)>,
    /// The bus.
    pub traffic: Traffic,
    /// What `watch` has counted.
    pub counts: Counts,
    /// Frames outside the time that was asked for.
    pub outside: u64,
    /// Frames without a date among those with one.
    pub undated: u64,
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
