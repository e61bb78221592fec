//! For how long both channels could be compared.
//!
//! In: when TPDO 1 of each channel and SYNC are heard. Out: a clock that goes on with each SYNC at
//! which both channels showed their angles, by no more than 50 ms, from the fourth on.
//! Maintenance of one node is single-channel operation (docs/safety.md): what begins meanwhile is
//! found when both are back.
//!
//! Left out: why a channel shows none.

use crate::trial::CHANNELS;

/// The slowest SYNC of which the reaction time is promised, s.
const MOST_S: f64 = 0.050;
/// A channel that showed its angles no longer ago than so many SYNCs takes part.
const SYNCS: usize = 2;
/// After a return the reaction time counts from this SYNC on: the age of what the peer sends has to
/// be found first (docs/safety.md).
const AGAIN: u32 = 4;

/// The clock.
#[derive(Clone, Debug, Default)]
pub struct Exposure {
    compared_s: f64,
    /// The newest SYNCs, the newest first, s.
    syncs_s: [f64; SYNCS],
    shown_s: [f64; CHANNELS],
    /// SYNCs in a row at which both showed their angles.
    together: u32,
}

impl Exposure {
    /// A channel shows its angles, valid or not.
    pub fn slopes(&mut self, at_s: f64, channel: usize) {
        self.shown_s[channel] = at_s;
    }

    /// SYNC.
    pub fn sync(&mut self, at_s: f64) {
        let [newest_s, oldest_s] = self.syncs_s;
        let both = self.shown_s.iter().all(|shown_s| *shown_s >= oldest_s);
        self.together = if both {
            self.together.saturating_add(1)
        } else {
            0
        };
        if self.together > AGAIN {
            self.compared_s += (at_s - newest_s).min(MOST_S);
        }
        self.syncs_s = [at_s, newest_s];
    }

    /// The time so far in which both could be compared, s.
    pub fn compared_s(&self) -> f64 {
        self.compared_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(exposure: &mut Exposure, from_s: f64, channels: &[usize], period_s: f64) {
        for sync in 0..50 {
            let at_s = from_s + period_s * f64::from(sync);
            exposure.sync(at_s);
            for channel in channels {
                exposure.slopes(at_s + 0.003, *channel);
            }
        }
    }

    #[test]
    fn time_counts_while_both_show_their_angles_and_no_more_of_a_slow_sync() {
        let mut exposure = Exposure::default();
        run(&mut exposure, 1.0, &[0, 1], 0.020);
        let both_s = exposure.compared_s();
        assert!((0.85..0.95).contains(&both_s), "{both_s}");
        run(&mut exposure, 2.0, &[1], 0.020);
        let one_s = exposure.compared_s() - both_s;
        assert!(one_s < 0.07, "{one_s}");
        run(&mut exposure, 3.0, &[0, 1], 0.200);
        let slow_s = exposure.compared_s() - both_s - one_s;
        assert!((2.1..2.3).contains(&slow_s), "{slow_s}");
    }
}
