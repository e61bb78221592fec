//! The device: a channel that measures and a node that speaks, joined.
//!
//! In: data-ready edges, frames and the controller's state, each with the time on this device's
//! clock. Out: frames, those that have to be taken back, a deadline, and now and then a
//! [`BoardRequest`] that only the board can fulfil.
//!
//! At each SYNC the channel's reading for that very instant is latched before any PDO is made
//! (R11, erratum E11), goes to the peer, and waits for the peer's reading of the same SYNC; then
//! the pair is judged (R12, R13; `pair`). What follows from a judgement, faults, EMCY, the fault
//! log and the consent to safety frames, is in `report`.
//!
//! Left out: the board, flash, and the time that the sensor's set-up takes, which is the
//! caller's to pass.

mod board;
mod log_writer;
mod matching;
mod report;
mod sending;
mod trial;

use canopen::Frame;
use canopen::nmt::State;
use canopen::node::{BusState, Node, Waiting};
use embedded_hal::delay::DelayNs;
use instant::Instant;
use tilt::chain::{Invalid, Reading};
use tilt::composition::{Composition, Whole};
use tilt::cross_check::{CrossCheck, Judgement};
use tilt::filter::Filtered;
use tilt::fusion::MeasuredSum;
use tilt::observation::Observation;
use tilt::sample::Temperature;

use crate::calibration::encoding::identity;
use crate::calibration::motor::TableSettings;
use crate::calibration::recall;
use crate::channel::{Channel, Settings, Setup};
use crate::exchange::Pdos;
use crate::fault::Faults;
use crate::instrument::Instrument;
use crate::objects::device_objects::{DeviceObjects, Identity, Memory, Parts, Source, stored_lss};
use crate::objects::moment::Moment;
use crate::objects::process::{Shown, SyncSource};
use crate::objects::values::Values;
use crate::pair::Pair;
use crate::records::Record;
use crate::sensor::{Part, PartError};

use log_writer::{LogWriter, PIECE_US};
use matching::Matching;
use sending::{PDOS, Sending};
use trial::{PAUSE_US, Trial};

/// What a device is made with.
#[derive(Clone, Debug)]
pub struct Factory {
    /// Channel and serial number.
    pub identity: Identity,
    /// Node-id until LSS stores another; 255 for none.
    pub node_id: u8,
    /// Bit rate until LSS stores another, kbit/s.
    pub kbit_s: u16,
    /// The part and its chain. The calibration comes from the memory, where a factory puts it
    /// ([`deliver`](crate::calibration::deliver)).
    pub setup: Setup,
    /// What tables made by a motor's run come with.
    pub table_settings: TableSettings,
}

/// What only the board can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardRequest {
    /// Start the device anew.
    Reset,
    /// Set the sensor up anew: [`Device::restart_sensor`].
    Sensor,
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

/// A reading of a SYNC may grow older than that by so much, so that a SYNC of the same period comes
/// before the next look.
const SYNC_FIRST_US: i64 = 1_000;

/// The oldest that a reading gets that SDOs, safety frames and event-driven PDOs show, us.
pub const OLDEST_READING_US: i64 = REFRESH_US + SYNC_FIRST_US;

/// The SDO server answers with this identifier and the node-id (1200h sub 2).
const SDO_ANSWER: u16 = 0x580;

/// A device: its state.
///
/// The fields stand in this order in memory, too: an instruction reaches 4095 bytes from the start
/// (ARMv7-M, LDR immediate), so what is large comes last. That alone saves 0.5 kB of code.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Device<P, M, I: Instrument = Whole> {
    /// Until LSS stores another.
    node_id: u8,
    /// Until LSS stores another.
    kbit_s: u16,
    sync_substituted: bool,
    record_damaged: bool,
    /// What a program on trial has not shown yet.
    trial: Trial,
    /// What the bus was told of.
    faults: Faults,
    /// The judgement that the bus was shown last.
    judged: Option<Judgement>,
    /// What was found wrong with this channel and its memory at the last look.
    looked: Faults,
    /// When the code was started: the log's time begins here.
    started: Instant,
    /// When the sensor was last seen sound, for setting it up anew.
    sensor_sound: Instant,
    /// When the calibration in force is next compared with what came into force.
    next_sum: Instant,
    next_refresh: Instant,
    /// No page is erased for an update before this.
    next_erase: Instant,
    /// When the next call is due, the channel's own deadline apart.
    next: Instant,
    log_writer: LogWriter,
    matching: Matching,
    bus: Node<I::Tpdos>,
    parts: Parts<M, Channel<P, I>, I>,
}

