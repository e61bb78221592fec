//! The thread that takes what the source gives, and never waits for a view.
//!
//! In: a [`Feed`]. Out: the model that the views share, a recording, and for the plain view a line
//! a second and one for each event. A view of a bus that reads too slowly loses lines, which are
//! counted, and no frame; a log waits for its view.
//!
//! Left out: what is done with lines.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use canopen::Frame;

use super::events::{Event, Kind};
use super::feed::{Feed, Step};
use super::level::Level;
use super::model::Model;
use super::moment;
use super::own::Own;
use super::record::Recorder;
use super::snapshot::{Snapshot, SourceState};
use bus_master::{self as bus, now_ns};
use output::printable;

/// How long a step waits for a frame: after that it is looked what else there is to do.
const GLANCE: Duration = Duration::from_millis(20);

/// From one try to reach a lost bus to the next.
const TRY_AGAIN: Duration = Duration::from_secs(1);

/// After this silence it is asked why, and again and again.
const ADVICE_FIRST: Duration = Duration::from_secs(2);
const ADVICE: Duration = Duration::from_secs(5);

/// From one line to the next, on the source's clock.
const LINE_NS: u64 = 1_000_000_000;

/// What the threads share.
#[derive(Debug)]
pub struct Shared {
    model: Mutex<Model>,
    stop: AtomicBool,
    paused: AtomicBool,
    done: AtomicBool,
}

impl Shared {
    /// Shares a model.
    pub const fn new(model: Model) -> Self {
        Self {
            model: Mutex::new(model),
            stop: AtomicBool::new(false),
            paused: AtomicBool::new(false),
            done: AtomicBool::new(false),
        }
    }

    /// The model; who holds it keeps the reader waiting, so not for long.
    pub fn model(&self) -> MutexGuard<'_, Model> {
        self.model.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks the reader to end.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Lets a log stand still, or go on; a bus does not wait.
    pub fn pause(&self, paused: bool) {
        self.paused.store(paused, Ordering::Relaxed);
    }

    /// Whether a log is to stand still.
    pub fn is_paused(&self) -> bool {
        self.paused.load(Ordering::Relaxed)
    }

    /// The reader has nothing left to show: the bus is lost, or it was asked to end.
    pub fn is_done(&self) -> bool {
        self.done.load(Ordering::Relaxed)
    }

    /// Whether it was asked to.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Tells the views that there is nothing more to show, however the reader has ended.
struct Done {
    shared: Arc<Shared>,
    /// The end of a log is something to look at.
    stays: bool,
}

impl Drop for Done {
    fn drop(&mut self) {
        self.shared.done.store(!self.stays, Ordering::Relaxed);
    }
}

/// Something for the plain view.
#[derive(Clone, Debug)]
pub enum Line {
    /// A second has passed.
    State(Box<Snapshot>),
    /// Something has happened.
    Event(Event),
}

/// Why reading has ended.
#[derive(Debug)]
pub enum Ending {
    /// The user has enough.
    Stopped,
    /// The log has come to its end.
    Ended,
    /// The bus is lost, or the log can't be read on.
    Lost(io::Error),
}

/// What is left when reading has ended.
#[derive(Debug)]
pub struct Outcome {
    /// Why.
    pub ending: Ending,
    /// Why the recording has ended before that.
    pub recording: Result<(), io::Error>,
}

/// SYNCs of our own.
#[derive(Clone, Copy, Debug)]
struct OwnSync {
    period: Duration,
    due: Instant,
}

/// What the reader is asked to do besides.
#[derive(Debug, Default)]
pub struct Tasks {
    /// Where frames are recorded.
    pub recorder: Option<Recorder>,
    /// Where lines go.
    pub lines: Option<SyncSender<Line>>,
    /// Whether a line may be lost, as of a bus, or is waited for.
    pub may_lose_lines: bool,
    /// Whether a lost bus is tried again.
    pub reconnect: bool,
    /// Nodes to be started at the beginning.
    pub start: Vec<u8>,
    /// SYNC to be sent while nobody else does.
    pub sync: Option<Duration>,
}

/// The reader.
pub struct Reader<F> {
    feed: F,
    shared: Arc<Shared>,
    tasks: Tasks,
    sync: Option<OwnSync>,
    own: Own,
    next_line_ns: Option<u64>,
    events_told: u64,
    lines_lost: u64,
    recording: Result<(), io::Error>,
    next_advice: Instant,
}

impl<F: Feed> Reader<F> {
    /// Reads from a source.
    pub fn new(feed: F, shared: Arc<Shared>, tasks: Tasks) -> Self {
        let due = Instant::now() + Duration::from_secs(1);
        Self {
            feed,
            shared,
            sync: tasks.sync.map(|period| OwnSync { period, due }),
            tasks,
            own: Own::default(),
            next_line_ns: None,
            events_told: 0,
            lines_lost: 0,
            recording: Ok(()),
            next_advice: Instant::now() + ADVICE_FIRST,
        }
    }

