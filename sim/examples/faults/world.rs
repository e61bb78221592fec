//! One run: a calibrated instrument on a machine, and one thing that goes wrong.
//!
//! In: a [`Case`] and the instruments of the [`Bench`](sim::bench::Bench). Out: an [`Outcome`].
//! The host starts the nodes, sends SYNC 50 times a second, and never resets a latched fault.

use sim::bench::{BenchError, Mode, World};
use sim::excavator::{Excavator, ExcavatorSetup, Scene};
use sim::network::Network;
use sim::network::instrument::{Delivered, Fitting};
use sim::rng::Rng;
use sim::trial::Setup;
use sim::trial::inject::{Injection, What};
use sim::trial::master::Master;
use sim::trial::message::Message;

use crate::observer::{Observer, Outcome};
use crate::spread::spread;

/// Seed of the bench that the units come from.
const BENCH_SEED: u64 = 1;
/// Time between two settings of the temperature, ns.
const SECOND_NS: u64 = 1_000_000_000;
/// A channel that was named may still name the other one: how long a run goes on for that, s.
const AFTER_NAMING_S: f64 = 2.0;

/// Calibrated instruments of both modes.
pub struct Units {
    product: Vec<Delivered>,
    paper: Vec<Delivered>,
}

impl Units {
    /// Takes `count` units of each mode through the bench.
    ///
    /// Errors: see [`BenchError`].
    pub fn commission(count: usize) -> Result<Self, BenchError> {
        let of = |mode| -> Result<Vec<Delivered>, BenchError> {
            let bench =
                |unit: usize| Delivered::calibrated(mode, &World::NOMINAL, BENCH_SEED, unit as u32);
            spread(count, bench).into_iter().collect()
        };
        Ok(Self {
            product: of(Mode::Product)?,
            paper: of(Mode::Paper)?,
        })
    }

    /// How many there are of each mode.
    pub fn count(&self) -> usize {
        self.product.len()
    }

    fn get(&self, mode: Mode, unit: usize) -> &Delivered {
        let units = match mode {
            Mode::Paper => &self.paper,
            Mode::Product | Mode::Dynamic | Mode::OneAxis => &self.product,
        };
        &units[unit]
    }
}

/// Everything that a run depends on.
#[derive(Clone, Debug)]
pub struct Case {
    /// Of everything drawn during the run.
    pub seed: u64,
    /// Which instrument.
    pub mode: Mode,
    /// Which unit.
    pub unit: usize,
    /// How often it was switched on before.
    pub power_cycles: u32,
    /// What the machine does.
    pub scene: Scene,
    /// Temperature at the beginning, degC.
    pub start_c: f64,
    /// Its change, K/min.
    pub ramp_c_per_min: f64,
    /// What goes wrong, and with which channel.
    pub fault: Option<(What, usize)>,
    /// When it begins, s.
    pub from_s: f64,
    /// How long the run goes on after that, s.
    pub watch_s: f64,
    /// Whether the run ends once the channel was named and the plain comparison has seen it.
    pub ends_early: bool,
    /// Whether the plain comparison counts for that.
    pub wants_plain: bool,
    /// Whether the machine stops when paper mode asks for it.
    pub obeys: bool,
}

/// Runs a case.
pub fn run(case: &Case, units: &Units) -> Outcome {
    let mut run = Run::new(case, units);
    while !run.is_over() {
        run.step();
    }
    run.outcome()
}

struct Run<'a> {
    case: &'a Case,
    network: Network,
    nodes: [usize; 2],
    master: Master,
    machine: Excavator,
    observer: Observer,
    /// When the fault begins; `None` once it has.
    fault_ns: Option<u64>,
    second_ns: u64,
    end_ns: u64,
}

