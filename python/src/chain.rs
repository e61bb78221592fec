//! The signal chain on arrays: counts in, angle, uncertainty, reason and instant out.
//!
//! In: a calibration and a mode; arrays of counts with the times of their capture, temperatures,
//! rates of a gyroscope, and the instants to read at. Out: the integers that the chip computes from
//! the same samples, by the crate that runs on it. A chain remembers: a recording may come in
//! pieces.
//!
//! Units: angles and uncertainties 2^-32 of a circle, times microseconds, temperatures degC.
//!
//! Left out: judging two channels by each other.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use codes::words;
use device::exchange::{self, reason_code};
use instant::Instant;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use sim::bench::Mode;
use tilt::chain::{self, ChainState, Invalid, Measurement, Timing};
use tilt::sample::{Counts, RateCounts, Sample, Temperature};
use tilt::uncertainty::Uncertainty;

use crate::calibration;
use crate::error::said;
use crate::signals::Watch;

/// Samples or readings between two looks at the clock, which take less than ten milliseconds.
const PIECE: usize = 1000;

/// The mode of this name.
///
/// Errors: there is none.
pub fn mode(name: &str) -> PyResult<Mode> {
    match name {
        "product" => Ok(Mode::Product),
        "paper" => Ok(Mode::Paper),
        "dynamic" => Ok(Mode::Dynamic),
        "one-axis" => Ok(Mode::OneAxis),
        _ => Err(said(format!(
            "there is no mode {name:?}: take product, dynamic, paper or one-axis"
        ))),
    }
}

/// Every reason why there is no angle, in words, by its code.
#[pyfunction]
pub fn reasons() -> BTreeMap<u8, String> {
    let codes = (1..=u8::MAX).filter(|code| exchange::reason(*code).is_some());
    codes
        .filter_map(|code| Some((code, words::reason(code)?.into_owned())))
        .collect()
}

/// One channel's signal chain with its memory.
#[pyclass(frozen)]
pub struct Chain {
    chain: chain::Chain,
    memory: Mutex<Memory>,
}

/// What a chain keeps from one call to the next.
#[derive(Default)]
struct Memory {
    state: ChainState,
    /// The newest sample, us.
    newest_us: Option<u64>,
}

/// What was read at each instant, axis X and axis Y side by side.
#[derive(Default)]
struct Read {
    angles: Vec<i32>,
    uncertainties: Vec<u32>,
    reasons: Vec<u8>,
    at_us: Vec<i64>,
}

/// The instants that were read at; angles, uncertainties, reasons and instants of the angles as
/// arrays of n x 2.
type Arrays<'py> = (
    Bound<'py, PyArray1<u64>>,
    Bound<'py, PyArray2<i32>>,
    Bound<'py, PyArray2<u32>>,
    Bound<'py, PyArray2<u8>>,
    Bound<'py, PyArray2<i64>>,
);

#[pymethods]
impl Chain {
    /// The chain of this mode; `latency_us` for other readings than the mode's, 0 for the newest
    /// sample whatever its age.
    #[new]
    #[pyo3(signature = (given, mode, channel, latency_us))]
    fn new(
        given: Option<calibration::Given>,
        mode: &str,
        channel: usize,
        latency_us: Option<u32>,
    ) -> PyResult<Self> {
        let mut chain = self::mode(mode)?.settings().chain;
        if let Some(given) = given {
            chain.calibration = calibration::of(&given, channel)?;
        }
        match latency_us {
            Some(0) => chain.timing = Timing::AsItArrives,
            Some(latency_us) => chain.timing = Timing::Aligned { latency_us },
            None => {}
        }
        Ok(Self {
            chain,
            memory: Mutex::default(),
        })
    }

    /// Nominal time between samples, us.
    #[getter]
    fn period_us(&self) -> u32 {
        self.chain.period_us
    }

    /// Left-justified counts of one g in the range of this mode's part.
    #[getter]
    fn counts_per_g(&self) -> i32 {
        self.chain.full_scale.counts_per_g()
    }

    /// Deg/s of one count of the gyroscope; `None` in a mode without one.
    #[getter]
    fn deg_s_per_count(&self) -> Option<f64> {
        let fusion = self.chain.fusion.as_ref()?;
        Some(f64::from(fusion.range.micro_dps_per_count()) * 1e-6)
    }

    /// The calibration as a node stores it.
    #[getter]
    fn calibration(&self) -> Vec<u8> {
        calibration::bytes_of(&self.chain.calibration)
    }

    /// Forgets all samples.
    fn reset(&self, py: Python<'_>) {
        py.detach(|| *lock(&self.memory) = Memory::default());
    }

