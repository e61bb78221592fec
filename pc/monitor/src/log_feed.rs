//! Logs as a source: frames come when they are due, on the clock of the log.
//!
//! In: a [`Player`], how fast it goes, and whether the view stands still. Out: its frames, and at
//! their end what was no frame.
//!
//! Left out: reading and pacing (`log`).

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use canopen::Frame;

use super::feed::{Feed, Step, as_ns};
use super::reading::Shared;
use bus_logs::{LogError, Logged, PaceOptions, PartOptions, PlayOptions, Player, Skip};
use bus_master::JoinError;
use output::progress::Progress;

/// What is played and how.
#[derive(Clone, Debug)]
pub struct LogOptions {
    /// Files and folders.
    pub paths: Vec<PathBuf>,
    /// How fast.
    pub pace: PaceOptions,
    /// Which part of their time.
    pub part: PartOptions,
    /// The only interface.
    pub interface: Option<String>,
}

/// A frame that was read, and when it is due.
#[derive(Clone, Copy, Debug)]
struct Head {
    logged: Logged,
    due: Instant,
}

/// Logs being played.
pub struct LogFeed {
    player: Player,
    speed: f64,
    shared: Arc<Shared>,
    head: Option<Head>,
    last_ns: u64,
    held_since: Option<Instant>,
    interface: String,
    name: String,
    /// Whether one interface was chosen.
    only: bool,
    many_told: bool,
}

impl LogFeed {
    /// Opens the logs.
    ///
    /// Errors: see [`LogError`].
    pub fn open(options: &LogOptions, shared: Arc<Shared>) -> Result<Self, LogError> {
        let play = PlayOptions {
            pace: options.pace,
            part: options.part,
            interface: options.interface.clone(),
            ..PlayOptions::default()
        };
        let player = Player::open(&options.paths, play, &Progress::hidden())?;
        Ok(Self {
            player,
            speed: options.pace.speed,
            shared,
            head: None,
            last_ns: 0,
            held_since: None,
            interface: String::new(),
            name: name(&options.paths),
            only: options.interface.is_some(),
            many_told: false,
        })
    }

    /// Waits while the view stands still; true when it does.
    fn held(&mut self, until: Instant) -> bool {
        if self.shared.is_paused() {
            self.held_since.get_or_insert_with(Instant::now);
            sleep_until(until);
            return true;
        }
        if let Some(since) = self.held_since.take() {
            let held = since.elapsed();
            self.player.pace().pause(held);
            if let Some(head) = &mut self.head {
                head.due += held;
            }
        }
        false
    }

    fn head(&mut self) -> io::Result<Option<Head>> {
        if self.head.is_none() {
            let next = self.player.next(Instant::now()).transpose();
            let next = next.map_err(|error| io::Error::other(error.to_string()))?;
            self.head = next.map(|(logged, due)| Head { logged, due });
        }
        Ok(self.head)
    }

    /// Told once: frames of several buses are no one's bus.
    fn many_interfaces(&mut self) -> Option<String> {
        let names = self.player.source().interfaces();
        if self.many_told || self.only || names.len() < 2 {
            return None;
        }
        let names = names.join(" and ");
        self.many_told = true;
        Some(format!(
            "frames of {names} are taken together: choose one of them by -c"
        ))
    }

    /// What was no frame, in words.
    fn remarks(&self) -> Vec<String> {
        let kinds = self.player.source().skipped().kinds();
        kinds
            .filter(|(kind, _)| !matches!(kind, Skip::NoFrame | Skip::OtherInterface))
            .map(|(kind, tally)| format!("{}: {}", kind.words(), tally.count))
            .collect()
    }
}

/// What the logs are called.
pub fn name(paths: &[PathBuf]) -> String {
    match paths {
        [] => String::new(),
        [one] => one.display().to_string(),
        [first, rest @ ..] => format!("{} and {} more", first.display(), rest.len()),
    }
}

fn sleep_until(until: Instant) {
    std::thread::sleep(until.saturating_duration_since(Instant::now()));
}

impl Feed for LogFeed {
    fn step(&mut self, until: Instant) -> io::Result<Step> {
        if self.held(until) {
            return Ok(Step::Nothing);
        }
        let Some(Head { logged, due }) = self.head()? else {
            return Ok(Step::Ended(self.remarks()));
        };
        if let Some(remark) = self.many_interfaces() {
            return Ok(Step::Remark(remark));
        }
        if due > until {
            sleep_until(until);
            return Ok(Step::Nothing);
        }
        sleep_until(due);
        self.head = None;
        self.last_ns = logged.time_ns;
        Ok(Step::Frame(logged.time_ns, logged.frame))
    }

