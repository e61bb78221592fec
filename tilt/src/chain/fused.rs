//! The chain's readings where a gyroscope helps: the angle of two instants, and its uncertainty.
//!
//! In: samples with a rate of turn. Out: the aligned [`Reading`], which belongs to the instant
//! that [`Fusion::latency_us`] gives, so that two channels can be compared, and the reading of this
//! very moment, which lies up to one sample ahead of the last one; and the rate of turn.
//!
//! Both lie on the line through the verticals of the last two samples. Ahead of them that line
//! misses half of what the rate changes by: at 500 deg/s^2 it is 0.002 deg after a sample.
//!
//! Left out: instruments of one axis and tables. Neither has the acceleration on all three axes,
//! which the vertical takes, so they go without the gyroscope.

use super::{Calibration, Chain, ChainState, Correction, Estimates, Measurement, Reading};
use super::{Invalid, Stamped, interpolate};
use crate::angle::{Axes, Harmonics, beside, slopes_beside};
use crate::composition::{Composition, Place};
use crate::filter::Filtered;
use crate::fusion::{Fusion, FusionState};
use crate::motion::{Rate, Vertical};
use crate::sample::{RateCounts, Temperature};
use crate::temperature::TemperatureModel;
use crate::turned::Turned;
use crate::uncertainty::Uncertainty;
use crate::vector::Corrected;
use instant::Instant;

impl<C: Composition> Chain<C> {
    /// The fusion, where this chain has one that its calibration can feed: one of three axes, and
    /// of the gyroscope, without which a bias of 1 deg/s would be taken for a turn.
    fn fusion(&self) -> Option<(&Fusion, &C::Vector, &Axes<Harmonics>)> {
        let fusion = self.fusion.as_ref()?.get();
        self.calibration.rates.as_ref()?;
        match &self.calibration.correction {
            Correction::TwoAxis { vector, harmonics } => Some((fusion, vector, harmonics)),
            _ => None,
        }
    }

    /// Lets the vertical follow one sample; `missing` ones before it were filled.
    pub(super) fn fuse(
        &self,
        state: &mut ChainState<C>,
        accel: [i32; 3],
        rate: Option<RateCounts>,
        missing: u32,
    ) {
        let (Some(place), Some(counts)) = (&self.fusion, rate) else {
            return;
        };
        self.memorise(state, place.get().range.rate(counts));
        let Some((fusion, vector, _)) = self.fusion() else {
            return;
        };
        if self.temperature_of(state).is_err() {
            return;
        }
        let period_q8 = state.period_q8;
        if let Some(state) = &mut state.fusion {
            let state = state.get_mut();
            let compensated = state.compensation().apply(Filtered { accel });
            let accel = vector.get().apply(compensated);
            fusion.sample(state, accel, period_q8, missing);
        }
    }

    /// Keeps what the gyroscope read; what fusion remembers is made when it is first needed.
    fn memorise(&self, state: &mut ChainState<C>, rate: Rate) {
        if state.fusion.is_none() {
            self.begin(state);
        }
        if let Some(state) = &mut state.fusion {
            state.get_mut().memorise(rate);
        }
    }

    /// Makes what fusion remembers.
    ///
    /// Out of line: it goes over the stack once, and no sample after it needs that room.
    #[inline(never)]
    fn begin(&self, state: &mut ChainState<C>) {
        state.fusion = C::FusionState::put(FusionState::default);
        let temperature = self.temperature_of(state).unwrap_or(Temperature::REFERENCE);
        self.correct_rates(state, temperature);
    }

    /// The part's errors at the temperature that compensation uses from now on.
    pub(super) fn correct_rates(&self, state: &mut ChainState<C>, temperature: Temperature) {
        let (Some(fusion), Some(rates)) = (&self.fusion, &self.calibration.rates) else {
            return;
        };
        if let Some(state) = &mut state.fusion {
            let compensation = self.calibration.temperature.at(temperature);
            let state = state.get_mut();
            state.temperature(fusion.get(), rates.get(), compensation, temperature);
        }
    }

    /// The gap is too long: the vertical is found anew.
    pub(super) fn restart_fusion(state: &mut ChainState<C>) {
        if let Some(fusion) = &mut state.fusion {
            fusion.get_mut().restart();
        }
    }

    /// The sensor measures wrongly: what fusion has found with it is forgotten. Nothing where no
    /// gyroscope takes part.
    pub fn forget_motion(state: &mut ChainState<C>) {
        if let Some(fusion) = &mut state.fusion {
            fusion.get_mut().forget();
        }
    }

    /// The temperature that compensation uses.
    pub(super) fn temperature_of(&self, state: &ChainState<C>) -> Result<Temperature, Invalid> {
        match self.calibration.temperature {
            TemperatureModel::None => Ok(state.temperature().unwrap_or(Temperature::REFERENCE)),
            _ => state.temperature().ok_or(Invalid::NoTemperature),
        }
    }

    /// The angle of this very moment, ahead of the last sample by what has passed since; where
    /// there is no gyroscope, that of [`Chain::reading`].
    pub fn reading_now(&self, state: &ChainState<C>, now: Instant) -> Reading {
        let fused = self.fused(state, now, 0);
        fused.unwrap_or_else(|| self.reading(state, now))
    }

