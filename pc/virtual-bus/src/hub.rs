//! All CAN clients of one bus, whatever they speak.
//!
//! In: clients' frames, each with the client it came from; and each frame that was on the bus.
//! Out: the former to the one who runs the bus, the latter to every client but its sender, which
//! is what socketcand, SLCAN adapters and the kernel do alike. Every client has threads of its
//! own; the one who runs the bus never waits for any of them. What waits in either direction is
//! bounded: a client that sends too fast is slowed down by its own connection, and no other one
//! waits for it ([`RoundRobin`]); one that doesn't read is dropped with a notice.
//!
//! Left out: the bus itself (arbitration, timing), and clients' names and passwords.

use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use canopen::Frame;

use super::error::ServeError;
use super::outlet::{FRAMES_LIMIT, Full, Outlet, Tap};
use super::round_robin::RoundRobin;
use super::{pty, socketcan, tcp};

/// Frames of one client that may wait for the bus.
const INCOMING_LIMIT: usize = 1024;

/// How long a client may stay without opening the bus. A program does so at once; a person who
/// types the commands has the time to look them up.
const OPEN_WITHIN: Duration = Duration::from_secs(30);

/// Clients at the same time.
pub const CLIENTS_LIMIT: usize = 32;

/// Notices that may wait to be read; later ones are counted only.
const NOTICES_LIMIT: usize = 200;

/// One client for as long as it stays; never given twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientId(u32);

/// A frame that a client wants on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Incoming {
    /// Who wants it.
    pub client: ClientId,
    /// What.
    pub frame: Frame,
}

/// What a piece of a client's bytes came to.
#[derive(Debug, Default)]
pub struct Heard {
    /// Bytes to send back.
    pub answer: Vec<u8>,
    /// Frames for the bus, in order.
    pub frames: Vec<Frame>,
    /// A new form of the frames it gets, and how long the first of them are held back.
    pub tap: Option<(Tap, Duration)>,
    /// Something the person at the bus should know.
    pub notice: Option<String>,
    /// Why the conversation ends here.
    pub close: Option<String>,
}

/// A wire format, as one client speaks it.
pub trait Dialogue: Send {
    /// Takes the next bytes of the client; adds to `heard` what they came to.
    fn hear(&mut self, bytes: &[u8], heard: &mut Heard);

    /// True while the client has the bus open.
    fn is_open(&self) -> bool;

    /// The bytes that tell the client why it has to go; nothing where the format has no words.
    fn refusal(&self, _why: &str) -> Vec<u8> {
        Vec::new()
    }
}

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
    id: ClientId,
    label: String,
    port: Port,
}

impl Client {
    /// Its text queue; `None` for the kernel.
    pub fn outlet(&self) -> Option<&Outlet> {
        match &self.port {
            Port::Tcp(outlet, _) | Port::Pty(outlet) => Some(outlet),
            Port::Kernel(..) => None,
        }
    }

    fn offer(&self, frame: &Frame, time_us: u64) -> Result<(), Full> {
        match &self.port {
            Port::Tcp(outlet, _) | Port::Pty(outlet) => outlet.offer(frame, time_us),
            Port::Kernel(queue, losing) => match queue.try_send(*frame) {
                // Told once: a bus that nobody acknowledges loses every frame.
                Err(TrySendError::Full(_)) if !losing.swap(true, Ordering::Relaxed) => Err(Full),
                _ => Ok(()),
            },
        }
    }

    fn end(&self) {
        if let Some(outlet) = self.outlet() {
            outlet.end();
        }
        if let Port::Tcp(_, stream) = &self.port {
            // It may be gone already, which is as good.
            let _ = stream.shutdown(Shutdown::Both);
        }
    }
}

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
    moved: Condvar,
    /// How long a client may stay without opening the bus.
    pub open_within: Duration,
    last_id: AtomicU32,
    stopped: AtomicBool,
}

impl Shared {
    fn clients(&self) -> MutexGuard<'_, Vec<Arc<Client>>> {
        self.clients.lock().unwrap_or_else(PoisonError::into_inner)
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

    /// Takes a client away and says why; nothing when it is away already.
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
        let mut notices = self.notices.lock().unwrap_or_else(PoisonError::into_inner);
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

