//! The whole way from counts to a reading: filter, temperature, correction, angle, uncertainty.
//!
//! In: [`Counts`] with the time of their capture, and now and then a [`Temperature`]. Out, at any
//! instant asked for: a [`Reading`], which is a [`Measurement`] or an [`Invalid`] reason per axis.
//!
//! R7 fixes the order: acquisition, low-pass, temperature, table (or vector), angle.
//!
//! # Time
//! What comes out of a filter is old by its delay, and two channels with clocks of their own
//! differ in age. [`Timing::Aligned`] therefore interpolates between the last two filtered
//! samples so that the reading belongs to exactly `now - latency`, the same instant in every
//! channel (erratum E11: 5 ms of skew alone fires the paper's rule at 80 deg/s).
//! [`Timing::AsItArrives`] is the paper's text: the newest sample, whatever its age. Both declare
//! their latency (erratum E2: at 80 deg/s the paper's filter alone lags 0.64 deg).
//!
//! The part's rate is off by several per cent, so the period is measured by capture times.
//!
//! Left out: reading the part, and judging one channel by the other (`cross_check`).

mod fused;

use crate::ONE_G;
use crate::angle::{Angle, Axes, Harmonics, beside, hypot, slopes_beside, turn};
use crate::composition::{Composition, Place, Whole};
use crate::filter::{FilterState, Filtered, LowPass, scale};
use crate::fusion::MeasuredSum;
use crate::motion::Rate;
use crate::root::root;
use crate::sample::{Counts, FullScale, Sample, Temperature};
use crate::saturate::saturate;
use crate::table::{Rule, Table};
use crate::temperature::{Compensated, TemperatureModel};
use crate::uncertainty::{Budget, Uncertainty};
use crate::vector::{Corrected, Vector};
use instant::Instant;

/// Why there is no angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Invalid {
    /// No sample has come since the start.
    NoSample,
    /// The filter has not settled since the start, or since a gap.
    Settling,
    /// Samples have stopped coming: the newest is older than four periods.
    Stale,
    /// The part was at its full scale within the filter's memory, so the mean is not to be had.
    OverRange,
    /// The temperature is not known yet.
    NoTemperature,
    /// This instrument does not measure this axis.
    NotMeasured,
    /// The part has lost its set-up: a brown-out or an upset. Needs a reset.
    PartReset,
    /// The part does not answer as itself on its bus.
    Bus,
    /// The part's codes repeat as no living part's do.
    Stuck,
    /// The channel is noisier than it is and than the other channel.
    Noise,
    /// Single samples are far off, in this channel only.
    Spikes,
    /// The part's temperature jumps as no die's can.
    Thermometer,
    /// This channel moved while the other one stood, or at standstill its gravity is of the wrong
    /// length.
    Biased,
    /// The calibration in memory is not the one that was loaded.
    Corrupt,
    /// Nothing has come from the channel in time.
    Silent,
    /// What has come from the channel belongs to the past.
    Late,
    /// The channels differ and it is not known which is right.
    Refused,
    /// The other channel has not been heard yet.
    Unconfirmed,
    /// The other channel is faulty, and this one must not go on alone.
    Alone,
    /// Both channels measure alike and are set to show different angles.
    Unlike,
    /// The standard uncertainty is above the limit that the user has set.
    Uncertain,
}

impl Invalid {
    /// True for what passes by itself within the filter's memory, or a start of the other channel,
    /// and accuses nobody.
    pub const fn is_transient(self) -> bool {
        matches!(
            self,
            Self::NoSample
                | Self::Settling
                | Self::OverRange
                | Self::NoTemperature
                | Self::Unconfirmed
                | Self::Uncertain
        )
    }

    /// True for what is over when its cause is: data that did not come, or came late. Nothing
    /// that was measured was wrong.
    pub const fn passes_with_its_cause(self) -> bool {
        self.is_transient() || matches!(self, Self::Stale | Self::Silent | Self::Late)
    }

    /// True where nothing was heard in time of a channel that may well have measured.
    pub const fn is_unheard(self) -> bool {
        matches!(self, Self::Silent | Self::Late)
    }

    /// True for a channel that gives wrong angles, which makes it differ from the other one. A
    /// channel that gives none, or is not heard, explains nothing of what was before.
    pub const fn measures_wrongly(self) -> bool {
        matches!(
            self,
            Self::Biased
                | Self::Corrupt
                | Self::Noise
                | Self::Spikes
                | Self::Stuck
                | Self::Thermometer
        )
    }
}

