//! The loop that runs the stage, serves the clients and obeys the words.
//!
//! In: all of them, ready. Out: the end. Virtual time is run up to the machine's time, then what
//! clients have sent goes onto the bus at that very instant, then the loop waits for whatever
//! comes first: a frame of a client, or the next thing that happens in the virtual world.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use super::hub::Hub;
use super::keep::Keep;
use super::line_port::LinePort;
use super::options::Arguments;
use super::pace::{Pace, Speed};
use super::ready;
use super::say;
use super::script::{Script, Wanted};
use super::stage::{Done, Stage};
use super::stop::Stopped;
use super::twin::TwinPort;
use super::typed;
use super::words::{Line, Word, read};

/// A tick of the virtual world, ns.
const TICK_NS: u64 = 1_000_000;

/// The longest rest: typed words and Ctrl-C are looked for between rests.
const LONGEST_REST: Duration = Duration::from_millis(20);

/// A rest that is not worth its system call.
const SHORTEST_REST: Duration = Duration::from_micros(20);

/// Everything of one run.
#[derive(Debug)]
pub struct Server {
    hub: Hub,
    stage: Stage,
    speed: Speed,
    pace: Pace,
    script: Option<(PathBuf, Script)>,
    /// When the script wants to be asked again, ns.
    script_due_ns: u64,
    typed: Option<Receiver<String>>,
    /// Typed words that were put off, with their times in ns.
    put_off: Vec<(u64, Word)>,
    keep: Option<Keep>,
    /// Where `plumb twin` sends its words.
    twin: Option<TwinPort>,
    /// Virtual devices that are spoken to in lines.
    ports: Vec<LinePort>,
    interrupted: Arc<AtomicBool>,
    await_client: bool,
    /// Virtual time 0, microseconds since 1970.
    epoch_us: u64,
    told_late: bool,
    json: bool,
}

/// Whether the run goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Go {
    /// It does.
    On,
    /// It ends, exit status 0.
    Quit,
}

/// Tells the person at the bus what is the matter.
pub fn complain(sentence: &str) {
    eprintln!("plumb: {sentence}");
}

impl Server {
    /// All that is needed, with virtual time at 0.
    pub fn new(
        arguments: &Arguments,
        hub: Hub,
        stage: Stage,
        script: Option<(PathBuf, Script)>,
        keep: Option<Keep>,
        interrupted: Arc<AtomicBool>,
    ) -> Self {
        let typed = match arguments.no_stdin {
            true => None,
            // Without typed words the bus is still worth serving.
            false => typed::listen().map_err(|e| complain(&e.to_string())).ok(),
        };
        Self {
            hub,
            stage,
            speed: arguments.speed,
            pace: Pace::new(arguments.speed, Instant::now(), 0),
            script,
            script_due_ns: 0,
            typed,
            put_off: Vec::new(),
            keep,
            twin: None,
            ports: Vec::new(),
            interrupted,
            await_client: arguments.await_client,
            epoch_us: 0,
            told_late: false,
            json: arguments.json,
        }
    }

    /// The same with a port for words, and with what turns the housing and keeps its temperature.
    pub fn with_ports(self, twin: TwinPort, ports: Vec<LinePort>) -> Self {
        let twin = Some(twin);
        Self {
            twin,
            ports,
            ..self
        }
    }