    fn incoming(&self) -> MutexGuard<'_, RoundRobin> {
        self.incoming.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Hands a client's frame to the bus, waiting while it has too many there; false at the end.
    pub fn submit(&self, client: &Client, frame: Frame) -> bool {
        let client = client.id;
        let mut incoming = self.incoming();
        while incoming.waiting(client) >= INCOMING_LIMIT && !self.is_stopped() {
            let moved = self.moved.wait(incoming);
            incoming = moved.unwrap_or_else(PoisonError::into_inner);
        }
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
        if let Some(notice) = heard.notice.take() {
            self.notice_of(client, &notice);
        }
        heard
            .frames
            .drain(..)
            .all(|frame| self.submit(client, frame))
            && heard.close.is_none()
    }

    /// True when all threads are to end.
    pub fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

/// Starts a thread with a name.
pub fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> Result<(), ServeError> {
    let thread = thread::Builder::new().name(name.to_owned()).spawn(work);
    thread.map(drop).map_err(ServeError::Thread)
}

/// The clients of a bus.
#[derive(Debug)]
pub struct Hub {
    shared: Arc<Shared>,
    listeners: Vec<SocketAddr>,
}

impl Hub {
    /// Nobody yet, and no way in.
    pub fn new() -> Self {
        Self::with_time_limit(OPEN_WITHIN)
    }

    /// The same, where a client may stay for so long without opening the bus.
    pub fn with_time_limit(open_within: Duration) -> Self {
        Self {
            shared: Arc::new(Shared {
                clients: Mutex::default(),
                notices: Mutex::default(),
                incoming: Mutex::default(),
                moved: Condvar::new(),
                open_within,
                last_id: AtomicU32::new(0),
                stopped: AtomicBool::new(false),
            }),
            listeners: Vec::new(),
        }
    }

    /// Listens for socketcand clients, who must open `bus_name`; with port 0 the system chooses
    /// one. Returns where.
    pub fn listen_socketcand(
        &mut self,
        at: SocketAddr,
        bus_name: &str,
    ) -> Result<SocketAddr, ServeError> {
        let at = tcp::listen_socketcand(&self.shared, at, bus_name)?;
        self.listening(at);
        Ok(at)
    }

    /// Listens for SLCAN clients; with port 0 the system chooses one. Returns where.
    pub fn listen_slcan(&mut self, at: SocketAddr) -> Result<SocketAddr, ServeError> {
        let at = tcp::listen_slcan(&self.shared, at)?;
        self.listening(at);
        Ok(at)
    }

    fn listening(&mut self, at: SocketAddr) {
        if !at.ip().is_loopback() {
            self.shared.notice(format!(
                "{at} is open to the network: whoever reaches it can read and write this bus"
            ));
        }
        self.listeners.push(at);
    }

    /// Makes a pseudo-terminal for one SLCAN client at a time. Returns the path it opens.
    pub fn open_pty(&mut self) -> Result<PathBuf, ServeError> {
        pty::open(&self.shared)
    }

    /// Joins a CAN interface of the kernel.
    pub fn open_kernel(&mut self, name: &str) -> Result<(), ServeError> {
        socketcan::open(&self.shared, name)
    }

    /// The frame whose turn it is to go onto the bus, of those clients that are `wanted`; `None`
    /// when none of them has one now.
    pub fn receive(&mut self, wanted: impl FnMut(ClientId) -> bool) -> Option<Incoming> {
        let received = self.shared.incoming().pop(wanted)?;
        self.shared.moved.notify_all();
        Some(received)
    }

    /// Waits until a client that is `wanted` wants a frame on the bus; false when none did for
    /// `timeout`.
    pub fn wait(&mut self, timeout: Duration, mut wanted: impl FnMut(ClientId) -> bool) -> bool {
        let moved = &self.shared.moved;
        let none = |incoming: &mut RoundRobin| !incoming.any(&mut wanted);
        let waited = moved.wait_timeout_while(self.shared.incoming(), timeout, none);
        let (incoming, waited) = waited.unwrap_or_else(PoisonError::into_inner);
        drop(incoming);
        !waited.timed_out()
    }

