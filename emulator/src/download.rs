//! A long value for an object of an emulated node: SDO block download, from the host of a pair.
//!
//! In: node, object, bytes. Out: nothing, or why not. Source: CiA 301 7.2.4.3.9 to 7.2.4.3.12.
//! Left out: the check sum over the transfer, which is the client's to ask for, and a repetition
//! of segments that got lost: nothing disturbs this bus.

use canopen::Frame;

use crate::pair::{Pair, SdoError};

/// How long a node may take to answer, ms: it stands still for each page that it erases.
const PATIENCE_MS: u32 = 1000;

impl Pair {
    /// Downloads `bytes` to an object of `node` in blocks.
    ///
    /// Errors: see [`SdoError`].
    pub fn download(
        &mut self,
        node: u8,
        (index, sub): (u16, u8),
        bytes: &[u8],
    ) -> Result<(), SdoError> {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = (bytes.len() as u32).to_le_bytes();
        let begun = self.call(node, &[[0xC2, low, high, sub, a, b, c, d]])?;
        let [0xA0 | 0xA4, _, _, _, mut block, ..] = begun else {
            return Err(SdoError::Form(begun[0]));
        };
        let mut rest = bytes;
        while !rest.is_empty() {
            let (now, later) = rest.split_at(rest.len().min(7 * usize::from(block.max(1))));
            let pieces = now.chunks(7).zip(1_u8..);
            let segments: Vec<_> = pieces
                .map(|(piece, number)| {
                    let is_last = later.is_empty() && 7 * usize::from(number) >= now.len();
                    let mut segment = [0; 8];
                    segment[0] = number | u8::from(is_last) << 7;
                    segment[1..=piece.len()].copy_from_slice(piece);
                    segment
                })
                .collect();
            let [command, arrived, next, ..] = self.call(node, &segments)?;
            if command != 0xA2 || usize::from(arrived) != segments.len() {
                return Err(SdoError::Form(command));
            }
            (rest, block) = (later, next);
        }
        let unused = (7 - bytes.len() % 7) % 7;
        match self.call(node, &[[0xC1 | (unused as u8) << 2, 0, 0, 0, 0, 0, 0, 0]])? {
            [0xA1, ..] => Ok(()),
            [command, ..] => Err(SdoError::Form(command)),
        }
    }

    /// Sends frames to a node's server and waits for one answer.
    fn call(&mut self, node: u8, requests: &[[u8; 8]]) -> Result<[u8; 8], SdoError> {
        let answers = Some(0x580 + u16::from(node));
        let mut looked = self.heard.len();
        for request in requests {
            let frame = Frame::data_frame(0x600 + u16::from(node), request);
            while self.send(frame).is_err() {
                self.run(0.001);
            }
        }
        for _ in 0..PATIENCE_MS {
            self.run(0.001);
            let mut heard = self.heard[looked..].iter();
            if let Some(answer) = heard.find(|heard| heard.frame.cob_id() == answers) {
                let answer = answer.frame.padded();
                let [command, _, _, _, code @ ..] = answer;
                return match command {
                    0x80 => Err(SdoError::Abort(u32::from_le_bytes(code))),
                    _ => Ok(answer),
                };
            }
            looked = self.heard.len();
        }
        Err(SdoError::Silent)
    }
}
