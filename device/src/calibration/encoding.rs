//! A calibration as bytes: for the DOMAIN of the dictionary, the record store and host tools.
//!
//! In: a [`Calibration`], any part of whose bytes is made on demand, without a buffer. Out of
//! bytes: a [`Calibration`], or a [`DecodeError`] that names what was refused.
//!
//! # Format, version 1
//! Words of 32 bits, little-endian; numbers with sign in two's complement.
//!
//! | words | content |
//! |---|---|
//! | 1 | "PLMC" (434D4C50h) |
//! | 1 | version, 1 |
//! | 1 | length of the whole in bytes, check sum included |
//! | 1 | kinds: byte 0 temperature model, byte 1 correction, byte 2 rule, byte 3 zero |
//! | 5 | budget: noise, repeatability, hysteresis (2^-26 g), reference, residual (2^-32 circle) |
//! | 0, 3, 33 or 12 | temperature model |
//! | see below | correction |
//! | 1 | CRC-32 ([`crc`](super::crc)) over all bytes before |
//!
//! Temperature model: 0 none. 1 data sheet: `tco_q8` of x, y, z. 2 piecewise: nine knots, then
//! x, y, z of eight slopes. 3 quadratic: `offset1_q8`, `offset2_q16`, `gain1_q38`, `gain2_q46`,
//! each x, y, z.
//!
//! Correction: 0 tables: for X, then for Y, the number of points and for each point acceleration
//! and angle. 1 two axes: nine of the matrix by rows, three of the offset, then cosine 1 to 3 and
//! sine 1 to 3 of slope X and of slope Y. 2 one axis: matrix, offset, cosine, sine. The rule is 0
//! nearest, 1 linear, 2 printed quarter, and 0 where there are no tables.
//!
//! Units are those of the types in `tilt`. The longest, two full tables, is 3076 bytes.
//!
//! Left out: storing, and putting in force.

use tilt::angle::{Axes, Harmonics};
use tilt::chain::{Calibration, Correction};
use tilt::table::{MAX_POINTS, Point, Rule, Table, TableError};
use tilt::temperature::{KNOTS, Piecewise, Quadratic, TemperatureModel};
use tilt::uncertainty::Uncertainty;
use tilt::vector::Vector;

use super::crc::Crc32;
use super::motor::Axis;
use super::tables_in;

/// "PLMC" as a little-endian word.
pub const MAGIC: u32 = u32::from_le_bytes(*b"PLMC");

/// The version written, and the only one read.
pub const VERSION: u32 = 1;

/// Words before the temperature model.
const HEAD: usize = 9;

/// Words of a piecewise model.
const PIECEWISE: usize = KNOTS + 3 * (KNOTS - 1);

/// Words of a quadratic model.
const QUADRATIC: usize = 12;

/// Words of an affine correction.
const VECTOR: usize = 12;

/// Words of the harmonics of one axis.
const HARMONICS: usize = 6;

/// The longest encoding in bytes: a piecewise model and two full tables.
pub const MAX_LENGTH: u32 = 4 * (HEAD + PIECEWISE + 2 * (1 + 2 * MAX_POINTS) + 1) as u32;

/// Why bytes are no calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// The bytes end early.
    Truncated,
    /// They do not begin with [`MAGIC`].
    Magic,
    /// They are of another version than [`VERSION`].
    Version(u32),
    /// The length they state is impossible, or not that of their content or of the transfer.
    Length,
    /// The check sum is wrong.
    CheckSum,
    /// The kind of temperature model, of correction or of rule is unknown.
    Kind,
    /// The temperatures of the piecewise model do not rise.
    Knots,
    /// The points of an axis are no table.
    Table(Axis, TableError),
    /// The matrix hardly depends on one of the directions that it has to tell apart.
    Matrix,
    /// The offset is 2 g or more.
    Offset,
    /// A harmonic of more than 5 deg: no part is bent so much.
    Harmonics,
}

/// Length of the encoding in bytes.
pub fn length(calibration: &Calibration) -> u32 {
    let words = HEAD + temperature_size(&calibration.temperature);
    let words = words + correction_size(&calibration.correction) + 1;
    (words * 4) as u32
}

