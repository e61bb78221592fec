//! Why an update ended: one sentence that says where and what to do.

use std::fmt;
use std::io;
use std::path::PathBuf;

use flash::image::ImageError;

use super::version;
use crate::bus::JoinError;
use crate::bus::diagnosis::Silence;
use crate::bus::sdo::SdoError;

/// Why an update ended before every node ran the new program.
#[derive(Debug)]
pub enum UpdateError {
    /// A file can't be read.
    File(PathBuf, io::Error),
    /// A file is no image.
    Image(PathBuf, ImageError),
    /// A file ends early, or its body is damaged.
    Damaged(PathBuf),
    /// The files hold images of two versions.
    Versions(u32, u32),
    /// The bus can't be joined.
    Join(JoinError),
    /// The bus was lost.
    Lost(io::Error),
    /// The user has ended it.
    Interrupted,
    /// A node is named twice.
    Twice(u8),
    /// A node does not answer, and why.
    NotThere(Silence),
    /// A node does not answer.
    Silent(u8),
    /// A node has refused a request: index, sub-index, abort code.
    Refused(u8, u16, u8, u32),
    /// The node's transfer came out of step.
    Transfer(u8),
    /// Somebody else has ended the transfer to a node and talks to it now.
    Taken(u8),
    /// A node is not one of ours.
    Stranger(u8),
    /// No image is for this node's hardware.
    Hardware(u8, u32),
    /// No image is for the slot that this node does not run in.
    Slot(u8, char),
    /// A node runs a later version than the image's.
    Older(u8, u32, u32),
    /// A node runs a program that is on trial.
    OnTrial(u8),
    /// A node has no valid angle: while the other one is updated nobody would measure.
    NoAngle(u8),
    /// A node has no place for a program that comes over the bus.
    Fixed(u8),
    /// A node is not OPERATIONAL that would be the only one that measures.
    Idle(u8),
    /// A node of a pair at work has no valid angle after the update of one.
    Apart(u8),
    /// A node did not finish clearing its memory.
    Clearing(u8),
    /// A node found the image wrong: what 1F57h says.
    Found(u8, u32),
    /// A node did not come back after the start.
    Gone(u8),
    /// A node has given the new program up and runs this version again.
    RolledBack(u8, u32),
    /// A node has neither confirmed the new program nor given it up.
    Undecided(u8),
}

impl UpdateError {
    /// What it means that the bus could not be read or written.
    pub fn lost(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::Interrupted => Self::Interrupted,
            _ => Self::Lost(error),
        }
    }

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
            SdoError::Lost(error) => Self::Lost(error),
            SdoError::Interrupted => Self::Interrupted,
            SdoError::Silent(node, ..) | SdoError::Unanswered(node, ..) => Self::Silent(node),
            SdoError::Refused(node, index, sub, code) => Self::Refused(node, index, sub, code),
            SdoError::Step(node, ..) | SdoError::Length(node, ..) => Self::Transfer(node),
            SdoError::Taken(node) => Self::Taken(node),
        }
    }
}

impl std::error::Error for UpdateError {}

impl fmt::Display for UpdateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path, error) => write!(f, "cannot read {}: {error}", path.display()),
            Self::Image(path, error) => {
                write!(f, "{} is no image: {}", path.display(), no_image(*error))
            }
            Self::Damaged(path) => write!(f, "{} is damaged: fetch it again", path.display()),
            Self::Versions(one, other) => write!(
                f,
                "the images are of two versions, {} and {}: give those of one",
                version(*one),
                version(*other)
            ),
            Self::Join(error) => write!(f, "{error}"),
            Self::NotThere(why) => write!(f, "{why}; nothing was changed"),
            Self::Interrupted => write!(f, "interrupted; {AGAIN}"),
            Self::Lost(error) => write!(f, "the bus is lost: {error}; {AGAIN}"),
            node => node.fmt_node(f),
        }
    }
}

impl UpdateError {
    /// The sentence of an error that names a node.
    fn fmt_node(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Twice(node) => write!(f, "node {node} is named twice"),
            Self::Silent(node) => write!(
                f,
                "node {node} does not answer: look at its node-id, its supply and the bus; {AGAIN}"
            ),
            Self::Taken(node) => write!(
                f,
                "another tool uses node {node}, perhaps another update: let one end first; \
                 {AGAIN}"
            ),
            Self::Refused(node, index, sub, WRONG_STATE) => write!(
                f,
                "node {node} can't do that now (0800 0022h at {index:04X}h sub {sub}): perhaps \
                 another tool uses it"
            ),
            Self::Refused(node, index, sub, code) => write!(
                f,
                "node {node} refuses {index:04X}h sub {sub}: abort code {code:08X}h"
            ),
            Self::Transfer(node) => {
                write!(f, "the transfer to node {node} came out of step; {AGAIN}")
            }
            Self::Fixed(node) => write!(
                f,
                "node {node} takes no program over the bus, as the paper's instrument does not: \
                 use a debug probe (docs/bring-up.md)"
            ),
            Self::Stranger(node) => write!(f, "node {node} is no channel of a Plumb"),
            Self::Hardware(node, id) => {
                write!(f, "no image is for node {node}: its hardware is {id:08X}h")
            }
            Self::Slot(node, slot) => write!(
                f,
                "node {node} needs the image for slot {slot}, which is not in the file"
            ),
            Self::Older(node, runs, image) => write!(
                f,
                "node {node} runs version {}, and the image is the older {}: nothing was changed",
                version(*runs),
                version(*image)
            ),
            Self::OnTrial(node) => write!(
                f,
                "node {node} runs a program on trial: wait half a minute until it is confirmed or \
                 given up"
            ),
            Self::NoAngle(node) => write!(
                f,
                "node {node} has no valid angle, and one channel has to measure while the other \
                 is updated: repair it first, or use --force"
            ),
            Self::Idle(node) => write!(
                f,
                "node {node} is not OPERATIONAL, and one channel has to measure while the other \
                 is updated: start it first, or use --force"
            ),
            Self::Clearing(node) => write!(f, "node {node} does not finish clearing its memory"),
            Self::Found(node, status) => {
                write!(f, "node {node} refuses the image: {}", found(*status))
            }
            started => started.fmt_started(f),
        }
    }

    /// The sentence of an error after the new program was started.
    fn fmt_started(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gone(node) => write!(
                f,
                "node {node} has not come back after the start of the new program"
            ),
            Self::RolledBack(node, runs) => write!(
                f,
                "node {node} gave the new program up, which did not pass its self-check, and runs \
                 version {} again",
                version(*runs)
            ),
            Self::Undecided(node) => write!(
                f,
                "node {node} has neither confirmed the new program nor given it up in time"
            ),
            Self::Apart(node) => write!(
                f,
                "node {node} has no valid angle in OPERATIONAL, and had one before the update: \
                 look at the pair with `plumb monitor`"
            ),
            // The others name none.
            _ => Ok(()),
        }
    }
}

/// The abort code of what can't be done in a node's present state.
const WRONG_STATE: u32 = 0x0800_0022;

/// What helps after most of them.
const AGAIN: &str =
    "run the same command again: it continues after the part of the image that the node has kept";

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

/// What 1F57h says, in words.
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
