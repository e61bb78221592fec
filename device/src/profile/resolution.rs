//! The unit of slopes (CiA 410, object 6000h), and what of it fits into 16 bit.
//!
//! In: the resolution, the measuring range and the form of the angle. Out: angles in that unit,
//! and a refusal where the 16-bit objects could not hold them: a slope that reads wrong is worse
//! than a write that fails.
//!
//! Left out: everything that a master can add to a slope.

use canopen::object::Abort;
use tilt::angle::Angle;

/// Why a write is refused. Nothing has changed then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// Not a resolution, or one at which 16 bit do not hold the range or a parameter.
    Resolution,
    /// A bit that has no meaning is set in the operating parameter.
    Operating,
    /// There is no valid angle that a preset could refer to.
    NoAngle,
    /// The number, or a slope made with it, is above what 16 bit or the circle hold.
    TooHigh,
    /// The number, or a slope made with it, is below what 16 bit or the circle hold.
    TooLow,
    /// The low end of the measuring range is not below its high end.
    EmptyRange,
    /// The offset cannot be written; it follows from the preset.
    ReadOnly,
}

impl Refused {
    /// The SDO abort code for it.
    pub const fn abort(self) -> Abort {
        match self {
            Self::Resolution | Self::Operating => Abort::InvalidValue,
            Self::NoAngle => Abort::WrongState,
            Self::TooHigh => Abort::ValueTooHigh,
            Self::TooLow => Abort::ValueTooLow,
            Self::EmptyRange => Abort::MaximumBelowMinimum,
            Self::ReadOnly => Abort::ReadOnly,
        }
    }
}

/// The unit of slopes, presets and offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Resolution {
    /// 0.001 deg.
    Thousandth = 1,
    /// 0.01 deg.
    Hundredth = 10,
    /// 0.1 deg.
    Tenth = 100,
    /// 1 deg.
    Degree = 1000,
}

impl Resolution {
    /// From what was written to 6000h, in 0.001 deg.
    ///
    /// Errors: [`Refused::Resolution`] for all but 1, 10, 100 and 1000.
    pub const fn new(number: u16) -> Result<Self, Refused> {
        Ok(match number {
            1 => Self::Thousandth,
            10 => Self::Hundredth,
            100 => Self::Tenth,
            1000 => Self::Degree,
            _ => return Err(Refused::Resolution),
        })
    }

    /// As 6000h has it, in 0.001 deg.
    pub const fn number(self) -> u16 {
        self as u16
    }

    /// Units in a full circle.
    pub const fn turn(self) -> i32 {
        match self {
            Self::Thousandth => 360_000,
            Self::Hundredth => 36_000,
            Self::Tenth => 3_600,
            Self::Degree => 360,
        }
    }

    /// An angle in this unit, -180 deg to +180 deg, rounded to the nearest.
    pub const fn units(self, angle: Angle) -> i32 {
        // 31 bits by 19 bits: a product and a shift in place of a division of 64 bits.
        let product = angle.0 as i64 * self.turn() as i64;
        ((product + (1 << 31)) >> 32) as i32
    }

    /// [`Resolution::units`] a second way, by sums in place of a product: for the half of a safety
    /// frame that has to be arrived at independently (EN 50325-5).
    pub const fn units_by_sums(self, angle: Angle) -> i32 {
        let (mut left, mut sum, mut addend) = (self.turn(), 1_i64 << 31, angle.0 as i64);
        while left != 0 {
            if left & 1 != 0 {
                sum += addend;
            }
            addend <<= 1;
            left >>= 1;
        }
        (sum >> 32) as i32
    }

    /// A number of `other` units in this unit, rounded to the nearest, halves away from zero.
    pub const fn convert(self, number: i32, other: Self) -> i32 {
        let fine = number.saturating_mul(other.number() as i32);
        let unit = self.number() as i32;
        let half = if fine < 0 { -(unit / 2) } else { unit / 2 };
        match fine.saturating_add(half).checked_div(unit) {
            Some(number) => number,
            None => 0,
        }
    }
}

/// How an angle is displayed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Form {
    /// A slope of a two-axis instrument: offsets may carry it past a quarter turn, without wrap.
    #[default]
    Slope,
    /// An angle of the full circle, -180 deg to just under +180 deg, which wraps.
    HalfTurn,
    /// An angle of the full circle, 0 deg to just under 360 deg, which wraps.
    FullTurn,
}

/// The measuring range, in 0.001 deg, both ends included (2040h).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// Low end, -180 000 to 180 000.
    pub low: i32,
    /// High end, -180 000 to 180 000.
    pub high: i32,
}

/// How a slope is displayed: configuration of one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scale {
    /// The unit.
    pub resolution: Resolution,
    /// The measuring range, before inversion and offsets.
    pub range: Range,
    /// The form.
    pub form: Form,
}

/// A 16-bit view of a number of 32 bit; what does not fit stops at the end.
///
/// [`Slope`](super::Slope) sees to it that within the measuring range everything fits, so a slope
/// that stands at an end is outside that range.
pub fn narrow(number: i32) -> i16 {
    i16::try_from(number).unwrap_or(if number < 0 { i16::MIN } else { i16::MAX })
}

/// Whether 16 bit hold a number.
pub(super) const fn fits(number: i32) -> Result<(), Refused> {
    if number > i16::MAX as i32 {
        return Err(Refused::TooHigh);
    }
    if number < i16::MIN as i32 {
        return Err(Refused::TooLow);
    }
    Ok(())
}

impl Scale {
    /// Lowest and highest number as measured, without inversion and offsets.
    pub const fn ends(&self) -> (i32, i32) {
        let turn = self.resolution.turn();
        match self.form {
            Form::HalfTurn => (-(turn / 2), turn / 2 - 1),
            Form::FullTurn => (0, turn - 1),
            Form::Slope => (
                self.resolution
                    .convert(self.range.low, Resolution::Thousandth),
                self.resolution
                    .convert(self.range.high, Resolution::Thousandth),
            ),
        }
    }

    /// Whether 16 bit hold every angle of the range.
    ///
    /// Errors: [`Refused::EmptyRange`], [`Refused::Resolution`].
    pub const fn check(&self) -> Result<(), Refused> {
        if self.range.low >= self.range.high {
            return Err(Refused::EmptyRange);
        }
        let (low, high) = self.ends();
        match (fits(low), fits(high)) {
            (Ok(()), Ok(())) => Ok(()),
            _ => Err(Refused::Resolution),
        }
    }

    /// Brings a number into the circle of the form; a slope stays as it is.
    pub const fn wrap(&self, number: i32) -> i32 {
        let (low, _) = self.ends();
        match self.form {
            Form::Slope => number,
            Form::HalfTurn | Form::FullTurn => {
                let above = number.saturating_sub(low);
                match above.checked_rem_euclid(self.resolution.turn()) {
                    Some(above) => low + above,
                    None => low,
                }
            }
        }
    }
}
