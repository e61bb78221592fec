//! A calibration as bytes: for the DOMAIN of the dictionary, the record store and host tools.
//!
//! In: a [`Calibration`], any part of whose bytes is made on demand, without a buffer. Out of
//! bytes: a [`Calibration`], or a [`DecodeError`] that names what was refused.
//!
//! # Format, version 3
//! Words of 32 bits, little-endian; numbers with sign in two's complement.
//!
//! | words | content |
//! |---|---|
//! | 1 | "PLMC" (434D4C50h) |
//! | 1 | version, 3 |
//! | 1 | length of the whole in bytes, check sum included |
//! | 1 | kinds: byte 0 temperature model, byte 1 correction, byte 2 rule, byte 3 gyroscope |
//! | 5 | budget: noise, repeatability, hysteresis (2^-26 g), reference, residual (2^-32 circle) |
//! | 1 | budget: temperature of the fit, 1/256 degC |
//! | 3 | budget: change per degC (2^-26 g), lowest and highest temperature (1/256 degC) |
//! | 0, 3, 33 or 12 | temperature model |
//! | see below | correction |
//! | 21 | gyroscope |
//! | 1 | CRC-32 ([`Crc32`]) over all bytes before |
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
//! Gyroscope, of kind 1 ([`RateCorrection`](tilt::rate::RateCorrection)): nine of the matrix by
//! rows, then `scale1_q38`, `bias_q30`, `bias1_q38` and `bias2_q46`, each x, y, z.
//!
//! Units are those of the types in `tilt`. The longest, two full tables and a gyroscope, is 3176
//! bytes.
//!
//! # Version 2
//! The same without a gyroscope: kind 0, and no words of it. It is written for every calibration
//! that has none, and version 3 is never without. An instrument without a gyroscope refuses
//! version 3; one with a gyroscope reads all versions, and measures without it by a calibration
//! that does not have these words.
//!
//! # Version 1
//! As version 2, without the four words of the budget that tell how it goes with the temperature;
//! in their place 25 degC, [`TCO`] and [`Span::implied_by`] stand. It is read, and written for a
//! calibration that has just these: what was stored before keeps its bytes, its check sum and its
//! report.
//!
//! Left out: storing, and putting in force.

mod gyroscope;

use flash::check_sum::Crc32;
use tilt::angle::{Axes, Harmonics};
use tilt::chain::{Calibration, Correction};
use tilt::composition::{Composition, Place};
use tilt::sample::Temperature;
use tilt::table::{MAX_POINTS, Point, Rule, Table, TableError};
use tilt::temperature::{DataSheet, KNOTS, Piecewise, Quadratic, TemperatureModel};
use tilt::uncertainty::{Budget, Span, TCO, Uncertainty};
use tilt::vector::Vector;

use super::motor::{Axis, MOTOR};
use super::tables_in;

/// "PLMC" as a little-endian word.
pub const MAGIC: u32 = u32::from_le_bytes(*b"PLMC");

/// The latest version: it has a gyroscope's words.
pub const VERSION: u32 = 3;

/// The version without a gyroscope that tells how the uncertainty goes with the temperature.
const VERSION_WITHOUT_RATES: u32 = 2;

/// The version that leaves that to [`TCO`] and [`Span::implied_by`].
const VERSION_WITHOUT_SPAN: u32 = 1;

/// Words before the kinds.
const HEAD: u32 = 3;

/// Words from the kinds to the temperature model.
const BUDGET: usize = 10;

/// Words of a piecewise model.
const PIECEWISE: usize = KNOTS + 3 * (KNOTS - 1);

/// Words of two full tables.
const TABLES: usize = 2 * (1 + 2 * MAX_POINTS);

/// The longest encoding in bytes: a piecewise model, two full tables and a gyroscope.
pub const MAX_LENGTH: u32 =
    4 * (HEAD + (BUDGET + PIECEWISE + TABLES + gyroscope::WORDS + 1) as u32);

