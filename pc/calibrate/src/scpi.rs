//! Devices of a laboratory that are spoken to in lines, after the manner of SCPI.
//!
//! In: an address and lines (IEEE 488.2, SCPI-1999). Out: answers, orders that were taken, and the
//! oldest error of a device's queue. A motor ([`crate::motor`]) and a climatic chamber
//! ([`crate::characterise::chamber`]) stand behind it; docs/motor.md and docs/chamber.md have
//! their words.
//!
//! Left out: what the words mean, and binary blocks.

use std::fmt;
use std::io;
use std::time::{Duration, Instant};

use bus_master::intake::{Intake, Stream, connect};
use output::printable;

/// How long an answer may take that needs no movement.
const ANSWER: Duration = Duration::from_secs(5);

/// How long one look for an answer takes; between two of them it is asked whether to go on.
const GLANCE: Duration = Duration::from_millis(100);

/// How long an answer is waited for before whoever waits has another turn: gyroscopes are followed
/// meanwhile.
const LOOK: Duration = Duration::from_millis(2);

/// Errors of before that are passed over; a queue holds fewer.
const ERRORS_LIMIT: usize = 100;

/// What kind of device it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// What turns the housing.
    Motor,
    /// What keeps its temperature.
    Chamber,
}

impl Device {
    const fn word(self) -> &'static str {
        match self {
            Self::Motor => "motor",
            Self::Chamber => "chamber",
        }
    }

    /// The page that has its words.
    const fn page(self) -> &'static str {
        match self {
            Self::Motor => "docs/motor.md",
            Self::Chamber => "docs/chamber.md",
        }
    }
}

/// A device with its address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Peer {
    device: Device,
    name: String,
}

impl Peer {
    /// A device at this address.
    pub fn new(device: Device, name: &str) -> Self {
        Self {
            device,
            name: name.to_owned(),
        }
    }
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the {} {}", self.device.word(), self.name)
    }
}

/// Why a device did not do its part.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// The address is none.
    #[error(
        "{a:?} is no {b}: write tcp://HOST:PORT or serial:///dev/ttyUSB0?baud=115200",
        a = .0.name,
        b = .0.device.word()
    )]
    Address(Peer),
    /// It could not be reached.
    #[error("cannot reach {0}: {1}; is it on, and is that its address?")]
    Connect(Peer, io::Error),
    /// The connection broke.
    #[error("{0} is gone: {1}")]
    Lost(Peer, io::Error),
    /// It does not answer this.
    #[error("{0} does not answer {1:?}: look at its cable and baud rate")]
    Silent(Peer, String),
    /// It answers this with something that is no such answer.
    #[error("{0} answers {1:?} by {2:?}: does it speak the words of {a}?", a = .0.device.page())]
    Stranger(Peer, String, String),
    /// It has an error of its own.
    #[error("{0} refuses {1:?}: {a}", a = printable(.2))]
    Refused(Peer, String, String),
    /// Nobody waits for it any longer.
    #[error("{0} was not waited for")]
    Ended(Peer),
    /// A motor was sent to one angle and stands at another, deg.
    #[error("{0} was sent to {1:.3} deg and stands at {2:.3} deg: is something in its way?")]
    Elsewhere(Peer, f64, f64),
    /// A chamber states a temperature that no air has, degC.
    #[error("{0} states an air temperature of {1} degC, which is none: look at its sensor")]
    Nonsense(Peer, f64),
    /// A chamber's range is none.
    #[error("{0} answers \"CONF:RANG?\" by {1:?}: two temperatures belong there: -40,85")]
    Range(Peer, String),
    /// The person who sets the chamber answers no more.
    #[error("the input ended before the chamber was set")]
    Unset,
}

/// A device that is spoken to in lines.
#[derive(Debug)]
pub struct Scpi {
    intake: Intake,
    peer: Peer,
}

