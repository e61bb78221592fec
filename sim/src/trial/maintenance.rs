//! What a master, a fitter, the wires and the supply do to one node alone, or to SYNC, while the
//! rest works.
//!
//! In: a list of [`Maintenance`]s. Out: a [`Network`] and a [`Master`] to which it is done, and
//! from which it is taken back. It is drawn at any moment, also while a fault stands.
//!
//! Left out: a whole update, which `plumb update` is tested with; what it does to the pair is done
//! here by clearing the spare slot, the longest standstill of an update.

use std::fmt;

use crate::network::Network;
use crate::trial::master::{Command, Master, Write};
use crate::trial::timed::Timed;
use crate::trial::{CHANNELS, Setup};

/// What is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Work {
    /// NMT: PRE-OPERATIONAL, and then started again.
    PreOperational,
    /// NMT: stopped, and then started again.
    Stop,
    /// NMT: reset node.
    Reset,
    /// NMT: reset communication.
    ResetCommunication,
    /// The reset pin.
    ResetPin,
    /// Its supply is taken away.
    Power,
    /// Its wires to the bus are taken off.
    Wires,
    /// What it sends is spoiled, so that it goes bus-off time and again.
    BusOff,
    /// Somebody floods the bus with frames that outrank all but NMT, SYNC and EMCY.
    Flood,
    /// PRE-OPERATIONAL, and its spare slot is cleared for an update (1F51h).
    Clear,
    /// Its slope X gets a differential offset (6014h), and the other one's does not.
    Offset,
    /// Its latch time (2004h) becomes 1 s.
    LatchTime,
    /// Its 2005h becomes the opposite of the other one's.
    GoesOnAlone,
    /// The master stops SYNC.
    NoSync,
    /// The master sends SYNC at another period.
    SyncPeriod {
        /// The period, us.
        us: u32,
    },
    /// A second master sends SYNC as well, and starts whoever boots.
    SecondMaster {
        /// The period of its SYNC, us.
        us: u32,
    },
}

impl fmt::Display for Work {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::PreOperational => write!(f, "PRE-OPERATIONAL"),
            Self::Stop => write!(f, "STOPPED"),
            Self::Reset => write!(f, "reset node"),
            Self::ResetCommunication => write!(f, "reset communication"),
            Self::ResetPin => write!(f, "reset pin"),
            Self::Power => write!(f, "no supply"),
            Self::Wires => write!(f, "wires off"),
            Self::BusOff => write!(f, "bus-off"),
            Self::Flood => write!(f, "flood"),
            Self::Clear => write!(f, "clearing of the spare slot"),
            Self::Offset => write!(f, "6014h alone"),
            Self::LatchTime => write!(f, "2004h alone"),
            Self::GoesOnAlone => write!(f, "2005h alone"),
            Self::NoSync => write!(f, "no SYNC"),
            Self::SyncPeriod { us } => write!(f, "SYNC every {us} us"),
            Self::SecondMaster { us } => write!(f, "second master, SYNC every {us} us"),
        }
    }
}

/// One piece of work, and for how long what it does stands.
pub type Maintenance = Timed<Work>;

/// Identifier of the flood's frames: below that of the exchange and every PDO.
const FLOOD_ID: u16 = 0x0FF;

/// Slope X shows 3 deg more, in the unit as delivered.
const OFFSET: Write = Write::new(0x6014, 0, 2, 300);
/// It shows what was measured again.
const NO_OFFSET: Write = Write::new(0x6014, 0, 2, 0);
/// The spare slot is cleared.
const CLEAR: Write = Write::new(0x1F51, 1, 1, 3);

/// The network and its masters.
pub struct Site<'a> {
    /// The instrument's bus.
    pub network: &'a mut Network,
    /// Node of each channel.
    pub nodes: [usize; CHANNELS],
    /// Who starts the nodes and sends SYNC.
    pub master: &'a mut Master,
}

impl Maintenance {
    /// Begins.
    pub fn begin(&self, site: &mut Site<'_>, setup: &Setup) {
        let channel = self.channel;
        let node = site.nodes[channel];
        let Site {
            network, master, ..
        } = site;
        match self.what {
            Work::PreOperational => master.hold(network, channel, Command::PreOperational),
            Work::Stop => master.hold(network, channel, Command::Stop),
            Work::Reset => tell(master, network, Command::Reset, channel),
            Work::ResetCommunication => {
                tell(master, network, Command::ResetCommunication, channel);
            }
            Work::ResetPin => network.reset(node),
            Work::Power => network.power_off(node),
            Work::Wires => connect(network, node, false),
            Work::BusOff => spoil(network, node, true),
            Work::Flood => master.flood(network, Some(FLOOD_ID)),
            Work::Clear => {
                master.hold(network, channel, Command::PreOperational);
                master.write(channel, CLEAR);
            }
            Work::Offset => master.write(channel, OFFSET),
            Work::LatchTime => master.write(channel, Write::new(0x2004, 0, 2, 1)),
            Work::GoesOnAlone => {
                let other = u32::from(!setup.degraded);
                master.write(channel, Write::new(0x2005, 0, 1, other));
            }
            Work::NoSync => master.set_sync(None, network.now_ns()),
            Work::SyncPeriod { us } => {
                master.set_sync(Some(u64::from(us) * 1000), network.now_ns());
            }
            Work::SecondMaster { us } => master.set_second(network, Some(u64::from(us) * 1000)),
        }
    }

    /// Ends: what was done is taken back.
    pub fn end(&self, site: &mut Site<'_>, setup: &Setup) {
        let channel = self.channel;
        let node = site.nodes[channel];
        let Site {
            network, master, ..
        } = site;
        match self.what {
            Work::PreOperational | Work::Stop | Work::Clear => master.let_go(channel),
            Work::Reset | Work::ResetCommunication | Work::ResetPin => {}
            Work::Power => network.power_on(node),
            Work::Wires => connect(network, node, true),
            Work::BusOff => spoil(network, node, false),
            Work::Flood => master.flood(network, None),
            Work::Offset => master.write(channel, NO_OFFSET),
            Work::LatchTime => {
                let latch_s = u32::from(setup.latch_s);
                master.write(channel, Write::new(0x2004, 0, 2, latch_s));
            }
            Work::GoesOnAlone => {
                let alone = u32::from(setup.degraded);
                master.write(channel, Write::new(0x2005, 0, 1, alone));
            }
            Work::NoSync | Work::SyncPeriod { .. } => {
                master.set_sync(Some(setup.period_ns()), network.now_ns());
            }
            Work::SecondMaster { .. } => master.set_second(network, None),
        }
    }
}

fn connect(network: &mut Network, node: usize, on: bool) {
    let port = network.nodes()[node].port;
    network.bus.connect(port, on);
}

fn spoil(network: &mut Network, node: usize, on: bool) {
    let port = network.nodes()[node].port;
    network.bus.faults().spoil(port, on);
}

/// A host whose queue is full has lost its command, as a person's is that nobody heard.
fn tell(master: &Master, network: &mut Network, command: Command, channel: usize) {
    let _ = master.command(network, command, channel);
}
