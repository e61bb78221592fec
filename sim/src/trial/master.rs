//! The host on the bus: it starts the nodes, sends SYNC, and resets what has to be reset.
//!
//! In: what is said on the bus, the time, and what maintenance asks for. Out: SYNC, NMT frames and
//! SDO writes through a port of its own. Of the nodes it has what any master has: boot-ups and
//! heartbeats. A second master may send SYNC beside it, and somebody may flood the bus.
//!
//! Left out: what a node answers to a write; it is repeated until there is an answer.

use std::collections::VecDeque;

use canopen::Frame;

use crate::can_bus::{ErrorState, Port};
use crate::network::Network;
use crate::trial::CHANNELS;
use crate::trial::message::{Message, OPERATIONAL, SYNC};

/// NMT commands (CiA 301, table 31).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Command {
    /// Start the node.
    Start = 1,
    /// Stop the node.
    Stop = 2,
    /// Enter PRE-OPERATIONAL.
    PreOperational = 128,
    /// Reset node.
    Reset = 129,
    /// Reset communication.
    ResetCommunication = 130,
}

/// A write of up to four bytes by SDO, expedited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Write([u8; 8]);

impl Write {
    /// `length` bytes, 1 to 4, of a value into an object.
    pub const fn new(index: u16, sub: u8, length: u8, value: u32) -> Self {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = value.to_le_bytes();
        Self([0x23 | ((4 - length) << 2), low, high, sub, a, b, c, d])
    }
}

/// A node that isn't OPERATIONAL is started again after this, ns.
const AGAIN_NS: u64 = 300_000_000;
/// A node that hasn't booted is reset again after this, ns.
const RESET_AGAIN_NS: u64 = 1_000_000_000;
/// A write without an answer is sent again after this, ns.
const ASK_AGAIN_NS: u64 = 500_000_000;
/// Of a SYNC that is not sent.
const NEVER: u64 = u64::MAX;

/// SYNC of a second master.
#[derive(Clone, Copy, Debug)]
struct Second {
    port: Port,
    period_ns: u64,
    next_ns: u64,
}

/// The host.
#[derive(Clone, Debug)]
pub struct Master {
    port: Port,
    /// Length of the SYNC period by the world's clock, ns; the host's clock error is in it.
    period_ns: u64,
    /// [`NEVER`] while it sends none.
    next_sync_ns: u64,
    /// A SYNC waits in the host's mailboxes.
    sync_waits: bool,
    /// A node that is not to be started.
    held: [bool; CHANNELS],
    second: Option<Second>,
    /// Writes that have had no answer.
    writes: [VecDeque<Write>; CHANNELS],
    /// When the first of them was last sent, ns.
    asked_ns: [Option<u64>; CHANNELS],
    /// Since when nobody floods the bus, ns: what was sent in a flood still waits.
    free_ns: u64,
    /// The port of a second master or of whoever floods the bus; attached once.
    stranger: Option<Port>,
    /// A node to start.
    start: [bool; CHANNELS],
    started_ns: [u64; CHANNELS],
    /// A node that has been told to reset and has not booted since; when it was told, ns.
    reset: [Option<u64>; CHANNELS],
}

impl Master {
    /// On the bus with a SYNC period; the first SYNC comes one period from now.
    pub fn new(network: &mut Network, period_ns: u64) -> Self {
        Self {
            port: network.attach_host(),
            period_ns,
            next_sync_ns: network.now_ns() + period_ns,
            sync_waits: false,
            held: [false; CHANNELS],
            second: None,
            writes: Default::default(),
            asked_ns: [None; CHANNELS],
            free_ns: 0,
            stranger: None,
            start: [false; CHANNELS],
            started_ns: [0; CHANNELS],
            reset: [None; CHANNELS],
        }
    }

    /// When it wants to act next, ns.
    pub fn next_ns(&self) -> u64 {
        let second_ns = self.second.map_or(NEVER, |second| second.next_ns);
        self.next_sync_ns.min(second_ns)
    }

    /// Sends a node into another state, and does not start it again.
    pub fn hold(&mut self, network: &mut Network, channel: usize, command: Command) {
        self.held[channel] = true;
        self.start[channel] = false;
        self.command(network, command, channel);
    }

    /// A node may be started again; at its next heartbeat it is.
    pub fn let_go(&mut self, channel: usize) {
        self.held[channel] = false;
        self.start[channel] = true;
    }

    /// From now on SYNC at this period, or none.
    pub fn set_sync(&mut self, period_ns: Option<u64>, now_ns: u64) {
        self.next_sync_ns = period_ns.map_or(NEVER, |period_ns| now_ns + period_ns);
        self.period_ns = period_ns.unwrap_or(self.period_ns);
    }

