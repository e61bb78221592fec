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

use std::net::{SocketAddr, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use canopen::Frame;

use super::outlet::{FRAMES_LIMIT, Outlet};
use super::round_robin::{ClientId, Incoming, RoundRobin};
use super::shared::{Client, Shared};
use super::{kernel, pty, tcp};
use crate::addresses::reached;
use crate::error::ServeError;

/// How long a client may stay without opening the bus. A program does so at once; a person who
/// types the commands has the time to look them up.
const OPEN_WITHIN: Duration = Duration::from_secs(30);

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
            shared: Arc::new(Shared::new(open_within)),
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
        kernel::open(&self.shared, name)
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
        late.iter().for_each(|client| self.shared.drop_late(client));
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
        self.shared.take_notices()
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
        for at in &self.listeners {
            // The listener waits for a connection, and looks whether to stop when it has one.
            let _ = TcpStream::connect_timeout(&reached(*at), Duration::from_millis(100));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;
    use std::sync::mpsc::sync_channel;

    use super::super::shared::Port;
    use super::*;

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
}
