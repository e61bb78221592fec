//! Two channels, and the difference between them.
//!
//! In: the frames of two nodes. Out: the last of what each has told, and with the second slopes of
//! a SYNC their difference.
//!
//! Left out: a judgement; the nodes send theirs.

use super::side::{self, Side};
use super::{News, Place};

/// The difference of the two channels at one SYNC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delta {
    /// When the SYNC was seen.
    pub time_ns: u64,
    /// Slope X and Y of channel A minus those of channel B, 0.001 deg; `None` where one of them
    /// has none.
    pub mdeg: [Option<i32>; 2],
}

/// One instrument.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Channel A and channel B.
    pub sides: [Side; 2],
    /// The latest difference.
    pub delta: Option<Delta>,
    sync_ns: u64,
    /// Which of them have sent slopes since the SYNC.
    told: [bool; 2],
}

impl Pair {
    pub(super) fn new(ids: [u8; 2]) -> Self {
        Self {
            sides: ids.map(Side::new),
            delta: None,
            sync_ns: 0,
            told: [false; 2],
        }
    }

    pub(super) fn sync(&mut self, time_ns: u64) {
        self.sync_ns = time_ns;
        self.told = [false; 2];
    }

    pub(super) fn take(&mut self, time_ns: u64, at: Place, service: u16, bytes: &[u8]) -> News {
        let number = usize::from(at.side);
        let Some(side) = self.sides.get_mut(number) else {
            return News::Other;
        };
        side.seen_ns = Some(time_ns);
        match service {
            0x180 => match side::slopes(time_ns, bytes) {
                Some(slopes) => {
                    side.slopes = Some(slopes);
                    News::Slopes(at, self.compare(number))
                }
                None => News::Malformed(at),
            },
            0x280 => match side::detail(time_ns, bytes) {
                Some(detail) => {
                    side.detail = Some(detail);
                    News::Detail(at)
                }
                None => News::Malformed(at),
            },
            0x380 | 0x480 if bytes.len() == 8 => News::Exchange(at),
            0x380 | 0x480 => News::Malformed(at),
            0x080 => side
                .emergency(bytes)
                .map_or(News::Malformed(at), |emergency| {
                    News::Emergency(at, emergency)
                }),
            0x700 => side
                .heartbeat(time_ns, bytes)
                .map_or(News::Malformed(at), |changed| News::Heartbeat(at, changed)),
            _ => News::Other,
        }
    }

    fn compare(&mut self, number: usize) -> Option<Delta> {
        if let Some(told) = self.told.get_mut(number) {
            *told = true;
        }
        let [Some(a), Some(b)] = [self.sides[0].slopes, self.sides[1].slopes] else {
            return None;
        };
        if self.told != [true; 2] {
            return None;
        }
        let minus = |axis: usize| Some(a.mdeg[axis]? - b.mdeg[axis]?);
        self.delta = Some(Delta {
            time_ns: self.sync_ns,
            mdeg: [minus(0), minus(1)],
        });
        self.delta
    }
}
