//! What turns the housing: a motor with a known angle, and one that is spoken to in lines.
//!
//! In: an axis and an angle in degrees. Out: the housing stands there, or why not. [`Motor`] is
//! what another table has to do; [`ScpiMotor`] does it in words after the manner of SCPI over TCP
//! or a serial port (docs/motor.md), which `plumb serve --motor` understands.
//!
//! Left out: whether the housing shakes, which the sensor itself tells.

use std::fmt;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use crate::report::replay_tables::printable;

/// Which slope is turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Slope X, the roll of the housing; all of the turn of a one-axis instrument.
    X,
    /// Slope Y, the pitch.
    Y,
}

impl Axis {
    /// The letter that people call the slope by.
    pub const fn letter(self) -> &'static str {
        match self {
            Self::X => "X",
            Self::Y => "Y",
        }
    }

    /// The motor's word for it.
    pub const fn word(self) -> &'static str {
        match self {
            Self::X => "ROLL",
            Self::Y => "PITCH",
        }
    }
}

/// A motor that the housing is mounted on, or anything else that knows its angles.
pub trait Motor {
    /// Who it is, as it goes into the report.
    ///
    /// Errors: see [`MotorError`].
    fn identity(&mut self) -> Result<String, MotorError>;

    /// The axes that it turns without the housing being mounted anew.
    ///
    /// Errors: see [`MotorError`].
    fn axes(&mut self) -> Result<Vec<Axis>, MotorError>;

    /// Standard uncertainty (k = 1) of its angles in deg; `None` when it does not say.
    ///
    /// Errors: see [`MotorError`].
    fn uncertainty_deg(&mut self) -> Result<Option<f64>, MotorError>;

    /// Turns to `deg` and returns when it stands there. `wait` is called again and again
    /// meanwhile; when it is false, nobody waits any longer.
    ///
    /// Errors: see [`MotorError`].
    fn turn(
        &mut self,
        axis: Axis,
        deg: f64,
        wait: &mut dyn FnMut() -> bool,
    ) -> Result<(), MotorError>;

    /// Where it stands by its own measure, deg: the reference of the calibration.
    ///
    /// Errors: see [`MotorError`].
    fn position_deg(&mut self, axis: Axis) -> Result<f64, MotorError>;
}

/// Why a motor does not turn.
#[derive(Debug)]
pub enum MotorError {
    /// The address is none.
    Address(String),
    /// It could not be reached.
    Connect(String, io::Error),
    /// The connection broke.
    Lost(String, io::Error),
    /// It does not answer this.
    Silent(String, String),
    /// It answers this with something that is no such answer.
    Stranger(String, String, String),
    /// It has an error of its own.
    Refused(String, String, String),
    /// Nobody waits for it any longer.
    Ended,
    /// It is told to stand at one angle and stands at another.
    Elsewhere(String, f64, f64),
}

impl std::error::Error for MotorError {}

impl fmt::Display for MotorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Address(text) => write!(
                f,
                "{text:?} is no motor: write tcp://HOST:PORT or serial:///dev/ttyUSB0?baud=115200"
            ),
            Self::Connect(name, error) => write!(
                f,
                "cannot reach the motor {name}: {error}; is it on, and is that its address?"
            ),
            Self::Lost(name, error) => write!(f, "the motor {name} is gone: {error}"),
            Self::Silent(name, asked) => write!(
                f,
                "the motor {name} does not answer {asked:?}: look at its cable and baud rate"
            ),
            Self::Stranger(name, asked, said) => write!(
                f,
                "the motor {name} answers {asked:?} by {said:?}: does it speak the words of \
                 docs/motor.md?"
            ),
            Self::Refused(name, asked, said) => {
                write!(f, "the motor {name} refuses {asked:?}: {}", printable(said))
            }
            Self::Ended => write!(f, "the motor was not waited for"),
            Self::Elsewhere(name, to, at) => write!(
                f,
                "the motor {name} was sent to {to:.3} deg and stands at {at:.3} deg: is something \
                 in its way?"
            ),
        }
    }
}

/// How long a move may take.
const MOVE: Duration = Duration::from_secs(120);

/// How long another answer may take.
const ANSWER: Duration = Duration::from_secs(5);

/// So much next to where it was sent a motor may stand, deg.
const NEAR_DEG: f64 = 0.5;

/// The longest answer.
const LONGEST: usize = 512;

/// What bytes go over.
pub trait Wire: Read + Write {}

impl<T: Read + Write> Wire for T {}

