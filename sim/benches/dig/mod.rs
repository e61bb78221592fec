//! Two product nodes on a 50 Hz bus, on the arm of an excavator, for timing and counting.
//!
//! In: nothing. Out: seconds of virtual time, and the bus's fingerprint: the same number of seconds
//! gives the same one, whatever was done to make them shorter. The nodes are as they were soldered,
//! for a calibration costs the same time whatever its numbers are; the host starts them and sends
//! SYNC.

use canopen::Frame;
use sim::bench::{Mode, World};
use sim::can_bus::Port;
use sim::excavator::{Excavator, ExcavatorSetup};
use sim::memory;
use sim::network::Network;
use sim::network::instrument::{Delivered, Fitting};
use sim::rng::Rng;

const KBIT_S: u16 = 250;
/// Time between two SYNCs: 50 Hz, in ns.
const SYNC_NS: u64 = 20_000_000;
/// SYNCs in a second.
const SYNCS: u64 = 50;
/// Until then the parts are set up and the filters settle.
const SETTLED_NS: u64 = 1_000_000_000;

/// Two nodes at work.
pub struct Dig {
    network: Network,
    arm: Excavator,
    host: Port,
    until_ns: u64,
}

impl Dig {
    /// Both nodes measure and are OPERATIONAL.
    pub fn new() -> Self {
        let mut network = Network::new(u32::from(KBIT_S) * 1000, 1);
        let host = network.attach_host();
        let fittings = [1, 2].map(|node_id| Fitting {
            node_id,
            kbit_s: KBIT_S,
            memory: memory::blank(),
        });
        let delivered = Delivered::bare(Mode::Product, &World::NOMINAL, 1, 0);
        for node in delivered.join(&mut network, fittings) {
            network.power_on(node);
        }
        let mut dig = Self {
            network,
            arm: Excavator::new(&ExcavatorSetup::NOMINAL, &mut Rng::stream(1, "arm")),
            host,
            until_ns: 0,
        };
        dig.run(SETTLED_NS);
        // NMT: start all nodes.
        dig.send(0, &[1, 0]);
        dig.run(SYNC_NS);
        dig
    }

    fn send(&mut self, id: u16, bytes: &[u8]) {
        let frame = Frame::data_frame(id, bytes);
        // The host's mailboxes are empty: it sends one frame and waits for longer than that takes.
        self.network.bus.offer(self.host, frame).expect("a mailbox");
    }

    fn run(&mut self, duration_ns: u64) {
        self.until_ns += duration_ns;
        self.network.run_until(&mut self.arm, self.until_ns, |_| {});
    }

    /// One second of virtual time.
    pub fn second(&mut self) {
        for _ in 0..SYNCS {
            self.send(0x080, &[]);
            self.run(SYNC_NS);
        }
    }

    /// Frames on the bus so far, and its hash over everything that has happened on it.
    pub fn seen(&self) -> (u64, u64) {
        let bus = &self.network.bus;
        (bus.statistics().sent, bus.fingerprint())
    }
}
