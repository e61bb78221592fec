//! The device: a channel that measures and a node that speaks, joined.
//!
//! In: data-ready edges, frames and the controller's state, each with the time on this device's
//! clock. Out: frames, a deadline, and now and then a [`Wish`] that only the board can fulfil.
//!
//! At each SYNC the channel's reading for that very instant is latched before any PDO is made
//! (R11, erratum E11), goes to the peer, and waits for the peer's reading of the same SYNC; then
//! the pair is judged (R12, R13). A peer that misses a few SYNCs is waited for; one that stays
//! silent counts as a channel without samples.
//!
//! Left out: the board, flash, and the time that the sensor's set-up takes, which is the
//! caller's to pass.

use canopen::Frame;
use canopen::Instant as BusInstant;
use canopen::nmt::State;
use canopen::node::{BusState, Node as BusNode};
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use tilt::angle::Axes;
use tilt::chain::{Invalid, Reading};
use tilt::cross_check::{CrossCheck, Judgement, Verdict};
use tilt::filter::Filtered;
use tilt::sample::{Instant, Temperature};

use crate::calibration::encoding::decode_into;
use crate::calibration::motor::{Motor, Terms};
use crate::channel::{Channel, Settings};
use crate::exchange;
use crate::fault::{Fault, Faults};
use crate::node::Node;
use crate::objects::panel::{Identity, Memory, Panel, Source, Work, stored_lss};
use crate::objects::process::{SyncSource, validity};
use crate::objects::safety::VALID;
use crate::objects::values::{Latched, Values};
use crate::profile::Resolution;
use crate::records::Record;
use crate::sensor::InitError;

/// What a device is made with.
#[derive(Clone, Debug)]
pub struct Factory {
    /// Channel and serial number.
    pub identity: Identity,
    /// Node-id until LSS stores another; 255 for none.
    pub node_id: u8,
    /// Bit rate until LSS stores another, kbit/s.
    pub kbit_s: u16,
    /// The part, its chain, and the calibration it left the factory with.
    pub settings: Settings,
    /// True when that calibration is this part's own.
    pub calibrated: bool,
    /// What tables made by a motor's run come with.
    pub terms: Terms,
}

/// What only the board can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// Start the device anew.
    Reset,
    /// Be silent for the delay, change the bit rate, be silent for the delay again (CiA 305).
    BitRate {
        /// The rate; `None`: find it.
        kbit_s: Option<u16>,
        /// The delay, ms.
        delay_ms: u16,
    },
}

/// Time between two looks at everything that moves without a SYNC.
pub const REFRESH_US: i64 = 10_000;

/// SYNCs in a row that may pass without the peer's reading before it counts as silent.
const MISSES_ALLOWED: u8 = 5;

/// The SDO server answers with this identifier and the node-id (1200h sub 2).
const SDO_ANSWER: u16 = 0x580;

/// How long a judgement is shown once no new one comes.
const JUDGED_FOR_US: i64 = 1_000_000;

/// Outside these the part is not specified (DS11811, table 4), in 1/256 degC.
const COLDEST: i32 = -40 * 256;
/// See [`COLDEST`].
const HOTTEST: i32 = 85 * 256;

/// A device: its state.
#[derive(Debug)]
pub struct Device<SPI, M> {
    node: Node<SPI>,
    bus: BusNode,
    values: Values,
    settings: Settings,
    work: Work,
    memory: M,
    factory: Factory,
    faults: Faults,
    /// What was found wrong at the last look, reported or not.
    pending: Faults,
    judgement: Option<Judgement>,
    judged_at: Instant,
    misses: u8,
    last_sync: Instant,
    standing_in: bool,
    record_damaged: bool,
    next_refresh: Instant,
    next: Instant,
}

impl<SPI: SpiDevice> Source for Channel<SPI> {
    fn reading(&self, settings: &Settings, now: Instant) -> Reading {
        self.reading(settings, now)
    }

