//! An SDO client: expedited, segmented and block transfer, both ways (CiA 301, 7.2.4).
//!
//! In: requests for one node. Out: its answers, or why there are none. A question is asked again
//! when no answer comes, the last time behind an abort of what another client may have left, and
//! answers that come late are not taken for those to later questions. A write is never sent again,
//! since the node may have taken it, unless the caller states that it may come twice; but the
//! request that begins a transfer of several frames writes nothing, and is sent again. What was
//! lost of a block is sent again from where the receiver has it. A user who interrupts a write
//! learns whether the node has taken it, and a transfer of several frames is aborted.
//!
//! Two clients on one node's channel disturb each other. What can be told is told: requests of
//! somebody else that pass on the bus while an answer is waited for.
//!
//! Left out: being asked, and SDO channels beyond the default one.

mod block;
mod error;
mod segmented;
#[cfg(test)]
mod tests;

use std::time::{Duration, Instant};

use canopen::Frame;

use super::{Bus, BusEnd};
pub use error::{SdoError, coded, meaning};

/// How long an answer may take: erases of flash stop a node for some tenths of a second, and one
/// with an older program checks the signature of a new one before it answers.
const PATIENCE: Duration = Duration::from_secs(3);

/// How long an answer may take that needs no work.
const SOON: Duration = Duration::from_millis(500);

/// How often a question is asked.
const ATTEMPTS: usize = 3;

/// How often it is asked of a node that may be at work: it is deaf while it erases a page.
const PATIENT_ATTEMPTS: usize = 6;

/// So long nobody may answer before a client counts as gone.
const SILENCE: Duration = Duration::from_millis(200);

/// The abort code of a transfer that nobody goes on with.
const TIMED_OUT: u32 = 0x0504_0000;

/// The abort code of a command that a server does not support.
const INVALID_COMMAND: u32 = 0x0504_0001;

/// Longer contents go in blocks, which take an eighth of the time.
const BLOCK_FROM: usize = 64;

/// The command of an abort.
const ABORT: u8 = 0x80;

/// The command of the answer that a request wants: these bits of it, and their value.
#[derive(Clone, Copy, Debug)]
struct Wanted(u8, u8);

impl Wanted {
    const UPLOAD: Self = Self(0xE0, 0x40);
    const DOWNLOAD: Self = Self(0xFF, 0x60);
    const BLOCKS: Self = Self(0xE3, 0xA0);
    const BLOCKS_UP: Self = Self(0xE1, 0xC0);

    /// Whether this answers the request, be it by a refusal.
    fn fits(self, request: &[u8; 8], bytes: &[u8; 8]) -> bool {
        let known = bytes[0] == ABORT || bytes[0] & self.0 == self.1;
        known && bytes[1..4] == request[1..4]
    }
}

/// The object that a transfer is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct At {
    index: u16,
    sub: u8,
}

impl At {
    /// A request about it: command, index, sub-index, and four more bytes.
    const fn request(self, command: u8, rest: u32) -> [u8; 8] {
        let [low, high] = self.index.to_le_bytes();
        let [a, b, c, d] = rest.to_le_bytes();
        [command, low, high, self.sub, a, b, c, d]
    }
}

/// The node asked, by way of the bus.
#[derive(Debug)]
pub struct Client<'a> {
    bus: &'a mut Bus,
    node: u8,
    attempts: usize,
    /// The address that somebody else has asked this node for meanwhile.
    other: Option<At>,
}

impl<'a> Client<'a> {
    /// Asks this node.
    pub fn new(bus: &'a mut Bus, node: u8) -> Self {
        Self {
            bus,
            node,
            attempts: ATTEMPTS,
            other: None,
        }
    }

    /// Asks a node that may be at work for seconds.
    pub fn patient(bus: &'a mut Bus, node: u8) -> Self {
        let attempts = PATIENT_ATTEMPTS;
        Self {
            attempts,
            ..Self::new(bus, node)
        }
    }

