//! Why what nodes remember could not be listed: one sentence that names node or file.

use std::fmt;
use std::io;

use super::decode::DecodeError;
use crate::bus::JoinError;
use crate::bus::sdo::SdoError;
use crate::report::replay_tables::printable;

/// What went wrong.
#[derive(Debug)]
pub enum FaultsError {
    /// The bus could not be joined.
    Join(JoinError),
    /// A node could not be asked.
    Sdo(SdoError),
    /// A node has given something else.
    Node(u8, DecodeError),
    /// A file could not be read.
    Read(String, io::Error),
    /// A file holds something else.
    File(String, DecodeError),
    /// A file could not be written.
    Write(String, io::Error),
    /// The list could not be turned into JSON.
    Json(serde_json::Error),
    /// It could not be printed.
    Print(io::Error),
}

impl FaultsError {
    /// True when no other node can be asked either.
    pub const fn ends_all(&self) -> bool {
        matches!(
            self,
            Self::Join(_) | Self::Sdo(SdoError::Lost(_) | SdoError::Interrupted) | Self::Write(..)
        )
    }
}

impl fmt::Display for FaultsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Join(why) => write!(f, "{why}"),
            Self::Sdo(why) => write!(f, "{why}"),
            Self::Node(node, why) => write!(
                f,
                "what node {node} remembers can't be read: {why}; is it another device?"
            ),
            Self::Read(file, why) => write!(
                f,
                "cannot read {}: {why}; check the name and the permissions",
                printable(file)
            ),
            Self::File(file, why) => write!(
                f,
                "{} can't be used: {why}; take a file that `plumb faults --boxes` has saved",
                printable(file)
            ),
            Self::Write(file, why) => write!(
                f,
                "cannot write {}: {why}; make room or choose another folder with --boxes",
                printable(file)
            ),
            Self::Json(why) => write!(
                f,
                "cannot put the list into JSON: {why}; please report this as a defect"
            ),
            Self::Print(why) => write!(f, "cannot print the list: {why}"),
        }
    }
}

impl std::error::Error for FaultsError {}