    fn filtered(&self) -> Option<Filtered> {
        self.filtered().map(|(filtered, _)| filtered)
    }

    fn temperature(&self) -> Option<Temperature> {
        self.temperature()
    }
}

const fn bus_time(now: Instant) -> BusInstant {
    BusInstant(now.0)
}

/// A reading of a channel that says nothing.
const SILENT: Reading = Axes {
    x: Err(Invalid::Stale),
    y: Err(Invalid::Stale),
};

impl<SPI: SpiDevice, M: Memory> Device<SPI, M> {
    /// A device that has not been started.
    pub fn new(spi: SPI, check: CrossCheck, factory: Factory, memory: M) -> Self {
        let settings = factory.settings.clone();
        let work = Work {
            motor: Motor::new(),
            result: settings.chain.calibration.clone(),
            terms: factory.terms,
        };
        Self {
            node: Node::new(spi, check),
            bus: BusNode::new(),
            values: Values::new(),
            settings,
            work,
            memory,
            factory,
            faults: Faults::default(),
            pending: Faults::default(),
            judgement: None,
            judged_at: Instant(0),
            misses: 0,
            last_sync: Instant(0),
            standing_in: false,
            record_damaged: false,
            next_refresh: Instant(0),
            next: Instant(0),
        }
    }

    /// The bus's node and what the device lends it.
    fn split(&mut self, now: Instant) -> (&mut BusNode, Panel<'_, M, Channel<SPI>>) {
        let panel = Panel {
            values: &mut self.values,
            settings: &mut self.settings,
            memory: &mut self.memory,
            source: &self.node.channel,
            work: &mut self.work,
            identity: self.factory.identity,
            now,
        };
        (&mut self.bus, panel)
    }

    /// First half of a start or reset: the stored calibration, then the part's set-up.
    ///
    /// Takes about 20 ms of `delay`. Errors: see [`Channel::start`]; the device goes on the bus
    /// all the same, with the reason instead of angles.
    pub fn start_sensor<D: DelayNs>(
        &mut self,
        delay: &mut D,
        now: Instant,
    ) -> Result<(), InitError<SPI::Error>> {
        self.values = Values::new();
        self.faults = Faults::default();
        self.pending = Faults::default();
        self.judgement = None;
        self.misses = 0;
        self.standing_in = false;
        self.work.motor = Motor::new();
        self.recall_calibration();
        self.node.start(&self.settings, delay, now)
    }

    /// The calibration in memory, or the factory's where there is none or it is damaged.
    fn recall_calibration(&mut self) {
        let calibration = &mut self.settings.chain.calibration;
        calibration.clone_from(&self.factory.settings.chain.calibration);
        self.values.calibrated = self.factory.calibrated;
        self.record_damaged = false;
        let memory = &self.memory;
        if memory.read(Record::Calibration, 0, &mut [0]) == 0 {
            return;
        }
        let Some(scratch) = self.work.motor.scratch() else {
            return;
        };
        let understood = decode_into(calibration, scratch, &mut |offset, into| {
            memory.read(Record::Calibration, offset, into)
        });
        self.values.calibrated |= understood.is_ok();
        self.record_damaged = understood.is_err();
    }

    /// Second half of a start: everything stored comes back, and boot-up is due.
    pub fn start_bus(&mut self, now: Instant) {
        let (node_id, rate) = stored_lss(&self.memory);
        self.values.bit_rate = rate.unwrap_or(self.factory.kbit_s);
        let node_id = node_id.unwrap_or(self.factory.node_id);
        self.last_sync = now;
        self.judged_at = now;
        self.next_refresh = now;
        self.next = now;
        let (bus, mut panel) = self.split(now);
        bus.start(&mut panel, node_id, bus_time(now));
    }

    /// The part has raised data-ready at `captured`.
    pub fn data_ready(&mut self, captured: Instant) {
        self.node.channel.data_ready(&self.settings, captured);
    }