/// What the device lends its node: objects and parts.
type Objects<'a, P, M, I> = DeviceObjects<'a, M, Channel<P, I>, I>;

impl<P: Part, C: Composition> Source<C> for Channel<P, C> {
    fn reading(&self, settings: &Settings<C>, now: Instant) -> Reading {
        self.reading(settings, now)
    }

    fn observe(&mut self, settings: &Settings<C>, now: Instant) -> Observation {
        self.observe(settings, now)
    }

    fn moment(&self, settings: &Settings<C>, now: Instant) -> Moment {
        Moment {
            reading: self.reading_now(settings, now),
            rate: self.rate(settings, now),
        }
    }

    fn measured_sum(&self) -> MeasuredSum {
        self.measured_sum()
    }

    fn filtered(&self) -> Option<Filtered> {
        self.filtered().map(|(filtered, _)| filtered)
    }

    fn temperature(&self) -> Option<Temperature> {
        self.temperature()
    }

    fn fault(&self) -> Option<Invalid> {
        self.fault()
    }
}

impl<P: Part, M: Memory, I: Instrument> Device<P, M, I> {
    /// A device that has not been started.
    ///
    /// It is larger than all the stack that its work takes, so it must not be made on the stack
    /// first and copied. Only what a call returns is written right into its place, and only when
    /// the calls come in the order of the fields: that is why this is never inlined, nor are the
    /// constructors of its large parts. `cargo xtask image` finds a copy by its budget for RAM.
    #[inline(never)]
    pub fn new(part: P, check: CrossCheck<I>, factory: Factory, memory: M) -> Self {
        let Factory {
            identity,
            node_id,
            kbit_s,
            setup,
            table_settings,
        } = factory;
        Self {
            node_id,
            kbit_s,
            sync_substituted: false,
            record_damaged: false,
            trial: Trial::OVER,
            faults: Faults::default(),
            judged: None,
            looked: Faults::default(),
            started: Instant(0),
            sensor_sound: Instant(0),
            next_sum: Instant(0),
            next_refresh: Instant(0),
            next_erase: Instant(0),
            next: Instant(0),
            log_writer: LogWriter::new(),
            matching: Matching::new(),
            bus: Node::new(),
            parts: Parts::new(
                identity,
                Channel::new(part),
                memory,
                &setup,
                table_settings,
                check,
            ),
        }
    }

    /// The bus's node and what the device lends it.
    fn split(&mut self, now: Instant) -> (&mut Node<I::Tpdos>, Objects<'_, P, M, I>) {
        let parts = &mut self.parts;
        (&mut self.bus, DeviceObjects { parts, now })
    }

    /// First half of a start or reset: the stored calibration, then the part's set-up.
    ///
    /// Takes about 20 ms of `delay`. Errors: see [`Channel::start`]; the device goes on the bus
    /// all the same, with the reason instead of angles.
    // Out of line: what it makes anew is large, and the second half needs none of it on the stack.
    #[inline(never)]
    pub fn start_sensor<D: DelayNs>(
        &mut self,
        delay: &mut D,
        now: Instant,
    ) -> Result<(), PartError<P::Error>> {
        self.parts.values = Values::new();
        self.faults = Faults::default();
        self.judged = None;
        self.looked = Faults::default();
        self.matching = Matching::new();
        self.parts.pair.start(now);
        self.sync_substituted = false;
        self.parts.work.abandon();
        self.parts.values.storage_failed = self.parts.memory.start().is_err();
        self.recall_events();
        self.recall_calibration();
        self.remember_calibration();
        self.sensor_sound = now;
        self.parts.channel.start(&self.parts.settings, delay, now)
    }

