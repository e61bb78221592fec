//! `plumb monitor`: what happens on a bus, or has happened in a log, as it is seen.
//!
//! In: frames of a bus (`bus_master`) or of logs (`bus_logs`). Out: the same knowledge in three
//! views, a terminal, a web page and plain lines, and a recording of everything that came.
//! `feed` is where frames come from, `reading` the thread that takes them, `model` what is known,
//! `moment` that at one instant (`snapshot`).
//!
//! Left out: what the frames mean (`watch`), and judgement, which is the nodes'.

mod clock;
mod error;
mod events;
mod feed;
mod level;
mod load;
mod log_feed;
mod model;
mod moment;
mod options;
mod own;
mod pace;
mod plain;
mod reading;
mod record;
mod snapshot;
mod terminal;
mod trace;
mod web;

#[cfg(test)]
mod model_tests;

use std::collections::BTreeMap;
use std::io::{self, IsTerminal as _, Write as _};
use std::net::TcpListener;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

pub use error::MonitorError;
pub use options::Arguments;

use feed::{BusFeed, Feed};
use log_feed::{LogFeed, LogOptions};
use model::{Model, Setup};
use plain::Record;
use reading::{Ending, Line, Outcome, Reader, Shared, Tasks};
use record::Recorder;
use web::Server;

use bus_logs::PaceOptions;
use listen::{Plan, Unnamed};

/// Lines that may wait for a slow reader of the standard output.
const LINES_WAITING: usize = 4096;

/// How long browsers have for the last message of a bus that is lost: two of them.
const LAST_WORDS: Duration = Duration::from_millis(600);

/// How often it is looked whether the time is over.
const GLANCE: Duration = Duration::from_millis(50);

/// Shows what happens until the user, the source or the time ends it.
///
/// Errors: see [`MonitorError`].
pub fn run(arguments: &Arguments) -> Result<ExitCode, MonitorError> {
    let address = arguments.bus.address().map_err(MonitorError::Join)?;
    let (plan, _) = arguments.plan.plan(Unnamed::One)?;
    let bit_rate = address.kbit_s.map(|kbit_s| kbit_s * 1000);
    // Before anything else is begun, as a recording that would stay empty.
    let page = arguments.web.map(|address| {
        TcpListener::bind(address).map_err(|error| MonitorError::Web(address, error))
    });
    let page = page.transpose()?;
    let is_part = arguments.part.from.or(arguments.part.to).is_some();
    if arguments.log.is_empty() && is_part {
        return Err(MonitorError::PartOfBus);
    }
    if arguments.log.is_empty() {
        watch_bus(arguments, &plan, bit_rate, page)
    } else {
        watch_log(arguments, &plan, bit_rate, page)
    }
}

fn watch_bus(
    arguments: &Arguments,
    plan: &Plan,
    bit_rate: Option<u32>,
    page: Option<TcpListener>,
) -> Result<ExitCode, MonitorError> {
    // Before the bus is joined; the file is made after it, so that none is left empty.
    if let Some(path) = &arguments.record {
        record::may_be(path, arguments.force)?;
    }
    let feed = BusFeed::join(&arguments.bus).map_err(MonitorError::Join)?;
    let name = feed.name().to_owned();
    let mut model = Model::new(plan, Setup { name, bit_rate });
    let recorder = arguments.record.as_ref().map(|path| {
        Recorder::create(path, arguments.force).map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => MonitorError::Exists(path.clone()),
            _ => MonitorError::Create(path.clone(), error),
        })
    });
    let recorder = recorder.transpose()?;
    model.recording.name = recorder.as_ref().map(|r| r.path().display().to_string());
    let tasks = Tasks {
        recorder,
        may_lose_lines: true,
        reconnect: arguments.reconnect,
        start: arguments.to_start(plan),
        sync: arguments.sync,
        ..Tasks::default()
    };
    show(arguments, Arc::new(Shared::new(model)), feed, tasks, page)
}

