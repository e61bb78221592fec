//! What is told by EMCY is taken back once, when it has gone.
//!
//! In: every EMCY and boot-up. Out: a violation for a fault that is told twice without having
//! gone, for code 0000h when nothing has gone, and for a fault that stands at the end. Several
//! faults may go with one 0000h; the set of faults in each message shows which. A boot-up takes
//! everything back.
//!
//! The first two are asked for on a sound bus only: a channel that can't send keeps the first and
//! the last message, not those between.
//!
//! Left out: communication errors (81xxh, 82xxh), which have no bit in the set: one of them only
//! excuses one 0000h without a change of the set.

use device::fault::Fault;

use super::{Rule, Violation};
use crate::trial::CHANNELS;
use crate::trial::message::Emergency;

/// What the rule remembers.
#[derive(Clone, Debug)]
pub struct Emergencies {
    strict: bool,
    /// Bits of the faults that were told and stand.
    open: [u32; CHANNELS],
    /// Communication errors told and not taken back.
    others: [u32; CHANNELS],
}

/// The bit of a code of the device's own; `None` for the stack's.
fn bit(code: u16) -> Option<u32> {
    let of = |fault: &Fault| fault.report().0 == code;
    Fault::ALL.iter().find(|f| of(f)).map(|f| 1 << *f as u8)
}

impl Emergencies {
    /// `strict` on a sound bus.
    pub fn new(strict: bool) -> Self {
        Self {
            strict,
            open: [0; CHANNELS],
            others: [0; CHANNELS],
        }
    }

    /// A channel has started anew.
    pub fn forget(&mut self, channel: usize) {
        self.open[channel] = 0;
        self.others[channel] = 0;
    }

    /// One EMCY.
    pub fn see(&mut self, at_s: f64, channel: usize, told: &Emergency) -> Option<Violation> {
        let open = self.open[channel];
        let problem = match (told.code, bit(told.code)) {
            (0, _) if open & !told.faults != 0 => None,
            (0, _) if self.others[channel] > 0 => {
                self.others[channel] -= 1;
                None
            }
            (0, _) => Some("0000h, and nothing has gone"),
            (_, Some(bit)) if open & bit != 0 => Some("reported twice"),
            (_, Some(bit)) => {
                self.open[channel] |= bit;
                None
            }
            (_, None) => {
                self.others[channel] += 1;
                None
            }
        };
        if told.code == 0 {
            self.open[channel] &= told.faults;
        }
        let problem = problem.filter(|_| self.strict)?;
        Some(Violation {
            rule: Rule::UnpairedEmergency,
            at_s,
            channel,
            what: format!("EMCY {:04X}h, set {:X}h: {problem}", told.code, told.faults),
        })
    }

    /// The run is over and everything well: what stands?
    pub fn end(&mut self, at_s: f64) -> Vec<Violation> {
        // A shock at the last moment may stand, since motion beyond full scale is no fault of the
        // part; so may what the paper's rule asks for, which the machine of a trial doesn't follow.
        let passing = [
            Fault::SensorOverRange,
            Fault::StopMotion,
            Fault::PhysicalFault,
        ];
        let passing = passing
            .map(|f| 1 << f as u8)
            .iter()
            .fold(0, |all, bit| all | bit);
        let standing = |channel: usize| {
            let open = self.open[channel] & !passing;
            (open != 0).then(|| Violation {
                rule: Rule::UnpairedEmergency,
                at_s,
                channel,
                what: format!("faults {open:X}h were never taken back"),
            })
        };
        (0..CHANNELS).filter_map(standing).collect()
    }
}