/// One axis measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measurement {
    /// The angle.
    pub angle: Angle,
    /// Its standard uncertainty (k = 1), the machine's own acceleration included as far as the
    /// vector's length shows it.
    pub uncertainty: Uncertainty,
    /// The part of it that another channel on the same housing does not share: all but motion.
    pub unshared: Uncertainty,
    /// The instant that the angle belongs to, on the device's clock.
    pub at: Instant,
    /// From `at` to when the reading was asked for, in microseconds.
    pub latency_us: u32,
}

/// What one channel reports at one instant.
pub type Reading = Axes<Result<Measurement, Invalid>>;

/// What the chain estimates behind the low-pass, without time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AngleEstimate {
    /// The angle.
    pub angle: Angle,
    /// Uncertainty of this channel alone.
    pub unshared: Uncertainty,
    /// Uncertainty by the machine's motion; the tables of paper mode cannot see it and give 0.
    pub motion: Uncertainty,
}

impl AngleEstimate {
    const fn spread(&self) -> (u32, u32) {
        (self.unshared.0, self.motion.0)
    }
}

/// How the compensated acceleration becomes an angle.
#[derive(Clone, Debug, PartialEq)]
pub enum Correction<C: Composition = Whole> {
    /// Paper mode: a table for each axis, z ignored (R5, R6).
    Tables {
        /// One table per axis.
        tables: C::Tables,
        /// How they are read.
        rule: Rule,
    },
    /// Product mode, two axes: twelve parameters, three harmonics per axis.
    TwoAxis {
        /// The affine correction.
        vector: C::Vector,
        /// Harmonics of slope X and slope Y.
        harmonics: Axes<Harmonics>,
    },
    /// Product mode, one axis over 360 deg: reported as axis X, axis Y is not measured.
    OneAxis {
        /// The affine correction.
        vector: C::Vector,
        /// Harmonics of the turn.
        harmonics: Harmonics,
    },
}

/// What a calibration leaves behind: the part of the configuration that belongs to one sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration<C: Composition = Whole> {
    /// Temperature compensation.
    pub temperature: TemperatureModel<C>,
    /// Acceleration to angle.
    pub correction: Correction<C>,
    /// Where the uncertainty comes from.
    pub budget: Budget,
    /// The gyroscope's errors; `None` where there is none, or nothing is known of it.
    pub rates: Option<C::Rates>,
}

impl Calibration {
    /// Of a part of which nothing is known: everything as the data sheet's typical part has it, and
    /// the data sheet's spread as its uncertainty.
    pub const NOMINAL: Self = Self {
        temperature: TemperatureModel::None,
        correction: Correction::NOMINAL,
        budget: Budget::DATA_SHEET,
        rates: None,
    };
}

impl<C: Composition> Calibration<C> {
    /// Back to [`Calibration::NOMINAL`], in its place.
    ///
    /// Field by field: a copy of the constant would be 3 kB of the part's flash, most of it zeros
    /// in the place of tables.
    pub fn reset(&mut self) {
        self.temperature = TemperatureModel::None;
        self.correction = C::uncalibrated();
        self.budget = Budget::DATA_SHEET;
        self.rates = None;
    }
}

impl Correction {
    /// Two axes of a perfect part.
    pub const NOMINAL: Self = Self::TwoAxis {
        vector: Vector::IDENTITY,
        harmonics: Axes {
            x: Harmonics {
                cosine: [0; 3],
                sine: [0; 3],
            },
            y: Harmonics {
                cosine: [0; 3],
                sine: [0; 3],
            },
        },
    };
}

/// Which instant a reading belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timing {
    /// The newest filtered sample, whatever its age: the paper to the letter.
    AsItArrives,
    /// Exactly this many microseconds before the reading is asked for.
    Aligned {
        /// The declared latency; must cover the delay of filter and part, about 24 ms at 400 Hz.
        latency_us: u32,
    },
}

/// The configuration of one channel's signal chain.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain<C: Composition = Whole> {
    /// The low-pass.
    pub filter: LowPass,
    /// Range of the part.
    pub full_scale: FullScale,
    /// Nominal time between samples.
    pub period_us: u32,
    /// Delay inside the part, in 1/65536 sample.
    pub part_delay_q16: u32,
    /// Which instant readings belong to.
    pub timing: Timing,
    /// How the vertical follows a gyroscope, where the part has one.
    pub fusion: Option<C::Fusion>,
    /// Correction for this part.
    pub calibration: Calibration<C>,
}

