//! The virtual instrument on its bus, in virtual time.
//!
//! In: frames of clients, and the time up to which to go. Out: the frames that were on the bus,
//! each once and with its time, as soon as the bus lets them.
//!
//! Left out: what words do to it (`effects`), the machine's own time (`pace`), and who the clients
//! are (`clients`).

use sim::can_bus::{Port, Rates};
use sim::chamber::Chamber;
use sim::motion::Attitude;
use sim::network::Network;
use sim::network::hand::{Hand, Pose};
use sim::rng::Rng;

use super::adapter::{Adapter, Passed};
use crate::clients::round_robin::{ClientId, Incoming};

/// How often the dies follow the chamber.
const CHAMBER_NS: u64 = 100_000_000;

/// Everything virtual.
#[derive(Debug)]
pub struct Stage {
    /// The bus with its nodes.
    pub network: Network,
    /// The nodes measure one axis all the way round, so X is a turn and no slope.
    pub one_axis: bool,
    /// The climatic chamber around the housing.
    pub chamber: Chamber,
    /// So many times as fast as in [`sim::chamber`] air and dies follow: a chamber with more
    /// power around a housing of less thermal mass.
    pub chamber_speed: f64,
    /// What turns the housing.
    pub hand: Hand,
    chamber_ns: u64,
    /// The clients' controller.
    pub adapter: Adapter,
    /// A stranger on the bus, once one has babbled.
    pub stranger: Option<Port>,
    /// What the wires do to frames.
    pub rates: Rates,
    /// For whatever is drawn when something breaks.
    pub rng: Rng,
    passed: Vec<Passed>,
}

/// The angle of gravity in the plane of the housing's x and z, in which a slope folds at 90 deg
/// and a turn goes on.
fn turn_deg(attitude: Attitude) -> f64 {
    let [x, y] = [attitude.slope_x_deg, attitude.slope_y_deg].map(|deg| deg.to_radians().sin());
    let down = (1.0 - x * x - y * y).max(0.0).sqrt();
    let over = attitude.turn_deg.to_radians().cos();
    x.atan2(down.copysign(over)).to_degrees()
}

impl Stage {
    /// A level housing at 25 degC around the nodes of `network`, which have no power yet.
    pub fn new(mut network: Network, seed: u64) -> Self {
        let port = network.attach_host();
        Self {
            network,
            one_axis: false,
            chamber: Chamber::at(25.0),
            chamber_speed: 1.0,
            hand: Hand::new(Rng::stream(seed, "hand")),
            chamber_ns: 0,
            adapter: Adapter::new(port),
            stranger: None,
            rates: Rates::default(),
            rng: Rng::stream(seed, "serve"),
            passed: Vec::new(),
        }
    }

    /// True when the housing stands still.
    pub fn is_still(&self) -> bool {
        self.hand.is_still()
    }

    /// Turns the housing there, so fast; false, and nothing changes, when no housing stands so.
    pub fn stand(&mut self, pose: Pose, deg_s: f64) -> bool {
        let possible = pose.is_possible();
        if possible {
            self.hand.set_rate(deg_s);
        }
        possible && self.hand.go(pose)
    }

    /// Where the housing truly stands: X, as the nodes measure it, and slope Y in degrees; and
    /// air and die in degC.
    pub fn truth(&self) -> ([f64; 2], [f64; 2]) {
        let attitude = self.hand.attitude();
        let x_deg = if self.one_axis {
            turn_deg(attitude)
        } else {
            attitude.slope_x_deg
        };
        (
            [x_deg, attitude.slope_y_deg],
            [self.chamber.air_c, self.chamber.die_c],
        )
    }

    /// True when one more frame of this client can be taken.
    pub fn has_room(&self, client: ClientId) -> bool {
        self.adapter.has_room(client)
    }

    /// Takes a client's frame, now.
    pub fn offer(&mut self, incoming: Incoming) {
        self.adapter.offer(incoming, &mut self.network.bus);
    }

    /// Goes on to `until_ns`; the frames that ended on the bus meanwhile, in their order.
    pub fn run_until(&mut self, until_ns: u64) -> Vec<Passed> {
        while self.network.now_ns() < until_ns {
            let mut next = until_ns.min(self.chamber_ns + CHAMBER_NS);
            if self.adapter.is_waiting() {
                // A mailbox that falls free is filled at once, or the bus would idle.
                let event = self.network.bus.next_event().unwrap_or(next);
                next = next.min(event.max(self.network.now_ns() + 1));
            }
            self.go(next);
            self.follow_chamber();
            self.adapter.recover(&mut self.network.bus);
            self.adapter.pump(&mut self.network.bus);
        }
        std::mem::take(&mut self.passed)
    }

    fn go(&mut self, until_ns: u64) {
        let Self {
            network,
            hand,
            adapter,
            passed,
            ..
        } = self;
        network.run_until(hand, until_ns, |event| {
            passed.extend(adapter.hear(event));
        });
    }

    fn follow_chamber(&mut self) {
        if self.network.now_ns() < self.chamber_ns + CHAMBER_NS {
            return;
        }
        self.chamber_ns += CHAMBER_NS;
        let before_c = self.chamber.die_c;
        self.chamber
            .step(CHAMBER_NS as f64 * 1e-9 * self.chamber_speed);
        if self.chamber.die_c != before_c {
            self.set_dies(self.chamber.die_c);
        }
    }

    /// Gives all sensors this temperature.
    pub fn set_dies(&mut self, die_c: f64) {
        for number in 0..self.network.node_count() {
            let electronics = self.network.electronics(number);
            electronics.set_die_temperature(die_c);
        }
    }
}
