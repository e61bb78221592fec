//! What enters the chain: the sensor's counts, its temperature, and the time of capture.
//!
//! Everything here is what the part itself said, before any processing. Reading a part over a
//! bus is `device`'s business and does not appear here.

/// One reading of the three axes, as 16-bit two's complement, left-justified.
///
/// The LIS2DW12 delivers 14 significant bits (12 in low-power mode 1) in the upper end of 16
/// (data sheet DS11811 rev 8, OUT_X..OUT_Z). One step of a 14-bit reading is 4 here, which is
/// 0.244 mg at +-2 g. The paper calls this "16-bit"; erratum E14 is that only 14 carry
/// information.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts(pub [i16; 3]);

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

/// A reading of the device's own clock, in microseconds since its reset.
///
/// Differences are signed 64-bit microseconds. The clock does not wrap in 584 000 years.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Instant(pub u64);

impl Instant {
    /// Microseconds from `earlier` to `self`; negative when `self` is the earlier one.
    pub const fn micros_since(self, earlier: Self) -> i64 {
        self.0.wrapping_sub(earlier.0) as i64
    }

    /// The instant `micros` later (earlier when negative), stopping at the ends of the clock.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub const fn offset(self, micros: i64) -> Self {
        Self(self.0.saturating_add_signed(micros))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_scale_counts() {
        assert_eq!(FullScale::G2.counts_per_g(), 16384);
        assert_eq!(FullScale::G16.counts_per_g(), 2048);
        assert_eq!(FullScale::G16.g(), 16);
    }

    #[test]
    fn instants_subtract_both_ways() {
        assert_eq!(Instant(5).micros_since(Instant(7)), -2);
        assert_eq!(Instant(5).offset(-9), Instant(0));
    }
}
