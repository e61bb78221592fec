//! The virtual climatic chamber around the virtual housing.
//!
//! In: lines of the words in docs/chamber.md. Out: answers, and another temperature of the air,
//! which the sensors follow ([`sim::chamber`]). It is the chamber that the word `temp` sets as
//! well.
//!
//! Left out: who is connected (`line_port`), overshoot, and the error of the chamber's own
//! thermometer: the instrument is characterised by the sensors'.

use super::line_port::{Answer, Error, LineDevice, UNDEFINED, number};
use crate::words::line::AIR_DEGC;
use crate::world::stage::Stage;

/// The chamber's words.
#[derive(Debug)]
pub struct Climate;

impl LineDevice for Climate {
    fn model(&self) -> &'static str {
        "Virtual chamber"
    }

    fn obey(&mut self, words: &[&str], stage: &mut Stage) -> Result<Answer, Error> {
        let (low, high) = (*AIR_DEGC.start(), *AIR_DEGC.end());
        let said = match words {
            ["CONF:RANG?"] => format!("{low:.1},{high:.1}"),
            ["TEMP:SETP", to] => {
                stage.chamber.set_point(number(to, low, high)?);
                return Ok(Answer::Nothing);
            }
            ["TEMP:SETP?"] => format!("{:.2}", stage.chamber.asked_c()),
            ["TEMP?"] => format!("{:.2}", stage.chamber.air_c),
            ["TEMP:STAB?"] => u8::from(stage.chamber.arrived()).to_string(),
            _ => return Err(UNDEFINED),
        };
        Ok(Answer::Line(said))
    }
}

#[cfg(test)]
mod tests {
    use super::super::line_port::Lines;
    use super::*;
    use sim::network::Network;

    #[test]
    fn the_air_goes_where_it_is_told_and_is_stable_when_it_is_there() {
        let mut stage = Stage::new(Network::new(250_000, 1), 1);
        stage.chamber_speed = 60.0;
        let mut lines = Lines::new(Box::new(Climate), 1);
        let mut said = |line: &str, stage: &mut Stage| lines.hear(line, stage);
        let line = |text: &str| Answer::Line(text.to_owned());
        assert_eq!(said("temp:setp 15", &mut stage), Answer::Nothing);
        assert_eq!(said("TEMP:SETP?", &mut stage), line("15.00"));
        assert_eq!(said("TEMP:STAB?", &mut stage), line("0"));
        // Ten degrees at 2 degC/min, sixty times as fast.
        stage.run_until(4_000_000_000);
        assert_eq!(said("TEMP:STAB?", &mut stage), line("0"));
        stage.run_until(5_200_000_000);
        assert_eq!(said("TEMP:STAB?", &mut stage), line("1"));
        assert_eq!(said("TEMP?", &mut stage), line("15.00"));
        assert_eq!(said("TEMP:SETP 86", &mut stage), Answer::Nothing);
        assert_eq!(
            said("SYST:ERR?", &mut stage),
            line("-222,\"Data out of range\"")
        );
    }
}
