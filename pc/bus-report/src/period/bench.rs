//! Logs for tests: an instrument on its virtual bus for some seconds, with trouble.
//!
//! In: what happens when. Out: the frames that were on the bus, with their times, and as the text
//! that candump would have written.

use canopen::Frame;
use sim::bench::{Mode, World};
use sim::can_bus::{Event, Port};
use sim::memory;
use sim::network::Network;
use sim::network::hand::{Hand, Pose};
use sim::network::instrument::{Delivered, Fitting};
use sim::rng::Rng;

/// The start of the logs: 2026-11-20 06:00:00 UTC.
pub const START_NS: u64 = 1_795_154_400_000_000_000;

const MS: u64 = 1_000_000;

/// SYNC of the master, ms.
const SYNC_MS: u64 = 10;

/// A pair on its bus with a master.
pub struct Site {
    /// The bus.
    pub network: Network,
    hand: Hand,
    host: Port,
    /// What was on it.
    pub frames: Vec<(u64, Frame)>,
    /// The master sends SYNC.
    pub syncs: bool,
}

impl Site {
    /// The product as it is delivered, in OPERATIONAL, settled and compared.
    pub fn working() -> Self {
        Self::of(Mode::Product)
    }

    /// An instrument of this mode in the same state.
    pub fn of(mode: Mode) -> Self {
        let delivered = Delivered::calibrated(mode, &World::NOMINAL, 1, 0).unwrap();
        let mut network = Network::new(250_000, 1);
        let fittings = [1, 2].map(|node_id| Fitting {
            node_id,
            kbit_s: 250,
            memory: memory::blank(),
        });
        let nodes = delivered.join(&mut network, fittings);
        let host = network.attach_host();
        nodes.into_iter().for_each(|node| network.power_on(node));
        let mut site = Self {
            network,
            hand: Hand::new(Rng::stream(1, "hand")),
            host,
            frames: Vec::new(),
            syncs: true,
        };
        site.run_ms(600);
        site.send(0, &[1, 0]);
        site.run_ms(3000);
        site
    }

    /// The master's frame.
    pub fn send(&mut self, id: u16, bytes: &[u8]) {
        let frame = Frame::data_frame(id, bytes);
        self.network.bus.offer(self.host, frame).unwrap();
        self.frames.push((self.network.now_ns(), frame));
    }

    /// The housing goes to another pose.
    pub fn tilt(&mut self, roll_deg: f64, pitch_deg: f64) {
        self.hand.set_rate(20.0);
        assert!(self.hand.go(Pose {
            roll_deg,
            pitch_deg
        }));
    }

    /// Goes on.
    pub fn run_ms(&mut self, ms: u64) {
        for _ in 0..ms / SYNC_MS {
            if self.syncs {
                self.send(0x80, &[]);
            }
            let until_ns = self.network.now_ns() + SYNC_MS * MS;
            let Self {
                network,
                hand,
                host,
                frames,
                ..
            } = self;
            network.run_until(hand, until_ns, |event| {
                if let Event::Delivered {
                    frame, to, at_ns, ..
                } = event
                    && to.contains(*host)
                {
                    frames.push((*at_ns, *frame));
                }
            });
        }
    }

    /// The board of a node comes loose: both of its axes feel so much more, g.
    pub fn loosen(&mut self, node: usize, offset_g: f64) {
        self.network.electronics(node).offset_g = [offset_g, offset_g, 0.0];
    }
}

/// The frames as a log of `candump -L`, `after_ns` later.
pub fn candump(frames: &[(u64, Frame)], after_ns: u64) -> String {
    let line = |(at_ns, frame): &(u64, Frame)| {
        let us = (START_NS + after_ns + at_ns) / 1000;
        let bytes: String = frame
            .bytes()
            .iter()
            .map(|byte| format!("{byte:02X}"))
            .collect();
        let id = frame.cob_id().unwrap();
        format!(
            "({}.{:06}) can0 {id:03X}#{bytes}\n",
            us / 1_000_000,
            us % 1_000_000
        )
    };
    frames.iter().map(line).collect()
}
