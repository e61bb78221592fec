//! The virtual instrument on its bus, with everything that can happen to it.
//!
//! In: [`Word`]s, frames of clients, and the time up to which to go. Out: the frames that were on
//! the bus, each once and with its time, and what there is to tell. Clients share one CAN
//! controller, as programs behind one adapter do; the frames of each go out in the order in which
//! they came, those of several in turn, and as soon as the bus lets them.
//!
//! Left out: the machine's own time (`pace`), and who the clients are (`hub`).

use canopen::Frame;
use sim::can_bus::{ErrorState, Event, MAILBOXES, Port, Rates, TransmitOrder};
use sim::chamber::Chamber;
use sim::fault::NodeFault;
use sim::lis2dw12::Fault;
use sim::motion::Attitude;
use sim::network::Network;
use sim::network::guest::Switch;
use sim::network::hand::{Hand, Pose};
use sim::rng::Rng;
use sim::supply::Supply;

use super::hub::{ClientId, Incoming};
use super::round_robin::RoundRobin;
use super::script::impossible;
use super::trouble::Trouble;
use super::words::{BusTrouble, Word, help};

/// Frames of one client that may wait here; the rest wait with the client.
const OUTGOING_LIMIT: usize = 64;

/// How often the dies follow the chamber.
const CHAMBER_NS: u64 = 100_000_000;

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
struct Adapter {
    port: Port,
    outgoing: RoundRobin,
    mailboxes: [Option<ClientId>; MAILBOXES],
    off: bool,
}

