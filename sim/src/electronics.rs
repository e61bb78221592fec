//! The hardware of one side: a part with its analogue side, a crystal and a supply.
//!
//! In: how the housing moves, tick by tick, and faults on demand. Out: data-ready edges
//! with their time, and the register-level chip behind an SPI port. Whatever code runs on that
//! side is the caller's: [`crate::instrument`] runs a channel alone, [`crate::network`] a whole
//! CANopen device.
//!
//! Left out: the microcontroller, and the time that code takes to run.

mod fitted;

pub use fitted::Driver;

use std::cell::RefCell;
use std::rc::Rc;

use device::sensor::{Config, PartConfig};
use embedded_hal::delay::DelayNs;
use instant::Instant;

use crate::TICK_S;
use crate::error_model::gyroscope::Gyroscope;
use crate::error_model::{ErrorModel, Part};
use crate::fault::{Injected, SensorFault};
use crate::lis2dw12::Chip;
use crate::low_pass::LowPass;
use crate::motion::{Motion, add};
use crate::rng::Rng;
use crate::spi_part::{Fault, Slave};
use crate::supply::{Condition, Supply};
use fitted::{Felt, Fitted};

/// A microcontroller's crystal: within +-50 ppm, started at a time of its own.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    start_s: f64,
    /// Microseconds that it counts in a second.
    us_per_s: f64,
    ns_per_us: f64,
}

impl Clock {
    /// Seconds that it counts in one of the world's.
    pub fn rate(&self) -> f64 {
        self.us_per_s * 1e-6
    }

    /// What the clock shows at `time_s`.
    pub fn at(&self, time_s: f64) -> Instant {
        Instant(whole((time_s - self.start_s) * self.us_per_s))
    }

    /// When the clock shows `instant`, s: the earliest time at which [`Clock::at`] gives it.
    pub fn when(&self, instant: Instant) -> f64 {
        instant.0 as f64 / self.us_per_s + self.start_s
    }
}

/// One part with its analogue side and its sampling clock.
#[derive(Debug)]
struct Sensor {
    fitted: Fitted,
    part: Part,
    analogue: LowPass,
    /// What the last tick ended with behind the analogue side.
    felt_g: [f64; 3],
    now_s: f64,
    sampling: Option<Sampling>,
    rng: Rng,
    fault: Option<Box<Injected>>,
}

/// A data-ready edge; times of the world, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// When the code gets it.
    pub at_s: f64,
    /// When it came and its sample was taken: the time stamp. The same, unless samples are late.
    pub captured_s: f64,
}

/// What the part does while it converts.
#[derive(Clone, Copy, Debug)]
struct Sampling {
    next_s: f64,
    period_s: f64,
    sigma_g: f64,
}

/// The whole part of a time, 0 of one before 0.
///
/// By way of signed numbers, which the processor converts by itself; no time is beyond them.
#[inline]
pub(crate) fn whole(time: f64) -> u64 {
    (time as i64).max(0) as u64
}

/// Rounded as `round` does, whose call would cost more than all the rest.
fn nanoseconds(time_s: f64) -> u64 {
    let time_ns = time_s * 1e9;
    let cut_ns = whole(time_ns);
    cut_ns + u64::from(time_ns - cut_ns as i64 as f64 >= 0.5)
}

impl Sensor {
    fn new(config: &PartConfig, model: &ErrorModel, mut rng: Rng) -> Self {
        let part = Part::draw(model, &mut rng);
        let mut fitted = Fitted::new(config, (model, &part), &mut rng);
        fitted.power_on(0);
        Self {
            fitted,
            part,
            analogue: LowPass::new(200.0),
            felt_g: [0.0, 0.0, 1.0],
            now_s: 0.0,
            sampling: None,
            rng,
            fault: None,
        }
    }

