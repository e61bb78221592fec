//! From what the part feels to the bytes in its output registers.
//!
//! In: specific force in g, rate of turn in deg/s and the die temperature in degC. Out: 16-bit
//! two's complement, clipped at the ends of the counts.

use tilt::sample::{Counts, FullScale, RateCounts, RateRange};

use crate::spi_part::quantise;

/// The counts end here; clipped to -LIMIT..LIMIT.
const LIMIT: i32 = 1 << 15;

/// Counts for a force in g: 0.122 mg per count at +-4 g \[DS\], which is 8192 in one g.
pub fn counts(force_g: [f64; 3], full_scale: FullScale) -> Counts {
    Counts(scaled(force_g, f64::from(full_scale.counts_per_g())))
}

/// Counts for a rate in deg/s: 17.5 mdps per count at +-500 deg/s \[DS\].
pub fn rate_counts(rate_dps: [f64; 3], range: RateRange) -> RateCounts {
    RateCounts(scaled(
        rate_dps,
        1e6 / f64::from(range.micro_dps_per_count()),
    ))
}

/// Rounded and clipped, axis by axis.
fn scaled(values: [f64; 3], per_unit: f64) -> [i16; 3] {
    let mut counts = [0; 3];
    for (count, value) in counts.iter_mut().zip(values) {
        *count = quantise(value * per_unit, LIMIT) as i16;
    }
    counts
}

/// OUT_TEMP_L and OUT_TEMP_H for a temperature in degC: 1/256 degC, zero at 25 degC \[DS\],
/// clipped at -103 and +153 degC.
pub fn temperature_bytes(die_c: f64) -> [u8; 2] {
    (quantise((die_c - 25.0) * 256.0, LIMIT) as i16).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forces_round_and_clip() {
        let step = 1.0 / 8192.0;
        let got = counts([1.0, 0.51 * step, -0.51 * step], FullScale::G4);
        assert_eq!(got, Counts([8192, 1, -1]));
        let got = counts([4.0, -4.0, f64::INFINITY], FullScale::G4);
        assert_eq!(got, Counts([32767, -32768, 32767]));
    }

    #[test]
    fn rates_have_the_steps_of_the_range_and_reach_beyond_it() {
        let got = rate_counts([17.5, 500.0, -0.0175], RateRange::Dps500);
        assert_eq!(got, RateCounts([1000, 28571, -1]));
        let got = rate_counts([140.0, 150.0, -150.0], RateRange::Dps125);
        assert_eq!(got, RateCounts([32000, 32767, -32768]));
        let got = rate_counts([70.0, 0.0, f64::NAN], RateRange::Dps2000);
        assert_eq!(got, RateCounts([1000, 0, -32768]));
    }

    #[test]
    fn temperature_is_sixteen_bits_around_25_degrees() {
        assert_eq!(temperature_bytes(25.0), [0x00, 0x00]);
        assert_eq!(temperature_bytes(26.5), [0x80, 0x01]);
        assert_eq!(temperature_bytes(1000.0), [0xFF, 0x7F]);
    }
}
