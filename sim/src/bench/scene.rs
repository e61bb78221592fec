//! A scene of work with whole devices on a simulated bus: both rows of Table I are provoked here,
//! and days of the week are held against the bench's.
//!
//! In: mode, world, seed, unit, and what goes wrong. Out: the [`Day`] of the scene. The instrument
//! is the one from the bench, put on a bus of 250 kbit/s with a host that starts the nodes and
//! sends 50 SYNCs a second; the world obeys what node 1 shows ([`super::week`]). Late data are
//! frames that node 2 hands to its controller late.
//!
//! Left out: the week. Its 21 hours take the bench's instrument without a bus, since two whole
//! devices at 50 SYNCs a second would take several times as long.

use canopen::Frame;
use canopen::nmt::State;
use device::objects::table::Channel;
use tilt::chain::Invalid;
use tilt::cross_check::Judgement;

use super::week::{
    AtWork, Compared, Day, HOURS_PER_DAY, SYNC_S, Trouble, Until, check, machine, work,
};
use super::{BenchError, Mode, World};
use crate::can_bus::Port;
use crate::excavator::Excavator;
use crate::fault::NodeFault;
use crate::memory;
use crate::network::Network;
use crate::network::instrument::{Delivered, Fitting};
use crate::rng::Rng;
use crate::supply::Supply;

/// Bit rate of the bus, kbit/s.
const KBIT_S: u16 = 250;

/// Two whole devices and their host.
struct Pair {
    network: Network,
    host: Port,
    nodes: [usize; 2],
    rng: Rng,
}

/// Works with unit `unit` of `mode` until the trouble is settled, for `duration_s` at the most.
///
/// Errors: see [`BenchError`].
pub fn scene(
    mode: Mode,
    world: &World,
    (seed, unit): (u64, u32),
    duration_s: f64,
    trouble: Trouble,
) -> Result<Day, BenchError> {
    play(
        mode,
        world,
        (seed, unit),
        (duration_s, Until::Settled),
        trouble,
    )
}

/// A day of the week, of three hours to its end, whatever is settled meanwhile.
///
/// Errors: see [`BenchError`].
pub fn day(
    mode: Mode,
    world: &World,
    (seed, unit): (u64, u32),
    trouble: Trouble,
) -> Result<Day, BenchError> {
    let ends = (HOURS_PER_DAY * 3600.0, Until::Over);
    play(mode, world, (seed, unit), ends, trouble)
}

fn play(
    mode: Mode,
    world: &World,
    (seed, unit): (u64, u32),
    ends: (f64, Until),
    trouble: Trouble,
) -> Result<Day, BenchError> {
    let mut rng = Rng::stream(seed, "scene");
    let mut arm = Excavator::new(&machine(mode, &world.paper), &mut rng);
    let mut pair = Pair::new(mode, world, (seed, unit))?;
    Ok(work(&mut pair, &mut arm, ends, trouble, &mut rng))
}

impl Pair {
    fn new(mode: Mode, world: &World, (seed, unit): (u64, u32)) -> Result<Self, BenchError> {
        let delivered = Delivered::calibrated(mode, world, seed, unit)?;
        let mut network = Network::new(u32::from(KBIT_S) * 1000, seed);
        let host = network.attach_host();
        let fittings = [Channel::A, Channel::B].map(|channel| Fitting {
            node_id: channel.node_id(),
            kbit_s: KBIT_S,
            memory: memory::blank(),
        });
        let nodes = delivered
            .judging_by(check(mode))
            .join(&mut network, fittings);
        Ok(Self {
            network,
            host,
            nodes,
            rng: Rng::stream(seed, "scene's bus"),
        })
    }

    /// Whether a node has booted and waits for its start.
    fn waits(&self, node: usize) -> bool {
        let unit = &self.network.nodes()[node];
        unit.is_running() && unit.device.values().state == State::PreOperational
    }

    /// A host's frame; one for which there is no room is left out, as SYNC comes again.
    fn send(&mut self, cob_id: u16, data: &[u8]) {
        let _ = self
            .network
            .bus
            .offer(self.host, Frame::data_frame(cob_id, data));
    }
}

impl AtWork for Pair {
    fn time_s(&self) -> f64 {
        self.network.now_s()
    }

    fn run(&mut self, arm: &mut Excavator, duration_s: f64) {
        for _ in 0..(duration_s / SYNC_S).round() as u32 {
            if self.nodes.iter().any(|node| self.waits(*node)) {
                self.send(0, &[1, 0]);
            }
            self.send(0x80, &[]);
            let until_ns = self.network.now_ns() + (SYNC_S * 1e9) as u64;
            self.network.run_until(arm, until_ns, |_| {});
        }
    }

    fn compare(&mut self) -> Compared {
        let [first, _] = self.nodes;
        let unit = &self.network.nodes()[first];
        let now = unit.electronics.clock(self.network.now_s());
        let waiting = Judgement::Waiting(Invalid::Unconfirmed);
        Compared {
            judgement: self.network.shown(first).judgement().unwrap_or(waiting),
            delta_deg: unit.device.pair().difference(now).y.map(|y| y.degrees()),
        }
    }

    fn power_cycle(&mut self) {
        for node in self.nodes {
            self.network.power_off(node);
            self.network.power_on(node);
        }
    }

    fn supply(&mut self) -> &mut Supply {
        let [_, second] = self.nodes;
        &mut self.network.node(second).electronics.supply
    }

    fn delay(&mut self, ms: u32) {
        let [_, second] = self.nodes;
        match ms {
            0 => self.network.heal(second),
            ms => {
                let fault = NodeFault::LateFrames { ms };
                self.network.inject(second, fault, &mut self.rng);
            }
        }
    }
}
