//! The instrument in its world: two sensors, two clocks, two supplies, and the device code that
//! will be flashed.
//!
//! In: one [`Motion`] per tick. Out: the readings and verdicts of both nodes. Each side has its
//! own part, its own microcontroller clock and its own supply; nothing is shared but the housing.
//! The device code runs as it is, over the register-level chip.
//!
//! Left out: the bus (the readings pass between the nodes without delay or loss at the instant of
//! SYNC; the bus is simulated when the nodes speak CANopen) and the time that code takes to run.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use device::channel::Settings;
use device::node::Node;
use device::sensor::{SelfTest, SelfTestError};
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::ErrorKind;
use tilt::chain::Reading;
use tilt::cross_check::{CrossCheck, Verdict};
use tilt::sample::Instant;

use crate::TICK_S;
use crate::error_model::{ErrorModel, Part};
use crate::lis2dw12::{Chip, SpiPort, Traits};
use crate::low_pass::LowPass;
use crate::motion::Motion;
use crate::rng::Rng;
use crate::supply::{Condition, Supply, condition};

/// A microcontroller's crystal: within +-50 ppm, started at a time of its own.
#[derive(Clone, Copy, Debug)]
struct Clock {
    start_s: f64,
    rate: f64,
}

impl Clock {
    fn at(&self, time_s: f64) -> Instant {
        Instant(((time_s - self.start_s) * self.rate * 1e6) as u64)
    }
}

/// One part with its analogue side and its sampling clock.
#[derive(Debug)]
struct Sensor {
    chip: Rc<RefCell<Chip>>,
    part: Part,
    analogue: LowPass,
    felt_g: [f64; 3],
    now_s: f64,
    sampling: Option<Sampling>,
    rng: Rng,
}

/// What the part does while it converts.
#[derive(Clone, Copy, Debug)]
struct Sampling {
    next_s: f64,
    period_s: f64,
    sigma_g: f64,
}

fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}

impl Sensor {
    fn new(model: &ErrorModel, mut rng: Rng) -> Self {
        let part = Part::draw(model, &mut rng);
        let traits = Traits {
            full_register: !part.quantises(),
            ..Traits::TYPICAL
        };
        let chip = Rc::new(RefCell::new(Chip::new(traits)));
        chip.borrow_mut().power_on(0);
        Self {
            chip,
            part,
            analogue: LowPass::new(200.0),
            felt_g: [0.0, 0.0, 1.0],
            now_s: 0.0,
            sampling: None,
            rng,
        }
    }

    /// Follows what the part has been set up to do; the phase stays while the rate does.
    fn retune(&mut self) {
        let chip = self.chip.borrow();
        let Some(odr_hz) = chip.odr_hz() else {
            self.sampling = None;
            return;
        };
        self.analogue
            .retune(chip.bandwidth_hz().unwrap_or(odr_hz / 2.0));
        let period_s = 1.0 / (odr_hz * self.part.clock_factor());
        let sigma_g = chip.noise_density_ug() * 1e-6 * (odr_hz / 2.0).sqrt();
        let running = self.sampling.filter(|s| s.period_s == period_s);
        let next_s = running.map_or(self.now_s + period_s, |s| s.next_s);
        self.sampling = Some(Sampling {
            next_s,
            period_s,
            sigma_g,
        });
    }

    /// One tick up to `time_s`, in which the force goes to `force_g`; calls `ready` for samples.
    #[inline]
    fn tick(&mut self, force_g: [f64; 3], time_s: f64, mut ready: impl FnMut(f64)) {
        let before_g = self.felt_g;
        let before_s = self.now_s;
        self.felt_g = self.analogue.step(force_g);
        self.now_s = time_s;
        while let Some(sampling) = self.sampling.filter(|s| s.next_s <= time_s) {
            let due_s = sampling.next_s;
            let way = ((due_s - before_s) / (time_s - before_s).max(1e-9)).clamp(0.0, 1.0);
            let at_g = [0, 1, 2].map(|i| before_g[i] + way * (self.felt_g[i] - before_g[i]));
            self.convert(at_g, &sampling);
            if self.chip.borrow().data_ready() {
                ready(due_s);
            }
            self.sampling = Some(Sampling {
                next_s: due_s + sampling.period_s,
                ..sampling
            });
        }
    }

    fn convert(&mut self, force_g: [f64; 3], sampling: &Sampling) {
        let Sampling {
            next_s,
            period_s,
            sigma_g,
        } = *sampling;
        let felt_g = self.part.feel(force_g, sigma_g, period_s, &mut self.rng);
        let die_c = self.part.thermometer(&mut self.rng);
        let mut chip = self.chip.borrow_mut();
        chip.advance_to(nanoseconds(next_s));
        chip.convert(felt_g, die_c);
    }

