//! A board: the chip with its sensor, its crystal, its channel strap and its port on the bus.
//!
//! In: images for the flash, power, the world's ticks, the bus's events. Out: what its CAN
//! controller does to the bus. It is a [`Guest`] of a [`sim::network::Network`].
//!
//! Wiring: sensor on SPI1 (PA5, PA6, PA7) with chip select PA4, its INT1 on PA0; CAN on PA11 and
//! PA12; PB0 to ground for channel B. Left out: the transceiver's delays; and the sensor samples
//! up to a tick of the world early, while its edges come at their times.

use std::fmt;

use flash::layout::{BASE, Layout};
use flash::nor::NorError;
use sim::can_bus::{Bus, Event, Mailbox, Port, TransmitOrder};
use sim::electronics::Electronics;
use sim::motion::Motion;
use sim::network::guest::{Guest, nanoseconds};
use sim::supply::BROWN_OUT_BELOW_V;

use crate::chip::can::{Action, End, Errors, MAILBOXES};
use crate::chip::rcc::Cause;
use crate::chip::{Chip, Individual};
use crate::cortex_m3::CortexM3;
use crate::cpu::Cpu;
use crate::image::Image;
use crate::machine::{Ended, Kept, Machine};

/// The bit rate of a port that nothing has been set for yet.
const NO_RATE: u32 = 1;

/// The falling supply resets the chip here, V (data sheet of the STM32F103xC, 5.3.3: 1.8 to 1.96).
pub const PDR_V: f64 = 1.88;
/// Below this the RAM loses all that it held, V. `[ASSUME]`
pub const RAM_LOST_BELOW_V: f64 = 0.8;

/// The world cuts the time of an edge off to whole ns where the part rounds: looked at as much
/// later, the part's pulse is over.
const ROUNDING_NS: u64 = 1;

/// What a board is made of.
#[derive(Debug)]
pub struct Parts {
    /// The map of its flash.
    pub layout: Layout,
    /// Sensor, supply and crystal.
    pub electronics: Electronics,
    /// The part's unique identity.
    pub identity: [u32; 3],
    /// The watchdog's oscillator, Hz.
    pub lsi_hz: u32,
    /// For what a power cut leaves.
    pub seed: u64,
    /// PB0 is wired to ground.
    pub strapped: bool,
}

/// A frame of a mailbox that is with the bus.
#[derive(Clone, Copy, Debug)]
struct Posted {
    mailbox: Mailbox,
    since_ns: u64,
    once: bool,
    aborted: bool,
}

/// The board.
#[derive(Debug)]
pub struct Board<C = CortexM3> {
    machine: Machine<C>,
    electronics: Electronics,
    port: Port,
    powered: bool,
    /// Its bus wires are connected.
    wired: bool,
    /// The code has set the controller up to take part.
    joined: bool,
    posted: [Option<Posted>; MAILBOXES],
    /// When it next has something to do, ns.
    due_ns: u64,
    /// Data-ready edges so far.
    samples: u64,
    /// Width of the part's data-ready pulses, ns.
    pulse_ns: u64,
    /// The supply has failed by itself, in a flash operation.
    cut: bool,
    /// How far the supply falls while there is no power, V.
    lowest_v: f64,
}

/// Why an image does not go into the flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashError {
    /// A piece of it is not for the flash.
    Address(u32),
    /// The flash refused it.
    Cells(NorError),
}

impl fmt::Display for FlashError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Address(address) => write!(f, "{address:#010x} is not in flash"),
            Self::Cells(error) => write!(f, "the flash refused it: {error:?}"),
        }
    }
}

impl std::error::Error for FlashError {}

impl<C: Cpu> Board<C> {
    /// A board without power, its flash erased, attached to `bus`.
    ///
    /// # Panics
    /// When the bus is full, or for want of memory.
    pub fn new(parts: Parts, bus: &mut Bus) -> Self {
        let individual = Individual {
            identity: parts.identity,
            crystal: parts.electronics.crystal().rate(),
            lsi_hz: parts.lsi_hz,
            seed: parts.seed,
        };
        let sensor = parts.electronics.slave();
        let pulse_ns = sensor.borrow().pulse_ns();
        let mut chip = Chip::new(parts.layout, individual, sensor, bus.now_ns());
        if parts.strapped {
            chip.drive(1, 0, Some(false));
        }
        let port = bus.attach(TransmitOrder::Identifier);
        bus.connect(port, false);
        Self {
            machine: Machine::new(chip),
            electronics: parts.electronics,
            port,
            powered: false,
            wired: true,
            joined: false,
            posted: [None; MAILBOXES],
            due_ns: 0,
            samples: 0,
            pulse_ns,
            cut: false,
            lowest_v: 0.0,
        }
    }

