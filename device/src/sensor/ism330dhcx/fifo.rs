//! The FIFO: tagged words of one sensor's three axes, oldest first.
//!
//! In: the level and seven bytes a word. Out: [`FifoWord`]s. Words of both sensors that were taken
//! at the same time carry the same slot number, so a lost word shows. Left out: compressed words,
//! and the parity bit of the tag.

use embedded_hal::spi::SpiDevice;
use tilt::sample::{Counts, RateCounts};

use super::super::error::ReadError;
use super::super::wire;
use super::driver::Ism330dhcx;
use super::registers::{FIFO_LEVEL_HIGH, FIFO_OVERRUN, Register};

/// Depth of the part's FIFO in words, without compression: 3 kB \[RECALL\].
pub const FIFO_WORDS: usize = 512;

/// Tag of a word of the gyroscope, without compression.
const TAG_RATE: u8 = 0x01;
/// Tag of a word of the accelerometer, without compression.
const TAG_ACCELERATION: u8 = 0x02;

/// What a word holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FifoData {
    /// The gyroscope's three axes.
    Rate(RateCounts),
    /// The accelerometer's three axes.
    Acceleration(Counts),
    /// Something this driver does not ask for; 0 is an empty FIFO.
    Other {
        /// The tag's sensor field, 0 to 31.
        tag: u8,
    },
}

/// One word of the FIFO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FifoWord {
    /// Number of the sampling time, 0 to 3, which comes round.
    pub slot: u8,
    /// What it holds.
    pub data: FifoData,
}

impl Default for FifoWord {
    /// An empty word.
    fn default() -> Self {
        Self::from_bytes([0; 7])
    }
}

impl FifoWord {
    /// FIFO_DATA_OUT_TAG to FIFO_DATA_OUT_Z_H (78h to 7Eh).
    const fn from_bytes(bytes: [u8; 7]) -> Self {
        let [tag, xyz @ ..] = bytes;
        let axes = wire::axes(xyz);
        let data = match tag >> 3 {
            TAG_RATE => FifoData::Rate(RateCounts(axes)),
            TAG_ACCELERATION => FifoData::Acceleration(Counts(axes)),
            tag => FifoData::Other { tag },
        };
        Self {
            slot: (tag >> 1) & 0x03,
            data,
        }
    }
}

/// What one call of `read_fifo` brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FifoRead {
    /// Words written to the front of the caller's slice, oldest first; 0 to 512.
    pub count: usize,
    /// Words that were there but found no room in the slice; 0 to 512.
    pub left: usize,
    /// Words were lost before this read because the FIFO was full.
    pub overrun: bool,
}

impl<SPI: SpiDevice> Ism330dhcx<SPI> {
    /// Moves what the FIFO holds into `out`, oldest first, as far as there is room.
    ///
    /// One transfer for the level, then one of seven bytes per word.
    ///
    /// # Errors
    /// The bus failed, or the level is one the part cannot have. After an error the words already
    /// taken from the part are lost.
    pub fn read_fifo(&mut self, out: &mut [FifoWord]) -> Result<FifoRead, ReadError<SPI::Error>> {
        let (level, overrun) = self.fifo_level().map_err(ReadError::Bus)?;
        let level = usize::from(level);
        if level > FIFO_WORDS {
            return Err(ReadError::StuckHigh);
        }
        let mut count: usize = 0;
        for slot in out.iter_mut().take(level) {
            let bytes = self.burst(Register::FifoDataOutTag);
            *slot = FifoWord::from_bytes(bytes.map_err(ReadError::Bus)?);
            count = count.saturating_add(1);
        }
        Ok(FifoRead {
            count,
            left: level.saturating_sub(count),
            overrun,
        })
    }

    /// Unread words, 0 to 1023 as the two registers can have it, and whether some were lost.
    pub(super) fn fifo_level(&mut self) -> Result<(u16, bool), SPI::Error> {
        let [low, high] = self.burst(Register::FifoStatus1)?;
        let level = u16::from_le_bytes([low, high & FIFO_LEVEL_HIGH]);
        Ok((level, high & FIFO_OVERRUN != 0))
    }
}
