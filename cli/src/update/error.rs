//! Why an update ended: one sentence that states where and what to do.

use std::io;
use std::path::PathBuf;

use canopen::object::Abort;

use super::version::version;
use bus_master::diagnosis::Silence;
use bus_master::sdo::SdoError;
use bus_master::{BusEnd, JoinError};
use flash::image::ImageError;

/// Why an update ended before every node ran the new program.
#[derive(Debug, thiserror::Error)]
pub enum UpdateError {
    /// A file can't be read.
    #[error("cannot read {path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// A file holds no images.
    #[error("{path} {1}", path = .0.display())]
    Images(PathBuf, FileError),
    /// The files hold images of two versions.
    #[error(
        "the images are of two versions, {a} and {b}: give those of one",
        a = version(*.0),
        b = version(*.1)
    )]
    Versions(u32, u32),
    /// The bus can't be joined.
    #[error("{0}")]
    Join(JoinError),
    /// The bus can be used no longer.
    #[error("{0}; {AGAIN}")]
    Bus(#[from] BusEnd),
    /// A node is named twice.
    #[error("node {0} is named twice")]
    Twice(u8),
    /// A node does not answer, and why.
    #[error("{0}; nothing was changed")]
    NotThere(Silence),
    /// A node does not answer.
    #[error("node {0} does not answer: look at its node-id, its supply and the bus; {AGAIN}")]
    Silent(u8),
    /// A node has refused a request: index, sub-index, abort code.
    #[error("node {0} {a}", a = refused(*.1, *.2, *.3))]
    Refused(u8, u16, u8, u32),
    /// The node's transfer came out of step.
    #[error("the transfer to node {0} came out of step; {AGAIN}")]
    Transfer(u8),
    /// Somebody else has ended the transfer to a node and talks to it now.
    #[error("another tool uses node {0}, perhaps another update: let one end first; {AGAIN}")]
    Taken(u8),
    /// A node is not one of ours.
    #[error("node {0} is no channel of a Plumb")]
    Stranger(u8),
    /// No image is for this node's hardware.
    #[error("no image is for node {0}: its hardware is {1:08X}h")]
    Hardware(u8, u32),
    /// No image is for the slot that this node does not run in.
    #[error("node {0} needs the image for slot {1}, which is not in the file")]
    Slot(u8, char),
    /// A node runs a later version than the image's.
    #[error(
        "node {0} runs version {a}, and the image is the older {b}: nothing was changed",
        a = version(*.1),
        b = version(*.2)
    )]
    Older(u8, u32, u32),
    /// A node runs a program that is on trial.
    #[error(
        "node {0} runs a program on trial: wait half a minute until it is confirmed or given up"
    )]
    OnTrial(u8),
    /// A node has no valid angle: while the other one is updated nobody would measure.
    #[error(
        "node {0} has no valid angle, and one channel has to measure while the other is updated: \
         repair it first, or use --force"
    )]
    NoAngle(u8),
    /// A node has no place for a program that comes over the bus.
    #[error(
        "node {0} takes no program over the bus, as the paper's instrument does not: use a debug \
         probe (docs/bring-up.md)"
    )]
    Fixed(u8),
    /// A node is not OPERATIONAL that would be the only one that measures.
    #[error(
        "node {0} is not OPERATIONAL, and one channel has to measure while the other is updated: \
         start it first, or use --force"
    )]
    Idle(u8),
    /// A node of a pair at work has no valid angle after the update of one.
    #[error(
        "node {0} has no valid angle in OPERATIONAL, and had one before the update: look at the \
         pair with `plumb monitor`"
    )]
    Apart(u8),
    /// A node did not finish clearing its memory.
    #[error("node {0} does not finish clearing its memory")]
    Clearing(u8),
    /// A node found the image wrong: what 1F57h reads.
    #[error("node {0} refuses the image: {a}", a = found(*.1))]
    Found(u8, u32),
    /// A node did not come back after the start.
    #[error("node {0} has not come back after the start of the new program")]
    Gone(u8),
    /// A node has given the new program up and runs this version again.
    #[error(
        "node {0} gave the new program up, which did not pass its self-check, and runs version \
         {a} again",
        a = version(*.1)
    )]
    RolledBack(u8, u32),
    /// A node has neither confirmed the new program nor given it up.
    #[error("node {0} has neither confirmed the new program nor given it up in time")]
    Undecided(u8),
}

