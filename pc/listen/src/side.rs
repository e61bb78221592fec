//! One channel, as the bus tells of it.
//!
//! In: the values of its PDOs, its EMCY and heartbeats. Out: its [`Side`].
//!
//! Left out: what it sends by SDO.

use canopen::nmt::State;
use device::exchange::{self, Exchange, NO_VECTOR};
use device::fault::Fault;

use super::checks::{Check, Checks};
use super::decode::Values;
use super::exchange::Measured;
use super::messages::{Emergency, Part};
use super::plan::{NodePlan, PdoPlan, What};
use super::supervision::Heartbeat;
use super::unit::Unit;

/// A heartbeat that has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Beat {
    /// The state when it is another one than before; of a boot-up message always.
    pub changed: Option<State>,
    /// The last one before it, ns, where it was lost until now.
    pub lost_since_ns: Option<u64>,
}

/// What was told so shortly before a boot-up message belongs to the same start, ns: an EMCY of the
/// start has the lower identifier and overtakes it on the bus.
pub const SAME_START_NS: u64 = 20_000_000;

/// What TPDO 1 carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slopes {
    /// When it was seen.
    pub time_ns: u64,
    /// Slope X and Y, 0.001 deg; `None` where the channel reports that it must not be used: by its
    /// bit of 2020h, by the number 8000h, or by both; and while they are in another unit than the
    /// one they are taken in.
    pub mdeg: [Option<i32>; 2],
    /// Validity (2020h); `None` where no PDO carries it.
    pub validity: Option<u8>,
    /// State of the pair (2021h); `None` where none came with them or shortly before.
    pub state: Option<u8>,
}

/// What TPDO 2 carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detail {
    /// When it was seen.
    pub time_ns: u64,
    /// The larger standard uncertainty of X and Y (k = 1), 0.001 deg (2022h).
    pub uncertainty_mdeg: Option<u16>,
    /// Group delay of the filter, ms (2023h); `None` where the PDO does not carry it.
    pub latency_ms: Option<u8>,
    /// The larger difference to the other channel as the node has formed it, 0.001 deg (2024h).
    pub difference_mdeg: Option<i16>,
    /// Where it is that of one axis: which, X being 0 (2024h sub 1, 2).
    pub difference_axis: Option<u8>,
    /// Temperature of the sensor, degC (6511h); `None` where the PDO does not carry it.
    pub temperature_degc: Option<i8>,
}

/// What TPDO 5 and 6 of an instrument with a gyroscope carry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Now {
    /// When the latest angle was seen; `None` where none was.
    pub angle_ns: Option<u64>,
    /// Slope X and Y at the SYNC itself, 0.001 deg; `None` where the channel has none.
    pub mdeg: [Option<i32>; 2],
    /// The larger standard uncertainty of both (k = 1), 0.001 deg.
    pub uncertainty_mdeg: Option<u16>,
    /// When the latest rates were seen; `None` where none were.
    pub rates_ns: Option<u64>,
    /// Rate of turn about the housing's X, Y and Z, 0.01 deg/s; `None` where the channel has none.
    pub rates: [Option<i16>; 3],
}

/// What TPDO 3 and 4 carry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Told {
    /// When the latest of both was seen.
    pub time_ns: u64,
    /// What the channel tells the other one; see `device::exchange` for the meaning.
    pub exchange: Exchange,
}

