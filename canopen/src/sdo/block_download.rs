//! Block download: up to 127 segments per acknowledgement (CiA 301, "SDO block download").
//!
//! In: numbered segments, some of which may get lost. Out: after each block the number of the last
//! segment that came in order; the client goes on behind it. Which bytes of the last segment count
//! is known at the end only, so one segment is always held back.
//!
//! Left out: a shorter block than 127. Segments are taken as fast as they come.

use crate::crc;
use crate::object::{Abort, Objects};

use super::content::writable;
use super::segmented::segment;
use super::server::{Phase, Server};

/// Segments in a block, as many as the standard allows.
const BLOCK: u8 = 127;
/// No more segments follow.
const LAST: u8 = 0x80;
/// Block transfer with check sum.
const CRC: u8 = 0x04;
const SIZE_INDICATED: u8 = 0x02;

/// What is known of a block download beside its content.
#[derive(Clone, Debug)]
pub(super) struct Incoming {
    /// Number of the last segment of this block that came in order.
    sequence: u8,
    /// The frame of the last segment, if there was one.
    held: Option<[u8; 8]>,
    /// The client sends a check sum at the end.
    with_crc: bool,
    crc: u16,
    /// Why the transfer has failed. The abort waits for the end of the block: segments that are
    /// already on their way must not be taken for requests.
    failed: Option<Abort>,
}

impl Incoming {
    /// Before the first segment.
    pub const NEW: Self = Self {
        sequence: 0,
        held: None,
        with_crc: false,
        crc: 0,
        failed: None,
    };

    /// Back to before the first segment, field by field: a copy of [`Self::NEW`] would bring the
    /// library's memcpy along.
    fn begin(&mut self, crc_follows: bool) {
        let Self {
            sequence,
            held,
            with_crc,
            crc,
            failed,
        } = self;
        *sequence = 0;
        *held = None;
        *with_crc = crc_follows;
        *crc = 0;
        *failed = None;
    }
}

/// True for the command that ends a block download, whatever its number of unused bytes.
const fn is_end(command: u8) -> bool {
    command & 0xE3 == 0xC1
}

impl Server {
    /// The first request.
    pub(super) fn block_download<O: Objects>(
        &mut self,
        objects: &mut O,
        data: [u8; 8],
    ) -> Result<(), Abort> {
        let [command, ..] = data;
        let bytes = self.begin(objects, data);
        let entry = writable(objects, self.content.at())?;
        let size = (command & SIZE_INDICATED != 0).then(|| u32::from_le_bytes(bytes));
        self.content.create(objects, entry, size)?;
        self.incoming.begin(command & CRC != 0);
        self.phase = Phase::BlockDownload;
        self.respond(0xA0 | CRC, u32::from(BLOCK));
        Ok(())
    }

    /// A segment, in order or not.
    pub(super) fn download_block_segment<O: Objects>(
        &mut self,
        objects: &mut O,
        data: [u8; 8],
    ) -> Result<(), Abort> {
        if self.response.is_some() {
            // A client sends nothing before it has the answer: its last frame was received twice,
            // which happens on CAN when an error strikes the last bit of a frame.
            return Ok(());
        }
        let [command, ..] = data;
        if self.is_early_end(command) {
            return self.finish_block_download(objects, data);
        }
        let last = command & LAST != 0;
        let number = command & !LAST;
        if number == self.incoming.sequence + 1 {
            self.incoming.sequence = number;
            self.keep(objects, data);
            if last {
                self.phase = Phase::BlockDownloadEnd;
            }
        } else if self.incoming.held == Some(data) {
            // Received twice, and the block that it ended has been acknowledged.
            return Ok(());
        }
        if last || number == BLOCK {
            self.acknowledge_segments()?;
        }
        Ok(())
    }

    /// True for the very last segment when it is received twice. One that could as well be the
    /// end is taken for the end; the check sum tells them apart.
    pub(super) fn is_repeated_segment(&self, data: [u8; 8]) -> bool {
        let [command, ..] = data;
        let complete = self.phase == Phase::BlockDownloadEnd;
        complete && self.incoming.held == Some(data) && !is_end(command)
    }

    /// A client with nothing to send may end at once, without an empty segment.
    fn is_early_end(&self, command: u8) -> bool {
        let first = self.incoming.held.is_none();
        first && self.content.is_announced_empty() && is_end(command)
    }

    fn acknowledge_segments(&mut self) -> Result<(), Abort> {
        if let Some(reason) = self.incoming.failed {
            return Err(reason);
        }
        let sequence = core::mem::take(&mut self.incoming.sequence);
        self.response = Some([0xA2, sequence, BLOCK, 0, 0, 0, 0, 0]);
        Ok(())
    }

    /// Holds a segment back and passes on the one before it.
    fn keep<O: Objects>(&mut self, objects: &mut O, data: [u8; 8]) {
        if self.incoming.failed.is_none() {
            self.incoming.failed = self.pass_on(objects, 0).err();
        }
        self.incoming.held = Some(data);
    }

    fn pass_on<O: Objects>(&mut self, objects: &mut O, unused: usize) -> Result<(), Abort> {
        let Some([_, held @ ..]) = self.incoming.held else {
            return Ok(());
        };
        let used = held.len().saturating_sub(unused);
        let bytes = held.get(..used).unwrap_or(&[]);
        self.incoming.crc = crc::update(self.incoming.crc, bytes);
        self.content.append(objects, bytes)
    }

    /// The end, in its place.
    pub(super) fn end_block_download<O: Objects>(
        &mut self,
        objects: &mut O,
        data: [u8; 8],
    ) -> Result<(), Abort> {
        self.must_be_in(Phase::BlockDownloadEnd)?;
        self.finish_block_download(objects, data)
    }

    /// The object changes only when the check sum, the size and the value are right.
    fn finish_block_download<O: Objects>(
        &mut self,
        objects: &mut O,
        data: [u8; 8],
    ) -> Result<(), Abort> {
        let [command, low, high, ..] = data;
        self.pass_on(objects, usize::from(command >> 2 & 7))?;
        if self.incoming.with_crc && self.incoming.crc != u16::from_le_bytes([low, high]) {
            return Err(Abort::CrcError);
        }
        self.content.commit(objects)?;
        self.response = Some(segment(0xA1, [0; 7]));
        self.close();
        Ok(())
    }
}