    /// Distributes a frame that was on the bus to all clients but its sender. The time in
    /// microseconds is shown to clients as it is, so count it from 1970 for those who want a date.
    pub fn send(&mut self, frame: &Frame, time_us: u64, from: Option<ClientId>) {
        let mut late = Vec::new();
        for client in self.shared.clients().iter() {
            if from != Some(client.id) && client.offer(frame, time_us).is_err() {
                late.push(Arc::clone(client));
            }
        }
        late.iter().for_each(|client| self.drop_late(client));
    }

    fn drop_late(&self, client: &Client) {
        let why = "dropped: it doesn't read its frames";
        match &client.port {
            Port::Tcp(..) => {
                self.shared
                    .leave(client, &format!("{why}, {} kB wait", FRAMES_LIMIT >> 10));
                client.end();
            }
            Port::Pty(outlet) => {
                outlet.tap(Tap::Closed, Duration::ZERO);
                self.shared
                    .notice_of(client, &format!("{why}; it may open again"));
            }
            Port::Kernel(..) => {
                let why = "takes frames too slowly and loses some: does a node acknowledge them?";
                self.shared.notice_of(client, why);
            }
        }
    }

    /// Clients for tests that have no connections.
    #[cfg(test)]
    pub fn made_up_clients() -> [ClientId; 3] {
        [0, 1, 2].map(ClientId)
    }

    /// Clients that have opened the bus, the kernel's interface among them.
    pub fn clients(&self) -> usize {
        let open = |client: &&Arc<Client>| client.outlet().is_none_or(Outlet::is_open);
        self.shared.clients().iter().filter(open).count()
    }

    /// True while a client has much to read: one who runs faster than real time should wait a
    /// little before the next frames, or lose that client.
    pub fn is_congested(&self) -> bool {
        let clients = self.shared.clients();
        let mut outlets = clients.iter().filter_map(|client| client.outlet());
        outlets.any(|outlet| outlet.waiting() > FRAMES_LIMIT / 4)
    }

    /// Who came, who went and why, since the last call: a sentence each.
    pub fn notices(&mut self) -> Vec<String> {
        let notices = &self.shared.notices;
        let mut taken =
            std::mem::take(&mut *notices.lock().unwrap_or_else(PoisonError::into_inner));
        if taken.lost > 0 {
            taken
                .kept
                .push(format!("{} more notices were not kept", taken.lost));
        }
        taken.kept
    }
}

impl Drop for Hub {
    fn drop(&mut self) {
        self.shared.stopped.store(true, Ordering::Relaxed);
        // Whoever has just seen that it goes on is waiting by now, and hears this.
        drop(self.shared.incoming());
        self.shared.moved.notify_all();
        self.shared
            .clients()
            .drain(..)
            .for_each(|client| client.end());
        for at in &mut self.listeners {
            // The listener waits for a connection, and looks whether to stop when it has one.
            if at.ip().is_unspecified() {
                at.set_ip(Ipv4Addr::LOCALHOST.into());
            }
            let _ = TcpStream::connect_timeout(at, Duration::from_millis(100));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::sync_channel;

    #[test]
    fn an_interface_that_is_behind_loses_frames_and_stays() {
        let mut hub = Hub::new();
        let (queue, frames) = sync_channel(1);
        let port = Port::Kernel(queue, AtomicBool::new(false));
        hub.shared
            .join("CAN interface can0".to_owned(), port)
            .unwrap();
        for number in 0..3 {
            hub.send(&Frame::data_frame(number, &[]), 0, None);
        }
        let told = hub.notices();
        assert_eq!(told.len(), 1);
        assert!(told[0].starts_with("CAN interface can0 takes frames too slowly"));
        assert_eq!(frames.recv().unwrap(), Frame::data_frame(0, &[]));
        hub.send(&Frame::data_frame(9, &[]), 0, None);
        assert_eq!(frames.recv().unwrap(), Frame::data_frame(9, &[]));
        assert_eq!(hub.clients(), 1);
    }

    #[test]
    fn notices_that_nobody_reads_are_counted() {
        let mut hub = Hub::new();
        (0..NOTICES_LIMIT + 5).for_each(|_| hub.shared.notice(String::new()));
        let told = hub.notices();
        assert_eq!(told.len(), NOTICES_LIMIT + 1);
        assert_eq!(told.last().unwrap(), "5 more notices were not kept");
    }
}