    /// Sets the sensor up anew while the bus goes on: what [`BoardRequest::Sensor`] asks for.
    ///
    /// Takes about 20 ms of `delay`. Errors: see [`Channel::start`]; the channel then keeps its
    /// reason, and is tried again later.
    pub fn restart_sensor<D: DelayNs>(
        &mut self,
        delay: &mut D,
        now: Instant,
    ) -> Result<(), PartError<P::Error>> {
        self.sensor_sound = now;
        self.parts.pair.compare_anew();
        self.parts.channel.start(&self.parts.settings, delay, now)
    }

    /// The calibration in memory, or the one delivered where there is none or it is damaged.
    fn recall_calibration(&mut self) {
        let recalled = recall(
            &mut self.parts.memory,
            &mut self.parts.settings.chain.calibration,
        );
        self.parts.values.calibrated = recalled.calibrated;
        // What is lost is told of whichever record was left in its place.
        let lost = self.parts.memory.damaged();
        let calibration = 1 << Record::Calibration as u32;
        self.record_damaged = recalled.damaged || lost & calibration != 0;
        self.parts.values.storage_failed |= lost & !calibration != 0;
    }

    /// Remembers what the calibration in force looks like, to see it change by itself.
    fn remember_calibration(&mut self) {
        self.parts.values.calibration_sum = identity(&self.parts.settings.chain.calibration);
    }

    /// Second half of a start: everything stored comes back, and boot-up is due.
    pub fn start_bus(&mut self, now: Instant) {
        let (node_id, rate) = stored_lss(&mut self.parts.memory);
        self.parts.values.bit_rate = rate.unwrap_or(self.kbit_s);
        let node_id = node_id.unwrap_or(self.node_id);
        self.trial = Trial::begin(&mut self.parts.memory);
        self.parts.pair.excuse_sync(now);
        self.started = now;
        self.next_sum = now;
        self.next_refresh = now;
        self.next = now;
        let (bus, mut objects) = self.split(now);
        bus.start(&mut objects, node_id, now);
        self.choose_check();
    }

    /// The part has raised data-ready at `captured`.
    // Apart: within the caller's loop it would have that set up what nobody needs between samples.
    #[inline(never)]
    pub fn data_ready(&mut self, captured: Instant) {
        self.parts
            .channel
            .data_ready(&self.parts.settings, captured);
        if self.parts.pair.own_fault().is_none() && self.parts.channel.reason().is_some() {
            // A channel that finds itself faulty reports it without delay.
            self.next = self.next.min(captured);
        }
    }

    /// A frame has ended on the bus at `now`.
    pub fn receive(&mut self, frame: &Frame, now: Instant) {
        self.watch_peer(frame);
        let (bus, mut objects) = self.split(now);
        if !bus.receive(&mut objects, frame, now) {
            return;
        }
        let pending = &self.parts.values.pending;
        if pending.sync {
            self.synchronised(SyncSource::Bus, now);
        } else if pending.exchange != Pdos::NONE {
            return self.exchanged(now);
        }
        self.after(now);
    }

    /// A frame of this device has ended on the bus at `now`.
    pub fn sent(&mut self, frame: &Frame, now: Instant) {
        if frame.cob_id() == Some(SDO_ANSWER + u16::from(self.bus.node_id())) {
            let pending = &mut self.parts.values.pending;
            pending.reset |= core::mem::take(&mut pending.restart);
        }
        self.trial.heard();
        if let Some(id) = frame.cob_id() {
            self.matching.sending.gone(id);
        }
        let id = frame.cob_id();
        let waits = id.is_some_and(|id| self.bus.pdo_sent(id, now));
        if self.bus.told(frame, now) {
            let (bus, mut objects) = self.split(now);
            bus.sync_sent(&mut objects, frame, now);
        } else if !waits && id.is_some_and(|id| PDOS.contains(&id)) {
            // What else a PDO brings about was known when it was made.
            return;
        }
        if self.parts.values.pending.sync {
            self.synchronised(SyncSource::Own, now);
        }
        self.after(now);
    }

