//! One channel: a part on its bus, read when it is ready, watched, and turned into readings.
//!
//! In: the data-ready edge with its capture time, the time, and what comes over SPI. Out: a
//! [`Reading`] for any instant. Settings are an immutable value handed in with every call, so that
//! they can stand in flash; the channel holds state only.
//!
//! A channel trusts its part only as long as the set-up reads back as it was written: a brown-out
//! puts the part into power-down, where its outputs freeze at a plausible value (LIS2DW12, CTRL1).
//! What is found wrong is latched until [`Channel::start`], because a part that has lost its
//! supply once is not to be believed before somebody has looked (R13, Table I).
//!
//! Between two read-backs the part is watched sample by sample: a sample that does not come is
//! asked after at once, codes that stand still are no signal, and a temperature that jumps as no
//! die's can takes the channel's word away, because its compensation would follow the jump.
//!
//! Left out: comparing one channel with the other, which is `tilt::cross_check`'s.

use embedded_hal::delay::DelayNs;
use instant::Instant;
use tilt::chain::{Calibration, Chain, ChainState, Invalid, PART_DELAY_Q16, Reading, Timing};
use tilt::composition::{Composition, Place, Whole};
use tilt::filter::{Filtered, LowPass};
use tilt::fusion::MeasuredSum;
use tilt::health::{self, Health};
use tilt::motion::Rate;
use tilt::observation::Observation;
use tilt::sample::{FullScale, Temperature};
use tilt::temperature::TemperatureModel;
use tilt::uncertainty::Budget;

use crate::factory;
use crate::sensor::{Part, PartConfig, PartError};

/// How one channel is set up as long as nothing is known of its part.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// The part's own configuration.
    pub part: PartConfig,
    /// The low-pass.
    pub filter: LowPass,
    /// Which instant readings belong to.
    pub timing: Timing,
    /// See [`Settings::noise`].
    pub noise: u32,
}

/// How one channel is set up: the part and the chain behind it.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings<C: Composition = Whole> {
    /// The part's own configuration.
    pub part: PartConfig,
    /// The signal chain.
    pub chain: Chain<C>,
    /// Standard deviation of a single sample of one axis, 2^-26 g, against which the channel's
    /// health is watched; 0: as the calibration's budget has it. Below 0.4 steps of the part its
    /// codes may stand still, as those of a part without noise do.
    pub noise: u32,
}

impl<C: Composition> Settings<C> {
    /// Of a part of which nothing is known.
    ///
    /// The tables that a calibration has room for make it large, so each level is a call, whose
    /// result is written right into its place: see [`Device::new`](crate::device::Device::new).
    #[inline(never)]
    pub fn uncalibrated(setup: &Setup) -> Self {
        Self {
            part: setup.part,
            chain: uncalibrated_chain(setup),
            noise: setup.noise,
        }
    }

    /// What they were before the part was calibrated.
    pub fn setup(&self) -> Setup {
        Setup {
            part: self.part,
            filter: self.chain.filter.clone(),
            timing: self.chain.timing,
            noise: self.noise,
        }
    }
}

#[inline(never)]
fn uncalibrated_chain<C: Composition>(setup: &Setup) -> Chain<C> {
    Chain {
        filter: setup.filter.clone(),
        full_scale: setup.part.full_scale(),
        period_us: setup.part.period_us(),
        part_delay_q16: PART_DELAY_Q16,
        timing: setup.timing,
        calibration: no_calibration(),
        fusion: factory::fusion::<C>(&setup.part, setup.noise),
    }
}

#[inline(never)]
fn no_calibration<C: Composition>() -> Calibration<C> {
    Calibration {
        temperature: TemperatureModel::None,
        correction: C::uncalibrated(),
        budget: Budget::DATA_SHEET,
        rates: None,
    }
}

/// Time between two read-backs of the part's registers, each with a temperature reading.
pub const CHECK_INTERVAL_US: i64 = 100_000;

/// How long a brown-out may keep a part from answering: 50 ms without supply and 20 ms of boot
/// (LIS2DW12), with a margin.
const OUTAGE_US: i64 = 75_000;

