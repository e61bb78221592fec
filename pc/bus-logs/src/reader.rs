//! The frames of one log.
//!
//! In: an open [`Input`] and its [`Kind`]. Out: frame after frame, and in [`Skipped`] every line
//! that is none. A last line without its line end is counted as cut even where it could be read:
//! nothing tells whether all of its bytes are there.

use std::io;

use crate::asc::Asc;
use crate::folder::cannot_read;
use crate::input::Input;
use crate::lines::Line;
use crate::skipped::{Damage, Skip, Skipped};
use crate::sniff::Kind;
use crate::{LogError, Logged, candump};

/// Interfaces by order of appearance.
#[derive(Clone, Debug, Default)]
pub struct Interfaces {
    names: Vec<String>,
    /// The place of the one seen last, since most frames are of that.
    last: usize,
    /// The only one whose frames are given.
    only: Option<String>,
}

impl Interfaces {
    /// All interfaces, or one of them.
    pub fn new(only: Option<String>) -> Self {
        Self {
            only,
            ..Self::default()
        }
    }

    /// Their names.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The place of an interface.
    #[inline]
    fn place(&mut self, name: &[u8]) -> Result<u8, Skip> {
        let is_last = self
            .names
            .get(self.last)
            .is_some_and(|n| n.as_bytes() == name);
        if !is_last {
            self.last = self.find(name)?;
        }
        let wanted = self
            .only
            .as_ref()
            .is_none_or(|only| only.as_bytes() == name);
        // 255 places at most.
        if wanted {
            Ok(self.last as u8)
        } else {
            Err(Skip::OtherInterface)
        }
    }

    fn find(&mut self, name: &[u8]) -> Result<usize, Skip> {
        let known = self.names.iter().position(|n| n.as_bytes() == name);
        if let Some(place) = known {
            return Ok(place);
        }
        if self.names.len() >= 255 {
            return Err(Skip::TooManyInterfaces);
        }
        // A name that is no text is a line that is none.
        let name = str::from_utf8(name).map_err(|_| Skip::Unreadable)?;
        self.names.push(name.to_owned());
        Ok(self.names.len() - 1)
    }
}

/// Reads one log.
pub struct Reader {
    name: String,
    file: usize,
    input: Input,
    dialect: Dialect,
    shift_ns: u64,
    before_ns: u64,
    end_ns: u64,
}

enum Dialect {
    Candump,
    Asc(Asc),
}

impl Reader {
    /// Frames of the file with this place and name, whose times are late by `shift_ns`.
    pub fn new(name: String, file: usize, input: Input, kind: Kind, shift_ns: u64) -> Self {
        Self {
            name,
            file,
            input,
            dialect: match kind {
                Kind::Candump => Dialect::Candump,
                Kind::Asc => Dialect::Asc(Asc::default()),
            },
            shift_ns,
            before_ns: 0,
            end_ns: 0,
        }
    }

    /// The latest time of a frame that was read.
    pub const fn end_ns(&self) -> u64 {
        self.end_ns
    }

    /// The next frame; `None` at the end.
    #[inline]
    pub fn next(
        &mut self,
        interfaces: &mut Interfaces,
        skipped: &mut Skipped,
    ) -> Result<Option<Logged>, LogError> {
        loop {
            let (line, is_whole) = match self.input.next_line() {
                Ok(Some(Line::Whole(line))) => (line, true),
                Ok(Some(Line::Unended(line))) => (line, false),
                Ok(Some(Line::TooLong(_))) => {
                    skipped.add(Skip::TooLong, self.file, self.input.number());
                    continue;
                }
                Ok(None) => {
                    // What follows a compressed text is none of it, but was meant to be read.
                    if self.input.take_trailing_bytes() {
                        skipped.damaged.push((self.file, Damage::Corrupt));
                    }
                    return Ok(None);
                }
                Err(error) => {
                    self.give_up(error, skipped)?;
                    continue;
                }
            };
            let read = match &mut self.dialect {
                Dialect::Candump => candump::parse(line),
                Dialect::Asc(asc) => asc.parse(line),
            };
            let read = read.and_then(|(time_ns, interface, frame)| {
                let whole = is_whole.then_some(()).ok_or(Skip::Cut);
                whole.and_then(|()| Ok((time_ns, interfaces.place(interface)?, frame)))
            });
            match read {
                Ok((time_ns, interface, frame)) => {
                    let time_ns = time_ns.saturating_add(self.shift_ns);
                    // A step back counts once, and not until the old time is reached again.
                    if time_ns < self.before_ns {
                        skipped.backwards.add(self.file, self.input.number());
                    }
                    self.before_ns = time_ns;
                    self.end_ns = self.end_ns.max(time_ns);
                    return Ok(Some(Logged {
                        time_ns,
                        interface,
                        frame,
                    }));
                }
                Err(kind) => skipped.add(kind, self.file, self.input.number()),
            }
        }
    }

    /// The end of a compressed file may be missing; what comes before it counts.
    fn give_up(&self, error: io::Error, skipped: &mut Skipped) -> Result<(), LogError> {
        let Some(damage) = self.input.damage(&error) else {
            return Err(cannot_read(self.name.as_ref(), error));
        };
        skipped.damaged.push((self.file, damage));
        Ok(())
    }
}
