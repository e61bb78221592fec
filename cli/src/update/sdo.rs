//! An SDO client: numbers up and down, and a block download (CiA 301, 7.2.4).
//!
//! In: requests for one node. Out: its answers, or why there are none. A request that may come
//! twice is sent again when no answer comes: a node that erases a page loses what does not fit into
//! its receiver meanwhile. What was lost of a block is sent again from where the node has it.
//!
//! Left out: uploads of more than four bytes, segments.

use std::time::{Duration, Instant};

use canopen::crc;

use super::bus::Bus;
use super::error::UpdateError;

/// How long an answer may take: a program's signature is checked in half a second.
const PATIENCE: Duration = Duration::from_secs(3);

/// How long an answer may take that needs no work.
const SOON: Duration = Duration::from_millis(500);

/// How often a request that may come twice is sent.
const ATTEMPTS: usize = 6;

/// So long nobody may answer before a client counts as gone.
const SILENCE: Duration = Duration::from_millis(200);

/// The abort code of a transfer that nobody goes on with.
const TIMED_OUT: u32 = 0x0504_0000;

/// Blocks of which nothing arrives before the transfer is given up.
const TRIES: u32 = 5;

/// The command of an abort.
const ABORT: u8 = 0x80;

/// The command of the answer that a request wants: these bits of it, and their value.
#[derive(Clone, Copy, Debug)]
struct Wanted(u8, u8);

impl Wanted {
    const UPLOAD: Self = Self(0xE0, 0x40);
    const DOWNLOAD: Self = Self(0xFF, 0x60);
    const BLOCKS: Self = Self(0xE3, 0xA0);

    /// Whether this answers the request, be it by a refusal.
    fn fits(self, request: &[u8; 8], bytes: &[u8; 8]) -> bool {
        let known = bytes[0] == ABORT || bytes[0] & self.0 == self.1;
        known && bytes[1..4] == request[1..4]
    }
}

