//! Why a log can't be read: one sentence that names the file and what to do.

use output::printable;
use output::unreadable::Unreadable;

/// A log that can't be read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// This file or folder can't be read, from its start or in the middle.
    #[error("{0}")]
    Read(#[from] Unreadable),
    /// This file is no log.
    #[error(
        "{a} is no log of a CAN bus: give what candump -L or an ASC logger has written",
        a = printable(.0)
    )]
    NotALog(String),
    /// This file is a log of this format, which is not read.
    #[error(
        "{a} is a {1} log, which is not read: make a candump or ASC log of it, as with `python3 \
         -m can.logconvert`",
        a = printable(.0)
    )]
    Foreign(String, &'static str),
    /// So many lines, and the ends of so many files, could not be read: the file and line of the
    /// first. What could be was used.
    #[error(
        "{a}; the rest was used: copy the log again, or check the program that writes it",
        a = incomplete(*.lines, .first, .damaged.as_deref())
    )]
    Incomplete {
        /// Lines that are cut, unreadable or too long.
        lines: u64,
        /// Where the first of them stands.
        first: (String, u64),
        /// The first compressed file whose end is missing or damaged.
        damaged: Option<String>,
    },
    /// This file is a text of 16-bit characters.
    #[error(
        "{a} is UTF-16 text: convert it to UTF-8, or redirect to a file from another shell",
        a = printable(.0)
    )]
    Wide(String),
    /// This folder holds no log.
    #[error(
        "{a} holds no log of a CAN bus; name the folder that does, or a file",
        a = printable(.0)
    )]
    NoLogs(String),
    /// So many logs overlap in time.
    #[error("{0} logs overlap in time; give fewer at once, or one folder at a time")]
    TooManyAtOnce(usize),
    /// The end that is asked for is not behind the beginning.
    #[error("--to is not after --from: swap them")]
    NoTime,
    /// No frame is of the interface that was asked for; those that there are.
    #[error(
        "no frame is of the interface {a}: there are {b}",
        a = printable(.0),
        b = printable(&.1.join(", "))
    )]
    NoSuchInterface(String, Vec<String>),
}

fn incomplete(lines: u64, (file, line): &(String, u64), damaged: Option<&str>) -> String {
    let mut text = String::new();
    if lines > 0 {
        let be = if lines == 1 { "line is" } else { "lines are" };
        let file = printable(file);
        text += &format!("{lines} {be} cut or can't be read, the first in {file} line {line}");
    }
    if let Some(file) = damaged {
        let and = if lines > 0 { ", and " } else { "" };
        let file = printable(file);
        text += &format!("{and}the end of {file} is missing or damaged");
    }
    text
}
