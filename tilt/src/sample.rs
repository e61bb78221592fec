//! What enters the chain: the sensor's counts, its temperature, and the time of capture.
//!
//! Everything here is what the part itself gave, before any processing. Reading a part over a
//! bus is `device`'s business and does not appear here.

use crate::motion::Rate;

/// One reading of the three axes, as 16-bit two's complement, left-justified.
///
/// The LIS2DW12 delivers 14 significant bits (12 in low-power mode 1) in the upper end of 16
/// (data sheet DS11811 rev 8, OUT_X..OUT_Z). One step of a 14-bit reading is 4 here, which is
/// 0.244 mg at +-2 g. The paper calls this "16-bit"; erratum E14 is that only 14 carry
/// information.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts(pub [i16; 3]);

/// What a part captured at one moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// Acceleration.
    pub counts: Counts,
    /// Rate of turn, where the part has a gyroscope.
    pub rate: Option<RateCounts>,
}

impl From<Counts> for Sample {
    fn from(counts: Counts) -> Self {
        Self { counts, rate: None }
    }
}

/// Full-scale range of the part, which fixes how many counts make one g.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FullScale {
    /// +-2 g, 16384 left-justified counts per g: the range the paper uses (R1).
    #[default]
    G2,
    /// +-4 g, 8192 counts per g: used by the LIS2DW12 self-test.
    G4,
    /// +-8 g, 4096 counts per g.
    G8,
    /// +-16 g, 2048 counts per g.
    G16,
}

impl FullScale {
    /// Nominal left-justified counts for one g.
    pub const fn counts_per_g(self) -> i32 {
        16384 >> self.log2()
    }

    /// The range in g: 2, 4, 8 or 16.
    pub const fn g(self) -> i32 {
        2 << self.log2()
    }

    /// log2(range / 2 g): 0 to 3.
    pub const fn log2(self) -> u32 {
        match self {
            Self::G2 => 0,
            Self::G4 => 1,
            Self::G8 => 2,
            Self::G16 => 3,
        }
    }
}

/// A temperature in 1/256 degC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Temperature(pub i32);

impl Temperature {
    /// 25 degC, where the data sheet states the zero-g offset and eq 5 of the paper has its zero.
    pub const REFERENCE: Self = Self(25 * 256);

    /// From whole degrees Celsius.
    pub const fn from_celsius(celsius: i16) -> Self {
        Self(celsius as i32 * 256)
    }

    /// Rounded to whole degrees Celsius.
    pub const fn celsius(self) -> i32 {
        (self.0 + 128) >> 8
    }
}

/// One reading of a gyroscope's three axes, 16-bit two's complement.
///
/// One step is [`RateRange::micro_dps_per_count`]. All 16 bits are
/// significant (data sheet DS13012 rev 6, OUTX_L_G to OUTZ_H_G).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RateCounts(pub [i16; 3]);

/// Range of a gyroscope, which fixes how much one count is.
///
/// The steps are those of the data sheet (DS13012 rev 6, table 2, angular rate sensitivity), and
/// 15 % larger than range / 2^15: at the end of the counts each range reaches 14.7 % further than
/// its name, 143 deg/s for 125. What the part measures there is not specified.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RateRange {
    /// +-125 deg/s, 4.375 mdps per count.
    Dps125,
    /// +-250 deg/s, 8.75 mdps per count.
    Dps250,
    /// +-500 deg/s, 17.5 mdps per count.
    #[default]
    Dps500,
    /// +-1000 deg/s, 35 mdps per count.
    Dps1000,
    /// +-2000 deg/s, 70 mdps per count.
    Dps2000,
}

/// 4.375 mdps in steps of [`Rate`], times 2^32: 4.375e-3 pi / 180 * 2^24 * 2^32.
const FINEST_COUNT: i64 = 5_502_184_918_244;

impl RateRange {
    /// log2(range / 125 deg/s): 0 to 4.
    pub const fn log2(self) -> u32 {
        match self {
            Self::Dps125 => 0,
            Self::Dps250 => 1,
            Self::Dps500 => 2,
            Self::Dps1000 => 3,
            Self::Dps2000 => 4,
        }
    }

    /// The range in deg/s: 125, 250, 500, 1000 or 2000.
    pub const fn dps(self) -> i32 {
        125 << self.log2()
    }

    /// Nominal size of one count in micro-deg/s: 4375 to 70 000, exact.
    pub const fn micro_dps_per_count(self) -> i32 {
        4_375 << self.log2()
    }

    /// The rate that these counts stand for with the nominal sensitivity, in the part's axes.
    ///
    /// Rounded to the nearest step of [`Rate`], 2^-24 rad/s. At most 2^15 counts of 20 497 steps
    /// each, so nothing overflows.
    pub const fn rate(self, counts: RateCounts) -> Rate {
        let RateCounts([x, y, z]) = counts;
        Rate {
            rate: [self.steps(x), self.steps(y), self.steps(z)],
        }
    }

    /// One axis of [`Self::rate`]: below 2^15 * 2^42.4 * 2^4 before the shift.
    const fn steps(self, count: i16) -> i32 {
        const HALF: i64 = 1 << 31;
        let fine = (count as i64 * FINEST_COUNT) << self.log2();
        ((fine + HALF) >> 32) as i32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::RATE_STEPS;

    const RANGES: [RateRange; 5] = [
        RateRange::Dps125,
        RateRange::Dps250,
        RateRange::Dps500,
        RateRange::Dps1000,
        RateRange::Dps2000,
    ];

    #[test]
    fn full_scale_counts() {
        assert_eq!(FullScale::G2.counts_per_g(), 16384);
        assert_eq!(FullScale::G16.counts_per_g(), 2048);
        assert_eq!(FullScale::G16.g(), 16);
    }

    #[test]
    fn ranges_have_the_steps_of_the_data_sheet() {
        let dps = RANGES.map(RateRange::dps);
        assert_eq!(dps, [125, 250, 500, 1000, 2000]);
        let micro_dps = RANGES.map(RateRange::micro_dps_per_count);
        assert_eq!(micro_dps, [4_375, 8_750, 17_500, 35_000, 70_000]);
    }

    #[test]
    fn counts_are_the_nearest_rate() {
        let counts = [
            i16::MIN,
            i16::MIN + 1,
            -20_000,
            -1,
            0,
            1,
            2,
            4_571,
            i16::MAX,
        ];
        for range in RANGES {
            let per_count_rad_s = f64::from(range.micro_dps_per_count()).to_radians() * 1e-6;
            for count in counts {
                let exact = f64::from(count) * per_count_rad_s * RATE_STEPS;
                let got = range.rate(RateCounts([count, 0, count])).rate;
                let want = (exact + 0.5).floor() as i32;
                assert_eq!(got, [want, 0, want], "{range:?} {count}");
            }
        }
    }

    #[test]
    fn the_largest_rate_fits_with_room_to_spare() {
        let largest = RateRange::Dps2000.rate(RateCounts([i16::MIN; 3])).rate;
        assert_eq!(largest, [-671_653_432; 3]);
    }
}
