//! One trial: a calibrated instrument on a bus, on a machine, with things going wrong.
//!
//! In: a [`Setup`] that sets everything, and instruments from the bench ([`pool::Pool`]). Out: a
//! [`Report`]: which rules were broken ([`checks`]), how soon each fault was told and who was
//! blamed, and the fingerprint of the bus. The same setup gives the same fingerprint.
//!
//! What is judged is what a receiver on the bus sees, beside the truth from the mover; nobody looks
//! into a device. A trial begins with power on, has its faults one after the other as the setup
//! has them, and after each looks whether the pair is in order again: if not, the master resets
//! both nodes, as somebody would who has found the cause and removed it.
//!
//! Left out: drawing a setup from a seed (`campaign`).

pub mod checks;
pub mod inject;
pub mod maintenance;
pub mod master;
pub mod message;
pub mod pool;
pub mod sabotage;
pub mod setup;
pub mod timed;
pub mod truth;

#[cfg(test)]
mod tests;

use crate::bench::Mode;
use crate::can_bus::Event;
use crate::excavator::Excavator;
use crate::network::Network;
use crate::network::instrument::Fitting;
use crate::rng::Rng;
use checks::detection::Detection;
use checks::{Affected, Checks, Violation};
use inject::What;
use maintenance::{Site, Work};
use master::Master;
use message::Message;
use pool::Pool;
pub use setup::Setup;
use truth::Watched;

/// Channels of an instrument.
pub const CHANNELS: usize = 2;

/// From the end of a fault to the look whether the pair is in order, s.
pub const LOOK_AFTER_S: f64 = 2.0;

/// How long a pair in order is watched for alarms at the end, s.
const AFTERWARDS_S: f64 = 3.0;

/// Over range for so long altogether while a finding is held, on a machine that strikes, s.
const STRUCK_S: f64 = 1.0;

/// What was handed to the controllers before an offset was taken away has gone out by then, s.
const UNDER_WAY_S: f64 = 0.2;

/// Time between two settings of the temperature, ns.
const TEMPERATURE_NS: u64 = 1_000_000_000;

/// Why a trial could not be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoSuchUnit;

impl std::fmt::Display for NoSuchUnit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "the instrument that the trial asks for was not commissioned"
        )
    }
}

impl std::error::Error for NoSuchUnit {}

/// What came of a trial.
#[derive(Clone, Debug)]
pub struct Report {
    /// Rules broken, in the order of time.
    pub violations: Vec<Violation>,
    /// What was told of each fault of the setup, in its order.
    pub detections: Vec<Detection>,
    /// Of everything that happened on the bus.
    pub fingerprint: u64,
    /// Virtual time that passed, s.
    pub duration_s: f64,
    /// The longest time for which a wrong angle was marked valid, s.
    pub longest_wrong_s: f64,
    /// Angles that came so late that they were taken for those of a later SYNC.
    pub old_angles: u32,
}

/// One event of the bus as the trial saw it.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// The event.
    pub event: &'a Event,
    /// What it carries, and which channel sent it.
    pub message: Option<(usize, Message)>,
    /// The slopes that the instrument is held to, deg, of [`Setup::latency_s`] before the event.
    pub truth_deg: Option<[f64; 2]>,
}

/// Runs a trial; `seen` gets every event of the bus.
///
/// Errors: the pool lacks the setup's unit.
///
/// # Panics
/// Never with a setup whose channels are 0 and 1.
pub fn run(
    setup: &Setup,
    pool: &Pool,
    mut seen: impl FnMut(Seen<'_>),
) -> Result<Report, NoSuchUnit> {
    let mut run = Run::new(setup, pool)?;
    while run.step(&mut seen) {}
    Ok(run.report())
}

/// Something that the world does at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Deed {
    Begin(usize),
    Heal(usize),
    Maintain(usize),
    Finish(usize),
    Look,
    End,
}

fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).max(0.0).round() as u64
}