impl UpdateError {
    /// Whether the work was done and the node would not have it: exit status 1.
    pub const fn is_verdict(&self) -> bool {
        matches!(
            self,
            Self::RolledBack(..) | Self::Found(..) | Self::Apart(..)
        )
    }
}

impl From<SdoError> for UpdateError {
    fn from(error: SdoError) -> Self {
        match error {
            SdoError::Bus(end) => Self::Bus(end),
            SdoError::Behind(..) => Self::Bus(BusEnd::Interrupted),
            // The same command finds out what the node has taken.
            SdoError::Amid(why, ..) => Self::from(*why),
            SdoError::Silent(node, ..) | SdoError::Unanswered(node, ..) => Self::Silent(node),
            SdoError::Refused(node, index, sub, code) => Self::Refused(node, index, sub, code),
            SdoError::Step(node, ..) | SdoError::Length(node, ..) => Self::Transfer(node),
            SdoError::Taken(node) => Self::Taken(node),
        }
    }
}

/// The abort code of what can't be done in a node's present state.
const WRONG_STATE: u32 = Abort::WrongState.code();

/// What helps after most of them.
const AGAIN: &str =
    "run the same command again: it continues after the part of the image that the node has kept";

/// What a node did with a request, in words.
fn refused(index: u16, sub: u8, code: u32) -> String {
    match code {
        WRONG_STATE => format!(
            "can't do that now (0800 0022h at {index:04X}h sub {sub}): perhaps another tool uses it"
        ),
        _ => format!("refuses {index:04X}h sub {sub}: abort code {code:08X}h"),
    }
}

/// Why bytes are no images, as it is said of their file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FileError {
    /// One of them is no image for any slot.
    #[error("is no image: {a}", a = no_image(*.0))]
    Image(ImageError),
    /// The bytes end early, or a body is not what was linked.
    #[error("is damaged: fetch it again")]
    Damaged,
    /// They are for a debug probe: the whole flash of a part, or a program with its addresses.
    #[error(
        "is for a debug probe (docs/bring-up.md): give the images for the two slots, as \
         plumb-VERSION-slot-a.img and plumb-VERSION-slot-b.img"
    )]
    Probe,
    /// They are the paper's instrument's, which takes no program over the bus.
    #[error(
        "is a program of the paper's instrument, which takes none over the bus: use a debug probe \
         (docs/bring-up.md)"
    )]
    Paper,
}

/// Why bytes are no image, in words.
const fn no_image(error: ImageError) -> &'static str {
    match error {
        ImageError::Magic => "it does not begin as one, or ends early",
        ImageError::Format => "it is of an unknown format; a later release of plumb may support it",
        ImageError::Header => "its header is damaged; fetch it again",
        ImageError::Hardware => "it is for other hardware",
        ImageError::Address => "it is linked for no slot of this part",
        ImageError::Length => "it has no body, or one that no slot has room for",
        ImageError::Body => "its body is damaged; fetch it again",
        ImageError::Access(_) => "it can't be read",
    }
}

/// What 1F57h reads, in words.
fn found(status: u32) -> &'static str {
    match (status >> 1 & 0x7F, status >> 16 & 0xFF) {
        (_, 1) => "it is for other hardware",
        (_, 2) => "it is for the slot that runs",
        (_, 3) => "it is older than the program that runs",
        (_, 4) => "it is not signed",
        (_, 5) => "its signature is wrong",
        (1, _) => "there is none",
        (2, _) => "it is of an unknown format",
        (3, _) => "it is damaged",
        (4, _) => "its memory was not cleared",
        (5, _) => "its memory does not hold it",
        (6, _) => "it is too long",
        (7, _) => "its memory is protected",
        _ => "it gives no reason",
    }
}