    fn brown_out(&mut self, time_s: f64) {
        self.chip.borrow_mut().brown_out(nanoseconds(time_s));
        self.part.power_on(&mut self.rng);
        self.sampling = None;
    }

    fn power_cycle(&mut self) {
        let now_ns = nanoseconds(self.now_s);
        let mut chip = self.chip.borrow_mut();
        chip.power_off();
        chip.power_on(now_ns);
        drop(chip);
        self.part.power_on(&mut self.rng);
        self.sampling = None;
    }
}

/// Waiting, as the device sees it, while the housing stands still: samples go on coming.
struct Standing<'a> {
    sensor: &'a mut Sensor,
    force_g: [f64; 3],
}

impl DelayNs for Standing<'_> {
    fn delay_ns(&mut self, ns: u32) {
        self.sensor.retune();
        let end_s = self.sensor.now_s + f64::from(ns) * 1e-9;
        while self.sensor.now_s < end_s {
            let next_s = (self.sensor.now_s + TICK_S).min(end_s);
            self.sensor.tick(self.force_g, next_s, |_| {});
        }
        self.sensor.chip.borrow_mut().advance_to(nanoseconds(end_s));
    }
}

/// One side of the instrument: sensor, supply, clock and the node's code.
#[derive(Debug)]
pub struct Side {
    sensor: Sensor,
    /// The node's code and state.
    pub node: Node<SpiPort>,
    /// What the node runs with.
    pub settings: Settings,
    /// This side's supply.
    pub supply: Supply,
    condition: Condition,
    clock: Clock,
    next_poll: Instant,
}

impl Side {
    fn new(settings: Settings, check: CrossCheck, model: &ErrorModel, mut rng: Rng) -> Self {
        let clock = Clock {
            start_s: -rng.range(0.1, 10.0),
            rate: 1.0 + rng.range(-5e-5, 5e-5),
        };
        let sensor = Sensor::new(model, rng);
        let port = SpiPort::new(Rc::clone(&sensor.chip));
        Self {
            sensor,
            node: Node::new(port, check),
            settings,
            supply: Supply::steady(),
            condition: Condition::Good,
            clock,
            next_poll: Instant(0),
        }
    }

    /// Starts or resets the node's code, at standstill in the pose of the last tick.
    fn start(&mut self) {
        let now = self.clock.at(self.sensor.now_s);
        let force_g = self.sensor.felt_g;
        let mut delay = Standing {
            sensor: &mut self.sensor,
            force_g,
        };
        // A part that does not answer leaves the channel invalid with its reason; that is what
        // the readings then say, so there is nothing more to do with the error here.
        let _ = self.node.start(&self.settings, &mut delay, now);
        self.next_poll = now;
        self.sensor.retune();
    }

    #[inline]
    fn tick(&mut self, force_g: [f64; 3], time_s: f64) {
        self.follow_supply(time_s);
        let Self {
            sensor,
            node,
            settings,
            clock,
            ..
        } = self;
        sensor.tick(force_g, time_s, |due_s| {
            node.channel.data_ready(settings, clock.at(due_s));
        });
        let now = clock.at(time_s);
        if now >= self.next_poll {
            self.sensor
                .chip
                .borrow_mut()
                .advance_to(nanoseconds(time_s));
            self.next_poll = self.node.channel.poll(&self.settings, now);
        }
    }

    #[inline]
    fn follow_supply(&mut self, time_s: f64) {
        let now = condition(self.supply.step(time_s));
        if now == self.condition {
            return;
        }
        self.sensor.part.set_sag(now == Condition::Sag);
        if now == Condition::BrownOut || self.condition == Condition::BrownOut {
            self.sensor.brown_out(time_s);
        }
        self.condition = now;
    }

    /// What this side's clock shows at `time_s`.
    pub fn clock(&self, time_s: f64) -> Instant {
        self.clock.at(time_s)
    }

    /// The part's thermometer and chain temperature go with the die, degC.
    fn set_die_temperature(&mut self, die_c: f64) {
        self.sensor.part.set_die_temperature(die_c);
    }

    /// The part, for faults and for looking at.
    pub fn chip(&self) -> &Rc<RefCell<Chip>> {
        &self.sensor.chip
    }
}