    /// The next frame to hand to the controller; call it when there is room for one.
    pub fn transmit(&mut self, now: Instant) -> Option<Frame> {
        self.hand_over(self.waiting(now)?, now)
    }

    /// What [`Device::transmit`] would give.
    pub fn waiting(&self, now: Instant) -> Option<Waiting> {
        self.bus
            .waiting::<DeviceObjects<'_, M, Channel<P, I>, I>>(now)
    }

    /// The frame that [`Device::waiting`] has named at the same instant.
    // Apart, because mostly there is nothing to hand over.
    #[inline(never)]
    pub fn hand_over(&mut self, waiting: Waiting, now: Instant) -> Option<Frame> {
        let (bus, mut objects) = self.split(now);
        let out = bus.hand_out(&mut objects, waiting, now)?;
        let until = out.until;
        self.matching.sending.hand_over(waiting.cob_id, until);
        Some(out.frame)
    }

    /// The identifier of a frame that the controller may still have and that may not go out any
    /// more, told once: abort it there, and call [`Device::withdrawn`] when it has not gone out.
    ///
    /// One that is on the wire ends with its transmission; where that fails it is not repeated. Ask
    /// before each [`Device::transmit`].
    pub fn withdraw(&mut self) -> Option<u16> {
        self.matching.sending.recalled()
    }

    /// A frame that [`Device::withdraw`] has named was taken back and has not gone out.
    pub fn withdrawn(&mut self, cob_id: u16, now: Instant) {
        self.matching.sending.withdrawn(cob_id);
        self.bus.withdrawn(cob_id);
        // What is sent on events is told as it is now.
        self.next = self.next.min(now);
    }

    /// The processor stood still until `now`, as it does while a page is erased: what happened
    /// meanwhile is told later, with its own time.
    ///
    /// The sensor is not blamed for that time, nor are nodes whose heartbeats may have been lost,
    /// and the next page waits until what has come up is done.
    pub fn stood_still(&mut self, now: Instant) {
        self.parts.channel.excuse(&self.parts.settings, now);
        // No page is erased in OPERATIONAL: whatever else takes long there, frames are kept.
        if self.bus.state() != State::Operational {
            self.bus.excuse(now);
        }
        self.next_erase = now.offset(PAUSE_US);
    }

    /// Everything that is due at `now`; returns when to call again.
    pub fn poll(&mut self, now: Instant) -> Instant {
        self.parts.channel.poll(&self.parts.settings, now);
        self.watch_own(now);
        self.matching.sending.expire(now);
        if now >= self.next_refresh {
            self.next_refresh = now.offset(REFRESH_US);
            self.refresh(now);
            // A reading of a SYNC that was left as it is must not grow older than others do.
            let measured_at = self.parts.values.process.measured_at;
            let oldest = measured_at.offset(OLDEST_READING_US);
            self.next_refresh = self.next_refresh.min(oldest);
            if self.log_writer.is_copying() {
                self.next_refresh = self.next_refresh.min(now.offset(PIECE_US));
            }
            self.update(now);
        }
        let (bus, mut objects) = self.split(now);
        let bus = bus.poll(&mut objects, now);
        let bus = bus.unwrap_or(self.next_refresh);
        self.exchanged(now);
        self.report(now);
        self.next = bus.min(self.next_refresh);
        self.next_deadline()
    }

    /// When [`Device::poll`] is next due. Frames bring it forward, samples put it off.
    pub fn next_deadline(&self) -> Instant {
        let channel = self.parts.channel.deadline();
        self.next.min(channel).min(self.matching.sending.next)
    }

