//! A frame as bits on the wire: CRC-15, bit stuffing, length, and the field that arbitrates.
//!
//! In: a [`Frame`]. Out: its bits from start of frame to the end of the CRC sequence, stuffed
//! (ISO 11898-1, classical frame formats), their number, and a key that orders frames as the bus
//! does. A dominant bit is 0. Left out: CAN FD, and frames that no controller sends (reserved bits
//! recessive, a data length code above 8).

use canopen::Frame;
use canopen::frame::Id;

/// Bits after the CRC sequence: its delimiter, acknowledge slot and delimiter, end of frame (7).
pub const TAIL_BITS: u64 = 10;
/// Bits of intermission, in which nobody begins.
pub const INTERMISSION_BITS: u64 = 3;
/// The most bits that [`Wire`] holds: 118 of an extended frame with 8 bytes, 29 of stuffing.
const MOST_BITS: usize = 147;

/// x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1, its highest term left out.
const CRC_POLYNOMIAL: u16 = 0x4599;
const CRC_BITS: u32 = 15;
const CRC_MASK: u16 = 0x7FFF;
const CRC_TABLE: [u16; 256] = crc_table();

/// For a state and the next eight bits: stuff bits * 8 + next state.
///
/// A state is the level of the last bit * 4 + (length of its run - 1); a run of five never stands,
/// since the stuff bit follows it at once and begins a run of its own.
const STUFF_TABLE: [[u8; 256]; 8] = stuff_table();
/// The state after one recessive bit, as before each start of frame.
const AFTER_RECESSIVE: u8 = 4;

const fn crc_table() -> [u16; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = (byte as u16) << (CRC_BITS - 8);
        let mut bit = 0;
        while bit < 8 {
            let carry = crc >> (CRC_BITS - 1) & 1;
            crc = ((crc << 1) ^ (carry * CRC_POLYNOMIAL)) & CRC_MASK;
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
}

/// The state after one more bit, and whether a stuff bit followed it.
const fn stuff(state: u8, level: u8) -> (u8, u8) {
    match (state >> 2 == level, state & 3) {
        (false, _) => (level << 2, 0),
        (true, 3) => ((1 - level) << 2, 1),
        (true, run) => (level << 2 | (run + 1), 0),
    }
}

const fn stuff_table() -> [[u8; 256]; 8] {
    let mut table = [[0; 256]; 8];
    let mut from = 0;
    while from < 8 {
        let mut byte = 0;
        while byte < 256 {
            let (mut state, mut stuffed, mut bit) = (from as u8, 0, 8);
            while bit > 0 {
                bit -= 1;
                let (next, more) = stuff(state, (byte >> bit & 1) as u8);
                (state, stuffed) = (next, stuffed + more);
            }
            table[from][byte] = stuffed << 3 | state;
            byte += 1;
        }
        from += 1;
    }
    table
}

/// CRC-15 of the bytes, first byte first, most significant bit first, from 0.
///
/// Zero bits in front change nothing, so a field that ends on no byte border is padded there.
fn crc15(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc: u16, byte| {
        let index = (crc >> (CRC_BITS - 8)) as u8 ^ byte;
        (crc << 8 ^ CRC_TABLE[usize::from(index)]) & CRC_MASK
    })
}

/// The fields that arbitrate, first bit highest: the lower number wins the bus.
///
/// At the same 11 bits a data frame goes before a remote one, and both before a 29-bit identifier.
pub fn priority(frame: &Frame) -> u32 {
    let remote = u32::from(frame.is_remote());
    match frame.id() {
        Id::Standard(id) => u32::from(id.as_raw()) << 21 | remote << 20,
        Id::Extended(id) => {
            let (base, rest) = (id.as_raw() >> 18, id.as_raw() & 0x3_FFFF);
            base << 21 | 0b11 << 19 | rest << 1 | remote
        }
    }
}

/// Start of frame to the end of the CRC sequence before stuffing: the bits and their number.
fn unstuffed(frame: &Frame) -> (u128, u32) {
    let control = u128::from(frame.is_remote()) << 6 | frame.length() as u128;
    let (header, header_bits) = match frame.id() {
        Id::Standard(id) => (u128::from(id.as_raw()) << 7 | control, 19),
        Id::Extended(id) => {
            let (base, rest) = (id.as_raw() >> 18, id.as_raw() & 0x3_FFFF);
            (
                u128::from(base << 2 | 0b11) << 25 | u128::from(rest) << 7 | control,
                39,
            )
        }
    };
    let data_bits = 8 * frame.bytes().len() as u32;
    // What a frame has no room for, and what a remote one does not carry, is shifted out.
    let padded = u128::from(u64::from_be_bytes(frame.padded()));
    let body = header << data_bits | padded >> (64 - data_bits);
    let body_bits = header_bits + data_bits;
    let first = 16 - body_bits.div_ceil(8) as usize;
    let crc = crc15(&body.to_be_bytes()[first..]);
    (body << CRC_BITS | u128::from(crc), body_bits + CRC_BITS)
}

