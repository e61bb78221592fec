//! The acceptance filters of the CAN controller: 14 banks.
//!
//! In: loads, stores, a frame's identifier. Out: the FIFO that takes it and the number of the
//! filter that matched. Source: RM0008 24.7.4, 24.9.4. Left out: nothing.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 00h | FMR (200h) | RM0008 24.9.4 |
//! | 04h | FM1R | 24.9.4 |
//! | 0Ch | FS1R | 24.9.4 |
//! | 14h | FFA1R | 24.9.4 |
//! | 1Ch | FA1R | 24.9.4 |
//! | 40h | F0R1, on to F13R2 at ACh | 24.9.4 |

use canopen::Frame;
use canopen::frame::Id;

/// Banks of a part with one controller.
const BANKS: usize = 14;

/// The registers.
#[derive(Clone, Debug)]
pub struct Filters {
    fmr: u32,
    /// FM1R: list (1) or mask (0).
    list: u32,
    /// FS1R: one of 32 bits (1) or two of 16 (0).
    wide: u32,
    /// FFA1R.
    fifo: u32,
    /// FA1R.
    active: u32,
    banks: [[u32; 2]; BANKS],
}

impl Default for Filters {
    fn default() -> Self {
        Self {
            // 24.9.4: FINIT is set after a reset.
            fmr: 0x2A1C_0E01,
            list: 0,
            wide: 0,
            fifo: 0,
            active: 0,
            banks: [[0; 2]; BANKS],
        }
    }
}

/// A frame that a filter lets in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Match {
    /// FIFO 0 or 1.
    pub fifo: usize,
    /// The filter match index (24.7.4).
    pub index: u8,
}

/// The identifier as a filter of 32 bits sees it (24.7.4, figure 230).
fn wide_word(frame: &Frame) -> u32 {
    let remote = u32::from(frame.is_remote()) << 1;
    remote
        | match frame.id() {
            Id::Standard(id) => u32::from(id.as_raw()) << 21,
            Id::Extended(id) => id.as_raw() << 3 | 4,
        }
}

/// The same of 16 bits: STID, RTR, IDE, EXID 17 to 15.
fn narrow_word(frame: &Frame) -> u16 {
    let remote = u16::from(frame.is_remote()) << 4;
    remote
        | match frame.id() {
            Id::Standard(id) => id.as_raw() << 5,
            Id::Extended(id) => {
                let id = id.as_raw();
                ((id >> 18) << 5) as u16 | 1 << 3 | (id >> 15 & 7) as u16
            }
        }
}

impl Filters {
    /// Who takes a frame; `None` for nobody.
    ///
    /// 24.7.4: wide before narrow, list before mask, then the lower number.
    pub fn find(&self, frame: &Frame) -> Option<Match> {
        if self.fmr & 1 != 0 {
            return None;
        }
        let mut numbers = [0u8; 2];
        let mut best: Option<((bool, bool, usize), Match)> = None;
        for bank in 0..BANKS {
            let fifo = (self.fifo >> bank & 1) as usize;
            let wide = self.wide >> bank & 1 != 0;
            let list = self.list >> bank & 1 != 0;
            // Numbers count for banks that are not active as well.
            let first = numbers[fifo];
            numbers[fifo] += match (wide, list) {
                (true, false) => 1,
                (true, true) | (false, false) => 2,
                (false, true) => 4,
            };
            if self.active >> bank & 1 == 0 {
                continue;
            }
            if let Some(offset) = self.matching(bank, wide, list, frame) {
                let order = (!wide, !list, bank);
                let index = first + offset;
                if best.is_none_or(|(before, _)| order < before) {
                    best = Some((order, Match { fifo, index }));
                }
            }
        }
        best.map(|(_, found)| found)
    }

    fn matching(&self, bank: usize, wide: bool, list: bool, frame: &Frame) -> Option<u8> {
        let [first, second] = self.banks[bank];
        if wide {
            let word = wide_word(frame);
            return match list {
                true => [first, second]
                    .iter()
                    .position(|id| id & !1 == word)
                    .map(|n| n as u8),
                false => ((word ^ first) & second & !1 == 0).then_some(0),
            };
        }
        let word = narrow_word(frame);
        let halves = |word: u32| [word as u16, (word >> 16) as u16];
        if list {
            let ids = [halves(first), halves(second)];
            return ids
                .as_flattened()
                .iter()
                .position(|id| *id == word)
                .map(|n| n as u8);
        }
        let pairs = [halves(first), halves(second)];
        let found = pairs.iter().position(|[id, mask]| (word ^ id) & mask == 0);
        found.map(|n| n as u8)
    }

