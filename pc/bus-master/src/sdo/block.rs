//! Blocks of up to 127 segments with one answer, and a check sum (CiA 301, 7.2.4.3.8 to 16).

use std::time::{Duration, Instant};

use canopen::crc;

use super::segmented::LONGEST;
use super::{ABORT, At, Client, PATIENCE, SOON, SdoError, TIMED_OUT, Wanted};
use crate::BusEnd;

/// Blocks of which nothing arrives before the transfer is given up.
const TRIES: u32 = 5;

/// The abort code of a wrong check sum.
const CHECK_SUM: u32 = 0x0504_0004;

/// Segments of a block that is uploaded.
const BLOCK: u8 = 127;

/// How long a block may take: five times what it does at 10 kbit/s.
const LONGEST_BLOCK: Duration = Duration::from_secs(10);

/// A block as it has come.
struct Block {
    content: Vec<u8>,
    /// Segments in their order without a gap.
    arrived: u8,
    is_last: bool,
}

impl Client<'_> {
    /// Downloads `bytes` in blocks; `sent` is told how many more have arrived.
    ///
    /// Errors: see [`SdoError`].
    pub fn download_blocks(
        &mut self,
        index: u16,
        sub: u8,
        bytes: &[u8],
        sent: impl FnMut(u64),
    ) -> Result<(), SdoError> {
        let at = At { index, sub };
        self.several(at, |client| client.send_blocks(at, bytes, sent))
    }

    /// All blocks of a download, and their end.
    fn send_blocks(
        &mut self,
        at: At,
        bytes: &[u8],
        mut sent: impl FnMut(u64),
    ) -> Result<(), SdoError> {
        let request = at.request(0xC6, bytes.len() as u32);
        let [_, _, _, _, mut block, ..] = self.begin_download(request, Wanted::BLOCKS)?;
        let (mut done, mut tries) = (0, 0);
        while done < bytes.len() {
            let arrived;
            (arrived, block) = self.send_block(at, &bytes[done..], block)?;
            let arrived = (7 * arrived).min(bytes.len() - done);
            tries = if arrived == 0 { tries + 1 } else { 0 };
            if tries == TRIES {
                return self.out_of_step(at, TIMED_OUT, "nothing arrives");
            }
            done += arrived;
            sent(arrived as u64);
        }
        let unused = (7 - bytes.len() % 7) % 7;
        let [sum_low, sum_high] = crc::update(0, bytes).to_le_bytes();
        self.send([0xC1 | (unused as u8) << 2, sum_low, sum_high, 0, 0, 0, 0, 0])?;
        self.taken(at, |client| {
            client.next(at, PATIENCE, |bytes| bytes[0] == 0xA1)
        })
    }

    /// One block of at most `block` segments: how many have arrived, and how many the next one may
    /// have.
    fn send_block(&mut self, at: At, rest: &[u8], block: u8) -> Result<(usize, u8), SdoError> {
        let pieces: Vec<_> = rest.chunks(7).take(usize::from(block)).collect();
        let is_end = 7 * pieces.len() >= rest.len();
        for (number, piece) in (1_u8..).zip(&pieces) {
            let mut segment = [0; 8];
            let last = is_end && usize::from(number) == pieces.len();
            segment[0] = number | if last { 0x80 } else { 0 };
            segment[1..=piece.len()].copy_from_slice(piece);
            self.send(segment)?;
        }
        let [_, arrived, next, ..] = self.next(at, PATIENCE, |bytes| bytes[0] == 0xA2)?;
        let legal = usize::from(arrived) <= pieces.len();
        if !legal || !(1..=127).contains(&next) {
            return self.out_of_step(at, TIMED_OUT, "its count of segments is wrong");
        }
        Ok((usize::from(arrived), next))
    }

    /// A whole upload in blocks.
    pub(super) fn upload_blocks(&mut self, at: At) -> Result<Vec<u8>, SdoError> {
        let request = at.request(0xA4, u32::from(BLOCK));
        let begun = self.ask(request, Wanted::BLOCKS_UP)?;
        let [command, _, _, _, size @ ..] = begun;
        let size = (command & 2 != 0).then(|| u32::from_le_bytes(size) as usize);
        self.send([0xA3, 0, 0, 0, 0, 0, 0, 0])?;
        let (mut content, mut tries) = (Vec::new(), 0);
        loop {
            let block = self.receive_block()?;
            tries = if block.arrived == 0 { tries + 1 } else { 0 };
            content.extend_from_slice(&block.content);
            // The last segment is padded to seven bytes.
            let most = size.map_or(LONGEST, |size| size.saturating_add(6));
            if tries == TRIES || content.len() > most {
                return self.out_of_step(at, TIMED_OUT, "its blocks do not end");
            }
            self.send([0xA2, block.arrived, BLOCK, 0, 0, 0, 0, 0])?;
            if block.is_last {
                break;
            }
        }
        let is_end = |bytes: &[u8; 8]| bytes[0] & 0xE3 == 0xC1;
        let [end, low, high, ..] = self.next(at, SOON, is_end)?;
        content.truncate(content.len().saturating_sub(usize::from(end >> 2 & 7)));
        let has_sum = command & 4 != 0;
        if has_sum && crc::update(0, &content) != u16::from_le_bytes([low, high]) {
            return self.out_of_step(at, CHECK_SUM, "the check sum is wrong");
        }
        if size.is_some_and(|size| size != content.len()) {
            return self.out_of_step(at, CHECK_SUM, "the length is wrong");
        }
        self.send([0xA1, 0, 0, 0, 0, 0, 0, 0])?;
        Ok(content)
    }

    /// One block, as far as it comes.
    fn receive_block(&mut self) -> Result<Block, SdoError> {
        let mut block = Block {
            content: Vec::new(),
            arrived: 0,
            is_last: false,
        };
        let id = 0x580 + u16::from(self.node);
        // A node that sends anything for ever is not waited for.
        let end = Instant::now() + LONGEST_BLOCK;
        let mut until = Instant::now() + SOON;
        while let Some(received) = self.bus.receive(until).map_err(BusEnd::from)? {
            let bytes = <[u8; 8]>::try_from(received.frame.bytes());
            let (Some(found), Ok(bytes)) = (received.frame.cob_id(), bytes) else {
                continue;
            };
            if found != id {
                continue;
            }
            if bytes[0] == ABORT {
                return self.judge(bytes).map(|_| block);
            }
            until = end.min(Instant::now() + SOON);
            let (number, last) = (bytes[0] & 0x7F, bytes[0] & 0x80 != 0);
            if number == block.arrived + 1 {
                block.content.extend_from_slice(&bytes[1..]);
                block.arrived = number;
                block.is_last = last;
            }
            if last || number == BLOCK {
                break;
            }
        }
        Ok(block)
    }
}
