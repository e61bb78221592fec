//! A relay between the program and a bus of socketcand: it sees what the program sends.
//!
//! In: the bus, and what to do at a frame, before the bus has it: what answers it cannot come
//! first. Out: frames pass in both directions until the program ends or the relay is told to end,
//! which closes the connection on both sides.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::thread;

/// Whether a relay goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// It passes on the frame and what comes.
    Goes,
    /// It passes on the frame, and the connection is cut.
    Ends,
}

/// A place to join the bus by.
pub struct Relay {
    door: TcpListener,
    bus: String,
}

impl Relay {
    /// One to this bus.
    pub fn to(bus: &str) -> Self {
        let door = TcpListener::bind("127.0.0.1:0").unwrap();
        let bus = bus.to_owned();
        Self { door, bus }
    }

    /// Where the program joins.
    pub fn address(&self) -> String {
        self.door.local_addr().unwrap().to_string()
    }

    /// Takes the program's connection and passes on what comes; `at` is told of each frame of the
    /// program before that. True where `at` has ended it, false where the program has.
    pub fn pass(&self, mut at: impl FnMut(u16, &[u8]) -> Next) -> bool {
        let (mut from, _) = self.door.accept().unwrap();
        let mut to = TcpStream::connect(&self.bus).unwrap();
        let (mut answers, mut back) = (to.try_clone().unwrap(), from.try_clone().unwrap());
        thread::scope(|scope| {
            scope.spawn(move || {
                let _ = std::io::copy(&mut answers, &mut back);
                let _ = back.shutdown(Shutdown::Both);
            });
            let ended = sent(&mut from, &mut to, &mut at);
            let _ = to.shutdown(Shutdown::Both);
            ended
        })
    }
}

fn sent(from: &mut TcpStream, to: &mut TcpStream, at: &mut impl FnMut(u16, &[u8]) -> Next) -> bool {
    let (mut text, mut bytes) = (String::new(), [0; 4096]);
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        text += &String::from_utf8_lossy(&bytes[..count]);
        while let Some(end) = text.find('>') {
            let command: String = text.drain(..=end).collect();
            let sent = frame(command.trim_matches(|c: char| "<> ".contains(c)));
            let next = sent.map_or(Next::Goes, |(id, data)| at(id, &data));
            if to.write_all(command.as_bytes()).is_err() {
                return false;
            }
            if next == Next::Ends {
                return true;
            }
        }
    }
    false
}

/// A command of socketcand as a frame; `None` for what sends none.
fn frame(command: &str) -> Option<(u16, Vec<u8>)> {
    let mut words = command.split_whitespace();
    words.find(|word| *word == "send")?;
    let id = u16::from_str_radix(words.next()?, 16).ok()?;
    let bytes = words.skip(1).map(|byte| u8::from_str_radix(byte, 16).ok());
    Some((id, bytes.collect::<Option<_>>()?))
}