/// 400 samples/s, until settings give another rate.
const NOMINAL_PERIOD_US: u32 = 2500;

/// How often a sample that is overdue is asked after.
const WATCH_US: u32 = 4_000;

/// The die's temperature moves by less than this between two readings, 1/256 degC, ...
const JUMP: i32 = 640;
/// ... and by this much more for each second between them, 1/256 degC.
const JUMP_PER_S: i64 = 128;

/// Readings of the temperature in a row that jump before the thermometer is not believed.
const JUMPS: u8 = 3;

const NEVER: Instant = Instant(u64::MAX);

/// The last temperature that was believed, when, and how many readings have jumped since.
#[derive(Clone, Copy, Debug)]
struct Thermometer {
    believed: Option<Temperature>,
    at: Instant,
    jumps: u8,
}

impl Thermometer {
    const fn new(at: Instant) -> Self {
        Self {
            believed: None,
            at,
            jumps: 0,
        }
    }

    /// True when a die's temperature can have come to this by `now`.
    fn believes(&self, reading: Temperature, now: Instant) -> bool {
        let pause_us = now.micros_since(self.at).clamp(0, 1_000_000_000);
        let allowed = i64::from(JUMP) + pause_us * JUMP_PER_S / 1_000_000;
        self.believed
            .is_none_or(|last| i64::from(reading.0.abs_diff(last.0)) <= allowed)
    }
}

/// One channel's state.
#[derive(Clone, Debug)]
pub struct Channel<P, C: Composition = Whole> {
    part: P,
    state: ChainState<C>,
    health: Health,
    watch: health::HealthState,
    thermometer: Thermometer,
    /// A sample is overdue and the part does not answer as itself.
    lost: bool,
    fault: Option<Invalid>,
    /// When the next sample will be missed.
    overdue_at: Instant,
    /// Nobody could read samples up to this instant; 0 once one was read.
    excused_until: Instant,
    next_check: Instant,
    /// A sample that is overdue is not asked after again before this.
    next_watch: Instant,
    samples: u32,
    /// Since when read-backs have found another name than the part's.
    nameless: Option<Instant>,
}

impl<P: Part, C: Composition> Channel<P, C> {
    /// A channel that has not been started: its readings are invalid.
    pub fn new(part: P) -> Self {
        Self {
            part,
            state: ChainState::default(),
            health: Health::new(0, FullScale::G2, NOMINAL_PERIOD_US),
            watch: health::HealthState::default(),
            thermometer: Thermometer::new(Instant(0)),
            lost: false,
            fault: Some(Invalid::NoSample),
            overdue_at: NEVER,
            excused_until: Instant(0),
            next_check: Instant(0),
            next_watch: Instant(0),
            samples: 0,
            nameless: None,
        }
    }

    /// Sets the part up and forgets everything, faults included: what a reset does.
    ///
    /// Takes about 20 ms of `delay`. On an error the channel stays invalid for that reason, and
    /// may be started again.
    pub fn start<D: DelayNs>(
        &mut self,
        settings: &Settings<C>,
        delay: &mut D,
        now: Instant,
    ) -> Result<(), PartError<P::Error>> {
        let chain = &settings.chain;
        let noise = match settings.noise {
            0 => chain.calibration.budget.noise,
            known => known,
        };
        self.state = ChainState::default();
        self.health = Health::new(noise, chain.full_scale, chain.period_us);
        self.watch = health::HealthState::default();
        self.thermometer = Thermometer::new(now);
        self.lost = false;
        self.overdue_at = NEVER;
        self.samples = 0;
        self.nameless = None;
        // The part has no temperature before its first conversion, and shows 25 degC until then.
        self.next_check = now.offset(CHECK_INTERVAL_US);
        self.next_watch = now;
        self.fault = Some(Invalid::Bus);
        self.part.init(&settings.part, delay)?;
        self.fault = None;
        // The first sample comes much earlier, at 50 samples/s and more. A part whose data-ready is
        // not connected gives none at all.
        self.overdue_at = self.next_check;
        Ok(())
    }