    /// Follows what the part has been set up to do; the phase stays while the rate does.
    fn retune(&mut self) {
        let Some(odr_hz) = self.fitted.odr_hz() else {
            self.sampling = None;
            return;
        };
        self.fitted.retune(&mut self.analogue, odr_hz);
        let period_s = 1.0 / (odr_hz * self.part.clock_factor());
        let sigma_g = self.fitted.noise_density_ug() * 1e-6 * (odr_hz / 2.0).sqrt();
        let running = self.sampling.filter(|s| s.period_s == period_s);
        let next_s = running.map_or(self.now_s + period_s, |s| s.next_s);
        self.sampling = Some(Sampling {
            next_s,
            period_s,
            sigma_g,
        });
    }

    /// One tick up to `time_s`, in which the force goes to that of `felt`; calls `ready` for
    /// samples.
    #[inline]
    fn tick(&mut self, felt: &Felt, time_s: f64, ready: impl FnMut(Edge)) {
        if self.sampling.is_some_and(|s| s.next_s <= time_s) {
            return self.tick_with_samples(felt, time_s, ready);
        }
        self.felt_g = self.analogue.step(felt.force_g);
        self.fitted.turn(felt.rate_dps);
        self.now_s = time_s;
    }

    fn tick_with_samples(&mut self, felt: &Felt, time_s: f64, mut ready: impl FnMut(Edge)) {
        let before = self.analogue.moment();
        let turning = self.fitted.turn(felt.rate_dps);
        let before_s = self.now_s;
        self.felt_g = self.analogue.step(felt.force_g);
        self.now_s = time_s;
        let after = self.analogue.moment();
        while let Some(sampling) = self.sampling.filter(|s| s.next_s <= time_s) {
            let due_s = sampling.next_s;
            let way = ((due_s - before_s) / (time_s - before_s).max(1e-9)).clamp(0.0, 1.0);
            let felt = Felt {
                force_g: before.towards(&after, way),
                rate_dps: turning.map_or([0.0; 3], |[from, to]| from.towards(&to, way)),
            };
            self.convert(&felt, &sampling);
            if self.fitted.data_ready()
                && let Some(edge) = self.edge(due_s)
            {
                ready(edge);
            }
            if let Some(sampling) = &mut self.sampling {
                sampling.next_s = due_s + sampling.period_s;
            }
        }
    }

    /// What becomes of the edge of `due_s`; `None` when it gets lost.
    #[inline]
    fn edge(&mut self, due_s: f64) -> Option<Edge> {
        let mut captured_s = due_s;
        if let Some(fault) = &mut self.fault {
            if !fault.arrives() {
                return None;
            }
            captured_s = fault.captured_s(due_s);
        }
        Some(Edge {
            at_s: due_s,
            captured_s,
        })
    }

    fn convert(&mut self, felt: &Felt, sampling: &Sampling) {
        let Self {
            part,
            fitted,
            rng,
            fault,
            ..
        } = self;
        let Sampling {
            next_s, period_s, ..
        } = *sampling;
        let noise = fault.as_ref().map_or(1.0, |fault| fault.noise());
        let mut felt_g = part.feel(felt.force_g, sampling.sigma_g * noise, period_s, rng);
        if let Some(fault) = fault {
            felt_g = fault.force_g(felt_g, next_s);
        }
        let rate_noise = fault.as_ref().map_or(1.0, |fault| fault.rate_noise());
        let mut rate_dps = fitted.feel_rate(felt, (rate_noise, period_s), rng);
        if let Some(fault) = fault {
            rate_dps = fault.rate_dps(rate_dps);
        }
        fitted.advance_to(nanoseconds(next_s));
        let mut die_c = match fitted.reads_temperature() {
            true => part.thermometer(rng),
            false => part.die_c(),
        };
        let felt = Felt {
            force_g: felt_g,
            rate_dps,
        };
        match fault {
            None => fitted.convert(&felt, die_c),
            Some(fault) => {
                die_c = fault.thermometer_c(die_c);
                fitted.convert_through(&felt, die_c, |[force, rate]| {
                    [fault.codes(force, next_s), fault.rate_codes(rate)]
                });
            }
        }
    }

    /// What an injected fault leaves of the supply in the tick that ends at `time_s`.
    ///
    /// A part cannot boot before its supply is back, however long that takes.
    fn starve(&mut self, time_s: f64) -> Condition {
        let supply = (self.fault.as_ref()).map_or(Condition::Good, |f| f.supply(time_s));
        if supply == Condition::BrownOut {
            self.fitted.brown_out(nanoseconds(time_s));
        }
        supply
    }

