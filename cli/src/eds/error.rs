//! Why a data sheet can't be used: one sentence that names the file.

use std::{fmt, io};

use crate::report::replay_tables::printable;

/// A data sheet that can't be used.
#[derive(Debug)]
pub enum EdsError {
    /// The file can't be read.
    Open(String, io::Error),
    /// The file is larger than any data sheet.
    TooLarge(String),
    /// The file describes no object.
    NoObject(String),
    /// Neither the file nor the command line says which node it is.
    NoNode(String),
}

impl std::error::Error for EdsError {}

impl fmt::Display for EdsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Open(file, why) => write!(f, "{} cannot be read: {why}", printable(file)),
            Self::TooLarge(file) => write!(
                f,
                "{} is larger than 16 MiB, which no EDS or DCF is; give another file",
                printable(file)
            ),
            Self::NoObject(file) => write!(
                f,
                "{} describes no object; give an EDS or DCF (CiA 306)",
                printable(file)
            ),
            Self::NoNode(file) => write!(
                f,
                "{} does not name its node; write --eds {}@NODE",
                printable(file),
                printable(file)
            ),
        }
    }
}
