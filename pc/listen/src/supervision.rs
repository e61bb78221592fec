//! Whether a node's heartbeat stays away: the one rule for a bus while it lives and for its logs.
//!
//! In: the times of its heartbeats, and holes in the log. Out: since when it is lost, and how often
//! it was. Supervision begins with the first heartbeat (CiA 301, 7.2.8.3.2.2). A heartbeat is lost
//! when none follows for the consumer time, as delivered (1016h) or by the data sheet, and for two
//! and a half periods of a node that was given a longer one: the shortest of its first periods.
//! These are measured anew when a lost one comes back, so that a period that was changed is one or
//! two losses, and after a restart.
//!
//! Left out: what time it is (`Watch`).

/// While the period isn't measured, ns.
const UNKNOWN_NS: u64 = 5_000_000_000;

/// The period is the shortest of so many.
const MEASURED: u8 = 5;

/// The heartbeat of one node.
#[derive(Clone, Debug)]
pub struct Heartbeat {
    /// Its limit is not less; 0 for a heartbeat that is not supervised.
    least_ns: u64,
    /// It is lost when it stays away for longer.
    limit_ns: u64,
    /// The latest one, or the end of a hole in the log behind it.
    since_ns: Option<u64>,
    /// The latest one where the next period counts from it.
    period_from_ns: Option<u64>,
    measured: u8,
    is_lost: bool,
    losses: u32,
}

impl Heartbeat {
    /// Before the first one; with the time after which it is lost at the earliest, ms, 0 for never.
    pub fn new(lost_after_ms: u32) -> Self {
        let least_ns = u64::from(lost_after_ms) * 1_000_000;
        Self {
            least_ns,
            limit_ns: least_ns.max(UNKNOWN_NS),
            since_ns: None,
            period_from_ns: None,
            measured: 0,
            is_lost: false,
            losses: 0,
        }
    }

    /// Takes a heartbeat or boot-up message; the time since when it was lost, where it was.
    pub(crate) fn take(&mut self, time_ns: u64, is_boot_up: bool) -> Option<u64> {
        let before_ns = self.since_ns.replace(time_ns);
        let was_lost = std::mem::take(&mut self.is_lost);
        self.measure(time_ns, is_boot_up);
        if was_lost {
            self.measured = 0;
        }
        before_ns.filter(|_| was_lost)
    }

    fn measure(&mut self, time_ns: u64, is_boot_up: bool) {
        if is_boot_up {
            // The period begins with the start, not with its message.
            (self.measured, self.limit_ns) = (0, self.least_ns.max(UNKNOWN_NS));
            self.period_from_ns = None;
            return;
        }
        let Some(from_ns) = self.period_from_ns.replace(time_ns) else {
            return;
        };
        if self.measured < MEASURED {
            let period_ns = time_ns.saturating_sub(from_ns);
            // As the nodes supervise each other as delivered.
            let limit_ns = self.least_ns.max(period_ns.saturating_mul(5) / 2);
            let is_first = self.measured == 0;
            self.limit_ns = if is_first {
                limit_ns
            } else {
                self.limit_ns.min(limit_ns)
            };
            self.measured += 1;
        }
    }

    /// When it counts as lost, unless another one comes; `None` before the first one, where it is
    /// not supervised, and while it is lost.
    pub(crate) fn deadline_ns(&self) -> Option<u64> {
        let since_ns = self
            .since_ns
            .filter(|_| !self.is_lost && self.least_ns > 0)?;
        Some(since_ns.saturating_add(self.limit_ns))
    }

    /// It is later than the deadline.
    pub(crate) const fn lose(&mut self) {
        self.is_lost = true;
        self.losses += 1;
    }

    /// The log has a hole that ends now, or its time has gone back: what was not seen in it is not
    /// lost.
    pub(crate) fn excuse(&mut self, now_ns: u64) {
        self.period_from_ns = None;
        if let (Some(since_ns), false) = (&mut self.since_ns, self.is_lost) {
            *since_ns = now_ns;
        }
    }

    /// The last one before it was lost, ns; `None` while it comes and before the first one.
    pub const fn lost_since_ns(&self) -> Option<u64> {
        if self.is_lost { self.since_ns } else { None }
    }

    /// How often it was lost.
    pub const fn losses(&self) -> u32 {
        self.losses
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Since when it was lost at each of these heartbeats, ms.
    fn lost(heartbeat: &mut Heartbeat, beats_ms: &[u64]) -> Vec<Option<u64>> {
        let beats = beats_ms.iter().map(|ms| {
            let is_late = |deadline_ns| ms * MS > deadline_ns;
            if heartbeat.deadline_ns().is_some_and(is_late) {
                heartbeat.lose();
            }
            heartbeat.take(ms * MS, false).map(|ns| ns / MS)
        });
        beats.collect()
    }

    #[test]
    fn half_a_second_without_is_a_loss_and_a_slow_one_is_none() {
        let mut heartbeat = Heartbeat::new(500);
        let found = lost(&mut heartbeat, &[0, 200, 400, 600, 1200, 1400]);
        assert_eq!(found, [None, None, None, None, Some(600), None]);
        let mut slow = Heartbeat::new(500);
        let found = lost(&mut slow, &[0, 1000, 2000, 3000, 6000]);
        assert_eq!(found, [None, None, None, None, Some(3000)]);
        assert_eq!(slow.losses(), 1);
    }

    #[test]
    fn a_data_sheet_states_the_least_and_whether_it_is_supervised() {
        let mut quick = Heartbeat::new(250);
        assert_eq!(lost(&mut quick, &[0, 100, 400]), [None, None, Some(100)]);
        let mut slow = Heartbeat::new(2500);
        assert_eq!(lost(&mut slow, &[0, 1000, 3400]), [None; 3]);
        let mut never = Heartbeat::new(0);
        assert_eq!(lost(&mut never, &[0, 100, 90_000]), [None; 3]);
    }

    #[test]
    fn a_period_that_was_changed_is_lost_until_it_is_measured() {
        let mut heartbeat = Heartbeat::new(500);
        let found = lost(&mut heartbeat, &[0, 200, 400, 2400, 4400, 6400, 8400]);
        assert_eq!(found[3..], [Some(400), Some(2400), None, None]);
        let quick = lost(&mut heartbeat, &[8600, 8800, 9000, 10_000]);
        assert_eq!(quick, [None, None, None, Some(9000)]);
    }

    #[test]
    fn a_heartbeat_slower_than_the_first_patience_was_lost_for_ever() {
        let mut heartbeat = Heartbeat::new(500);
        let found = lost(&mut heartbeat, &[0, 8000, 16_000, 24_000]);
        assert_eq!(found, [None, Some(0), None, None]);
    }

    #[test]
    fn a_start_begins_anew_and_a_hole_in_the_log_is_no_loss() {
        let mut heartbeat = Heartbeat::new(500);
        lost(&mut heartbeat, &[0, 200]);
        heartbeat.take(300 * MS, true);
        // Another period since the start, the first of it short.
        assert_eq!(lost(&mut heartbeat, &[310, 1310, 2310]), [None; 3]);
        heartbeat.excuse(60_000 * MS);
        assert_eq!(lost(&mut heartbeat, &[60_900, 61_900]), [None; 2]);
        assert_eq!(heartbeat.lost_since_ns(), None);
    }
}