    /// Reads to the end.
    pub fn run(mut self) -> Outcome {
        let mut done = Done {
            shared: Arc::clone(&self.shared),
            stays: false,
        };
        let ending = match self.start().and_then(|()| self.read()) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ending::Stopped,
            Err(error) => Ending::Lost(error),
            Ok(ending) => ending,
        };
        done.stays = matches!(ending, Ending::Ended);
        let rest = self.own.rest(Instant::now(), now_ns());
        self.take_own(rest);
        if let Some(recorder) = self.tasks.recorder.take() {
            let finished = recorder.finish().map(drop);
            self.recording = std::mem::replace(&mut self.recording, Ok(())).and(finished);
        }
        if let Ending::Lost(error) = &ending {
            let why = printable(&error.to_string());
            self.shared.model().end(SourceState::Lost, why);
        }
        self.tell_events();
        Outcome {
            ending,
            recording: self.recording,
        }
    }

    fn start(&mut self) -> io::Result<()> {
        for node in std::mem::take(&mut self.tasks.start) {
            // NMT, start remote node (CiA 301, 7.2.8.3.1).
            self.send(&Frame::data_frame(0, &[1, node]))?;
        }
        Ok(())
    }

    /// Sends a frame, which is shown and recorded too when its time is known: no transport shows
    /// us our own.
    fn send(&mut self, frame: &Frame) -> io::Result<()> {
        self.feed.send(frame)?;
        self.own.sent(Instant::now(), *frame);
        Ok(())
    }

    fn read(&mut self) -> io::Result<Ending> {
        while !self.shared.is_stopped() {
            match self.step() {
                Ok(true) => {}
                Ok(false) => return Ok(Ending::Ended),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => break,
                Err(error) if self.tasks.reconnect => {
                    if !self.reconnect(&error) {
                        break;
                    }
                }
                Err(error) => return Err(error),
            }
        }
        Ok(Ending::Stopped)
    }

    /// One step of the source; false at its end.
    fn step(&mut self) -> io::Result<bool> {
        let now = Instant::now();
        let until = self
            .sync
            .map_or(now + GLANCE, |sync| sync.due.min(now + GLANCE));
        match self.feed.step(until)? {
            Step::Frame(time_ns, frame) => {
                let own = self.own.received(time_ns, Instant::now());
                self.take_own(own);
                self.line(time_ns);
                self.record(time_ns, &frame);
                self.shared.model().take(time_ns, &frame);
                self.foreign_sync(&frame);
            }
            Step::Nothing => {
                let own = self.own.waited(now, now_ns());
                self.take_own(own);
                let now_ns = self.feed.now_ns();
                self.line(now_ns);
                self.shared.model().pass(now_ns);
                self.advise()?;
                self.own_sync()?;
            }
            Step::Remark(text) => {
                let text = printable(&text);
                self.shared.model().note(Kind::Source, Level::Warning, text);
            }
            Step::Ended(remarks) => {
                self.ended(remarks);
                return Ok(false);
            }
        }
        self.shared.model().unreadable(self.feed.unreadable());
        self.record_pass();
        self.tell_events();
        Ok(true)
    }

    /// The last state is told too: the last second of a log is rarely whole.
    fn ended(&mut self, remarks: Vec<String>) {
        let snapshot = {
            let mut model = self.shared.model();
            for remark in remarks {
                model.note(Kind::Source, Level::Warning, remark);
            }
            model.end(SourceState::Ended, "the log has ended".to_owned());
            moment::snapshot(&model)
        };
        self.tell_events();
        self.tell(Line::State(Box::new(snapshot)));
    }

    /// Takes frames of our own, which are no sign that anybody is there.
    fn take_own(&mut self, frames: Vec<(u64, Frame)>) {
        for (time_ns, frame) in frames {
            self.record(time_ns, &frame);
            self.shared.model().take_own(time_ns, &frame);
        }
    }

    fn record(&mut self, time_ns: u64, frame: &Frame) {
        if let Some(recorder) = &mut self.tasks.recorder {
            let taken = recorder.take(time_ns, self.feed.interface(), frame);
            self.recorded(taken);
        }
    }

    fn record_pass(&mut self) {
        let Some(recorder) = &mut self.tasks.recorder else {
            return;
        };
        let passed = recorder.pass(Instant::now());
        let frames = recorder.frames();
        self.recorded(passed);
        let mut model = self.shared.model();
        if model.recording.ended.is_none() {
            model.recording.frames = frames;
        }
    }

