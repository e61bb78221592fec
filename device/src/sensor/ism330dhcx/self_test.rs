//! The self-test: the part deflects its own masses and the driver measures by how much.
//!
//! In: an instrument at rest, and something to wait with. Out: the per-axis differences for both
//! signs, of the accelerometer in mg and of the gyroscope in mdps. The procedure is that of ST's
//! application note AN5398 as ST's open example has it: one sensor after the other, +-4 g at 52 Hz
//! and +-2000 deg/s at 208 Hz; at rest and with each sign wait 100 ms, discard one sample, take
//! the mean of five. It takes about 0.95 s, and no angle can be given meanwhile.
//!
//! The windows of 19:1 and 5:1 only tell dead from alive. Judging a change against the unit's own
//! difference at calibration is the caller's business.

use core::ops::RangeInclusive;

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use tilt::sample::{FullScale, RateRange};

use super::config::{Config, DataRate, Fifo, Setup};
use super::driver::{InertialSample, Ism330dhcx};
use super::error::SelfTestError;
use super::registers::{
    CTRL5_ST_G_NEGATIVE, CTRL5_ST_G_POSITIVE, CTRL5_ST_XL_NEGATIVE, CTRL5_ST_XL_POSITIVE, Register,
    STATUS_GDA, STATUS_XLDA,
};

/// Time for a mass to settle after each change, in milliseconds.
const SETTLE_MS: u32 = 100;

/// Samples in each mean.
const SAMPLES: i64 = 5;

/// Looks at data-ready, one per millisecond, before a sample counts as missing: 2.6 periods of the
/// slower sensor.
const POLLS: u32 = 50;

/// The accelerometer's window, in mg (ST's example and Linux driver; data sheet not compared).
const WINDOW_MG: RangeInclusive<u32> = 90..=1_700;

/// The gyroscope's window at +-2000 deg/s, in mdps (as above).
const WINDOW_MDPS: RangeInclusive<u32> = 150_000..=700_000;

/// What the self-test found: output with the deflection minus output at rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SelfTest {
    /// The accelerometer with positive sign, mg per axis.
    pub positive_mg: [i32; 3],
    /// The accelerometer with negative sign, mg per axis.
    pub negative_mg: [i32; 3],
    /// The gyroscope with positive sign, mdps per axis.
    pub positive_mdps: [i32; 3],
    /// The gyroscope with negative sign, mdps per axis.
    pub negative_mdps: [i32; 3],
}

impl SelfTest {
    /// Every axis moved by 90 to 1700 mg and 150 to 700 deg/s, either way, with both signs.
    pub fn within_data_sheet(&self) -> bool {
        let mut acceleration = self.positive_mg.iter().chain(&self.negative_mg);
        let mut rate = self.positive_mdps.iter().chain(&self.negative_mdps);
        acceleration.all(|difference| WINDOW_MG.contains(&difference.unsigned_abs()))
            && rate.all(|difference| WINDOW_MDPS.contains(&difference.unsigned_abs()))
    }
}

/// One of the two sensors under test.
struct Sensor {
    setup: Setup,
    /// Its bit in STATUS_REG.
    ready: u8,
    /// CTRL5_C for both signs.
    deflections: [u8; 2],
    axes: fn(&InertialSample) -> [i16; 3],
    /// A count in the unit of the result, as a fraction.
    unit: (i64, i64),
}

/// What both sensors share: the widest filters, no FIFO.
const SHARED: Config = Config {
    full_scale: FullScale::G4,
    range: RateRange::Dps2000,
    fifo: Fifo::Bypass,
    ..Config::PRODUCT
};

/// +-4 g at 52 Hz, the gyroscope in power-down; mg.
const ACCELEROMETER: Sensor = Sensor {
    setup: alone(DataRate::Hz52, 1),
    ready: STATUS_XLDA,
    deflections: [CTRL5_ST_XL_POSITIVE, CTRL5_ST_XL_NEGATIVE],
    axes: |sample| sample.acceleration.0,
    unit: (1_000, FullScale::G4.counts_per_g() as i64),
};

/// +-2000 deg/s at 208 Hz, the accelerometer in power-down; mdps.
const GYROSCOPE: Sensor = Sensor {
    setup: alone(DataRate::Hz208, 0),
    ready: STATUS_GDA,
    deflections: [CTRL5_ST_G_POSITIVE, CTRL5_ST_G_NEGATIVE],
    axes: |sample| sample.rate.0,
    unit: (RateRange::Dps2000.micro_dps_per_count() as i64, 1_000),
};

/// A set-up in which the sensor whose control register is `off` (0: CTRL1_XL, 1: CTRL2_G) rests.
const fn alone(rate: DataRate, off: u8) -> Setup {
    let mut setup = Config { rate, ..SHARED }.setup();
    let [ctrl1_xl, ctrl2_g, ..] = &mut setup.control;
    if off == 0 {
        *ctrl1_xl = 0;
    } else {
        *ctrl2_g = 0;
    }
    setup
}

impl<SPI: SpiDevice> Ism330dhcx<SPI> {
    /// Runs the self-test and brings the part back to its configuration, also after an error.
    ///
    /// The instrument must be at rest. Afterwards the filters downstream have to start anew:
    /// samples were missing for about 0.95 s, and the gyroscope needs its start-up time again.
    ///
    /// # Errors
    /// The bus failed, a register did not take its setting, no sample came, or the previous
    /// configuration could not be restored. The last one wins over the others, because a part
    /// left in the self-test's configuration must not be used.
    pub fn self_test<D: DelayNs>(
        &mut self,
        delay: &mut D,
    ) -> Result<SelfTest, SelfTestError<SPI::Error>> {
        let before = self.config().setup();
        let outcome = self.deflect_both(delay);
        match self.apply(&before) {
            Ok(()) => outcome,
            Err(error) => Err(SelfTestError::Restore(error)),
        }
    }

