//! Logs onto a bus, when each frame is due.
//!
//! In: logs and the name of a bus. Out: their frames on it, and how many they were and how late
//! the latest of them was. What the bus sends meanwhile is taken in and forgotten, since nobody
//! else would take it.

use std::io::{self, BufRead as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use canopen::Frame;

use super::{Options, PlaybackError};
use bus_logs::{Logged, Moment, Player, candump_line};
use bus_master::{Bus, BusOptions};
use output::progress::Progress;
use output::stdout;
use output::{object, plural};

/// Plays the logs.
pub fn run(
    paths: &[PathBuf],
    options: &Options,
    from: Option<Moment>,
    json: bool,
) -> Result<ExitCode, PlaybackError> {
    if options.step && paths.iter().any(|path| path.as_os_str() == "-") {
        return Err(PlaybackError::StepFromStdin);
    }
    let mut player = Player::open(paths, options.play(from), &Progress::hidden())?;
    let bus = BusOptions {
        bus: options.onto.clone(),
        ..BusOptions::default()
    };
    let mut stage = Stage {
        bus: bus.join().map_err(PlaybackError::Join)?,
        step: options.step,
        interface: None,
        sent: 0,
        not_sent: 0,
        latest: Duration::ZERO,
    };
    let started = Instant::now();
    while let Some(next) = player.next(Instant::now()) {
        let (logged, due) = next?;
        stage.hold_to_one(&logged, player.source().interfaces())?;
        match stage.play(&logged, due) {
            Ok(true) => {}
            Ok(false) => break,
            // Played for ever, this is how it ends.
            Err(why) if why.kind() == io::ErrorKind::Interrupted && options.again => break,
            Err(why) if why.kind() == io::ErrorKind::Interrupted => {
                return Err(PlaybackError::Interrupted(stage.sent));
            }
            Err(why) => return Err(PlaybackError::Lost(stage.sent, why)),
        }
    }
    stage.tell(started.elapsed(), json)?;
    match player.source().incomplete() {
        Some(why) => Err(why.into()),
        None => Ok(ExitCode::SUCCESS),
    }
}

struct Stage {
    bus: Bus,
    step: bool,
    interface: Option<u8>,
    sent: u64,
    not_sent: u64,
    latest: Duration,
}

impl Stage {
    /// Frames of two buses on one would be a third.
    fn hold_to_one(&mut self, logged: &Logged, names: &[String]) -> Result<(), PlaybackError> {
        let first = *self.interface.get_or_insert(logged.interface);
        if first == logged.interface {
            return Ok(());
        }
        let name = |place: u8| names.get(usize::from(place)).cloned().unwrap_or_default();
        Err(PlaybackError::TwoInterfaces(
            name(first),
            name(logged.interface),
        ))
    }

    /// Waits until the frame is due and sends it; false when no more is wanted.
    fn play(&mut self, logged: &Logged, due: Instant) -> io::Result<bool> {
        if self.step && !self.wait_for_enter(logged)? {
            return Ok(false);
        }
        // At least one look, for a signal to end and to keep the adapter's queue empty.
        while self.bus.receive(due)?.is_some() {}
        self.send(&logged.frame)?;
        if !self.step {
            self.latest = self.latest.max(due.elapsed());
        }
        Ok(true)
    }

    fn send(&mut self, frame: &Frame) -> io::Result<()> {
        match self.bus.send(frame) {
            Ok(()) => self.sent += 1,
            Err(why) if why.kind() == io::ErrorKind::Unsupported => self.not_sent += 1,
            Err(why) => return Err(why),
        }
        Ok(())
    }

    fn wait_for_enter(&self, logged: &Logged) -> io::Result<bool> {
        eprintln!("{}", candump_line(logged.time_ns, "next", &logged.frame));
        let mut line = String::new();
        let bytes = io::stdin().lock().read_line(&mut line)?;
        Ok(bytes > 0 && line.trim() != "q")
    }

    fn tell(self, elapsed: Duration, json: bool) -> Result<(), PlaybackError> {
        let played = object! {
            format: "plumb-onto",
            version: 1,
            bus: self.bus.name(),
            sent: self.sent,
            // Frames that the adapter can't send, such as remote ones through socketcand.
            not_sent: self.not_sent,
            // The most that a frame went out behind its time.
            latest_ms: self.latest.as_secs_f64() * 1e3,
            elapsed_s: elapsed.as_secs_f64(),
        };
        let text = || {
            let left = match played.not_sent {
                0 => String::new(),
                count => format!("; {count} that this adapter can't send were left out"),
            };
            format!(
                "{} onto {} in {:.1} s, none later than {:.1} ms{left}\n",
                plural(played.sent, "frame", "frames"),
                played.bus,
                played.elapsed_s,
                played.latest_ms
            )
        };
        stdout::print_as(json, &played, text).map_err(PlaybackError::Stdout)
    }
}
