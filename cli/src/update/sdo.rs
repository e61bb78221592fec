//! An SDO client: numbers up and down, and a block download (CiA 301, 7.2.4).
//!
//! In: requests for one node. Out: its answers, or why there are none. What was lost of a block is
//! sent again from where the node has it.
//!
//! Left out: uploads of more than four bytes, segments.

use std::time::{Duration, Instant};

use canopen::crc;

use super::bus::Bus;
use super::error::UpdateError;

/// How long an answer may take: a program's signature is checked in half a second.
const PATIENCE: Duration = Duration::from_secs(3);

/// So long nobody may answer before a client counts as gone.
const SILENCE: Duration = Duration::from_millis(200);

/// The abort code for no particular reason.
const GENERAL: u32 = 0x0800_0000;

/// Blocks of which nothing arrives before the transfer is given up.
const TRIES: u32 = 5;

/// The node asked, by way of the bus.
pub struct Client<'a> {
    bus: &'a mut Bus,
    node: u8,
}

impl<'a> Client<'a> {
    /// Asks this node.
    pub fn new(bus: &'a mut Bus, node: u8) -> Self {
        Self { bus, node }
    }

    fn send(&mut self, bytes: [u8; 8]) -> Result<(), UpdateError> {
        let id = 0x600 + u16::from(self.node);
        self.bus.send(id, &bytes).map_err(UpdateError::Lost)
    }

    /// The next answer.
    fn answer(&mut self) -> Result<[u8; 8], UpdateError> {
        let until = Instant::now() + PATIENCE;
        let id = 0x580 + u16::from(self.node);
        while let Some(frame) = self.bus.receive(until).map_err(UpdateError::Lost)? {
            if frame.cob_id() == Some(id)
                && let Ok(bytes) = frame.bytes().try_into()
            {
                return self.judge(bytes);
            }
        }
        Err(UpdateError::Silent(self.node))
    }

    fn judge(&self, bytes: [u8; 8]) -> Result<[u8; 8], UpdateError> {
        let [command, low, high, sub, code @ ..] = bytes;
        match command {
            0x80 => Err(UpdateError::Refused(
                self.node,
                u16::from_le_bytes([low, high]),
                sub,
                u32::from_le_bytes(code),
            )),
            _ => Ok(bytes),
        }
    }

    /// Gives up whatever transfer another client has begun and left, and waits until nobody
    /// answers to that any more: what it has sent may still be on its way.
    pub fn give_up(&mut self) -> Result<(), UpdateError> {
        let [low, high] = 0x1F50_u16.to_le_bytes();
        let [a, b, c, d] = GENERAL.to_le_bytes();
        let id = 0x580 + u16::from(self.node);
        let until = Instant::now() + PATIENCE;
        let mut silence = Instant::now() + SILENCE;
        self.send([0x80, low, high, 1, a, b, c, d])?;
        while let Some(frame) = self.bus.receive(silence).map_err(UpdateError::Lost)? {
            if Instant::now() > until {
                return Err(UpdateError::Transfer(self.node));
            }
            if frame.cob_id() == Some(id) {
                self.send([0x80, low, high, 1, a, b, c, d])?;
                silence = Instant::now() + SILENCE;
            }
        }
        Ok(())
    }

    /// The number at an address, of four bytes at most.
    pub fn read(&mut self, index: u16, sub: u8) -> Result<u32, UpdateError> {
        let [low, high] = index.to_le_bytes();
        self.send([0x40, low, high, sub, 0, 0, 0, 0])?;
        let [command, _, _, _, data @ ..] = self.answer()?;
        if command & 0xE3 != 0x43 {
            return Err(UpdateError::Transfer(self.node));
        }
        let unused = u32::from(command >> 2 & 3);
        Ok(u32::from_le_bytes(data) << (8 * unused) >> (8 * unused))
    }

    /// Writes a number of `length` bytes, 1 to 4.
    pub fn write(
        &mut self,
        index: u16,
        sub: u8,
        value: u32,
        length: u8,
    ) -> Result<(), UpdateError> {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = value.to_le_bytes();
        let command = 0x23 | (4 - length) << 2;
        self.send([command, low, high, sub, a, b, c, d])?;
        self.answer().map(drop)
    }

    /// Downloads `bytes` in blocks; `sent` is told how many more have arrived.
    pub fn download(
        &mut self,
        index: u16,
        sub: u8,
        bytes: &[u8],
        mut sent: impl FnMut(u64),
    ) -> Result<(), UpdateError> {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = (bytes.len() as u32).to_le_bytes();
        self.send([0xC6, low, high, sub, a, b, c, d])?;
        let [_, _, _, _, mut block, ..] = self.answer()?;
        let (mut done, mut tries) = (0, 0);
        while done < bytes.len() {
            let arrived;
            (arrived, block) = self.block(&bytes[done..], block)?;
            let arrived = (7 * arrived).min(bytes.len() - done);
            tries = if arrived == 0 { tries + 1 } else { 0 };
            if tries == TRIES {
                return Err(UpdateError::Transfer(self.node));
            }
            done += arrived;
            sent(arrived as u64);
        }
        let unused = (7 - bytes.len() % 7) % 7;
        let [sum_low, sum_high] = crc::update(0, bytes).to_le_bytes();
        self.send([0xC1 | (unused as u8) << 2, sum_low, sum_high, 0, 0, 0, 0, 0])?;
        self.answer().map(drop)
    }

    /// One block of at most `block` segments: how many have arrived, and how many the next one may
    /// have.
    fn block(&mut self, rest: &[u8], block: u8) -> Result<(usize, u8), UpdateError> {
        let pieces: Vec<_> = rest.chunks(7).take(usize::from(block)).collect();
        let is_end = 7 * pieces.len() >= rest.len();
        for (number, piece) in (1_u8..).zip(&pieces) {
            let mut segment = [0; 8];
            let last = is_end && usize::from(number) == pieces.len();
            segment[0] = number | if last { 0x80 } else { 0 };
            segment[1..=piece.len()].copy_from_slice(piece);
            self.send(segment)?;
        }
        let [command, arrived, next, ..] = self.answer()?;
        let legal = command & 0xE3 == 0xA2 && usize::from(arrived) <= pieces.len();
        if !legal || !(1..=127).contains(&next) {
            return Err(UpdateError::Transfer(self.node));
        }
        Ok((usize::from(arrived), next))
    }
}