    /// The part has raised data-ready at `captured`: reads the sample and runs the filter.
    // Out of line: the image is smaller.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn data_ready(&mut self, settings: &Settings<C>, captured: Instant) {
        match self.part.read() {
            Ok(Some(sample)) => {
                self.samples = self.samples.wrapping_add(1);
                self.lost = false;
                self.excused_until = Instant(0);
                if captured >= self.overdue_at {
                    self.health.restart(&mut self.watch);
                }
                self.health.sample(&mut self.watch, sample.counts);
                if C::Fusion::FITTED && self.reason().is_some() {
                    self.forget_motion();
                }
                settings.chain.sample(&mut self.state, sample, captured);
                self.await_next(settings);
            }
            // An edge without a sample: the registers were read out already. Age will tell.
            Ok(None) => {}
            Err(_) => self.latch(Invalid::Bus),
        }
    }

    /// Remembers when the sample after the newest will be missed: deadlines are asked for far more
    /// often than there are samples.
    fn await_next(&mut self, settings: &Settings<C>) {
        if let Some((_, newest)) = self.state.filtered() {
            self.overdue_at = newest.offset(3 * i64::from(settings.chain.period_us) / 2 + 1);
        }
    }

    /// The processor stood still until `now`: that no samples were read meanwhile is no silence of
    /// the part, whose next one has to come within its period.
    ///
    /// Two such excuses in a row do not count without a sample between them, so that a part that
    /// really is silent is found while a memory is erased page by page.
    pub fn excuse(&mut self, settings: &Settings<C>, now: Instant) {
        if now >= self.overdue_at && self.excused_until == Instant(0) {
            self.excused_until = now.offset(i64::from(settings.chain.period_us));
        }
    }

    /// A sample is missing, but not by the part's fault.
    fn is_excused(&self, now: Instant) -> bool {
        (self.overdue_at..=self.excused_until).contains(&now)
    }

    /// When [`Channel::poll`] is next due. Every sample puts it off.
    pub fn deadline(&self) -> Instant {
        if self.fault.is_some() {
            return self.next_check;
        }
        self.overdue_at.max(self.next_watch).min(self.next_check)
    }

    /// Housekeeping that is due at `now`; returns when to call again.
    pub fn poll(&mut self, settings: &Settings<C>, now: Instant) -> Instant {
        let overdue = now >= self.overdue_at;
        if (now >= self.next_check || overdue) && self.fault.is_none() {
            self.check(settings, now, overdue);
        }
        if now >= self.next_check {
            self.next_check = now.offset(CHECK_INTERVAL_US);
        }
        if overdue {
            // The chain finds samples that have stopped, and not that the first one is missing.
            self.lost |= self.samples == 0;
            let watch_us = WATCH_US.max(settings.chain.period_us);
            self.next_watch = now.offset(i64::from(watch_us));
        }
        self.deadline()
    }

    // Out of line: the image is smaller.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn check(&mut self, settings: &Settings<C>, now: Instant, overdue: bool) {
        match self.part.verify() {
            Ok(()) => self.nameless = None,
            // A part in a brown-out does not answer until it has booted, so its name is asked for
            // again before the bus is blamed. Meanwhile its samples are missed.
            Err(PartError::Identity) => {
                self.lost |= overdue;
                let again = self.nameless.get_or_insert(now).offset(OUTAGE_US);
                if now >= again {
                    return self.latch(Invalid::Bus);
                }
                self.next_check = again;
                return;
            }
            Err(PartError::Register) => return self.latch(Invalid::PartReset),
            Err(_) => return self.latch(Invalid::Bus),
        }
        // A part that has stopped converting shows a temperature of an unknown time.
        if now >= self.next_check && !overdue && self.samples > 0 {
            match self.part.read_temperature() {
                Ok(temperature) => self.take_temperature(settings, temperature, now),
                Err(_) => self.latch(Invalid::Bus),
            }
        }
    }

    /// A temperature that jumps is not used; one that stays where it jumped is a fault.
    fn take_temperature(&mut self, settings: &Settings<C>, reading: Temperature, now: Instant) {
        if self.thermometer.believes(reading, now) {
            self.thermometer = Thermometer {
                believed: Some(reading),
                ..Thermometer::new(now)
            };
            return settings.chain.temperature(&mut self.state, reading);
        }
        self.thermometer.jumps = self.thermometer.jumps.saturating_add(1);
        if self.thermometer.jumps >= JUMPS {
            self.latch(Invalid::Thermometer);
        }
    }

    /// The first fault stays: later ones follow from it.
    fn latch(&mut self, reason: Invalid) {
        self.fault.get_or_insert(reason);
    }

    /// Why there is nothing to report, when that is not the chain's business.
    pub fn reason(&self) -> Option<Invalid> {
        let lost = self.lost.then_some(Invalid::Stale);
        let stuck = || self.health.stuck(&self.watch).then_some(Invalid::Stuck);
        self.fault.or(lost).or_else(stuck)
    }

    /// [`Channel::reason`], or that there is no sample because nobody could read it.
    fn reason_at(&self, now: Instant) -> Option<Invalid> {
        let excused = || self.is_excused(now).then_some(Invalid::NoSample);
        self.reason().or_else(excused)
    }

    /// What the channel reports at `now`.
    pub fn reading(&self, settings: &Settings<C>, now: Instant) -> Reading {
        match self.reason_at(now) {
            Some(reason) => Observation::absent(reason).reading,
            None => settings.chain.reading(&self.state, now),
        }
    }

    /// All that the channel reports at `now`, a SYNC: the activity is that since the SYNC before.
    pub fn observe(&mut self, settings: &Settings<C>, now: Instant) -> Observation {
        let activity = self.health.take_activity(&mut self.watch);
        let turned = settings.chain.take_turned(&mut self.state, now);
        match self.reason_at(now) {
            Some(reason) => Observation {
                activity,
                ..Observation::absent(reason)
            },
            None => {
                let (reading, vector) = settings.chain.reading_and_vector(&self.state, now);
                Observation {
                    reading,
                    vector,
                    activity,
                    turned,
                }
            }
        }
    }

    /// The sensor measures wrongly: what its estimator has found with it is forgotten.
    pub fn forget_motion(&mut self) {
        Chain::forget_motion(&mut self.state);
    }

    /// Takes the channel's word away until it is started: something beside the part is wrong.
    pub fn condemn(&mut self, reason: Invalid) {
        self.latch(reason);
    }

    /// The newest filtered acceleration and its time: what a calibration memorises (R5).
    pub fn filtered(&self) -> Option<(Filtered, Instant)> {
        self.state.filtered()
    }

    /// The newest rate as the part's gyroscope read it: what its calibration memorises.
    pub fn measured_rate(&self) -> Option<Rate> {
        self.state.measured_rate()
    }

    /// What the gyroscope has measured since the start, summed up; nothing before its first sample.
    pub fn measured_sum(&self) -> MeasuredSum {
        self.state.measured_sum().unwrap_or_default()
    }

    /// The angle of this very moment; where there is no gyroscope, that of [`Channel::reading`].
    pub fn reading_now(&self, settings: &Settings<C>, now: Instant) -> Reading {
        match self.reason_at(now) {
            Some(reason) => Observation::absent(reason).reading,
            None => settings.chain.reading_now(&self.state, now),
        }
    }

    /// The rate of turn about the housing's axes, corrected; `now` is as with [`Channel::reading`].
    ///
    /// # Errors
    /// Why there is none: see [`Chain::rate`](tilt::chain::Chain::rate).
    pub fn rate(&self, settings: &Settings<C>, now: Instant) -> Result<Rate, Invalid> {
        match self.reason_at(now) {
            Some(reason) => Err(reason),
            None => settings.chain.rate(&self.state, now),
        }
    }

    /// The part's temperature, smoothed, once one has been read.
    pub fn temperature(&self) -> Option<Temperature> {
        self.state.temperature()
    }

    /// The measured time between samples in 1/256 us; 0 before the second sample.
    pub fn period_q8(&self) -> u32 {
        self.state.period_q8()
    }

    /// Samples taken since the start; wraps.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// The latched fault.
    pub const fn fault(&self) -> Option<Invalid> {
        self.fault
    }

    /// The part, for its self-test.
    pub fn part(&mut self) -> &mut P {
        &mut self.part
    }
}
