//! One channel: a part on its bus, read when it says so, watched, and turned into readings.
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
//! Left out: the CAN bus, which joins in `node` when the `canopen` crate comes, and naming a
//! faulty channel by comparing signals.

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use tilt::angle::Axes;
use tilt::chain::{Chain, Invalid, Reading, State};
use tilt::filter::Filtered;
use tilt::sample::{Instant, Temperature};

use crate::sensor::{Config, InitError, Lis2dw12, Register, VerifyError};

/// How one channel is set up: the part and the chain behind it.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The part's own configuration.
    pub part: Config,
    /// The signal chain.
    pub chain: Chain,
}

/// Time between two read-backs of the part's registers, each with a temperature reading.
pub const CHECK_INTERVAL_US: i64 = 100_000;

/// How long a brown-out may keep a part from answering: 50 ms without supply and 20 ms of boot
/// (LIS2DW12), with a margin.
const OUTAGE_US: i64 = 75_000;

/// One channel's state.
#[derive(Debug)]
pub struct Channel<SPI> {
    part: Lis2dw12<SPI>,
    state: State,
    fault: Option<Invalid>,
    next_check: Instant,
    samples: u32,
    /// The last read-back found another name than the part's.
    nameless: bool,
}

impl<SPI: SpiDevice> Channel<SPI> {
    /// A channel that has not been started: its readings are invalid.
    pub fn new(spi: SPI) -> Self {
        Self {
            part: Lis2dw12::new(spi),
            state: State::default(),
            fault: Some(Invalid::NoSample),
            next_check: Instant(0),
            samples: 0,
            nameless: false,
        }
    }

    /// Sets the part up and forgets everything, faults included: what a reset does.
    ///
    /// Takes about 20 ms of `delay`. On an error the channel stays invalid for that reason, and
    /// may be started again.
    pub fn start<D: DelayNs>(
        &mut self,
        settings: &Settings,
        delay: &mut D,
        now: Instant,
    ) -> Result<(), InitError<SPI::Error>> {
        self.state = State::default();
        self.samples = 0;
        self.nameless = false;
        self.next_check = now;
        self.fault = Some(Invalid::Bus);
        self.part.init(&settings.part, delay)?;
        self.fault = None;
        Ok(())
    }

    /// The part has raised data-ready at `captured`: reads the sample and runs the filter.
    pub fn data_ready(&mut self, settings: &Settings, captured: Instant) {
        match self.part.read() {
            Ok(Some(sample)) => {
                self.samples = self.samples.wrapping_add(1);
                settings
                    .chain
                    .sample(&mut self.state, sample.counts, captured);
            }
            // An edge without a sample: the registers were read out already. Age will tell.
            Ok(None) => {}
            Err(_) => self.latch(Invalid::Bus),
        }
    }

    /// Housekeeping that is due at `now`; returns when to call again.
    pub fn poll(&mut self, settings: &Settings, now: Instant) -> Instant {
        if now < self.next_check {
            return self.next_check;
        }
        self.next_check = now.offset(CHECK_INTERVAL_US);
        if self.fault.is_none() {
            self.check(settings, now);
        }
        self.next_check
    }

    fn check(&mut self, settings: &Settings, now: Instant) {
        match self.part.verify() {
            Ok(_) => self.nameless = false,
            Err(VerifyError::Bus(_)) => return self.latch(Invalid::Bus),
            // A part in a brown-out does not answer until it has booted, so its name is asked for
            // once more before the bus is blamed.
            Err(VerifyError::Mismatch(m)) if m.register == Register::WhoAmI && !self.nameless => {
                self.nameless = true;
                self.next_check = now.offset(OUTAGE_US);
                return;
            }
            Err(VerifyError::Mismatch(m)) if m.register == Register::WhoAmI => {
                return self.latch(Invalid::Bus);
            }
            Err(VerifyError::Mismatch(_)) => return self.latch(Invalid::PartReset),
        }
        match self.part.read_temperature() {
            Ok(temperature) => settings.chain.temperature(&mut self.state, temperature),
            Err(_) => self.latch(Invalid::Bus),
        }
    }

    /// The first fault stays: later ones follow from it.
    fn latch(&mut self, reason: Invalid) {
        self.fault.get_or_insert(reason);
    }

    /// What the channel says at `now`.
    pub fn reading(&self, settings: &Settings, now: Instant) -> Reading {
        match self.fault {
            Some(reason) => Axes {
                x: Err(reason),
                y: Err(reason),
            },
            None => settings.chain.reading(&self.state, now),
        }
    }

    /// The newest filtered acceleration and its time: what a calibration memorises (R5).
    pub fn filtered(&self) -> Option<(Filtered, Instant)> {
        self.state.filtered()
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
    pub fn fault(&self) -> Option<Invalid> {
        self.fault
    }

    /// The part, for its self-test.
    pub fn part(&mut self) -> &mut Lis2dw12<SPI> {
        &mut self.part
    }
}
