//! The self-test: the part deflects its own mass and the driver measures by how much.
//!
//! In: an instrument at rest, and something to wait with. Out: the per-axis difference in mg
//! for both signs. The procedure: +-4 g, high-performance mode, 50 Hz; at rest and with each
//! sign wait 100 ms, discard one sample, take the mean of five (data sheet and application note
//! AN5038). It takes about 0.7 s, and no angle can be given meanwhile.
//!
//! The data sheet's window of 70 to 1500 mg is 21:1 and only tells dead from alive. Judging a
//! change against the unit's own difference at calibration is the caller's business.

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::SpiDevice;
use tilt::sample::FullScale;

use super::config::Config;
use super::error::SelfTestError;
use super::lis2dw12::{Lis2dw12, Sample};
use super::registers::{CTRL3_ST_NEGATIVE, CTRL3_ST_POSITIVE, Register};

/// Time for the mass to settle after each change of the self-test bits, in milliseconds.
const SETTLE_MS: u32 = 100;

/// Samples in each mean.
const SAMPLES: i32 = 5;

/// Looks at data-ready, one per millisecond, before a sample counts as missing: 2.5 periods.
const POLLS: u32 = 50;

/// Sum of `SAMPLES` readings of one g.
const SUM_PER_G: i32 = SAMPLES * FullScale::G4.counts_per_g();

/// The window of the data sheet, in mg.
const WINDOW_MG: core::ops::RangeInclusive<u32> = 70..=1500;

/// What the self-test found: output with the deflection minus output at rest, in mg per axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SelfTest {
    /// With positive sign.
    pub positive_mg: [i32; 3],
    /// With negative sign.
    pub negative_mg: [i32; 3],
}

impl SelfTest {
    /// Every axis moved by 70 to 1500 mg, either way, with both signs (data sheet, self-test
    /// output change).
    pub fn within_data_sheet(&self) -> bool {
        let mut all = self.positive_mg.iter().chain(&self.negative_mg);
        all.all(|difference_mg| WINDOW_MG.contains(&difference_mg.unsigned_abs()))
    }
}

impl<SPI: SpiDevice> Lis2dw12<SPI> {
    /// Runs the self-test and brings the part back to its configuration, also after an error.
    ///
    /// The instrument must be at rest. Afterwards the filters downstream have to start anew:
    /// samples were missing for about 0.7 s.
    ///
    /// # Errors
    /// The bus failed, a register did not take its setting, no sample came, or the previous
    /// configuration could not be restored. The last one wins over the others, because a part
    /// left in the self-test's configuration must not be used.
    pub fn self_test<D: DelayNs>(
        &mut self,
        delay: &mut D,
    ) -> Result<SelfTest, SelfTestError<SPI::Error>> {
        let before = *self.config();
        let outcome = self.deflect(delay);
        match self.apply(&before) {
            Ok(()) => outcome,
            Err(error) => Err(SelfTestError::Restore(error)),
        }
    }

    /// The measurement itself; leaves the part in the self-test's configuration.
    fn deflect<D: DelayNs>(
        &mut self,
        delay: &mut D,
    ) -> Result<SelfTest, SelfTestError<SPI::Error>> {
        self.apply(&Config::SELF_TEST)?;
        let rest = self.sum_after_settling(delay)?;
        self.set(Register::Ctrl3, CTRL3_ST_POSITIVE)?;
        let positive = self.sum_after_settling(delay)?;
        self.set(Register::Ctrl3, CTRL3_ST_NEGATIVE)?;
        let negative = self.sum_after_settling(delay)?;
        Ok(SelfTest {
            positive_mg: difference_mg(positive, rest),
            negative_mg: difference_mg(negative, rest),
        })
    }

    /// Waits, discards one sample, sums five, per axis in counts at +-4 g.
    fn sum_after_settling<D: DelayNs>(
        &mut self,
        delay: &mut D,
    ) -> Result<[i32; 3], SelfTestError<SPI::Error>> {
        delay.delay_ms(SETTLE_MS);
        self.next_sample(delay)?;
        let mut sum = [0_i32; 3];
        for _ in 0..SAMPLES {
            let sample = self.next_sample(delay)?;
            for (total, count) in sum.iter_mut().zip(sample.counts.0) {
                *total = total.saturating_add(i32::from(count));
            }
        }
        Ok(sum)
    }

    /// Waits for data-ready, at most `POLLS` milliseconds.
    fn next_sample<D: DelayNs>(
        &mut self,
        delay: &mut D,
    ) -> Result<Sample, SelfTestError<SPI::Error>> {
        for _ in 0..POLLS {
            if let Some(sample) = self.read()? {
                return Ok(sample);
            }
            delay.delay_ms(1);
        }
        Err(SelfTestError::NoData)
    }
}

/// The difference of two sums of five as mg per sample, rounded to the nearest.
fn difference_mg(deflected: [i32; 3], rest: [i32; 3]) -> [i32; 3] {
    let mut difference = deflected;
    for (value, at_rest) in difference.iter_mut().zip(rest) {
        // At most 5 * 65535 counts, so the product stays below 2^29.
        let milli = value.saturating_sub(at_rest).saturating_mul(1000);
        *value = milli.saturating_add(SUM_PER_G / 2).div_euclid(SUM_PER_G);
    }
    difference
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_round_to_the_nearest_mg_on_both_sides() {
        let rest = [0, 100, -100];
        // 0.5 g is half of 5 * 8192 counts.
        let deflected = [SUM_PER_G / 2, 100 - SUM_PER_G, -100 + 28];
        assert_eq!(difference_mg(deflected, rest), [500, -1000, 1]);
        assert_eq!(difference_mg([-28, -13, 13], [0; 3]), [-1, 0, 0]);
    }

    #[test]
    fn extreme_sums_do_not_overflow() {
        let low = [5 * i32::from(i16::MIN); 3];
        let high = [5 * i32::from(i16::MAX); 3];
        assert_eq!(difference_mg(high, low), [8000; 3]);
    }

    #[test]
    fn the_window_is_70_to_1500_mg_on_every_axis() {
        let alive = SelfTest {
            positive_mg: [70, 1500, 300],
            negative_mg: [-70, -1500, -300],
        };
        assert!(alive.within_data_sheet());
        let weak = SelfTest {
            negative_mg: [-69, -1500, -300],
            ..alive
        };
        let strong = SelfTest {
            positive_mg: [70, 1501, 300],
            ..alive
        };
        assert!(!weak.within_data_sheet());
        assert!(!strong.within_data_sheet());
    }
}
