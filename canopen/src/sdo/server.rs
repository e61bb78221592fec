//! One SDO server: which transfer is open, what a request means, and what is sent.
//!
//! In: the client's frames, the objects, the time. Out: responses, one per call, when the bus has
//! room. One transfer is open at a time; a client that begins another has given up the first.
//!
//! Left out: COB-IDs, and the NMT states in which the server is silent.

use crate::frame::Frame;
use crate::object::{Abort, Address, Objects, at};
use crate::time::Deadline;
use instant::Instant;

use super::block_download::Incoming;
use super::block_upload::Outgoing;
use super::content::{Content, writable};

/// How long the server waits for the client, in ms, before it ends the transfer. CiA 301 leaves
/// it open; PLCs pause for tens of milliseconds and a flash page can take a hundred, so 25 ms, as
/// some devices have it, is too short.
pub const TIMEOUT_MS: u32 = 3000;

/// The abort command, from either side (CiA 301, "Abort SDO transfer").
pub(super) const ABORT: u8 = 0x80;
const EXPEDITED: u8 = 0x02;
const SIZE_INDICATED: u8 = 0x01;

/// What the client has to send next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// Any first request.
    Idle,
    /// The next segment.
    Download,
    /// A request for the next segment.
    Upload,
    /// The next segment of a block.
    BlockDownload,
    /// The end of the block download: all segments are there.
    BlockDownloadEnd,
    /// The start of the block upload.
    BlockUpload,
    /// Nothing, or an early acknowledgement: the block is being sent.
    BlockUploadSending,
    /// The acknowledgement of the block.
    BlockUploadWaiting,
    /// The end of the block upload: everything has been acknowledged.
    BlockUploadEnd,
}

/// An SDO server with at most one open transfer.
#[derive(Clone, Debug)]
pub struct Server {
    pub(super) phase: Phase,
    pub(super) content: Content,
    /// Toggle bit of the next segment, at its place in the command byte.
    pub(super) toggle: u8,
    pub(super) incoming: Incoming,
    pub(super) outgoing: Outgoing,
    pub(super) response: Option<[u8; 8]>,
    deadline: Instant,
}

impl Default for Server {
    fn default() -> Self {
        Self::new()
    }
}

/// A frame with command, multiplexer and a number.
fn reply(command: u8, at: Address, number: u32) -> [u8; 8] {
    let [low, high] = at.index.to_le_bytes();
    let [a, b, c, d] = number.to_le_bytes();
    [command, low, high, at.sub, a, b, c, d]
}

impl Server {
    /// A server without an open transfer.
    pub const fn new() -> Self {
        Self {
            phase: Phase::Idle,
            content: Content::NONE,
            toggle: 0,
            incoming: Incoming::NEW,
            outgoing: Outgoing::NEW,
            response: None,
            deadline: Instant(0),
        }
    }

    /// Takes a request, whose COB-ID the caller has checked, and prepares the response.
    ///
    /// A frame shorter than eight bytes is no SDO and is ignored. A request that cannot be served
    /// is answered with an abort and ends the transfer; an abort is never answered. While a block
    /// is being downloaded every frame but an abort is a segment.
    pub fn request<O: Objects>(&mut self, objects: &mut O, frame: &Frame, now: Instant) {
        if frame.bytes().len() < 8 {
            return;
        }
        self.deadline = now.after_ms(TIMEOUT_MS);
        if let Err(reason) = self.serve(objects, frame.padded()) {
            self.abort(objects, reason);
        }
    }

    /// The next frame to send: a response, or a segment of a block that is made now.
    pub fn transmit<O: Objects>(&mut self, objects: &mut O, now: Instant) -> Option<[u8; 8]> {
        if !self.is_pending() {
            return None;
        }
        self.deadline = now.after_ms(TIMEOUT_MS);
        if O::SERVICES.block_upload && self.response.is_none() {
            match self.upload_block_segment(objects) {
                Ok(segment) => return Some(segment),
                Err(reason) => self.abort(objects, reason),
            }
        }
        self.response.take()
    }

    /// Ends a transfer whose client has been silent for [`TIMEOUT_MS`]; when to call again.
    pub fn poll<O: Objects>(&mut self, objects: &mut O, now: Instant) -> Deadline {
        if self.phase == Phase::Idle {
            return Deadline::NONE;
        }
        if now < self.deadline {
            return Deadline::at(self.deadline);
        }
        self.abort(objects, Abort::TimedOut);
        Deadline::NONE
    }

    /// Forgets the transfer and any response; an open download is discarded. Nothing is sent.
    pub fn reset<O: Objects>(&mut self, objects: &mut O) {
        self.content.discard(objects);
        self.close();
        self.response = None;
    }

