//! The device on its board: started, served, reset.
//!
//! In: what interrupts have left in the inbox, and the time. Out: everything that the device does.
//! Events and deadlines are served in the order of their times ([`crate::driver`]).

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::SCB;
use device::device::Device;
use rtic::Mutex;
use tilt::composition::Composition as _;

use crate::chip::board::Board;
use crate::chip::can::{self, Can};
use crate::chip::clock::{Alarm, Wait, now};
use crate::crash::Crash;
use crate::driver::{BoardAction, Driver, DriverCall};
use crate::image::Image;
use crate::inbox::Inbox;
use crate::self_check;

/// Set by each round of [`BoardNode::serve`], taken back by the watchdog's feeder.
static ALIVE: AtomicBool = AtomicBool::new(false);

/// Whether the device was served since the last call.
pub fn was_served() -> bool {
    let served = ALIVE.load(Ordering::Relaxed);
    ALIVE.store(false, Ordering::Relaxed);
    served
}

/// The device with all that it needs, as `C` composes it.
pub struct BoardNode<C: Image> {
    driver: Driver,
    device: Device<C::Sensor, C::Memory, C::Instrument>,
    can: Can,
    alarm: Alarm,
    crash: Option<Crash>,
    running: bool,
}

impl<C: Image> BoardNode<C> {
    /// A device that has not been started.
    #[inline(never)]
    pub fn new(board: Board<C::Eraser>) -> Self {
        let factory = C::factory(board.channel, board.serial);
        let memory = C::memory(board.nor);
        Self {
            driver: Driver::new(),
            device: Device::new(
                C::sensor(board.sensor),
                C::Instrument::check(),
                factory,
                memory,
            ),
            can: board.can,
            alarm: board.alarm,
            crash: board.crash,
            running: false,
        }
    }

    fn at(&mut self) -> DriverCall<'_, C::Sensor, C::Memory, Can, C::Instrument> {
        self.driver.at(&mut self.device, &mut self.can)
    }

    /// Does all that is due, and sets the alarm for what will be.
    pub fn serve(&mut self, inbox: &mut impl Mutex<T = Inbox>) {
        if !self.running {
            self.start();
            inbox.lock(Inbox::forget_edge);
        }
        if self_check::has_failed() {
            self.device.program_damaged();
        }
        let lost = inbox.lock(|inbox| {
            can::look(inbox, now);
            inbox.take_lost()
        });
        if lost != 0 {
            self.device.frames_lost(lost, now());
        }
        loop {
            // The time first: what the inbox then has not got comes after it.
            let now = now();
            let mut take = |until| inbox.lock(|inbox| inbox.take(until));
            if let Some(next) = self.at().step(now, &mut take)
                && self.alarm.set(next, now)
            {
                break;
            }
            if let Some(action) = self.driver.take_action() {
                self.perform(action);
                inbox.lock(Inbox::forget_edge);
            }
        }
        ALIVE.store(true, Ordering::Relaxed);
    }

    /// The sensor is set up first, which takes 20 ms; then the bus hears of this node.
    ///
    /// Out of line: what it has on the stack, nothing else that is served needs.
    #[inline(never)]
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

    #[inline(never)]
    fn perform(&mut self, action: BoardAction) {
        match action {
            BoardAction::Reset => SCB::sys_reset(),
            // A part that still does not answer leaves its channel invalid.
            BoardAction::Sensor => {
                let _ = self.device.restart_sensor(&mut Wait, now());
            }
        }
    }
}
