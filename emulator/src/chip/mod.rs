//! The chip around the core: an STM32F103 register by register.
//!
//! In: loads and stores of the code, blocks of instructions as they run, edges of pins, what the
//! bus tells. Out: exceptions, actions on the bus, requests for a reset, and the counts of
//! instructions and cycles. One module per peripheral; `bus` has the map of addresses and
//! a clock, this one when somebody next wants attention.
//!
//! Source: RM0008 10.1.2 (interrupts).
//! Left out: DMA, ADC, USART, I2C, USB, RTC, window watchdog, TIM1: they read as 0.

pub mod bit_band;
mod bus;
pub mod can;
pub mod clock;
pub mod crc;
pub mod exti;
pub mod flash_controller;
pub mod gpio;
pub mod nvic;
pub mod rcc;
pub mod spi;
pub mod system;
pub mod tap;
pub mod timer;
pub mod watchdog;

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use flash::layout::Layout;
use sim::spi_part::Slave;

use crate::code::{Block, Code};
use can::Can;
use clock::{Clock, Known};
use crc::Crc;
use exti::Exti;
use flash_controller::FlashController;
use gpio::Gpio;
use nvic::Nvic;
use rcc::{Cause, Rcc};
use spi::{Spi, Wire};
use system::System;
use tap::{Deed, Tap};
use timer::Timer;
use watchdog::Watchdog;

/// The sensor's chip select: PA4.
const SELECT: u8 = 4;
/// Ports A to E.
const PORTS: usize = 5;
/// TIM2 to TIM4.
const TIMERS: usize = 3;

/// What one part has that another has not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Individual {
    /// The unique identity (RM0008 30.2).
    pub identity: [u32; 3],
    /// What its crystal makes of a second, 1 for exact.
    pub crystal: f64,
    /// The watchdog's oscillator, Hz: 30 000 to 60 000.
    pub lsi_hz: u32,
    /// For what a power cut leaves in the flash.
    pub seed: u64,
}

/// The sensor at the other end of SPI1.
#[derive(Clone, Debug)]
struct Sensor {
    chip: Rc<RefCell<dyn Slave>>,
    selected: bool,
    /// Here, since the sensor's bytes pass here.
    tap: Tap,
}

impl Wire for Sensor {
    fn exchange(&mut self, byte: u8) -> u8 {
        match self.selected {
            true => {
                let answer = self.chip.borrow_mut().exchange(byte);
                self.tap.note(Deed::Byte(byte, answer));
                answer
            }
            // Nobody drives the line; it has a pull-up.
            false => 0xFF,
        }
    }
}

/// An edge that will come to pin PA0.
#[derive(Clone, Copy, Debug)]
struct Edge {
    at_ns: u64,
    level: bool,
}

/// The chip.
#[derive(Debug)]
pub struct Chip {
    /// What is known of the code.
    pub code: Code,
    /// The interrupt controller.
    pub nvic: Nvic,
    /// The CAN controller.
    pub can: Can,
    /// The flash.
    pub flash: FlashController,
    /// The core's own registers.
    pub system: System,
    layout: Layout,
    individual: Individual,
    clock: Clock,
    cycles: u64,
    /// Those of them in which no instruction was executed.
    idle: u64,
    /// The cycle from which on somebody wants attention.
    attention: u64,
    /// The cycle at which everybody last had it.
    attended: u64,
    /// The cycle up to which the core may run.
    limit: u64,
    /// An SEV or an exception has come since the last WFE (PM0056 2.5.3).
    event: bool,
    rcc: Rcc,
    ports: [Gpio; PORTS],
    exti: Exti,
    spi: Spi,
    timers: [Timer; TIMERS],
    watchdog: Watchdog,
    crc: Crc,
    pwr: u32,
    sensor: Sensor,
    edges: VecDeque<Edge>,
    /// The cycle of the first of them, and that of the watchdog's bite.
    edge: Known,
    bite: Known,
    reset: Option<Cause>,
    /// The supply has failed in a flash operation.
    cut: bool,
    /// Addresses in code that are watched, and when the code came to them.
    watched: Vec<u32>,
    passed: Vec<(u32, u64)>,
    /// A store was refused by the bus, and that has not reached the core yet.
    bad_store: bool,
}

