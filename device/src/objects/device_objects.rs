//! The device as its dictionary shows it: every row above 1FFFh, and those of the area below that
//! describe the device or its memory.
//!
//! In: reads, writes and events from the stack. Out: values, abort codes, and what is left in
//! [`Values`] for the device to act on. A write that is refused changes nothing.
//!
//! Left out: the communication objects, which the stack serves itself.

use canopen::nmt;
use canopen::node::{Application, Event};
use canopen::object::{Abort, Address, Dictionary, Number, Objects, Value, at};
use canopen::services::Services;
use canopen::storage::Group;
use instant::Instant;
use tilt::chain::{Invalid, Reading};
use tilt::composition::{Composition, Place, Whole};
use tilt::cross_check::CrossCheck;
use tilt::filter::Filtered;
use tilt::fusion::MeasuredSum;
use tilt::observation::Observation;
use tilt::sample::Temperature;

use super::communication::{PRODUCT_CODE_A, PRODUCT_CODE_B, REVISION, VENDOR_ID};
use super::moment::{ALL_TURNED, Moment};
use super::process::Shown;
use super::safety::VALID;
use super::table::{Channel, Models};
use super::turned;
use super::values::Values;
use crate::black_box::BlackBox;
use crate::calibration::motor::{Motor, TableSettings};
use crate::channel::{Settings, Setup};
use crate::exchange::Pdos;
use crate::fault_log::FaultLog;
use crate::instrument::Instrument;
use crate::pair::Pair;
use crate::presentation::Presentation;
use crate::program::ProgramMemory;
use crate::records::{EventStore, Record, RecordStore, StoreError, parameters};

/// Where readings come from: the channel, or anything that stands in for it.
pub trait Source<C: Composition = Whole> {
    /// The reading at `now`.
    fn reading(&self, settings: &Settings<C>, now: Instant) -> Reading;
    /// All that the channel reports at `now`, a SYNC.
    fn observe(&mut self, settings: &Settings<C>, now: Instant) -> Observation;
    /// What is so at this very moment, where there is a gyroscope.
    fn moment(&self, _settings: &Settings<C>, _now: Instant) -> Moment {
        Moment::NOTHING
    }
    /// What the gyroscope has measured since the start, summed up.
    fn measured_sum(&self) -> MeasuredSum {
        MeasuredSum::default()
    }
    /// The newest filtered acceleration.
    fn filtered(&self) -> Option<Filtered>;
    /// The part's temperature.
    fn temperature(&self) -> Option<Temperature>;
    /// The fault that is latched.
    fn fault(&self) -> Option<Invalid>;
}

/// Records, events and a place for programs.
pub trait Memory: RecordStore + EventStore + ProgramMemory {}

impl<M: RecordStore + EventStore + ProgramMemory> Memory for M {}

/// What a calibration over the bus works with.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Work<I: Instrument = Whole> {
    /// What new tables come with.
    pub table_settings: TableSettings,
    /// The motor's run, where the instrument has one.
    pub motor: Option<I::Motor>,
}

impl<I: Instrument> Work<I> {
    /// No run.
    #[inline(never)]
    pub fn new(table_settings: TableSettings) -> Self {
        Self {
            motor: I::Motor::put(Motor::new),
            table_settings,
        }
    }
}

impl<I: Instrument> Work<I> {
    /// A run is open.
    pub fn is_running(&self) -> bool {
        self.motor
            .as_ref()
            .is_some_and(|motor| motor.get().is_running())
    }

    /// Ends whatever is under way.
    pub fn abandon(&mut self) {
        if let Some(motor) = &mut self.motor {
            *motor.get_mut() = Motor::new();
        }
    }
}

/// What tells one device from another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Which channel of the instrument.
    pub channel: Channel,
    /// 1018h sub 4.
    pub serial: u32,
    /// Whose rows are shown by a device that could be either instrument.
    pub models: Models,
}