    /// A frame has ended on the bus at `now`.
    pub fn receive(&mut self, frame: &Frame, now: Instant) {
        let (bus, mut panel) = self.split(now);
        bus.receive(&mut panel, frame, bus_time(now));
        if self.values.news.sync {
            self.synchronised(SyncSource::Bus, now);
        }
        self.after(now);
    }

    /// A frame of this device has ended on the bus at `now`.
    pub fn sent(&mut self, frame: &Frame, now: Instant) {
        if frame.cob_id() == Some(SDO_ANSWER + u16::from(self.bus.node_id())) {
            let news = &mut self.values.news;
            news.reset |= core::mem::take(&mut news.restart);
        }
        let (bus, mut panel) = self.split(now);
        bus.sent(&mut panel, frame, bus_time(now));
        if self.values.news.sync {
            self.synchronised(SyncSource::Own, now);
        }
        self.after(now);
    }

    /// The next frame to hand to the controller; call it when there is room for one.
    pub fn transmit(&mut self, now: Instant) -> Option<Frame> {
        let (bus, mut panel) = self.split(now);
        bus.transmit(&mut panel, bus_time(now))
    }

    /// The identifier of what [`Device::transmit`] would give.
    pub fn next_cob_id(&self, now: Instant) -> Option<u16> {
        self.bus.next_cob_id(bus_time(now))
    }

    /// Everything that is due at `now`; returns when to call again.
    pub fn poll(&mut self, now: Instant) -> Instant {
        let part = self.node.channel.poll(&self.settings, now);
        if now >= self.next_refresh {
            self.next_refresh = now.offset(REFRESH_US);
            self.refresh(now);
        }
        let (bus, mut panel) = self.split(now);
        let bus = bus.poll(&mut panel, bus_time(now));
        let bus = bus.map_or(self.next_refresh, |at| Instant(at.0));
        self.after(now);
        self.next = part.min(bus).min(self.next_refresh);
        self.next
    }

    /// When [`Device::poll`] is next due.
    pub const fn next_deadline(&self) -> Instant {
        self.next
    }

    /// What the CAN controller says of itself.
    pub fn bus_state(&mut self, state: BusState, transmit: u8, receive: u8, now: Instant) {
        let shown = &mut self.values.process.bus;
        let code = match state {
            BusState::Active => 0,
            BusState::Passive => 1,
            BusState::Off => 2,
        };
        if code == 2 && shown.state != 2 {
            shown.bus_offs = shown.bus_offs.saturating_add(1);
        }
        shown.state = code;
        shown.transmit_errors = transmit;
        shown.receive_errors = receive;
        let (bus, mut panel) = self.split(now);
        bus.bus_state(&mut panel, state, bus_time(now));
        self.after(now);
    }

    /// How busy the bus has been in the last second, per cent.
    pub const fn set_bus_load(&mut self, percent: u8) {
        self.values.process.bus.load_percent = percent;
    }

    /// The controller's bit rate is this one now, kbit/s; 0 while it is looked for.
    pub const fn set_bit_rate(&mut self, kbit_s: u16) {
        self.values.bit_rate = kbit_s;
    }

    /// The bit rate to start with, kbit/s; `None` when it is to be found by listening.
    pub fn bit_rate(&self) -> Option<u16> {
        let automatic = self.values.parameters.automatic_bit_rate == 1;
        let known = !automatic && self.values.bit_rate != 0;
        known.then_some(self.values.bit_rate)
    }

    /// The controller has gone bus-off: when to ask it back (2051h); `None`: not by itself.
    pub fn recovery(&self, now: Instant) -> Option<Instant> {
        let wait_ms = i64::from(self.values.parameters.recovery_ms);
        (wait_ms != 0).then(|| now.offset(wait_ms * 1000))
    }

    /// What only the board can do, once.
    pub fn take_wish(&mut self) -> Option<Wish> {
        let news = &mut self.values.news;
        if core::mem::take(&mut news.reset) {
            return Some(Wish::Reset);
        }
        let (kbit_s, delay_ms) = news.bit_rate.take()?;
        Some(Wish::BitRate { kbit_s, delay_ms })
    }

