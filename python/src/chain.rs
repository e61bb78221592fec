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

use std::collections::BTreeMap;

use codes::words;
use device::exchange::{self, reason_code};
use instant::Instant;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use sim::bench::Mode;
use tilt::chain::{self, ChainState, Invalid, Measurement, Timing};
use tilt::sample::{Counts, RateCounts, Sample, Temperature};
use tilt::uncertainty::Uncertainty;

use crate::calibration::{self, Given};
use crate::error::said;

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
#[pyclass]
pub struct Chain {
    chain: chain::Chain,
    state: ChainState,
}

/// What was read at each instant, axis X and axis Y side by side.
#[derive(Default)]
struct Read {
    angles: Vec<i32>,
    uncertainties: Vec<u32>,
    reasons: Vec<u8>,
    at_us: Vec<i64>,
}

/// Angles, uncertainties, reasons and instants as arrays of n x 2.
type Arrays<'py> = (
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
        given: Option<Given>,
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
            state: ChainState::default(),
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
    fn reset(&mut self) {
        self.state = ChainState::default();
    }

    /// Takes samples in and reads at each of `read_us`, which rise.
    #[pyo3(signature = (counts, times_us, temperatures, rates, read_us))]
    fn run<'py>(
        &mut self,
        py: Python<'py>,
        counts: PyReadonlyArray2<'py, i16>,
        times_us: PyReadonlyArray1<'py, u64>,
        temperatures: Option<PyReadonlyArray1<'py, f64>>,
        rates: Option<PyReadonlyArray2<'py, i16>>,
        read_us: PyReadonlyArray1<'py, u64>,
    ) -> PyResult<Arrays<'py>> {
        let taken = Taken {
            counts: triples(counts.as_slice()?),
            times_us: times_us.as_slice()?,
            temperatures: temperatures
                .as_ref()
                .map(|all| all.as_slice())
                .transpose()?,
            rates: rates
                .as_ref()
                .map(|all| all.as_slice().map(triples))
                .transpose()?,
        };
        taken.check()?;
        let instants = read_us.as_slice()?;
        let Self { chain, state } = self;
        let read = py.detach(|| run(chain, state, &taken, instants));
        arrays(py, read)
    }
}

/// Samples as they come from numpy.
struct Taken<'a> {
    counts: &'a [[i16; 3]],
    times_us: &'a [u64],
    /// NaN where none was read.
    temperatures: Option<&'a [f64]>,
    rates: Option<&'a [[i16; 3]]>,
}

fn triples(flat: &[i16]) -> &[[i16; 3]] {
    flat.as_chunks().0
}

impl Taken<'_> {
    fn check(&self) -> PyResult<()> {
        let wanted = self.counts.len();
        let lengths = [
            ("times_us", Some(self.times_us.len())),
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

    /// Feeds sample `number`.
    fn feed(&self, chain: &chain::Chain, state: &mut ChainState, number: usize) {
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
    }
}

/// Feeds each sample when its time has come, reads at each instant, and feeds the rest.
fn run(chain: &chain::Chain, state: &mut ChainState, taken: &Taken<'_>, instants: &[u64]) -> Read {
    let mut read = Read::default();
    let mut next = 0;
    for instant in instants {
        while taken.times_us.get(next).is_some_and(|at| at <= instant) {
            taken.feed(chain, state, next);
            next += 1;
        }
        let reading = chain.reading(state, Instant(*instant));
        read.add(reading.x);
        read.add(reading.y);
    }
    (next..taken.times_us.len()).for_each(|number| taken.feed(chain, state, number));
    read
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

fn arrays(py: Python<'_>, read: Read) -> PyResult<Arrays<'_>> {
    let rows = read.angles.len() / 2;
    let shape = [rows, 2];
    Ok((
        PyArray1::from_vec(py, read.angles).reshape(shape)?,
        PyArray1::from_vec(py, read.uncertainties).reshape(shape)?,
        PyArray1::from_vec(py, read.reasons).reshape(shape)?,
        PyArray1::from_vec(py, read.at_us).reshape(shape)?,
    ))
}