    /// True when [`Server::transmit`] has something to send.
    pub fn is_pending(&self) -> bool {
        self.response.is_some() || self.phase == Phase::BlockUploadSending
    }

    fn serve<O: Objects>(&mut self, objects: &mut O, data: [u8; 8]) -> Result<(), Abort> {
        let [command, rest @ ..] = data;
        let blocks = O::SERVICES.block_download;
        if blocks && self.phase == Phase::BlockDownload && command != ABORT {
            return self.download_block_segment(objects, data);
        }
        if blocks && self.is_repeated_segment(data) {
            return Ok(());
        }
        match (command >> 5, command & 3) {
            (0, _) => self.download_segment(objects, command, rest),
            (1, _) => self.download(objects, data),
            (2, _) => self.upload(objects, data),
            (3, _) => self.upload_segment(objects, command),
            (4, _) => {
                self.reset(objects);
                Ok(())
            }
            (5, _) if !O::SERVICES.block_upload => Err(Abort::InvalidCommand),
            (6, _) if !blocks => Err(Abort::InvalidCommand),
            (5, 0) => self.block_upload(objects, data),
            (5, 1) => self.end_block_upload(),
            (5, 2) => self.acknowledge_block(rest),
            (5, _) => self.start_block_upload(),
            (6, 0 | 2) => self.block_download(objects, data),
            (6, _) => self.end_block_download(objects, data),
            _ => Err(Abort::InvalidCommand),
        }
    }

    /// Any first request: gives up the open transfer and turns to the object named in the frame.
    pub(super) fn begin<O: Objects>(&mut self, objects: &mut O, data: [u8; 8]) -> [u8; 4] {
        let [_, low, high, sub, rest @ ..] = data;
        self.reset(objects);
        self.content = Content::new(at(u16::from_le_bytes([low, high]), sub));
        rest
    }

    /// Prepares a response that names the object.
    pub(super) fn respond(&mut self, command: u8, number: u32) {
        self.response = Some(reply(command, self.content.at(), number));
    }

    /// Goes on only in the given phase: a request at any other time is out of place.
    pub(super) fn must_be_in(&self, phase: Phase) -> Result<(), Abort> {
        if self.phase != phase {
            return Err(Abort::InvalidCommand);
        }
        Ok(())
    }

    /// The transfer is over; the prepared response still goes out.
    // Eight callers, each of which would hold a copy of it.
    #[inline(never)]
    pub(super) fn close(&mut self) {
        self.phase = Phase::Idle;
        self.content = Content::NONE;
    }

    fn abort<O: Objects>(&mut self, objects: &mut O, reason: Abort) {
        self.respond(ABORT, reason.code());
        self.content.discard(objects);
        self.close();
    }

    /// SDO download, first request (CiA 301, "SDO download initiate").
    fn download<O: Objects>(&mut self, objects: &mut O, data: [u8; 8]) -> Result<(), Abort> {
        let [command, ..] = data;
        let bytes = self.begin(objects, data);
        let entry = writable(objects, self.content.at())?;
        let sized = command & SIZE_INDICATED != 0;
        if command & EXPEDITED == 0 {
            let size = sized.then(|| u32::from_le_bytes(bytes));
            self.content.create(objects, entry, size)?;
            self.phase = Phase::Download;
            self.toggle = 0;
        } else {
            // Without a size the type tells how many of the four bytes count.
            let length = match sized {
                true => 4 - usize::from(command >> 2 & 3),
                false => entry.data_type.size().unwrap_or(4).min(4),
            };
            self.content.create(objects, entry, Some(length as u32))?;
            self.content
                .append(objects, bytes.get(..length).unwrap_or(&[]))?;
            self.content.commit(objects)?;
        }
        self.respond(0x60, 0);
        if self.phase == Phase::Idle {
            self.close();
        }
        Ok(())
    }

    fn upload<O: Objects>(&mut self, objects: &mut O, data: [u8; 8]) -> Result<(), Abort> {
        self.begin(objects, data);
        self.content.open(objects)?;
        self.answer_upload(objects)
    }

    /// The response to an upload request, expedited up to four bytes (CiA 301, "SDO upload
    /// initiate"). Nothing at all cannot be told in an expedited response, so it is segmented.
    pub(super) fn answer_upload<O: Objects>(&mut self, objects: &mut O) -> Result<(), Abort> {
        let size = self.content.size();
        if !(1..=4).contains(&size) {
            self.phase = Phase::Upload;
            self.toggle = 0;
            self.respond(0x41, size);
            return Ok(());
        }
        let mut bytes = [0; 4];
        self.content.read(objects, 0, &mut bytes)?;
        let unused = 4 - size as u8;
        self.respond(0x43 | unused << 2, u32::from_le_bytes(bytes));
        self.close();
        Ok(())
    }
}