/// What one node has told.
#[derive(Clone, Debug)]
pub struct Side {
    /// Its node-id.
    pub node_id: u8,
    /// When anything of it was seen last.
    pub seen_ns: Option<u64>,
    /// The latest slopes.
    pub slopes: Option<Slopes>,
    /// The latest detail.
    pub detail: Option<Detail>,
    /// The latest angle and rates of the moment.
    pub now: Now,
    /// The latest exchange.
    pub told: Option<Told>,
    /// The state of its latest heartbeat, and when it came.
    pub nmt: Option<(State, u64)>,
    /// Its heartbeat under supervision.
    pub heartbeat: Heartbeat,
    /// The faults that stand by its latest EMCY, bit n for fault n of `device::fault`.
    pub faults: u32,
    /// Its latest EMCY, and when it came.
    pub emergency: Option<(u64, Emergency)>,
    /// Boot-up messages seen.
    pub boots: u32,
    /// What does not fit together in what it sends.
    pub checks: Checks,
    pub(super) unit: Unit,
    pub(super) plan: NodePlan,
    /// PDOs of the plan that came since the SYNC, and since the one before: bit n for PDO n.
    came: u8,
    came_before: u8,
    /// A SYNC was seen, so that a PDO can come twice after one.
    has_sync: bool,
    /// The latest slopes that its validity allows, whatever their unit, 0.001 deg.
    sent_mdeg: [Option<i32>; 2],
    /// The latest state of the pair in any of its PDOs, and when it came.
    state: Option<(u64, u8)>,
    /// When the faults that stand were told.
    faults_ns: Option<u64>,
    /// PDOs that come at every SYNC.
    at_every_sync: u8,
    kinds: Vec<Kind>,
}

/// What a PDO turned out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Slopes,
    Detail,
    Exchange(Part),
    Angle,
    Rates,
    Turned,
    Other,
}

/// Numbers of faults that exist, as a set.
const FAULTS: u32 = (1 << Fault::ALL.len()) - 1;

/// A state in a PDO of its own is that of slopes that come no later than this, as a slope is shown
/// no longer, ns.
const STATE_NS: u64 = 1_000_000_000;

/// The highest code of 2021h.
const LAST_STATE: u8 = 9;

impl Side {
    pub(super) fn new(plan: NodePlan) -> Self {
        let every = plan.pdos.iter().enumerate().take(8);
        let bits = every.map(|(number, pdo)| u8::from(pdo.every == 1) << number);
        Self {
            node_id: plan.node_id,
            seen_ns: None,
            slopes: None,
            detail: None,
            now: Now::default(),
            told: None,
            nmt: None,
            heartbeat: Heartbeat::new(plan.lost_after_ms),
            faults: 0,
            emergency: None,
            boots: 0,
            checks: Checks::default(),
            unit: Unit::taken(plan.resolution_mdeg),
            came: 0,
            came_before: 0,
            has_sync: false,
            sent_mdeg: [None; 2],
            state: None,
            faults_ns: None,
            at_every_sync: bits.fold(0, |set, bit| set | bit),
            kinds: plan.pdos.iter().map(kind_of).collect(),
            plan,
        }
    }

    /// A SYNC: what came at every SYNC so far and did not come at the last one is missing.
    #[inline]
    pub(super) fn sync(&mut self, time_ns: u64) {
        self.has_sync = true;
        let missing = self.came_before & !self.came & self.at_every_sync;
        for _ in 0..missing.count_ones() {
            self.checks.add(Check::Missed, time_ns);
        }
        (self.came_before, self.came) = (self.came, 0);
    }

    /// A PDO has come.
    #[inline]
    pub(super) fn arrived(&mut self, number: u8, every: u8, time_ns: u64) {
        let bit = 1 << number;
        if self.has_sync && every > 0 && self.came & bit != 0 {
            self.checks.add(Check::Twice, time_ns);
        }
        self.came |= bit;
    }

    /// Takes what a PDO carries.
    #[inline]
    pub(super) fn take(&mut self, time_ns: u64, pdo: usize, values: &Values) -> Kind {
        let kind = self.kinds.get(pdo).copied().unwrap_or(Kind::Other);
        if values.state.is_some_and(|state| state > LAST_STATE) {
            self.checks.add(Check::Reserved, time_ns);
        }
        if let Some(state) = values.state {
            self.state = Some((time_ns, state));
        }
        match kind {
            Kind::Slopes => self.take_slopes(time_ns, values),
            Kind::Detail => {
                self.detail = Some(Detail {
                    time_ns,
                    uncertainty_mdeg: values.uncertainty_mdeg,
                    latency_ms: values.latency_ms,
                    difference_mdeg: values.difference_mdeg,
                    difference_axis: values.difference_axis,
                    temperature_degc: values.temperature_degc,
                });
            }
            Kind::Exchange(part) => self.take_exchange(time_ns, part, values),
            Kind::Angle => {
                self.now.angle_ns = Some(time_ns);
                // They have the unit of the slopes.
                let is_known = !self.unit.is_another();
                self.now.mdeg = values.now_mdeg.map(|mdeg| mdeg.filter(|_| is_known));
                self.now.uncertainty_mdeg = values.now_uncertainty_mdeg;
            }
            Kind::Rates => {
                self.now.rates_ns = Some(time_ns);
                self.now.rates = values.rates;
            }
            Kind::Turned | Kind::Other => {}
        }
        kind
    }