/// Everything behind the rows. What is large comes last, as in `Device`, and what is handed on as a
/// whole comes behind what is read field by field: so the pair stands where an instruction reaches
/// it from the start of the device, which saves 0.2 kB of code.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Parts<M, S, I: Instrument = Whole> {
    /// Who this is.
    pub identity: Identity,
    /// The values.
    pub values: Values,
    /// The channel.
    pub channel: S,
    /// The pair.
    pub pair: Pair<I>,
    /// Angle and rates of the last SYNC, or of the last look without one.
    pub moment: Option<I::Moment>,
    /// The memory.
    pub memory: M,
    /// Settings with the calibration in force.
    pub settings: Settings<I>,
    /// Calibration under way.
    pub work: Work<I>,
    /// The fault log.
    pub log: FaultLog,
    /// The black box.
    pub black_box: BlackBox,
}

impl<M, S: Source<I>, I: Instrument> Parts<M, S, I> {
    /// Nothing measured, nothing kept.
    #[inline(never)]
    pub fn new(
        identity: Identity,
        channel: S,
        memory: M,
        setup: &Setup,
        table_settings: TableSettings,
        check: CrossCheck<I>,
    ) -> Self {
        Self {
            identity,
            values: Values::new(),
            channel,
            pair: Pair::new(check),
            moment: I::Moment::put(|| Moment::NOTHING),
            memory,
            settings: Settings::uncalibrated(setup),
            work: Work::new(table_settings),
            log: FaultLog::new(),
            black_box: BlackBox::new(),
        }
    }

    /// Takes in what is so at this very moment.
    // Where there is no gyroscope nothing is left of it.
    #[inline(always)]
    pub fn take_moment(&mut self, now: Instant) {
        if let Some(place) = &mut self.moment {
            *place.get_mut() = self.channel.moment(&self.settings, now);
        }
    }

    /// How this channel's angles are shown.
    pub fn presentation(&self) -> Presentation {
        if I::PRESETS {
            self.values.parameters.presentation()
        } else {
            Presentation::AS_MEASURED
        }
    }

    /// What is shown of both channels at `now`.
    pub fn shown(&self, now: Instant) -> Shown<'_, I> {
        Shown::new(&self.values, &self.pair, self.channel.fault(), now)
    }
}

/// Everything behind the rows, lent for one call of the stack.
pub struct DeviceObjects<'a, M, S, I: Instrument = Whole> {
    /// What is lent.
    pub parts: &'a mut Parts<M, S, I>,
    /// When the call is.
    pub now: Instant,
}

/// Address of the node-id in the LSS record, which has no rows.
const LSS_NODE_ID: Address = at(0, 1);
/// Address of the bit rate in the LSS record, in kbit/s.
const LSS_BIT_RATE: Address = at(0, 2);

/// Node-id and bit rate as LSS has stored them.
pub fn stored_lss<M: RecordStore>(memory: &mut M) -> (Option<u8>, Option<u16>) {
    let mut number = |address| parameters::get(memory, Record::Lss, address).map(|v| v.unsigned());
    (
        number(LSS_NODE_ID).map(|n| n as u8),
        number(LSS_BIT_RATE).map(|n| n as u16),
    )
}

/// Stores node-id and bit rate as LSS does; a rate that is `None` is the factory's.
///
/// Errors: those of the store.
pub fn store_lss<M: RecordStore>(
    memory: &mut M,
    node_id: u8,
    kbit_s: Option<u16>,
) -> Result<(), StoreError> {
    RecordStore::begin(memory, Record::Lss, Record::Lss.longest())?;
    parameters::put(memory, LSS_NODE_ID, &Value::u8(node_id))?;
    if let Some(rate) = kbit_s {
        parameters::put(memory, LSS_BIT_RATE, &Value::u16(rate))?;
    }
    RecordStore::commit(memory)
}

