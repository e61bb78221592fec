//! One channel of a recording with a fault on it, as the instrument's own channel would have it.
//!
//! In: the rows of a [`Prepared`] recording in their time, and a [`SensorFault`] from some moment
//! on. Out: the [`Observation`] of any instant: reading, vector, and the energy at the upper end
//! of the band against the noise that this part had at its standstills.
//!
//! Left out: what needs the part itself. A register cannot be read back from a recording, so a
//! brown-out is seen by its silence alone.

use instant::Instant;
use sim::fault::{OnCounts, SensorFault};
use sim::rng::Rng;
use tilt::chain::{Chain, ChainState, Invalid};
use tilt::health::{self, Health};
use tilt::observation::Observation;
use tilt::sample::{Counts, FullScale};

use super::super::prepare::Prepared;
use super::super::recording::Row;

/// The range that the parts of the recording were set to: a count there is a count here.
pub const RANGE: FullScale = FullScale::G16;

/// The noise density that [`OnCounts`] takes a part to have, g/rtHz.
const DENSITY_G: f64 = 90e-6;

/// A channel under its head. A copy goes on from where the original was.
#[derive(Clone)]
pub struct Channel<'a> {
    chain: &'a Chain,
    rows: &'a [Row],
    offset_us: u64,
    health: Health,
    state: ChainState,
    watch: health::HealthState,
    next: usize,
    fault: Option<OnCounts>,
}

impl<'a> Channel<'a> {
    /// At the beginning of the recording, without a fault.
    pub fn new(prepared: &'a Prepared, chain: &'a Chain) -> Self {
        let noise = chain.calibration.budget.noise;
        Self {
            chain,
            rows: prepared.fed(),
            offset_us: prepared.offset_us,
            health: Health::new(noise, RANGE, chain.period_us),
            state: ChainState::default(),
            watch: health::HealthState::default(),
            next: 0,
            fault: None,
        }
    }

    /// Noise of a single sample of one axis at standstill, g.
    pub fn noise_g(&self) -> f64 {
        f64::from(self.chain.calibration.budget.noise) / f64::from(tilt::ONE_G)
    }

    /// The same channel, with a fault that begins at `from`.
    pub fn with(&self, fault: SensorFault, from: Instant, rng: Rng) -> Self {
        // `OnCounts` has the noise by its density and the rate. This part has more, so it is
        // given the rate at which the density comes to the noise that was measured.
        let rate_hz = 2.0 * (self.noise_g() / DENSITY_G).powi(2);
        Self {
            fault: Some(OnCounts::new(fault, from.0 as f64 / 1e6, rate_hz, rng)),
            ..self.clone()
        }
    }

    /// What the channel reports at `now`, a SYNC; instants must not go back.
    pub fn observe(&mut self, now: Instant) -> Observation {
        self.feed_until(now);
        let activity = self.health.take_activity(&mut self.watch);
        let (reading, vector) = if self.health.stuck(&self.watch) {
            (Observation::absent(Invalid::Stuck).reading, None)
        } else {
            self.chain.reading_and_vector(&self.state, now)
        };
        Observation {
            reading,
            vector,
            activity,
            turned: None,
        }
    }

    fn feed_until(&mut self, now: Instant) {
        while let Some(row) = self.rows.get(self.next) {
            let at = Instant(row.time_us.saturating_add(self.offset_us));
            if at > now {
                return;
            }
            self.next += 1;
            if let Some((counts, captured)) = self.disturbed(row.counts(RANGE), at) {
                self.take(counts, captured);
            }
        }
    }

    fn disturbed(&mut self, counts: Counts, at: Instant) -> Option<(Counts, Instant)> {
        let Some(fault) = &mut self.fault else {
            return Some((counts, at));
        };
        let per_g = f64::from(RANGE.counts_per_g());
        let (captured_s, codes) = fault.apply(at.0 as f64 / 1e6, counts.0, per_g)?;
        Some((Counts(codes), Instant((captured_s * 1e6).round() as u64)))
    }

    fn take(&mut self, counts: Counts, captured: Instant) {
        let newest = self.state.filtered().map(|(_, at)| at);
        let age_us = newest.map_or(0, |at| captured.micros_since(at));
        if 2 * age_us > 3 * i64::from(self.chain.period_us) {
            self.health.restart(&mut self.watch);
        }
        self.health.sample(&mut self.watch, counts);
        self.chain.sample(&mut self.state, counts, captured);
    }
}
