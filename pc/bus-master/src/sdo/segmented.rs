//! Segments of seven bytes, each answered (CiA 301, 7.2.4.3.4 and 7.2.4.3.7).

use super::{At, Client, PATIENCE, SOON, SdoError, Wanted};

/// More than any object of an instrument holds: an announced length is not believed beyond it.
pub const LONGEST: usize = 1 << 24;

/// The abort code of a toggle bit that did not alternate.
const TOGGLE: u32 = 0x0503_0000;

/// The abort code of content that is longer than was said.
const TOO_LONG: u32 = 0x0607_0012;

impl Client<'_> {
    /// What follows the answer that has begun an upload.
    pub(super) fn upload_segments(
        &mut self,
        at: At,
        size: Option<usize>,
    ) -> Result<Vec<u8>, SdoError> {
        let mut content = Vec::new();
        let mut toggle = 0;
        loop {
            self.send(At { index: 0, sub: 0 }.request(0x60 | toggle, 0))?;
            let [command, rest @ ..] = self.next(at, SOON, |bytes| bytes[0] & 0xE0 == 0)?;
            if command & 0x10 != toggle {
                return self.out_of_step(at, TOGGLE, "the toggle bit did not alternate");
            }
            content.extend_from_slice(&rest[..7 - usize::from(command >> 1 & 7)]);
            if content.len() > size.unwrap_or(LONGEST) {
                return self.out_of_step(at, TOO_LONG, "more came than was announced");
            }
            if command & 1 != 0 {
                break;
            }
            toggle ^= 0x10;
        }
        match size {
            Some(size) if size != content.len() => {
                let what = "less came than was announced";
                Err(SdoError::Step(self.node, at.index, at.sub, what))
            }
            _ => Ok(content),
        }
    }

    /// A whole download in segments.
    pub(super) fn download_segments(&mut self, at: At, bytes: &[u8]) -> Result<(), SdoError> {
        self.begin_download(at.request(0x21, bytes.len() as u32), Wanted::DOWNLOAD)?;
        // Nothing at all is one segment without content.
        let pieces: Vec<&[u8]> = match bytes {
            [] => vec![&[]],
            _ => bytes.chunks(7).collect(),
        };
        let last = pieces.len() - 1;
        for (number, piece) in pieces.iter().enumerate() {
            let toggle = if number % 2 == 0 { 0 } else { 0x10 };
            let unused = (7 - piece.len()) as u8;
            let mut segment = [0; 8];
            segment[0] = toggle | unused << 1 | u8::from(number == last);
            segment[1..=piece.len()].copy_from_slice(piece);
            self.send(segment)?;
            let answer = |client: &mut Self| client.segment_answered(at, toggle);
            match number == last {
                true => self.taken(at, answer)?,
                false => answer(self).map(drop)?,
            }
        }
        Ok(())
    }

    /// The answer to a segment that went down.
    fn segment_answered(&mut self, at: At, toggle: u8) -> Result<[u8; 8], SdoError> {
        let bytes = self.next(at, PATIENCE, |bytes| bytes[0] & 0xE0 == 0x20)?;
        match bytes[0] & 0x10 == toggle {
            true => Ok(bytes),
            false => self.out_of_step(at, TOGGLE, "the toggle bit did not alternate"),
        }
    }
}
