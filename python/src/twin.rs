//! The virtual instrument in a Python test.
//!
//! In: the words of the command line that set what is built, words of `plumb serve`, frames of
//! clients, and times in ns. Out: frames with their times. It may be used from several threads, one
//! call after the other.
//!
//! Left out: frames as python-can has them (`python/plumb/bus.py`).

use std::error::Error as _;
use std::process;
use std::sync::mpsc::{self, Sender};
use std::sync::{Mutex, PoisonError};
use std::thread;

use canopen::Frame;
use canopen::frame::{ExtendedId, Id, StandardId};
use clap::Parser;
use clap::error::{ContextKind, ContextValue};
use pyo3::prelude::*;
use virtual_bus::{Arguments, Heard, Said, Twin, WordError};

use crate::error::said;

/// What is built, as on the command line of `plumb serve`.
#[derive(Parser)]
#[command(name = "plumb serve")]
struct Line {
    #[command(flatten)]
    arguments: Arguments,
}

/// A frame: time in ns, identifier, whether it has 29 bits, whether it is a remote frame, its
/// length code, its data, and the client that sent it or none.
type Told = (u64, u32, bool, bool, usize, Vec<u8>, Option<u32>);

/// The same of a frame that is to be sent: identifier to data.
type Sent = (u32, bool, bool, usize, Vec<u8>);

/// Something to do with the instrument.
type Job = Box<dyn FnOnce(&mut Twin) + Send>;

/// Virtual time between two looks for a signal, ns: some milliseconds of the machine.
const PIECE_NS: u64 = 1_000_000_000;

/// The virtual instrument; time stands still between two calls.
///
/// It lives on a thread of its own, since parts of it belong to the thread that has made them, and
/// ends with this object. A fork has no such thread.
#[pyclass(frozen)]
pub struct World {
    jobs: Mutex<Sender<Job>>,
    /// The process whose thread it is.
    process: u32,
}

#[pymethods]
impl World {
    /// Builds and calibrates it, and gives it power at time 0.
    #[new]
    fn new(py: Python<'_>, words: Vec<String>) -> PyResult<Self> {
        let all = ["plumb serve".to_owned()].into_iter().chain(words);
        let line = Line::try_parse_from(all).map_err(|error| said(sentence(&error)))?;
        let started = py.detach(|| start(line.arguments));
        Ok(Self {
            jobs: Mutex::new(started.map_err(said)?),
            process: process::id(),
        })
    }

    /// Virtual time, ns.
    #[getter]
    fn now_ns(&self, py: Python<'_>) -> PyResult<u64> {
        self.ask(py, |twin| twin.now_ns())
    }

    /// X and slope Y of the housing, deg; air and die, degC.
    fn truth(&self, py: Python<'_>) -> PyResult<([f64; 2], [f64; 2])> {
        self.ask(py, |twin| twin.truth())
    }

    /// Carries a word out; what it has to tell. Of a `wait`, a signal is handled after each piece.
    fn say(&self, py: Python<'_>, line: String) -> PyResult<String> {
        let answer = self.ask(py, move |twin| {
            twin.say(&line).map_err(|why| why.to_string())
        });
        let wait = match answer?.map_err(said)? {
            Said::Told(text) => return Ok(text),
            Said::Wait(wait) => wait,
        };
        self.in_pieces(py, move |twin| twin.go_on(wait, PIECE_NS))?;
        Ok(String::new())
    }

    /// Takes a client's frame; false when too many of them wait already.
    fn send(&self, py: Python<'_>, client: u32, sent: Sent) -> PyResult<bool> {
        let frame = frame(&sent).ok_or_else(|| {
            said("this is no CAN frame: take an identifier of 11 or 29 bits and up to 8 bytes")
        })?;
        self.ask(py, move |twin| {
            let has_room = twin.has_room(client);
            if has_room {
                twin.send(client, frame);
            }
            has_room
        })
    }

    /// Goes on to this time, ns; a signal is handled after each piece of it.
    fn run_until(&self, py: Python<'_>, until_ns: u64) -> PyResult<()> {
        self.in_pieces(py, move |twin| {
            let piece_ns = until_ns.min(twin.now_ns().saturating_add(PIECE_NS));
            twin.run_until(piece_ns).map(|()| piece_ns == until_ns)
        })
    }

    /// What was on the bus since the last call.
    fn take_heard(&self, py: Python<'_>) -> PyResult<Vec<Told>> {
        self.ask(py, |twin| twin.take_heard().into_iter().map(told).collect())
    }
}

