//! Segments of a normal transfer, seven bytes each with a toggle bit (CiA 301, "SDO download
//! segment" and "SDO upload segment").
//!
//! In: segments, or requests for them. Out: the acknowledgement, or the segment.
//!
//! Left out: the first request, which `server.rs` answers.

use crate::object::{Abort, Objects};

use super::server::{Phase, Server};

const TOGGLE: u8 = 0x10;
/// No more segments follow.
const LAST: u8 = 0x01;
/// Bytes in a segment.
pub(super) const SEGMENT: u32 = 7;

/// Command byte and seven bytes of a segment.
pub(super) fn segment(command: u8, data: [u8; 7]) -> [u8; 8] {
    let [a, b, c, d, e, f, g] = data;
    [command, a, b, c, d, e, f, g]
}

impl Server {
    /// The toggle bit starts at 0 and changes with every segment.
    fn turn(&mut self, command: u8) -> Result<u8, Abort> {
        let toggle = command & TOGGLE;
        if toggle != self.toggle {
            return Err(Abort::ToggleBit);
        }
        self.toggle = toggle ^ TOGGLE;
        Ok(toggle)
    }

    /// Takes a segment. Any of them may be partly filled, the last one may be empty.
    pub(super) fn download_segment<O: Objects>(
        &mut self,
        objects: &mut O,
        command: u8,
        data: [u8; 7],
    ) -> Result<(), Abort> {
        self.must_be_in(Phase::Download)?;
        let toggle = self.turn(command)?;
        let used = data.len() - usize::from(command >> 1 & 7);
        self.content
            .append(objects, data.get(..used).unwrap_or(&[]))?;
        if command & LAST != 0 {
            self.content.commit(objects)?;
            self.close();
        }
        self.response = Some(segment(0x20 | toggle, [0; 7]));
        Ok(())
    }

    /// Sends the next segment. An object without bytes is one empty segment.
    pub(super) fn upload_segment<O: Objects>(
        &mut self,
        objects: &mut O,
        command: u8,
    ) -> Result<(), Abort> {
        self.must_be_in(Phase::Upload)?;
        let toggle = self.turn(command)?;
        let mut data = [0; 7];
        let count = self.content.read(objects, self.content.done(), &mut data)?;
        self.content.advance(count as u32);
        let last = self.content.done() == self.content.size();
        let unused = SEGMENT as u8 - count as u8;
        self.response = Some(segment(toggle | unused << 1 | u8::from(last), data));
        if last {
            self.close();
        }
        Ok(())
    }
}