impl<'a> Run<'a> {
    fn new(case: &'a Case, units: &Units) -> Self {
        let setup = Setup::healthy(case.seed);
        let mut network = Network::new(u32::from(setup.kbit_s) * 1000, case.seed);
        let fittings = [1, 2].map(|node_id| Fitting {
            node_id,
            kbit_s: setup.kbit_s,
            memory: setup.memory(),
        });
        let delivered = units.get(case.mode, case.unit).clone();
        let nodes = delivered.join(&mut network, fittings);
        let master = Master::new(&mut network, u64::from(setup.sync_us) * 1000);
        // The machine's own controller, which acknowledges.
        let _listener = network.attach_host();
        for node in nodes {
            for _ in 0..case.power_cycles {
                network.node(node).electronics.power_cycle();
            }
            let electronics = &mut network.node(node).electronics;
            electronics.set_die_temperature(case.start_c);
            network.power_on(node);
        }
        let machine = ExcavatorSetup {
            scene: case.scene,
            ..ExcavatorSetup::NOMINAL
        };
        let mut rng = Rng::stream(case.seed, "machine");
        let from_ns = (case.from_s * 1e9) as u64;
        let end_ns = from_ns + (case.watch_s * 1e9) as u64;
        Self {
            case,
            network,
            nodes,
            master,
            machine: Excavator::new(&machine, &mut rng),
            observer: Observer::new(
                from_ns,
                case.fault.map_or(0, |(_, channel)| channel),
                case.mode == Mode::Paper,
            ),
            fault_ns: case.fault.map(|_| from_ns),
            second_ns: SECOND_NS,
            end_ns,
        }
    }

    fn step(&mut self) {
        let next_ns = (self.master.next_ns())
            .min(self.second_ns)
            .min(self.fault_ns.unwrap_or(u64::MAX))
            .min(self.end_ns)
            .max(self.network.now_ns());
        let Self {
            network,
            machine,
            observer,
            master,
            ..
        } = self;
        network.run_until(machine, next_ns, |event| {
            let told = match event {
                sim::can_bus::Event::Delivered { frame, at_ns, .. } => {
                    let told = Message::of(frame);
                    if let Some((channel, message)) = &told {
                        master.hear(*channel, message, *at_ns);
                    }
                    told
                }
                _ => None,
            };
            observer.hear(event, told);
        });
        self.observer.pass(next_ns);
        self.follow_temperature(next_ns);
        self.obey(next_ns);
        if self.fault_ns.is_some_and(|at| at <= next_ns) {
            self.fault_ns = None;
            self.begin();
        }
        self.master.act(&mut self.network);
    }

    fn begin(&mut self) {
        if let Some((what, channel)) = self.case.fault {
            let injection = Injection {
                what,
                channel,
                from_s: self.case.from_s,
                until_s: f64::INFINITY,
            };
            let rng = Rng::stream(self.case.seed, "fault");
            injection.begin(&mut self.network, self.nodes[channel], rng);
        }
    }

    fn follow_temperature(&mut self, now_ns: u64) {
        if now_ns < self.second_ns {
            return;
        }
        self.second_ns += SECOND_NS;
        let die_c = self.case.start_c + self.case.ramp_c_per_min * now_ns as f64 * 1e-9 / 60.0;
        for node in self.nodes {
            let electronics = &mut self.network.node(node).electronics;
            electronics.set_die_temperature(die_c);
        }
    }

    fn obey(&mut self, now_ns: u64) {
        let now_s = now_ns as f64 * 1e-9;
        if !self.case.obeys {
            return;
        }
        if self.observer.asks_to_stop() {
            self.machine.stop(now_s);
        } else {
            self.machine.resume(now_s);
        }
    }

    fn is_over(&self) -> bool {
        let now_ns = self.network.now_ns();
        let told = &self.observer.outcome;
        // A healthy instrument that the paper's rule holds for broken reports nothing else.
        let given_up = self.case.obeys && told.physical > 0;
        if now_ns >= self.end_ns || given_up {
            return true;
        }
        let since_s = self.network.now_s() - self.case.from_s;
        let named = told
            .named_s
            .is_some_and(|named| since_s > named + AFTER_NAMING_S);
        self.case.ends_early && named && (told.plain_s.is_some() || !self.case.wants_plain)
    }

    fn outcome(self) -> Outcome {
        Outcome {
            duration_s: self.network.now_s(),
            fingerprint: self.network.bus.fingerprint(),
            ..self.observer.outcome
        }
    }
}
