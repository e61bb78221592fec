//! The device on its board: started, served, reset.
//!
//! In: what interrupts have left in the inbox, and the time. Out: everything that the device does.
//! Events and deadlines are served in the order of their times ([`crate::unit`]).

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::SCB;
use device::device::Device;
use device::memory::update::Anybody;
use device::memory::{Build, FlashMemory};
use rtic::Mutex;
use tilt::cross_check::CrossCheck;
use tilt::sample::Instant;

use crate::chip::board::{Board, Select};
use crate::chip::can::Can;
use crate::chip::clock::{Alarm, Wait, now};
use crate::chip::nor::Nor;
use crate::chip::spi::Sensor;
use crate::crash::Crash;
use crate::factory::factory;
use crate::inbox::{Inbox, Input};
use crate::part::LAYOUT;
use crate::self_check;
use crate::unit::{At, Order, Unit};

/// Set by each round of [`Node::serve`], taken back by the watchdog's feeder.
static ALIVE: AtomicBool = AtomicBool::new(false);

/// Whether the device was served since the last call.
pub fn was_served() -> bool {
    let served = ALIVE.load(Ordering::Relaxed);
    ALIVE.store(false, Ordering::Relaxed);
    served
}

/// What the device keeps: records and programs in the chip's own flash.
pub type Memory = FlashMemory<Nor, Anybody>;

/// The device with all that it needs.
pub struct Node {
    unit: Unit,
    device: Device<Sensor<Select>, Memory>,
    can: Can,
    alarm: Alarm,
    crash: Option<Crash>,
    running: bool,
}

impl Node {
    /// A device that has not been started.
    pub fn new(board: Board) -> Self {
        let factory = factory(board.channel, board.serial);
        let check = CrossCheck::product();
        let build = Build {
            layout: &LAYOUT,
            running: self_check::running_slot(),
            hardware: LAYOUT.hardware,
        };
        let memory = FlashMemory::new(board.nor, build, Anybody);
        Self {
            unit: Unit::new(),
            device: Device::new(board.sensor, check, factory, memory),
            can: board.can,
            alarm: board.alarm,
            crash: board.crash,
            running: false,
        }
    }

    fn at(&mut self) -> At<'_, Sensor<Select>, Memory, Can> {
        self.unit.at(&mut self.device, &mut self.can)
    }

    /// Does all that is due, and sets the alarm for what will be.
    pub fn serve(&mut self, inbox: &mut impl Mutex<T = Inbox>) {
        if !self.running {
            self.start();
            inbox.lock(Inbox::forget_edges);
        }
        if self_check::has_failed() {
            self.device.program_damaged();
        }
        let lost = inbox.lock(Inbox::take_lost);
        if lost != 0 {
            self.device.frames_lost(lost, now());
        }
        loop {
            let next = self.at().next();
            if let Some((input, at)) = inbox.lock(|inbox| inbox.take(next)) {
                self.take(input, at);
            } else if next <= now() {
                self.at().poll(next);
            } else if self.alarm.set(next) {
                break;
            }
            if let Some(order) = self.unit.take_order() {
                self.obey(order);
                inbox.lock(Inbox::forget_edges);
            }
        }
        ALIVE.store(true, Ordering::Relaxed);
    }

    /// The sensor is set up first, which takes 20 ms; then the bus hears of this node.
    fn start(&mut self) {
        // A part that does not answer leaves its channel invalid, and the bus hears why.
        let _ = self.device.start_sensor(&mut Wait, now());
        let now = now();
        self.at().start(now);
        if let Some(crash) = self.crash.take() {
            let (code, detail) = crash.emergency();
            self.device.came_up_after(code, detail, now);
        }
        self.running = true;
    }

    fn take(&mut self, input: Input, at: Instant) {
        match input {
            Input::Edge => self.at().data_ready(at),
            Input::Bus(event) => self.at().event(event, at),
        }
    }

    fn obey(&mut self, order: Order) {
        match order {
            Order::Reset => SCB::sys_reset(),
            // A part that still does not answer leaves its channel invalid.
            Order::Sensor => {
                let _ = self.device.restart_sensor(&mut Wait, now());
            }
        }
    }
}
