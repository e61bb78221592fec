//! Where programs that turn the virtual motor connect: lines over TCP.
//!
//! In: an address. Out: each line with a way to answer it, in the order in which they came. Each
//! connection has a thread, which waits for the answer before it reads on.
//!
//! Left out: what the lines mean (`motor`).

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::Duration;

use super::error::ServeError;
use super::motor::{Answer, Table};
use super::stage::Stage;

/// The longest line.
const LINE_LIMIT: u64 = 256;

/// A line of a client, and where its answer goes; an empty one for none.
#[derive(Debug)]
struct Request {
    line: String,
    answer: Sender<String>,
}

/// The port with the motor behind it.
#[derive(Debug)]
pub struct MotorPort {
    table: Table,
    requests: Receiver<Request>,
    /// Those who wait until the housing stands.
    waiting: Vec<Sender<String>>,
    /// Where it listens.
    pub at: SocketAddr,
}

impl MotorPort {
    /// Listens there; port 0 is any free one.
    ///
    /// Errors: [`ServeError::PortInUse`], [`ServeError::Listen`].
    pub fn listen(at: SocketAddr, seed: u64) -> Result<Self, ServeError> {
        let failed = |error: std::io::Error| match error.kind() {
            ErrorKind::AddrInUse => ServeError::PortInUse(at),
            _ => ServeError::Listen(at, error),
        };
        let listener = TcpListener::bind(at).map_err(failed)?;
        let at = listener.local_addr().map_err(failed)?;
        let (sender, requests) = channel();
        thread::spawn(move || accept(&listener, &sender));
        Ok(Self {
            table: Table::new(seed),
            requests,
            waiting: Vec::new(),
            at,
        })
    }

    /// Carries out what has come, and answers those who waited for the housing to stand.
    pub fn serve(&mut self, stage: &mut Stage) {
        while let Ok(Request { line, answer }) = self.requests.try_recv() {
            // Whoever has gone needs no answer.
            let _ = match self.table.hear(&line, stage) {
                Answer::Nothing => answer.send(String::new()),
                Answer::Line(text) => answer.send(text),
                Answer::WhenStill => {
                    self.waiting.push(answer);
                    Ok(())
                }
            };
        }
        if stage.is_still() {
            for answer in self.waiting.drain(..) {
                let _ = answer.send("1".to_owned());
            }
        }
    }
}

fn accept(listener: &TcpListener, requests: &Sender<Request>) {
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                let requests = requests.clone();
                thread::spawn(move || converse(stream, &requests));
            }
            // Too many files open, or a client that went at once: neither ends the listening.
            Err(_) => thread::sleep(Duration::from_millis(20)),
        }
    }
}

/// Reads lines until the client goes, the bus ends, or a line is longer than any that means
/// something.
fn converse(mut stream: TcpStream, requests: &Sender<Request>) {
    let Ok(reading) = stream.try_clone() else {
        return;
    };
    let _ = stream.set_nodelay(true);
    let mut reader = BufReader::new(reading);
    loop {
        let mut bytes = Vec::new();
        let read = (&mut reader).take(LINE_LIMIT).read_until(b'\n', &mut bytes);
        if !matches!(read, Ok(count) if count > 0) || bytes.last() != Some(&b'\n') {
            return;
        }
        let line = String::from_utf8_lossy(&bytes).into_owned();
        let (answer, said) = channel();
        if requests.send(Request { line, answer }).is_err() {
            return;
        }
        let Ok(said) = said.recv() else {
            return;
        };
        if !said.is_empty() && stream.write_all(format!("{said}\n").as_bytes()).is_err() {
            return;
        }
    }
}