    fn take_slopes(&mut self, time_ns: u64, values: &Values) {
        // A PDO without it keeps what another one has told.
        let before = self.slopes.and_then(|slopes| slopes.validity);
        let validity = values.validity.or(before);
        if let Some(validity) = values.validity {
            self.check_validity(time_ns, validity, &values.slopes_mdeg);
        }
        let mut mdeg = values.slopes_mdeg;
        for (axis, mdeg) in mdeg.iter_mut().enumerate() {
            *mdeg = mdeg.filter(|_| validity.is_none_or(|bits| bits & (1 << axis) != 0));
        }
        self.sent_mdeg = mdeg;
        if self.unit.is_another() {
            if mdeg.iter().any(Option::is_some) {
                self.checks.add(Check::Unit, time_ns);
            }
            mdeg = [None; 2];
        }
        for (mdeg, [low, high]) in mdeg.iter().zip(&self.plan.range_mdeg) {
            if mdeg.is_some_and(|mdeg| mdeg < *low || mdeg > *high) {
                self.checks.add(Check::Range, time_ns);
            }
        }
        self.slopes = Some(Slopes {
            time_ns,
            mdeg,
            validity,
            state: self.state_at(time_ns),
        });
    }

    /// The state that came with slopes of this time, or with another PDO shortly before.
    fn state_at(&self, time_ns: u64) -> Option<u8> {
        let (state_ns, state) = self.state?;
        (time_ns.abs_diff(state_ns) <= STATE_NS).then_some(state)
    }

    /// True while it has slopes that are not used, since they are in another unit (6000h) than they
    /// are taken in.
    pub fn has_another_unit(&self) -> bool {
        self.unit.is_another() && self.sent_mdeg.iter().any(Option::is_some)
    }

    /// Both slopes and measured angles of a SYNC have come.
    #[inline]
    pub(super) fn judge_unit(&mut self, time_ns: u64, measured: &Measured) {
        let was_another = self.unit.is_another();
        self.unit.judge(&self.sent_mdeg, measured);
        // The first ones that are found to be wrong are not shown either.
        if let (false, true, Some(slopes)) = (was_another, self.unit.is_another(), &mut self.slopes)
        {
            slopes.mdeg = [None; 2];
            self.now.mdeg = [None; 2];
            self.checks.add(Check::Unit, time_ns);
        }
    }

    /// Bits 0 and 1 of 2020h against the numbers (docs/canopen.md, "Reading an angle"). A valid
    /// slope that 16 bit cannot hold reads as none, and is then told as outside its range.
    fn check_validity(&mut self, time_ns: u64, validity: u8, sent_mdeg: &[Option<i32>; 2]) {
        for (axis, mdeg) in sent_mdeg.iter().enumerate() {
            let is_valid = validity & (1 << axis) != 0;
            let out_of_range = self.faults & (1 << axis) != 0;
            if is_valid != mdeg.is_some() && !(is_valid && out_of_range) {
                self.checks.add(Check::Validity, time_ns);
            }
        }
    }

    fn take_exchange(&mut self, time_ns: u64, part: Part, values: &Values) {
        let mut told = self.told.map_or(Exchange::NOTHING, |told| told.exchange);
        if part.has_angles() {
            (told.angle, told.quality) = (values.exchange.angle, values.exchange.quality);
            let is_reserved = |quality: &u8| {
                let is_reason = (1..32).contains(quality);
                is_reason && exchange::reason(*quality).is_none()
            };
            if told.quality.iter().any(is_reserved) {
                self.checks.add(Check::Reserved, time_ns);
            }
        }
        if part.has_vector() {
            told.vector = values.exchange.vector;
            told.captured = values.exchange.captured;
            told.activity = values.exchange.activity;
        }
        self.told = Some(Told {
            time_ns,
            exchange: told,
        });
    }