/// What the setup asks for, the latest first.
fn agenda(setup: &Setup) -> Vec<(u64, Deed)> {
    let mut deeds = Vec::new();
    let recovery_s = setup.limits().recovery_s;
    let mut end_s = setup.safety_s.max(recovery_s);
    let after_s = f64::from(setup.latch_s) + recovery_s + AFTERWARDS_S;
    for (index, injection) in setup.faults.iter().enumerate() {
        deeds.push((nanoseconds(injection.from_s), Deed::Begin(index)));
        deeds.push((nanoseconds(injection.until_s), Deed::Heal(index)));
        let look_s = injection.until_s + LOOK_AFTER_S;
        deeds.push((nanoseconds(look_s), Deed::Look));
        end_s = end_s.max(look_s + after_s);
    }
    for (index, work) in setup.maintenance.iter().enumerate() {
        deeds.push((nanoseconds(work.from_s), Deed::Maintain(index)));
        deeds.push((nanoseconds(work.until_s), Deed::Finish(index)));
        let look_s = work.until_s + LOOK_AFTER_S;
        deeds.push((nanoseconds(look_s), Deed::Look));
        end_s = end_s.max(look_s + after_s);
    }
    deeds.push((nanoseconds(end_s), Deed::End));
    // Stable: what begins at one instant begins in the order of the setup.
    deeds.sort_by_key(|(at, _)| *at);
    deeds.reverse();
    deeds
}

struct Run<'a> {
    setup: &'a Setup,
    network: Network,
    nodes: [usize; CHANNELS],
    master: Master,
    housing: Watched<Excavator>,
    checks: Checks,
    agenda: Vec<(u64, Deed)>,
    temperature_ns: u64,
    /// Faults and maintenance that have begun and not ended.
    active: usize,
    /// Channels that are set to show another angle than the other one.
    offsets: usize,
    events: Vec<Event>,
    over: bool,
}

impl<'a> Run<'a> {
    fn new(setup: &'a Setup, pool: &Pool) -> Result<Self, NoSuchUnit> {
        let delivered = pool.get(setup.mode, setup.unit).ok_or(NoSuchUnit)?;
        let mut network = Network::new(u32::from(setup.kbit_s) * 1000, setup.seed);
        let fittings = [1, 2].map(|node_id| Fitting {
            node_id,
            kbit_s: setup.kbit_s,
            memory: setup.memory(),
        });
        let nodes = delivered.clone().join(&mut network, fittings);
        let master = Master::new(&mut network, setup.period_ns());
        // The machine's own controller listens and acknowledges. Where all who are on a bus send
        // the very same SYNC at once, nobody is left to do so, and they repeat it for ever.
        let _listener = network.attach_host();
        network.bus.faults().set_rates(setup.rates);
        for node in nodes {
            // Each turn of the switch draws another turn-on offset and leaves other noise to come.
            for _ in 0..setup.power_cycles {
                network.node(node).electronics.power_cycle();
            }
            setup.sabotage.apply(setup, &mut network, node);
            let die_c = setup.temperature_c(0.0);
            network.node(node).electronics.set_die_temperature(die_c);
            network.power_on(node);
        }
        let mut rng = Rng::stream(setup.seed, "trial machine");
        Ok(Self {
            housing: Watched::new(Excavator::new(&setup.machine, &mut rng)),
            checks: Checks::new(setup.limits()),
            agenda: agenda(setup),
            temperature_ns: TEMPERATURE_NS,
            active: 0,
            offsets: 0,
            events: Vec::new(),
            over: false,
            setup,
            network,
            nodes,
            master,
        })
    }