    /// A second master sends SYNC as well at this period, or no longer.
    pub fn set_second(&mut self, network: &mut Network, period_ns: Option<u64>) {
        let port = self.stranger(network);
        let now_ns = network.now_ns();
        self.second = period_ns.map(|period_ns| Second {
            port,
            period_ns,
            next_ns: now_ns,
        });
    }

    /// Somebody floods the bus with this identifier, or no longer.
    pub fn flood(&mut self, network: &mut Network, id: Option<u16>) {
        let port = self.stranger(network);
        self.free_ns = if id.is_some() {
            NEVER
        } else {
            network.now_ns()
        };
        let frame = id.map(|id| Frame::data_frame(id, &[0; 8]));
        network.bus.babble(port, frame);
    }

    fn stranger(&mut self, network: &mut Network) -> Port {
        *self.stranger.get_or_insert_with(|| network.attach_host())
    }

    /// Writes an object of a node, after what was to be written before.
    pub fn write(&mut self, channel: usize, write: Write) {
        self.writes[channel].push_back(write);
    }

    /// True while a write has had no answer.
    pub fn is_writing(&self) -> bool {
        self.writes.iter().any(|writes| !writes.is_empty())
    }

    fn ask(&mut self, network: &mut Network, now_ns: u64) {
        for channel in 0..CHANNELS {
            let free_ns = self.free_ns;
            let again =
                |asked_ns: u64| now_ns >= asked_ns.max(free_ns).saturating_add(ASK_AGAIN_NS);
            if let Some(Write(bytes)) = self.writes[channel].front()
                && self.asked_ns[channel].is_none_or(again)
            {
                let frame = Frame::data_frame(0x601 + channel as u16, bytes);
                if self.offer(network, frame) {
                    self.asked_ns[channel] = Some(now_ns);
                }
            }
        }
    }

    /// Hears a message of a channel.
    pub fn hear(&mut self, channel: usize, message: &Message, at_ns: u64) {
        match message {
            Message::BootUp => {
                self.start[channel] = !self.held[channel];
                self.reset[channel] = None;
            }
            Message::Heartbeat(state) if *state != OPERATIONAL => {
                let long_ago = !self.held[channel] && at_ns >= self.started_ns[channel] + AGAIN_NS;
                self.start[channel] |= long_ago;
            }
            Message::Sync => self.sync_waits = false,
            Message::Answer => {
                self.writes[channel].pop_front();
                self.asked_ns[channel] = None;
            }
            _ => {}
        }
    }

    /// Does what is due.
    pub fn act(&mut self, network: &mut Network) {
        let now_ns = network.now_ns();
        if network.bus.state(self.port) == ErrorState::BusOff {
            network.bus.recover(self.port);
        }
        for channel in 0..CHANNELS {
            if std::mem::take(&mut self.start[channel]) {
                self.started_ns[channel] = now_ns;
                self.start[channel] = !self.command(network, Command::Start, channel);
            }
        }
        self.reset_again(network, now_ns);
        self.ask(network, now_ns);
        if let Some(second) = &mut self.second
            && now_ns >= second.next_ns
        {
            second.next_ns += second.period_ns;
            // A SYNC that finds no room is left out, as a master's is that has not got through.
            let _ = network.bus.offer(second.port, Frame::data_frame(SYNC, &[]));
        }
        if now_ns < self.next_sync_ns {
            return;
        }
        self.next_sync_ns += self.period_ns;
        if !self.sync_waits {
            let sync = Frame::data_frame(SYNC, &[]);
            self.sync_waits = network.bus.offer(self.port, sync).is_ok();
        }
    }

    /// Resets both nodes: the way out of a latched fault. Sends it again until they boot.
    pub fn reset_all(&mut self, network: &mut Network) {
        self.reset = [Some(0); CHANNELS];
        self.reset_again(network, network.now_ns());
    }

    fn reset_again(&mut self, network: &mut Network, now_ns: u64) {
        for channel in 0..CHANNELS {
            let due = self.reset[channel]
                .is_some_and(|told| told == 0 || now_ns >= told + RESET_AGAIN_NS);
            if due && self.command(network, Command::Reset, channel) {
                self.reset[channel] = Some(now_ns);
            }
        }
    }

    /// An NMT command to one node; false where the host has no room for it.
    pub fn command(&self, network: &mut Network, command: Command, channel: usize) -> bool {
        let frame = Frame::data_frame(0, &[command as u8, channel as u8 + 1]);
        self.offer(network, frame)
    }

    fn offer(&self, network: &mut Network, frame: Frame) -> bool {
        network.bus.offer(self.port, frame).is_ok()
    }
}