    /// Takes an EMCY; `None` when it is none.
    pub(super) fn emergency(&mut self, time_ns: u64, bytes: &[u8]) -> Option<Emergency> {
        let [c0, c1, register, rest @ ..] = bytes else {
            return None;
        };
        let bytes: [u8; 5] = rest.try_into().ok()?;
        let [f0, f1, f2, ..] = bytes;
        let code = u16::from_le_bytes([*c0, *c1]);
        // Those of the bus have other bytes there, and so have those of a program that ended.
        if !matches!(code, 0x8000..=0x8FFF | 0x6101..=0x6105) {
            let set = u32::from_le_bytes([f0, f1, f2, 0]);
            if set & !FAULTS != 0 {
                self.checks.add(Check::Reserved, time_ns);
            }
            // The end of a fault of the bus has none of the instrument's, which may stand.
            let of_the_bus = code == 0 && *register & !0x10 != 0 && bytes == [0; 5];
            if !of_the_bus {
                self.faults = set;
                self.faults_ns = Some(time_ns);
            }
        }
        let emergency = Emergency {
            code,
            register: *register,
            bytes,
        };
        self.emergency = Some((time_ns, emergency));
        Some(emergency)
    }

    /// Takes a heartbeat; `None` when it is none.
    pub(super) fn heartbeat(&mut self, time_ns: u64, bytes: &[u8]) -> Option<Beat> {
        let [state] = bytes else {
            return None;
        };
        let Ok(state) = State::of(*state) else {
            self.checks.add(Check::Reserved, time_ns);
            return None;
        };
        let lost_since_ns = self.heartbeat.take(time_ns, state == State::Initialising);
        if state == State::Initialising {
            self.boots += 1;
            self.unit.restart();
            self.state = None;
            let told_ns = self.faults_ns.filter(|_| self.faults != 0);
            if told_ns.is_none_or(|told_ns| time_ns.abs_diff(told_ns) >= SAME_START_NS) {
                self.faults = 0;
            }
        }
        let before = self.nmt.replace((state, time_ns)).map(|(state, _)| state);
        let is_new = before != Some(state) || state == State::Initialising;
        Some(Beat {
            changed: is_new.then_some(state),
            lost_since_ns,
        })
    }

    /// The log has a hole: what was not seen in it is not lost.
    pub(super) fn excuse(&mut self, time_ns: u64) {
        self.heartbeat.excuse(time_ns);
        self.came_before = 0;
        self.unit.excuse();
    }

    /// The acceleration that it told last, 2^-13 g; `None` where there is none.
    pub fn vector(&self) -> Option<[i16; 3]> {
        let vector = self.told?.exchange.vector;
        (vector != NO_VECTOR).then_some(vector)
    }
}

fn kind_of(pdo: &PdoPlan) -> Kind {
    let has_angles = pdo.has(|what| matches!(what, What::Angle(_) | What::Quality(_)));
    let has_vector = pdo.has(|what| matches!(what, What::Vector(_) | What::Activity));
    let has_detail = pdo.has(|what| {
        matches!(
            what,
            What::Uncertainty | What::Difference(_) | What::Temperature
        )
    });
    match (has_angles, has_vector) {
        _ if pdo.has(|what| matches!(what, What::Slope(_))) => Kind::Slopes,
        (true, true) => Kind::Exchange(Part::Both),
        (true, false) => Kind::Exchange(Part::Angles),
        (false, true) => Kind::Exchange(Part::Vector),
        _ if has_detail => Kind::Detail,
        _ if pdo.has(|what| matches!(what, What::SlopeNow(_))) => Kind::Angle,
        _ if pdo.has(|what| matches!(what, What::Rate(_))) => Kind::Rates,
        _ if pdo.has(|what| what == What::Turned) => Kind::Turned,
        _ => Kind::Other,
    }
}
