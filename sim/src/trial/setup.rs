//! Everything that a trial depends on.
//!
//! In: nothing. Out: [`Setup`], which prints as lines that a person can read.

use std::fmt;

use canopen::object::{Address, Value, at};
use device::factory::{DYNAMIC_LATENCY_US, PRODUCT_LATENCY_US};
use device::objects::safety::VALID;
use device::records::{Record, RecordStore, parameters};

use crate::bench::Mode;
use crate::can_bus::Rates;
use crate::excavator::ExcavatorSetup;
use crate::memory::{self, Memory};
use crate::trial::checks::{LIMIT_DEG, Limits};
use crate::trial::inject::{Injection, What};
use crate::trial::maintenance::Maintenance;
use crate::trial::sabotage::Sabotage;

/// Paper mode takes up to 10 min 45 s (erratum E16), s.
const PAPER_REACTION_S: f64 = 645.0;
/// Paper mode: the last of the states that its rule gives to two channels that measure.
const PAPER_ORDER_UP_TO: u8 = 5;

/// How soon the variant with a gyroscope is in order, s: in a machine that moves, its vertical has
/// to become more certain than 2007h demands.
const DYNAMIC_RECOVERY_S: f64 = 12.0;

/// 2007h as delivered where there is a gyroscope, deg.
const MOST_UNCERTAIN_DEG: f64 = 2.0;

/// A trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// Seed of everything drawn during the trial.
    pub seed: u64,
    /// Which instrument.
    pub mode: Mode,
    /// Which unit of it.
    pub unit: u32,
    /// How often it was switched on before: other turn-on offsets, other noise.
    pub power_cycles: u32,
    /// The machine it is mounted on.
    pub machine: ExcavatorSetup,
    /// Bit rate, kbit/s.
    pub kbit_s: u16,
    /// SYNC period by the host's clock, us.
    pub sync_us: u32,
    /// Error of the host's clock, ppm.
    pub host_clock_ppm: f64,
    /// Temperature of both dies at the start, degC.
    pub start_c: f64,
    /// Its change, K/min.
    pub ramp_c_per_min: f64,
    /// After how long a finding ends, s; 0: not until a reset (2004h).
    pub latch_s: u16,
    /// Whether a channel goes on while the other one is faulty (2005h).
    pub degraded: bool,
    /// Whether safety frames have been commissioned.
    pub safety_frames: bool,
    /// How often frames go wrong.
    pub rates: Rates,
    /// What goes wrong, in the order of time.
    pub faults: Vec<Injection>,
    /// What is done to one node alone, or to SYNC, meanwhile.
    pub maintenance: Vec<Maintenance>,
    /// The trial lasts at least so long, s.
    pub safety_s: f64,
    /// Whether everything stays within what is promised.
    pub within_promise: bool,
    /// What is broken on purpose.
    pub sabotage: Sabotage,
}

impl Setup {
    /// A healthy product on a machine that digs, for 10 s.
    pub fn healthy(seed: u64) -> Self {
        Self {
            seed,
            mode: Mode::Product,
            unit: 0,
            power_cycles: 0,
            machine: ExcavatorSetup::NOMINAL,
            kbit_s: 250,
            sync_us: 20_000,
            host_clock_ppm: 0.0,
            start_c: 25.0,
            ramp_c_per_min: 0.0,
            latch_s: 0,
            degraded: true,
            safety_frames: false,
            rates: Rates::default(),
            faults: Vec::new(),
            maintenance: Vec::new(),
            safety_s: 10.0,
            within_promise: true,
            sabotage: Sabotage::None,
        }
    }

    /// Temperature of the dies at a time, degC.
    pub fn temperature_c(&self, time_s: f64) -> f64 {
        self.start_c + self.ramp_c_per_min * time_s / 60.0
    }

    /// SYNC period by the world's clock, ns.
    pub fn period_ns(&self) -> u64 {
        let period_ns = f64::from(self.sync_us) * 1e3 * (1.0 + self.host_clock_ppm * 1e-6);
        period_ns.round() as u64
    }

    /// What both nodes find in their memory: the parameters that differ from the delivered ones.
    pub fn memory(&self) -> Memory {
        let mut memory = memory::blank();
        let policy = [
            (at(0x2004, 0), Value::u16(self.latch_s)),
            (at(0x2005, 0), Value::u8(self.degraded.into())),
        ];
        store(&mut memory, Record::Manufacturer, &policy);
        if self.safety_frames {
            // The signatures of what was delivered are there already.
            let protocol = [(at(0x13FE, 0), Value::u8(VALID))];
            store(&mut memory, Record::Communication, &protocol);
            let application = [(at(0x63FE, 0), Value::u8(VALID))];
            store(&mut memory, Record::Profile, &application);
        }
        memory
    }

