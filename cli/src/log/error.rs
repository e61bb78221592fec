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
    /// This file is a log of this format, which is not read.
    Foreign(String, &'static str),
    /// So many lines, and the ends of so many files, could not be read: the file and line of the
    /// first. What could be was used.
    Incomplete {
        /// Lines that are cut, unreadable or too long.
        lines: u64,
        /// Where the first of them stands.
        first: (String, u64),
        /// The first compressed file whose end is missing or damaged.
        damaged: Option<String>,
    },
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
            Self::Foreign(file, format) => write!(
                f,
                "{} is a {format} log, which is not read: make a candump or ASC log of it, as with \
                 `python3 -m can.logconvert`",
                printable(file)
            ),
            Self::Incomplete {
                lines,
                first,
                damaged,
            } => incomplete(f, *lines, first, damaged.as_deref()),
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

fn incomplete(
    f: &mut fmt::Formatter<'_>,
    lines: u64,
    (file, line): &(String, u64),
    damaged: Option<&str>,
) -> fmt::Result {
    if lines > 0 {
        let be = if lines == 1 { "line is" } else { "lines are" };
        let file = printable(file);
        write!(
            f,
            "{lines} {be} cut or can't be read, the first in {file} line {line}"
        )?;
    }
    if let Some(file) = damaged {
        let and = if lines > 0 { ", and " } else { "" };
        write!(
            f,
            "{and}the end of {} is missing or damaged",
            printable(file)
        )?;
    }
    f.write_str("; the rest was used: copy the log again, or check the program that writes it")
}
