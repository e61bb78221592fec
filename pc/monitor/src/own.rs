//! Frames of our own, and the time at which they went out on the adapter's clock.
//!
//! In: what was sent and received, and when on this computer's clock. Out: each frame that was
//! sent with a time that fits between those received before and after it. An adapter's clock may
//! be another one than this computer's, so a frame waits until the adapter has told the time.
//!
//! Left out: reading of clocks.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use canopen::Frame;

use super::feed::as_ns;

/// Where the adapter's clock is known, a frame waits no longer than this for the next reception.
const PATIENCE: Duration = Duration::from_millis(200);

/// Frames that wait at most: of SYNCs each ms, those of a minute.
const MOST: usize = 1 << 16;

/// Frames that were sent and have no time yet.
#[derive(Debug, Default)]
pub struct Own {
    waiting: VecDeque<(Instant, Frame)>,
    /// The latest time on the adapter's clock, ns, and when it was told.
    clock: Option<(u64, Instant)>,
}

impl Own {
    /// A frame was sent.
    pub fn sent(&mut self, at: Instant, frame: Frame) {
        self.waiting.push_back((at, frame));
    }

    /// A frame that the adapter has stamped has come: those sent before it, with their times.
    pub fn received(&mut self, time_ns: u64, at: Instant) -> Vec<(u64, Frame)> {
        let before_ns = self.clock.map_or(0, |(before_ns, _)| before_ns);
        self.clock = Some((time_ns, at));
        // Where the adapter's time has gone back, nothing before it bounds anything.
        let least_ns = if before_ns <= time_ns { before_ns } else { 0 };
        let stamp = |(sent, frame): (Instant, Frame)| {
            let since_ns = as_ns(at.saturating_duration_since(sent));
            (time_ns.saturating_sub(since_ns).max(least_ns), frame)
        };
        self.waiting.drain(..).map(stamp).collect()
    }

    /// Nothing has come: those that have waited long enough. Before the adapter has told the time
    /// they wait on, unless there are very many of them.
    pub fn waited(&mut self, now: Instant, host_ns: u64) -> Vec<(u64, Frame)> {
        let mut ready = Vec::new();
        while let Some((sent, _)) = self.waiting.front() {
            let age = now.saturating_duration_since(*sent);
            let is_late = self.clock.is_some() && age >= PATIENCE;
            if !is_late && self.waiting.len() <= MOST {
                break;
            }
            ready.extend(self.stamp_first(now, host_ns));
        }
        ready
    }

    /// The end: all that is left, by this computer's clock where the adapter has told none.
    pub fn rest(&mut self, now: Instant, host_ns: u64) -> Vec<(u64, Frame)> {
        let count = self.waiting.len();
        (0..count)
            .filter_map(|_| self.stamp_first(now, host_ns))
            .collect()
    }

    fn stamp_first(&mut self, now: Instant, host_ns: u64) -> Option<(u64, Frame)> {
        let (sent, frame) = self.waiting.pop_front()?;
        let time_ns = match self.clock {
            Some((ns, at)) => ns.saturating_add(as_ns(sent.saturating_duration_since(at))),
            None => host_ns.saturating_sub(as_ns(now.saturating_duration_since(sent))),
        };
        Some((time_ns, frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn start() -> Frame {
        Frame::data_frame(0, &[1, 1])
    }

    fn times(frames: &[(u64, Frame)]) -> Vec<u64> {
        frames.iter().map(|(time_ns, _)| *time_ns).collect()
    }

    #[test]
    fn own_frames_were_stamped_by_another_clock_than_all_others() {
        let (mut own, now) = (Own::default(), Instant::now());
        let after = |ms| now + Duration::from_millis(ms);
        own.sent(now, start());
        own.sent(after(3), start());
        assert!(own.waited(after(900), 7_000_000 * MS).is_empty());
        // The adapter's clock is an hour off; nobody knew before it has told.
        let ready = own.received(3_600_000 * MS, after(1000));
        assert_eq!(times(&ready), [3_599_000 * MS, 3_599_003 * MS]);
        own.sent(after(1010), start());
        let ready = own.received(3_600_020 * MS, after(1025));
        assert_eq!(times(&ready), [3_600_005 * MS]);
    }

    #[test]
    fn an_own_frame_is_never_older_than_what_came_before_it() {
        let (mut own, now) = (Own::default(), Instant::now());
        let after = |ms| now + Duration::from_millis(ms);
        own.received(5000 * MS, now);
        own.sent(after(10), start());
        // The frame behind it was read late: it is older than it seems.
        let ready = own.received(5001 * MS, after(50));
        assert_eq!(times(&ready), [5000 * MS]);
    }

    #[test]
    fn where_nothing_comes_an_own_frame_does_not_wait_for_ever() {
        let (mut own, now) = (Own::default(), Instant::now());
        let after = |ms| now + Duration::from_millis(ms);
        own.received(5000 * MS, now);
        own.sent(after(10), start());
        assert!(own.waited(after(100), 0).is_empty());
        assert_eq!(times(&own.waited(after(210), 0)), [5010 * MS]);
        assert!(own.rest(after(211), 0).is_empty());
    }

    #[test]
    fn on_a_bus_where_nothing_came_at_all_the_end_takes_this_computers_clock() {
        let (mut own, now) = (Own::default(), Instant::now());
        own.sent(now, start());
        let ready = own.rest(now + Duration::from_millis(40), 1000 * MS);
        assert_eq!(times(&ready), [960 * MS]);
    }

    #[test]
    fn frames_that_nobody_answers_do_not_fill_the_memory() {
        let (mut own, now) = (Own::default(), Instant::now());
        for _ in 0..MOST + 5 {
            own.sent(now, start());
        }
        assert_eq!(own.waited(now, MS).len(), 5);
    }
}
