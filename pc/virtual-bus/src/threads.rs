//! Threads with a name, what they share, and listening for connections.
//!
//! In: the work of a thread; or an address, and what to do with each connection. Out: a thread,
//! and where it listens.
//!
//! Left out: what is spoken on a connection (`clients/tcp`, `ports/line_server`).

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::ops::ControlFlow;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use crate::error::ServeError;

/// How long to wait after a connection that failed before the next one is accepted.
const PAUSE: Duration = Duration::from_millis(20);

/// Starts a thread with a name.
///
/// Errors: [`ServeError::Thread`].
pub fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> Result<(), ServeError> {
    let thread = thread::Builder::new().name(name.to_owned()).spawn(work);
    thread.map(drop).map_err(ServeError::Thread)
}

/// What a mutex guards, also behind a thread that has ended in the middle of its work.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Listens there, at any free port for 0, and gives each connection to `each` until that breaks.
/// `option` is the one that asks for it. Returns where.
///
/// Errors: [`ServeError::PortInUse`], [`ServeError::Listen`], [`ServeError::Thread`].
pub fn listen(
    at: SocketAddr,
    option: &'static str,
    mut each: impl FnMut(TcpStream, SocketAddr) -> ControlFlow<()> + Send + 'static,
) -> Result<SocketAddr, ServeError> {
    let failed = |error: io::Error| match error.kind() {
        ErrorKind::AddrInUse => ServeError::PortInUse(at, option),
        _ => ServeError::Listen(at, option, error),
    };
    let listener = TcpListener::bind(at).map_err(failed)?;
    let at = listener.local_addr().map_err(failed)?;
    spawn("listener", move || {
        loop {
            let Ok((stream, from)) = listener.accept() else {
                // Too many files open, or a client that went at once: neither ends the listening.
                thread::sleep(PAUSE);
                continue;
            };
            if each(stream, from).is_break() {
                return;
            }
        }
    })?;
    Ok(at)
}
