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
use std::rc::Rc;

use crate::bench_node::BenchNode;
use device::channel::Settings;
use device::factory;
use device::sensor::{SelfTest, SelfTestError};
use embedded_hal::spi::ErrorKind;
use instant::Instant;
use tilt::chain::Reading;
use tilt::composition::Whole;
use tilt::cross_check::{CrossCheck, Verdict};

use crate::TICK_S;
use crate::electronics::{Driver, Electronics};
use crate::error_model::ErrorModel;
use crate::lis2dw12::Chip;
use crate::motion::Motion;
use crate::rng::Rng;

/// One side of the instrument: its electronics and the node's code.
#[derive(Debug)]
pub struct Side {
    /// Sensor, supply and clock.
    pub electronics: Electronics,
    /// The node's code and state.
    pub node: BenchNode<Driver>,
    /// What the node runs with.
    pub settings: Settings,
    next_poll: Instant,
}

impl Side {
    fn new(settings: Settings, check: CrossCheck, model: &ErrorModel, rng: Rng) -> Self {
        let electronics = Electronics::with(&settings.part, model, rng);
        let driver = electronics.driver();
        let noise = model.known_noise();
        let mut settings = Settings { noise, ..settings };
        settings.chain.fusion = factory::fusion::<Whole>(&settings.part, noise);
        Self {
            electronics,
            node: BenchNode::new(driver, check),
            settings,
            next_poll: Instant(0),
        }
    }

    /// Starts or resets the node's code, at standstill in the pose of the last tick.
    fn start(&mut self) {
        let Self {
            electronics,
            node,
            settings,
            next_poll,
        } = self;
        electronics.run_waiting(|mut delay, now| {
            // A part that does not answer leaves the channel invalid with its reason; that is
            // what the readings then give, so there is nothing more to do with the error here.
            let _ = node.start(settings, &mut delay, now);
            *next_poll = now;
        });
    }

    #[inline]
    fn tick(&mut self, motion: &Motion, time_s: f64) {
        let Self {
            electronics,
            node,
            settings,
            ..
        } = self;
        let clock = *electronics.crystal();
        electronics.tick(motion, time_s, |edge| {
            node.channel.data_ready(settings, clock.at(edge.captured_s));
        });
        let now = clock.at(time_s);
        if now >= self.next_poll {
            self.electronics.settle(time_s);
            self.next_poll = self.node.channel.poll(&self.settings, now);
        }
    }

    /// What this side's clock shows at `time_s`.
    pub fn clock(&self, time_s: f64) -> Instant {
        self.electronics.clock(time_s)
    }

    /// The accelerometer LIS2DW12, for looking at.
    ///
    /// # Panics
    /// Where there is another part.
    pub fn chip(&self) -> &Rc<RefCell<Chip>> {
        let chip = self.electronics.lis2dw12();
        chip.expect("an LIS2DW12")
    }
}

/// Two sides on one housing.
#[derive(Debug)]
pub struct Instrument {
    /// Node 1 and node 2.
    pub sides: [Side; 2],
    ticks: u64,
}

/// What node 1 has of both nodes at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Both readings.
    pub readings: [Reading; 2],
    /// Both angles of this very moment, where there are gyroscopes; otherwise the readings.
    pub now: [Reading; 2],
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
            .for_each(|side| side.electronics.power_cycle());
        self.start();
    }

    /// Starts or resets the code of both nodes; takes some 25 ms of virtual time.
    pub fn start(&mut self) {
        for side in &mut self.sides {
            side.electronics.catch_up(self.ticks as f64 * TICK_S);
            side.start();
        }
        let reached_s = self
            .sides
            .iter()
            .map(|s| s.electronics.now_s())
            .fold(0.0, f64::max);
        self.ticks = (reached_s / TICK_S).ceil() as u64;
    }

    /// One tick of 1 ms in which the housing feels `motion`.
    #[inline]
    pub fn tick(&mut self, motion: &Motion) {
        self.ticks += 1;
        let time_s = self.time_s();
        for side in &mut self.sides {
            side.tick(motion, time_s);
        }
    }

    /// Lets `duration_s` pass without sampling, for hours in the chamber; the filters restart.
    pub fn skip(&mut self, duration_s: f64) {
        self.ticks += (duration_s / TICK_S).round() as u64;
        let time_s = self.time_s();
        for side in &mut self.sides {
            side.electronics.skip_to(time_s);
        }
    }

    /// Both dies take this temperature, degC.
    pub fn set_die_temperature(&mut self, die_c: f64) {
        self.sides
            .iter_mut()
            .for_each(|side| side.electronics.set_die_temperature(die_c));
    }

    /// Both nodes report at the same instant, and node 1 judges.
    pub fn sync(&mut self) -> Pair {
        let time_s = self.time_s();
        let [own, peer] = [0, 1].map(|i| {
            let side = &mut self.sides[i];
            let now = side.clock(time_s);
            side.node.observe(&side.settings, now)
        });
        let [first, _] = &mut self.sides;
        let now = first.clock(time_s);
        let verdict = first.node.judge(own, peer, now);
        let readings = [own, peer].map(|said| said.reading);
        let mut pair = Pair {
            readings,
            now: readings,
            verdict,
        };
        for (now, side) in pair.now.iter_mut().zip(&self.sides) {
            if side.settings.chain.fusion.is_some() {
                let channel = &side.node.channel;
                *now = channel.reading_now(&side.settings, side.clock(time_s));
            }
        }
        pair
    }

    /// The self-test of one side's part in the present pose (data sheet procedure).
    ///
    /// Takes about a second of that side's time. Errors: see [`SelfTestError`].
    ///
    /// # Panics
    /// Where there is no LIS2DW12.
    pub fn self_test(&mut self, node: usize) -> Result<SelfTest, SelfTestError<ErrorKind>> {
        let Side {
            electronics, node, ..
        } = &mut self.sides[node];
        let result = electronics.run_waiting(|mut delay, _| {
            let part = node.channel.part().lis2dw12();
            part.expect("an LIS2DW12").self_test(&mut delay)
        });
        self.start();
        result
    }
}