/// Everything virtual.
#[derive(Debug)]
pub struct Stage {
    /// The bus with its nodes.
    pub network: Network,
    /// The nodes measure one axis all the way round, so X is a turn and no slope.
    pub one_axis: bool,
    /// The climatic chamber around the housing.
    pub chamber: Chamber,
    /// So many times as fast as [`sim::chamber`] says air and dies follow: a chamber with more
    /// power around a housing of less thermal mass.
    pub chamber_speed: f64,
    hand: Hand,
    chamber_ns: u64,
    adapter: Adapter,
    /// A stranger on the bus, once one has babbled.
    stranger: Option<Port>,
    rates: Rates,
    rng: Rng,
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
            adapter: Adapter {
                port,
                outgoing: RoundRobin::default(),
                mailboxes: [None; MAILBOXES],
                off: false,
            },
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
        self.adapter.outgoing.waiting(client) < OUTGOING_LIMIT
    }

    /// Takes a client's frame, now.
    pub fn offer(&mut self, incoming: Incoming) {
        self.adapter.outgoing.push(incoming);
        self.pump();
    }

    /// Moves what waits into free mailboxes.
    fn pump(&mut self) {
        let Self {
            network, adapter, ..
        } = self;
        while adapter.mailboxes.contains(&None)
            && let Some(Incoming { client, frame }) = adapter.outgoing.pop(|_| true)
            && let Ok(mailbox) = network.bus.offer(adapter.port, frame)
        {
            adapter.mailboxes[mailbox.number()] = Some(client);
        }
    }

    /// Goes on to `until_ns`; the frames that ended on the bus meanwhile, in their order.
    pub fn run_until(&mut self, until_ns: u64) -> Vec<Passed> {
        while self.network.now_ns() < until_ns {
            let mut next = until_ns.min(self.chamber_ns + CHAMBER_NS);
            if !self.adapter.outgoing.is_empty() {
                // A mailbox that falls free is filled at once, or the bus would idle.
                let event = self.network.bus.next_event().unwrap_or(next);
                next = next.min(event.max(self.network.now_ns() + 1));
            }
            self.go(next);
            self.follow_chamber();
            self.recover();
            self.pump();
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

    fn set_dies(&mut self, die_c: f64) {
        for number in 0..self.network.node_count() {
            let electronics = self.network.electronics(number);
            electronics.set_die_temperature(die_c);
        }
    }

    /// An adapter that went off the bus is asked back at once, as one with a restart time.
    fn recover(&mut self) {
        if std::mem::take(&mut self.adapter.off) {
            self.network.bus.recover(self.adapter.port);
        }
    }
}

impl Adapter {
    /// What clients see of an event: what this controller received, and what it sent.
    fn hear(&mut self, event: &Event) -> Option<Passed> {
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

/// What a word came to.
#[derive(Clone, Debug, PartialEq)]
pub enum Done {
    /// Done, with nothing to tell.
    Quietly,
    /// Something to tell.
    Told(String),
    /// A pose in which no housing stands; nothing has changed.
    Impossible(Pose),
    /// The end was asked for.
    Quit,
    /// A word for scripts, which means nothing here.
    ScriptOnly,
    /// Trouble of a node whose code runs elsewhere; nothing has changed.
    Beyond,
}

impl Done {
    /// Why nothing has changed; `None` for a word that was carried out.
    pub fn refusal(&self) -> Option<String> {
        match self {
            Self::Quietly | Self::Told(_) | Self::Quit => None,
            Self::Impossible(pose) => Some(impossible(*pose)),
            Self::ScriptOnly => Some(SCRIPT_ONLY.to_owned()),
            Self::Beyond => Some(BEYOND.to_owned()),
        }
    }
}

/// What is told of words that mean nothing here.
const SCRIPT_ONLY: &str = "`hold` and `repeat` are words of scripts, `wait` of scripts and, \
                           without a time before it, of `plumb twin`";

/// What is told of trouble that only the code of a virtual node can have.
const BEYOND: &str = "its code runs on an emulated processor: only its part and its wires break";

impl Stage {
    /// Carries out a word, now.
    pub fn obey(&mut self, word: &Word) -> Done {
        let target = self.hand.target();
        match word {
            Word::Pitch(pitch_deg) => {
                return self.go_to(Pose {
                    pitch_deg: *pitch_deg,
                    ..target
                });
            }
            Word::Roll(roll_deg) => {
                return self.go_to(Pose {
                    roll_deg: *roll_deg,
                    ..target
                });
            }
            Word::Level => return self.go_to(Pose::default()),
            Word::Rate(deg_s) => self.hand.set_rate(*deg_s),
            Word::Vibration(rms_g) => self.hand.set_vibration(*rms_g),
            Word::Temperature(celsius, at_once) => self.temper(*celsius, *at_once),
            Word::Bus(trouble) => self.trouble_bus(*trouble),
            Word::Babble(id) => self.babble(*id),
            Word::BitRate(kbit_s) => {
                let rate = u32::from(*kbit_s) * 1000;
                self.network.bus.set_bit_rate(self.adapter.port, rate);
            }
            Word::Fault(nodes, trouble) if self.is_beyond(&nodes.0, *trouble) => {
                return Done::Beyond;
            }
            Word::Fault(nodes, trouble) => self.each(&nodes.0, |s, n| s.trouble(n, *trouble)),
            Word::Heal(nodes) => self.each(&nodes.0, Self::heal),
            Word::Power(nodes, true) => self.each(&nodes.0, Self::power_on),
            Word::Power(nodes, false) => self.each(&nodes.0, Self::power_off),
            Word::Wire(nodes, on) => self.each(&nodes.0, |s, n| s.wire(n, *on)),
            Word::Reset(nodes) => self.each(&nodes.0, Self::reset),
            Word::Status => return Done::Told(super::status::text(self)),
            Word::Help => return Done::Told(help()),
            Word::Quit => return Done::Quit,
            Word::Wait(_) | Word::Hold | Word::Repeat => return Done::ScriptOnly,
        }
        Done::Quietly
    }

    fn each(&mut self, nodes: &[usize], mut act: impl FnMut(&mut Self, usize)) {
        nodes.iter().for_each(|number| act(self, *number));
    }

    fn go_to(&mut self, pose: Pose) -> Done {
        if self.hand.go(pose) {
            Done::Quietly
        } else {
            Done::Impossible(pose)
        }
    }

    fn temper(&mut self, celsius: f64, at_once: bool) {
        if at_once {
            self.chamber = Chamber::at(celsius);
            self.set_dies(celsius);
        } else {
            self.chamber.set_point(celsius);
        }
    }

    fn trouble_bus(&mut self, trouble: BusTrouble) {
        match trouble {
            BusTrouble::Short(seconds) => {
                let until_ns = self.network.now_ns() + (seconds * 1e9) as u64;
                self.network.bus.short_until(until_ns);
            }
            BusTrouble::Noise(share) => self.rates.corrupt = share,
            BusTrouble::Loss(share) => self.rates.overrun = share,
            BusTrouble::Double(share) => self.rates.last_but_one = share,
            BusTrouble::Heal => self.rates = Rates::default(),
        }
        self.network.bus.faults().set_rates(self.rates);
    }

    fn babble(&mut self, id: Option<u16>) {
        let bus = &mut self.network.bus;
        let frame = id.map(|id| Frame::data_frame(id, &[0xBA; 8]));
        if let (None, Some(_)) = (self.stranger, frame) {
            self.stranger = Some(bus.attach(TransmitOrder::Offered));
        }
        if let Some(port) = self.stranger {
            bus.babble(port, frame);
            // One that has stopped is taken off, so that it acknowledges nothing any more.
            bus.connect(port, frame.is_some());
        }
    }

    /// True for trouble with code or memory of a node that brings its own processor.
    fn is_beyond(&self, nodes: &[usize], trouble: Trouble) -> bool {
        let guests = nodes
            .iter()
            .any(|node| self.network.as_guest(*node).is_some());
        guests && matches!(trouble, Trouble::Memory | Trouble::Node(_))
    }

    fn trouble(&mut self, number: usize, trouble: Trouble) {
        let (now_ns, rng) = (self.network.now_ns(), &mut self.rng);
        let electronics = self.network.electronics(number);
        let break_part = |fault| electronics.chip().borrow_mut().set_fault(Some(fault));
        match trouble {
            Trouble::Stuck => break_part(Fault::MisoHigh),
            Trouble::Silent => break_part(Fault::MisoLow),
            Trouble::Spi => break_part(Fault::Bus),
            Trouble::ResetStuck => break_part(Fault::ResetStuck),
            Trouble::BrownOut => electronics.chip().borrow_mut().brown_out(now_ns),
            Trouble::Supply => {
                electronics.supply = Supply::unstable(now_ns as f64 * 1e-9, rng);
            }
            Trouble::Offset(g) => electronics.offset_g = [g, g, 0.0],
            Trouble::Memory => self
                .network
                .node(number)
                .device
                .memory()
                .flash_mut()
                .set_broken(true),
            Trouble::Sensor(fault) => electronics.inject(fault, rng.fork()),
            // Code that does not run can't stand still.
            Trouble::Node(NodeFault::Halted) if !self.network.nodes()[number].is_powered() => {}
            Trouble::Node(fault) => {
                let mut rng = rng.fork();
                self.network.inject(number, fault, &mut rng);
            }
        }
    }

    fn heal(&mut self, number: usize) {
        let now_s = self.network.now_s();
        let electronics = self.network.electronics(number);
        electronics.chip().borrow_mut().set_fault(None);
        electronics.supply.repair(now_s);
        electronics.offset_g = [0.0; 3];
        electronics.heal();
        if self.network.as_guest(number).is_none() {
            self.network
                .node(number)
                .device
                .memory()
                .flash_mut()
                .set_broken(false);
            self.network.heal(number);
        }
    }

    /// Power for one that has none; a node that has power keeps it.
    pub fn power_on(&mut self, number: usize) {
        if let Some(guest) = self.network.as_guest(number) {
            if !self.network.guest(guest).is_powered() {
                self.network.switch_guest(guest, Switch::On);
            }
        } else if !self.network.nodes()[number].is_powered() {
            self.network.power_on(number);
        }
    }

    fn power_off(&mut self, number: usize) {
        if let Some(guest) = self.network.as_guest(number) {
            return self.network.switch_guest(guest, Switch::Off);
        }
        self.end_halt(number);
        self.network.power_off(number);
    }

    fn reset(&mut self, number: usize) {
        if let Some(guest) = self.network.as_guest(number) {
            return self.network.switch_guest(guest, Switch::Reset);
        }
        if !self.end_halt(number) {
            self.network.reset(number);
        }
    }

    /// Code that stood still starts anew with a reset, and doesn't wait to be healed; true then.
    fn end_halt(&mut self, number: usize) -> bool {
        let halted = self.network.fault(number) == Some(NodeFault::Halted);
        if halted {
            self.network.heal(number);
        }
        halted
    }

    fn wire(&mut self, number: usize, on: bool) {
        if let Some(guest) = self.network.as_guest(number) {
            let switch = if on { Switch::Connect } else { Switch::Cut };
            return self.network.switch_guest(guest, switch);
        }
        let port = self.network.nodes()[number].port;
        self.network.bus.connect(port, on);
    }
}