    /// An angle belongs to the instant so long before its SYNC, s.
    pub fn latency_s(&self) -> f64 {
        let us = match self.mode {
            Mode::Dynamic => DYNAMIC_LATENCY_US,
            _ => PRODUCT_LATENCY_US,
        };
        f64::from(us) * 1e-6
    }

    /// What the instrument is held to.
    pub fn limits(&self) -> Limits {
        let paper = self.mode == Mode::Paper;
        let faultless = self.rates == Rates::default();
        let sound = |injection: &Injection| injection.what.leaves_bus_sound();
        Limits {
            reaction_s: if paper {
                PAPER_REACTION_S
            } else {
                Limits::PRODUCT.reaction_s
            },
            angles_only: !self.within_promise,
            maintained: !self.maintenance.is_empty(),
            sound_bus: faultless && self.faults.iter().all(sound),
            safety: self.safety_frames,
            recovery_s: match self.mode {
                Mode::Dynamic => DYNAMIC_RECOVERY_S,
                _ => Limits::PRODUCT.recovery_s,
            },
            order_up_to: if paper { PAPER_ORDER_UP_TO } else { 1 },
            // The paper's angle has no instant of its own, so no truth to be held to in motion.
            order_deg: if paper { f64::INFINITY } else { LIMIT_DEG },
            // What a gyroscope predicts is known as well as it states, worst after a start.
            uncertainty_deg: (self.mode == Mode::Dynamic).then_some(MOST_UNCERTAIN_DEG),
            latency_s: self.latency_s(),
        }
    }

    /// Whether one of the faults is of this kind.
    pub fn has(&self, kind: impl Fn(&What) -> bool) -> bool {
        self.faults.iter().any(|injection| kind(&injection.what))
    }
}

fn store(memory: &mut Memory, record: Record, told: &[(Address, Value)]) {
    let stored = RecordStore::begin(memory, record, record.longest()).and_then(|()| {
        for (address, value) in told {
            parameters::put(memory, *address, value)?;
        }
        RecordStore::commit(memory)
    });
    stored.expect("an empty memory holds two numbers");
}

impl fmt::Display for Setup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rates = &self.rates;
        writeln!(f, "seed           {}", self.seed)?;
        writeln!(
            f,
            "instrument     {:?}, unit {}, switched on {} times before",
            self.mode, self.unit, self.power_cycles
        )?;
        writeln!(f, "machine        {}", self.machine)?;
        writeln!(
            f,
            "bus            {} kbit/s, SYNC every {:.3} ms, host's clock {:+.1} ppm",
            self.kbit_s,
            f64::from(self.sync_us) * 1e-3,
            self.host_clock_ppm
        )?;
        writeln!(
            f,
            "frames         corrupt {:.4}, local {:.4}, last but one bit {:.4}, overrun {:.4}",
            rates.corrupt, rates.local, rates.last_but_one, rates.overrun
        )?;
        writeln!(
            f,
            "temperature    {:.1} degC, {:+.2} K/min",
            self.start_c, self.ramp_c_per_min
        )?;
        let latch = match self.latch_s {
            0 => "until a reset".into(),
            seconds => format!("until {seconds} s after its end"),
        };
        let alone = if self.degraded {
            "goes on"
        } else {
            "stops too"
        };
        let safety = if self.safety_frames { "sent" } else { "off" };
        writeln!(
            f,
            "policy         a finding stays {latch}, the healthy channel {alone}, safety frames \
             {safety}"
        )?;
        let promise = match (self.mode, self.within_promise) {
            (Mode::Paper, _) => "in paper mode, of which nothing is promised",
            (_, true) => "within the promise",
            (_, false) => "beyond the promise: only a wrong angle marked valid counts",
        };
        writeln!(f, "faults         {}, {promise}", self.faults.len())?;
        for injection in &self.faults {
            writeln!(f, "               {injection}")?;
        }
        for maintenance in &self.maintenance {
            writeln!(f, "maintenance    {maintenance}")?;
        }
        if self.sabotage != Sabotage::None {
            writeln!(f, "sabotage       {:?}", self.sabotage)?;
        }
        Ok(())
    }
}
