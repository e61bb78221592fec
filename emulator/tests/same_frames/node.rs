//! The device of the host's build, served as `firmware::board_node` serves it on the chip.
//!
//! In: what the chip's code has seen. Out: where this build went another way.

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;

use canopen::Frame;
use canopen::frame::Id;
use device::device::Device;
use device::mailboxes::{Abort, Transmitter};
use device::objects::table::Channel;
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use emulator::chip::flash_controller::Dice;
use emulator::chip::tap::Entry;
use firmware::bit_timing;
use firmware::driver::{BoardAction, Controller, Driver};
use flash::nor::{Nor, Page};
use instant::Instant;
use tilt::composition::Composition as _;

use crate::composition::Composition;
use crate::log::register::*;
use crate::log::{Log, error_state};

/// The flash that both begin with.
pub type Cells = Nor<Vec<Page>, Dice>;
/// The log, as whoever is on its ends has it.
#[derive(Clone, Debug)]
pub struct Wire(Rc<RefCell<Log>>);

impl Wire {
    fn now(&self) -> Instant {
        self.0.borrow_mut().now()
    }

    fn load(&self, address: u32) -> u32 {
        self.0.borrow_mut().load(address)
    }

    fn store(&self, address: u32, value: u32) {
        self.0.borrow_mut().store(address, value);
    }

    /// `chip::can::initialise`.
    fn initialise(&self) {
        self.store(MCR, 1 | 1 << 3);
        let end = self.now().offset(15_000);
        while self.load(MSR) & 1 == 0 && self.now() < end {}
    }
}

impl DelayNs for Wire {
    fn delay_ns(&mut self, ns: u32) {
        let end = self.now().offset(i64::from(ns.div_ceil(1000)) + 1);
        while self.now() < end {}
    }
}

impl ErrorType for Wire {
    type Error = Infallible;
}

impl SpiDevice for Wire {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        self.0.borrow_mut().select(true);
        for operation in operations {
            let exchange = |byte| self.0.borrow_mut().exchange(byte);
            match operation {
                Operation::Read(into) => into.iter_mut().for_each(|to| *to = exchange(0)),
                Operation::Write(bytes) => bytes.iter().for_each(|byte| {
                    exchange(*byte);
                }),
                Operation::TransferInPlace(bytes) => {
                    bytes.iter_mut().for_each(|byte| *byte = exchange(*byte));
                }
                Operation::Transfer(into, bytes) => {
                    for place in 0..into.len().max(bytes.len()) {
                        let came = exchange(bytes.get(place).copied().unwrap_or(0));
                        if let Some(to) = into.get_mut(place) {
                            *to = came;
                        }
                    }
                }
                Operation::DelayNs(ns) => self.delay_ns(*ns),
            }
        }
        self.0.borrow_mut().select(false);
        Ok(())
    }
}

impl Transmitter for Wire {
    fn post(&mut self, place: u8, frame: &Frame) {
        let mailbox = 0x10 * u32::from(place);
        let bytes = u64::from_le_bytes(frame.padded());
        let identifier = match frame.id() {
            Id::Standard(id) => u32::from(id.as_raw()) << 21,
            Id::Extended(id) => id.as_raw() << 3 | 4,
        };
        let remote = u32::from(frame.is_remote()) << 1;
        self.store(TDTR + mailbox, frame.length() as u32);
        self.store(TDLR + mailbox, bytes as u32);
        self.store(TDHR + mailbox, (bytes >> 32) as u32);
        self.store(TIR + mailbox, identifier | remote | 1);
    }

    fn abort(&mut self, place: u8) -> Abort {
        let shift = 8 * u32::from(place);
        if self.load(TSR) >> shift & 1 != 0 {
            return Abort::Later;
        }
        self.store(TSR, 1 << 7 << shift);
        for _ in 0..16 {
            match self.load(TSR) >> shift & 3 {
                0 | 2 => {}
                3 => return Abort::Later,
                _ => {
                    self.store(TSR, 1 << shift);
                    return Abort::Done;
                }
            }
        }
        Abort::Later
    }

    fn clear(&mut self) {
        self.store(TSR, 0x80_8080);
        for _ in 0..16 {
            if self.load(TSR) & 7 << 26 == 7 << 26 {
                break;
            }
        }
        self.store(TSR, 0x01_0101);
    }
}

impl Controller for Wire {
    fn recover(&mut self) {
        self.initialise();
        self.store(MCR, 1 << 3);
    }

    fn set_rate(&mut self, kbit_s: u16, listen_only: bool) {
        self.initialise();
        if let Some(timing) = bit_timing::register(kbit_s) {
            self.store(BTR, timing | u32::from(listen_only) << 31);
            self.store(MCR, 1 << 3);
        }
    }

    fn listen_to(&mut self, node_id: u8) {
        let id = (0x600 + u32::from(node_id)) << 21;
        self.store(FA1R, 0b101);
        self.store(FB1R1, id);
        self.store(FB1R2, id);
        self.store(FA1R, 0b111);
    }
}

/// Follows the chip of this channel and serial number to the end of what was written down, or to
/// where the host does something else; what it has come to.
pub fn follow<C: Composition>(
    entries: Vec<Entry>,
    cells: Cells,
    channel: Channel,
    serial: u32,
) -> Log {
    let log = Rc::new(RefCell::new(Log::new(entries)));
    let mut wire = Wire(Rc::clone(&log));
    let (factory, memory) = (C::factory(channel, serial), C::memory(cells));
    let mut device = Device::new(
        C::sensor(wire.clone()),
        C::Instrument::check(),
        factory,
        memory,
    );
    let mut driver = Driver::new();
    let now = wire.now();
    // A part that does not answer is one on the chip, too.
    let _ = device.start_sensor(&mut wire.clone(), now);
    let now = wire.now();
    driver.at(&mut device, &mut wire).start(now);
    log.borrow_mut().inbox().forget_edge();
    while !log.borrow().has_ended() {
        serve::<C>(&mut driver, &mut device, &mut wire);
    }
    drop((device, wire));
    Rc::into_inner(log).expect("the device had it").into_inner()
}

/// `firmware::board_node::BoardNode::serve`, once.
fn serve<C: Composition>(
    driver: &mut Driver,
    device: &mut Device<C::Sensor, C::Memory, C::Instrument>,
    wire: &mut Wire,
) {
    let log = Rc::clone(&wire.0);
    let state = error_state(wire.load(ESR));
    if log.borrow_mut().inbox().is_another(state.0) {
        let now = wire.now();
        log.borrow_mut().tell(state, now);
    }
    let lost = log.borrow_mut().inbox().take_lost();
    if lost != 0 {
        device.frames_lost(lost, wire.now());
    }
    while !log.borrow().has_ended() {
        let now = wire.now();
        let take = |until| log.borrow_mut().take(until, now);
        if let Some(next) = driver.at(device, wire).step(now, take)
            && next > wire.now()
        {
            return;
        }
        match driver.take_action() {
            None => continue,
            Some(BoardAction::Reset) => {
                panic!("the chip was reset: nothing of that was written down")
            }
            Some(BoardAction::Sensor) => {
                let now = wire.now();
                let _ = device.restart_sensor(&mut wire.clone(), now);
            }
        }
        log.borrow_mut().inbox().forget_edge();
    }
}
