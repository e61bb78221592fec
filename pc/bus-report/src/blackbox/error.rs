//! Why what nodes remember could not be listed: one sentence that names node or file.

use std::io;
use std::path::PathBuf;

use super::decode::DecodeError;
use bus_master::fault::Fault;
use bus_master::nodes::NodesError;
use output::printable;
use output::unreadable::Unreadable;
use output::write::not_written;

/// What went wrong.
#[derive(Debug, thiserror::Error)]
pub enum FaultsError {
    /// The bus, or a node that could not be asked.
    #[error("{0}")]
    Bus(Fault),
    /// No node could be chosen.
    #[error("{0}")]
    Nodes(NodesError),
    /// A node has given something else.
    #[error("the fault memory of node {0} can't be read: {1}; is it another device?")]
    Node(u8, DecodeError),
    /// A file could not be read.
    #[error("{0}")]
    Read(Unreadable),
    /// A file holds something else.
    #[error(
        "{a} can't be used: {1}; take a file that `plumb faults --boxes` has saved",
        a = printable(.0)
    )]
    File(String, DecodeError),
    /// A file could not be written.
    #[error("{a}", a = not_written(.0, .1, "another folder with --boxes"))]
    Write(PathBuf, io::Error),
    /// It could not be printed.
    #[error("cannot print the list: {0}")]
    Print(io::Error),
}

impl FaultsError {
    /// True when no other node can be asked either.
    pub const fn ends_all(&self) -> bool {
        matches!(
            self,
            Self::Bus(Fault::Join(_) | Fault::Bus(_)) | Self::Nodes(_) | Self::Write(..)
        )
    }
}