/// A motor that is spoken to in lines.
pub struct ScpiMotor {
    wire: Box<dyn Wire>,
    name: String,
    heard: Vec<u8>,
}

impl ScpiMotor {
    /// Connects to `tcp://HOST:PORT`, `HOST:PORT` or `serial://PATH?baud=RATE`.
    ///
    /// Errors: [`MotorError::Address`], [`MotorError::Connect`].
    pub fn connect(url: &str) -> Result<Self, MotorError> {
        let failed = |error| MotorError::Connect(url.to_owned(), error);
        let wire: Box<dyn Wire> = match url.strip_prefix("serial://") {
            Some(port) => {
                let (path, rate) = port.split_once('?').unwrap_or((port, "baud=115200"));
                let baud = rate
                    .strip_prefix("baud=")
                    .and_then(|rate| rate.parse().ok());
                let baud = baud.ok_or_else(|| MotorError::Address(url.to_owned()))?;
                let port = serialport::new(path, baud).timeout(GLANCE).open();
                Box::new(port.map_err(|error| failed(error.into()))?)
            }
            None => {
                let at = url.strip_prefix("tcp://").unwrap_or(url);
                if at.contains('/') || !at.contains(':') {
                    return Err(MotorError::Address(url.to_owned()));
                }
                let stream = TcpStream::connect(at).map_err(failed)?;
                stream.set_nodelay(true).map_err(failed)?;
                stream.set_read_timeout(Some(GLANCE)).map_err(failed)?;
                Box::new(stream)
            }
        };
        Ok(Self::over(wire, url))
    }

    /// Speaks over anything that bytes go over; a read of it ends after some tenths of a second.
    pub fn over(wire: Box<dyn Wire>, name: &str) -> Self {
        Self {
            wire,
            name: name.to_owned(),
            heard: Vec::new(),
        }
    }

    fn say(&mut self, line: &str) -> Result<(), MotorError> {
        let text = format!("{line}\n");
        let said = self.wire.write_all(text.as_bytes());
        let said = said.and_then(|()| self.wire.flush());
        said.map_err(|error| MotorError::Lost(self.name.clone(), error))
    }

    fn ask(&mut self, question: &str) -> Result<String, MotorError> {
        self.ask_while(question, ANSWER, &mut || true)
    }

    fn ask_while(
        &mut self,
        question: &str,
        patience: Duration,
        wait: &mut dyn FnMut() -> bool,
    ) -> Result<String, MotorError> {
        self.say(question)?;
        let until = Instant::now() + patience;
        loop {
            if !wait() {
                return Err(MotorError::Ended);
            }
            if let Some(end) = self.heard.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.heard.drain(..=end).collect();
                return Ok(String::from_utf8_lossy(&line).trim().to_owned());
            }
            if Instant::now() > until || self.heard.len() > LONGEST {
                return Err(MotorError::Silent(self.name.clone(), question.to_owned()));
            }
            self.hear()?;
        }
    }

    fn hear(&mut self) -> Result<(), MotorError> {
        use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
        let mut bytes = [0; 256];
        match self.wire.read(&mut bytes) {
            Ok(0) => {
                let ended = io::ErrorKind::UnexpectedEof.into();
                Err(MotorError::Lost(self.name.clone(), ended))
            }
            Ok(count) => {
                self.heard.extend_from_slice(&bytes[..count]);
                Ok(())
            }
            Err(error) if matches!(error.kind(), Interrupted | TimedOut | WouldBlock) => Ok(()),
            Err(error) => Err(MotorError::Lost(self.name.clone(), error)),
        }
    }

    fn number(&mut self, question: &str) -> Result<f64, MotorError> {
        let said = self.ask(question)?;
        let number = said.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.stranger(question, &said))
    }

    fn stranger(&self, asked: &str, said: &str) -> MotorError {
        let (asked, said) = (asked.to_owned(), said.to_owned());
        MotorError::Stranger(self.name.clone(), asked, said)
    }

    /// The first error that it has not told of yet.
    fn error(&mut self) -> Result<Option<String>, MotorError> {
        const ASKED: &str = "SYST:ERR?";
        let said = self.ask(ASKED)?;
        let number = said.split(',').next().unwrap_or("");
        match number.trim().parse::<i32>() {
            Ok(0) => Ok(None),
            Ok(_) => Ok(Some(said)),
            Err(_) => Err(self.stranger(ASKED, &said)),
        }
    }
}

/// How long one read waits.
const GLANCE: Duration = Duration::from_millis(100);

