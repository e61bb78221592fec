//! Why a log can't be read: one sentence that names the file and what to do.

use std::{fmt, io};

use crate::report::replay_tables::printable;

/// A log that can't be read.
#[derive(Debug)]
pub enum LogError {
    /// This file or folder can't be opened.
    Open(String, io::Error),
    /// Reading this file failed in the middle.
    Read(String, io::Error),
    /// This file is no log.
    NotALog(String),
    /// This file is a text of 16-bit characters.
    Wide(String),
    /// This folder holds no log.
    NoLogs(String),
    /// So many logs overlap in time.
    TooManyAtOnce(usize),
    /// No frame is of the interface that was asked for; those that there are.
    NoSuchInterface(String, Vec<String>),
}

impl std::error::Error for LogError {}

impl fmt::Display for LogError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Open(file, why) => write!(f, "{} cannot be opened: {why}", printable(file)),
            Self::Read(file, why) => write!(f, "reading {} failed: {why}", printable(file)),
            Self::NotALog(file) => write!(
                f,
                "{} is no log of a CAN bus: give what candump -L or an ASC logger has written",
                printable(file)
            ),
            Self::Wide(file) => write!(
                f,
                "{} is UTF-16 text: convert it to UTF-8, or redirect to a file from another shell",
                printable(file)
            ),
            Self::NoLogs(folder) => write!(
                f,
                "{} holds no log of a CAN bus; name the folder that does, or a file",
                printable(folder)
            ),
            Self::TooManyAtOnce(count) => write!(
                f,
                "{count} logs overlap in time; give fewer at once, or one folder at a time"
            ),
            Self::NoSuchInterface(name, there) => write!(
                f,
                "no frame is of the interface {}: there are {}",
                printable(name),
                printable(&there.join(", "))
            ),
        }
    }
}