/// Time, reset and the core's side.
impl Chip {
    /// A chip that has just got power, at `now_ns`, with a sensor at SPI1.
    pub fn new(
        layout: Layout,
        individual: Individual,
        sensor: Rc<RefCell<dyn Slave>>,
        now_ns: u64,
    ) -> Self {
        Self {
            code: Code::new(layout.flash),
            nvic: Nvic::default(),
            can: Can::default(),
            flash: FlashController::new(&layout, individual.seed),
            system: System::of(&layout),
            layout,
            individual,
            clock: Clock::new(now_ns, 8_000_000, individual.crystal),
            cycles: 0,
            idle: 0,
            attention: 0,
            attended: 0,
            limit: 0,
            event: false,
            rcc: Rcc::reset(Cause::Power, 0),
            ports: Default::default(),
            exti: Exti::default(),
            spi: Spi::default(),
            timers: Default::default(),
            watchdog: Watchdog::new(individual.lsi_hz),
            crc: Crc::default(),
            pwr: 0,
            sensor: Sensor {
                chip: sensor,
                selected: false,
                tap: Tap::default(),
            },
            edges: VecDeque::new(),
            edge: Known::default(),
            bite: Known::default(),
            reset: None,
            cut: false,
            bad_store: false,
            watched: Vec::new(),
            passed: Vec::new(),
        }
    }

    /// Everything as after a reset.
    pub fn restart(&mut self, cause: Cause) {
        let before = match cause {
            Cause::Power => 0,
            _ => self.rcc.flags(),
        };
        self.rcc = Rcc::reset(cause, before);
        self.clock.set_hz(self.cycles, self.rcc.frequencies().hclk);
        self.nvic = Nvic::default();
        self.system = System::of(&self.layout);
        match cause {
            Cause::Power => self.flash.power_up(),
            _ => self.flash.reset(),
        }
        self.can = Can::default();
        self.ports.iter_mut().for_each(Gpio::reset);
        self.exti = Exti::default();
        self.spi = Spi::default();
        self.timers = Default::default();
        self.watchdog.reset();
        self.crc = Crc::default();
        (self.pwr, self.reset, self.cut, self.bad_store) = (0, None, false, false);
        self.event = false;
        self.attention = 0;
        self.follow_select();
    }

    /// Flash, bytes.
    pub fn flash_size(&self) -> u32 {
        self.layout.flash
    }

    /// RAM, bytes.
    pub fn ram_size(&self) -> u32 {
        self.layout.ram
    }

    /// Time of the world that this part has come to, ns.
    pub fn now_ns(&self) -> u64 {
        self.clock.ns(self.cycles)
    }

    /// Instructions executed since it was made.
    pub fn instructions(&self) -> u64 {
        self.cycles - self.idle
    }

    /// Watches for code that comes to these addresses, instead of those before.
    pub fn watch(&mut self, addresses: &[u32]) {
        self.watched = addresses.to_vec();
        self.passed.clear();
    }

    /// Which of the watched addresses the code has come to since then, and how many instructions
    /// it had executed before each time.
    pub fn passed(&self) -> &[(u32, u64)] {
        &self.passed
    }

    /// Whether anybody asks where code runs: then [`Chip::observe`] is to be told of blocks.
    #[inline]
    pub fn is_observed(&self) -> bool {
        !self.watched.is_empty() || self.code.is_counted()
    }

    /// Whether [`Chip::watch`] has addresses to watch.
    #[inline(always)]
    pub fn is_watched(&self) -> bool {
        !self.watched.is_empty()
    }

    /// Notes a block that is about to run, and its bytes, before [`Chip::begin`].
    pub fn observe(&mut self, address: u32, block: Block, bytes: &[u8]) {
        self.code.ran(address, block.instructions);
        self.pass_watched(address, bytes);
    }

    /// Notes which of the watched addresses are in a block that is about to run.
    pub fn pass_watched(&mut self, address: u32, bytes: &[u8]) {
        for watched in &self.watched {
            let Some(before) = watched.checked_sub(address).map(|offset| offset as usize) else {
                continue;
            };
            if before < bytes.len()
                && let Some(bytes) = bytes.get(..before)
            {
                let instructions = u64::from(Block::of(bytes).instructions);
                self.passed
                    .push((*watched, self.instructions() + instructions));
            }
        }
    }

    /// What the code exchanges with sensor, clock and CAN controller.
    pub fn tap(&mut self) -> &mut Tap {
        &mut self.sensor.tap
    }

    /// Cycles passed since it was made: instructions, sleep, and waits for the flash.
    pub fn cycles(&self) -> u64 {
        self.cycles
    }

    /// What the core's clock is, Hz, as the code has set it.
    pub fn hclk_hz(&self) -> u32 {
        self.rcc.frequencies().hclk
    }

    /// Cycles of PCLK1 as a bit rate of the world: `per_bit` cycles in a bit, bit/s.
    pub fn bit_rate(&self, per_bit: u32) -> u32 {
        let pclk1 = self.rcc.frequencies().pclk1;
        (pclk1 + per_bit / 2) / per_bit.max(1)
    }

    /// Flags of resets, as RCC_CSR shows them (RM0008 7.3.10).
    pub fn reset_flags(&self) -> u32 {
        self.rcc.flags()
    }

