//! What turns the housing: a motor with a known angle that is spoken to in lines.
//!
//! In: an axis and an angle in degrees. Out: the housing stands there, or why not. The lines are
//! words after the manner of SCPI over TCP or a serial port (docs/motor.md), which
//! `plumb serve --motor` understands.
//!
//! Left out: whether the housing shakes, which the sensor itself tells.

use std::time::Duration;

use crate::scpi::{Device, DeviceError, Scpi};

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

/// How long a move may take.
const MOVE: Duration = Duration::from_secs(120);

/// So much next to where it was sent a motor may stand, deg.
const NEAR_DEG: f64 = 0.5;

/// A motor that the housing is mounted on, or anything else with known angles.
#[derive(Debug)]
pub struct Motor {
    scpi: Scpi,
}

impl Motor {
    /// Connects to `tcp://HOST:PORT`, `HOST:PORT` or `serial://PATH?baud=RATE`.
    ///
    /// Errors: [`DeviceError::Address`], [`DeviceError::Connect`].
    pub fn connect(url: &str) -> Result<Self, DeviceError> {
        let scpi = Scpi::connect(Device::Motor, url)?;
        Ok(Self { scpi })
    }

    /// Who it is, as it goes into the report.
    ///
    /// Errors: see [`DeviceError`].
    pub fn identity(&mut self) -> Result<String, DeviceError> {
        self.scpi.identity()
    }

    /// The axes that it turns without the housing being mounted anew.
    ///
    /// Errors: see [`DeviceError`].
    pub fn axes(&mut self) -> Result<Vec<Axis>, DeviceError> {
        const ASKED: &str = "CONF:AXES?";
        let said = self.scpi.ask(ASKED)?;
        let named = |axis: &Axis| said.split(',').any(|word| word.trim() == axis.word());
        let axes: Vec<_> = [Axis::X, Axis::Y].into_iter().filter(named).collect();
        match axes.is_empty() {
            true => Err(self.scpi.stranger(ASKED, &said)),
            false => Ok(axes),
        }
    }

    /// Standard uncertainty (k = 1) of its angles in deg; `None` when it does not report it.
    ///
    /// Errors: see [`DeviceError`].
    pub fn uncertainty_deg(&mut self) -> Result<Option<f64>, DeviceError> {
        let said = self.scpi.number("CONF:UNC?")?;
        Ok(Some(said).filter(|deg| *deg > 0.0))
    }

    /// Turns to `deg` and returns when it stands there. `wait` is called again and again
    /// meanwhile; when it is false, nobody waits any longer.
    ///
    /// Errors: see [`DeviceError`].
    pub fn turn(
        &mut self,
        axis: Axis,
        deg: f64,
        wait: &mut dyn FnMut() -> bool,
    ) -> Result<(), DeviceError> {
        const STANDS: &str = "*OPC?";
        self.scpi.order(&format!("POS:{} {deg:.4}", axis.word()))?;
        let said = self.scpi.ask_while(STANDS, MOVE, wait)?;
        if said != "1" {
            return Err(self.scpi.stranger(STANDS, &said));
        }
        let at = self.position_deg(axis)?;
        if (at - deg).abs() > NEAR_DEG {
            return Err(DeviceError::Elsewhere(self.scpi.peer(), deg, at));
        }
        Ok(())
    }

    /// Where it stands by its own measure, deg: the reference of the calibration.
    ///
    /// Errors: see [`DeviceError`].
    pub fn position_deg(&mut self, axis: Axis) -> Result<f64, DeviceError> {
        self.scpi.number(&format!("POS:{}?", axis.word()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scpi::script;

    fn motor(answers: &[&'static str]) -> Motor {
        let scpi = script::device(Device::Motor, answers);
        Motor { scpi }
    }

    #[test]
    fn it_turns_and_waits_and_asks_where_it_is() {
        let mut motor = motor(&["0,\"No error\"\n", "1\n", "30.001\r\n", "30.002\n"]);
        motor.turn(Axis::X, 30.0, &mut || true).unwrap();
        assert_eq!(motor.position_deg(Axis::X).unwrap(), 30.002);
    }

    #[test]
    fn errors_state_what_was_asked_and_what_came() {
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
        assert!(matches!(turned, Err(DeviceError::Ended(_))));
        assert_eq!(glances, 4);
    }

    #[test]
    fn axes_are_those_that_it_names() {
        let axes = |said| motor(&[said]).axes();
        assert_eq!(axes("PITCH,ROLL\n").unwrap(), [Axis::X, Axis::Y]);
        assert_eq!(axes("PITCH\n").unwrap(), [Axis::Y]);
        assert!(axes("YAW\n").is_err());
    }
}