    /// The channel, for looking at.
    pub const fn channel(&self) -> &Channel<SPI> {
        &self.node.channel
    }

    /// The values shown on the bus.
    pub const fn values(&self) -> &Values {
        &self.values
    }

    /// The node on the bus.
    pub const fn bus(&self) -> &BusNode {
        &self.bus
    }

    /// The settings in force.
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The memory.
    pub const fn memory(&mut self) -> &mut M {
        &mut self.memory
    }

    /// Faults that stand.
    pub const fn faults(&self) -> Faults {
        self.faults
    }
}

impl<SPI: SpiDevice, M: Memory> Device<SPI, M> {
    /// A SYNC was obeyed, from `source`.
    fn synchronised(&mut self, source: SyncSource, now: Instant) {
        self.values.news.sync = false;
        self.values.process.source = source;
        self.last_sync = now;
        if source == SyncSource::Bus {
            self.end_standing_in(now);
        }
        if let Some(before) = self.values.news.unanswered.take() {
            let process = &mut self.values.process;
            process.missed = process.missed.saturating_add(1);
            self.misses = self.misses.saturating_add(1);
            if self.misses > MISSES_ALLOWED {
                self.judge(before.reading, SILENT, before.at);
            }
        }
    }

    fn end_standing_in(&mut self, now: Instant) {
        if core::mem::take(&mut self.standing_in) {
            self.bus.stand_in_for_sync(None, bus_time(now));
        }
    }

    /// What every call ends with.
    fn after(&mut self, now: Instant) {
        // Whatever has happened may be due sooner than what was known.
        self.next = now;
        if core::mem::take(&mut self.values.news.exchange) {
            self.answered(now);
        }
        self.report(now);
    }

    /// The peer's exchange has come: the pair is whole.
    fn answered(&mut self, now: Instant) {
        self.misses = 0;
        // Without SYNC the peer speaks when it likes; then this channel's reading is of now.
        let own = self.values.news.own.take().unwrap_or_else(|| Latched {
            reading: self.node.reading(&self.settings, now),
            at: now,
        });
        let process = &self.values.process;
        let latency_us = process.latency_us;
        let at = own.at.offset(-i64::from(latency_us));
        let peer = exchange::decode(process.received, at, latency_us);
        self.judge(own.reading, peer, own.at);
    }

    fn judge(&mut self, own: Reading, peer: Reading, at: Instant) {
        let verdict: Verdict = self.node.judge(own, peer, at);
        self.values.process.judge(&verdict);
        self.judgement = Some(verdict.judgement());
        self.judged_at = at;
    }

    /// What moves without a SYNC: the angle for SDOs, SRDOs and event-driven PDOs, counters, time.
    fn refresh(&mut self, now: Instant) {
        let reading = self.node.reading(&self.settings, now);
        let channel = &self.node.channel;
        let process = &mut self.values.process;
        process.show(&reading);
        process.samples = channel.samples();
        process.period_q8 = channel.period_q8();
        if let Some((filtered, _)) = channel.filtered() {
            process.filtered = filtered.accel;
        }
        if let Some(t) = channel.temperature() {
            process.temperature_c = (t.0.saturating_add(128) >> 8).clamp(-128, 127) as i8;
        }
        process.bus.overruns = self.bus.overruns();
        process.flag(validity::CALIBRATED, self.values.calibrated);
        if now.micros_since(self.judged_at) > JUDGED_FOR_US {
            process.not_judged();
            // What was found stays found until a judgement takes it back or a reset does.
            self.judgement = self.judgement.filter(|judgement| judgement.is_fault());
        }
        self.look_for_sync(now);
        self.find_faults(&reading);
        let (bus, mut panel) = self.split(now);
        bus.data_changed(&mut panel, bus_time(now));
    }