    /// The machine, to look into.
    pub fn machine(&self) -> &Machine<C> {
        &self.machine
    }

    /// The machine, to change.
    pub fn machine_mut(&mut self) -> &mut Machine<C> {
        &mut self.machine
    }

    /// Its port on the bus.
    pub fn port(&self) -> Port {
        self.port
    }

    /// How many samples its sensor has told of while there was power.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// True when the supply has failed by itself, in the middle of a flash operation.
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// The supply will fall to this only when power next goes, V: below what resets the chip
    /// ([`PDR_V`]), and perhaps not below what the sensor and the RAM live on.
    ///
    /// # Panics
    /// For a voltage at which nothing happens.
    pub fn dip_to(&mut self, volts: f64) {
        assert!(volts < PDR_V, "{volts} V resets nothing");
        self.lowest_v = volts;
    }

    /// Writes an image into the flash, as a programmer does.
    ///
    /// Errors: see [`FlashError`].
    pub fn flash(&mut self, image: &Image) -> Result<(), FlashError> {
        for (address, bytes) in &image.pieces {
            self.flash_at(*address, bytes)?;
        }
        Ok(())
    }

    /// Writes bytes at an address of the flash.
    ///
    /// Errors: see [`FlashError`].
    pub fn flash_at(&mut self, address: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let flash = &mut self.machine.chip_mut().flash;
        let offset = address
            .checked_sub(BASE)
            .filter(|offset| *offset < flash.size());
        let offset = offset.ok_or(FlashError::Address(address))?;
        flash.flash(offset, bytes).map_err(FlashError::Cells)
    }

    /// Does to the bus what the CAN controller wants.
    fn act(&mut self, bus: &mut Bus) {
        while let Some(action) = self.machine.chip_mut().can.take_action() {
            match action {
                Action::Offer {
                    mailbox,
                    frame,
                    once,
                } => {
                    let offered = match once {
                        true => bus.offer_once(self.port, frame),
                        false => bus.offer(self.port, frame),
                    };
                    if let Ok(place) = offered {
                        self.posted[mailbox] = Some(Posted {
                            mailbox: place,
                            since_ns: bus.now_ns(),
                            once,
                            aborted: false,
                        });
                    }
                }
                Action::Abort { mailbox } => self.abort(mailbox, bus),
                Action::Join {
                    pclk1_per_bit,
                    silent,
                } => {
                    let rate = self.machine.chip().bit_rate(pclk1_per_bit);
                    bus.set_bit_rate(self.port, rate);
                    bus.listen_only(self.port, silent);
                    self.join(bus, true);
                }
                Action::Leave => self.join(bus, false),
                Action::Recover => bus.recover(self.port),
                Action::Reset => {
                    self.posted = [None; MAILBOXES];
                    self.join(bus, false);
                    bus.reset(self.port);
                    bus.listen_only(self.port, false);
                    bus.set_bit_rate(self.port, NO_RATE);
                }
            }
        }
    }

    fn join(&mut self, bus: &mut Bus, joined: bool) {
        self.joined = joined;
        bus.connect(self.port, self.joined && self.wired);
    }

    fn abort(&mut self, number: usize, bus: &mut Bus) {
        let Some(posted) = &mut self.posted[number] else {
            return;
        };
        if bus.abort(self.port, posted.mailbox) {
            self.posted[number] = None;
            self.machine.chip_mut().can.ended(number, End::Aborted);
        } else {
            posted.aborted = true;
        }
    }

    /// The bxCAN mailbox whose frame is in this mailbox of the bus.
    fn owner(&self, mailbox: Mailbox) -> Option<usize> {
        let mut places = self.posted.iter();
        places.position(|place| place.is_some_and(|posted| posted.mailbox == mailbox))
    }

    /// Frames that were taken back or have one attempt, and are no longer with the bus.
    fn give_up(&mut self, bus: &Bus) {
        for number in 0..MAILBOXES {
            if let Some(posted) = self.posted[number]
                && (posted.aborted || posted.once)
                && bus.waiting(self.port, posted.mailbox).is_none()
            {
                self.posted[number] = None;
                let why = if posted.once {
                    End::Failed
                } else {
                    End::Aborted
                };
                self.machine.chip_mut().can.ended(number, why);
            }
        }
    }

    /// An attempt of somebody has failed.
    fn see_error(&mut self, event: &Event, bus: &Bus) {
        let Event::Error { kind, senders, .. } = event else {
            return;
        };
        let sending = senders.contains(self.port);
        self.machine.chip_mut().can.see_error(*kind, sending);
        let on_wire = bus
            .on_wire(self.port)
            .and_then(|mailbox| self.owner(mailbox));
        if let Some(number) = on_wire.filter(|_| sending) {
            self.machine.chip_mut().can.failed(number);
        }
    }

