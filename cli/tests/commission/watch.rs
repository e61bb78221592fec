//! A verb on the bus that is interrupted at a frame of the LSS master.

use std::io::{BufReader, prelude::*};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use super::bench::*;

/// A second client of the bus, which sees the frames of the first.
pub struct Watch(BufReader<TcpStream>);

impl Watch {
    pub fn new(bench: &Bench) -> Self {
        let mut stream = TcpStream::connect(&bench.bus).unwrap();
        write!(stream, "< open plumb >< rawmode >").unwrap();
        sleep(Duration::from_millis(200));
        Self(BufReader::new(stream))
    }

    /// Sends a request of the LSS master.
    pub fn request(&mut self, bytes: &str) {
        write!(self.0.get_mut(), "< send 7E5 8 {bytes} >").unwrap();
    }

    /// Waits for a request of the LSS master that begins so.
    pub fn until(&mut self, begin: &str) {
        self.until_frame("7E5", begin);
    }

    /// Waits for a frame of this identifier that begins so.
    pub fn until_frame(&mut self, id: &str, begin: &str) {
        loop {
            let mut word = Vec::new();
            assert!(self.0.read_until(b'>', &mut word).unwrap() > 0, "{begin}");
            let word = String::from_utf8_lossy(&word).into_owned();
            let mut parts = word.split_whitespace().skip_while(|part| *part != "frame");
            let is_one = parts
                .nth(1)
                .is_some_and(|found| found.eq_ignore_ascii_case(id));
            if is_one && parts.nth(1).is_some_and(|bytes| bytes.starts_with(begin)) {
                return;
            }
        }
    }
}

/// A verb under way.
pub fn begin(bench: &Bench, words: &[&str]) -> Child {
    let mut change = plumb(&[words, &["--bus", &bench.bus]].concat());
    let pipes = change.stdout(Stdio::piped()).stderr(Stdio::piped());
    pipes.spawn().unwrap()
}

/// What a change says that is interrupted now.
pub fn interrupted(change: Child) -> String {
    let id = change.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status().unwrap();
    assert!(sent.success());
    let (status, _, err) = said(&change.wait_with_output().unwrap());
    assert_eq!(status, Some(2), "{err}");
    assert_eq!(err.lines().count(), 1, "{err}");
    err
}