    /// All that the object holds.
    ///
    /// Errors: see [`SdoError`].
    pub fn upload(&mut self, index: u16, sub: u8) -> Result<Vec<u8>, SdoError> {
        let at = At { index, sub };
        let mut tries = 1;
        loop {
            match self.upload_once(at) {
                // In the middle of a transfer a question cannot be repeated, the whole of it can.
                Err(SdoError::Step(..)) if tries < self.attempts => {
                    tries += 1;
                    self.give_up(index, sub)?;
                }
                ended => return ended,
            }
        }
    }

    fn upload_once(&mut self, at: At) -> Result<Vec<u8>, SdoError> {
        let begun = self.ask(at.request(0x40, 0), Wanted::UPLOAD)?;
        let [command, _, _, _, content @ ..] = begun;
        let sized = command & 1 != 0;
        if command & 2 != 0 {
            let unused = if sized {
                usize::from(command >> 2 & 3)
            } else {
                0
            };
            return Ok(content[..4 - unused].to_vec());
        }
        let size = sized.then(|| u32::from_le_bytes(content) as usize);
        if size.is_some_and(|size| size <= BLOCK_FROM) {
            return self.upload_segments(at, size);
        }
        self.send(at.request(ABORT, TIMED_OUT))?;
        match self.upload_blocks(at) {
            Err(SdoError::Refused(.., INVALID_COMMAND)) => {
                self.ask(at.request(0x40, 0), Wanted::UPLOAD)?;
                self.upload_segments(at, size)
            }
            ended => ended,
        }
    }

    /// Writes the object, once: a write that was not answered is [`SdoError::Unanswered`], one that
    /// the user has interrupted [`SdoError::Behind`] or [`SdoError::Amid`].
    ///
    /// Errors: see [`SdoError`].
    pub fn download(&mut self, index: u16, sub: u8, bytes: &[u8]) -> Result<(), SdoError> {
        let at = At { index, sub };
        match bytes.len() {
            1..=4 => self.write_once(at, expedited(at, bytes)),
            ..=BLOCK_FROM => self.several(at, |client| client.download_segments(at, bytes)),
            _ => match self.download_blocks(index, sub, bytes, |_| {}) {
                Err(SdoError::Refused(.., INVALID_COMMAND)) => {
                    self.several(at, |client| client.download_segments(at, bytes))
                }
                ended => ended,
            },
        }
    }

    /// Writes up to four bytes that may come twice: sent again when no answer comes.
    ///
    /// Errors: see [`SdoError`].
    pub fn download_again(&mut self, index: u16, sub: u8, bytes: &[u8]) -> Result<(), SdoError> {
        let at = At { index, sub };
        self.ask(expedited(at, bytes), Wanted::DOWNLOAD).map(drop)
    }

    /// The number at an address, of four bytes at most, without a sign.
    ///
    /// Errors: see [`SdoError`].
    pub fn read_u32(&mut self, index: u16, sub: u8) -> Result<u32, SdoError> {
        let bytes = self.upload(index, sub)?;
        let mut number = [0; 4];
        let place = number.get_mut(..bytes.len()).filter(|p| !p.is_empty());
        let wrong = SdoError::Length(self.node, index, sub, bytes.len());
        place.ok_or(wrong)?.copy_from_slice(&bytes);
        Ok(u32::from_le_bytes(number))
    }

    /// Gives up whatever transfer another client has begun and left, and waits until nobody
    /// answers to that any more: what it has sent may still be on its way.
    ///
    /// Errors: see [`SdoError`].
    pub fn give_up(&mut self, index: u16, sub: u8) -> Result<(), SdoError> {
        let at = At { index, sub };
        let id = 0x580 + u16::from(self.node);
        let until = Instant::now() + PATIENCE;
        let mut silence = Instant::now() + SILENCE;
        self.send(at.request(ABORT, TIMED_OUT))?;
        while let Some(received) = self.bus.receive(silence).map_err(BusEnd::from)? {
            if Instant::now() > until {
                return Err(SdoError::Step(self.node, index, sub, "it does not end"));
            }
            if received.frame.cob_id() == Some(id) {
                self.send(at.request(ABORT, TIMED_OUT))?;
                silence = Instant::now() + SILENCE;
            }
        }
        Ok(())
    }