    /// Runs until Ctrl-C or `quit`.
    ///
    /// Errors: [`Stopped::ScriptEnded`], [`Stopped::Keep`].
    pub fn run(mut self) -> Result<(), Stopped> {
        if self.wait_for_client() == Go::Quit {
            return Ok(());
        }
        self.pace = Pace::new(self.speed, Instant::now(), 0);
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        self.epoch_us = since_1970.map_or(0, |d| d.as_micros() as u64);
        while !self.is_interrupted() {
            let at_ns = self.stage.network.now_ns();
            let (target_ns, late) = self.pace.target(Instant::now(), at_ns);
            self.tell_late(late);
            let is_over = self.advance(target_ns)? == Go::Quit
                || self.hear_typed() == Go::Quit
                || self.hear_twin() == Go::Quit;
            if is_over {
                break;
            }
            for port in &mut self.ports {
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
    fn wait_for_client(&mut self) -> Go {
        while self.await_client && self.hub.clients() == 0 && !self.is_interrupted() {
            thread::sleep(Duration::from_millis(5));
            self.tell();
            if self.hear_twin() == Go::Quit {
                return Go::Quit;
            }
        }
        Go::On
    }

    fn tell_late(&mut self, late: bool) {
        if late && !self.told_late {
            self.told_late = true;
            complain("this machine can't keep up: virtual time goes slower than asked for");
        }
    }

    fn tell(&mut self) {
        for notice in self.hub.notices() {
            complain(&notice);
        }
    }

    /// Goes on to `target_ns`, with every word at its time.
    fn advance(&mut self, target_ns: u64) -> Result<Go, Stopped> {
        loop {
            if self.obey_due()? == Go::Quit {
                return Ok(Go::Quit);
            }
            let now_ns = self.stage.network.now_ns();
            if now_ns >= target_ns {
                return Ok(Go::On);
            }
            let put_off_ns = self.put_off.iter().map(|(at, _)| *at);
            let due_ns = put_off_ns.fold(self.script_due_ns, u64::min);
            self.play(due_ns.clamp(now_ns + 1, target_ns))?;
        }
    }

    /// Runs the world; what was stored is on the disk before anybody hears that it is.
    fn play(&mut self, until_ns: u64) -> Result<(), Stopped> {
        let passed = self.stage.run_until(until_ns);
        if passed.is_empty() {
            return Ok(());
        }
        if let Some(keep) = &mut self.keep {
            keep.save(&mut self.stage)?;
        }
        for frame in passed {
            let time_us = self.epoch_us + frame.at_ns / 1000;
            self.hub.send(&frame.frame, time_us, frame.from);
        }
        Ok(())
    }

    /// Carries out the words whose time has come.
    fn obey_due(&mut self) -> Result<Go, Stopped> {
        let now_ns = self.stage.network.now_ns();
        while let Some(place) = self.put_off.iter().position(|(at, _)| *at <= now_ns) {
            let (_, word) = self.put_off.remove(place);
            if self.obey(&word) == Go::Quit {
                return Ok(Go::Quit);
            }
        }
        if now_ns < self.script_due_ns {
            return Ok(Go::On);
        }
        // A time that falls between two nanoseconds has come at the first of them.
        let now_s = (now_ns + 1) as f64 * 1e-9;
        loop {
            self.script_due_ns = match self.wanted(now_s) {
                Wanted::Word(word) if self.obey(&word) == Go::Quit => return Ok(Go::Quit),
                Wanted::Word(_) => continue,
                Wanted::Later(due_s) => (due_s * 1e9) as u64,
                Wanted::Stillness => now_ns + TICK_NS,
                Wanted::Nothing => u64::MAX,
                Wanted::End => {
                    let path = self.script.take().map(|(path, _)| path);
                    return Err(Stopped::ScriptEnded(path.unwrap_or_default(), now_s));
                }
            };
            return Ok(Go::On);
        }
    }

    fn wanted(&mut self, now_s: f64) -> Wanted {
        let script = self.script.as_mut();
        script.map_or(Wanted::Nothing, |(_, script)| {
            script.next(now_s, self.stage.is_still())
        })
    }

    fn obey(&mut self, word: &Word) -> Go {
        match self.stage.obey(word) {
            Done::Told(text) if self.json => say(&ready::json(&ready::Told::new(&text))),
            Done::Told(text) => say(&text),
            Done::Quit => return Go::Quit,
            done => done.refusal().iter().for_each(|why| complain(why)),
        }
        Go::On
    }

    fn hear_typed(&mut self) -> Go {
        while let Some(text) = self.typed.as_ref().and_then(|lines| lines.try_recv().ok()) {
            let now_ns = self.stage.network.now_ns();
            let (at_ns, word) = match read(&text, self.stage.network.node_count()) {
                Ok(None) => continue,
                Err(error) => {
                    complain(&error.to_string());
                    continue;
                }
                Ok(Some(Line { when, word })) => (when.at_ns(now_ns), word),
            };
            if at_ns > now_ns {
                self.put_off.push((at_ns, word));
            } else if self.obey(&word) == Go::Quit {
                return Go::Quit;
            }
        }
        Go::On
    }

    fn hear_twin(&mut self) -> Go {
        let Self {
            twin,
            stage,
            put_off,
            ..
        } = self;
        twin.as_mut()
            .map_or(Go::On, |twin| twin.serve(stage, put_off))
    }

    /// Puts what clients have sent onto the bus.
    fn take_in(&mut self) {
        let Self { hub, stage, .. } = self;
        while let Some(incoming) = hub.receive(|client| stage.has_room(client)) {
            stage.offer(incoming);
        }
    }

    /// Waits for what comes first: a client, or the virtual world.
    fn rest(&mut self) {
        if self.speed == Speed::Max {
            while self.hub.is_congested() && !self.is_interrupted() {
                thread::sleep(Duration::from_millis(1));
            }
            return;
        }
        let network = &self.stage.network;
        let tick_ns = (network.now_ns() / TICK_NS + 1) * TICK_NS;
        let next_ns = network.bus.next_event().map_or(tick_ns, |e| e.min(tick_ns));
        let rest = self.pace.wait(Instant::now(), next_ns).min(LONGEST_REST);
        if rest < SHORTEST_REST {
            return;
        }
        let Self { hub, stage, .. } = self;
        hub.wait(rest, |client| stage.has_room(client));
    }
}