    /// Goes to the next instant at which somebody does something; false at the end.
    fn step(&mut self, seen: &mut impl FnMut(Seen<'_>)) -> bool {
        let deed_ns = self.agenda.last().map_or(u64::MAX, |(at, _)| *at);
        let next_ns = (self.master.next_ns())
            .min(self.temperature_ns)
            .min(deed_ns)
            .max(self.network.now_ns());
        let events = &mut self.events;
        let keep = |event: &Event| events.push(*event);
        self.network.run_until(&mut self.housing, next_ns, keep);
        let apart = self.offsets > 0 || self.master.is_writing();
        let apart_s = next_ns as f64 * 1e-9 + UNDER_WAY_S;
        self.checks.shown_apart(apart, apart_s);
        self.hear(seen);
        self.checks.pass(self.network.now_s());
        self.follow_temperature();
        while let Some((_, deed)) = self.agenda.pop_if(|(at, _)| *at <= next_ns) {
            self.act(deed);
        }
        self.master.act(&mut self.network);
        !self.over
    }

    /// Hands what happened to master, checks and caller.
    fn hear(&mut self, seen: &mut impl FnMut(Seen<'_>)) {
        let truth = &self.housing.truth;
        for event in &self.events {
            let at_s = event.at_ns() as f64 * 1e-9;
            let mut told = None;
            if let Event::Delivered { frame, at_ns, .. } = event {
                told = Message::of(frame);
                if let Some((channel, message)) = &told {
                    self.master.hear(*channel, message, *at_ns);
                    let mode = self.setup.mode;
                    let ideal = |time_s: f64| truth.due_deg(time_s, mode);
                    self.checks.see(at_s, *channel, message, ideal);
                }
            }
            seen(Seen {
                event,
                message: told,
                truth_deg: truth.due_deg(at_s - self.setup.latency_s(), self.setup.mode),
            });
        }
        self.events.clear();
    }

    fn follow_temperature(&mut self) {
        if self.network.now_ns() < self.temperature_ns {
            return;
        }
        self.temperature_ns += TEMPERATURE_NS;
        let die_c = self.setup.temperature_c(self.network.now_s());
        for node in self.nodes {
            let unit = self.network.node(node);
            unit.electronics.set_die_temperature(die_c);
        }
    }

    fn act(&mut self, deed: Deed) {
        let now_s = self.network.now_s();
        match deed {
            Deed::Begin(index) => {
                let injection = &self.setup.faults[index];
                self.active += 1;
                self.checks.fault(Affected {
                    channel: injection.channel,
                    from_s: now_s,
                    blame_counts: injection.what.is_own(),
                });
                let rng = Rng::stream(self.setup.seed, &format!("fault {index}"));
                injection.begin(&mut self.network, self.nodes[injection.channel], rng);
            }
            Deed::Heal(index) => {
                let injection = &self.setup.faults[index];
                self.active -= 1;
                self.checks.healed(now_s);
                injection.heal(&mut self.network, self.nodes[injection.channel]);
            }
            Deed::Maintain(index) => self.maintain(index, true),
            Deed::Finish(index) => self.maintain(index, false),
            Deed::Look if self.active > 0 => {}
            Deed::Look => self.look(now_s),
            Deed::End => self.over = true,
        }
    }

    fn maintain(&mut self, index: usize, begins: bool) {
        let setup = self.setup;
        let maintenance = &setup.maintenance[index];
        if maintenance.what == Work::Offset {
            self.checks.shown_anew();
        }
        let mut site = Site {
            network: &mut self.network,
            nodes: self.nodes,
            master: &mut self.master,
        };
        if begins {
            self.active += 1;
            self.checks.maintain();
            self.offsets += usize::from(maintenance.what == Work::Offset);
            maintenance.begin(&mut site, setup);
        } else {
            self.active -= 1;
            maintenance.end(&mut site, setup);
            self.offsets -= usize::from(maintenance.what == Work::Offset);
        }
    }

    /// Whoever has removed the cause looks whether all is well again.
    fn look(&mut self, now_s: f64) {
        let setup = self.setup;
        // What the paper's rule calls a physical fault stays until a reset.
        let product = setup.mode != Mode::Paper;
        let lone = setup.maintenance.is_empty();
        let by_itself = product && lone && setup.latch_s != 0 && !setup.has(What::needs_reset);
        if by_itself {
            // Only pairs that show the cause gone count, and none is compared over range.
            let struck_s = if setup.machine.shock_g.1 > 0.0 {
                STRUCK_S
            } else {
                0.0
            };
            return self
                .checks
                .well(now_s + f64::from(setup.latch_s) + struck_s);
        }
        if !self.checks.in_order(now_s) {
            self.master.reset_all(&mut self.network);
        }
        self.checks.well(now_s);
    }

    fn report(mut self) -> Report {
        let duration_s = self.network.now_s();
        self.checks.end(duration_s);
        Report {
            longest_wrong_s: self.checks.longest_wrong_s(),
            old_angles: self.checks.old_angles(),
            violations: self.checks.violations,
            detections: self.checks.detections.all,
            fingerprint: self.network.bus.fingerprint(),
            duration_s,
        }
    }
}
