//! Plays recordings through their chains, in the time of the recordings.
//!
//! In: one or two [`Prepared`] recordings with a [`Chain`] each. Out: at each instant, the readings
//! of all channels, as the instrument would have had them then: a row is fed when its time has
//! come and not before. Product mode is read at 50 Hz. Paper mode is read at each row of channel
//! 1, and at its pace where its rows fail to come. Time goes on until the last row of either
//! recording, so that a channel that falls silent is seen. Hours in which nothing was recorded at
//! all are stepped over.

use instant::Instant;
use tilt::chain::{Chain, ChainState, Measurement, Reading};
use tilt::sample::{FullScale, Temperature};

use super::arguments::Mode;
use super::prepare::Prepared;
use super::recording::{GAP_PERIODS, Row};
use super::tuning;
use output::progress::Progress;

/// Time between readings in product mode, microseconds.
const READ_EVERY_US: u64 = 20_000;

/// A silence of all recordings is played this far from either end, microseconds.
const SILENCE_US: u64 = 10_000_000;

/// Readings between two words to the progress bar.
const ADVANCE: u64 = 5000;

/// One recording under its head. The faster of two is held back by [`tuning::held_back_us`].
struct Tape<'a> {
    chain: &'a Chain,
    rows: &'a [Row],
    range: FullScale,
    offset_us: u64,
    held_back_us: u32,
    state: ChainState,
    next: usize,
    last_us: u64,
}

impl<'a> Tape<'a> {
    fn new(channel: &'a Prepared, chain: &'a Chain, held_back_us: u32) -> Self {
        Self {
            chain,
            rows: channel.fed(),
            range: chain.full_scale,
            offset_us: channel.offset_us,
            held_back_us,
            state: ChainState::default(),
            next: 0,
            last_us: channel.offset_us,
        }
    }

    /// The time of the next row, on the common clock.
    fn next_us(&self) -> Option<u64> {
        let row = self.rows.get(self.next)?;
        Some(row.time_us.saturating_add(self.offset_us))
    }

    fn end_us(&self) -> u64 {
        let last = self.rows.last().map_or(0, |row| row.time_us);
        last.saturating_add(self.offset_us)
    }

    /// Feeds what has come until `now_us` and reads.
    fn read_at(&mut self, now_us: u64) -> Reading {
        let held_back_us = self.held_back_us;
        let Some(then_us) = now_us.checked_sub(u64::from(held_back_us)) else {
            return self.chain.reading(&self.state, Instant(now_us));
        };
        self.feed_until(then_us);
        let reading = self.chain.reading(&self.state, Instant(then_us));
        reading.map(|measurement| Measurement {
            latency_us: measurement.latency_us.saturating_add(held_back_us),
            ..measurement
        })
    }

    fn feed_until(&mut self, now_us: u64) {
        while let (Some(row), Some(at_us)) = (self.rows.get(self.next), self.next_us()) {
            if at_us > now_us {
                return;
            }
            self.feed(row, Instant(at_us));
            self.next += 1;
            self.last_us = at_us;
        }
    }

    fn feed(&mut self, row: &Row, at: Instant) {
        if row.starts_anew {
            // The temperature has not gone while nobody looked; it is smoothed on.
            let temperature = self.state.temperature();
            self.state = ChainState::default();
            temperature.into_iter().for_each(|t| self.warm(t));
        }
        if let Some(celsius) = row.temperature_c {
            // A float to integer cast stops at the ends of the range; the chain has its own.
            self.warm(Temperature((celsius * 256.0).round() as i32));
        }
        self.chain
            .sample(&mut self.state, row.counts(self.range), at);
    }

    fn warm(&mut self, temperature: Temperature) {
        self.chain.temperature(&mut self.state, temperature);
    }
}

/// What is read at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// The instant, on the common clock.
    pub now: Instant,
    /// Channel 1.
    pub own: Reading,
    /// Channel 2, where there is one.
    pub peer: Option<Reading>,
}

/// Plays all channels and hands each moment to `see`.
pub fn play(
    channels: &[Prepared],
    chains: &[Chain],
    mode: Mode,
    progress: &Progress,
    mut see: impl FnMut(Moment),
) {
    let common_us = tuning::common_latency_us(chains);
    let mut tapes = channels
        .iter()
        .zip(chains)
        .map(|(channel, chain)| Tape::new(channel, chain, tuning::held_back_us(chain, common_us)));
    let Some(mut own) = tapes.next() else { return };
    let mut peer = tapes.next();
    let end_us = own.end_us().max(peer.as_ref().map_or(0, Tape::end_us));
    let task = progress.task("Playing", end_us / READ_EVERY_US);
    let mut now_us = 0;
    let mut count: u64 = 0;
    let mut told_us = 0;
    while now_us <= end_us {
        see(Moment {
            now: Instant(now_us),
            own: own.read_at(now_us),
            peer: peer.as_mut().map(|peer| peer.read_at(now_us)),
        });
        count += 1;
        if count.is_multiple_of(ADVANCE) {
            task.advance((now_us - told_us) / READ_EVERY_US);
            told_us = now_us;
        }
        now_us = next_instant(now_us, mode, &own, peer.as_ref());
    }
}

fn next_instant(now_us: u64, mode: Mode, own: &Tape, peer: Option<&Tape>) -> u64 {
    let period_us = u64::from(own.chain.period_us).max(1);
    let soon = |at_us: &u64| *at_us <= now_us.saturating_add(GAP_PERIODS * period_us);
    let next_us = match mode {
        Mode::Product => now_us + READ_EVERY_US,
        Mode::Paper => own
            .next_us()
            .filter(soon)
            .unwrap_or(now_us.saturating_add(period_us)),
    };
    let last_us = own.last_us.max(peer.map_or(0, |peer| peer.last_us));
    let coming = [own.next_us(), peer.and_then(Tape::next_us)];
    match coming.into_iter().flatten().min() {
        Some(row_us) if now_us > last_us + SILENCE_US && row_us > next_us + SILENCE_US => {
            (row_us - SILENCE_US).next_multiple_of(READ_EVERY_US)
        }
        _ => next_us,
    }
}

#[cfg(test)]
#[path = "play_tests.rs"]
pub mod tests;