    /// A load; `offset` from 4000 6600h.
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.fmr,
            0x04 => self.list,
            0x0C => self.wide,
            0x14 => self.fifo,
            0x1C => self.active,
            0x40..=0xAC => self.banks.as_flattened()[place(offset)],
            _ => 0,
        }
    }

    /// A store. Modes need FINIT; a bank needs FINIT or to be inactive (24.9.4).
    pub fn write(&mut self, offset: u32, value: u32) {
        let all = (1 << BANKS) - 1;
        let initialising = self.fmr & 1 != 0;
        match offset {
            0x00 => self.fmr = value & 0x3F01 | self.fmr & !0x3F01,
            0x04 if initialising => self.list = value & all,
            0x0C if initialising => self.wide = value & all,
            0x14 if initialising => self.fifo = value & all,
            0x1C => self.active = value & all,
            0x40..=0xAC => {
                let bank = place(offset) / 2;
                if initialising || self.active >> bank & 1 == 0 {
                    self.banks.as_flattened_mut()[place(offset)] = value;
                }
            }
            _ => {}
        }
    }
}

fn place(offset: u32) -> usize {
    (offset as usize - 0x40) / 4
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(filters: &mut Filters, writes: &[(u32, u32)]) {
        for (offset, value) in writes {
            filters.write(*offset, *value);
        }
    }

    fn index(filters: &Filters, frame: &Frame) -> Option<(usize, u8)> {
        filters.find(frame).map(|found| (found.fifo, found.index))
    }

    #[test]
    fn a_mask_of_nothing_takes_everything_once_the_banks_are_on() {
        let mut filters = Filters::default();
        let frame = Frame::data_frame(0x123, &[1]);
        set(&mut filters, &[(0x0C, 1), (0x1C, 1)]);
        assert_eq!(filters.find(&frame), None);
        filters.write(0x00, 0);
        assert_eq!(index(&filters, &frame), Some((0, 0)));
    }

    #[test]
    fn wide_goes_before_narrow_and_list_before_mask() {
        let mut filters = Filters::default();
        // Bank 0: two narrow masks, all. Bank 1: wide mask, all. Bank 2: wide list of 123h.
        set(
            &mut filters,
            &[
                (0x0C, 0b110),
                (0x04, 0b100),
                (0x14, 0b100),
                (0x50, 0x123 << 21),
                (0x54, 0x124 << 21),
                (0x1C, 0b111),
                (0x00, 0),
            ],
        );
        assert_eq!(
            index(&filters, &Frame::data_frame(0x123, &[])),
            Some((1, 0))
        );
        assert_eq!(
            index(&filters, &Frame::data_frame(0x124, &[])),
            Some((1, 1))
        );
        assert_eq!(
            index(&filters, &Frame::data_frame(0x125, &[])),
            Some((0, 2))
        );
        filters.write(0x1C, 0b001);
        assert_eq!(
            index(&filters, &Frame::data_frame(0x125, &[])),
            Some((0, 0))
        );
    }

    #[test]
    fn a_narrow_list_has_four_identifiers_and_tells_remote_frames() {
        let mut filters = Filters::default();
        let id = |id: u32| id << 5;
        set(
            &mut filters,
            &[
                (0x04, 1),
                (0x40, id(1) | id(2) << 16),
                (0x44, id(3) | id(4) << 16 | 1 << 20),
                (0x1C, 1),
                (0x00, 0),
            ],
        );
        assert_eq!(index(&filters, &Frame::data_frame(3, &[])), Some((0, 2)));
        assert_eq!(index(&filters, &Frame::data_frame(4, &[])), None);
        let remote = Frame::remote(canopen::frame::standard(4), 0).unwrap();
        assert_eq!(index(&filters, &remote), Some((0, 3)));
    }
}