    /// What the CAN controller reports of itself. At bus-off its mailboxes are to be emptied.
    pub fn bus_state(&mut self, state: BusState, transmit: u8, receive: u8, now: Instant) {
        let shown = &mut self.parts.values.process.bus;
        let code = match state {
            BusState::Active => 0,
            BusState::Passive => 1,
            BusState::Off => 2,
        };
        if code == 2 && shown.state != 2 {
            shown.bus_offs = shown.bus_offs.saturating_add(1);
        }
        if code == 2 {
            // Whatever waited in the controller is gone, and so is what the peer has sent. A
            // restart waits no longer for its answer to go out.
            let pending = &mut self.parts.values.pending;
            pending.reset |= core::mem::take(&mut pending.restart);
            self.matching.sending = Sending::new();
            self.matching.excuse();
            self.parts.values.pending.own = None;
            self.parts.pair.lost();
        }
        shown.state = code;
        shown.transmit_errors = transmit;
        shown.receive_errors = receive;
        let (bus, mut objects) = self.split(now);
        bus.bus_state(&mut objects, state, now);
        self.after(now);
    }

    /// How busy the bus has been in the last second, per cent.
    pub const fn set_bus_load(&mut self, percent: u8) {
        self.parts.values.process.bus.load_percent = percent;
    }

    /// The controller's bit rate is this one now, kbit/s; 0 while it is looked for.
    pub const fn set_bit_rate(&mut self, kbit_s: u16) {
        self.parts.values.bit_rate = kbit_s;
    }

    /// The bit rate to start with, kbit/s; `None` when it is to be found by listening.
    pub fn bit_rate(&self) -> Option<u16> {
        let automatic = self.parts.values.parameters.automatic_bit_rate == 1;
        let known = !automatic && self.parts.values.bit_rate != 0;
        known.then_some(self.parts.values.bit_rate)
    }

    /// The controller has gone bus-off: when to ask it back (2051h); `None`: not by itself.
    pub fn recovery(&self, now: Instant) -> Option<Instant> {
        let wait_ms = i64::from(self.parts.values.parameters.recovery_ms);
        (wait_ms != 0).then(|| now.offset(wait_ms * 1000))
    }

    /// What only the board can do, once.
    pub fn take_request(&mut self) -> Option<BoardRequest> {
        let pending = &mut self.parts.values.pending;
        if core::mem::take(&mut pending.reset) {
            self.keep_all(self.next_refresh);
            return Some(BoardRequest::Reset);
        }
        if core::mem::take(&mut pending.sensor) {
            return Some(BoardRequest::Sensor);
        }
        let (kbit_s, delay_ms) = pending.bit_rate.take()?;
        Some(BoardRequest::BitRate { kbit_s, delay_ms })
    }

    /// The channel, for looking at.
    pub const fn channel(&self) -> &Channel<P, I> {
        &self.parts.channel
    }

    /// The pair, for looking at.
    pub const fn pair(&self) -> &Pair<I> {
        &self.parts.pair
    }

    /// What is shown on the bus at `now`.
    pub fn shown(&self, now: Instant) -> Shown<'_, I> {
        self.parts.shown(now)
    }

    /// The values shown on the bus.
    pub const fn values(&self) -> &Values {
        &self.parts.values
    }

    /// The node on the bus.
    pub const fn bus(&self) -> &Node<I::Tpdos> {
        &self.bus
    }

    /// The settings in force.
    pub const fn settings(&self) -> &Settings<I> {
        &self.parts.settings
    }

    /// The settings in force, for fault injection and tests: nothing else may change them.
    pub const fn settings_mut(&mut self) -> &mut Settings<I> {
        &mut self.parts.settings
    }

    /// The memory.
    pub const fn memory(&mut self) -> &mut M {
        &mut self.parts.memory
    }

    /// Faults that stand.
    pub const fn faults(&self) -> Faults {
        self.faults
    }
}