/// Delay of the part's internal second-order low-pass at ODR/2: sqrt(2) / pi sample \[ASSUME\].
///
/// 9.0 ms at 25 Hz (50 samples/s) and 1.13 ms at 200 Hz (400 samples/s).
pub const PART_DELAY_Q16: u32 = 29_502;

/// Samples after a start before a reading is valid: 0.32 s at 400 Hz, 0.64 s at 50 Hz.
const fn settling_samples(period_us: u32) -> u32 {
    if period_us > 10_000 { 32 } else { 128 }
}

/// Samples missing in a row that are filled by holding the last; more, and the filter restarts.
const MOST_FILLED: u32 = 3;

#[derive(Clone, Copy, Debug)]
struct Stamped {
    filtered: Filtered,
    at: Instant,
}

/// What a chain remembers between samples.
#[derive(Clone, Debug)]
pub struct ChainState<C: Composition = Whole> {
    filter: FilterState,
    latest: Option<Stamped>,
    previous: Option<Stamped>,
    input: [i32; 3],
    /// Measured time between samples in 1/256 us, 0 before the second sample.
    period_q8: u32,
    settling: u32,
    over_range: u32,
    /// Smoothed temperature in 1/65536 degC.
    temperature_q16: Option<i32>,
    filled: u32,
    fusion: Option<C::FusionState>,
}

impl<C: Composition> Default for ChainState<C> {
    // Out of line: inlined, a copy of the fusion's size lies on the stack of whoever starts.
    #[inline(never)]
    fn default() -> Self {
        Self {
            filter: FilterState::default(),
            latest: None,
            previous: None,
            input: [0; 3],
            period_q8: 0,
            settling: 0,
            over_range: 0,
            temperature_q16: None,
            filled: 0,
            fusion: None,
        }
    }
}

impl<C: Composition> ChainState<C> {
    /// The temperature that compensation uses, once one has been read.
    pub fn temperature(&self) -> Option<Temperature> {
        self.temperature_q16.map(|t| Temperature((t + 128) >> 8))
    }

    /// The newest filtered acceleration with its capture time: what a calibration memorises.
    pub fn filtered(&self) -> Option<(Filtered, Instant)> {
        self.latest.map(|s| (s.filtered, s.at))
    }

    /// The newest rate as the gyroscope read it, in its own axes: what its calibration memorises.
    pub fn measured_rate(&self) -> Option<Rate> {
        self.fusion.as_ref().map(|fusion| fusion.get().measured())
    }

    /// What the gyroscope has measured since the start, summed up; `None` before its first sample.
    pub fn measured_sum(&self) -> Option<MeasuredSum> {
        let sum = self.fusion.as_ref()?.get().measured_sum();
        let gaps = sum.gaps.wrapping_add(self.filled as u16);
        Some(MeasuredSum { gaps, ..sum })
    }

    /// Missing samples that were filled by holding the one before, since the start.
    pub fn filled(&self) -> u32 {
        self.filled
    }

    /// The measured time between samples in 1/256 us; 0 before the second sample.
    pub fn period_q8(&self) -> u32 {
        self.period_q8
    }
}

impl<C: Composition> Chain<C> {
    /// Takes in one temperature reading; smoothed over about eight readings.
    pub fn temperature(&self, state: &mut ChainState<C>, reading: Temperature) {
        let new = reading.0.clamp(-128 * 256, 127 * 256) << 8;
        state.temperature_q16 = Some(match state.temperature_q16 {
            None => new,
            Some(old) => old + (new - old) / 8,
        });
        self.correct_rates(state, state.temperature().unwrap_or(reading));
    }

    /// Takes in one sample captured at `at`.
    ///
    /// A sample that is not newer than the last is ignored. Up to three missing ones are filled by
    /// holding the last; a longer gap starts the filter anew.
    pub fn sample(&self, state: &mut ChainState<C>, sample: impl Into<Sample>, at: Instant) {
        let Sample { counts, rate } = sample.into();
        let input = scale(counts, self.full_scale);
        let missing = match state.latest.map(|s| at.micros_since(s.at)) {
            Some(elapsed) if elapsed <= 0 => return,
            Some(elapsed) => self.account(state, elapsed, input),
            None => self.start(state, input),
        };
        self.fuse(state, input, rate, missing);
        self.note_range(state, counts);
        state.input = input;
        state.previous = state.latest;
        state.latest = Some(Stamped {
            filtered: self.filter.step(&mut state.filter, input),
            at,
        });
        state.settling = state.settling.saturating_sub(1);
    }