    /// With no SYNC on the bus the lower node-id makes it, the other one if that fails (2050h).
    fn look_for_sync(&mut self, now: Instant) {
        let parameters = &self.values.parameters;
        if self.values.state != State::Operational {
            // A node that is stopped or being set up makes no SYNC of its own accord.
            self.last_sync = now;
            return self.end_standing_in(now);
        }
        let first = self.bus.node_id() < parameters.peer;
        let patience_ms = i64::from(parameters.fallback_ms) * if first { 1 } else { 2 };
        let silent_us = now.micros_since(self.last_sync);
        if patience_ms == 0 || silent_us <= patience_ms * 1000 {
            return;
        }
        self.values.process.source = SyncSource::None;
        if !self.standing_in {
            self.standing_in = true;
            let period_us = Some(parameters.fallback_period_us);
            self.bus.stand_in_for_sync(period_us, bus_time(now));
        }
    }

    fn find_faults(&mut self, reading: &Reading) {
        let mut found = Faults::default();
        found.of_reading(reading);
        if let Some(judgement) = self.judgement {
            found.of_judgement(judgement);
        }
        let [x, y, ..] = self.values.process.slopes;
        let [low_x, high_x, low_y, high_y] = self.values.parameters.range;
        let outside = |slope: Option<_>, low, high| {
            slope.is_some_and(|a| !(low..=high).contains(&Resolution::Thousandth.units(a)))
        };
        found.set(Fault::RangeX, outside(x, low_x, high_x));
        found.set(Fault::RangeY, outside(y, low_y, high_y));
        let temperature = self.node.channel.temperature();
        let beyond = temperature.is_some_and(|t| !(COLDEST..=HOTTEST).contains(&t.0));
        found.set(Fault::Temperature, beyond);
        found.set(Fault::NotCalibrated, !self.values.calibrated);
        found.set(Fault::CalibrationRecord, self.record_damaged);
        found.set(Fault::Storage, self.values.storage_failed);
        let fail_safe = self.values.news.fail_safe;
        found.set(Fault::FailSafe, fail_safe);
        let latched = fail_safe
            || self.node.channel.fault().is_some()
            || self.judgement.is_some_and(|judgement| {
                matches!(judgement, Judgement::Disagree | Judgement::PhysicalFault)
            });
        self.values.process.flag(validity::LATCHED, latched);
        self.pending = found;
    }

    /// Tells the bus what has appeared and what has gone, and withdraws consent to SRDOs.
    fn report(&mut self, now: Instant) {
        let (before, found) = (self.faults, self.pending);
        if before != found {
            self.faults = found;
            for fault in found.new_since(before).iter() {
                let (code, _, _) = fault.report();
                self.tell(Some(code), found, now);
            }
            if !before.new_since(found).is_empty() {
                self.tell(None, found, now);
            }
        }
        let consent = self.consents();
        self.bus.consent_to_safety(consent);
    }

    /// EMCY with the set of faults in its bytes 3 to 6 and the state of the pair in byte 7.
    fn tell(&mut self, code: Option<u16>, found: Faults, now: Instant) {
        let [a, b, c, d] = found.bits().to_le_bytes();
        let detail = [a, b, c, d, self.values.process.state];
        let bits = found.register();
        let (bus, mut panel) = self.split(now);
        match code {
            Some(code) => bus.report(&mut panel, code, bits, detail, bus_time(now)),
            None => bus.cleared(bits, detail),
        }
    }

    /// A safety frame is sent only of an angle that is valid, checked and configured as signed.
    fn consents(&self) -> bool {
        let process = &self.values.process;
        let valid = process.validity & validity::OWN != 0;
        let judged = matches!(
            self.judgement,
            Some(Judgement::Agree | Judgement::DataDelay)
        );
        let sound = !self.faults.iter().any(Fault::forbids_safety);
        valid && judged && sound && self.values.parameters.safety_valid == VALID
    }
}
