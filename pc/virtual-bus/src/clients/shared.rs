//! What the threads of all clients share.
//!
//! In: clients that come and go, what their bytes came to, and frames of the bus. Out: clients'
//! frames in their turn ([`RoundRobin`]), frames of the bus in each client's queue ([`Outlet`]),
//! and notices for the person at the bus.
//!
//! Left out: how clients connect (`tcp`, `pty`, `kernel`).

use std::net::{Shutdown, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use canopen::Frame;

use super::dialogue::Heard;
use super::outlet::{FRAMES_LIMIT, Full, Outlet, Tap};
use super::round_robin::{ClientId, Incoming, RoundRobin};
use crate::error::ServeError;
use crate::threads::{lock, spawn};

/// Frames of one client that may wait for the bus.
const INCOMING_LIMIT: usize = 1024;

/// Clients at the same time.
pub const CLIENTS_LIMIT: usize = 32;

/// Notices that may wait to be read; later ones are counted only.
const NOTICES_LIMIT: usize = 200;

/// Where the frames for a client go.
#[derive(Debug)]
pub enum Port {
    /// To a text that goes over TCP; the connection, to end it.
    Tcp(Outlet, TcpStream),
    /// To a text for the pseudo-terminal, which stays when its client goes.
    Pty(Outlet),
    /// To a CAN interface of the kernel; whether frames to it have been lost.
    Kernel(SyncSender<Frame>, AtomicBool),
}

/// A client, shared between the bus and its threads.
#[derive(Debug)]
pub struct Client {
    /// Which one.
    pub id: ClientId,
    label: String,
    /// Where its frames go.
    pub port: Port,
}

impl Client {
    /// Its text queue; `None` for the kernel.
    pub fn outlet(&self) -> Option<&Outlet> {
        match &self.port {
            Port::Tcp(outlet, _) | Port::Pty(outlet) => Some(outlet),
            Port::Kernel(..) => None,
        }
    }

    /// Queues a frame of the bus.
    pub fn offer(&self, frame: &Frame, time_us: u64) -> Result<(), Full> {
        match &self.port {
            Port::Tcp(outlet, _) | Port::Pty(outlet) => outlet.offer(frame, time_us),
            Port::Kernel(queue, losing) => match queue.try_send(*frame) {
                // Told once: a bus that nobody acknowledges loses every frame.
                Err(TrySendError::Full(_)) if !losing.swap(true, Ordering::Relaxed) => Err(Full),
                _ => Ok(()),
            },
        }
    }

    /// Ends its queue and its connection.
    pub fn end(&self) {
        if let Some(outlet) = self.outlet() {
            outlet.end();
        }
        if let Port::Tcp(_, stream) = &self.port {
            // It may be gone already, which is as good.
            let _ = stream.shutdown(Shutdown::Both);
        }
    }
}

/// What the person at the bus has not read yet.
#[derive(Debug, Default)]
struct Notices {
    kept: Vec<String>,
    lost: usize,
}

/// What the threads of all clients share.
#[derive(Debug)]
pub struct Shared {
    clients: Mutex<Vec<Arc<Client>>>,
    notices: Mutex<Notices>,
    incoming: Mutex<RoundRobin>,
    /// Something has come into `incoming`, or has gone out.
    pub moved: Condvar,
    /// How long a client may stay without opening the bus.
    pub open_within: Duration,
    last_id: AtomicU32,
    /// All threads are to end.
    pub stopped: AtomicBool,
}

impl Shared {
    /// Nobody yet; a client may stay for so long without opening the bus.
    pub fn new(open_within: Duration) -> Self {
        Self {
            clients: Mutex::default(),
            notices: Mutex::default(),
            incoming: Mutex::default(),
            moved: Condvar::new(),
            open_within,
            last_id: AtomicU32::new(0),
            stopped: AtomicBool::new(false),
        }
    }

    /// Those who are here.
    pub fn clients(&self) -> MutexGuard<'_, Vec<Arc<Client>>> {
        lock(&self.clients)
    }

    /// Adds a client; `None` when there are too many.
    pub fn join(&self, label: String, port: Port) -> Option<Arc<Client>> {
        let mut clients = self.clients();
        if clients.len() >= CLIENTS_LIMIT {
            self.notice(format!(
                "{label} refused: {CLIENTS_LIMIT} clients are here already"
            ));
            return None;
        }
        let id = ClientId(self.last_id.fetch_add(1, Ordering::Relaxed));
        let client = Arc::new(Client { id, label, port });
        clients.push(Arc::clone(&client));
        Some(client)
    }

    /// Starts the two threads of a client.
    ///
    /// Errors: [`ServeError::Thread`].
    pub fn start(
        self: &Arc<Self>,
        client: &Arc<Client>,
        write: impl FnOnce(&Self, &Client) + Send + 'static,
        read: impl FnOnce(&Self, &Client) + Send + 'static,
    ) -> Result<(), ServeError> {
        let (shared, writer) = (Arc::clone(self), Arc::clone(client));
        spawn("client writer", move || write(&shared, &writer))?;
        let (shared, reader) = (Arc::clone(self), Arc::clone(client));
        spawn("client reader", move || read(&shared, &reader))
    }

    /// Takes a client away and reports why; nothing when it is away already.
    pub fn leave(&self, client: &Client, why: &str) {
        let mut clients = self.clients();
        let before = clients.len();
        clients.retain(|other| other.id != client.id);
        if clients.len() < before && !self.is_stopped() {
            self.notice(format!("{} {why}", client.label));
        }
    }

    /// Tells the person at the bus.
    pub fn notice(&self, sentence: String) {
        let mut notices = lock(&self.notices);
        if notices.kept.len() < NOTICES_LIMIT {
            notices.kept.push(sentence);
        } else {
            notices.lost += 1;
        }
    }

    /// Tells the person at the bus something about a client.
    pub fn notice_of(&self, client: &Client, what: &str) {
        self.notice(format!("{} {what}", client.label));
    }

    /// What waits for the bus.
    pub fn incoming(&self) -> MutexGuard<'_, RoundRobin> {
        lock(&self.incoming)
    }

    /// Hands a client's frame to the bus, waiting while it has too many there; false at the end.
    pub fn submit(&self, client: &Client, frame: Frame) -> bool {
        let client = client.id;
        let is_full = |incoming: &mut RoundRobin| {
            incoming.waiting(client) >= INCOMING_LIMIT && !self.is_stopped()
        };
        let moved = self.moved.wait_while(self.incoming(), is_full);
        let mut incoming = moved.unwrap_or_else(PoisonError::into_inner);
        incoming.push(Incoming { client, frame });
        self.moved.notify_all();
        !self.is_stopped()
    }

    /// Carries out what a client said; false when the conversation is over.
    pub fn act(&self, client: &Client, heard: &mut Heard) -> bool {
        let Some(outlet) = client.outlet() else {
            return false;
        };
        if let Some((tap, hold)) = heard.tap.take() {
            outlet.tap(tap, hold);
        }
        if outlet.answer(&heard.answer).is_err() {
            heard.close = Some("it doesn't read the answers to its commands".to_owned());
        }
        heard.answer.clear();
        if !heard.frames.is_empty() {
            // A client that sends has read its answer, and may wait for what comes of its frame.
            outlet.release();
        }
        if let Some(notice) = heard.notice.take() {
            self.notice_of(client, &notice);
        }
        let mut frames = heard.frames.drain(..);
        frames.all(|frame| self.submit(client, frame)) && heard.close.is_none()
    }

    /// Tells the person at the bus that a client doesn't read, and drops it where that helps.
    pub fn drop_late(&self, client: &Client) {
        let why = "dropped: it doesn't read its frames";
        match &client.port {
            Port::Tcp(..) => {
                self.leave(client, &format!("{why}, {} kB wait", FRAMES_LIMIT >> 10));
                client.end();
            }
            Port::Pty(outlet) => {
                outlet.tap(Tap::Closed, Duration::ZERO);
                self.notice_of(client, &format!("{why}; it may open again"));
            }
            Port::Kernel(..) => {
                let why = "takes frames too slowly and loses some: does a node acknowledge them?";
                self.notice_of(client, why);
            }
        }
    }

    /// Who came, who went and why, since the last call: a sentence each.
    pub fn take_notices(&self) -> Vec<String> {
        let Notices { mut kept, lost } = std::mem::take(&mut *lock(&self.notices));
        if lost > 0 {
            kept.push(format!("{lost} more notices were not kept"));
        }
        kept
    }

    /// True when all threads are to end.
    pub fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notices_that_nobody_reads_are_counted() {
        let shared = Shared::new(Duration::ZERO);
        (0..NOTICES_LIMIT + 5).for_each(|_| shared.notice(String::new()));
        let told = shared.take_notices();
        assert_eq!(told.len(), NOTICES_LIMIT + 1);
        assert_eq!(told.last().unwrap(), "5 more notices were not kept");
    }
}
