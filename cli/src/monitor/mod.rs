//! `plumb monitor`: what happens on a bus, or has happened in a log, as it is seen.
//!
//! In: frames of a bus (`crate::bus`) or of logs (`crate::log`). Out: the same knowledge in three
//! views, a terminal, a web page and plain lines, and a recording of everything that came.
//! `feed` is where frames come from, `reading` the thread that takes them, `model` what is known,
//! `moment` that at one instant (`snapshot`).
//!
//! Left out: what the frames mean (`watch`), and judgement, which is the nodes'.

mod clock;
mod error;
mod events;
mod feed;
mod load;
mod model;
mod moment;
mod options;
mod pace;
mod plain;
mod reading;
mod record;
mod snapshot;
mod trace;
mod words;
mod writer;

#[cfg(test)]
mod model_tests;

use std::io::{self, Write as _};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

pub use error::MonitorError;
pub use options::Arguments;

use feed::BusFeed;
use model::{Model, Setup};
use plain::EventObject;
use reading::{Ending, Line, Outcome, Reader, Shared, Tasks};
use record::Recorder;

/// Lines that may wait for a slow reader of the standard output.
const LINES_WAITING: usize = 4096;

/// How often it is looked whether the time is over.
const GLANCE: Duration = Duration::from_millis(50);

/// Shows what happens until the user, the source or the time says stop.
///
/// Errors: see [`MonitorError`].
pub fn run(arguments: &Arguments) -> Result<ExitCode, MonitorError> {
    let address = arguments.bus.address().map_err(MonitorError::Join)?;
    if let Some(path) = arguments.record.as_ref().filter(|_| !arguments.force)
        && path.exists()
    {
        return Err(MonitorError::Exists(path.clone()));
    }
    let feed = BusFeed::join(&arguments.bus).map_err(MonitorError::Join)?;
    let setup = Setup {
        name: feed.name().to_owned(),
        bit_rate: address.kbit_s.map(|kbit_s| kbit_s * 1000),
    };
    let mut model = Model::new(&arguments.plan(), setup);
    let recorder = arguments.record.as_ref().map(|path| {
        Recorder::create(path, arguments.force).map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => MonitorError::Exists(path.clone()),
            _ => MonitorError::Record(path.clone(), error),
        })
    });
    let recorder = recorder.transpose()?;
    model.recording.name = recorder.as_ref().map(|r| r.path().display().to_string());
    let shared = Arc::new(Shared::new(model));
    let (sender, lines) = sync_channel(LINES_WAITING);
    let tasks = Tasks {
        recorder,
        lines: Some(sender),
        may_lose_lines: true,
        reconnect: arguments.reconnect,
        start: arguments.to_start(),
        sync: arguments.sync,
    };
    let reader = spawn(Reader::new(feed, Arc::clone(&shared), tasks));
    let printed = print_lines(arguments, &shared, &lines);
    drop(lines);
    shared.stop();
    end(arguments, reader, printed)
}

fn spawn(reader: Reader<BusFeed>) -> JoinHandle<Outcome> {
    thread::spawn(move || reader.run())
}

fn end(
    arguments: &Arguments,
    reader: JoinHandle<Outcome>,
    printed: io::Result<()>,
) -> Result<ExitCode, MonitorError> {
    let outcome = reader.join().map_err(|_| MonitorError::Reader)?;
    printed.map_err(MonitorError::Print)?;
    if let (Err(error), Some(path)) = (outcome.recording, &arguments.record) {
        return Err(MonitorError::Record(path.clone(), error));
    }
    match outcome.ending {
        Ending::Stopped => Ok(ExitCode::SUCCESS),
        Ending::Lost(error) => Err(MonitorError::Lost(error)),
    }
}

/// Prints what the reader tells, until it has ended, the time is over or nobody reads any more.
fn print_lines(arguments: &Arguments, shared: &Shared, lines: &Receiver<Line>) -> io::Result<()> {
    let until = arguments.duration.map(|time| Instant::now() + time);
    loop {
        if until.is_some_and(|until| Instant::now() >= until) {
            shared.stop();
            return Ok(());
        }
        let line = match lines.recv_timeout(GLANCE) {
            Ok(line) => line,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        };
        match print(&text(arguments.json, &line)?) {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(()),
            other => other?,
        }
    }
}

fn text(json: bool, line: &Line) -> io::Result<String> {
    Ok(match (json, line) {
        (true, Line::State(snapshot)) => serde_json::to_string(snapshot)? + "\n",
        (true, Line::Event(event)) => serde_json::to_string(&EventObject::new(event))? + "\n",
        (false, Line::State(snapshot)) => plain::state(snapshot),
        (false, Line::Event(event)) => plain::event(event) + "\n",
    })
}

/// Unlike `stdout::print`, tells when nobody reads any more: this goes on for ever otherwise.
fn print(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()
}
