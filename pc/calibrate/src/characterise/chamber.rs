//! What keeps the air around the instrument at a temperature: a chamber, or a person at one.
//!
//! In: a set point in degC. Out: the air's temperature as the chamber states it, and whether it is
//! stable. [`Chamber`] is what another chamber has to do; [`ScpiChamber`] does it in words after
//! the manner of SCPI over TCP or a serial port (docs/chamber.md), which `plumb serve --chamber`
//! understands; [`HandChamber`] asks a person.
//!
//! Left out: how long a temperature is kept, and whether the sensors have followed (`hold`).

use super::air::Air;
use super::profile::REFERENCE_C;
use crate::console::{Answer, Console};
use crate::scpi::{Device, DeviceError, Scpi};

/// Temperatures that no chamber of air has, degC: below and above them a reading is nonsense.
const POSSIBLE_DEGC: std::ops::RangeInclusive<f64> = -100.0..=200.0;

/// How a chamber is named to a person.
const BY_HAND: &str = "a chamber set by hand";

/// A chamber around the instrument.
pub trait Chamber {
    /// Who it is, as it goes into the report.
    ///
    /// Errors: see [`DeviceError`].
    fn identity(&mut self) -> Result<String, DeviceError>;

    /// The lowest and the highest set point, degC; `None` where it does not report them.
    ///
    /// Errors: see [`DeviceError`].
    fn range_degc(&mut self) -> Result<Option<[f64; 2]>, DeviceError>;

    /// Asks for another temperature of the air, degC. `wait` is called again and again where this
    /// takes its time; when it is false, nobody waits any longer.
    ///
    /// Errors: see [`DeviceError`].
    fn set(&mut self, degc: f64, wait: &mut dyn FnMut() -> bool) -> Result<(), DeviceError>;

    /// What the air is like now.
    ///
    /// Errors: see [`DeviceError`].
    fn air(&mut self) -> Result<Air, DeviceError>;

    /// Leaves the chamber near room temperature when the run has ended early, as far as it can be
    /// reached.
    fn leave(&mut self);
}

/// A chamber that is spoken to in lines.
#[derive(Debug)]
pub struct ScpiChamber {
    scpi: Scpi,
}

impl ScpiChamber {
    /// Connects to `tcp://HOST:PORT`, `HOST:PORT` or `serial://PATH?baud=RATE`.
    ///
    /// Errors: [`DeviceError::Address`], [`DeviceError::Connect`].
    pub fn connect(url: &str) -> Result<Self, DeviceError> {
        let scpi = Scpi::connect(Device::Chamber, url)?;
        Ok(Self { scpi })
    }

    fn told(&self, degc: f64) -> Result<f64, DeviceError> {
        match POSSIBLE_DEGC.contains(&degc) {
            true => Ok(degc),
            false => Err(DeviceError::Nonsense(self.scpi.peer(), degc)),
        }
    }
}

fn order(degc: f64) -> String {
    format!("TEMP:SETP {degc:.2}")
}

impl Chamber for ScpiChamber {
    fn identity(&mut self) -> Result<String, DeviceError> {
        self.scpi.identity()
    }

    fn range_degc(&mut self) -> Result<Option<[f64; 2]>, DeviceError> {
        let said = self.scpi.ask("CONF:RANG?")?;
        let number = |text: &str| text.trim().parse().ok().filter(|n: &f64| n.is_finite());
        let ends = said.split_once(',');
        let ends = ends.and_then(|(low, high)| Some([number(low)?, number(high)?]));
        match ends {
            Some([low, high]) if low < high => Ok(Some([low, high])),
            _ => Err(DeviceError::Range(self.scpi.peer(), said)),
        }
    }

    fn set(&mut self, degc: f64, _: &mut dyn FnMut() -> bool) -> Result<(), DeviceError> {
        self.scpi.order(&order(degc))
    }

    fn air(&mut self) -> Result<Air, DeviceError> {
        const STABLE: &str = "TEMP:STAB?";
        let degc = self.scpi.number("TEMP?")?;
        let degc = self.told(degc)?;
        let said = self.scpi.ask(STABLE)?;
        let stable = match said.as_str() {
            "0" => false,
            "1" => true,
            _ => return Err(self.scpi.stranger(STABLE, &said)),
        };
        Ok(Air {
            degc: Some(degc),
            stable,
        })
    }

    fn leave(&mut self) {
        // Whatever ended the run is told; a chamber that can't be reached may be that itself.
        let _ = self.scpi.order(&order(REFERENCE_C));
    }
}

/// A person who sets a chamber and says when its air is stable.
pub struct HandChamber<'a> {
    /// Who answers.
    pub console: &'a Console,
    /// Where requests go.
    pub tell: &'a dyn Fn(&str),
}

impl Chamber for HandChamber<'_> {
    fn identity(&mut self) -> Result<String, DeviceError> {
        Ok(BY_HAND.to_owned())
    }

    fn range_degc(&mut self) -> Result<Option<[f64; 2]>, DeviceError> {
        Ok(None)
    }

    fn set(&mut self, degc: f64, wait: &mut dyn FnMut() -> bool) -> Result<(), DeviceError> {
        (self.tell)(&format!(
            "set the chamber to {degc} degC; press Enter when its air is stable there"
        ));
        match self.console.wait_while(wait) {
            Some(Answer::Done) => Ok(()),
            Some(Answer::Ended) | None => Err(DeviceError::Unset),
        }
    }

    fn air(&mut self) -> Result<Air, DeviceError> {
        Ok(Air {
            degc: None,
            stable: true,
        })
    }

    fn leave(&mut self) {
        (self.tell)(&format!("set the chamber to {REFERENCE_C} degC"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scpi::script;

    fn chamber(answers: &[&str]) -> ScpiChamber {
        let scpi = script::device(Device::Chamber, answers);
        ScpiChamber { scpi }
    }

    #[test]
    fn it_reports_what_its_air_is_like() {
        let mut chamber = chamber(&["0,\"No error\"\n", "-9.98\n", "0\r\n", "-10.0\n", "1\n"]);
        chamber.set(-10.0, &mut || true).unwrap();
        let air = |degc, stable| Air {
            degc: Some(degc),
            stable,
        };
        assert_eq!(chamber.air().unwrap(), air(-9.98, false));
        assert_eq!(chamber.air().unwrap(), air(-10.0, true));
    }

    #[test]
    fn nonsense_is_told_in_a_sentence() {
        let told = |answers: &[&str]| chamber(answers).air().unwrap_err().to_string();
        assert!(told(&["9999\n"]).contains("an air temperature of 9999 degC"));
        assert!(told(&["-273.15\n"]).contains("which is none"));
        assert!(told(&["NaN\n"]).contains("by \"NaN\""));
        assert!(told(&["ERR\n"]).contains("by \"ERR\""));
        assert!(told(&["20\n", "yes\n"]).contains("by \"yes\""));
        assert!(told(&["20\n"]).contains("is gone"));
        assert!(told(&[]).contains("is gone"));
    }

    #[test]
    fn a_range_is_two_temperatures() {
        let range = |said| chamber(&[said]).range_degc();
        assert_eq!(range("-40.0, 85\n").unwrap(), Some([-40.0, 85.0]));
        for bad in ["85\n", "85,-40\n", "a,b\n", "nan,85\n", "\n"] {
            let told = range(bad).unwrap_err().to_string();
            assert!(told.contains("two temperatures belong there"), "{told}");
        }
    }
}