/// Bits on the wire from start of frame to the last CRC bit, stuff bits included.
pub fn stuffed_bits(frame: &Frame) -> u64 {
    let (bits, length) = unstuffed(frame);
    // Alternating bits, recessive before the start of frame, fill the first byte: no stuffing.
    let padded = bits | 0b0101_0101 << length;
    let first = 16 - length.div_ceil(8) as usize;
    let start = (AFTER_RECESSIVE, 0);
    let (_, stuffed) = (padded.to_be_bytes()[first..].iter()).fold(start, |(state, sum), byte| {
        let entry = STUFF_TABLE[usize::from(state)][usize::from(*byte)];
        (entry & 7, sum + u64::from(entry >> 3))
    });
    u64::from(length) + stuffed
}

/// Bits of a frame from start of frame to the end of its end-of-frame field.
pub fn frame_bits(frame: &Frame) -> u64 {
    stuffed_bits(frame) + TAIL_BITS
}

/// The stuffed bits one by one, for the rare frame in which something goes wrong.
#[derive(Clone, Copy, Debug)]
pub struct Wire {
    recessive: [bool; MOST_BITS],
    length: usize,
}

impl Wire {
    /// Start of frame to the end of the CRC sequence.
    pub fn new(frame: &Frame) -> Self {
        let (bits, length) = unstuffed(frame);
        let mut wire = Self {
            recessive: [true; MOST_BITS],
            length: 0,
        };
        let mut state = AFTER_RECESSIVE;
        for bit in (0..length).rev() {
            let level = (bits >> bit & 1) as u8;
            wire.push(level == 1);
            let (next, stuffed) = stuff(state, level);
            if stuffed == 1 {
                wire.push(level == 0);
            }
            state = next;
        }
        wire
    }

    fn push(&mut self, recessive: bool) {
        self.recessive[self.length] = recessive;
        self.length += 1;
    }

    /// The levels, `true` for recessive.
    pub fn levels(&self) -> &[bool] {
        &self.recessive[..self.length]
    }

    /// Turns one bit over; a number past the end counts from the start again.
    ///
    /// Returns which bit it was, from 0.
    pub fn flip(&mut self, bit: usize) -> usize {
        let bit = bit % self.length;
        self.recessive[bit] ^= true;
        bit
    }

    /// The run of one level that ends with this bit, in bits; 0 when the bit has the other level.
    pub fn run(&self, bit: usize, recessive: bool) -> u64 {
        let back = self.recessive[..=bit].iter().rev();
        back.take_while(|level| **level == recessive).count() as u64
    }

