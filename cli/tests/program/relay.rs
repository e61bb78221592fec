//! The program on a bus of socketcand, behind a relay that sees what the program sends.
//!
//! In: the bus, arguments, and what to do at a frame, before the bus has it: what answers it cannot
//! come first. Out: what the program has come to. Frames pass in both directions until the program
//! ends or the relay is told to end, which closes the connection on both sides.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::process::{Child, Stdio};
use std::thread;

use super::{Said, plumb, said};

/// Whether a relay goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// It passes on the frame and what comes.
    Goes,
    /// It passes on the frame, and the connection is cut.
    Ends,
}

/// Runs the program with these arguments on this bus; `at` is told of each frame of the program.
pub fn run(bus: &str, words: &[&str], mut at: impl FnMut(&mut Child, u16, &[u8]) -> Next) -> Said {
    let door = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = door.local_addr().unwrap().to_string();
    let mut program = plumb(&[words, &["--bus", &address]].concat());
    let program = program.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut program = program.spawn().unwrap();

    let (mut from, _) = door.accept().unwrap();
    let mut to = TcpStream::connect(bus).unwrap();
    let (mut answers, mut back) = (to.try_clone().unwrap(), from.try_clone().unwrap());
    thread::scope(|scope| {
        scope.spawn(move || {
            let _ = std::io::copy(&mut answers, &mut back);
            let _ = back.shutdown(Shutdown::Both);
        });
        pass(&mut from, &mut to, |id, data| at(&mut program, id, data));
        let _ = to.shutdown(Shutdown::Both);
    });
    said(&program.wait_with_output().unwrap())
}

/// Passes on what the program sends.
fn pass(from: &mut TcpStream, to: &mut TcpStream, mut at: impl FnMut(u16, &[u8]) -> Next) {
    let (mut text, mut bytes) = (String::new(), [0; 4096]);
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        text += &String::from_utf8_lossy(&bytes[..count]);
        while let Some(end) = text.find('>') {
            let command: String = text.drain(..=end).collect();
            let sent = frame(command.trim_matches(|c: char| "<> ".contains(c)));
            let next = sent.map_or(Next::Goes, |(id, data)| at(id, &data));
            if to.write_all(command.as_bytes()).is_err() || next == Next::Ends {
                return;
            }
        }
    }
}

/// A command of socketcand as a frame; `None` for what sends none.
fn frame(command: &str) -> Option<(u16, Vec<u8>)> {
    let mut words = command.split_whitespace();
    words.find(|word| *word == "send")?;
    let id = u16::from_str_radix(words.next()?, 16).ok()?;
    let bytes = words.skip(1).map(|byte| u8::from_str_radix(byte, 16).ok());
    Some((id, bytes.collect::<Option<_>>()?))
}
