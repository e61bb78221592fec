//! The independent watchdog.
//!
//! In: loads, stores, time of the world (its oscillator is its own). Out: when it bites.
//!
//! Source: RM0008 19.3 and 19.4; LSI 40 kHz, 30 to 60 (data sheet 5.3.7). Left out: freezing
//! by the debugger, the option byte that starts it, and the time that PR and RLR take to be taken.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 00h | KR | RM0008 19.4.1 |
//! | 04h | PR | 19.4.2 |
//! | 08h | RLR | 19.4.3 |

/// The registers and where it stands.
#[derive(Clone, Debug)]
pub struct Watchdog {
    /// Its oscillator, Hz; another one on each part.
    lsi_hz: u32,
    unlocked: bool,
    pr: u32,
    rlr: u32,
    /// When it bites, ns; `None` until it is started.
    bites_ns: Option<u64>,
}

impl Watchdog {
    /// Stopped, of an oscillator of so many Hz.
    pub fn new(lsi_hz: u32) -> Self {
        Self {
            lsi_hz,
            unlocked: false,
            pr: 0,
            rlr: 0xFFF,
            bites_ns: None,
        }
    }

    /// As after a reset: stopped.
    pub fn reset(&mut self) {
        *self = Self::new(self.lsi_hz);
    }

    /// When it bites unless it is fed, ns.
    pub fn bites_ns(&self) -> Option<u64> {
        self.bites_ns
    }

    /// From a full counter to 0: prescaler 4 to 256, RLR + 1 counts (19.3, table 96).
    fn period_ns(&self) -> u64 {
        let counts = u64::from(self.rlr + 1) << (2 + self.pr.min(6));
        counts * 1_000_000_000 / u64::from(self.lsi_hz.max(1))
    }

    /// A load; `offset` from 4000 3000h.
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x04 => self.pr,
            0x08 => self.rlr,
            _ => 0,
        }
    }

    /// A store at `now_ns`.
    pub fn write(&mut self, offset: u32, value: u32, now_ns: u64) {
        // The upper half of KR is reserved; the bridge fills it for a store of a half-word.
        match (offset, value & 0xFFFF) {
            // 19.4.1.
            (0x00, 0x5555) => self.unlocked = true,
            (0x00, 0xCCCC) => {
                self.unlocked = false;
                self.bites_ns.get_or_insert(now_ns + self.period_ns());
            }
            (0x00, 0xAAAA) => {
                self.unlocked = false;
                let fed_ns = now_ns + self.period_ns();
                self.bites_ns = self.bites_ns.map(|_| fed_ns);
            }
            (0x00, _) => self.unlocked = false,
            (0x04, _) if self.unlocked => self.pr = value & 7,
            (0x08, _) if self.unlocked => self.rlr = value & 0xFFF,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_stored_as_a_half_word_was_taken_for_none() {
        let mut dog = Watchdog::new(40_000);
        dog.write(0x00, 0xCCCC_CCCC, 0);
        assert!(dog.bites_ns().is_some());
    }

    #[test]
    fn it_bites_unless_it_is_fed() {
        let mut dog = Watchdog::new(40_000);
        dog.write(0x04, 4, 0);
        assert_eq!(dog.read(0x04), 0);
        for (offset, value) in [(0, 0x5555), (0x04, 4), (0x08, 624), (0, 0xCCCC)] {
            dog.write(offset, value, 0);
        }
        // 625 counts of 64 / 40 kHz: 1 s.
        assert_eq!(dog.bites_ns(), Some(1_000_000_000));
        dog.write(0, 0xAAAA, 900_000_000);
        assert_eq!(dog.bites_ns(), Some(1_900_000_000));
        dog.reset();
        dog.write(0, 0xAAAA, 0);
        assert_eq!(dog.bites_ns(), None);
    }
}