/// Writes the encoding from byte `offset` on into `into`; how many bytes, fewer only at the end.
pub fn read_at(calibration: &Calibration, offset: u32, into: &mut [u8]) -> usize {
    let end = length(calibration);
    let mut written = 0;
    for (at, byte) in (offset..end).zip(into.iter_mut()) {
        let place = (at >> 2) as usize;
        let word = if at < end - 4 {
            word(calibration, place)
        } else {
            check_sum(calibration, place)
        };
        *byte = (word >> (8 * (at & 3))) as u8;
        written += 1;
    }
    written
}

/// The CRC-32 at the end of the encoding: what tells one calibration from another.
pub fn identity(calibration: &Calibration) -> u32 {
    let words = (length(calibration) >> 2) as usize;
    check_sum(calibration, words.saturating_sub(1))
}

/// The check sum over the first `words` words.
fn check_sum(calibration: &Calibration, words: usize) -> u32 {
    let mut crc = Crc32::new();
    for place in 0..words {
        crc.add(&word(calibration, place).to_le_bytes());
    }
    crc.value()
}

/// One word of the encoding; 0 beyond the content.
fn word(calibration: &Calibration, place: usize) -> u32 {
    let budget = &calibration.budget;
    match place {
        0 => MAGIC,
        1 => VERSION,
        2 => length(calibration),
        3 => kinds(calibration),
        4 => budget.noise,
        5 => budget.repeatability,
        6 => budget.hysteresis,
        7 => budget.reference.0,
        8 => budget.residual.0,
        HEAD.. => {
            let place = place - HEAD;
            let size = temperature_size(&calibration.temperature);
            let word = match place.checked_sub(size) {
                None => temperature_word(&calibration.temperature, place),
                Some(place) => correction_word(&calibration.correction, place),
            };
            word.unwrap_or(0) as u32
        }
    }
}

fn kinds(calibration: &Calibration) -> u32 {
    let temperature = match calibration.temperature {
        TemperatureModel::None => 0,
        TemperatureModel::DataSheet(_) => 1,
        TemperatureModel::Piecewise(_) => 2,
        TemperatureModel::Quadratic(_) => 3,
    };
    let rule = match &calibration.correction {
        Correction::Tables { rule, .. } => rule_code(*rule),
        Correction::TwoAxis { .. } | Correction::OneAxis { .. } => 0,
    };
    let correction = kind(&calibration.correction);
    u32::from_le_bytes([temperature, correction, rule, 0])
}

/// The kind of correction by its number: 0 tables, 1 two axes, 2 one axis.
pub const fn kind(correction: &Correction) -> u8 {
    match correction {
        Correction::Tables { .. } => 0,
        Correction::TwoAxis { .. } => 1,
        Correction::OneAxis { .. } => 2,
    }
}

const fn rule_code(rule: Rule) -> u8 {
    match rule {
        Rule::Nearest => 0,
        Rule::Linear => 1,
        Rule::PrintedQuarter => 2,
    }
}

const fn temperature_size(model: &TemperatureModel) -> usize {
    match model {
        TemperatureModel::None => 0,
        TemperatureModel::DataSheet(_) => 3,
        TemperatureModel::Piecewise(_) => PIECEWISE,
        TemperatureModel::Quadratic(_) => QUADRATIC,
    }
}

fn correction_size(correction: &Correction) -> usize {
    match correction {
        Correction::Tables { tables, .. } => table_size(&tables.x) + table_size(&tables.y),
        Correction::TwoAxis { .. } => VECTOR + 2 * HARMONICS,
        Correction::OneAxis { .. } => VECTOR + HARMONICS,
    }
}

fn table_size(table: &Table) -> usize {
    1 + 2 * table.points().len()
}

/// The number at `place` in the row of `parts`.
fn pick(parts: &[&[i32]], mut place: usize) -> Option<i32> {
    for part in parts {
        match part.get(place) {
            Some(number) => return Some(*number),
            None => place = place.checked_sub(part.len())?,
        }
    }
    None
}

fn temperature_word(model: &TemperatureModel, place: usize) -> Option<i32> {
    match model {
        TemperatureModel::None => None,
        TemperatureModel::DataSheet(model) => pick(&[&model.tco_q8], place),
        TemperatureModel::Piecewise(model) => match model.knots.get(place) {
            Some(knot) => Some(knot.0),
            None => pick(&[model.slopes_q8.as_flattened()], place.checked_sub(KNOTS)?),
        },
        TemperatureModel::Quadratic(model) => {
            let Quadratic {
                offset1_q8,
                offset2_q16,
                gain1_q38,
                gain2_q46,
            } = model;
            pick(&[offset1_q8, offset2_q16, gain1_q38, gain2_q46], place)
        }
    }
}