    fn send(&mut self, bytes: [u8; 8]) -> Result<(), SdoError> {
        let id = 0x600 + u16::from(self.node);
        let frame = Frame::data_frame(id, &bytes);
        Ok(self.bus.send(&frame).map_err(BusEnd::from)?)
    }

    /// The next answer that belongs to what was asked, until then; others are late ones.
    fn answer(
        &mut self,
        patience: Duration,
        at: At,
        fits: impl Fn(&[u8; 8]) -> bool,
    ) -> Result<[u8; 8], SdoError> {
        let until = Instant::now() + patience;
        let node = u16::from(self.node);
        while let Some(received) = self.bus.receive(until).map_err(BusEnd::from)? {
            let (id, bytes) = (received.frame.cob_id(), received.frame.bytes());
            let Ok(bytes) = <[u8; 8]>::try_from(bytes) else {
                continue;
            };
            if id == Some(0x600 + node) {
                let index = u16::from_le_bytes([bytes[1], bytes[2]]);
                let sub = bytes[3];
                self.other = Some(At { index, sub });
            }
            if id == Some(0x580 + node) && fits(&bytes) {
                return self.judge(bytes);
            }
        }
        Err(SdoError::Silent(self.node, at.index, at.sub))
    }

    /// The answer to a request that may come twice: `wanted` or a refusal, of the same address.
    fn ask(&mut self, request: [u8; 8], wanted: Wanted) -> Result<[u8; 8], SdoError> {
        let at = about(&request);
        let fits = |bytes: &[u8; 8]| wanted.fits(&request, bytes);
        self.other = None;
        for late in 0..self.attempts {
            // A block download that a client has left takes each request for a segment of its own,
            // and goes on for as long as there are any.
            if late > 0 && late + 1 == self.attempts && self.other.is_none() {
                self.send(at.request(ABORT, TIMED_OUT))?;
            }
            self.send(request)?;
            match self.answer(SOON, at, fits) {
                Err(SdoError::Silent(..)) => {}
                answer => {
                    // Those to the requests before must not be taken for that to a later one.
                    for _ in 0..late {
                        if let Err(SdoError::Silent(..)) = self.answer(SILENCE, at, fits) {
                            break;
                        }
                    }
                    return answer;
                }
            }
        }
        match self.other {
            Some(_) => Err(SdoError::Taken(self.node)),
            None => Err(SdoError::Silent(self.node, at.index, at.sub)),
        }
    }

    /// The answer to the request that begins a download of several frames. No answer comes from a
    /// node that was deaf for as long as it erased a page; what it may have begun is given up
    /// before it is asked again.
    fn begin_download(&mut self, request: [u8; 8], wanted: Wanted) -> Result<[u8; 8], SdoError> {
        let at = about(&request);
        let mut tries = 1;
        loop {
            self.send(request)?;
            match self.answer(PATIENCE, at, |bytes| wanted.fits(&request, bytes)) {
                Err(SdoError::Silent(..)) if tries < self.attempts => {
                    tries += 1;
                    self.give_up(at.index, at.sub)?;
                }
                answer => return answer,
            }
        }
    }

    /// A write of one frame: sent once, and its answer may take its time.
    fn write_once(&mut self, at: At, request: [u8; 8]) -> Result<(), SdoError> {
        self.other = None;
        self.send(request)?;
        let fits = |bytes: &[u8; 8]| Wanted::DOWNLOAD.fits(&request, bytes);
        let answered = self.taken(at, |client| client.answer(PATIENCE, at, fits));
        match answered {
            Err(SdoError::Silent(node, index, sub)) => match self.other {
                Some(_) => Err(SdoError::Taken(node)),
                None => Err(SdoError::Unanswered(node, index, sub)),
            },
            // Somebody else has written the same object: whose answer this is can't be told.
            _ if self.other == Some(at) => Err(SdoError::Taken(self.node)),
            answered => answered,
        }
    }

