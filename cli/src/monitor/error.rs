//! Why monitoring could not be done: one sentence that says which file or bus, and what to do.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

use crate::bus::JoinError;
use crate::log::LogError;
use crate::report::replay_tables::printable;

/// Why monitoring could not be done.
#[derive(Debug)]
pub enum MonitorError {
    /// The bus can't be joined.
    Join(JoinError),
    /// The log can't be read.
    Log(LogError),
    /// Node-ids that make no pairs.
    Nodes,
    /// The bus was lost.
    Lost(io::Error),
    /// This recording exists already.
    Exists(PathBuf),
    /// A recording would be compressed by this name, and is not.
    Compressed(PathBuf),
    /// This recording can't be begun.
    Create(PathBuf, io::Error),
    /// This recording can't be written on.
    Record(PathBuf, io::Error),
    /// The page can't be served at this address.
    Web(SocketAddr, io::Error),
    /// The page's server can't be started.
    Serve(io::Error),
    /// The standard output can't be written.
    Print(io::Error),
    /// The reader has panicked.
    Reader,
}

impl std::error::Error for MonitorError {}

impl fmt::Display for MonitorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |path: &PathBuf| printable(&path.display().to_string());
        match self {
            Self::Join(error) => write!(f, "{error}"),
            Self::Log(error) => write!(f, "{error}"),
            Self::Nodes => write!(
                f,
                "--nodes needs two node-ids for each instrument, each node-id once: 1,2 or 1,2,3,4"
            ),
            Self::Lost(error) => write!(f, "{}", printable(&error.to_string())),
            Self::Exists(path) => write!(
                f,
                "{} exists already: name another file, or add --force to write over it",
                name(path)
            ),
            Self::Compressed(path) => write!(
                f,
                "{}: a recording is not compressed, so that nothing of it is lost: name it .log \
                 or .asc, and compress it afterwards",
                name(path)
            ),
            Self::Create(path, error) => write!(
                f,
                "nothing can be recorded to {}: {error}; name a file in a folder that exists and \
                 that you may write to",
                name(path)
            ),
            Self::Record(path, error) => write!(
                f,
                "recording to {} has ended: {error}; what was recorded until then is whole",
                name(path)
            ),
            Self::Web(address, error) => write!(
                f,
                "no page can be served at {address}: {error}; give another by --web ADDRESS:PORT"
            ),
            Self::Serve(error) => write!(f, "the page cannot be served: {error}"),
            Self::Print(error) => write!(f, "the output cannot be written: {error}"),
            Self::Reader => write!(
                f,
                "reading has ended by a fault of this program: please report what stands above"
            ),
        }
    }
}