/// Why bytes are no calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// The bytes end early.
    Truncated,
    /// They do not begin with [`MAGIC`].
    Magic,
    /// They are of a later version than [`VERSION`], or of none.
    Version,
    /// The length they state is impossible, or not that of their content or of the transfer.
    Length,
    /// The check sum is wrong.
    CheckSum,
    /// The kind of temperature model, of correction, of rule or of gyroscope is unknown.
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
    /// It is that of an instrument with a gyroscope, and this one has none. Nothing of it is taken.
    NoGyroscope,
    /// No gyroscope in its housing: an entry of the matrix is further than 1/4 from the
    /// identity's, the bias at 25 degC is above 20 deg/s, grows by more than 0.1 (deg/s)/degC or
    /// 0.001 (deg/s)/degC^2, or the scale by more than 0.1 %/degC.
    Rates,
}

/// Length of the encoding in bytes.
pub fn length<C: Composition>(calibration: &Calibration<C>) -> u32 {
    let mut words = HEAD;
    content(calibration, &mut |_| words += 1);
    // The check sum is one more.
    4 * (words + 1)
}

/// Writes the encoding from byte `offset` on into `into`; how many bytes, fewer only at the end.
///
/// Goes through all of it each time, since a machine reads its calibration once in a while.
pub fn read_at<C: Composition>(
    calibration: &Calibration<C>,
    offset: u32,
    into: &mut [u8],
) -> usize {
    let end = length(calibration);
    let size = (into.len() as u32).min(end.saturating_sub(offset));
    let mut at = 0_u32;
    let mut put = |word: u32| {
        for byte in word.to_le_bytes() {
            let place = at.checked_sub(offset).map(|place| place as usize);
            if let Some(slot) = place.and_then(|place| into.get_mut(place)) {
                *slot = byte;
            }
            at += 1;
        }
    };
    words(calibration, &mut put);
    if offset + size > end - 4 {
        put(identity(calibration));
    }
    size as usize
}

/// The CRC-32 at the end of the encoding: what tells one calibration from another.
pub fn identity<C: Composition>(calibration: &Calibration<C>) -> u32 {
    let mut crc = Crc32::new();
    words(calibration, &mut |word| crc.add(&word.to_le_bytes()));
    crc.value()
}

/// Every word but the check sum, in order.
fn words<C: Composition>(calibration: &Calibration<C>, put: &mut dyn FnMut(u32)) {
    put(MAGIC);
    put(version(calibration));
    put(length(calibration));
    content(calibration, put);
}

/// The version that holds all of it in the fewest words.
fn version<C: Composition>(calibration: &Calibration<C>) -> u32 {
    if calibration.rates.is_some() {
        return VERSION;
    }
    let budget = &calibration.budget;
    let implied = with_implied(*budget, &calibration.temperature);
    if *budget == implied {
        VERSION_WITHOUT_SPAN
    } else {
        VERSION_WITHOUT_RATES
    }
}

/// `budget` with what version 1 does not tell.
fn with_implied<C: Composition>(budget: Budget, temperature: &TemperatureModel<C>) -> Budget {
    Budget {
        fitted_at: Temperature::REFERENCE,
        tco: TCO,
        span: Span::implied_by(temperature),
        ..budget
    }
}

/// The budget's words; version 1 has those before the last four.
const fn budget_words(budget: &Budget) -> [u32; 9] {
    [
        budget.noise,
        budget.repeatability,
        budget.hysteresis,
        budget.reference.0,
        budget.residual.0,
        budget.fitted_at.0 as u32,
        budget.tco,
        budget.span.low.0 as u32,
        budget.span.high.0 as u32,
    ]
}

const fn budget_length(version: u32) -> usize {
    if version == VERSION_WITHOUT_SPAN {
        5
    } else {
        9
    }
}