    fn now_ns(&self) -> u64 {
        let Some(head) = self.head.filter(|_| self.speed.is_finite()) else {
            return self.last_ns;
        };
        let now = self.held_since.unwrap_or_else(Instant::now);
        let left = head.due.saturating_duration_since(now);
        let left_ns = (as_ns(left) as f64 * self.speed) as u64;
        // Where time goes backwards the log stands still.
        let next_ns = head.logged.time_ns;
        next_ns
            .saturating_sub(left_ns)
            .max(self.last_ns.min(next_ns))
    }

    fn interface(&self) -> &str {
        &self.interface
    }

    fn send(&mut self, _: &Frame) -> io::Result<()> {
        let sentence = format!("{}: nothing can be sent to a log", self.name);
        Err(io::Error::new(io::ErrorKind::Unsupported, sentence))
    }

    fn again(&mut self) -> Result<(), JoinError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::super::model::{Model, Setup};
    use super::*;
    use listen::Plan;

    fn feed(name: &str, text: &str, speed: f64, skip_gaps: bool) -> (LogFeed, Arc<Shared>) {
        let file = format!("plumb-feed-{}-{name}.log", std::process::id());
        let path = std::env::temp_dir().join(file);
        std::fs::write(&path, text).unwrap();
        let shared = Arc::new(Shared::new(Model::new(&Plan::default(), Setup::default())));
        let options = LogOptions {
            paths: vec![path.clone()],
            pace: PaceOptions {
                speed,
                longest_gap: skip_gaps.then_some(Duration::from_secs(2)),
            },
            part: PartOptions::default(),
            interface: None,
        };
        let feed = LogFeed::open(&options, Arc::clone(&shared)).unwrap();
        (feed, shared)
    }

    const LOG: &str =
        "(100.000000) can0 080#\n(100.200000) can0 181#0000\n(160.000000) can0 080#\n";

    fn soon(ms: u64) -> Instant {
        Instant::now() + Duration::from_millis(ms)
    }

    #[test]
    fn frames_come_when_they_are_due_and_time_goes_on_between_them() {
        // So slow that no busy machine sleeps from one frame to the next: four seconds lie between.
        let (mut feed, _) = feed("due", LOG, 0.05, false);
        let from = Instant::now();
        assert!(matches!(
            feed.step(soon(10)),
            Ok(Step::Frame(100_000_000_000, _))
        ));
        assert!(matches!(feed.step(soon(1000)), Ok(Step::Nothing)));
        let now_ns = feed.now_ns();
        assert!(
            (100_030_000_000..100_200_000_000).contains(&now_ns),
            "{now_ns}"
        );
        assert!(matches!(
            feed.step(soon(30_000)),
            Ok(Step::Frame(100_200_000_000, _))
        ));
        assert!(from.elapsed() >= Duration::from_millis(3900));
    }

    #[test]
    fn as_fast_as_can_be_does_not_wait_and_tells_of_what_was_no_frame() {
        let text = format!("{LOG}(170.0000");
        let (mut feed, _) = feed("fast", &text, f64::INFINITY, false);
        let from = Instant::now();
        for _ in 0..3 {
            assert!(matches!(feed.step(soon(1)), Ok(Step::Frame(..))));
        }
        assert_eq!(feed.now_ns(), 160_000_000_000);
        let Ok(Step::Ended(remarks)) = feed.step(soon(1)) else {
            panic!("the log goes on");
        };
        assert_eq!(remarks, ["lines cut short: 1"]);
        // At its own speed the log takes a minute.
        assert!(from.elapsed() < Duration::from_secs(30));
    }

    #[test]
    fn frames_of_two_interfaces_are_told_of_once() {
        let text = "(1.000000) can0 080#\n(1.100000) can1 080#\n(1.200000) can0 080#\n";
        let (mut feed, _) = feed("two", text, f64::INFINITY, false);
        let mut remarks = Vec::new();
        loop {
            match feed.step(soon(1)).unwrap() {
                Step::Remark(remark) => remarks.push(remark),
                Step::Ended(_) => break,
                _ => {}
            }
        }
        assert_eq!(remarks.len(), 1);
        assert!(remarks[0].starts_with("frames of can0 and can1 are taken together"));
    }

    #[test]
    fn a_log_that_is_held_stands_still() {
        let (mut feed, shared) = feed("held", LOG, 1.0, false);
        assert!(matches!(feed.step(soon(1)), Ok(Step::Frame(..))));
        assert!(matches!(feed.step(soon(5)), Ok(Step::Nothing)));
        shared.pause(true);
        assert!(matches!(feed.step(soon(300)), Ok(Step::Nothing)));
        let held_ns = feed.now_ns();
        assert!(held_ns < 100_100_000_000, "{held_ns}");
        shared.pause(false);
        assert!(matches!(feed.step(soon(20)), Ok(Step::Nothing)));
        assert!(matches!(
            feed.step(soon(1000)),
            Ok(Step::Frame(100_200_000_000, _))
        ));
    }
}
