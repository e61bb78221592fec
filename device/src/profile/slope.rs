//! What a slope displays: inversion, preset, offset and differential offset (CiA 410, 60x0h to
//! 60x4h and their 32-bit twins).
//!
//! In: an angle as measured and the parameters of one slope. Out: the displayed number,
//!
//! > slope = +-measured (+ differential offset + offset, where bit 1 of the operating parameter
//! > is set),
//!
//! and at the write of a preset: offset = preset - (+-measured) - differential offset.
//!
//! Everything is in units of the resolution, as the standard has it, and stored once: the 16-bit
//! and the 32-bit objects are two views of one [`Slope`]. What would leave 16 bit anywhere within
//! the measuring range is refused at the write, so nothing wraps or saturates unseen. Where the
//! angle is one of the full circle it wraps there, and so do the sums: inverted, 30 deg reads
//! 330 deg in the form of 0 to 360 deg.
//!
//! A new resolution takes the parameters along ([`Slope::rescaled`]): an offset of 5 deg stays
//! one. The standard leaves open whether the bare numbers stay; a slope that jumps by the factor
//! ten because its unit was changed would mislead.
//!
//! Left out: the second logical device, which is one more [`Slope`] per axis.

use tilt::angle::Angle;

use super::resolution::{Form, Refused, Resolution, Scale, fits};

/// Bit 0 of the operating parameter: the angle as measured is inverted.
const INVERTED: u8 = 1;
/// Bit 1 of the operating parameter: differential offset and offset are added.
const SCALED: u8 = 2;

/// The four parameters of a slope, by their place after the slope's own index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// 60x1h: bit 0 inverts, bit 1 adds the offsets.
    Operating,
    /// 60x2h: what the slope shall read now.
    Preset,
    /// 60x3h: what the preset came to.
    Offset,
    /// 60x4h: a shift of its own.
    Differential,
}

impl Parameter {
    /// From the distance to the slope's index, 1 to 4; `None` for others.
    pub const fn new(distance: u16) -> Option<Self> {
        Some(match distance {
            1 => Self::Operating,
            2 => Self::Preset,
            3 => Self::Offset,
            4 => Self::Differential,
            _ => return None,
        })
    }
}

/// The parameters of one slope. The default is the one of the rows: not inverted, scaled, 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slope {
    operating: u8,
    preset: i32,
    offset: i32,
    differential: i32,
}

impl Default for Slope {
    fn default() -> Self {
        Self::new()
    }
}

impl Slope {
    /// As delivered.
    pub const fn new() -> Self {
        Self {
            operating: crate::objects::profile::OPERATING,
            preset: 0,
            offset: 0,
            differential: 0,
        }
    }

    /// A parameter, in units of the resolution (the operating parameter: its bits).
    pub const fn get(&self, parameter: Parameter) -> i32 {
        match parameter {
            Parameter::Operating => self.operating as i32,
            Parameter::Preset => self.preset,
            Parameter::Offset => self.offset,
            Parameter::Differential => self.differential,
        }
    }

    /// Puts a stored value in place, without any rule; [`Slope::check`] follows when all are in.
    pub const fn load(&mut self, parameter: Parameter, number: i32) {
        match parameter {
            Parameter::Operating => self.operating = number as u8,
            Parameter::Preset => self.preset = number,
            Parameter::Offset => self.offset = number,
            Parameter::Differential => self.differential = number,
        }
    }

    /// A master writes a parameter, by either twin. `measured` is the valid angle of this
    /// instant, which only a preset needs.
    ///
    /// Errors: [`Refused::Operating`], [`Refused::NoAngle`], [`Refused::TooHigh`],
    /// [`Refused::TooLow`], [`Refused::ReadOnly`]; nothing has changed then.
    pub fn set(
        &mut self,
        parameter: Parameter,
        number: i32,
        measured: Option<Angle>,
        scale: &Scale,
    ) -> Result<(), Refused> {
        let mut next = *self;
        match parameter {
            Parameter::Offset => return Err(Refused::ReadOnly),
            Parameter::Operating if !(0..=3).contains(&number) => return Err(Refused::Operating),
            Parameter::Preset => {
                let measured = measured.ok_or(Refused::NoAngle)?;
                next.zero(number, measured, scale)?;
            }
            Parameter::Operating | Parameter::Differential => next.load(parameter, number),
        }
        next.check(scale)?;
        *self = next;
        Ok(())
    }

    /// Makes the slope read `preset` at an angle. A preset outside the circle could never be
    /// read, so it is refused.
    fn zero(&mut self, preset: i32, measured: Angle, scale: &Scale) -> Result<(), Refused> {
        if scale.wrap(preset) < preset {
            return Err(Refused::TooHigh);
        }
        if scale.wrap(preset) > preset {
            return Err(Refused::TooLow);
        }
        let rest = preset.saturating_sub(self.signed(measured, scale));
        self.preset = preset;
        self.offset = scale.wrap(rest.saturating_sub(self.differential));
        Ok(())
    }

    /// The angle as measured in units of the resolution, inverted where bit 0 is set.
    fn signed(&self, measured: Angle, scale: &Scale) -> i32 {
        let units = scale.resolution.units(measured);
        scale.wrap(if self.is(INVERTED) { -units } else { units })
    }

    const fn is(&self, bit: u8) -> bool {
        self.operating & bit != 0
    }

    /// True where the angle as measured is inverted.
    pub const fn is_inverted(&self) -> bool {
        self.is(INVERTED)
    }

    /// What is added to the angle: 0 while bit 1 is not set.
    pub const fn shift(&self) -> i32 {
        if self.is(SCALED) {
            self.offset.saturating_add(self.differential)
        } else {
            0
        }
    }

    /// The displayed slope, in units of the resolution; the 16-bit object shows
    /// [`narrow`](super::narrow) of it.
    pub fn displayed(&self, measured: Angle, scale: &Scale) -> i32 {
        scale.wrap(self.signed(measured, scale).saturating_add(self.shift()))
    }

    /// Whether the slope can be shown in 16 bit over the whole measuring range.
    ///
    /// For a change of the range, and for stored values at a start. Errors:
    /// [`Refused::Operating`], [`Refused::TooHigh`], [`Refused::TooLow`].
    pub fn check(&self, scale: &Scale) -> Result<(), Refused> {
        if self.operating & !(INVERTED | SCALED) != 0 {
            return Err(Refused::Operating);
        }
        for number in [self.preset, self.offset, self.differential] {
            fits(number)?;
        }
        let (low, high) = scale.ends();
        if scale.form == Form::Slope {
            let inverted = self.is(INVERTED);
            let (low, high) = if inverted { (-high, -low) } else { (low, high) };
            fits(low.saturating_add(self.shift()))?;
            fits(high.saturating_add(self.shift()))?;
        }
        Ok(())
    }

    /// The same slope at another resolution: `scale` is the new one, `old` the one so far.
    ///
    /// Errors: [`Refused::Resolution`] where 16 bit do not hold it, [`Refused::EmptyRange`].
    pub fn rescaled(&self, old: Resolution, scale: &Scale) -> Result<Self, Refused> {
        scale.check()?;
        let convert = |number| scale.resolution.convert(number, old);
        let next = Self {
            operating: self.operating,
            preset: scale.wrap(convert(self.preset)),
            offset: scale.wrap(convert(self.offset)),
            differential: convert(self.differential),
        };
        next.check(scale).map_err(|_| Refused::Resolution)?;
        Ok(next)
    }
}