    /// The core may run until `ns`.
    pub fn set_limit_ns(&mut self, ns: u64) {
        self.limit = self.clock.cycle(ns);
        self.attention = 0;
    }

    /// Whether that time has come.
    pub fn is_at_limit(&self) -> bool {
        self.cycles >= self.limit
    }

    /// A reset that was asked for.
    pub fn wanted_reset(&self) -> Option<Cause> {
        let software = self.system.wants_reset().then_some(Cause::Software);
        self.reset.or(software)
    }

    /// The reset pin, or the supply.
    pub fn want_reset(&mut self, cause: Cause) {
        self.reset = Some(cause);
        self.attention = 0;
    }

    /// Whether the supply has failed in a flash operation.
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// Whether a store was refused by the bus since this was last asked.
    pub fn take_bad_store(&mut self) -> bool {
        std::mem::take(&mut self.bad_store)
    }

    /// Whether something wants [`Chip::attend`] before the next block.
    #[inline]
    pub fn needs_attention(&self) -> bool {
        self.cycles >= self.attention
    }

    /// Whether the core is to stop before the next block, whatever its masks are.
    pub fn wants_stop(&self) -> bool {
        self.is_at_limit()
            || self.can.has_actions()
            || self.flash.is_changed()
            || self.wanted_reset().is_some()
            || self.cut
            || self.bad_store
    }

    /// A block is about to run.
    #[inline]
    pub fn begin(&mut self, block: Block) {
        // Wrapping, as a check would be made at each block: it does so in 8 000 years.
        self.cycles = self.cycles.wrapping_add(block.instructions.into());
        self.event |= block.sends_event;
    }

    /// A block at `address` is about to run that sends no event, or does so by itself: what
    /// [`Chip::observe`] and [`Chip::begin`] do without addresses that are watched.
    #[inline(always)]
    pub fn count(&mut self, address: u32, instructions: u32) {
        self.code.ran(address, instructions);
        self.cycles = self.cycles.wrapping_add(instructions.into());
    }

    /// Instructions of the block under way that were not executed.
    pub fn take_back(&mut self, instructions: u32) {
        self.cycles -= u64::from(instructions);
    }

    /// The core is to stop: something is asked before the next block.
    pub fn call(&mut self) {
        self.attention = 0;
    }

    /// Comes to a cycle without instructions.
    fn pass(&mut self, cycle: u64) {
        self.idle += cycle.saturating_sub(self.cycles);
        self.cycles = cycle.max(self.cycles);
    }

    /// Takes the event that ends a WFE, if there is one.
    pub fn take_event(&mut self) -> bool {
        std::mem::take(&mut self.event)
    }

    /// The code sends an event (SEV).
    pub fn send_event(&mut self) {
        self.event = true;
    }

    /// An exception begins or ends: an event for WFE (PM0056 2.5.3).
    pub fn set_event(&mut self) {
        self.event = true;
        self.attention = 0;
    }

    /// Lets time pass without instructions up to what comes next, or to the limit.
    pub fn sleep(&mut self) {
        self.attend();
        let until = self.next_event().min(self.limit);
        self.pass(until);
        self.attend();
    }

    /// Lets time pass without instructions up to `ns`, if that is later than now.
    pub fn skip_to(&mut self, ns: u64) {
        self.pass(self.clock.cycle(ns));
        self.attention = 0;
    }

    /// When something happens by itself, ns; `u64::MAX` for never.
    pub fn wakes_ns(&mut self) -> u64 {
        match self.next_event() {
            u64::MAX => u64::MAX,
            cycle => self.clock.ns(cycle.max(self.cycles)),
        }
    }

    /// Whether there is an event that ends a WFE.
    pub fn has_event(&self) -> bool {
        self.event
    }

    /// Lets every peripheral come to now, and asks who wants what when; unless that is done, and
    /// neither has time passed since nor has anything happened that calls for it.
    #[inline]
    pub fn attend(&mut self) {
        if self.attention == 0 || self.attended != self.cycles {
            self.attend_now();
        }
    }

    fn attend_now(&mut self) {
        self.attended = self.cycles;
        self.take_edges();
        let (now, steps) = (self.cycles, self.timer_step());
        for timer in &mut self.timers {
            timer.follow(now, steps);
        }
        self.spi.advance(now, self.per_pclk2(), &mut self.sensor);
        self.system.advance(now, &mut self.nvic);
        if self.is_bitten() {
            self.reset = Some(Cause::Watchdog);
        }
        self.nvic.set_lines(self.lines());
        self.attention = match self.nvic.first() {
            // The core's masks may open at any block.
            Some(_) => 0,
            None => self.next_event().min(self.limit),
        };
    }

