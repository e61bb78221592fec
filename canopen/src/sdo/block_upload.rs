//! Block upload: up to 127 segments per acknowledgement (CiA 301, "SDO block upload").
//!
//! In: block sizes and acknowledgements, any of which may ask for a part again, any number of
//! times. Out: segments, made one by one when the bus has room, and the check sum over the whole.
//!
//! Left out: block sizes above 127, which the standard does not have.

use crate::crc;
use crate::object::{Abort, Objects};

use super::segmented::{SEGMENT, segment};
use super::server::{Phase, Server};

/// No more segments follow.
const LAST: u8 = 0x80;
/// Block transfer with check sum.
const CRC: u8 = 0x04;
const SIZE_INDICATED: u8 = 0x02;

/// What is known of a block upload beside its content.
#[derive(Clone, Debug)]
pub(super) struct Outgoing {
    /// Segments in this block, 1 to 127.
    block: u8,
    /// Segments of this block that have been sent.
    sequence: u8,
    /// The client checks the sum at the end.
    with_crc: bool,
    crc: u16,
    /// Bytes in the sum; what is sent again counts once.
    summed: u32,
}

impl Outgoing {
    /// Before the first segment.
    pub const NEW: Self = Self {
        block: 0,
        sequence: 0,
        with_crc: false,
        crc: 0,
        summed: 0,
    };
}

impl Server {
    /// The first request. A client that allows it gets a short object by a normal upload.
    pub(super) fn block_upload<O: Objects>(
        &mut self,
        objects: &mut O,
        data: [u8; 8],
    ) -> Result<(), Abort> {
        let [command, ..] = data;
        let [block, threshold, ..] = self.begin(objects, data);
        self.content.open(objects)?;
        self.outgoing = Outgoing {
            with_crc: command & CRC != 0,
            ..Outgoing::NEW
        };
        self.next_block(block)?;
        let size = self.content.size();
        if threshold > 0 && size <= u32::from(threshold) {
            return self.answer_upload(objects);
        }
        self.phase = Phase::BlockUpload;
        self.respond(0xC0 | CRC | SIZE_INDICATED, size);
        Ok(())
    }

    fn next_block(&mut self, block: u8) -> Result<(), Abort> {
        if !(1..=127).contains(&block) {
            return Err(Abort::InvalidBlockSize);
        }
        self.outgoing.block = block;
        self.outgoing.sequence = 0;
        Ok(())
    }

    /// The client is ready for the segments.
    pub(super) fn start_block_upload(&mut self) -> Result<(), Abort> {
        self.must_be_in(Phase::BlockUpload)?;
        self.phase = Phase::BlockUploadSending;
        Ok(())
    }

    /// The next segment of the block.
    pub(super) fn upload_block_segment<O: Objects>(
        &mut self,
        objects: &mut O,
    ) -> Result<[u8; 8], Abort> {
        let sent = SEGMENT * u32::from(self.outgoing.sequence);
        let offset = self.content.done().saturating_add(sent);
        let mut data = [0; 7];
        let count = self.content.read(objects, offset, &mut data)?;
        if offset == self.outgoing.summed {
            let bytes = data.get(..count).unwrap_or(&[]);
            self.outgoing.crc = crc::update(self.outgoing.crc, bytes);
            self.outgoing.summed = offset.saturating_add(count as u32);
        }
        self.outgoing.sequence = self.outgoing.sequence.saturating_add(1);
        let last = self.content.size().saturating_sub(offset) <= SEGMENT;
        if last || self.outgoing.sequence >= self.outgoing.block {
            self.phase = Phase::BlockUploadWaiting;
        }
        let flag = if last { LAST } else { 0 };
        Ok(segment(self.outgoing.sequence | flag, data))
    }

    /// The client has the first segments of the block, all or some; the next block starts behind
    /// them, with the size that the client now asks for. It need not wait for the whole block.
    pub(super) fn acknowledge_block(&mut self, data: [u8; 7]) -> Result<(), Abort> {
        let [acknowledged, block, ..] = data;
        let sending = self.phase == Phase::BlockUploadSending;
        if sending && self.outgoing.sequence == 0 {
            // Nothing has gone out since the last acknowledgement: this is the same one again.
            return Ok(());
        }
        if !sending {
            self.must_be_in(Phase::BlockUploadWaiting)?;
        }
        if acknowledged > self.outgoing.sequence {
            return Err(Abort::InvalidSequence);
        }
        self.content.advance(SEGMENT * u32::from(acknowledged));
        if acknowledged > 0 && self.content.done() == self.content.size() {
            return self.announce_end();
        }
        self.next_block(block)?;
        self.phase = Phase::BlockUploadSending;
        Ok(())
    }

    /// Tells how many bytes of the last segment do not count, and the check sum.
    fn announce_end(&mut self) -> Result<(), Abort> {
        let size = self.content.size();
        // 0 for a full last segment, 7 for the only segment of an object without bytes.
        let unused = match size % SEGMENT {
            0 if size > 0 => 0,
            used => (SEGMENT - used) as u8,
        };
        let crc = if self.outgoing.with_crc {
            self.outgoing.crc
        } else {
            0
        };
        let [low, high] = crc.to_le_bytes();
        self.response = Some([0xC1 | unused << 2, low, high, 0, 0, 0, 0, 0]);
        self.phase = Phase::BlockUploadEnd;
        Ok(())
    }

    /// The client is content. Nothing is sent.
    pub(super) fn end_block_upload(&mut self) -> Result<(), Abort> {
        self.must_be_in(Phase::BlockUploadEnd)?;
        self.close();
        Ok(())
    }
}
