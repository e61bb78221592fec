//! Why `plumb serve` did not start, or has ended by itself: one sentence each.

use std::fmt;
use std::path::PathBuf;

use sim::bench::BenchError;

use super::error::ServeError;
use super::keep::KeepError;
use super::script::ScriptError;

/// An end that nobody asked for; exit status 2.
#[derive(Debug)]
pub enum Stopped {
    /// A way for clients could not be opened.
    Door(ServeError),
    /// The script is none.
    Script(ScriptError),
    /// The script has ended, after so many seconds.
    ScriptEnded(PathBuf, f64),
    /// The folder for the nodes' records can't be used.
    Keep(KeepError),
    /// So many node-ids for so many nodes.
    NodeIds(usize, usize),
    /// An instrument could not be calibrated.
    Bench(BenchError),
    /// The end by Ctrl-C could not be arranged.
    Signal(ctrlc::Error),
}

impl std::error::Error for Stopped {}

impl From<ServeError> for Stopped {
    fn from(error: ServeError) -> Self {
        Self::Door(error)
    }
}

impl From<ScriptError> for Stopped {
    fn from(error: ScriptError) -> Self {
        Self::Script(error)
    }
}

impl From<KeepError> for Stopped {
    fn from(error: KeepError) -> Self {
        Self::Keep(error)
    }
}

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Door(error) => error.fmt(f),
            Self::Script(error) => error.fmt(f),
            Self::ScriptEnded(path, seconds) => write!(
                f,
                "the script {} has ended after {seconds:.1} s and nothing moves the instrument \
                 any more; end it with `hold` to serve on, or with `repeat` to begin again",
                path.display()
            ),
            Self::Keep(error) => error.fmt(f),
            Self::NodeIds(given, nodes) => write!(
                f,
                "{given} node-id{} for {nodes} nodes: --node-ids takes one for each, or none",
                if *given == 1 { "" } else { "s" }
            ),
            Self::Bench(error) => write!(f, "an instrument could not be calibrated: {error}"),
            Self::Signal(error) => write!(f, "cannot be ended by Ctrl-C ({error}), so not begun"),
        }
    }
}
