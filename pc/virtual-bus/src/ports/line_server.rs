//! Programs that speak to the virtual instrument in lines over TCP.
//!
//! In: an address. Out: each line with a way to answer it, in the order in which they came. Each
//! connection has a thread, which waits for the answer before it reads on.
//!
//! Left out: what the lines mean (`line_port`, `twin`).

use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::ops::ControlFlow;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use crate::error::ServeError;
use crate::threads::{listen, spawn};

/// How long the last answer may take to be written before the program ends.
const FAREWELL: Duration = Duration::from_secs(1);

/// How conversations are held.
#[derive(Clone, Copy, Debug)]
pub struct Manner {
    /// The line that a client is told first; none when empty.
    pub greeting: &'static str,
    /// The longest line, bytes.
    pub longest: u64,
}

/// A line of a client, and where its answer goes. Who drops it unanswered ends the conversation.
#[derive(Debug)]
pub struct Request {
    /// `None` for a line that is too long.
    line: Option<String>,
    answer: Sender<String>,
    /// Closed as soon as the answer is written.
    written: Receiver<()>,
}

impl Request {
    /// The line; `None` for one that is longer than any that means something.
    pub fn line(&self) -> Option<&str> {
        self.line.as_deref()
    }

    /// Answers by one line; an empty one is no answer at all, and the client may go on.
    pub fn answer(&self, line: &str) {
        // Whoever has gone needs no answer.
        let _ = self.answer.send(line.to_owned());
    }

    /// As [`Request::answer`], for a program that ends behind it.
    pub fn answer_last(&self, line: &str) {
        self.answer(line);
        // Nothing is ever sent: it closes, or its client does not read.
        let _ = self.written.recv_timeout(FAREWELL);
    }
}

/// Listens, and takes lines of all who connect.
#[derive(Debug)]
pub struct LineServer {
    requests: Receiver<Request>,
    /// Where it listens.
    pub at: SocketAddr,
}

impl LineServer {
    /// Listens there; port 0 is any free one. `option` is the one that asks for it.
    ///
    /// Errors: [`ServeError::PortInUse`], [`ServeError::Listen`], [`ServeError::Thread`].
    pub fn listen(
        at: SocketAddr,
        option: &'static str,
        manner: Manner,
    ) -> Result<Self, ServeError> {
        let (sender, requests) = channel();
        let at = listen(at, option, move |stream, _| {
            let sender = sender.clone();
            // Without a thread the connection closes, which is all that can be said.
            let _ = spawn("line", move || {
                // A client that goes is no error, whatever it was in the middle of.
                let _ = converse(stream, manner, &sender);
            });
            ControlFlow::Continue(())
        })?;
        Ok(Self { requests, at })
    }

    /// The next line, when one has come.
    pub fn next(&self) -> Option<Request> {
        self.requests.try_recv().ok()
    }
}

/// Reads lines until the client goes, the bus ends, or nobody answers.
fn converse(mut stream: TcpStream, manner: Manner, requests: &Sender<Request>) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let mut reader = BufReader::new(stream.try_clone()?);
    write_line(&mut stream, manner.greeting)?;
    while let Some(bytes) = read_line(&mut reader, manner.longest)? {
        let is_whole = bytes.ends_with(b"\n");
        // What is not UTF-8 becomes an unknown word, and is named as such.
        let line = is_whole.then(|| String::from_utf8_lossy(&bytes).into_owned());
        // A page in a browser can make it send any lines here, but behind one like this.
        if line.as_ref().is_some_and(|line| line.contains(" HTTP/")) {
            return Ok(());
        }
        let (answer, said) = channel();
        let (writing, written) = channel();
        let request = Request {
            line,
            answer,
            written,
        };
        let answered = requests.send(request).ok().and_then(|()| said.recv().ok());
        let Some(said) = answered else {
            return Ok(());
        };
        write_line(&mut stream, &said)?;
        drop::<Sender<()>>(writing);
        if !is_whole {
            reader.skip_until(b'\n')?;
        }
    }
    Ok(())
}

/// A line with its end, or the begin of one that is longer; `None` when the client has gone, in the
/// middle of a line too.
fn read_line(reader: &mut impl BufRead, longest: u64) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    let count = reader.take(longest).read_until(b'\n', &mut bytes)?;
    let is_all = bytes.ends_with(b"\n") || count as u64 == longest;
    Ok(is_all.then_some(bytes))
}

fn write_line(stream: &mut TcpStream, line: &str) -> io::Result<()> {
    match line {
        "" => Ok(()),
        line => stream.write_all(format!("{line}\n").as_bytes()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is read of this, with at most eight bytes a line.
    fn read(text: &[u8]) -> Option<Vec<u8>> {
        read_line(&mut BufReader::new(text), 8).unwrap()
    }

    #[test]
    fn half_a_line_of_a_client_that_has_gone_is_none() {
        assert_eq!(read(b"quit\nx"), Some(b"quit\n".to_vec()));
        assert_eq!(read(b"quit"), None);
        assert_eq!(read(b""), None);
    }

    #[test]
    fn of_a_long_line_no_more_than_its_begin_is_kept() {
        assert_eq!(read(b"1234567\n"), Some(b"1234567\n".to_vec()));
        assert_eq!(read(b"123456789\n"), Some(b"12345678".to_vec()));
    }
}
