//! Why a data sheet can't be used: one sentence that names the file.

use output::printable;
use output::unreadable::Unreadable;

/// A data sheet that can't be used.
#[derive(Debug, thiserror::Error)]
pub enum EdsError {
    /// The file can't be read.
    #[error("{0}")]
    Read(#[from] Unreadable),
    /// The file is larger than any data sheet.
    #[error(
        "{a} is larger than 16 MiB, which no EDS or DCF is; give another file",
        a = printable(.0)
    )]
    TooLarge(String),
    /// The file describes no object.
    #[error("{a} describes no object; give an EDS or DCF (CiA 306)", a = printable(.0))]
    NoObject(String),
    /// Neither the file nor the command line states which node it is.
    #[error(
        "{a} does not name its node; write --eds {b}@NODE",
        a = printable(.0),
        b = printable(.0)
    )]
    NoNode(String),
}