impl Scpi {
    /// Connects to `tcp://HOST:PORT`, `HOST:PORT` or `serial://PATH?baud=RATE`.
    ///
    /// Errors: [`DeviceError::Address`], [`DeviceError::Connect`].
    pub fn connect(device: Device, url: &str) -> Result<Self, DeviceError> {
        let peer = Peer::new(device, url);
        let failed = |error| DeviceError::Connect(peer.clone(), error);
        let address = || DeviceError::Address(peer.clone());
        let stream: Box<dyn Stream> = match url.strip_prefix("serial://") {
            Some(port) => {
                let (path, rate) = port.split_once('?').unwrap_or((port, "baud=115200"));
                let baud = rate
                    .strip_prefix("baud=")
                    .and_then(|rate| rate.parse().ok());
                let baud = baud.ok_or_else(address)?;
                let port = serialport::new(path, baud).timeout(GLANCE).open();
                Box::new(port.map_err(|error| failed(error.into()))?)
            }
            None => {
                let at = url.strip_prefix("tcp://").unwrap_or(url);
                if at.contains('/') || !at.contains(':') {
                    return Err(address());
                }
                Box::new(connect(at).map_err(failed)?)
            }
        };
        Ok(Self::over(stream, peer))
    }

    /// Speaks over anything that bytes go over.
    pub fn over(stream: Box<dyn Stream>, peer: Peer) -> Self {
        Self {
            intake: Intake::new(stream),
            peer,
        }
    }

    /// Who it is.
    pub fn peer(&self) -> Peer {
        self.peer.clone()
    }

    fn lost(&self, error: io::Error) -> DeviceError {
        DeviceError::Lost(self.peer(), error)
    }

    fn send(&mut self, line: &str) -> Result<(), DeviceError> {
        let sent = self.intake.write(format!("{line}\n").as_bytes());
        sent.map_err(|error| self.lost(error))
    }

    /// The answer to a question, without space around it.
    ///
    /// Errors: see [`DeviceError`].
    pub fn ask(&mut self, question: &str) -> Result<String, DeviceError> {
        self.ask_while(question, ANSWER, &mut || true)
    }

    /// The same of a question whose answer may take so long. `wait` is called again and again
    /// meanwhile; when it is false, nobody waits any longer.
    ///
    /// Errors: see [`DeviceError`].
    pub fn ask_while(
        &mut self,
        question: &str,
        patience: Duration,
        wait: &mut dyn FnMut() -> bool,
    ) -> Result<String, DeviceError> {
        self.send(question)?;
        let until = Instant::now() + patience;
        while wait() {
            let glance = until.min(Instant::now() + LOOK);
            match self.intake.next(b"\n", glance) {
                Ok(Some((line, _))) => return Ok(String::from_utf8_lossy(line).trim().to_owned()),
                Ok(None) if Instant::now() < until => {}
                Ok(None) => return Err(DeviceError::Silent(self.peer(), question.to_owned())),
                Err(error) => return Err(self.lost(error)),
            }
        }
        Err(DeviceError::Ended(self.peer()))
    }

    /// The answer to a question, a finite number.
    ///
    /// Errors: see [`DeviceError`]; [`DeviceError::Stranger`] for anything else.
    pub fn number(&mut self, question: &str) -> Result<f64, DeviceError> {
        let said = self.ask(question)?;
        let number = said.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.stranger(question, &said))
    }

    /// What it means that this is the answer to that.
    pub fn stranger(&self, asked: &str, said: &str) -> DeviceError {
        DeviceError::Stranger(self.peer(), asked.to_owned(), said.to_owned())
    }

    /// The oldest error that it has not told of yet.
    fn error(&mut self) -> Result<Option<String>, DeviceError> {
        const ASKED: &str = "SYST:ERR?";
        let said = self.ask(ASKED)?;
        let number = said.split(',').next().unwrap_or("");
        match number.trim().parse::<i32>() {
            Ok(0) => Ok(None),
            Ok(_) => Ok(Some(said)),
            Err(_) => Err(self.stranger(ASKED, &said)),
        }
    }

    /// Sends what has no answer, and asks whether it was taken.
    ///
    /// Errors: see [`DeviceError`]; [`DeviceError::Refused`] with the device's own words.
    pub fn order(&mut self, line: &str) -> Result<(), DeviceError> {
        self.send(line)?;
        match self.error()? {
            None => Ok(()),
            Some(said) => Err(DeviceError::Refused(self.peer(), line.to_owned(), said)),
        }
    }

    /// Who it is by its own words. Errors of before are not this work's and are passed over.
    ///
    /// Errors: see [`DeviceError`].
    pub fn identity(&mut self) -> Result<String, DeviceError> {
        for _ in 0..ERRORS_LIMIT {
            if self.error()?.is_none() {
                break;
            }
        }
        Ok(printable(&self.ask("*IDN?")?))
    }
}