    /// The rate of turn about the housing's axes that the newest sample has shown: corrected, and
    /// not filtered.
    ///
    /// # Errors
    /// Why there is none, as with readings: [`Invalid::NotMeasured`] where no gyroscope takes part,
    /// and [`Invalid::OverRange`] where it is beyond its range on any axis.
    pub fn rate(&self, state: &ChainState<C>, now: Instant) -> Result<Rate, Invalid> {
        let (fusion, _, _) = self.fusion().ok_or(Invalid::NotMeasured)?;
        self.fresh(state, now)?;
        let rate = state.fusion.as_ref().ok_or(Invalid::NoSample)?.get().rate();
        if fusion.motion.reaches(rate) {
            Ok(rate)
        } else {
            Err(Invalid::OverRange)
        }
    }

    /// The aligned angle; `None` where no gyroscope takes part.
    pub(super) fn fused_reading(&self, state: &ChainState<C>, now: Instant) -> Option<Reading> {
        let (fusion, _, _) = self.fusion()?;
        self.fused(state, now, fusion.latency_us)
    }

    /// How far the gyroscope has turned up to the instant of the aligned angle, about the
    /// housing's axes; `None` where no gyroscope takes part, or something is missing since this was
    /// last asked for.
    pub fn take_turned(&self, state: &mut ChainState<C>, now: Instant) -> Option<Turned> {
        let (fusion, _, _) = self.fusion()?;
        let latest = self.fresh(state, now);
        let temperature = self.temperature_of(state);
        let state = state.fusion.as_mut()?.get_mut();
        let at = now.offset(-i64::from(fusion.latency_us));
        let (Ok(latest), Ok(temperature)) = (latest, temperature) else {
            state.interrupt_turned();
            return None;
        };
        let accel = self.calibration.budget.accel_at_rest(temperature);
        state.take_turned(fusion, latest.at.micros_since(at), accel)
    }

    /// The calibrated acceleration behind the low-pass, as [`Chain::reading_and_vector`] has it
    /// beside an angle without the gyroscope.
    pub(super) fn vector(&self, state: &ChainState<C>, now: Instant) -> Option<Corrected> {
        let (_, vector, _) = self.fusion()?;
        let (filtered, temperature, _) = self.take(state, now).ok()?;
        let compensated = self.calibration.temperature.apply(filtered, temperature);
        Some(vector.get().apply(compensated))
    }

    fn fused(&self, state: &ChainState<C>, now: Instant, latency_us: u32) -> Option<Reading> {
        let (fusion, _, harmonics) = self.fusion()?;
        let at = now.offset(-i64::from(latency_us));
        let found = self.vertical_at(fusion, state, now, at);
        let found = found.map(|(vertical, temperature)| {
            let accel = self.calibration.budget.accel_at_rest(temperature);
            self.calibration.slopes(vertical, harmonics, accel)
        });
        let reading = match found {
            Err(reason) => Axes {
                x: Err(reason),
                y: Err(reason),
            },
            Ok(estimates) => estimates.map(|found| Measurement {
                angle: found.angle,
                uncertainty: found.unshared.combined_with(found.motion),
                unshared: found.unshared,
                at,
                latency_us,
            }),
        };
        Some(reading)
    }

    /// The vertical at `at` on the line through the last two.
    fn vertical_at(
        &self,
        fusion: &Fusion,
        state: &ChainState<C>,
        now: Instant,
        at: Instant,
    ) -> Result<(Vertical, Temperature), Invalid> {
        let latest = self.fresh(state, now)?;
        let previous = state.previous.ok_or(Invalid::Settling)?;
        let temperature = self.temperature_of(state)?;
        let state = state.fusion.as_ref().ok_or(Invalid::NoSample)?.get();
        let [before, last] = state.verticals(fusion)?;
        let stamped = |vertical: Vertical, at| Stamped {
            filtered: Filtered { accel: vertical.up },
            at,
        };
        let (before, last_stamped) = (stamped(before, previous.at), stamped(last, latest.at));
        let up = interpolate(before, last_stamped, at).ok_or(Invalid::Stale)?;
        let vertical = Vertical {
            up: up.accel,
            ..last
        };
        Ok((vertical, temperature))
    }
}

impl<C: Composition> Calibration<C> {
    /// Slopes of a vertical; `accel` is the standard uncertainty of the calibration, 2^-26 g.
    fn slopes(&self, vertical: Vertical, harmonics: &Axes<Harmonics>, accel: u32) -> Estimates {
        // From 2^-30 to 2^-26 per step, the unit of an acceleration of 1 g.
        let vector = Corrected {
            accel: vertical.up.map(|up| (up + 8) >> 4),
        };
        let beside = beside(vector);
        let raw = slopes_beside(vector, beside);
        let unshared = self.budget.of_vectors(beside, accel);
        // What contradicts is so much more than the rest that it may contain that once more.
        let motion = match vertical.uncertainty == vertical.unshared {
            true => Uncertainty(0),
            false => vertical.uncertainty,
        };
        let found = |angle, unshared: Uncertainty| {
            Ok(super::AngleEstimate {
                angle,
                unshared: unshared.combined_with(vertical.unshared),
                motion,
            })
        };
        Axes {
            x: found(harmonics.x.apply_to_slope(raw.x), unshared.x),
            y: found(harmonics.y.apply_to_slope(raw.y), unshared.y),
        }
    }
}