    /// A frame of somebody else went first: what waited then has lost.
    fn lose(&mut self, start_ns: u64, bus: &mut Bus) {
        for number in 0..MAILBOXES {
            let Some(posted) = self.posted[number].filter(|posted| posted.since_ns <= start_ns)
            else {
                continue;
            };
            let can = &mut self.machine.chip_mut().can;
            if posted.once && bus.abort(self.port, posted.mailbox) {
                self.posted[number] = None;
                can.ended(number, End::Lost);
            } else {
                can.lost(number);
            }
        }
    }

    fn copy_errors(&mut self, bus: &Bus) {
        let counters = bus.counters(self.port);
        let errors = Errors {
            transmit: counters.transmit(),
            receive: counters.receive(),
            state: bus.state(self.port),
        };
        self.machine.chip_mut().can.set_errors(errors);
    }
}

impl<C: Cpu + 'static> Guest for Board<C> {
    fn electronics(&mut self) -> &mut Electronics {
        &mut self.electronics
    }

    fn tick(&mut self, motion: &Motion, end_s: f64) {
        // The part samples as the code has set it up meanwhile.
        self.electronics.run_waiting(|_, _| ());
        let chip = self.machine.chip_mut();
        let (powered, samples) = (self.powered, &mut self.samples);
        let pulse_ns = self.pulse_ns;
        self.electronics.tick(motion, end_s, |edge| {
            if powered {
                *samples += 1;
                let at_ns = nanoseconds(edge.captured_s);
                chip.plan_edge(at_ns, true);
                chip.plan_edge(at_ns + pulse_ns + ROUNDING_NS, false);
            }
        });
        self.due_ns = self.machine.next_ns();
    }

    fn hear(&mut self, event: &Event, bus: &mut Bus) {
        if !self.powered {
            return;
        }
        self.machine.sleep_until(bus.now_ns());
        match event {
            Event::Delivered {
                frame,
                to,
                start_ns,
                ..
            } if to.contains(self.port) => {
                self.machine.chip_mut().can.receive(*frame);
                self.lose(*start_ns, bus);
            }
            Event::Sent {
                port,
                mailbox: Some(mailbox),
                ..
            } if *port == self.port => {
                if let Some(number) = self.owner(*mailbox) {
                    self.posted[number] = None;
                    self.machine.chip_mut().can.sent(number);
                }
            }
            Event::Error { .. } if self.machine.chip().can.is_joined() => {
                self.see_error(event, bus);
            }
            _ => {}
        }
        self.give_up(bus);
        self.copy_errors(bus);
        self.act(bus);
        self.machine.chip_mut().call();
        self.due_ns = self.machine.next_ns();
    }

    fn next_ns(&self) -> u64 {
        match self.powered {
            true => self.due_ns,
            false => u64::MAX,
        }
    }

    fn run(&mut self, bus: &mut Bus, until_ns: u64) {
        while self.powered {
            self.give_up(bus);
            self.act(bus);
            match self.machine.run(until_ns) {
                // What it wants of the bus happens at its own time, when that has come.
                Ended::Acts if self.machine.chip().now_ns() <= bus.now_ns() => continue,
                Ended::Acts | Ended::AtLimit => {}
                Ended::Cut => {
                    self.power_off(bus);
                    self.cut = true;
                }
            }
            self.due_ns = self.machine.next_ns();
            return;
        }
    }

    fn power_on(&mut self, bus: &mut Bus) {
        let now_ns = bus.now_ns();
        self.electronics.catch_up(now_ns as f64 * 1e-9);
        if self.lowest_v < BROWN_OUT_BELOW_V {
            self.electronics.power_cycle();
        }
        self.machine.chip_mut().skip_to(now_ns);
        self.machine.power_on(match self.lowest_v {
            volts if volts < RAM_LOST_BELOW_V => Kept::Nothing,
            volts if volts < BROWN_OUT_BELOW_V => Kept::Most,
            _ => Kept::All,
        });
        (self.powered, self.cut, self.lowest_v) = (true, false, 0.0);
        self.act(bus);
        self.due_ns = self.machine.next_ns();
    }

    fn power_off(&mut self, bus: &mut Bus) {
        self.powered = false;
        self.posted = [None; MAILBOXES];
        bus.reset(self.port);
        self.join(bus, false);
    }

    fn wire(&mut self, bus: &mut Bus, connected: bool) {
        self.wired = connected;
        self.join(bus, self.joined);
    }

    fn reset(&mut self, bus: &mut Bus) {
        self.machine.sleep_until(bus.now_ns());
        self.machine.chip_mut().want_reset(Cause::Pin);
        self.due_ns = self.machine.next_ns();
    }

    fn is_powered(&self) -> bool {
        self.powered
    }
}
