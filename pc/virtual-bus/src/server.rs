//! The loop that runs the stage, serves the clients and obeys the words.
//!
//! In: all of them, ready. Out: the end. Virtual time is run up to the machine's time, then what
//! clients have sent goes onto the bus at that very instant, then the loop waits for whatever
//! comes first: a frame of a client, or the next thing that happens in the virtual world. Behind a
//! frame of a client that is the next frame on the bus, since it may be the answer; else a
//! millisecond is the least, and what comes within it goes out together.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::console::{Told, complain, say, say_json};
use crate::doors::Doors;
use crate::error::ServeError;
use crate::options::Arguments;
use crate::pace::{Pace, Speed};
use crate::ports::stdin;
use crate::words::line::Word;
use crate::words::reader::WordError;
use crate::words::script::{Script, Wanted};
use crate::world::agenda::{Agenda, Outcome};
use crate::world::effects::Done;
use crate::world::keep::Keep;
use crate::world::stage::Stage;

/// A tick of the virtual world, ns.
const TICK_NS: u64 = 1_000_000;

/// The longest rest: typed words and Ctrl-C are looked for between rests.
const LONGEST_REST: Duration = Duration::from_millis(20);

/// For so long after a frame of a client, in virtual time, each frame goes out as it comes, ns: one
/// of them may be the answer.
const DIALOGUE_NS: u64 = 5_000_000;

/// Else what comes within this time goes out together, as an adapter at a USB port does it: each
/// frame by itself wakes a thread of every client, and every program that listens.
const BUNDLE: Duration = Duration::from_millis(1);

/// A rest that is not worth its system call.
const SHORTEST_REST: Duration = Duration::from_micros(20);

/// Everything of one run.
#[derive(Debug)]
pub struct Server {
    doors: Doors,
    stage: Stage,
    pace: Pace,
    script: Option<Script>,
    /// When the script wants to be asked again, ns.
    script_due_ns: u64,
    typed: Option<Receiver<String>>,
    agenda: Agenda,
    keep: Option<Keep>,
    interrupted: Arc<AtomicBool>,
    await_client: bool,
    /// Virtual time 0, microseconds since 1970.
    epoch_us: u64,
    told_late: bool,
    json: bool,
    /// Virtual time at which a client last put a frame onto the bus, ns.
    asked_ns: u64,
}

/// Why the run ends.
#[derive(Debug, thiserror::Error)]
enum End {
    #[error("the end was asked for")]
    Quit,
    #[error(transparent)]
    Failed(#[from] ServeError),
}

impl Server {
    /// All that is needed, with virtual time at 0.
    pub fn new(
        arguments: &Arguments,
        doors: Doors,
        stage: Stage,
        script: Option<Script>,
        keep: Option<Keep>,
        interrupted: Arc<AtomicBool>,
    ) -> Self {
        let typed = match arguments.no_stdin {
            true => None,
            // Without typed words the bus is still worth serving.
            false => stdin::listen().map_err(|e| complain(&e.to_string())).ok(),
        };
        Self {
            doors,
            stage,
            pace: Pace::new(arguments.speed, Instant::now(), 0),
            script,
            script_due_ns: 0,
            typed,
            agenda: Agenda::default(),
            keep,
            interrupted,
            await_client: arguments.await_client,
            epoch_us: 0,
            told_late: false,
            json: arguments.json,
            asked_ns: 0,
        }
    }

    /// Runs until Ctrl-C or `quit`.
    ///
    /// Errors: [`ServeError::ScriptEnded`], [`ServeError::Keep`].
    pub fn run(mut self) -> Result<(), ServeError> {
        match self.go() {
            Ok(()) | Err(End::Quit) => Ok(()),
            Err(End::Failed(error)) => Err(error),
        }
    }

    fn go(&mut self) -> Result<(), End> {
        self.wait_for_client()?;
        self.pace = Pace::new(self.pace.speed, Instant::now(), 0);
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        self.epoch_us = since_1970.map_or(0, |d| d.as_micros() as u64);
        while !self.is_interrupted() {
            let at_ns = self.stage.network.now_ns();
            let (target_ns, late) = self.pace.target(Instant::now(), at_ns);
            self.tell_late(late);
            self.advance(target_ns)?;
            self.hear_typed()?;
            self.hear_twin()?;
            for port in &mut self.doors.devices {
                port.serve(&mut self.stage);
            }
            self.take_in();
            self.tell();
            self.rest();
        }
        Ok(())
    }

    fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Somebody waits for the answer to a word, and so these are carried out meanwhile, at time 0.
    fn wait_for_client(&mut self) -> Result<(), End> {
        while self.await_client && self.doors.hub.clients() == 0 && !self.is_interrupted() {
            thread::sleep(Duration::from_millis(5));
            self.tell();
            self.hear_twin()?;
        }
        Ok(())
    }

    fn tell_late(&mut self, late: bool) {
        if late && !self.told_late {
            self.told_late = true;
            complain("this machine can't keep up: virtual time goes slower than asked for");
        }
    }