    /// Takes samples in and reads at each of `read_us`, or else at the time of each sample. Without
    /// `times_us` a sample comes one nominal period after the one before it, the first at 0.
    ///
    /// Errors: `plumb.Error` where lengths differ or times fall; nothing was taken in then.
    #[pyo3(signature = (counts, times_us, temperatures, rates, read_us))]
    fn run<'py>(
        &self,
        py: Python<'py>,
        counts: PyReadonlyArray2<'py, i16>,
        times_us: Option<PyReadonlyArray1<'py, u64>>,
        temperatures: Option<PyReadonlyArray1<'py, f64>>,
        rates: Option<PyReadonlyArray2<'py, i16>>,
        read_us: Option<PyReadonlyArray1<'py, u64>>,
    ) -> PyResult<Arrays<'py>> {
        let given = Given {
            counts: triples(counts.as_slice()?),
            times_us: times_us.as_ref().map(|all| all.as_slice()).transpose()?,
            temperatures: temperatures
                .as_ref()
                .map(|all| all.as_slice())
                .transpose()?,
            rates: rates
                .as_ref()
                .map(|all| all.as_slice().map(triples))
                .transpose()?,
            read_us: read_us.as_ref().map(|all| all.as_slice()).transpose()?,
        };
        let (instants, read) = py.detach(|| {
            let mut memory = lock(&self.memory);
            let taken = given.taken(self.chain.period_us, memory.newest_us)?;
            let read = run(&self.chain, &mut memory, &taken)?;
            PyResult::Ok((taken.read_us.into_owned(), read))
        })?;
        arrays(py, instants, read)
    }
}

fn lock(memory: &Mutex<Memory>) -> MutexGuard<'_, Memory> {
    memory.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Samples and instants as they come from numpy.
struct Given<'a> {
    counts: &'a [[i16; 3]],
    times_us: Option<&'a [u64]>,
    /// NaN where none was read.
    temperatures: Option<&'a [f64]>,
    rates: Option<&'a [[i16; 3]]>,
    read_us: Option<&'a [u64]>,
}

/// The same, checked, with the times that were not given.
struct Taken<'a> {
    counts: &'a [[i16; 3]],
    times_us: Cow<'a, [u64]>,
    temperatures: Option<&'a [f64]>,
    rates: Option<&'a [[i16; 3]]>,
    read_us: Cow<'a, [u64]>,
}

fn triples(flat: &[i16]) -> &[[i16; 3]] {
    flat.as_chunks().0
}

impl<'a> Given<'a> {
    /// With the times of samples `period_us` apart where none are given, the first of them behind
    /// `newest_us`.
    ///
    /// Errors: lengths differ, or times fall.
    fn taken(&self, period_us: u32, newest_us: Option<u64>) -> PyResult<Taken<'a>> {
        self.check_lengths()?;
        let times_us = match self.times_us {
            Some(times_us) => Cow::Borrowed(times_us),
            None => Cow::Owned(times(self.counts.len(), period_us, newest_us)?),
        };
        let rises = |before, at| before < at;
        check_order("times_us", &times_us, newest_us, rises)?;
        let read_us = match self.read_us {
            Some(read_us) => Cow::Borrowed(read_us),
            None => times_us.clone(),
        };
        check_order("read_us", &read_us, newest_us, |before, at| before <= at)?;
        Ok(Taken {
            counts: self.counts,
            times_us,
            temperatures: self.temperatures,
            rates: self.rates,
            read_us,
        })
    }

    fn check_lengths(&self) -> PyResult<()> {
        let wanted = self.counts.len();
        let lengths = [
            ("times_us", self.times_us.map(<[u64]>::len)),
            ("temperature_degc", self.temperatures.map(<[f64]>::len)),
            ("rates", self.rates.map(<[[i16; 3]]>::len)),
        ];
        for (name, length) in lengths {
            if let Some(length) = length.filter(|length| *length != wanted) {
                return Err(said(format!(
                    "there are {wanted} samples and {length} of {name}: give one for each sample"
                )));
            }
        }
        Ok(())
    }
}

/// Times of samples that follow each other by the nominal period, us.
fn times(count: usize, period_us: u32, newest_us: Option<u64>) -> PyResult<Vec<u64>> {
    let period_us = u64::from(period_us);
    let mut next_us = newest_us.map_or(Some(0), |newest_us| newest_us.checked_add(period_us));
    let mut times_us = Vec::with_capacity(count);
    for _ in 0..count {
        let at_us = next_us.ok_or_else(|| said("the times of these samples are beyond 2^64 us"))?;
        times_us.push(at_us);
        next_us = at_us.checked_add(period_us);
    }
    Ok(times_us)
}