    /// The first bit at which another frame has the other level; `None` for the same bits.
    pub fn differs(&self, other: &Self) -> Option<usize> {
        (self.recessive.iter().zip(&other.recessive)).position(|(one, two)| one != two)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use canopen::frame::{ExtendedId, standard};
    use proptest::prelude::*;

    fn extended(id: u32, bytes: &[u8]) -> Frame {
        Frame::with(ExtendedId::new(id).unwrap(), bytes).unwrap()
    }

    fn any_frame() -> impl Strategy<Value = Frame> {
        let bytes = prop_oneof![Just(0), Just(0xFF), any::<u8>()];
        let data = prop::collection::vec(bytes, 0..=8);
        (any::<u32>(), any::<bool>(), any::<bool>(), data).prop_map(|(id, long, remote, data)| {
            let id = match long {
                true => Id::Extended(ExtendedId::new(id & 0x1FFF_FFFF).unwrap()),
                false => Id::Standard(standard(id as u16)),
            };
            match remote {
                true => Frame::remote(id, data.len()).unwrap(),
                false => Frame::with(id, &data).unwrap(),
            }
        })
    }

    #[test]
    fn the_crc_has_its_published_check_value() {
        assert_eq!(crc15(b"123456789"), 0x059E);
    }

    /// Identifier 0 without data: 19 zeros, CRC 0. 34 dominant bits take a recessive one after the
    /// fifth and after each five more, since each of those breaks the run.
    #[test]
    fn a_frame_of_zeros_counted_by_hand() {
        let frame = Frame::data_frame(0, &[]);
        assert_eq!(unstuffed(&frame), (0, 34));
        assert_eq!(frame_bits(&frame), 34 + 6 + 10);
    }

    /// Start of frame, identifier 555h, then RTR, IDE and r0, a length of 1, and AAh.
    #[test]
    fn the_fields_stand_in_their_order() {
        let (bits, length) = unstuffed(&Frame::data_frame(0x555, &[0xAA]));
        let fields = [(0, 1), (0x555, 11), (0, 3), (1, 4), (0xAA, 8)];
        let want = (fields.iter()).fold(0, |bits, (field, length)| bits << length | field);
        assert_eq!(bits >> CRC_BITS, want);
        assert_eq!(length, 42);
    }

    /// Lengths from a program that works bit by bit and shares nothing with this one.
    #[test]
    fn lengths_are_those_of_another_implementation() {
        let remote = Frame::remote(standard(0x701), 1).unwrap();
        let known = [
            (Frame::data_frame(0x080, &[]), 48),
            (Frame::data_frame(0x101, &[]), 46),
            (Frame::data_frame(0x701, &[0]), 56),
            (Frame::data_frame(0x181, &[0; 8]), 123),
            (Frame::data_frame(0x181, &[1, 2, 3, 4, 5, 6, 7, 8]), 117),
            (Frame::data_frame(0x100, &[0xAA; 8]), 110),
            (extended(0x1234_5678, &[0xDE, 0xAD]), 81),
            (extended(0x1FFF_FFFF, &[0xFF; 8]), 146),
            (remote, 48),
        ];
        for (frame, bits) in known {
            assert_eq!(frame_bits(&frame), bits, "{frame:?}");
        }
    }

    #[test]
    fn identifiers_order_as_the_bus_does() {
        let remote = |id| Frame::remote(standard(id), 0).unwrap();
        let ascending = [
            Frame::data_frame(0x000, &[9]),
            extended(0x0000_0000, &[]),
            Frame::data_frame(0x100, &[]),
            remote(0x100),
            extended(0x100 << 18, &[]),
            Frame::remote(ExtendedId::new(0x100 << 18).unwrap(), 0).unwrap(),
            extended(0x100 << 18 | 1, &[]),
            Frame::data_frame(0x101, &[]),
            remote(0x7FF),
            extended(0x1FFF_FFFF, &[]),
        ];
        assert!(ascending.is_sorted_by_key(priority));
        assert!((ascending.windows(2)).all(|pair| priority(&pair[0]) < priority(&pair[1])));
    }

    #[test]
    fn a_run_is_counted_back_from_its_last_bit() {
        let mut wire = Wire::new(&Frame::data_frame(0, &[]));
        assert_eq!((wire.run(4, false), wire.run(4, true)), (5, 0));
        assert_eq!((wire.run(5, true), wire.run(6, false)), (1, 1));
        assert_eq!(wire.flip(5), 5);
        assert_eq!(wire.run(5, false), 6);
        assert_eq!(wire.flip(40 + 5), 5);
    }

    proptest! {
        #[test]
        fn lengths_lie_between_the_known_bounds(frame in any_frame()) {
            let data = 8 * frame.bytes().len() as u64;
            let short = matches!(frame.id(), Id::Standard(_));
            let stuffable = data + if short { 34 } else { 54 };
            let bits = frame_bits(&frame);
            prop_assert!(bits >= stuffable + 10);
            prop_assert!(bits <= stuffable + 10 + (stuffable - 1) / 4);
        }

        #[test]
        fn the_table_counts_what_the_single_bits_give(frame in any_frame()) {
            let wire = Wire::new(&frame);
            prop_assert_eq!(wire.levels().len() as u64, stuffed_bits(&frame));
            prop_assert!(wire.levels().windows(6).all(|six| six.iter().any(|l| *l != six[0])));
        }

        #[test]
        fn without_its_stuff_bits_the_wire_divides_by_the_polynomial(frame in any_frame()) {
            let (mut last, mut run, mut rest) = (true, 1, 0u32);
            for level in Wire::new(&frame).levels().iter().copied() {
                let stuffed = run == 5;
                run = if level == last { run + 1 } else { 1 };
                last = level;
                if !stuffed {
                    rest = rest << 1 | u32::from(level);
                    rest ^= (rest >> 15 & 1) * (0x8000 | u32::from(CRC_POLYNOMIAL));
                }
            }
            prop_assert_eq!(rest, 0);
        }
    }
}