/// A download of up to four bytes.
const fn expedited(index: u16, sub: u8, value: u32, length: u8) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    let [a, b, c, d] = value.to_le_bytes();
    [0x23 | (4 - length) << 2, low, high, sub, a, b, c, d]
}

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
        self.bus.send(id, &bytes).map_err(UpdateError::lost)
    }

    /// The next answer that belongs to what was asked, until then; others are late ones.
    fn answer(
        &mut self,
        patience: Duration,
        fits: impl Fn(&[u8; 8]) -> bool,
    ) -> Result<[u8; 8], UpdateError> {
        let until = Instant::now() + patience;
        let id = 0x580 + u16::from(self.node);
        while let Some(frame) = self.bus.receive(until).map_err(UpdateError::lost)? {
            if frame.cob_id() == Some(id)
                && let Ok(bytes) = frame.bytes().try_into()
                && fits(&bytes)
            {
                return self.judge(bytes);
            }
        }
        Err(UpdateError::Silent(self.node))
    }

    /// The answer to a request that may come twice: `wanted` or a refusal, of the same address.
    fn ask(&mut self, request: [u8; 8], wanted: Wanted) -> Result<[u8; 8], UpdateError> {
        let fits = |bytes: &[u8; 8]| wanted.fits(&request, bytes);
        for late in 0..ATTEMPTS {
            self.send(request)?;
            match self.answer(SOON, fits) {
                Err(UpdateError::Silent(_)) => {}
                answer => {
                    // Those to the requests before must not be taken for that to a later one.
                    for _ in 0..late {
                        if let Err(UpdateError::Silent(_)) = self.answer(SILENCE, fits) {
                            break;
                        }
                    }
                    return answer;
                }
            }
        }
        Err(UpdateError::Silent(self.node))
    }

    fn judge(&self, bytes: [u8; 8]) -> Result<[u8; 8], UpdateError> {
        let [command, low, high, sub, code @ ..] = bytes;
        match command {
            ABORT => Err(UpdateError::Refused(
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
        let [a, b, c, d] = TIMED_OUT.to_le_bytes();
        let id = 0x580 + u16::from(self.node);
        let until = Instant::now() + PATIENCE;
        let mut silence = Instant::now() + SILENCE;
        self.send([ABORT, low, high, 1, a, b, c, d])?;
        while let Some(frame) = self.bus.receive(silence).map_err(UpdateError::lost)? {
            if Instant::now() > until {
                return Err(UpdateError::Transfer(self.node));
            }
            if frame.cob_id() == Some(id) {
                self.send([ABORT, low, high, 1, a, b, c, d])?;
                silence = Instant::now() + SILENCE;
            }
        }
        Ok(())
    }

    /// The number at an address, of four bytes at most.
    pub fn read(&mut self, index: u16, sub: u8) -> Result<u32, UpdateError> {
        let [low, high] = index.to_le_bytes();
        let request = [0x40, low, high, sub, 0, 0, 0, 0];
        let [command, _, _, _, data @ ..] = self.ask(request, Wanted::UPLOAD)?;
        if command & 0xE3 != 0x43 {
            return Err(UpdateError::Transfer(self.node));
        }
        let unused = u32::from(command >> 2 & 3);
        Ok(u32::from_le_bytes(data) << (8 * unused) >> (8 * unused))
    }

    /// Writes a number of `length` bytes, 1 to 4, which may be done twice.
    pub fn write(
        &mut self,
        index: u16,
        sub: u8,
        value: u32,
        length: u8,
    ) -> Result<(), UpdateError> {
        let request = expedited(index, sub, value, length);
        self.ask(request, Wanted::DOWNLOAD).map(drop)
    }

    /// Writes a byte that is a command: asked for once only, and the answer may take its time.
    pub fn command(&mut self, index: u16, sub: u8, value: u8) -> Result<(), UpdateError> {
        let request = expedited(index, sub, u32::from(value), 1);
        self.send(request)?;
        let fits = |bytes: &[u8; 8]| Wanted::DOWNLOAD.fits(&request, bytes);
        self.answer(PATIENCE, fits).map(drop)
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
        let request = [0xC6, low, high, sub, a, b, c, d];
        self.send(request)?;
        let fits = |bytes: &[u8; 8]| Wanted::BLOCKS.fits(&request, bytes);
        let [_, _, _, _, mut block, ..] = self.answer(PATIENCE, fits)?;
        let (mut done, mut tries) = (0, 0);
        while done < bytes.len() {
            let arrived;
            (arrived, block) = self.block((index, sub), &bytes[done..], block)?;
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
        self.answer_to_blocks((index, sub), 0xA1).map(drop)
    }

    /// The answer within a block download to this address, with this command.
    fn answer_to_blocks(&mut self, at: (u16, u8), command: u8) -> Result<[u8; 8], UpdateError> {
        let fits = |bytes: &[u8; 8]| bytes[0] == command || bytes[0] == ABORT;
        match self.answer(PATIENCE, fits) {
            // The node does not know of this transfer any more: who did that was not this client.
            Err(UpdateError::Refused(node, index, sub, code))
                if (index, sub) != at || (0x0504_0001..=0x0504_0003).contains(&code) =>
            {
                Err(UpdateError::Taken(node))
            }
            answer => answer,
        }
    }

    /// One block of at most `block` segments: how many have arrived, and how many the next one may
    /// have.
    fn block(&mut self, at: (u16, u8), rest: &[u8], block: u8) -> Result<(usize, u8), UpdateError> {
        let pieces: Vec<_> = rest.chunks(7).take(usize::from(block)).collect();
        let is_end = 7 * pieces.len() >= rest.len();
        for (number, piece) in (1_u8..).zip(&pieces) {
            let mut segment = [0; 8];
            let last = is_end && usize::from(number) == pieces.len();
            segment[0] = number | if last { 0x80 } else { 0 };
            segment[1..=piece.len()].copy_from_slice(piece);
            self.send(segment)?;
        }
        let [_, arrived, next, ..] = self.answer_to_blocks(at, 0xA2)?;
        let legal = usize::from(arrived) <= pieces.len();
        if !legal || !(1..=127).contains(&next) {
            return Err(UpdateError::Transfer(self.node));
        }
        Ok((usize::from(arrived), next))
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader, Write};
    use std::net::TcpListener;
    use std::thread::{JoinHandle, spawn};

    use super::*;

    /// A bus whose other end says to each request what `answers` has for it, as words of
    /// socketcand; it returns the number of requests.
    fn bus(answers: &'static [&'static str]) -> (Bus, JoinHandle<usize>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let at = listener.local_addr().unwrap().to_string();
        let server = spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let words = BufReader::new(stream.try_clone().unwrap()).split(b'>');
            stream.write_all(b"< hi >").unwrap();
            let (mut requests, mut answers) = (0, answers.iter());
            for word in words.map_while(Result::ok) {
                let answer = match String::from_utf8_lossy(&word).contains("send") {
                    true => *answers.next().unwrap_or(&""),
                    false => "< ok >",
                };
                requests += usize::from(answer != "< ok >");
                stream.write_all(answer.as_bytes()).unwrap();
            }
            requests
        });
        (Bus::join(&at).unwrap(), server)
    }

    #[test]
    fn a_lost_poll_ended_an_update() {
        let (mut bus, server) = bus(&["", "", "< frame 581 1.0 43571F0101000000 >"]);
        assert_eq!(Client::new(&mut bus, 1).read(0x1F57, 1).unwrap(), 1);
        drop(bus);
        assert_eq!(server.join().unwrap(), 3);
    }

    #[test]
    fn a_late_answer_was_taken_for_another_one() {
        let (mut bus, server) = bus(&[
            "",
            // Both answers come, the second one later, behind one to nobody's request.
            "< frame 581 1.0 43571F0101000000 >< frame 581 1.0 4380200207000000 >\
             < frame 581 1.0 43571F0101000000 >",
            "< frame 581 1.0 43571F0102000000 >",
            "< frame 581 1.0 601F510100000000 >< frame 581 1.0 60511F0100000000 >",
        ]);
        let mut client = Client::new(&mut bus, 1);
        assert_eq!(client.read(0x1F57, 1).unwrap(), 1);
        assert_eq!(client.read(0x1F57, 1).unwrap(), 2);
        client.command(0x1F51, 1, 3).unwrap();
        drop(bus);
        assert_eq!(server.join().unwrap(), 4);
    }

    #[test]
    fn a_command_is_not_asked_twice() {
        let (mut bus, server) = bus(&[]);
        let silent = Client::new(&mut bus, 1).command(0x1F51, 1, 1);
        assert!(matches!(silent, Err(UpdateError::Silent(1))));
        drop(bus);
        assert_eq!(server.join().unwrap(), 1);
    }
}