impl Motor for ScpiMotor {
    fn identity(&mut self) -> Result<String, MotorError> {
        // Errors of before are not this calibration's.
        while self.error()?.is_some() {}
        self.ask("*IDN?")
    }

    fn axes(&mut self) -> Result<Vec<Axis>, MotorError> {
        const ASKED: &str = "CONF:AXES?";
        let said = self.ask(ASKED)?;
        let named = |axis: &Axis| said.split(',').any(|word| word.trim() == axis.word());
        let axes: Vec<_> = [Axis::X, Axis::Y].into_iter().filter(named).collect();
        match axes.is_empty() {
            true => Err(self.stranger(ASKED, &said)),
            false => Ok(axes),
        }
    }

    fn uncertainty_deg(&mut self) -> Result<Option<f64>, MotorError> {
        let said = self.number("CONF:UNC?")?;
        Ok(Some(said).filter(|deg| *deg > 0.0))
    }

    fn turn(
        &mut self,
        axis: Axis,
        deg: f64,
        wait: &mut dyn FnMut() -> bool,
    ) -> Result<(), MotorError> {
        const STANDS: &str = "*OPC?";
        let order = format!("POS:{} {deg:.4}", axis.word());
        self.say(&order)?;
        if let Some(said) = self.error()? {
            return Err(MotorError::Refused(self.name.clone(), order, said));
        }
        let said = self.ask_while(STANDS, MOVE, wait)?;
        if said != "1" {
            return Err(self.stranger(STANDS, &said));
        }
        let at = self.position_deg(axis)?;
        if (at - deg).abs() > NEAR_DEG {
            return Err(MotorError::Elsewhere(self.name.clone(), deg, at));
        }
        Ok(())
    }

    fn position_deg(&mut self, axis: Axis) -> Result<f64, MotorError> {
        self.number(&format!("POS:{}?", axis.word()))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;

    /// A motor's other end: what it answers to each line, in order.
    struct Script {
        answers: VecDeque<&'static str>,
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
                let answer = self.answers.pop_front().unwrap_or("");
                self.said.extend(answer.bytes());
            }
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn motor(answers: &[&'static str]) -> ScpiMotor {
        let script = Script {
            answers: answers.iter().copied().collect(),
            said: VecDeque::new(),
        };
        ScpiMotor::over(Box::new(script), "m")
    }

    #[test]
    fn it_turns_and_waits_and_asks_where_it_is() {
        let mut motor = motor(&["0,\"No error\"\n", "1\n", "30.001\r\n", "30.002\n"]);
        motor.turn(Axis::X, 30.0, &mut || true).unwrap();
        assert_eq!(motor.position_deg(Axis::X).unwrap(), 30.002);
    }

    #[test]
    fn errors_say_what_was_asked_and_what_came() {
        let told = |answers: &[&'static str]| {
            let turned = motor(answers).turn(Axis::Y, 5.0, &mut || true);
            turned.unwrap_err().to_string()
        };
        let refused = told(&["-222,\"Data out of range\"\n"]);
        assert!(
            refused.contains("refuses \"POS:PITCH 5.0000\": -222"),
            "{refused}"
        );
        assert!(told(&["hello\n"]).contains("by \"hello\""));
        assert!(told(&["0\n", "1\n", "9.7\n"]).contains("stands at 9.700 deg"));
        assert!(told(&["0\n", "1\n"]).contains("is gone"));
        assert!(told(&["0\n", "1\n", "NaN\n"]).contains("by \"NaN\""));
    }

    #[test]
    fn a_jammed_motor_is_waited_for_as_long_as_somebody_waits() {
        let mut glances = 0;
        let mut wait = || {
            glances += 1;
            glances < 4
        };
        let turned = motor(&["0\n", "", ""]).turn(Axis::X, 5.0, &mut wait);
        assert!(matches!(turned, Err(MotorError::Ended)));
        assert_eq!(glances, 4);
    }

    #[test]
    fn an_address_that_is_none_says_how_one_is_written() {
        for bad in ["", "motor", "tcp://a/b:1", "serial:///dev/x?baud=fast"] {
            let error = ScpiMotor::connect(bad).err().unwrap().to_string();
            assert!(error.contains("tcp://HOST:PORT"), "{error}");
        }
    }

    #[test]
    fn axes_are_those_that_it_names() {
        let axes = |said| motor(&[said]).axes();
        assert_eq!(axes("PITCH,ROLL\n").unwrap(), [Axis::X, Axis::Y]);
        assert_eq!(axes("PITCH\n").unwrap(), [Axis::Y]);
        assert!(axes("YAW\n").is_err());
    }
}