/// Every word from the kinds on.
fn content<C: Composition>(calibration: &Calibration<C>, put: &mut dyn FnMut(u32)) {
    put(kinds(calibration));
    let words = budget_words(&calibration.budget);
    let count = budget_length(version(calibration));
    words.iter().take(count).for_each(|word| put(*word));
    let mut all = |numbers: &[i32]| numbers.iter().for_each(|number| put(*number as u32));
    match &calibration.temperature {
        TemperatureModel::None => {}
        TemperatureModel::DataSheet(model) => all(&model.tco_q8),
        TemperatureModel::Piecewise(model) => {
            model.knots.iter().for_each(|knot| all(&[knot.0]));
            all(model.slopes_q8.as_flattened());
        }
        TemperatureModel::Quadratic(model) => {
            let Quadratic {
                offset1_q8,
                offset2_q16,
                gain1_q38,
                gain2_q46,
            } = model.get();
            for part in &[offset1_q8, offset2_q16, gain1_q38, gain2_q46] {
                all(*part);
            }
        }
    }
    match &calibration.correction {
        Correction::Tables { tables, .. } => {
            let Axes { x, y } = tables.get();
            [x, y].into_iter().for_each(|table| {
                all(&[table.points().len() as i32]);
                table
                    .points()
                    .iter()
                    .for_each(|point| all(&[point.accel, point.angle.0]));
            });
        }
        Correction::TwoAxis { vector, harmonics } => {
            affine(vector.get(), &mut all);
            wave(&harmonics.x, &mut all);
            wave(&harmonics.y, &mut all);
        }
        Correction::OneAxis { vector, harmonics } => {
            affine(vector.get(), &mut all);
            wave(harmonics, &mut all);
        }
    }
    if let Some(rates) = &calibration.rates {
        gyroscope::put(rates.get(), &mut all);
    }
}

fn affine(vector: &Vector, all: &mut dyn FnMut(&[i32])) {
    all(vector.matrix.as_flattened());
    all(&vector.offset);
}

fn wave(harmonics: &Harmonics, all: &mut dyn FnMut(&[i32])) {
    all(&harmonics.cosine);
    all(&harmonics.sine);
}

fn kinds<C: Composition>(calibration: &Calibration<C>) -> u32 {
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
    let gyroscope = u8::from(calibration.rates.is_some());
    u32::from_le_bytes([temperature, correction, rule, gyroscope])
}