/// Whether each of these times may follow the one before it, the first of them the newest sample
/// of an earlier call.
fn check_order(
    name: &str,
    times_us: &[u64],
    newest_us: Option<u64>,
    may_follow: impl Fn(u64, u64) -> bool,
) -> PyResult<()> {
    let mut before = newest_us.map(|at_us| (at_us, "the newest sample of an earlier call"));
    for (number, at_us) in times_us.iter().enumerate() {
        if let Some((before_us, what)) = before
            && !may_follow(before_us, *at_us)
        {
            return Err(said(format!(
                "{name}[{number}] is {at_us} us and {what} is at {before_us} us: give times in \
                 their order, or begin anew with reset()"
            )));
        }
        before = Some((*at_us, "the one before it"));
    }
    Ok(())
}

impl Taken<'_> {
    /// Feeds sample `number`.
    fn feed(&self, chain: &chain::Chain, memory: &mut Memory, number: usize) {
        let state = &mut memory.state;
        let temperature = self.temperatures.and_then(|all| all.get(number));
        if let Some(celsius) = temperature.filter(|celsius| celsius.is_finite()) {
            chain.temperature(state, Temperature((celsius * 256.0).round() as i32));
        }
        let (Some(counts), Some(at)) = (self.counts.get(number), self.times_us.get(number)) else {
            return;
        };
        let rate = self.rates.and_then(|all| all.get(number));
        let sample = Sample {
            counts: Counts(*counts),
            rate: rate.map(|rate| RateCounts(*rate)),
        };
        chain.sample(state, sample, Instant(*at));
        memory.newest_us = Some(*at);
    }
}

/// Feeds each sample when its time has come, reads at each instant, and feeds the rest.
///
/// Errors: the exception of a signal's handler. The samples up to then were taken in.
fn run(chain: &chain::Chain, memory: &mut Memory, taken: &Taken<'_>) -> PyResult<Read> {
    let mut feeder = Feeder {
        chain,
        taken,
        next: 0,
        watch: Watch::new(),
    };
    let mut read = Read::default();
    for (number, instant) in taken.read_us.iter().enumerate() {
        if number.is_multiple_of(PIECE) {
            feeder.watch.look()?;
        }
        feeder.feed_until(memory, Instant(*instant))?;
        let reading = chain.reading(&memory.state, Instant(*instant));
        read.add(reading.x);
        read.add(reading.y);
    }
    feeder.feed_until(memory, Instant(u64::MAX))?;
    Ok(read)
}

/// Samples that are fed one after the other.
struct Feeder<'a> {
    chain: &'a chain::Chain,
    taken: &'a Taken<'a>,
    /// The next of them.
    next: usize,
    watch: Watch,
}

impl Feeder<'_> {
    /// Feeds the samples up to this instant.
    fn feed_until(&mut self, memory: &mut Memory, instant: Instant) -> PyResult<()> {
        let times_us = &self.taken.times_us;
        while times_us.get(self.next).is_some_and(|at| *at <= instant.0) {
            if self.next.is_multiple_of(PIECE) {
                self.watch.look()?;
            }
            self.taken.feed(self.chain, memory, self.next);
            self.next += 1;
        }
        Ok(())
    }
}

impl Read {
    fn add(&mut self, axis: Result<Measurement, Invalid>) {
        let measured = axis.as_ref().ok();
        self.angles.push(measured.map_or(0, |found| found.angle.0));
        let unknown = Uncertainty::UNKNOWN;
        let uncertainty = measured.map_or(unknown, |found| found.uncertainty);
        self.uncertainties.push(uncertainty.0);
        self.reasons.push(axis.err().map_or(0, reason_code));
        let at_us = measured.and_then(|found| i64::try_from(found.at.0).ok());
        self.at_us.push(at_us.unwrap_or(-1));
    }
}

fn arrays(py: Python<'_>, instants: Vec<u64>, read: Read) -> PyResult<Arrays<'_>> {
    let rows = read.angles.len() / 2;
    let shape = [rows, 2];
    Ok((
        PyArray1::from_vec(py, instants),
        PyArray1::from_vec(py, read.angles).reshape(shape)?,
        PyArray1::from_vec(py, read.uncertainties).reshape(shape)?,
        PyArray1::from_vec(py, read.reasons).reshape(shape)?,
        PyArray1::from_vec(py, read.at_us).reshape(shape)?,
    ))
}