    fn brown_out(&mut self, time_s: f64) {
        self.fitted.brown_out(nanoseconds(time_s));
        self.part.power_on(&mut self.rng);
        self.fitted.renew(&mut self.rng);
        self.sampling = None;
    }

    fn power_cycle(&mut self) {
        let now_ns = nanoseconds(self.now_s);
        self.fitted.power_off();
        self.fitted.power_on(now_ns);
        self.part.power_on(&mut self.rng);
        self.fitted.renew(&mut self.rng);
        self.sampling = None;
    }
}

/// Waiting, as the device sees it, while the housing stands still: samples go on coming.
struct DelayAtRest<'a> {
    sensor: &'a mut Sensor,
    felt: Felt,
}

impl DelayNs for DelayAtRest<'_> {
    fn delay_ns(&mut self, ns: u32) {
        self.sensor.retune();
        let end_s = self.sensor.now_s + f64::from(ns) * 1e-9;
        while self.sensor.now_s < end_s {
            let next_s = (self.sensor.now_s + TICK_S).min(end_s);
            self.sensor.tick(&self.felt, next_s, |_| {});
            self.sensor.starve(next_s);
        }
        self.sensor.fitted.advance_to(nanoseconds(end_s));
    }
}

/// Sensor, supply and clock of one side.
#[derive(Debug)]
pub struct Electronics {
    sensor: Sensor,
    /// This side's supply.
    pub supply: Supply,
    /// What this side feels beside the housing, g: its board has come loose. Zero by default.
    pub offset_g: [f64; 3],
    condition: Condition,
    clock: Clock,
}

impl Electronics {
    /// With an LIS2DW12, drawn from `rng`; powered, level.
    pub fn new(model: &ErrorModel, rng: Rng) -> Self {
        Self::with(&PartConfig::Lis2dw12(Config::PRODUCT), model, rng)
    }

    /// With the part that `config` is for, drawn from `rng`; powered, level, not set up.
    pub fn with(config: &PartConfig, model: &ErrorModel, mut rng: Rng) -> Self {
        let start_s = -rng.range(0.1, 10.0);
        let rate = 1.0 + rng.range(-5e-5, 5e-5);
        let clock = Clock {
            start_s,
            us_per_s: rate * 1e6,
            ns_per_us: 1e3 / rate,
        };
        Self {
            sensor: Sensor::new(config, model, rng),
            supply: Supply::steady(),
            offset_g: [0.0; 3],
            condition: Condition::Good,
            clock,
        }
    }

    /// The driver of the part, for the code of this side.
    pub fn driver(&self) -> Driver {
        self.sensor.fitted.driver()
    }

    /// The part at the wires, for code that drives them itself.
    pub fn slave(&self) -> Rc<RefCell<dyn Slave>> {
        self.sensor.fitted.slave()
    }

    /// The gyroscope's errors, for looking at; `None` where the part has none.
    pub fn gyroscope(&self) -> Option<&Gyroscope> {
        self.sensor.fitted.gyroscope()
    }

    /// The accelerometer LIS2DW12, for looking at; `None` where there is another part.
    pub fn lis2dw12(&self) -> Option<&Rc<RefCell<Chip>>> {
        self.sensor.fitted.lis2dw12()
    }

    /// Injects a fault of the part or its wires, or ends it.
    pub fn set_part_fault(&mut self, fault: Option<Fault>) {
        self.sensor.fitted.set_fault(fault);
    }

    /// The fault of the part or its wires that is injected.
    pub fn part_fault(&self) -> Option<Fault> {
        self.sensor.fitted.fault()
    }

    /// The part's supply fails for a moment at `time_ns`, and its set-up is lost.
    pub fn brown_out(&mut self, time_ns: u64) {
        self.sensor.fitted.brown_out(time_ns);
    }

    /// The crystal that this side's time comes from.
    pub fn crystal(&self) -> &Clock {
        &self.clock
    }