fn correction_word(correction: &Correction, place: usize) -> Option<i32> {
    match correction {
        Correction::Tables { tables, .. } => match place.checked_sub(table_size(&tables.x)) {
            None => table_word(&tables.x, place),
            Some(place) => table_word(&tables.y, place),
        },
        Correction::TwoAxis { vector, harmonics } => {
            let Axes { x, y } = harmonics;
            let matrix = vector.matrix.as_flattened();
            let parts = [
                matrix,
                &vector.offset,
                &x.cosine,
                &x.sine,
                &y.cosine,
                &y.sine,
            ];
            pick(&parts, place)
        }
        Correction::OneAxis { vector, harmonics } => {
            let matrix = vector.matrix.as_flattened();
            let parts = [matrix, &vector.offset, &harmonics.cosine, &harmonics.sine];
            pick(&parts, place)
        }
    }
}

fn table_word(table: &Table, place: usize) -> Option<i32> {
    let Some(place) = place.checked_sub(1) else {
        return Some(table.points().len() as i32);
    };
    let point = table.points().get(place >> 1)?;
    Some(if place & 1 == 0 {
        point.accel
    } else {
        point.angle.0
    })
}

/// Where bytes come from: offset and room in, the number of bytes out (fewer only at the end).
pub type Source<'a> = dyn FnMut(u32, &mut [u8]) -> usize + 'a;

/// Reads an encoding into `result`, in its place: no second calibration fits in the RAM.
///
/// Accelerations that fall within a table are pooled, as [`Table::new`] does. Errors: see
/// [`DecodeError`]; `result` is then worth nothing, unless the envelope was refused already.
pub fn decode_into(result: &mut Calibration, source: &mut Source<'_>) -> Result<(), DecodeError> {
    let end = envelope(source)?;
    let mut words = Words { source, at: 12 };
    let [temperature, correction, rule, reserved] = words.next()?.to_le_bytes();
    let budget = &mut result.budget;
    budget.noise = words.next()?;
    budget.repeatability = words.next()?;
    budget.hysteresis = words.next()?;
    budget.reference = Uncertainty(words.next()?);
    budget.residual = Uncertainty(words.next()?);
    result.temperature = words.temperature(temperature)?;
    let rule = rule_of(rule).ok_or(DecodeError::Kind)?;
    if reserved != 0 || (correction != 0 && rule != Rule::Nearest) {
        return Err(DecodeError::Kind);
    }
    match correction {
        0 => {
            let tables = tables_in(&mut result.correction, rule);
            let Axes { x, y } = tables.ok_or(DecodeError::Kind)?;
            words.table(x, Axis::X)?;
            words.table(y, Axis::Y)?;
        }
        1 | 2 => result.correction = words.vector(correction)?,
        _ => return Err(DecodeError::Kind),
    }
    if words.at != end {
        return Err(DecodeError::Length);
    }
    Ok(())
}

const fn rule_of(code: u8) -> Option<Rule> {
    match code {
        0 => Some(Rule::Nearest),
        1 => Some(Rule::Linear),
        2 => Some(Rule::PrintedQuarter),
        _ => None,
    }
}

/// Checks magic, version, length and check sum; where the check sum stands.
fn envelope(source: &mut Source<'_>) -> Result<u32, DecodeError> {
    let mut words = Words { source, at: 0 };
    if words.next()? != MAGIC {
        return Err(DecodeError::Magic);
    }
    match words.next()? {
        VERSION => {}
        version => return Err(DecodeError::Version(version)),
    }
    let length = words.next()?;
    if !(48..=MAX_LENGTH).contains(&length) || length & 3 != 0 {
        return Err(DecodeError::Length);
    }
    let mut crc = Crc32::new();
    words.at = 0;
    while words.at < length - 4 {
        crc.add(&words.next()?.to_le_bytes());
    }
    if words.next()? != crc.value() {
        return Err(DecodeError::CheckSum);
    }
    if (words.source)(length, &mut [0]) != 0 {
        return Err(DecodeError::Length);
    }
    Ok(length - 4)
}

/// A place in the bytes.
struct Words<'a, 'b> {
    source: &'a mut Source<'b>,
    at: u32,
}

impl Words<'_, '_> {
    fn next(&mut self) -> Result<u32, DecodeError> {
        let mut bytes = [0; 4];
        if (self.source)(self.at, &mut bytes) < bytes.len() {
            return Err(DecodeError::Truncated);
        }
        self.at = self.at.saturating_add(4);
        Ok(u32::from_le_bytes(bytes))
    }