/// A device's other end, for tests: what it answers to each question, in order.
#[cfg(test)]
pub mod script {
    use std::collections::VecDeque;
    use std::io::{Read, Write};

    use super::*;

    /// The answers that are left, and the bytes under way.
    struct Script {
        answers: VecDeque<String>,
        said: VecDeque<u8>,
    }

    impl Read for Script {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            if self.said.is_empty() {
                return match self.answers.is_empty() {
                    true => Ok(0),
                    false => Err(io::ErrorKind::TimedOut.into()),
                };
            }
            self.said.read(into)
        }
    }

    impl Write for Script {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if bytes.contains(&b'?') {
                let answer = self.answers.pop_front().unwrap_or_default();
                self.said.extend(answer.bytes());
            }
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Stream for Script {
        fn limit_reads(&mut self, _: Duration) -> io::Result<()> {
            Ok(())
        }
    }

    /// A device that answers so, and is gone behind the last answer.
    pub fn device(device: Device, answers: &[&str]) -> Scpi {
        let script = Script {
            answers: answers.iter().map(|answer| (*answer).to_owned()).collect(),
            said: VecDeque::new(),
        };
        Scpi::over(Box::new(script), Peer::new(device, "x"))
    }
}

#[cfg(test)]
mod tests {
    use super::script::device;
    use super::*;

    #[test]
    fn errors_of_before_are_passed_over_and_those_of_an_order_are_told() {
        let mut motor = device(
            Device::Motor,
            &["-113,\"old\"\n", "0,\"No error\"\n", " Maker,Model \r\n"],
        );
        assert_eq!(motor.identity().unwrap(), "Maker,Model");
        let told =
            device(Device::Chamber, &["-222,\"Data out of range\"\n"]).order("TEMP:SETP 900");
        let told = told.unwrap_err().to_string();
        assert_eq!(
            told,
            "the chamber x refuses \"TEMP:SETP 900\": -222,\"Data out of range\""
        );
    }

    #[test]
    fn a_queue_of_errors_that_never_ends_was_read_for_ever() {
        let mut answers = vec!["-1,\"again\"\n"; ERRORS_LIMIT];
        answers.push("Maker\n");
        let mut chamber = device(Device::Chamber, &answers);
        assert_eq!(chamber.identity().unwrap(), "Maker");
    }

    #[test]
    fn what_is_no_number_is_told_with_the_question() {
        for said in ["NaN\n", "inf\n", "9,9\n", "\n", "warm\n"] {
            let told = device(Device::Chamber, &[said]).number("TEMP?");
            let told = told.unwrap_err().to_string();
            assert!(told.contains("answers \"TEMP?\" by"), "{told}");
            assert!(told.contains("docs/chamber.md"), "{told}");
        }
    }

    #[test]
    fn an_address_that_is_none_shows_how_one_is_written() {
        for bad in ["", "motor", "tcp://a/b:1", "serial:///dev/x?baud=fast"] {
            let error = Scpi::connect(Device::Motor, bad).unwrap_err().to_string();
            assert!(error.contains("tcp://HOST:PORT"), "{error}");
        }
    }
}
