//! What the frames of a bus say of the instruments on it: the one reading of them that monitor,
//! replay and report share.
//!
//! In: a [`Plan`] of which nodes make a pair and what their PDOs carry, then frames with their
//! time. Out: with each frame its [`News`], and in [`Watch`] the last of everything. Angles are
//! in 0.001 deg whatever resolution the bus has. The difference of a pair is formed anew here, of
//! the two angles of one SYNC, beside what the nodes say of themselves.
//!
//! Left out: where frames come from (`bus`, `log`), and what is done with what they say.

mod pair;
mod side;

pub use pair::{Delta, Pair};
pub use side::{Detail, Nmt, Side, Slopes};

use canopen::Frame;

/// The instruments on a bus.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Node-ids of channel A and channel B of each instrument.
    pub pairs: Vec<[u8; 2]>,
}

impl Default for Plan {
    /// One instrument with node-ids 1 and 2, its PDOs as delivered.
    fn default() -> Self {
        Self {
            pairs: vec![[1, 2]],
        }
    }
}

/// Which channel a piece of news is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// The instrument, by its place in the plan.
    pub pair: u16,
    /// 0 is channel A, 1 is channel B.
    pub side: u8,
}

/// What a frame has told. The values are in the [`Watch`] by then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum News {
    /// TPDO 1: slopes, validity and state. With `Some`, the pair is complete for this SYNC.
    Slopes(Place, Option<Delta>),
    /// TPDO 2: uncertainty, latency, difference, temperature.
    Detail(Place),
    /// TPDO 3 or 4: what the channels tell each other.
    Exchange(Place),
    /// A fault has come or gone.
    Emergency(Place, Emergency),
    /// A heartbeat, with the state when it is another one than before; boot-up is `Nmt::BootUp`.
    Heartbeat(Place, Option<Nmt>),
    /// SYNC.
    Sync,
    /// A frame of the instrument that does not have the form which the plan says.
    Malformed(Place),
    /// Any other frame: of other nodes, SDO, LSS, NMT, 29-bit, remote.
    Other,
}

/// An EMCY message (CiA 301, 7.2.7), its manufacturer bytes as docs/canopen.md has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Emergency {
    /// Error code; 0 when faults have gone.
    pub code: u16,
    /// Error register (1001h).
    pub register: u8,
    /// Bytes 3 to 7 as they came.
    pub bytes: [u8; 5],
}

/// How many frames of what were seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// All frames.
    pub frames: u64,
    /// SYNCs.
    pub syncs: u64,
    /// Frames of the instruments with a length that the plan does not know.
    pub malformed: u64,
    /// Frames of nodes that are not in the plan, and of no node.
    pub others: u64,
    /// Frames that are older than one before them.
    pub backwards: u64,
}

/// All that is known of the instruments.
#[derive(Clone, Debug)]
pub struct Watch {
    pairs: Vec<Pair>,
    counts: Counts,
    places: Box<[Option<Place>; 128]>,
    last_ns: u64,
}

impl Watch {
    /// Knows nothing yet.
    pub fn new(plan: &Plan) -> Self {
        let mut places = Box::new([None; 128]);
        for (pair, ids) in (0..).zip(&plan.pairs) {
            for (side, id) in (0..).zip(ids) {
                if let Some(place) = places.get_mut(usize::from(*id)) {
                    *place = Some(Place { pair, side });
                }
            }
        }
        Self {
            pairs: plan.pairs.iter().map(|ids| Pair::new(*ids)).collect(),
            counts: Counts::default(),
            places,
            last_ns: 0,
        }
    }

    /// The instruments, in the order of the plan.
    pub fn pairs(&self) -> &[Pair] {
        &self.pairs
    }

    /// What was counted.
    pub const fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Takes a frame that was seen at this time, in ns since whatever the source counts from.
    pub fn take(&mut self, time_ns: u64, frame: &Frame) -> News {
        self.counts.frames += 1;
        if time_ns < self.last_ns {
            self.counts.backwards += 1;
        }
        self.last_ns = time_ns;
        let news = self.read(time_ns, frame);
        match news {
            News::Sync => self.counts.syncs += 1,
            News::Malformed(_) => self.counts.malformed += 1,
            News::Other => self.counts.others += 1,
            _ => {}
        }
        news
    }

    fn read(&mut self, time_ns: u64, frame: &Frame) -> News {
        let Some(cob_id) = frame.cob_id().filter(|_| !frame.is_remote()) else {
            return News::Other;
        };
        if cob_id == 0x080 {
            self.pairs.iter_mut().for_each(|pair| pair.sync(time_ns));
            return News::Sync;
        }
        let place = self.places.get(usize::from(cob_id & 0x7F)).copied();
        let Some(place) = place.flatten() else {
            return News::Other;
        };
        let pair = self.pairs.get_mut(usize::from(place.pair));
        let Some(pair) = pair else {
            return News::Other;
        };
        pair.take(time_ns, place, cob_id & 0x780, frame.bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_of_one_sync_make_a_difference() {
        let mut watch = Watch::new(&Plan::default());
        assert_eq!(watch.take(0, &Frame::data_frame(0x80, &[])), News::Sync);
        let a = Frame::data_frame(0x181, &[0xE8, 3, 0, 0, 0x3F, 1]);
        let b = Frame::data_frame(0x182, &[0xE6, 3, 0, 0x80, 0x3F, 1]);
        let place = |side| Place { pair: 0, side };
        assert_eq!(watch.take(1, &a), News::Slopes(place(0), None));
        let delta = Delta {
            time_ns: 0,
            mdeg: [Some(20), None],
        };
        assert_eq!(watch.take(2, &b), News::Slopes(place(1), Some(delta)));
        let slopes = watch.pairs()[0].sides[0].slopes.unwrap();
        assert_eq!(slopes.mdeg, [Some(10_000), Some(0)]);
        let cut = Frame::data_frame(0x182, &[1, 2]);
        assert_eq!(watch.take(3, &cut), News::Malformed(place(1)));
        assert_eq!(watch.counts().malformed, 1);
    }
}