    /// Whether the watchdog has bitten.
    fn is_bitten(&mut self) -> bool {
        let Some(at_ns) = self.watchdog.bites_ns() else {
            return false;
        };
        // A whole ns may come a cycle before its own.
        let cycle = self.clock.cycle_known(at_ns, &mut self.bite);
        self.cycles + 1 >= cycle && at_ns <= self.now_ns()
    }

    /// When something happens by itself, cycles; `u64::MAX` for never.
    fn next_event(&mut self) -> u64 {
        let steps = self.timer_step();
        let mut next = u64::MAX;
        for timer in &self.timers {
            next = next.min(timer.next_event(steps).unwrap_or(u64::MAX));
        }
        if let Some(at_ns) = self.watchdog.bites_ns() {
            next = next.min(self.clock.cycle_known(at_ns, &mut self.bite));
        }
        let others = [
            self.spi.next_event(),
            self.system.next_event(),
            self.next_edge(),
        ];
        for other in others.into_iter().flatten() {
            next = next.min(other);
        }
        next
    }

    /// When the next edge comes, cycles.
    fn next_edge(&mut self) -> Option<u64> {
        let edge = self.edges.front()?;
        Some(self.clock.cycle_known(edge.at_ns, &mut self.edge))
    }

    /// The interrupts that ask, bit n for interrupt n (RM0008 10.1.2, table 63).
    fn lines(&self) -> u64 {
        let [transmit, first, second, state] = self.can.lines();
        let mut lines = self.exti.lines();
        lines |= u64::from(self.flash.line()) << 4;
        lines |= u64::from(transmit) << 19 | u64::from(first) << 20;
        lines |= u64::from(second) << 21 | u64::from(state) << 22;
        for (timer, number) in self.timers.iter().zip(28..) {
            lines |= u64::from(timer.line()) << number;
        }
        lines | u64::from(self.spi.line()) << 35
    }

    /// Cycles of HCLK in one of PCLK2.
    fn per_pclk2(&self) -> u32 {
        self.rcc.ratios().pclk2
    }

    /// Cycles of HCLK in one of the timers' clock.
    fn timer_step(&self) -> u32 {
        self.rcc.ratios().timers
    }
}

/// Pins.
impl Chip {
    /// The board drives a pin of port A (0) to E (4).
    pub fn drive(&mut self, port: usize, pin: u8, level: Option<bool>) {
        if let Some(port) = self.ports.get_mut(port) {
            port.drive(pin, level);
        }
    }

    /// The level of a pin.
    pub fn level(&self, port: usize, pin: u8) -> bool {
        self.ports.get(port).is_some_and(|port| port.level(pin))
    }

    /// PA0 will change to `level` at `at_ns`.
    pub fn plan_edge(&mut self, at_ns: u64, level: bool) {
        let later = self.edges.iter().position(|edge| edge.at_ns > at_ns);
        let place = later.unwrap_or(self.edges.len());
        self.edges.insert(place, Edge { at_ns, level });
        self.attention = 0;
    }

    fn take_edges(&mut self) {
        while let Some(cycle) = self.next_edge().filter(|cycle| *cycle <= self.cycles) {
            let Some(edge) = self.edges.pop_front() else {
                return;
            };
            let before = self.level(0, 0);
            if !edge.level {
                // The end of a pulse; a part that does not pulse holds its pin until it is read.
                let mut sensor = self.sensor.chip.borrow_mut();
                sensor.advance_to(edge.at_ns);
                if sensor.int1() {
                    continue;
                }
            }
            self.drive(0, 0, Some(edge.level));
            if before == edge.level {
                continue;
            }
            self.exti.edge(0, 0, edge.level);
            let steps = self.timer_step();
            self.timers[0].edge(0, edge.level, cycle, steps);
        }
    }

    /// The sensor's chip select follows its pin; without an output its pull-up holds it high.
    fn follow_select(&mut self) {
        let port = &self.ports[0];
        let selected = port.is_output(SELECT) && !port.level(SELECT);
        if selected == self.sensor.selected {
            return;
        }
        self.sensor.selected = selected;
        self.sensor.tap.enter(self.nvic.running());
        self.sensor.tap.note(Deed::Select(selected));
        let now_ns = self.now_ns();
        let mut chip = self.sensor.chip.borrow_mut();
        chip.advance_to(now_ns);
        match selected {
            true => chip.select(),
            false => chip.deselect(),
        }
        drop(chip);
        self.follow_data_ready();
    }

    /// A part whose data were read lets its data-ready pin go.
    fn follow_data_ready(&mut self) {
        if !self.sensor.chip.borrow().int1() && self.level(0, 0) {
            let now_ns = self.now_ns();
            self.plan_edge(now_ns, false);
        }
    }
}