    fn tell(&mut self) {
        for notice in self.doors.hub.notices() {
            complain(&notice);
        }
    }

    /// Goes on to `target_ns`, with every word at its time.
    fn advance(&mut self, target_ns: u64) -> Result<(), End> {
        loop {
            self.obey_due()?;
            let now_ns = self.stage.network.now_ns();
            if now_ns >= target_ns {
                return Ok(());
            }
            let due_ns = self.agenda.due_ns().min(self.script_due_ns);
            self.play(due_ns.clamp(now_ns + 1, target_ns))?;
        }
    }

    /// Runs the world; what was stored is on the disk before anybody hears that it is.
    fn play(&mut self, until_ns: u64) -> Result<(), ServeError> {
        let passed = self.stage.run_until(until_ns);
        if passed.is_empty() {
            return Ok(());
        }
        if let Some(keep) = &mut self.keep {
            keep.save(&mut self.stage)?;
        }
        for frame in passed {
            let time_us = self.epoch_us + frame.at_ns / 1000;
            self.doors.hub.send(&frame.frame, time_us, frame.from);
        }
        Ok(())
    }

    /// Carries out the words whose time has come.
    fn obey_due(&mut self) -> Result<(), End> {
        let now_ns = self.stage.network.now_ns();
        while let Some(word) = self.agenda.take_due(now_ns) {
            self.obey(&word)?;
        }
        // A time that falls between two nanoseconds has come at the first of them.
        let now_s = (now_ns + 1) as f64 * 1e-9;
        while now_ns >= self.script_due_ns {
            let script = self.script.as_mut();
            let wanted = script.map_or(Wanted::Nothing, |script| {
                script.next(now_s, self.stage.is_still())
            });
            match wanted {
                Wanted::Word(word) => self.obey(&word)?,
                Wanted::Later(due_s) => self.script_due_ns = (due_s * 1e9) as u64,
                Wanted::Stillness => self.script_due_ns = now_ns + TICK_NS,
                Wanted::Nothing => self.script_due_ns = u64::MAX,
                Wanted::End(path) => return Err(ServeError::ScriptEnded(path, now_s).into()),
            }
        }
        Ok(())
    }

    fn obey(&mut self, word: &Word) -> Result<(), End> {
        let done = self.stage.obey(word);
        self.report(done.map(Outcome::Done))
    }

    /// Tells the person at the bus what a word came to.
    fn report(&self, outcome: Result<Outcome, WordError>) -> Result<(), End> {
        match outcome {
            Ok(Outcome::Done(Done::Quietly) | Outcome::PutOff(_)) => {}
            Ok(Outcome::Done(Done::Told(text))) if self.json => say_json(&Told::new(&text)),
            Ok(Outcome::Done(Done::Told(text))) => say(&text),
            Ok(Outcome::Done(Done::Quit)) => return Err(End::Quit),
            Ok(Outcome::Wait(_)) => complain(&WordError::ScriptOnly.to_string()),
            Err(error) => complain(&error.to_string()),
        }
        Ok(())
    }

    fn hear_typed(&mut self) -> Result<(), End> {
        while let Some(line) = self.typed.as_ref().and_then(|lines| lines.try_recv().ok()) {
            let outcome = self.agenda.hear(&line, &mut self.stage);
            self.report(outcome)?;
        }
        Ok(())
    }

    fn hear_twin(&mut self) -> Result<(), End> {
        let went_on = self.doors.twin.serve(&mut self.stage, &mut self.agenda);
        match went_on.is_continue() {
            true => Ok(()),
            false => Err(End::Quit),
        }
    }

    /// Puts what clients have sent onto the bus.
    fn take_in(&mut self) {
        let Self { doors, stage, .. } = self;
        while let Some(incoming) = doors.hub.receive(|client| stage.has_room(client)) {
            stage.offer(incoming);
            self.asked_ns = stage.network.now_ns();
        }
    }

    /// Waits for what comes first: a client, or the virtual world.
    fn rest(&mut self) {
        if self.pace.speed == Speed::Max {
            while self.doors.hub.is_congested() && !self.is_interrupted() {
                thread::sleep(Duration::from_millis(1));
            }
            return;
        }
        let network = &self.stage.network;
        let now_ns = network.now_ns();
        let tick_ns = (now_ns / TICK_NS + 1) * TICK_NS;
        let now = Instant::now();
        let mut rest = self.pace.wait(now, tick_ns);
        if rest.is_zero() {
            return;
        }
        rest = rest.clamp(BUNDLE, LONGEST_REST);
        if now_ns < self.asked_ns + DIALOGUE_NS {
            let event_ns = network.bus.next_event().unwrap_or(u64::MAX);
            rest = rest.min(self.pace.wait(now, event_ns));
        }
        if rest < SHORTEST_REST {
            return;
        }
        let Self { doors, stage, .. } = self;
        doors.hub.wait(rest, |client| stage.has_room(client));
    }
}