    /// Starts the filter at `input`; no sample is missing before it.
    fn start(&self, state: &mut ChainState<C>, input: [i32; 3]) -> u32 {
        state.filter = FilterState::standing_at(input);
        state.settling = settling_samples(self.period_us);
        state.period_q8 = self.period_us.saturating_mul(256);
        state.latest = None;
        Self::restart_fusion(state);
        0
    }

    /// Follows the period and mends gaps; `elapsed` is positive. Gives the samples it filled.
    ///
    /// A gap of more than 8.3 s starts the filter anew whatever the period: up to there everything
    /// fits into 32 bits, which the chip divides by itself.
    fn account(&self, state: &mut ChainState<C>, elapsed: i64, input: [i32; 3]) -> u32 {
        let elapsed_q8 = match u32::try_from(elapsed) {
            Ok(elapsed) if elapsed < 1 << 23 => elapsed << 8,
            _ => return self.start(state, input),
        };
        let period = state.period_q8.max(1);
        // The sum is below 2^32, since half of any period is below 2^31.
        let steps = (elapsed_q8 + period / 2) / period;
        if steps > MOST_FILLED + 1 {
            return self.start(state, input);
        }
        if steps == 1 {
            // So the period is at most twice what has elapsed, and the difference has a sign.
            let late = elapsed_q8.wrapping_sub(period).cast_signed();
            // The first differences count more, so that the measured period is there in time.
            let change = if state.settling > 96 {
                late / 8
            } else {
                late / 32
            };
            state.period_q8 = period.wrapping_add_signed(change);
        }
        for _ in 1..steps {
            self.filter.step(&mut state.filter, state.input);
            state.filled = state.filled.saturating_add(1);
        }
        steps.saturating_sub(1)
    }

    fn note_range(&self, state: &mut ChainState<C>, counts: Counts) {
        // The top code of a 12-bit left-justified reading; 14-bit ones clip above it.
        const TOP: i16 = 32_752;
        let memory = settling_samples(self.period_us) / 2;
        let clipped = counts.0.iter().any(|&c| c >= TOP || c == i16::MIN);
        state.over_range = if clipped {
            memory
        } else {
            state.over_range.saturating_sub(1)
        };
    }

    /// Delay of part and filter in microseconds, by the measured period.
    pub fn delay_us(&self, state: &ChainState<C>) -> i64 {
        let samples = i64::from(self.filter.delay_q16()) + i64::from(self.part_delay_q16);
        (samples * i64::from(state.period_q8) + (1 << 23)) >> 24
    }

    /// The reading at `now`, belonging to the instant that [`Timing`] sets.
    pub fn reading(&self, state: &ChainState<C>, now: Instant) -> Reading {
        match self.fused_reading(state, now) {
            Some(fused) => fused,
            None => self.filtered_reading(state, now).0,
        }
    }

    /// The reading at `now`, and the calibrated acceleration that it came from where there is one:
    /// a calibration on three axes.
    pub fn reading_and_vector(
        &self,
        state: &ChainState<C>,
        now: Instant,
    ) -> (Reading, Option<Corrected>) {
        match self.fused_reading(state, now) {
            Some(fused) => (fused, self.vector(state, now)),
            None => self.filtered_reading(state, now),
        }
    }

    /// [`Chain::reading_and_vector`] without the gyroscope.
    fn filtered_reading(
        &self,
        state: &ChainState<C>,
        now: Instant,
    ) -> (Reading, Option<Corrected>) {
        match self.take(state, now) {
            Err(reason) => {
                let absent = Axes {
                    x: Err(reason),
                    y: Err(reason),
                };
                (absent, None)
            }
            Ok((filtered, temperature, at)) => {
                let latency_us = u32::try_from(now.micros_since(at)).unwrap_or(0);
                let (found, vector) = self.correct(filtered, temperature);
                let of_x = found.x.ok();
                let of_x = of_x.filter(|_| C::UNCERTAINTY);
                let of_x = of_x.map(|x| (x, x.unshared.combined_with(x.motion)));
                let reading = found.map(|found| Measurement {
                    angle: found.angle,
                    uncertainty: match of_x {
                        _ if !C::UNCERTAINTY => Uncertainty::UNKNOWN,
                        // As a rule both axes are worth the same, and a root is dear.
                        Some((x, whole)) if x.spread() == found.spread() => whole,
                        _ => found.unshared.combined_with(found.motion),
                    },
                    unshared: found.unshared,
                    at,
                    latency_us,
                });
                (reading, vector)
            }
        }
    }