const fn record(group: Group) -> Record {
    match group {
        Group::Communication => Record::Communication,
        Group::Profile => Record::Profile,
        Group::Manufacturer => Record::Manufacturer,
    }
}

/// What a master is told when the memory does not do its part.
pub const fn store_abort(error: StoreError) -> Abort {
    match error {
        StoreError::Hardware => Abort::Hardware,
        StoreError::Full => Abort::OutOfMemory,
        StoreError::NotBegun => Abort::General,
    }
}

impl<M: Memory, S: Source<I>, I: Instrument> DeviceObjects<'_, M, S, I> {
    /// What is shown of both channels now.
    // Out of line: what reads a slope, a preset and a safe slope would each make it anew.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub(super) fn shown(&self) -> Shown<'_, I> {
        self.parts.shown(self.now)
    }

    fn number(&mut self, at: Address) -> Result<Number, Abort> {
        let axis = usize::from(at.sub).wrapping_sub(1);
        let process = &self.parts.values.process;
        let number = match at.index {
            0x1018 => return self.identity_value(at),
            0x1F50..=0x1F57 | 0x2080 if I::UPDATE => return self.read_program(at),
            0x2030 | 0x2060 | 0x2062 => return self.read_calibration(at),
            0x6210..=0x6221 if I::SERVICES.safety => return self.read_safe_slope(at),
            0x6000..=0x61FF | 0x6800..=0x69FF => return self.read_slope(at),
            0x2010 => exchange_value(&process.sent, at.sub),
            0x2011 => exchange_value(&process.received, at.sub),
            0x2020..=0x2028 => self.shown_value(at),
            0x2029 | 0x202A if I::Moment::FITTED => return self.read_moment(at),
            0x202B if I::Moment::FITTED => turned::read(&process.sent.turned, at.sub),
            0x202C if I::Moment::FITTED => turned::read(&process.received.turned, at.sub),
            0x2034 if I::Moment::FITTED => return self.read_turned(at),
            0x2031 => process.filtered.get(axis).copied().map(Number::i32),
            0x2032 => Some(Number::u32(process.samples)),
            0x2033 => Some(Number::u32(process.period_q8)),
            0x2052 => bus_value(&process.bus, at.sub),
            0x2053 if at.sub == 1 => Some(Number::u16(self.parts.values.bit_rate)),
            0x6511 => Some(Number::i8(process.temperature_c)),
            _ => self.parts.values.parameters.place(at).map(|p| p.get()),
        };
        number.ok_or(Abort::NoSuchObject)
    }

    /// 2020h to 2028h, what is derived at this instant and what stands beside it.
    fn shown_value(&self, at: Address) -> Option<Number> {
        let process = &self.parts.values.process;
        let shown = self.shown();
        let axis = usize::from(at.sub).wrapping_sub(1);
        Some(match (at.index, at.sub) {
            (0x2020, _) => Number::u8(shown.validity()),
            (0x2021, _) => Number::u8(shown.state()),
            (0x2022, 3) => Number::u16(shown.larger_uncertainty()),
            (0x2022, _) => Number::u16(shown.uncertainty(axis)),
            (0x2023, 1) => Number::u32(process.latency_us),
            (0x2023, _) => Number::u8(process.latency_ms()),
            (0x2024, 3) => Number::i16(shown.larger_delta()),
            (0x2024, _) => Number::i16(*shown.delta().get(axis)?),
            (0x2025, _) => Number::u8(shown.reason(axis)),
            (0x2026, 1) => Number::u32(process.syncs),
            (0x2026, 2) => Number::u16(process.missed),
            (0x2026, _) => Number::u8(process.source as u8),
            (0x2027, 1) => Number::u8(shown.blame().0),
            (0x2027, 2) => Number::u8(shown.blame().1),
            (0x2027, _) => Number::u32(process.since_ms),
            _ => Number::i16(*shown.residual().get(axis)?),
        })
    }

    /// The signature that 63FFh must hold for the parameters as they are.
    fn safety_signature(&self) -> u16 {
        let resolution = self.parts.values.parameters.safety_resolution;
        canopen::crc::update(0, &resolution.to_le_bytes())
    }

    fn write_safety(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        // While the node works, SRDOs neither begin nor change what they carry.
        if self.parts.values.state == nmt::State::Operational {
            return Err(Abort::WrongState);
        }
        let signature = self.safety_signature();
        let parameters = &mut self.parts.values.parameters;
        match at.index {
            0x6200 => {
                crate::profile::Resolution::new(value.unsigned() as u16).map_err(|r| r.abort())?;
                parameters.safety_valid = 0;
            }
            0x63FE => {
                let valid = value.unsigned() == u64::from(VALID);
                if valid && parameters.safety_signature != signature {
                    return Err(Abort::ParameterIncompatible);
                }
                parameters.safety_valid = if valid { VALID } else { 0 };
                return Ok(());
            }
            _ if value.unsigned() != u64::from(signature) => return Err(Abort::InvalidValue),
            _ => {}
        }
        self.put(at, value)
    }

    fn put(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        let place = self.parts.values.parameters.place(at);
        place.ok_or(Abort::NoSuchObject)?.set(value);
        Ok(())
    }

    fn identity_value(&self, at: Address) -> Result<Number, Abort> {
        let number = usize::from(at.sub).wrapping_sub(1);
        let number = self.identity().get(number).copied();
        number.map(Number::u32).ok_or(Abort::NoSuchSubIndex)
    }
}

