//! Where frames come from.
//!
//! In: a bus that was joined, or another [`Feed`]. Out: frame after frame, each with its time on
//! the source's clock, and what that clock shows between them.
//!
//! Left out: what they mean; logs, which are in `log_feed`.

use std::io;
use std::time::{Duration, Instant};

use canopen::Frame;

use bus_master::survey::Survey;
use bus_master::{Bus, BusOptions, JoinError, diagnosis, now_ns};

/// What a source gives.
#[derive(Debug)]
pub enum Step {
    /// A frame was seen at this time, in ns on the source's clock.
    Frame(u64, Frame),
    /// Nothing until then.
    Nothing,
    /// Something that the user should know of it.
    Remark(String),
    /// It has come to its end; what there is to remark.
    Ended(Vec<String>),
}

/// A source of frames.
pub trait Feed {
    /// The next frame, or nothing until `until`.
    ///
    /// Errors: the source is lost; [`io::ErrorKind::Interrupted`] when the user has enough.
    fn step(&mut self, until: Instant) -> io::Result<Step>;

    /// What the source's clock shows now, ns.
    fn now_ns(&self) -> u64;

    /// Name of the interface of the latest frame, for a recording.
    fn interface(&self) -> &str;

    /// Sends a frame.
    ///
    /// Errors: as [`Feed::step`].
    fn send(&mut self, frame: &Frame) -> io::Result<()>;

    /// Lines so far that can't be read, of a source that counts them while it runs: a log tells
    /// of its own at the end.
    fn unreadable(&self) -> u64 {
        0
    }

    /// What a silence may come from, in words; asked when nothing comes.
    ///
    /// Errors: as [`Feed::step`].
    fn advice(&mut self) -> io::Result<Option<String>> {
        Ok(None)
    }

    /// Tries to get a lost source back.
    ///
    /// Errors: why it is still lost.
    fn again(&mut self) -> Result<(), JoinError>;
}

/// A bus.
#[derive(Debug)]
pub struct BusFeed {
    options: BusOptions,
    bus: Bus,
    /// Lines that could not be read before it was last joined.
    before: u64,
    interface: String,
    /// Time of the latest frame, and when it was taken.
    last: Option<(u64, Instant)>,
}

impl BusFeed {
    /// Joins it.
    ///
    /// Errors: see [`JoinError`].
    pub fn join(options: &BusOptions) -> Result<Self, JoinError> {
        let bus = options.join()?;
        Ok(Self {
            options: options.clone(),
            interface: interface(bus.name()),
            bus,
            before: 0,
            last: None,
        })
    }

    /// What the bus is called.
    pub fn name(&self) -> &str {
        self.bus.name()
    }
}

/// The last word of a bus's name as loggers take it: letters and digits only.
fn interface(name: &str) -> String {
    let last = name.rsplit(['/', ':']).next().unwrap_or("");
    let word: String = last.chars().filter(char::is_ascii_alphanumeric).collect();
    if word.chars().any(|c| c.is_ascii_alphabetic()) {
        word
    } else {
        "can0".to_owned()
    }
}

impl Feed for BusFeed {
    fn step(&mut self, until: Instant) -> io::Result<Step> {
        let Some(received) = self.bus.receive(until)? else {
            return Ok(Step::Nothing);
        };
        self.last = Some((received.time_ns, Instant::now()));
        Ok(Step::Frame(received.time_ns, received.frame))
    }

    fn now_ns(&self) -> u64 {
        match self.last {
            Some((time_ns, at)) => time_ns.saturating_add(as_ns(at.elapsed())),
            None => now_ns(),
        }
    }

    fn interface(&self) -> &str {
        &self.interface
    }

    fn send(&mut self, frame: &Frame) -> io::Result<()> {
        self.bus.send(frame)
    }

    fn unreadable(&self) -> u64 {
        self.before + self.bus.unreadable()
    }

    fn advice(&mut self) -> io::Result<Option<String>> {
        // Nobody is asked: who only listens has the adapter's word and no other.
        let trouble = self.bus.trouble()?;
        let bus = self.bus.name().to_owned();
        let heard = Survey::default();
        Ok(Some(
            diagnosis::judge(&heard, trouble, &bus, None).to_string(),
        ))
    }

    fn again(&mut self) -> Result<(), JoinError> {
        // What its clock has shown is still the best that is known of it.
        let bus = self.options.join()?;
        self.before = self.unreadable();
        self.bus = bus;
        Ok(())
    }
}

/// Whole nanoseconds.
pub fn as_ns(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interface_is_a_word_that_loggers_take() {
        for (name, word) in [
            ("socketcand://127.0.0.1:29536/plumb", "plumb"),
            ("socketcan://can0", "can0"),
            ("slcan:///dev/ttyACM0", "ttyACM0"),
            ("slcan://pi:7", "can0"),
            ("", "can0"),
        ] {
            assert_eq!(interface(name), word, "{name}");
        }
    }
}
