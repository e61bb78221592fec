//! Why monitoring could not be done: one sentence that states which file or bus, and what to do.

use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use bus_logs::LogError;
use bus_master::JoinError;
use listen::PlanError;
use output::printable;

/// Why monitoring could not be done.
#[derive(Debug, thiserror::Error)]
pub enum MonitorError {
    /// The bus can't be joined.
    #[error("{0}")]
    Join(JoinError),
    /// The log can't be read.
    #[error("{0}")]
    Log(LogError),
    /// Instruments that can't be looked for.
    #[error("{0}")]
    Plan(#[from] PlanError),
    /// A bus has no part that was asked for.
    #[error("--from and --to are for logs: name them by --log")]
    PartOfBus,
    /// The bus was lost.
    #[error("{a}", a = printable(&.0.to_string()))]
    Lost(io::Error),
    /// This recording exists already.
    #[error(
        "{a} is there already: choose another file with --record, or replace it with --force",
        a = name(.0)
    )]
    Exists(PathBuf),
    /// A recording would be compressed by this name, and is not.
    #[error(
        "{a}: a recording is not compressed, so that nothing of it is lost: name it .log or .asc, \
         and compress it afterwards",
        a = name(.0)
    )]
    Compressed(PathBuf),
    /// This recording can't be begun.
    #[error(
        "nothing can be recorded to {a}: {1}; name a file in a folder that exists and that you \
         may write to",
        a = name(.0)
    )]
    Create(PathBuf, io::Error),
    /// This recording can't be written on.
    #[error("recording to {a} has ended: {1}; what was recorded until then is whole", a = name(.0))]
    Record(PathBuf, io::Error),
    /// The page can't be served at this address.
    #[error("no page can be served at {0}: {1}; give another by --web ADDRESS:PORT")]
    Web(SocketAddr, io::Error),
    /// The page's server can't be started.
    #[error("the page cannot be served: {0}")]
    Serve(io::Error),
    /// The standard output can't be written.
    #[error("the output cannot be written: {0}")]
    Print(io::Error),
    /// The reader has panicked.
    #[error("reading has ended by a fault of this program: please report what stands above")]
    Reader,
}

fn name(path: &Path) -> String {
    printable(&path.display().to_string())
}
