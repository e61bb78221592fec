//! The clients' CAN controller, which all of them share.
//!
//! In: frames of clients, and events of the bus. Out: the frames in free mailboxes, and what
//! clients see of an event. The frames of each client go out in the order in which they came,
//! those of several in turn.
//!
//! Left out: when the bus runs (`stage`).

use canopen::Frame;
use sim::can_bus::{Bus, ErrorState, Event, MAILBOXES, Port};

use crate::clients::round_robin::{ClientId, Incoming, RoundRobin};

/// Frames of one client that may wait here; the rest wait with the client.
const OUTGOING_LIMIT: usize = 64;

/// A frame that was on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passed {
    /// What.
    pub frame: Frame,
    /// When it ended, ns of virtual time.
    pub at_ns: u64,
    /// The client that sent it; `None` for a node.
    pub from: Option<ClientId>,
}

/// The clients' CAN controller.
#[derive(Debug)]
pub struct Adapter {
    /// Where it is on the bus.
    pub port: Port,
    outgoing: RoundRobin,
    mailboxes: [Option<ClientId>; MAILBOXES],
    off: bool,
}

impl Adapter {
    /// A controller at this port, with nothing to send.
    pub fn new(port: Port) -> Self {
        Self {
            port,
            outgoing: RoundRobin::default(),
            mailboxes: [None; MAILBOXES],
            off: false,
        }
    }

    /// True when one more frame of this client can be taken.
    pub fn has_room(&self, client: ClientId) -> bool {
        self.outgoing.waiting(client) < OUTGOING_LIMIT
    }

    /// True when frames wait for a mailbox.
    pub fn is_waiting(&self) -> bool {
        !self.outgoing.is_empty()
    }

    /// Takes a client's frame, now.
    pub fn offer(&mut self, incoming: Incoming, bus: &mut Bus) {
        self.outgoing.push(incoming);
        self.pump(bus);
    }

    /// Moves what waits into free mailboxes.
    pub fn pump(&mut self, bus: &mut Bus) {
        while self.mailboxes.contains(&None)
            && let Some(Incoming { client, frame }) = self.outgoing.pop(|_| true)
            && let Ok(mailbox) = bus.offer(self.port, frame)
        {
            self.mailboxes[mailbox.number()] = Some(client);
        }
    }

    /// An adapter that went off the bus is asked back at once, as one with a restart time.
    pub fn recover(&mut self, bus: &mut Bus) {
        if std::mem::take(&mut self.off) {
            bus.recover(self.port);
        }
    }

    /// What clients see of an event: what this controller received, and what it sent.
    pub fn hear(&mut self, event: &Event) -> Option<Passed> {
        match *event {
            Event::Delivered {
                frame, to, at_ns, ..
            } if to.contains(self.port) => Some(Passed {
                frame,
                at_ns,
                from: None,
            }),
            Event::Sent {
                port,
                mailbox: Some(mailbox),
                frame,
                end_ns,
                ..
            } if port == self.port => Some(Passed {
                frame,
                at_ns: end_ns,
                from: self.mailboxes[mailbox.number()].take(),
            }),
            Event::Changed {
                port,
                state: ErrorState::BusOff,
                ..
            } if port == self.port => {
                self.off = true;
                None
            }
            _ => None,
        }
    }
}
