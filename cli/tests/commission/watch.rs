//! A verb on the bus that is interrupted at one of its frames.

use std::io::Write;
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use super::bench::*;
use crate::program::relay::{Next, Relay};

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

/// Sends a request of the LSS master.
pub fn request(bench: &Bench, bytes: &str) {
    let mut stream = TcpStream::connect(&bench.bus).unwrap();
    write!(
        stream,
        "< open plumb >< rawmode >< send {LSS:X} 8 {bytes} >"
    )
    .unwrap();
    thread::sleep(Duration::from_millis(400));
}

/// What a verb says that is interrupted at this frame, and how its frames begin behind that.
pub fn interrupted(bus: &str, words: &[&str], at: At, mut before: impl FnMut()) -> Interrupted {
    let relay = Relay::to(bus);
    let mut program = plumb(&[words, &["--bus", &relay.address()]].concat());
    let pipes = program.stdout(Stdio::piped()).stderr(Stdio::piped());
    let program = pipes.spawn().unwrap();
    let id = program.id().to_string();
    let (mut found, mut behind) = (0, Vec::new());
    let ended = thread::spawn(move || said(&program.wait_with_output().unwrap()));
    relay.pass(|sent, data| {
        if found == at.number {
            behind.push((sent, data.to_vec()));
        } else if sent == at.id && data.starts_with(at.begin) {
            found += 1;
            if found == at.number {
                before();
                let sent = Command::new("kill").args(["-INT", &id]).status().unwrap();
                assert!(sent.success());
            }
        }
        Next::Goes
    });
    let (status, _, err) = ended.join().unwrap();
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
