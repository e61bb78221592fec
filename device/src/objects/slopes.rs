//! The slopes of CiA 410 behind their rows: 6000h to 61FFh, the same 800h higher for the peer,
//! and the safe slopes 6210h to 6221h.
//!
//! In: what a master writes, and the angles of the moment. Out: displayed slopes, or why not.
//! A slope without a valid angle reads as the lowest number of its type, which no valid slope can
//! have; 2025h tells the reason.
//!
//! Left out: the arithmetic (`profile`).

use canopen::object::{Abort, Address, Number, Value};
use tilt::angle::Angle;
use tilt::chain::Correction;

use super::device_objects::{DeviceObjects, Memory, Source};
use super::manufacturer::HALF_TURN;
use super::profile::{LOGICAL_DEVICE, RESOLUTION};
use crate::instrument::Instrument;
use crate::profile::{Form, Parameter, Range, Resolution, Scale, Slope, narrow};
use crate::records::{Record, parameters};

/// A slope's object taken apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Which {
    /// 0 and 1: X and Y of this channel, 2 and 3: of the peer.
    slope: usize,
    /// Seen as 32 bit.
    wide: bool,
    /// Distance to the slope's own index: 0 for the slope, 1 to 4 for its parameters.
    distance: u16,
}

/// Index of a slope's object to what it means; `None` for the resolution and for others.
const fn which(index: u16) -> Option<Which> {
    let peer = index >= 0x6000 + LOGICAL_DEVICE;
    let local = index & (LOGICAL_DEVICE - 1);
    let axis = local >> 4 & 0xF;
    if axis != 1 && axis != 2 {
        return None;
    }
    Some(Which {
        slope: axis as usize - 1 + if peer { 2 } else { 0 },
        wide: local & 0x100 != 0,
        distance: local & 0xF,
    })
}