/// Sub-index of 2010h and 2011h at which the objects of the first PDO begin.
const ANGLES: u8 = 1;
/// The same of the second PDO.
const BACKING: u8 = 5;

fn exchange_value(exchange: &crate::exchange::Exchange, sub: u8) -> Option<Number> {
    let [x, y] = exchange.angle;
    let [quality_x, quality_y] = exchange.quality;
    Some(match sub {
        1 => Number::i24(x),
        2 => Number::i24(y),
        3 => Number::u8(quality_x),
        4 => Number::u8(quality_y),
        8 => Number::u8(exchange.captured),
        9 => Number::u8(exchange.activity),
        _ => Number::i16(*exchange.vector.get(usize::from(sub).wrapping_sub(5))?),
    })
}

fn bus_value(bus: &super::process::Bus, sub: u8) -> Option<Number> {
    Some(match sub {
        1 => Number::u8(bus.state),
        2 => Number::u8(bus.transmit_errors),
        3 => Number::u8(bus.receive_errors),
        4 => Number::u8(bus.load_percent),
        5 => Number::u16(bus.overruns),
        6 => Number::u16(bus.bus_offs),
        _ => return None,
    })
}

fn receive_exchange(exchange: &mut crate::exchange::Exchange, at: Address, value: Value) {
    let [x, y] = &mut exchange.angle;
    let [quality_x, quality_y] = &mut exchange.quality;
    match at.sub {
        1 => *x = value.signed_32(),
        2 => *y = value.signed_32(),
        3 => *quality_x = value.unsigned() as u8,
        4 => *quality_y = value.unsigned() as u8,
        8 => exchange.captured = value.unsigned() as u8,
        9 => exchange.activity = value.unsigned() as u8,
        sub => {
            if let Some(axis) = exchange.vector.get_mut(usize::from(sub).wrapping_sub(5)) {
                *axis = value.signed_32() as i16;
            }
        }
    }
}