    /// The newest sample, unless it is too old or too early.
    fn fresh(&self, state: &ChainState<C>, now: Instant) -> Result<Stamped, Invalid> {
        let latest = state.latest.ok_or(Invalid::NoSample)?;
        let age = now.micros_since(latest.at);
        if age > 4 * i64::from(self.period_us) {
            return Err(Invalid::Stale);
        }
        if state.settling > 0 {
            return Err(Invalid::Settling);
        }
        Ok(latest)
    }

    fn take(
        &self,
        state: &ChainState<C>,
        now: Instant,
    ) -> Result<(Filtered, Temperature, Instant), Invalid> {
        let latest = self.fresh(state, now)?;
        if state.over_range > 0 {
            return Err(Invalid::OverRange);
        }
        let temperature = self.temperature_of(state)?;
        let delay = self.delay_us(state);
        match self.timing {
            Timing::AsItArrives => Ok((latest.filtered, temperature, latest.at.offset(-delay))),
            Timing::Aligned { latency_us } => {
                let previous = state.previous.ok_or(Invalid::Settling)?;
                let at = now.offset(-i64::from(latency_us));
                let filtered = interpolate(previous, latest, at.offset(delay));
                Ok((filtered.ok_or(Invalid::Stale)?, temperature, at))
            }
        }
    }

    /// Angle and uncertainty of one filtered acceleration: everything behind the low-pass.
    pub fn evaluate(
        &self,
        filtered: Filtered,
        temperature: Temperature,
    ) -> Axes<Result<AngleEstimate, Invalid>> {
        self.correct(filtered, temperature).0
    }

    fn correct(
        &self,
        filtered: Filtered,
        temperature: Temperature,
    ) -> (Estimates, Option<Corrected>) {
        let compensated = self.calibration.temperature.apply(filtered, temperature);
        let accel = match C::UNCERTAINTY {
            true => self.calibration.budget.accel(&self.filter, temperature),
            false => 0,
        };
        self.calibration.correct(compensated, accel)
    }
}

impl<T, E> Axes<Result<T, E>> {
    /// Applies `f` to whichever axes have a value.
    pub fn map<U>(self, f: impl Fn(T) -> U) -> Axes<Result<U, E>> {
        Axes {
            x: self.x.map(&f),
            y: self.y.map(&f),
        }
    }
}

/// What is estimated on each axis.
type Estimates = Axes<Result<AngleEstimate, Invalid>>;

impl<C: Composition> Calibration<C> {
    fn correct(&self, input: Compensated, accel: u32) -> (Estimates, Option<Corrected>) {
        let budget = &self.budget;
        match &self.correction {
            Correction::Tables { tables, rule } => {
                let read = |table: &Table, a, across| {
                    if table.points().is_empty() {
                        return Err(Invalid::NotMeasured);
                    }
                    let unshared = || budget.of_table(table, *rule, a, with_leakage(accel, across));
                    Ok(AngleEstimate {
                        angle: table.look_up(a, *rule),
                        unshared: match C::UNCERTAINTY {
                            true => unshared(),
                            false => Uncertainty::UNKNOWN,
                        },
                        motion: Uncertainty(0),
                    })
                };
                let [x, y, _] = input.accel;
                let tables = tables.get();
                let sight = Axes {
                    x: read(&tables.x, x, y),
                    y: read(&tables.y, y, x),
                };
                (sight, None)
            }
            Correction::TwoAxis { vector, harmonics } => {
                let v = vector.get().apply(input);
                let beside = beside(v);
                let raw = slopes_beside(v, beside);
                let unshared = budget.of_vectors(beside, accel);
                let motion = budget.of_motion(v, accel);
                let found = |angle, unshared| {
                    Ok(AngleEstimate {
                        angle,
                        unshared,
                        motion,
                    })
                };
                let sight = Axes {
                    x: found(harmonics.x.apply_to_slope(raw.x), unshared.x),
                    y: found(harmonics.y.apply_to_slope(raw.y), unshared.y),
                };
                (sight, Some(v))
            }
            Correction::OneAxis { vector, harmonics } => {
                let v = vector.get().apply(input);
                // Nothing was calibrated about y, so only the plane of the turn is looked at.
                let [x, _, z] = v.accel;
                let plane = Corrected { accel: [x, 0, z] };
                let found = AngleEstimate {
                    angle: harmonics.apply(turn(v)),
                    unshared: budget
                        .of_vector(ONE_AXIS_NEVER_FOLDS, accel)
                        .combined_with(across(v)),
                    motion: budget.of_motion(plane, accel),
                };
                let sight = Axes {
                    x: Ok(found),
                    y: Err(Invalid::NotMeasured),
                };
                // The matrix is right only while the turn is the only tilt, so two healthy
                // channels differ in a vector that was tilted across.
                (sight, None)
            }
        }
    }
}