    fn signed(&mut self) -> Result<i32, DecodeError> {
        self.next().map(|word| word as i32)
    }

    fn fill(&mut self, numbers: &mut [i32]) -> Result<(), DecodeError> {
        for number in numbers {
            *number = self.signed()?;
        }
        Ok(())
    }

    fn temperature(&mut self, kind: u8) -> Result<TemperatureModel, DecodeError> {
        match kind {
            0 => Ok(TemperatureModel::None),
            1 => {
                let mut model = tilt::temperature::DataSheet::default();
                self.fill(&mut model.tco_q8)?;
                Ok(TemperatureModel::DataSheet(model))
            }
            2 => self.piecewise().map(TemperatureModel::Piecewise),
            3 => {
                let mut model = Quadratic::default();
                self.fill(&mut model.offset1_q8)?;
                self.fill(&mut model.offset2_q16)?;
                self.fill(&mut model.gain1_q38)?;
                self.fill(&mut model.gain2_q46)?;
                Ok(TemperatureModel::Quadratic(model))
            }
            _ => Err(DecodeError::Kind),
        }
    }

    fn piecewise(&mut self) -> Result<Piecewise, DecodeError> {
        let mut model = Piecewise::default();
        for knot in &mut model.knots {
            knot.0 = self.signed()?;
        }
        let pairs = model.knots.iter().zip(model.knots.iter().skip(1));
        if pairs.into_iter().any(|(low, high)| low >= high) {
            return Err(DecodeError::Knots);
        }
        self.fill(model.slopes_q8.as_flattened_mut())?;
        Ok(model)
    }

    fn vector(&mut self, kind: u8) -> Result<Correction, DecodeError> {
        let mut vector = Vector::IDENTITY;
        self.fill(vector.matrix.as_flattened_mut())?;
        self.fill(&mut vector.offset)?;
        let one_axis = kind == 2;
        if !tells_directions_apart(&vector.matrix, one_axis) {
            return Err(DecodeError::Matrix);
        }
        if vector.offset.iter().any(|o| o.unsigned_abs() >= OFFSET) {
            return Err(DecodeError::Offset);
        }
        let x = self.harmonics()?;
        if one_axis {
            let harmonics = x;
            return Ok(Correction::OneAxis { vector, harmonics });
        }
        let y = self.harmonics()?;
        let harmonics = Axes { x, y };
        Ok(Correction::TwoAxis { vector, harmonics })
    }

    fn harmonics(&mut self) -> Result<Harmonics, DecodeError> {
        let mut harmonics = Harmonics::default();
        self.fill(&mut harmonics.cosine)?;
        self.fill(&mut harmonics.sine)?;
        let mut all = harmonics.cosine.iter().chain(&harmonics.sine);
        if all.any(|a| a.unsigned_abs() > HARMONIC) {
            return Err(DecodeError::Harmonics);
        }
        Ok(harmonics)
    }

    fn table(&mut self, table: &mut Table, axis: Axis) -> Result<(), DecodeError> {
        let refused = |error| DecodeError::Table(axis, error);
        let mut builder = table.rebuild();
        for _ in 0..self.next()? {
            let accel = self.signed()?;
            let angle = tilt::angle::Angle(self.signed()?);
            builder.push(Point { accel, angle }).map_err(refused)?;
        }
        builder.finish().map_err(refused)
    }
}

/// 2 g in steps of 2^-26 g: what [`Vector::from_real`] refuses.
const OFFSET: u32 = 1 << 27;

/// 5 deg in steps of the angle.
const HARMONIC: u32 = 59_652_324;

/// Whether the volume that the matrix makes of the unit cube is 1/8 at least; in one-axis mode,
/// which calibrates the plane of x and z only, the area that it makes of the unit square.
fn tells_directions_apart(matrix: &[[i32; 3]; 3], one_axis: bool) -> bool {
    // 14 fractional bits are left, so that the products of three stay within 48 bits.
    let [[a, b, c], [d, e, f], [g, h, i]] = matrix.map(|row| row.map(|v| i64::from(v >> 16)));
    if one_axis {
        return (a * i - c * g).unsigned_abs() >= 1 << 25;
    }
    let volume = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
    volume.unsigned_abs() >= 1 << 39
}

#[cfg(test)]
mod tests;