impl World {
    /// Does a piece of something after the other until one of them was the last.
    fn in_pieces(
        &self,
        py: Python<'_>,
        piece: impl Fn(&mut Twin) -> Result<bool, WordError> + Copy + Send + 'static,
    ) -> PyResult<()> {
        loop {
            let done = self.ask(py, move |twin| piece(twin).map_err(|why| why.to_string()));
            if done?.map_err(said)? {
                return Ok(());
            }
            py.check_signals()?;
        }
    }

    /// Does something with the instrument, and waits for what comes of it.
    fn ask<T: Send + 'static>(
        &self,
        py: Python<'_>,
        job: impl FnOnce(&mut Twin) -> T + Send + 'static,
    ) -> PyResult<T> {
        if self.process != process::id() {
            return Err(said(
                "a fork of the process that has made the twin can't use it: make one in each",
            ));
        }
        let (answer, answered) = mpsc::channel();
        let jobs = &self.jobs;
        let job: Job = Box::new(move |twin| drop(answer.send(job(twin))));
        let asked = py.detach(move || {
            let jobs = jobs.lock().unwrap_or_else(PoisonError::into_inner);
            jobs.send(job).ok()?;
            drop(jobs);
            answered.recv().ok()
        });
        asked.ok_or_else(|| said("the virtual instrument has ended by a defect: please report it"))
    }
}

/// Builds the instrument on a thread of its own; where its jobs go.
///
/// Errors: one sentence.
fn start(arguments: Arguments) -> Result<Sender<Job>, String> {
    let (jobs, taken) = mpsc::channel::<Job>();
    let (built, told) = mpsc::channel();
    let run = move || {
        let mut twin = match Twin::new(&arguments) {
            Ok(twin) => twin,
            Err(why) => return drop(built.send(Err(why.to_string()))),
        };
        drop(built.send(Ok(())));
        taken.into_iter().for_each(|job| job(&mut twin));
    };
    let thread = thread::Builder::new().name("plumb".to_owned()).spawn(run);
    thread.map_err(|why| format!("cannot start a thread: {why}"))?;
    told.recv().map_err(|why| why.to_string())??;
    Ok(jobs)
}

/// What is wrong with an argument: its name in Python, its value, and what is allowed.
fn sentence(error: &clap::Error) -> String {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.as_str()),
        _ => None,
    };
    let (Some(option), Some(value)) = (
        text(ContextKind::InvalidArg),
        text(ContextKind::InvalidValue),
    ) else {
        let all = error.to_string();
        let first = all.lines().next().unwrap_or_default();
        return first.strip_prefix("error: ").unwrap_or(first).to_owned();
    };
    let name = option.split(' ').next().unwrap_or_default();
    let name = name.trim_start_matches('-').replace('-', "_");
    format!("{name} is {value}: {}", allowed(error))
}

/// What an argument may be.
fn allowed(error: &clap::Error) -> String {
    if let Some(ContextValue::Strings(values)) = error.get(ContextKind::ValidValue)
        && let Some((last, others)) = values.split_last()
    {
        return format!("take {} or {last}", others.join(", "));
    }
    let why = error.source().map(ToString::to_string).unwrap_or_default();
    // Clap's sentence on a number: "99 is not in 1..=20".
    let range = why.rsplit_once(" is not in ").map(|(_, range)| range);
    match range.and_then(|range| range.split_once("..=")) {
        Some((least, most)) => format!("give {least} to {most}"),
        None => why,
    }
}

/// The frame; `None` where an identifier or a length is none.
fn frame((id, is_extended, is_remote, length, data): &Sent) -> Option<Frame> {
    let id = match is_extended {
        true => Id::Extended(ExtendedId::new(*id)?),
        false => Id::Standard(StandardId::new(u16::try_from(*id).ok()?)?),
    };
    match is_remote {
        true => Frame::remote(id, *length),
        false => Frame::with(id, data),
    }
}

fn told(heard: Heard) -> Told {
    let frame = &heard.frame;
    let (id, is_extended) = match frame.id() {
        Id::Standard(id) => (u32::from(id.as_raw()), false),
        Id::Extended(id) => (id.as_raw(), true),
    };
    let (remote, length) = (frame.is_remote(), frame.length());
    (
        heard.at_ns,
        id,
        is_extended,
        remote,
        length,
        frame.bytes().to_vec(),
        heard.from,
    )
}