/// atan2(x, z) goes all the way round: there is no vertical at which it folds.
const ONE_AXIS_NEVER_FOLDS: i32 = i32::MAX;

/// What an axis across the one that turns reads where nothing is tilted across, at most: 60 mg by
/// its offset and its angles.
const LEVEL_ACROSS: u32 = (ONE_G as u64 * 60 / 1000) as u32;

/// What y adds to the angle of a turn in whose plane it has no place, as a standard uncertainty.
///
/// The part lies in the housing to about a degree, and its axes in the part to half of one
/// \[ASSUME\], so 2 % of y are in the plane, and no calibration by turning shows them. Up to
/// [`LEVEL_ACROSS`] counts as none.
fn across(vector: Corrected) -> Uncertainty {
    /// 2 % of a radian in steps of [`Angle`]: 2^32 / (2 pi) / 50.
    const SHARE: u64 = 13_671_306;
    const NONE: u64 = LEVEL_ACROSS as u64;
    let [x, y, z] = vector.accel;
    let y = u64::from(y.unsigned_abs());
    let beyond = u64::from(root((y * y).saturating_sub(NONE * NONE)));
    let plane = u64::from(hypot(x, z).unsigned_abs());
    let steps = (beyond * SHARE).checked_div(plane).unwrap_or(u64::MAX);
    Uncertainty(u32::try_from(steps).unwrap_or(u32::MAX))
}

/// `accel` and what the tilt of the axis `across` does to one of two tables, 2^-26 g as a standard
/// uncertainty.
///
/// Each table was made with the other axis level. By the angles of [`across`] an axis has 2 % of
/// the one across in it, and of z, of which less is left the more that one is tilted: together
/// 2.2 % of y sqrt(1 + y^2) and up.
fn with_leakage(accel: u32, across: i32) -> u32 {
    let square = |value: u32| u64::from(value) * u64::from(value);
    let y = square(across.unsigned_abs()).saturating_sub(square(LEVEL_ACROSS));
    if y == 0 {
        return accel;
    }
    // 2^-52 g^2 by 2^-26 g^2 twice; 2.2 % are the root of 1/2048.
    let leaked = y.saturating_add((y >> 26).saturating_mul(y >> 26)) >> 11;
    root(square(accel).saturating_add(leaked))
}

/// `a` / `b` in 1/65536, rounded towards 0; `None` for what does not fit or has no end.
fn quotient_q16(a: i64, b: i64) -> Option<i64> {
    if let (Ok(size), Ok(by)) = (u32::try_from(a.unsigned_abs()), u16::try_from(b))
        && by != 0
    {
        // Samples less than 65 ms apart: two divisions by the chip's own of 32 bits.
        let by = u32::from(by);
        let size = i64::from(size / by) << 16 | i64::from(((size % by) << 16) / by);
        return Some(if a < 0 { -size } else { size });
    }
    a.checked_mul(1 << 16)?.checked_div(b)
}

/// The filtered acceleration at `at` on the line through the last two samples.
///
/// `None` when `at` is more than two periods before the first or three after the second.
fn interpolate(previous: Stamped, latest: Stamped, at: Instant) -> Option<Filtered> {
    let span = latest.at.micros_since(previous.at);
    let way = at.micros_since(previous.at);
    let weight_q16 = quotient_q16(way, span)?;
    if !(-2 << 16..=4 << 16).contains(&weight_q16) {
        return None;
    }
    let mut accel = previous.filtered.accel;
    for (a, &b) in accel.iter_mut().zip(&latest.filtered.accel) {
        let step = (i64::from(b) - i64::from(*a)) * weight_q16;
        let value = i64::from(*a) + (step >> 16);
        *a = saturate(value);
    }
    Some(Filtered { accel })
}

#[cfg(test)]
mod fused_tests;
#[cfg(test)]
mod tests;
