//! Clients over TCP, socketcand and SLCAN alike.
//!
//! In: an address to listen on. Out: a reader and a writer thread for each client. The reader
//! stands still while the bus has too many frames of its client, which is slowed down by TCP; the
//! writer sends all that waits in one piece, without delay. There is room for a limited number of
//! clients, so one that does not open the bus has to go after a while.
//!
//! Left out: encryption. The default address is that of this machine alone.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::dialogue::{Dialogue, Heard};
use super::outlet::Outlet;
use super::shared::{Client, Port, Shared};
use super::{slcan, socketcand};
use crate::error::ServeError;
use crate::threads;

/// A write that makes no progress for so long ends the connection.
const WRITE_TIMEOUT: Duration = Duration::from_secs(5);

/// How long a client that is shown the door may take to read why.
const FAREWELL: Duration = Duration::from_millis(200);

/// Listens for socketcand clients.
pub fn listen_socketcand(
    shared: &Arc<Shared>,
    at: SocketAddr,
    bus_name: &str,
) -> Result<SocketAddr, ServeError> {
    if !can_text::socketcand::is_bus_name(bus_name) {
        return Err(ServeError::BusName(bus_name.to_owned()));
    }
    let name = bus_name.to_owned();
    listen(shared, at, ("socketcand", "--listen"), move || {
        let session = socketcand::Session::new(&name);
        (socketcand::GREETING, Box::new(session))
    })
}

/// Listens for SLCAN clients.
pub fn listen_slcan(shared: &Arc<Shared>, at: SocketAddr) -> Result<SocketAddr, ServeError> {
    listen(shared, at, ("SLCAN", "--slcan"), || {
        (b"", Box::new(slcan::Session::new()))
    })
}

fn listen(
    shared: &Arc<Shared>,
    at: SocketAddr,
    (kind, option): (&'static str, &'static str),
    welcome: impl Fn() -> (&'static [u8], Box<dyn Dialogue>) + Send + 'static,
) -> Result<SocketAddr, ServeError> {
    let shared = Arc::clone(shared);
    threads::listen(at, option, move |stream, from| {
        if shared.is_stopped() {
            return ControlFlow::Break(());
        }
        let (greeting, dialogue) = welcome();
        let label = format!("{kind} client {from}");
        if let Err(why) = start(&shared, stream, &label, greeting, dialogue) {
            shared.notice(format!("{label} refused: {why}"));
        }
        ControlFlow::Continue(())
    })
}

fn start(
    shared: &Arc<Shared>,
    stream: TcpStream,
    label: &str,
    greeting: &[u8],
    dialogue: Box<dyn Dialogue>,
) -> Result<(), String> {
    let prepared = (|| {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(WRITE_TIMEOUT))?;
        Ok((stream.try_clone()?, stream.try_clone()?))
    })();
    let (writing, ending) = prepared.map_err(|e: std::io::Error| e.to_string())?;
    let port = Port::Tcp(Outlet::new(), ending);
    let Some(client) = shared.join(label.to_owned(), port) else {
        return Ok(());
    };
    shared.notice_of(&client, "connected");
    if let Some(outlet) = client.outlet() {
        // An empty queue has room for a greeting.
        let _ = outlet.answer(greeting);
    }
    let started = shared.start(
        &client,
        move |shared, client| write(shared, client, writing),
        move |shared, client| read(shared, client, stream, dialogue),
    );
    started.map_err(|error| {
        shared.leave(&client, "dropped");
        error.to_string()
    })
}

fn write(shared: &Shared, client: &Client, mut stream: TcpStream) {
    let Some(outlet) = client.outlet() else {
        return;
    };
    let mut bytes = Vec::new();
    while outlet.next(&mut bytes).is_some() {
        if let Err(error) = stream.write_all(&bytes) {
            shared.leave(
                client,
                &format!("dropped: it can't be written to ({error})"),
            );
            // Ends the reader too.
            let _ = stream.shutdown(Shutdown::Both);
            return;
        }
    }
    let _ = stream.shutdown(Shutdown::Write);
}

/// How long a client may still stay with the bus closed; `None` while it has it open.
struct TimeLimit {
    open_within: Duration,
    until: Option<Instant>,
}

impl TimeLimit {
    /// Sets how long the next read may take; false when the time is over.
    fn look(&mut self, is_open: bool, stream: &TcpStream) -> bool {
        if is_open {
            if self.until.take().is_some() {
                // A read that never ends is what a socket has from the beginning.
                let _ = stream.set_read_timeout(None);
            }
            return true;
        }
        let now = Instant::now();
        let until = *self.until.get_or_insert(now + self.open_within);
        let left = until.saturating_duration_since(now);
        // No time at all would mean no end.
        !left.is_zero() && stream.set_read_timeout(Some(left)).is_ok()
    }
}

/// A read that was interrupted, or has taken all the time that it had.
const fn is_passing(kind: ErrorKind) -> bool {
    use ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(kind, Interrupted | TimedOut | WouldBlock)
}

fn read(shared: &Shared, client: &Client, mut stream: TcpStream, mut dialogue: Box<dyn Dialogue>) {
    let mut bytes = [0; 4096];
    let mut heard = Heard::default();
    let mut limit = TimeLimit {
        open_within: shared.open_within,
        until: None,
    };
    loop {
        if !limit.look(dialogue.is_open(), &stream) {
            let why = format!("the bus was not opened within {:?}", shared.open_within);
            heard.answer.extend(dialogue.refusal(&why));
            heard.close = Some(why);
        } else {
            match stream.read(&mut bytes) {
                Ok(0) => break shared.leave(client, "left"),
                Ok(length) => dialogue.hear(&bytes[..length], &mut heard),
                Err(error) if is_passing(error.kind()) => {}
                Err(error) => break shared.leave(client, &format!("left ({error})")),
            }
        }
        if !shared.act(client, &mut heard) {
            let why = heard.close.take().unwrap_or_default();
            break shared.leave(client, &format!("dropped: {why}"));
        }
    }
    if let Some(outlet) = client.outlet() {
        outlet.end();
    }
    // Closing with bytes unread would take the last answer away from the client.
    let _ = stream.set_read_timeout(Some(FAREWELL));
    for _ in 0..64 {
        if !matches!(stream.read(&mut bytes), Ok(length) if length > 0) {
            break;
        }
    }
    // Whatever still holds a handle of this connection, it ends here.
    let _ = stream.shutdown(Shutdown::Both);
}
