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
}
