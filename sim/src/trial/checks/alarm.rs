//! Without a fault nobody is accused.
//!
//! In: states and EMCY, and whether there is reason for them. Out: a violation for the first
//! accusation of each channel in each time without reason.

use device::fault::Fault;

use super::{Rule, Violation};
use crate::trial::CHANNELS;
use crate::trial::message::Emergency;

/// States (2021h) that accuse somebody.
const ACCUSING: std::ops::RangeInclusive<u8> = 6..=9;

/// Faults that a healthy instrument never has. Motion may drive a part beyond full scale, and the
/// paper's rule may find a physical fault in what its tables leave (errata E7, E11).
const NEVER: [Fault; 8] = [
    Fault::SensorSupply,
    Fault::SensorBus,
    Fault::SensorSilent,
    Fault::CalibrationRecord,
    Fault::Disagree,
    Fault::OwnChannel,
    Fault::PeerChannel,
    Fault::NoChannel,
];

/// What the rule remembers.
#[derive(Clone, Debug, Default)]
pub struct Alarms {
    /// Nobody may be accused now.
    quiet: bool,
    told: [bool; CHANNELS],
}

impl Alarms {
    /// From now on there is a reason.
    pub fn expect(&mut self) {
        self.quiet = false;
    }

    /// From now on there is none.
    pub fn forbid(&mut self) {
        if !self.quiet {
            self.told = [false; CHANNELS];
        }
        self.quiet = true;
    }

    /// A channel shows a state.
    pub fn state(&mut self, at_s: f64, channel: usize, state: u8) -> Option<Violation> {
        let accuses = ACCUSING.contains(&state);
        accuses.then(|| self.alarm(at_s, channel, format!("state {state}")))?
    }

    /// A channel sends an EMCY.
    pub fn emergency(&mut self, at_s: f64, channel: usize, told: &Emergency) -> Option<Violation> {
        let fault = NEVER
            .into_iter()
            .find(|f| told.faults >> *f as u8 & 1 == 1)?;
        let (code, reason) = (told.code, told.reason);
        let what = format!("EMCY {code:04X}h with {fault:?}, reason {reason}");
        self.alarm(at_s, channel, what)
    }

    fn alarm(&mut self, at_s: f64, channel: usize, what: String) -> Option<Violation> {
        if !self.quiet || std::mem::replace(&mut self.told[channel], true) {
            return None;
        }
        Some(Violation {
            rule: Rule::FalseAlarm,
            at_s,
            channel,
            what,
        })
    }
}