impl<M: Memory, S: Source<I>, I: Instrument> Objects for DeviceObjects<'_, M, S, I> {
    const SERVICES: Services = I::SERVICES;

    fn dictionary(&self) -> Dictionary {
        I::dictionary(self.parts.identity)
    }

    fn read(&mut self, at: Address) -> Result<Value, Abort> {
        if I::Moment::FITTED && at == ALL_TURNED {
            return Ok(self.read_all_turned());
        }
        self.number(at).map(Value::from)
    }

    fn write(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        match at.index {
            0x1F51 if I::UPDATE => self.control_program(value),
            0x2011 => {
                receive_exchange(&mut self.parts.values.process.received, at, value);
                Ok(())
            }
            0x202C if I::Moment::FITTED => {
                turned::receive(&mut self.parts.values.process.received.turned, at, value);
                Ok(())
            }
            0x2040 if I::PRESETS => self.write_range(at, value),
            0x2060 => self.write_calibration(at, value),
            0x2072 if I::HISTORY => self.clear_history(value),
            0x2080 if I::UPDATE => self.resume_program(value),
            0x6200 | 0x63FE | 0x63FF if I::SERVICES.safety => self.write_safety(at, value),
            0x6000..=0x61FF | 0x6800..=0x69FF if I::PRESETS => self.write_slope(at, value),
            _ => self.put(at, value),
        }
    }

    /// The exchange as its two PDOs carry it: at each SYNC eight objects one by one would be a
    /// tenth of all that the node does.
    fn read_adjacent(&mut self, first: Address, length: usize) -> Option<Value> {
        let sent = &self.parts.values.process.sent;
        if I::Moment::FITTED && (first.index, first.sub, length) == (0x202B, 1, 8) {
            return Some(Value::whole(sent.turned.bytes()));
        }
        let bytes = sent.bytes();
        let (pdos, _) = bytes.as_chunks::<8>();
        let pdo = match (first.index, first.sub, length) {
            (0x2010, ANGLES, 8) => pdos.first(),
            (0x2010, BACKING, 8) => pdos.last(),
            _ => None,
        };
        Some(Value::whole(*pdo?))
    }

    fn write_adjacent(&mut self, first: Address, values: &Value) -> bool {
        let received = &mut self.parts.values.process.received;
        let Ok(bytes) = values.bytes().try_into() else {
            return false;
        };
        match (first.index, first.sub) {
            (0x2011, ANGLES) => received.take_angles(bytes),
            (0x2011, BACKING) => received.take_backing(bytes),
            (0x202C, 1) if I::Moment::FITTED => received.turned.take(bytes),
            _ => return false,
        }
        true
    }

    fn open(&mut self, at: Address) -> Result<u32, Abort> {
        self.open_stream(at)
    }

    fn read_at(&mut self, at: Address, offset: u32, into: &mut [u8]) -> Result<usize, Abort> {
        self.read_stream(at, offset, into)
    }

    fn create(&mut self, at: Address, size: Option<u32>) -> Result<(), Abort> {
        self.create_stream(at, size)
    }

    fn append(&mut self, at: Address, bytes: &[u8]) -> Result<(), Abort> {
        self.append_stream(at, bytes)
    }

    fn commit(&mut self, at: Address) -> Result<(), Abort> {
        self.commit_stream(at)
    }

    fn discard(&mut self, at: Address) {
        self.discard_stream(at);
    }
}

