//! Reading many registers at once, as a driver does at every sample.
//!
//! In: a read command that the part has taken, and room for bytes. Out: what [`Chip::exchange`]
//! would have given byte by byte, with the same effects. Where a byte could change one that
//! leaves after it, the bytes go one by one.

use std::ops::Range;

use super::registers::{
    CTRL2, OUT_T_H, OUT_T_L, OUT_X_L, OUT_Z_H, STATUS, STATUS_DUP, ctrl2, flag,
};
use super::{Chip, FifoMode, TEMPERATURE, Wire};
use crate::spi_part::ADDRESSES;

impl Chip {
    /// As many bytes out as there is room, with zeros in.
    pub fn read_into(&mut self, bytes: &mut [u8]) {
        let Some(span) = self.plain_span(bytes.len()) else {
            return bytes.iter_mut().for_each(|byte| *byte = self.exchange(0));
        };
        bytes.copy_from_slice(&self.state.registers[span.clone()]);
        if span.contains(&usize::from(OUT_Z_H)) {
            self.state.clear(STATUS, flag::DRDY);
            self.state.clear(STATUS_DUP, flag::DRDY);
        }
        if span.contains(&usize::from(OUT_T_H)) {
            self.state.clear(STATUS_DUP, flag::DRDY_T);
        }
        self.state.wire = Wire::Read((span.end % ADDRESSES) as u8);
    }

    /// The registers of a burst in which each byte is what its register held at the beginning.
    fn plain_span(&self, length: usize) -> Option<Range<usize>> {
        let Wire::Read(first) = self.state.wire else {
            return None;
        };
        let span = usize::from(first)..usize::from(first) + length;
        let answers = self.state.answers() && self.state.fault.is_none();
        let runs =
            self.state.register(CTRL2) & (ctrl2::IF_ADD_INC | ctrl2::SIM) == ctrl2::IF_ADD_INC;
        // Flags that reading an output clears, after that output.
        let shows_effect = first <= OUT_Z_H && span.end > usize::from(STATUS_DUP);
        let plain = answers
            && runs
            && self.fifo_mode == FifoMode::Bypass
            && span.end <= ADDRESSES
            && !shows_effect
            && self.is_whole(&span, OUT_X_L, OUT_Z_H, 0..TEMPERATURE)
            && self.is_whole(&span, OUT_T_L, OUT_T_H, TEMPERATURE..TEMPERATURE + 1);
        plain.then_some(span)
    }

    /// True when the span holds all of these outputs or none, and no half of a pair was read
    /// before: reading whole pairs then changes nothing in them.
    fn is_whole(&self, span: &Range<usize>, low: u8, high: u8, pairs: Range<usize>) -> bool {
        let (low, high) = (usize::from(low), usize::from(high));
        if span.end <= low || span.start > high {
            return true;
        }
        let all = span.start <= low && span.end > high;
        all && self.pairs[pairs].iter().all(|pair| !pair.is_half_read())
    }
}

#[cfg(test)]
mod tests {
    use super::super::registers::{CTRL1, FIFO_CTRL, RESET};
    use super::super::{Fault, Traits};
    use super::*;
    use crate::rng::Rng;
    use crate::spi_part::bench::write;

    /// A part that converts at 400 Hz and has a sample, with block data update.
    fn working() -> Chip {
        let mut chip = Chip::new(Traits::TYPICAL);
        chip.power_on(0);
        chip.advance_to(30_000_000);
        for (address, value) in [(CTRL1, 0x74), (CTRL2, 0x0C)] {
            write(&mut chip, address, value);
        }
        chip.convert([0.1, -0.2, 0.9], 27.3);
        chip
    }

    /// The same burst at once and byte by byte must give the same bytes and leave the same part.
    fn compare(chip: &mut Chip, first: u8, length: usize) -> bool {
        chip.select();
        chip.exchange(first | 0x80);
        let plain = chip.plain_span(length).is_some();
        let mut slow = chip.clone();
        let (mut got, mut want) = (vec![0; length], vec![0; length]);
        chip.read_into(&mut got);
        want.iter_mut().for_each(|byte| *byte = slow.exchange(0));
        assert_eq!(got, want, "{length} from {first:02x}");
        assert_eq!(
            format!("{chip:?}"),
            format!("{slow:?}"),
            "{first:02x} {length}"
        );
        chip.deselect();
        plain
    }

    #[test]
    fn a_burst_is_what_its_bytes_are_one_by_one() {
        let mut rng = Rng::stream(1, "bursts");
        let mut below = |limit: u32| rng.range(0.0, f64::from(limit)) as u32;
        let mut plain = [0; 2];
        let mut chip = working();
        for _ in 0..20_000 {
            match below(12) {
                0 => chip = working(),
                1 => write(
                    &mut chip,
                    CTRL2,
                    [0x0C, 0x04, 0x08, 0x0D][below(4) as usize],
                ),
                2 => write(&mut chip, FIFO_CTRL, [0x00, 0x00, 0xC4][below(3) as usize]),
                3 => chip.set_fault([None, None, Some(Fault::MisoHigh)][below(3) as usize]),
                4 => chip.brown_out(chip.now_ns()),
                _ => chip.convert(
                    [0.0; 3].map(|_: f64| f64::from(below(200)) * 0.01 - 1.0),
                    30.0,
                ),
            }
            let first = if below(2) == 0 {
                0x26
            } else {
                below(128) as u8
            };
            let length = if below(2) == 0 { 8 } else { below(40) as usize };
            plain[usize::from(compare(&mut chip, first, length))] += 1;
        }
        assert!(plain.iter().all(|n| *n > 2000), "{plain:?}");
    }

    #[test]
    fn what_the_driver_reads_goes_at_once() {
        let mut chip = working();
        assert_eq!(RESET.len(), ADDRESSES);
        // Sample, temperature, control registers, and everything from FIFO_CTRL on.
        for (first, length) in [(0x26, 8), (0x0D, 2), (0x20, 6), (0x2E, 18), (0x0F, 1)] {
            assert!(compare(&mut chip, first, length), "{first:02x}");
        }
    }
}