    /// A recording that can't go on ends; the view does not.
    fn recorded(&mut self, done: io::Result<()>) {
        let Err(error) = done else { return };
        let path = self
            .tasks
            .recorder
            .take()
            .map(|r| r.path().display().to_string());
        let path = printable(&path.unwrap_or_default());
        let why = format!("recording to {path} has ended: {error}");
        let mut model = self.shared.model();
        model.recording.ended = Some(error.to_string());
        model.note(Kind::Source, Level::Fault, why);
        self.recording = Err(error);
    }

    /// Finds out why nothing comes, now and then.
    fn advise(&mut self) -> io::Result<()> {
        let now = Instant::now();
        if now < self.next_advice || !self.shared.model().is_quiet() {
            return Ok(());
        }
        self.next_advice = now + ADVICE;
        let advice = self.feed.advice()?;
        self.shared.model().advise(advice);
        Ok(())
    }

    fn own_sync(&mut self) -> io::Result<()> {
        let Some(mut sync) = self.sync.filter(|sync| Instant::now() >= sync.due) else {
            return Ok(());
        };
        sync.due += sync.period;
        self.sync = Some(sync);
        self.send(&Frame::data_frame(0x80, &[]))
    }

    /// A SYNC of somebody else ends ours for good: two producers disturb each other.
    fn foreign_sync(&mut self, frame: &Frame) {
        if self.sync.is_some() && frame.cob_id() == Some(0x80) && !frame.is_remote() {
            self.sync = None;
            let text = "another node produces SYNC: this program sends none".to_owned();
            self.shared.model().note(Kind::Sync, Level::Good, text);
        }
    }

    /// Tries until the bus is there again or the user has enough.
    fn reconnect(&mut self, error: &io::Error) -> bool {
        let why = printable(&error.to_string());
        self.shared.model().end(SourceState::Lost, why);
        let mut next = Instant::now();
        while !self.shared.is_stopped() && !bus::interrupted() {
            self.tell_events();
            if Instant::now() >= next {
                next = Instant::now() + TRY_AGAIN;
                if self.feed.again().is_ok() {
                    let text = "the bus is there again".to_owned();
                    self.shared.model().resume(text);
                    return true;
                }
            }
            let own = self.own.waited(Instant::now(), now_ns());
            self.take_own(own);
            let now_ns = self.feed.now_ns();
            self.line(now_ns);
            self.shared.model().pass(now_ns);
            self.record_pass();
            std::thread::sleep(GLANCE);
        }
        false
    }

    /// Makes a line when a second has passed on the source's clock.
    fn line(&mut self, now_ns: u64) {
        if self.tasks.lines.is_none() {
            return;
        }
        let next_ns = now_ns.saturating_add(LINE_NS);
        let due = *self.next_line_ns.get_or_insert(next_ns);
        // Where time has gone back, seconds are counted from there.
        if next_ns.saturating_add(LINE_NS) < due {
            self.next_line_ns = Some(next_ns);
        }
        if now_ns < due {
            return;
        }
        let snapshot = {
            let mut model = self.shared.model();
            model.pass(due);
            moment::snapshot(&model)
        };
        self.tell_events();
        self.tell(Line::State(Box::new(snapshot)));
        // A gap is told as an event, not as a line for each of its seconds.
        let next = due.saturating_add(LINE_NS);
        self.next_line_ns = Some(if next <= now_ns { next_ns } else { next });
    }

    fn tell_events(&mut self) {
        if self.tasks.lines.is_none() {
            return;
        }
        let (count, fresh) = {
            let model = self.shared.model();
            let count = model.events.count();
            if count == self.events_told {
                return;
            }
            let fresh: Vec<_> = model.events.since(self.events_told).cloned().collect();
            (count, fresh)
        };
        self.events_told = count;
        for event in fresh {
            self.tell(Line::Event(event));
        }
    }

    fn tell(&mut self, line: Line) {
        let Some(lines) = &self.tasks.lines else {
            return;
        };
        let gone = if self.tasks.may_lose_lines {
            match lines.try_send(line) {
                Ok(()) => {
                    self.tell_losses();
                    false
                }
                Err(TrySendError::Full(_)) => {
                    self.lines_lost += 1;
                    false
                }
                Err(TrySendError::Disconnected(_)) => true,
            }
        } else {
            lines.send(line).is_err()
        };
        if gone {
            self.tasks.lines = None;
            self.shared.stop();
        }
    }

    /// Lines that found no room are told of when there is some again.
    fn tell_losses(&mut self) {
        let lost = std::mem::take(&mut self.lines_lost);
        if lost > 0 {
            let text = format!("{lost} lines were left out: they were not read in time");
            let mut model = self.shared.model();
            model.note(Kind::Source, Level::Warning, text);
        }
    }
}