    /// What this side's clock shows at `time_s`.
    pub fn clock(&self, time_s: f64) -> Instant {
        self.clock.at(time_s)
    }

    /// When this side's clock shows `instant`, ns of the world, never too early.
    pub fn when_ns(&self, instant: Instant) -> u64 {
        // Signed numbers are the ones that the processor converts by itself, and there is no
        // instant beyond them.
        let shown_us = i64::try_from(instant.0).unwrap_or(i64::MAX) as f64;
        let time_ns = shown_us * self.clock.ns_per_us + self.clock.start_s * 1e9;
        whole(time_ns) + 1001
    }

    /// Virtual time that this side has reached, s.
    pub fn now_s(&self) -> f64 {
        self.sensor.now_s
    }

    /// Lets this side's time start no earlier than `time_s`.
    pub fn catch_up(&mut self, time_s: f64) {
        self.sensor.now_s = self.sensor.now_s.max(time_s);
    }

    /// Runs `code` that waits on a delay while the housing stands still: samples go on coming.
    ///
    /// `code` also gets this side's time at its beginning. Takes as long as it waits.
    pub fn run_waiting<R>(&mut self, code: impl FnOnce(&mut dyn DelayNs, Instant) -> R) -> R {
        let now = self.clock.at(self.sensor.now_s);
        let felt = Felt {
            force_g: self.sensor.felt_g,
            rate_dps: [0.0; 3],
        };
        let mut delay = DelayAtRest {
            sensor: &mut self.sensor,
            felt,
        };
        let result = code(&mut delay, now);
        self.sensor.retune();
        result
    }

    /// One tick up to `time_s`; calls `ready` with each data-ready edge.
    #[inline]
    pub fn tick(&mut self, motion: &Motion, time_s: f64, ready: impl FnMut(Edge)) {
        self.follow_supply(time_s);
        let felt = Felt {
            force_g: add(motion.force_g, self.offset_g),
            rate_dps: motion.rate_dps,
        };
        self.sensor.tick(&felt, time_s, ready);
    }

    /// Brings the chip's own time up to `time_s`, before code talks to it between samples.
    pub fn settle(&self, time_s: f64) {
        self.sensor.fitted.advance_to(nanoseconds(time_s));
    }

    #[inline]
    fn follow_supply(&mut self, time_s: f64) {
        let mut now = self.supply.condition(time_s);
        if self.sensor.fault.is_some() {
            let fault = self.sensor.starve(time_s);
            now = if fault as u8 > now as u8 { fault } else { now };
        }
        if now == self.condition {
            return;
        }
        self.sensor.part.set_sag(now == Condition::Sag);
        self.sensor.fitted.set_sag(now == Condition::Sag);
        if now == Condition::BrownOut || self.condition == Condition::BrownOut {
            self.sensor.brown_out(time_s);
        }
        self.condition = now;
    }

    /// From now on this goes wrong, instead of what went wrong before; `rng` is the fault's own.
    pub fn inject(&mut self, fault: SensorFault, rng: Rng) {
        let now_s = self.sensor.now_s;
        self.sensor.fault = Some(Box::new(Injected::new(fault, now_s, rng)));
    }

    /// Ends the fault that was injected. A part that it has reset stays so.
    pub fn heal(&mut self) {
        self.sensor.fault = None;
    }

    /// The fault that was injected.
    pub fn fault(&self) -> Option<SensorFault> {
        self.sensor.fault.as_ref().map(|fault| fault.fault())
    }

    /// Takes the power away and gives it back: new turn-on offsets.
    pub fn power_cycle(&mut self) {
        self.sensor.power_cycle();
    }

    /// Lets time pass up to `time_s` without sampling.
    pub fn skip_to(&mut self, time_s: f64) {
        self.sensor.now_s = time_s;
        if let Some(sampling) = &mut self.sensor.sampling {
            sampling.next_s = time_s + sampling.period_s;
        }
    }

    /// The part's thermometer and chain temperature go with the die, degC.
    pub fn set_die_temperature(&mut self, die_c: f64) {
        self.sensor.part.set_die_temperature(die_c);
        self.sensor.fitted.set_die_temperature(die_c);
    }
}
