//! The host on the bus: it starts the nodes, sends SYNC, and resets what has to be reset.
//!
//! In: what is said on the bus, and the time. Out: SYNC and NMT frames through a port of its own.
//! It knows of the nodes what any master knows: boot-ups and heartbeats.
//!
//! Left out: SDO, and a master that fails.

use canopen::Frame;

use crate::can_bus::{Port, State};
use crate::network::Network;
use crate::trial::CHANNELS;
use crate::trial::message::{Message, OPERATIONAL, SYNC};

/// NMT: start the node.
const START: u8 = 1;
/// NMT: reset the node.
const RESET: u8 = 129;
/// A node that isn't OPERATIONAL is started again after this, ns.
const AGAIN_NS: u64 = 300_000_000;
/// A node that hasn't booted is reset again after this, ns.
const RESET_AGAIN_NS: u64 = 1_000_000_000;

/// The host.
#[derive(Clone, Debug)]
pub struct Master {
    port: Port,
    /// Length of the SYNC period by the world's clock, ns; the host's clock error is in it.
    period_ns: u64,
    next_sync_ns: u64,
    /// A SYNC waits in the host's mailboxes.
    sync_waits: bool,
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
            start: [false; CHANNELS],
            started_ns: [0; CHANNELS],
            reset: [None; CHANNELS],
        }
    }

    /// When it wants to act next, ns.
    pub fn next_ns(&self) -> u64 {
        self.next_sync_ns
    }

    /// Hears a message of a channel.
    pub fn hear(&mut self, channel: usize, message: &Message, at_ns: u64) {
        match message {
            Message::BootUp => {
                self.start[channel] = true;
                self.reset[channel] = None;
            }
            Message::Heartbeat(state) if *state != OPERATIONAL => {
                let long_ago = at_ns >= self.started_ns[channel] + AGAIN_NS;
                self.start[channel] |= long_ago;
            }
            Message::Sync => self.sync_waits = false,
            _ => {}
        }
    }

    /// Does what is due.
    pub fn act(&mut self, network: &mut Network) {
        let now_ns = network.now_ns();
        if network.bus.state(self.port) == State::BusOff {
            network.bus.recover(self.port);
        }
        for channel in 0..CHANNELS {
            if std::mem::take(&mut self.start[channel]) {
                self.started_ns[channel] = now_ns;
                self.start[channel] = !self.command(network, START, channel);
            }
        }
        self.reset_again(network, now_ns);
        if now_ns < self.next_sync_ns {
            return;
        }
        self.next_sync_ns += self.period_ns;
        if !self.sync_waits {
            let sync = Frame::data_frame(SYNC, &[]);
            self.sync_waits = network.bus.offer(self.port, sync).is_ok();
        }
    }

    /// Resets both nodes: the way out of a latched fault. Says so again until they boot.
    pub fn reset_all(&mut self, network: &mut Network) {
        self.reset = [Some(0); CHANNELS];
        self.reset_again(network, network.now_ns());
    }

    fn reset_again(&mut self, network: &mut Network, now_ns: u64) {
        for channel in 0..CHANNELS {
            let due = self.reset[channel]
                .is_some_and(|told| told == 0 || now_ns >= told + RESET_AGAIN_NS);
            if due && self.command(network, RESET, channel) {
                self.reset[channel] = Some(now_ns);
            }
        }
    }

    fn command(&self, network: &mut Network, command: u8, channel: usize) -> bool {
        let frame = Frame::data_frame(0, &[command, channel as u8 + 1]);
        network.bus.offer(self.port, frame).is_ok()
    }
}