/// Two sides on one housing.
#[derive(Debug)]
pub struct Instrument {
    /// Node 1 and node 2.
    pub sides: [Side; 2],
    ticks: u64,
    /// Node 2's readings on their way to node 1; empty while nothing is late.
    late: VecDeque<Reading>,
    late_syncs: usize,
}

/// What node 1 has of both nodes at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Node 1's reading, and node 2's as it arrives there.
    pub readings: [Reading; 2],
    /// Node 1's verdict on them.
    pub verdict: Verdict,
}

impl Instrument {
    /// A new instrument: both sides drawn from `seed` and `unit`, powered, level, not started.
    pub fn new(
        settings: &Settings,
        check: &CrossCheck,
        model: &ErrorModel,
        seed: u64,
        unit: u32,
    ) -> Self {
        let side = |node: u32| {
            let rng = Rng::stream(seed, &format!("unit {unit} node {node}"));
            Side::new(settings.clone(), check.clone(), model, rng)
        };
        Self {
            sides: [side(1), side(2)],
            ticks: 0,
            late: VecDeque::new(),
            late_syncs: 0,
        }
    }

    /// Virtual time in s.
    pub fn time_s(&self) -> f64 {
        self.ticks as f64 * TICK_S
    }

    /// Takes the power away and gives it back: new turn-on offsets; then starts the code.
    pub fn power_cycle(&mut self) {
        self.sides
            .iter_mut()
            .for_each(|side| side.sensor.power_cycle());
        self.start();
    }

    /// Starts or resets the code of both nodes; takes some 25 ms of virtual time.
    pub fn start(&mut self) {
        for side in &mut self.sides {
            side.sensor.now_s = side.sensor.now_s.max(self.ticks as f64 * TICK_S);
            side.start();
        }
        let reached_s = self
            .sides
            .iter()
            .map(|s| s.sensor.now_s)
            .fold(0.0, f64::max);
        self.ticks = (reached_s / TICK_S).ceil() as u64;
    }

    /// One tick of 1 ms in which the housing feels `motion`.
    #[inline]
    pub fn tick(&mut self, motion: &Motion) {
        self.ticks += 1;
        let time_s = self.time_s();
        for side in &mut self.sides {
            side.tick(motion.force_g, time_s);
        }
    }

    /// Lets `duration_s` pass without sampling, for hours in the chamber; the filters restart.
    pub fn skip(&mut self, duration_s: f64) {
        self.ticks += (duration_s / TICK_S).round() as u64;
        let time_s = self.time_s();
        for side in &mut self.sides {
            side.sensor.now_s = time_s;
            if let Some(sampling) = &mut side.sensor.sampling {
                sampling.next_s = time_s + sampling.period_s;
            }
        }
    }

    /// Both dies take this temperature, degC.
    pub fn set_die_temperature(&mut self, die_c: f64) {
        self.sides
            .iter_mut()
            .for_each(|side| side.set_die_temperature(die_c));
    }

    /// From now on node 2's readings reach node 1 this many SYNCs late; 0 is in time again.
    pub fn delay_peer(&mut self, syncs: usize) {
        self.late_syncs = syncs;
        self.late.clear();
    }

    /// What reaches node 1 of node 2's reading.
    fn arrive(&mut self, reading: Reading) -> Reading {
        if self.late_syncs == 0 {
            return reading;
        }
        self.late.push_back(reading);
        if self.late.len() > self.late_syncs {
            return self.late.pop_front().unwrap_or(reading);
        }
        self.late.front().copied().unwrap_or(reading)
    }

    /// Both nodes report at the same instant, and node 1 judges.
    pub fn sync(&mut self) -> Pair {
        let time_s = self.time_s();
        let [own, peer] = [0, 1].map(|i| {
            let side = &self.sides[i];
            side.node.reading(&side.settings, side.clock.at(time_s))
        });
        let readings = [own, self.arrive(peer)];
        let [own, _] = &mut self.sides;
        let now = own.clock.at(time_s);
        let verdict = own.node.judge(readings[0], readings[1], now);
        Pair { readings, verdict }
    }

    /// The self-test of one side's part in the present pose (data sheet procedure).
    ///
    /// Takes about a second of that side's time. Errors: see [`SelfTestError`].
    pub fn self_test(&mut self, node: usize) -> Result<SelfTest, SelfTestError<ErrorKind>> {
        let side = &mut self.sides[node];
        let force_g = side.sensor.felt_g;
        let mut delay = Standing {
            sensor: &mut side.sensor,
            force_g,
        };
        let result = side.node.channel.part().self_test(&mut delay);
        self.start();
        result
    }
}
