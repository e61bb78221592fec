//! A verb on the bus that is interrupted at one of its frames.

use super::bench::*;
use crate::program::interrupt;
use crate::program::relay::{self, Next};

/// The identifier of the LSS master's requests.
pub const LSS: u16 = 0x7E5;

/// A frame of a verb.
#[derive(Clone, Copy, Debug)]
pub struct At {
    /// Its identifier.
    pub id: u16,
    /// How it begins.
    pub begin: &'static [u8],
    /// Which of those it is, from 1.
    pub number: usize,
}

impl At {
    /// The first request of the LSS master that begins with this command.
    pub const fn first(command: &'static [u8; 1]) -> Self {
        Self {
            id: LSS,
            begin: command,
            number: 1,
        }
    }
}

/// What a verb prints that is interrupted at this frame, and what it has sent since.
pub fn interrupted(bench: &Bench, words: &[&str], at: At) -> Interrupted {
    interrupted_behind(&bench.bus, words, at, || ())
}

/// What a verb prints that is interrupted at this frame when no node has its supply any more.
pub fn interrupted_on_a_dead_bus(bench: &mut Bench, words: &[&str], at: At) -> String {
    let bus = bench.bus.clone();
    let dies = || {
        bench.word("power all off");
        bench.pass(0.2);
    };
    interrupted_behind(&bus, words, at, dies).err
}

fn interrupted_behind(bus: &str, words: &[&str], at: At, mut first: impl FnMut()) -> Interrupted {
    let (mut found, mut behind) = (0, Vec::new());
    let (status, _, err) = relay::run(bus, words, |program, id, data| {
        if found == at.number {
            behind.push((id, data.to_vec()));
        } else if id == at.id && data.starts_with(at.begin) {
            found += 1;
            if found == at.number {
                first();
                interrupt(program);
            }
        }
        Next::Goes
    });
    assert_eq!(status, Some(2), "{err}");
    assert_eq!(err.lines().count(), 1, "{err}");
    Interrupted { err, behind }
}

/// How a verb has ended that was interrupted.
pub struct Interrupted {
    /// Its sentence.
    pub err: String,
    /// Identifier and data of what it has sent since.
    pub behind: Vec<(u16, Vec<u8>)>,
}