/// The kind of correction by its number: 0 tables, 1 two axes, 2 one axis.
pub const fn kind<C: Composition>(correction: &Correction<C>) -> u8 {
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

/// Where bytes come from: offset and room in, the number of bytes out (fewer only at the end).
pub type Source<'a> = dyn FnMut(u32, &mut [u8]) -> usize + 'a;

/// Reads an encoding into `result`, in its place: no second calibration fits in the RAM.
///
/// Accelerations that fall within a table are pooled, as [`Table::new`] does. Errors: see
/// [`DecodeError`]; `result` is then worth nothing, unless the envelope was refused already.
pub fn decode_into<C: Composition>(
    result: &mut Calibration<C>,
    source: &mut Source<'_>,
) -> Result<(), DecodeError> {
    let (end, version) = envelope::<C>(source)?;
    let mut words = Words { source, at: 12 };
    let [temperature, correction, rule, gyroscope] = words.next()?.to_le_bytes();
    let mut told = [0; 9];
    for word in told.iter_mut().take(budget_length(version)) {
        *word = words.next()?;
    }
    words.temperature(temperature, &mut result.temperature)?;
    result.budget = budget(told, version, &result.temperature);
    let rule = rule_of(rule).ok_or(DecodeError::Kind)?;
    if gyroscope != u8::from(version == VERSION) || (correction != 0 && rule != Rule::Nearest) {
        return Err(DecodeError::Kind);
    }
    words.correction(correction, rule, &mut result.correction)?;
    gyroscope::fill::<C>(&mut words, gyroscope != 0, &mut result.rates)?;
    if words.at != end {
        return Err(DecodeError::Length);
    }
    give_budget(result);
    Ok(())
}

/// Tables that a node made by itself came with a budget of zeros once, which no part keeps: they
/// get the one that their points tell, and anything else without one that of the data sheet.
fn give_budget<C: Composition>(calibration: &mut Calibration<C>) {
    if !C::UNCERTAINTY {
        return;
    }
    let Budget {
        repeatability,
        reference,
        residual,
        ..
    } = calibration.budget;
    if repeatability | reference.0 | residual.0 != 0 {
        return;
    }
    let budget = &mut calibration.budget;
    budget.noise = Budget::DATA_SHEET.noise;
    budget.hysteresis = Budget::DATA_SHEET.hysteresis;
    match &calibration.correction {
        Correction::Tables { tables, .. } => budget.take_tables(tables.get(), MOTOR),
        _ => *budget = Budget::DATA_SHEET,
    }
}

/// A budget from its words; what version 1 does not tell is implied.
fn budget<C: Composition>(
    words: [u32; 9],
    version: u32,
    temperature: &TemperatureModel<C>,
) -> Budget {
    let [
        noise,
        repeatability,
        hysteresis,
        reference,
        residual,
        fitted_at,
        tco,
        low,
        high,
    ] = words;
    let told = Budget {
        noise,
        repeatability,
        hysteresis,
        reference: Uncertainty(reference),
        residual: Uncertainty(residual),
        fitted_at: Temperature(fitted_at as i32),
        tco,
        span: Span {
            low: Temperature(low as i32),
            high: Temperature(high as i32),
        },
    };
    match version {
        VERSION_WITHOUT_SPAN => with_implied(told, temperature),
        _ => told,
    }
}

const fn rule_of(code: u8) -> Option<Rule> {
    match code {
        0 => Some(Rule::Nearest),
        1 => Some(Rule::Linear),
        2 => Some(Rule::PrintedQuarter),
        _ => None,
    }
}

/// Checks magic, version, length and check sum; where the check sum stands, and the version.
fn envelope<C: Composition>(source: &mut Source<'_>) -> Result<(u32, u32), DecodeError> {
    let mut words = Words { source, at: 0 };
    if words.next()? != MAGIC {
        return Err(DecodeError::Magic);
    }
    let version = words.next()?;
    if version == VERSION && !C::Rates::FITTED {
        return Err(DecodeError::NoGyroscope);
    }
    if !matches!(version, VERSION_WITHOUT_SPAN..=VERSION) {
        return Err(DecodeError::Version);
    }
    let length = words.next()?;
    if !matches!(length, 48..=MAX_LENGTH) || length & 3 != 0 {
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
    Ok((length - 4, version))
}

/// A place in the bytes.
struct Words<'a, 'b> {
    source: &'a mut Source<'b>,
    at: u32,
}

impl Words<'_, '_> {
    /// The next word; `None` where the bytes end. Out of line, and without the error, it comes
    /// back in two registers.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn word(&mut self) -> Option<u32> {
        let mut bytes = [0; 4];
        if (self.source)(self.at, &mut bytes) < bytes.len() {
            return None;
        }
        self.at = self.at.saturating_add(4);
        Some(u32::from_le_bytes(bytes))
    }

    fn next(&mut self) -> Result<u32, DecodeError> {
        self.word().ok_or(DecodeError::Truncated)
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

    /// Each kind is put in its place blank and then filled there, which takes no room of its own.
    fn temperature<C: Composition>(
        &mut self,
        kind: u8,
        model: &mut TemperatureModel<C>,
    ) -> Result<(), DecodeError> {
        *model = match kind {
            0 => TemperatureModel::None,
            1 => TemperatureModel::DataSheet(DataSheet::default()),
            2 => TemperatureModel::Piecewise(Piecewise::default()),
            3 => TemperatureModel::Quadratic(
                C::Quadratic::put(Quadratic::default).ok_or(DecodeError::Kind)?,
            ),
            _ => return Err(DecodeError::Kind),
        };
        match model {
            TemperatureModel::None => Ok(()),
            TemperatureModel::DataSheet(model) => self.fill(&mut model.tco_q8),
            TemperatureModel::Piecewise(model) => self.piecewise(model),
            TemperatureModel::Quadratic(model) => {
                let model = model.get_mut();
                self.fill(&mut model.offset1_q8)?;
                self.fill(&mut model.offset2_q16)?;
                self.fill(&mut model.gain1_q38)?;
                self.fill(&mut model.gain2_q46)
            }
        }
    }

    fn piecewise(&mut self, model: &mut Piecewise) -> Result<(), DecodeError> {
        for knot in &mut model.knots {
            knot.0 = self.signed()?;
        }
        if !model.knots.is_sorted_by(|low, high| low < high) {
            return Err(DecodeError::Knots);
        }
        self.fill(model.slopes_q8.as_flattened_mut())
    }

    fn correction<C: Composition>(
        &mut self,
        kind: u8,
        rule: Rule,
        correction: &mut Correction<C>,
    ) -> Result<(), DecodeError> {
        let blank = || C::Vector::put(|| Vector::IDENTITY).ok_or(DecodeError::Kind);
        match kind {
            0 => drop(tables_in(correction, rule).ok_or(DecodeError::Kind)?),
            1 => {
                let (vector, harmonics) = (blank()?, Axes::default());
                *correction = Correction::TwoAxis { vector, harmonics };
            }
            2 => {
                let (vector, harmonics) = (blank()?, Harmonics::default());
                *correction = Correction::OneAxis { vector, harmonics };
            }
            _ => return Err(DecodeError::Kind),
        }
        match correction {
            Correction::Tables { tables, .. } => {
                let tables = tables.get_mut();
                self.table(&mut tables.x, Axis::X)?;
                self.table(&mut tables.y, Axis::Y)
            }
            Correction::TwoAxis { vector, harmonics } => {
                self.vector(vector.get_mut(), false)?;
                self.harmonics(&mut harmonics.x)?;
                self.harmonics(&mut harmonics.y)
            }
            Correction::OneAxis { vector, harmonics } => {
                self.vector(vector.get_mut(), true)?;
                self.harmonics(harmonics)
            }
        }
    }

    fn vector(&mut self, vector: &mut Vector, one_axis: bool) -> Result<(), DecodeError> {
        self.fill(vector.matrix.as_flattened_mut())?;
        self.fill(&mut vector.offset)?;
        if !tells_directions_apart(&vector.matrix, one_axis) {
            return Err(DecodeError::Matrix);
        }
        if vector.offset.iter().any(|o| o.unsigned_abs() >= OFFSET) {
            return Err(DecodeError::Offset);
        }
        Ok(())
    }

    fn harmonics(&mut self, harmonics: &mut Harmonics) -> Result<(), DecodeError> {
        self.fill(&mut harmonics.cosine)?;
        self.fill(&mut harmonics.sine)?;
        let mut all = harmonics.cosine.iter().chain(&harmonics.sine);
        if all.any(|a| a.unsigned_abs() > HARMONIC) {
            return Err(DecodeError::Harmonics);
        }
        Ok(())
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
    let [[a, b, c], middle, low] = matrix;
    let [d, e, f] = middle;
    let [g, h, i] = low;
    if one_axis {
        return area([a, c], [g, i]).unsigned_abs() >= 1 << 25;
    }
    let parts = [
        (a, area([e, f], [h, i])),
        (b, area([f, d], [i, g])),
        (c, area([d, e], [g, h])),
    ];
    let volume = parts
        .iter()
        .map(|(n, area)| i64::from(*n >> 16) * i64::from(*area));
    volume.sum::<i64>().unsigned_abs() >= 1 << 39
}

/// The area of the parallelogram between two vectors. 14 fractional bits are left of each number,
/// so both products and their difference stay within 32 bits, and three of them times one more
/// within 48.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn area(one: [&i32; 2], other: [&i32; 2]) -> i32 {
    let [[a, b], [c, d]] = [one, other].map(|numbers| numbers.map(|number| *number >> 16));
    a * d - b * c
}

#[cfg(test)]
mod tests;