fn watch_log(
    arguments: &Arguments,
    plan: &Plan,
    bit_rate: Option<u32>,
    page: Option<TcpListener>,
) -> Result<ExitCode, MonitorError> {
    let options = LogOptions {
        paths: arguments.log.clone(),
        pace: PaceOptions {
            speed: arguments.speed,
            longest_gap: arguments.skip_gaps,
        },
        part: arguments.part,
        interface: arguments.bus.channel.clone(),
    };
    let name = log_feed::name(&options.paths);
    let model = Model::new(plan, Setup { name, bit_rate });
    let shared = Arc::new(Shared::new(model));
    let feed = LogFeed::open(&options, Arc::clone(&shared)).map_err(MonitorError::Log)?;
    let stopped = Arc::clone(&shared);
    // Without it a signal ends the program at once, which leaves the terminal as it is.
    let _ = ctrlc::set_handler(move || stopped.stop());
    show(arguments, shared, feed, Tasks::default(), page)
}

/// Runs the reader in its own thread and a view in this one.
fn show(
    arguments: &Arguments,
    shared: Arc<Shared>,
    feed: impl Feed + Send + 'static,
    mut tasks: Tasks,
    page: Option<TcpListener>,
) -> Result<ExitCode, MonitorError> {
    let is_terminal = !arguments.plain && !arguments.json && io::stdout().is_terminal();
    let (sender, lines) = sync_channel(LINES_WAITING);
    tasks.lines = (!is_terminal).then_some(sender);
    let reader = Reader::new(feed, Arc::clone(&shared), tasks);
    let server = page.map(|listener| Server::start(listener, Arc::clone(&shared)));
    let server = server.transpose().map_err(MonitorError::Serve)?;
    let page = server.as_ref().map(Server::url);
    let reader = thread::spawn(move || reader.run());
    let until = arguments.duration.map(|time| Instant::now() + time);
    let shown = if is_terminal {
        terminal::run(&shared, &terminal::Options { until, page })
    } else {
        print_lines(arguments, &shared, &lines, until, page)
    };
    drop(lines);
    shared.stop();
    let ended = end(arguments, reader, shown);
    if server.is_some() && ended.is_err() {
        // Browsers hear of the end before the server goes with it.
        thread::sleep(LAST_WORDS);
    }
    ended
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
        Ending::Stopped | Ending::Ended => Ok(ExitCode::SUCCESS),
        Ending::Lost(error) => Err(MonitorError::Lost(error)),
    }
}

/// Prints what the reader tells, until it has ended, the time is over or nobody reads any more.
/// While there is a page, the end of a log is no end: there is something to look at.
fn print_lines(
    arguments: &Arguments,
    shared: &Shared,
    lines: &Receiver<Line>,
    until: Option<Instant>,
    page: Option<String>,
) -> io::Result<()> {
    let stays = page.is_some();
    // Asked while it is there: of a closed terminal it can't be found out what it was.
    let is_terminal = io::stdout().is_terminal();
    let has_gone = |error: &io::Error| {
        error.kind() == io::ErrorKind::BrokenPipe || is_terminal && terminal::is_gone(error)
    };
    if let Some(url) = page {
        print(&address(arguments.json, url)?)?;
    }
    let over = || shared.is_stopped() || until.is_some_and(|until| Instant::now() >= until);
    while !over() {
        let line = match lines.recv_timeout(GLANCE) {
            Ok(line) => line,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) if stays && !shared.is_done() => {
                thread::sleep(GLANCE);
                continue;
            }
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        };
        match print(&text(arguments.json, &line)?) {
            Err(error) if has_gone(&error) => return Ok(()),
            other => other?,
        }
    }
    Ok(())
}

/// The first line where there is a page.
fn address(json: bool, url: String) -> io::Result<String> {
    if !json {
        return Ok(format!("the page is at {url}\n"));
    }
    Ok(serde_json::to_string(&Record::new("page", BTreeMap::from([("url", url)])))? + "\n")
}

fn text(json: bool, line: &Line) -> io::Result<String> {
    Ok(match (json, line) {
        (true, Line::State(snapshot)) => serde_json::to_string(snapshot)? + "\n",
        (true, Line::Event(event)) => serde_json::to_string(&Record::new("event", event))? + "\n",
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