    /// Waits for the answer to the last frame of a write. An interrupt does not end that: the node
    /// may have taken the write, and its answer shows whether it has.
    fn taken(
        &mut self,
        At { index, sub }: At,
        wait: impl Fn(&mut Self) -> Result<[u8; 8], SdoError>,
    ) -> Result<(), SdoError> {
        let node = self.node;
        let amid = |why| Err(SdoError::Amid(Box::new(why), node, index, sub));
        match wait(self) {
            Err(SdoError::Bus(BusEnd::Interrupted)) => match wait(self) {
                Ok(_) => Err(SdoError::Behind(node, index, sub)),
                Err(SdoError::Refused(..)) => Err(BusEnd::Interrupted.into()),
                Err(lost @ SdoError::Bus(BusEnd::Lost(_))) => amid(lost),
                Err(_) => amid(BusEnd::Interrupted.into()),
            },
            Err(lost @ SdoError::Bus(BusEnd::Lost(_))) => amid(lost),
            answered => answered.map(drop),
        }
    }

    /// Does a transfer of several frames; the node learns of an interrupt, since no more comes.
    fn several(
        &mut self,
        at: At,
        transfer: impl FnOnce(&mut Self) -> Result<(), SdoError>,
    ) -> Result<(), SdoError> {
        let done = transfer(self);
        if let Err(SdoError::Bus(BusEnd::Interrupted)) = done {
            self.send(at.request(ABORT, TIMED_OUT))?;
        }
        done
    }

    fn judge(&self, bytes: [u8; 8]) -> Result<[u8; 8], SdoError> {
        let [command, _, _, _, code @ ..] = bytes;
        let At { index, sub } = about(&bytes);
        match command {
            ABORT => {
                let code = u32::from_le_bytes(code);
                Err(SdoError::Refused(self.node, index, sub, code))
            }
            _ => Ok(bytes),
        }
    }

    /// Ends a transfer that came out of step, for this reason, and tells the node why.
    fn out_of_step<T>(&mut self, at: At, code: u32, what: &'static str) -> Result<T, SdoError> {
        self.send(at.request(ABORT, code))?;
        Err(SdoError::Step(self.node, at.index, at.sub, what))
    }

    /// An answer within a transfer: silence in the middle of it is out of step.
    fn next(
        &mut self,
        at: At,
        patience: Duration,
        fits: impl Fn(&[u8; 8]) -> bool,
    ) -> Result<[u8; 8], SdoError> {
        match self.answer(patience, at, |bytes| bytes[0] == ABORT || fits(bytes)) {
            Err(SdoError::Silent(..)) => self.out_of_step(at, TIMED_OUT, "an answer is missing"),
            // The node does not have this transfer any more: who did that was not this client.
            Err(SdoError::Refused(node, index, sub, code))
                if At { index, sub } != at || (0x0504_0001..=0x0504_0003).contains(&code) =>
            {
                Err(SdoError::Taken(node))
            }
            answer => answer,
        }
    }
}

/// The object that a frame is about.
const fn about(bytes: &[u8; 8]) -> At {
    let index = u16::from_le_bytes([bytes[1], bytes[2]]);
    let sub = bytes[3];
    At { index, sub }
}

/// A download of one to four bytes; more are cut.
fn expedited(at: At, bytes: &[u8]) -> [u8; 8] {
    let mut content = [0; 4];
    let length = bytes.len().min(4);
    content[..length].copy_from_slice(&bytes[..length]);
    let unused = (4 - length) as u8;
    at.request(0x23 | unused << 2, u32::from_le_bytes(content))
}