impl<M: Memory, S: Source<I>, I: Instrument> Application for DeviceObjects<'_, M, S, I> {
    fn identity(&self) -> [u32; 4] {
        let product = match self.parts.identity.channel {
            Channel::A => PRODUCT_CODE_A,
            Channel::B => PRODUCT_CODE_B,
        };
        [VENDOR_ID, product, REVISION, self.parts.identity.serial]
    }

    fn event(&mut self, event: Event, _now: Instant) {
        let pending = &mut self.parts.values.pending;
        match event {
            Event::State(state) => self.enter(state),
            Event::ResetNode => {
                pending.reset = true;
                pending.restart = false;
            }
            Event::ResetCommunication => {
                // No answer will come any more that a restart could wait for.
                pending.reset |= core::mem::take(&mut pending.restart);
                self.enter(nmt::State::Initialising);
                self.mend_slopes();
            }
            Event::Sync => {
                let observation = self.parts.channel.observe(&self.parts.settings, self.now);
                self.parts.take_moment(self.now);
                let own_fault = self.parts.pair.own_fault();
                let shown = self.parts.presentation();
                self.parts
                    .values
                    .latch(observation, own_fault, shown, self.now);
            }
            // The stack tells a lost node by EMCY; the pair's own measure of the peer is its
            // exchange.
            Event::Heartbeat { .. } | Event::LifeGuarding { .. } => {}
            Event::Received(rpdo) => {
                let pdo = match rpdo {
                    0 => Pdos::ANGLES,
                    1 => Pdos::BACKING,
                    2 if I::Moment::FITTED => Pdos::TURN,
                    _ => Pdos::NONE,
                };
                pending.exchange = pending.exchange.with(pdo);
            }
            Event::BitRate { kbit_s, delay_ms } => pending.bit_rate = Some((kbit_s, delay_ms)),
            Event::SafetyLost(_) | Event::FailSafe => pending.fail_safe = true,
        }
    }

    fn load(&mut self, at: Address, value: Value) {
        match at.index {
            0x6000..=0x61FF | 0x6800..=0x69FF if I::PRESETS => self.load_slope(at, value),
            _ => {
                let turn = I::PRESETS.then(|| self.range_of_a_turn(at)).flatten();
                let value = turn.unwrap_or(value);
                if let Some(mut place) = self.parts.values.parameters.place(at) {
                    place.set(value);
                }
            }
        }
    }

    fn begin_store(&mut self, group: Group) -> Result<(), Abort> {
        let record = record(group);
        self.may_store(record.longest())?;
        let begun = RecordStore::begin(&mut self.parts.memory, record, record.longest());
        self.note(begun)
    }

    fn put(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        let put = parameters::put(&mut self.parts.memory, at, &value);
        self.note(put)
    }

    fn commit_store(&mut self) -> Result<(), Abort> {
        let committed = RecordStore::commit(&mut self.parts.memory);
        self.note(committed)
    }

    fn erase(&mut self, group: Group) -> Result<(), Abort> {
        self.may_store(0)?;
        let erased = RecordStore::erase(&mut self.parts.memory, record(group));
        self.note(erased)
    }

    fn stored(&mut self, group: Group, at: Address) -> Option<Value> {
        parameters::get(&mut self.parts.memory, record(group), at)
    }

    fn store_lss(&mut self, node_id: u8, kbit_s: Option<u16>) -> bool {
        // A download under way is not to be broken by another master's LSS.
        if self.parts.values.receiving {
            return false;
        }
        // What was stored and is not mentioned stays.
        let (_, before) = stored_lss(&mut self.parts.memory);
        let stored = store_lss(&mut self.parts.memory, node_id, kbit_s.or(before));
        self.note(stored).is_ok()
    }
}

impl<M: Memory, S: Source<I>, I: Instrument> DeviceObjects<'_, M, S, I> {
    /// The NMT state is another one. Outside OPERATIONAL this node is away from the pair.
    fn enter(&mut self, state: nmt::State) {
        self.parts.values.state = state;
        if state != nmt::State::Operational {
            self.parts.pair.leave();
        }
    }

    /// While others work by the angles the processor does not stand still for an erase.
    fn may_store(&self, length: u32) -> Result<(), Abort> {
        if self.parts.values.state == nmt::State::Operational
            && self.parts.memory.needs_erase(length)
        {
            return Err(Abort::WrongState);
        }
        Ok(())
    }

    /// Remembers whether the memory did its part, for the fault that tells.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub(super) fn note(&mut self, outcome: Result<(), StoreError>) -> Result<(), Abort> {
        self.parts.values.storage_failed |= outcome.is_err();
        outcome.map_err(store_abort)
    }
}
