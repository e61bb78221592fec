//! Why `plumb serve` did not start, or has ended by itself: one sentence each.

use std::path::PathBuf;

use sim::bench::BenchError;

use super::error::ServeError;
use super::keep::KeepError;
use super::script::ScriptError;

/// An end that nobody asked for; exit status 2.
#[derive(Debug, thiserror::Error)]
pub enum Stopped {
    /// A way for clients could not be opened.
    #[error("{0}")]
    Door(#[from] ServeError),
    /// The script is none.
    #[error("{0}")]
    Script(#[from] ScriptError),
    /// The script has ended, after so many seconds.
    #[error(
        "the script {path} has ended after {1:.1} s and nothing moves the instrument any more; \
         end it with `hold` to serve on, or with `repeat` to begin again",
        path = .0.display()
    )]
    ScriptEnded(PathBuf, f64),
    /// The folder for the nodes' records can't be used.
    #[error("{0}")]
    Keep(#[from] KeepError),
    /// So many node-ids for so many nodes.
    #[error(
        "{0} node-id{a} for {1} nodes: --node-ids takes one for each, or none",
        a = if *.0 == 1 { "" } else { "s" }
    )]
    NodeIds(usize, usize),
    /// An instrument could not be calibrated.
    #[error("an instrument could not be calibrated: {0}")]
    Bench(BenchError),
    /// The end by Ctrl-C could not be arranged.
    #[error("cannot be ended by Ctrl-C ({0}), so not begun")]
    Signal(ctrlc::Error),
}