impl<M: Memory, S: Source<I>, I: Instrument> DeviceObjects<'_, M, S, I> {
    fn resolution(&self, device: usize) -> Resolution {
        let number = self.parts.values.parameters.resolution.get(device).copied();
        let known = number.and_then(|n| Resolution::new(n).ok());
        known.unwrap_or(Resolution::Hundredth)
    }

    fn range(&self, axis: usize) -> Range {
        let (ranges, _) = self.parts.values.parameters.range.as_chunks();
        let [low, high] = *ranges.get(axis).unwrap_or(&[0; 2]);
        Range { low, high }
    }

    /// A slope's unit, range and form. One angle of 360 deg counts from 0 where its range begins
    /// there, and from -180 deg otherwise.
    fn scale(&self, slope: usize, resolution: Resolution) -> Scale {
        let correction = &self.parts.settings.chain.calibration.correction;
        self.scale_with(correction, slope, resolution)
    }

    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn scale_with(
        &self,
        correction: &Correction<I>,
        slope: usize,
        resolution: Resolution,
    ) -> Scale {
        let range = self.range(slope & 1);
        let turns = matches!(correction, Correction::OneAxis { .. });
        let form = match (turns && slope & 1 == 0, range.low >= 0) {
            (false, _) => Form::Slope,
            (true, true) => Form::FullTurn,
            (true, false) => Form::HalfTurn,
        };
        Scale {
            resolution,
            range,
            form,
        }
    }

    fn angle(&self, slope: usize) -> Option<Angle> {
        self.shown().slope(slope)
    }

    pub(super) fn read_slope(&self, at: Address) -> Result<Number, Abort> {
        let device = usize::from(at.index >= 0x6000 + LOGICAL_DEVICE);
        let Some(which) = which(at.index) else {
            return Ok(Number::u16(self.resolution(device).number()));
        };
        if !I::PRESETS {
            return Ok(self.as_measured(which));
        }
        let parameters = self.parts.values.parameters.slopes.get(which.slope);
        let slope = parameters.ok_or(Abort::NoSuchObject)?;
        let number = match Parameter::new(which.distance) {
            Some(Parameter::Operating) => {
                return Ok(Number::u8(slope.get(Parameter::Operating) as u8));
            }
            Some(parameter) => slope.get(parameter),
            None => {
                let scale = self.scale(which.slope, self.resolution(device));
                let angle = self.angle(which.slope);
                let number = angle.map(|a| slope.displayed(a, &scale));
                if which.wide {
                    return Ok(Number::i32(number.unwrap_or(i32::MIN)));
                }
                return Ok(slope_of_16_bit(number));
            }
        };
        Ok(sized(number, which.wide))
    }

    /// A slope whose unit, sign and zero nobody can set.
    fn as_measured(&self, which: Which) -> Number {
        let angle = self.angle(which.slope);
        let number = angle.map(|angle| Resolution::Hundredth.units(angle));
        match which.wide {
            true => Number::i32(number.unwrap_or(i32::MIN)),
            false => Number::i16(number.map_or(i16::MIN, narrow)),
        }
    }

    /// An angle of this channel in 16 bit, as its slope `axis` (0 is X) is shown.
    pub(super) fn as_slope(&self, axis: usize, angle: Option<Angle>) -> Number {
        let slope = self.parts.values.parameters.slopes.get(axis);
        let scale = self.scale(axis, self.resolution(0));
        slope_of_16_bit(slope.and_then(|slope| angle.map(|angle| slope.displayed(angle, &scale))))
    }

    pub(super) fn write_slope(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        let device = usize::from(at.index >= 0x6000 + LOGICAL_DEVICE);
        let Some(which) = which(at.index) else {
            return self.write_resolution(device, value.unsigned() as u16);
        };
        let parameter = Parameter::new(which.distance).ok_or(Abort::ReadOnly)?;
        let number = if parameter == Parameter::Operating {
            value.unsigned() as i32
        } else {
            value.signed_32()
        };
        let scale = self.scale(which.slope, self.resolution(device));
        let angle = self.shown().preset_slope(which.slope);
        let slope = self.parts.values.parameters.slopes.get_mut(which.slope);
        let slope = slope.ok_or(Abort::NoSuchObject)?;
        let set = slope.set(parameter, number, angle, &scale);
        set.map_err(|refused| refused.abort())
    }

    /// A new unit takes the offsets along, or is refused where 16 bit do not hold them.
    fn write_resolution(&mut self, device: usize, number: u16) -> Result<(), Abort> {
        let new = Resolution::new(number).map_err(|r| r.abort())?;
        let old = self.resolution(device);
        let (pairs, _) = self.parts.values.parameters.slopes.as_chunks::<2>();
        let mut pair = *pairs.get(device).ok_or(Abort::NoSuchObject)?;
        for (slope, i) in pair.iter_mut().zip(2 * device..) {
            let scale = self.scale(i, new);
            *slope = slope.rescaled(old, &scale).map_err(|r| r.abort())?;
        }
        let (pairs, _) = self.parts.values.parameters.slopes.as_chunks_mut();
        if let Some(place) = pairs.get_mut(device) {
            *place = pair;
        }
        if let Some(place) = self.parts.values.parameters.resolution.get_mut(device) {
            *place = number;
        }
        Ok(())
    }

    /// 2040h: every slope must still fit into 16 bit over the new range.
    pub(super) fn write_range(&mut self, at: Address, value: Value) -> Result<(), Abort> {
        let before = self.parts.values.parameters.range;
        let member = usize::from(at.sub).wrapping_sub(1);
        let place = self.parts.values.parameters.range.get_mut(member);
        *place.ok_or(Abort::NoSuchSubIndex)? = value.signed_32();
        let axis = member >> 1;
        for slope in [axis, axis + 2] {
            let scale = self.scale(slope, self.resolution(slope >> 1));
            let parameters = self.parts.values.parameters.slopes.get(slope);
            let held = scale
                .check()
                .and(parameters.map_or(Ok(()), |s| s.check(&scale)));
            if let Err(refused) = held {
                self.parts.values.parameters.range = before;
                return Err(refused.abort());
            }
        }
        Ok(())
    }

    /// 2040h of X as delivered, where one axis measures the full circle: then that is its range.
    pub(super) fn range_of_a_turn(&mut self, at: Address) -> Option<Value> {
        let turns = matches!(
            self.parts.settings.chain.calibration.correction,
            Correction::OneAxis { .. }
        );
        let end = match (at.index, at.sub) {
            (0x2040, 1) => -HALF_TURN,
            (0x2040, 2) => HALF_TURN,
            _ => return None,
        };
        let stored = parameters::get(&mut self.parts.memory, Record::Manufacturer, at);
        (turns && stored.is_none()).then_some(Value::i32(end as i32))
    }

    /// Whether every slope fits into 16 bit, with a calibration that corrects like this.
    ///
    /// Errors: [`Abort::ParameterIncompatible`].
    pub(super) fn slopes_hold(&self, correction: &Correction<I>) -> Result<(), Abort> {
        let slopes = &self.parts.values.parameters.slopes;
        for (i, slope) in slopes.iter().enumerate().filter(|_| I::PRESETS) {
            let scale = self.scale_with(correction, i, self.resolution(i >> 1));
            let held = scale.check().and_then(|()| slope.check(&scale));
            held.map_err(|_| Abort::ParameterIncompatible)?;
        }
        Ok(())
    }

    /// Range and resolution are stored in two groups, so what was stored of one need not go with
    /// what is stored, or restored, of the other. Then the slopes have their defaults, which fit
    /// any range, and the fault of the memory tells.
    pub(super) fn mend_slopes(&mut self) {
        let held = self.slopes_hold(&self.parts.settings.chain.calibration.correction);
        if held.is_err() {
            self.parts.values.parameters.resolution = [RESOLUTION; 2];
            self.parts.values.parameters.slopes = [Slope::new(); 4];
            self.parts.values.storage_failed = true;
        }
    }

    /// A default or stored value, in any order; [`DeviceObjects::mend_slopes`] looks at them
    /// together.
    pub(super) fn load_slope(&mut self, at: Address, value: Value) {
        let device = usize::from(at.index >= 0x6000 + LOGICAL_DEVICE);
        match which(at.index) {
            None => {
                if let Some(place) = self.parts.values.parameters.resolution.get_mut(device) {
                    *place = value.unsigned() as u16;
                }
            }
            Some(which) => {
                let slope = self.parts.values.parameters.slopes.get_mut(which.slope);
                if let (Some(slope), Some(parameter)) = (slope, Parameter::new(which.distance)) {
                    slope.load(parameter, value.signed_32());
                }
            }
        }
    }

    /// 6210h to 6221h: as measured, without preset and offsets, in the unit of 6200h. Without a
    /// valid angle, or where 16 bit do not hold it, there is no value, so that no SRDO can be made
    /// of it.
    pub(super) fn read_safe_slope(&self, at: Address) -> Result<Number, Abort> {
        let axis = usize::from(at.index >= 0x6220);
        let (angle, again) = self.shown().measured(axis).ok_or(Abort::NoData)?;
        let unit = Resolution::new(self.parts.values.parameters.safety_resolution);
        let unit = unit.map_err(|refused| refused.abort())?;
        let number = if at.index & 1 == 0 {
            unit.units(angle)
        } else {
            !unit.units_by_sums(again)
        };
        let number = i16::try_from(number).map_err(|_| Abort::NoData)?;
        Ok(Number::i16(number))
    }
}

/// Outside the measuring range it may not fit, and the nearest number that does would be a wrong
/// angle.
#[inline(always)]
fn slope_of_16_bit(number: Option<i32>) -> Number {
    let narrow = number.and_then(|n| i16::try_from(n).ok());
    Number::i16(narrow.unwrap_or(i16::MIN))
}

fn sized(number: i32, wide: bool) -> Number {
    if wide {
        Number::i32(number)
    } else {
        Number::i16(narrow(number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_fall_apart_as_the_profile_numbers_them() {
        let slope = |slope, wide, distance| {
            Some(Which {
                slope,
                wide,
                distance,
            })
        };
        assert_eq!(which(0x6000), None);
        assert_eq!(which(0x6800), None);
        assert_eq!(which(0x6010), slope(0, false, 0));
        assert_eq!(which(0x6124), slope(1, true, 4));
        assert_eq!(which(0x6812), slope(2, false, 2));
        assert_eq!(which(0x6920), slope(3, true, 0));
    }
}