    /// The measurement itself; leaves the part in the self-test's configuration.
    fn deflect_both<D: DelayNs>(
        &mut self,
        delay: &mut D,
    ) -> Result<SelfTest, SelfTestError<SPI::Error>> {
        let [positive_mg, negative_mg] = self.deflect(&ACCELEROMETER, delay)?;
        let [positive_mdps, negative_mdps] = self.deflect(&GYROSCOPE, delay)?;
        Ok(SelfTest {
            positive_mg,
            negative_mg,
            positive_mdps,
            negative_mdps,
        })
    }

    /// One sensor: at rest, then with both signs.
    fn deflect<D: DelayNs>(
        &mut self,
        sensor: &Sensor,
        delay: &mut D,
    ) -> Result<[[i32; 3]; 2], SelfTestError<SPI::Error>> {
        self.apply(&sensor.setup)?;
        let rest = self.sum_after_settling(sensor, delay)?;
        let mut found = [[0; 3]; 2];
        for (difference, bits) in found.iter_mut().zip(sensor.deflections) {
            self.set(Register::Ctrl5C, bits)?;
            let deflected = self.sum_after_settling(sensor, delay)?;
            *difference = difference_of_means(deflected, rest, sensor.unit);
        }
        Ok(found)
    }

    /// Waits, discards one sample, sums five, per axis in counts.
    fn sum_after_settling<D: DelayNs>(
        &mut self,
        sensor: &Sensor,
        delay: &mut D,
    ) -> Result<[i64; 3], SelfTestError<SPI::Error>> {
        delay.delay_ms(SETTLE_MS);
        self.next_of(sensor, delay)?;
        let mut sum = [0_i64; 3];
        for _ in 0..SAMPLES {
            let axes = self.next_of(sensor, delay)?;
            for (total, count) in sum.iter_mut().zip(axes) {
                *total = total.saturating_add(i64::from(count));
            }
        }
        Ok(sum)
    }

    /// Waits for the sensor's data-ready, at most `POLLS` milliseconds.
    fn next_of<D: DelayNs>(
        &mut self,
        sensor: &Sensor,
        delay: &mut D,
    ) -> Result<[i16; 3], SelfTestError<SPI::Error>> {
        for _ in 0..POLLS {
            let outputs = self.outputs()?;
            if outputs.status & sensor.ready != 0 {
                return Ok((sensor.axes)(&outputs.sample));
            }
            delay.delay_ms(1);
        }
        Err(SelfTestError::NoData)
    }
}

/// The difference of two sums of five per sample, in the sensor's unit, rounded to the nearest.
///
/// At most 5 * 65535 counts of 70 000 units, so the product stays below 2^36 and the result, at
/// most 4 587 450 mdps or 8 000 mg, fits.
fn difference_of_means(deflected: [i64; 3], rest: [i64; 3], unit: (i64, i64)) -> [i32; 3] {
    let (numerator, denominator) = unit;
    let divisor = SAMPLES.saturating_mul(denominator).max(1);
    let mut result = [0; 3];
    for ((value, on), off) in result.iter_mut().zip(deflected).zip(rest) {
        let scaled = on.saturating_sub(off).saturating_mul(numerator);
        let rounded = scaled.saturating_add(divisor / 2).div_euclid(divisor);
        *value = i32::try_from(rounded).unwrap_or(i32::MAX);
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_round_to_the_nearest_on_both_sides() {
        let rest = [0, 100, -100];
        // 0.5 g is half of 5 * 8192 counts.
        let deflected = [20_480, 100 - 40_960, -100 + 28];
        let found = difference_of_means(deflected, rest, ACCELEROMETER.unit);
        assert_eq!(found, [500, -1000, 1]);
        // One count of 70 mdps, five times and once.
        let found = difference_of_means([5, -5, 1], [0; 3], GYROSCOPE.unit);
        assert_eq!(found, [70, -70, 14]);
    }

    #[test]
    fn extreme_sums_do_not_overflow() {
        let low = [5 * i64::from(i16::MIN); 3];
        let high = [5 * i64::from(i16::MAX); 3];
        let mg = difference_of_means(high, low, ACCELEROMETER.unit);
        assert_eq!(mg, [8000; 3]);
        let mdps = difference_of_means(low, high, GYROSCOPE.unit);
        assert_eq!(mdps, [-4_587_450; 3]);
    }

    #[test]
    fn one_sensor_rests_while_the_other_is_tested() {
        assert_eq!(ACCELEROMETER.setup.control[..2], [0x38, 0x00]);
        assert_eq!(GYROSCOPE.setup.control[..2], [0x00, 0x5C]);
    }

    #[test]
    fn the_windows_hold_on_every_axis() {
        let alive = SelfTest {
            positive_mg: [90, 1700, 300],
            negative_mg: [-90, -1700, -300],
            positive_mdps: [150_000, 700_000, 400_000],
            negative_mdps: [-150_000, -700_000, -400_000],
        };
        assert!(alive.within_data_sheet());
        let weak = SelfTest {
            negative_mdps: [-149_999, -700_000, -400_000],
            ..alive
        };
        let strong = SelfTest {
            positive_mg: [90, 1701, 300],
            ..alive
        };
        assert!(!weak.within_data_sheet());
        assert!(!strong.within_data_sheet());
    }
}
