//! Whether a node's heartbeat stayed away.
//!
//! In: the moments of its heartbeats. Out: since when it was away, when it has come back late.
//! The supervision starts with the first heartbeat (CiA 301, 7.2.8.3.2.2). Late is more than
//! [`LIMIT_NS`], as delivered (1016h), and more than two and a half periods of a node that was
//! given a longer one, which shows in the first ones of the log. Where the whole bus was silent it
//! was the log that stood still, and nobody's heartbeat.

use super::gaps::GAP_NS;
use super::instrument::Moment;

/// As delivered (1016h), ns.
const LIMIT_NS: u64 = 500_000_000;

/// The period is the shortest of so many.
const FIRST: u8 = 5;

/// The heartbeat of one node.
#[derive(Clone, Copy, Debug, Default)]
pub struct Heartbeat {
    last_ns: Option<u64>,
    shortest_ns: Option<u64>,
    counted: u8,
    /// The bus was silent since the last one.
    blind: bool,
}

impl Heartbeat {
    /// The bus was silent for longer than a gap takes.
    pub const fn bus_was_silent(&mut self) {
        self.blind = true;
    }

    /// Takes a heartbeat, or the end of the log; since when it was away, when it was.
    pub fn take(&mut self, at: Moment) -> Option<u64> {
        let last_ns = self.last_ns.replace(at.now_ns)?;
        let since_ns = at.now_ns.saturating_sub(last_ns);
        let blind = std::mem::take(&mut self.blind);
        if blind || at.now_ns.saturating_sub(at.before_ns) > GAP_NS {
            return None;
        }
        let learning = self.counted < FIRST;
        if learning {
            self.counted += 1;
            let shortest_ns = self.shortest_ns.unwrap_or(since_ns);
            self.shortest_ns = Some(shortest_ns.min(since_ns));
        }
        let shortest_ns = self.shortest_ns.unwrap_or_default();
        let limit_ns = LIMIT_NS.max(shortest_ns.saturating_mul(5) / 2);
        (since_ns > limit_ns).then_some(last_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn at(now_ms: u64) -> Moment {
        Moment {
            now_ns: now_ms * MS,
            before_ns: now_ms.saturating_sub(10) * MS,
        }
    }

    #[test]
    fn half_a_second_without_is_a_loss_and_a_slow_one_is_none() {
        let mut heartbeat = Heartbeat::default();
        let beats = [0, 200, 400, 600, 1200, 1400];
        let lost = beats.map(|ms| heartbeat.take(at(ms)));
        assert_eq!(lost, [None, None, None, None, Some(600 * MS), None]);
        let mut slow = Heartbeat::default();
        let lost = [0, 1000, 2000, 3000, 6000].map(|ms| slow.take(at(ms)));
        assert_eq!(lost, [None, None, None, None, Some(3000 * MS)]);
    }

    #[test]
    fn a_log_that_stood_still_is_nobodys_loss() {
        let mut heartbeat = Heartbeat::default();
        heartbeat.take(at(0));
        heartbeat.take(at(200));
        heartbeat.bus_was_silent();
        assert_eq!(heartbeat.take(at(60_000)), None);
        assert_eq!(heartbeat.take(at(60_200)), None);
    }
}
