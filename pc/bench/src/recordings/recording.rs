//! A recording of one channel: checked samples in g, and what was left out of the file.
//!
//! In: a CSV file, plain or gzip, whose header names the columns and their units (`columns`).
//! Out: [`Recording`]: rows with strictly rising time from 0, with the nominal period, the gaps
//! and the count of every row that was skipped; or one [`FileError`]. Comment lines (`#`)
//! and blank lines don't count as rows. A row stands by its time and its accelerations alone: a
//! temperature or reference that can't be read is left out of the row and counted apart.

use std::io;
use std::path::Path;
use std::sync::Arc;

use bus_logs::{Damage, Input, Line};
use tilt::sample::{Counts, FullScale};

use super::cells::{optional, required};
use super::columns::{Columns, ReferenceColumns, TIMES, TimeUnit, clean};
use super::error::{FileError, Problem};

use super::rates::{self, Turning};
use super::reference::{Attitude, Reference};
use super::scale::{Scale, scale_of};
use super::skips::{Count, Reason, Skips};
use super::windows::quantile;
use output::progress::Task;

/// Fewest rows that are worth looking at.
pub const FEWEST_ROWS: usize = 50;

/// Most rows of one file: over a day at 100 samples per second.
pub const MOST_ROWS: usize = 10_000_000;

/// More periods than this between two rows is a gap, after which the chain starts anew.
pub const GAP_PERIODS: u64 = 5;

/// Most wrong times in a row that are found to be ahead of what follows.
const MOST_AHEAD: usize = 3;

/// The last rows are ahead of the recording when they leap by more than this, in periods and
/// seconds. Nothing follows that would tell.
const LAST_AHEAD: (f64, f64) = (100.0, 10.0);

/// Larger numbers are no acceleration in any unit.
const ABSURD: f64 = 1e6;

/// The largest acceleration of an axis that is believed, g.
const FULL_SCALE_G: f64 = 16.0;

/// Rates that are believed, samples per second.
const RATES_HZ: std::ops::RangeInclusive<f64> = 25.0..=10_000.0;

/// What the caller gives beside the file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// Counts per g of `_lsb` columns; found by the length at standstill when not given.
    pub lsb_per_g: Option<f64>,
}

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Its line in the file, counted from 1.
    pub line: u64,
    /// Microseconds since the first row.
    pub time_us: u64,
    /// Acceleration in the sensor's axes, nominal g.
    pub accel_g: [f64; 3],
    /// Rate of turn about the sensor's axes, rad/s, if recorded.
    pub rate_radps: Option<[f64; 3]>,
    /// Whether the row counts against the reference; true where the recording does not state it.
    pub counts: bool,
    /// Temperature in degC, if recorded.
    pub temperature_c: Option<f64>,
    /// The reference, if recorded.
    pub reference: Option<Reference>,
    /// True for the first row and for one that follows a gap: the chain must start anew.
    pub starts_anew: bool,
}

/// A recording that passed the checks.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The file as the caller named it.
    pub file: String,
    /// What the header said.
    pub columns: Columns,
    /// The time column at the first row, microseconds: what the clock of the recording said.
    pub start_us: i64,
    /// The samples, time strictly rising.
    pub rows: Vec<Row>,
    /// How the recording's numbers became g.
    pub scale: Scale,
    /// Median time between rows, microseconds.
    pub period_us: u64,
    /// Spans of over [`GAP_PERIODS`] periods without a row, with the line after the first.
    pub gaps: Count,
    /// Lines of data in the file: kept and skipped.
    pub data_lines: u64,
    /// The rows left out.
    pub skips: Skips,
    /// The file went on behind the end of its gzip stream, with bytes that were not read.
    pub trailing_bytes: bool,
    /// Rows kept without their temperature, reference or rate, which is no number or no attitude.
    ///
    /// Loggers that interpolate a quaternion across its change of sign write such: its length
    /// falls to 0 on the way.
    pub unread_extras: Count,
}

impl Recording {
    /// Reads a file. The task is told of the bytes as they are read.
    pub fn open(path: &Path, options: Options, task: Option<Arc<Task>>) -> Result<Self, FileError> {
        Self::parse(
            &path.display().to_string(),
            Input::open(path, task),
            options,
        )
    }

    /// Reads any stream; `name` is what errors call it.
    #[cfg(test)]
    pub fn read(
        name: &str,
        source: impl io::Read + Send + 'static,
        options: Options,
    ) -> Result<Self, FileError> {
        Self::parse(name, Input::new(source, None), options)
    }

    fn parse(name: &str, input: io::Result<Input>, options: Options) -> Result<Self, FileError> {
        let input =
            input.map_err(|error| FileError::of_file(name, Problem::not_readable(&error)))?;
        Parser::run(name, input)?.finish(options)
    }

    /// Nominal samples per second.
    pub fn rate_hz(&self) -> f64 {
        1e6 / self.period_us as f64
    }

    /// Time from the first row to the last, seconds.
    pub fn duration_s(&self) -> f64 {
        self.rows.last().map_or(0.0, |row| row.time_us as f64 / 1e6)
    }

    /// The smallest range of the chain that holds every sample.
    pub fn full_scale(&self) -> FullScale {
        let largest = self
            .rows
            .iter()
            .flat_map(|row| row.accel_g)
            .fold(0.0, |m: f64, a| m.max(a.abs()));
        let holds = |range: &FullScale| largest < f64::from(range.g()) * (32_767.0 / 32_768.0);
        let ranges = [FullScale::G2, FullScale::G4, FullScale::G8];
        ranges.into_iter().find(holds).unwrap_or(FullScale::G16)
    }

    /// True when some row has the rate of a gyroscope.
    pub fn has_rate(&self) -> bool {
        self.rows.iter().any(|row| row.rate_radps.is_some())
    }

    /// True when some row has a reference.
    pub fn has_reference(&self) -> bool {
        self.rows.iter().any(|row| row.reference.is_some())
    }
}

impl Row {
    /// The sample as the chain takes it: left-justified counts of the range, clipped at its ends.
    pub fn counts(&self, range: FullScale) -> Counts {
        let per_g = f64::from(range.counts_per_g());
        // A float to integer cast stops at the ends of the range.
        Counts(self.accel_g.map(|a| (a * per_g).round() as i16))
    }
}

/// A row as it stands in the file, before the scale is known.
struct Raw {
    line: u64,
    time: f64,
    accel: [f64; 3],
    rate_radps: Option<[f64; 3]>,
    counts: bool,
    temperature: Option<f64>,
    reference: Option<Reference>,
    extras_read: bool,
}

struct Parser<'a> {
    name: &'a str,
    columns: Columns,
    header_line: u64,
    times_us: Vec<u64>,
    raws: Vec<Raw>,
    data_lines: u64,
    skips: Skips,
    unread_extras: Count,
    trailing_bytes: bool,
}

impl<'a> Parser<'a> {
    fn run(name: &'a str, mut input: Input) -> Result<Self, FileError> {
        let (columns, header_line) = header(name, &mut input)?;
        let mut parser = Self {
            name,
            columns,
            header_line,
            times_us: Vec::new(),
            raws: Vec::new(),
            data_lines: 0,
            skips: Skips::default(),
            unread_extras: Count::default(),
            trailing_bytes: false,
        };
        loop {
            let line = input.number() + 1;
            match input.next_line() {
                Ok(Some(Line::Whole(bytes) | Line::Unended(bytes))) => parser.take(line, bytes)?,
                Ok(Some(Line::TooLong(_))) => {
                    return Err(FileError::of_line(name, line, Problem::LineTooLong));
                }
                Ok(None) => {
                    parser.trailing_bytes = input.take_trailing_bytes();
                    return Ok(parser);
                }
                Err(error) => return Err(explain(name, &input, &error, parser.raws.len())),
            }
        }
    }

    fn take(&mut self, line: u64, bytes: &[u8]) -> Result<(), FileError> {
        if is_silent(bytes) {
            return Ok(());
        }
        self.data_lines += 1;
        let raw = match self.parse(line, bytes) {
            Ok(raw) => raw,
            Err(reason) => {
                self.skips.add(reason, line);
                return Ok(());
            }
        };
        self.take_back_jump(&raw);
        match self.place(&raw) {
            Err(reason) => self.skips.add(reason, line),
            Ok(_) if self.raws.len() >= MOST_ROWS => {
                let problem = Problem::TooManyRows(MOST_ROWS);
                return Err(FileError::of_line(self.name, line, problem));
            }
            Ok(time_us) => {
                self.times_us.push(time_us);
                self.raws.push(raw);
            }
        }
        Ok(())
    }

    /// Drops up to [`MOST_AHEAD`] last rows when their times leap ahead of what follows.
    ///
    /// One wrong digit in a time would otherwise make all rows up to that time backward ones.
    fn take_back_jump(&mut self, next: &Raw) {
        if self.raws.last().is_none_or(|last| next.time >= last.time) {
            return;
        }
        let len = self.raws.len();
        let leaps = |from: usize| {
            let before = from.checked_sub(1).and_then(|i| self.raws.get(i));
            match (before, self.raws.get(from)) {
                (None, _) => len == 1,
                (Some(before), Some(ahead)) => {
                    let step = next.time - before.time;
                    step > 0.0 && ahead.time - before.time > GAP_PERIODS as f64 * step
                }
                _ => false,
            }
        };
        let most = MOST_AHEAD.min(len);
        if let Some(from) = (1..=most).map(|k| len - k).find(|&from| leaps(from)) {
            self.drop_from(from);
        }
    }

    /// Drops up to [`MOST_AHEAD`] rows at the end that leap ahead of all others.
    fn take_back_last(&mut self) {
        let (periods, seconds) = LAST_AHEAD;
        let in_seconds = self.columns.time_unit.micros() / 1e6;
        let step = |pair: &[Raw]| match pair {
            [before, after] => (after.time - before.time) * in_seconds,
            _ => 0.0,
        };
        let leap = |most: f64| {
            let first = self.raws.len().saturating_sub(MOST_AHEAD).max(1);
            (first..self.raws.len()).find(|&i| {
                self.raws
                    .get(i - 1..=i)
                    .is_some_and(|pair| step(pair) > most)
            })
        };
        if leap(seconds).is_none() {
            return;
        }
        let period_s = quantile(self.raws.windows(2).map(step).collect(), 0.5).unwrap_or(0.0);
        if let Some(from) = leap(seconds.max(periods * period_s)) {
            self.drop_from(from);
        }
    }

    /// Drops the rows from a place on as ahead of the others.
    fn drop_from(&mut self, from: usize) {
        for raw in self.raws.drain(from.min(self.raws.len())..) {
            self.skips.add(Reason::ForwardJump, raw.line);
        }
        self.times_us.truncate(from);
    }

    fn parse(&self, line: u64, bytes: &[u8]) -> Result<Raw, Reason> {
        let text = std::str::from_utf8(bytes).map_err(|_| Reason::UnparsableCell)?;
        let cells: Vec<&str> = text.split(',').map(str::trim).collect();
        if cells.len() != self.columns.width {
            return Err(Reason::CellCount);
        }
        let cell = |place: usize| cells.get(place).copied().unwrap_or_default();
        let time = required(cell(self.columns.time))?;
        let [x, y, z] = self.columns.accel.map(|place| required(cell(place)));
        let accel = [x?, y?, z?];
        if accel == [0.0; 3] {
            return Err(Reason::AllZero);
        }
        if accel.iter().any(|a| a.abs() > ABSURD) {
            return Err(Reason::OverRange);
        }
        let temperature = match self.columns.temperature {
            Some(place) => optional(cell(place)),
            None => Ok(None),
        };
        let reference = match self.columns.reference {
            Some(places) => reference(places, cell),
            None => Ok(None),
        };
        let rate = match self.columns.rate {
            Some((places, unit)) => rates::rate_radps(places.map(cell), unit),
            None => Ok(None),
        };
        let moving = self
            .columns
            .moving
            .map_or(Ok(None), |place| optional(cell(place)));
        let extras_read =
            temperature.is_ok() && reference.is_ok() && rate.is_ok() && moving.is_ok();
        let (temperature, reference) = (temperature.unwrap_or(None), reference.unwrap_or(None));
        Ok(Raw {
            line,
            time,
            accel,
            rate_radps: rate.unwrap_or(None),
            counts: moving.unwrap_or(None).is_none_or(|moving| moving != 0.0),
            temperature,
            reference,
            extras_read,
        })
    }

    /// Microseconds since the first row, later than the row before.
    fn place(&self, raw: &Raw) -> Result<u64, Reason> {
        let (Some(first), Some(&before)) = (self.raws.first(), self.times_us.last()) else {
            return Ok(0);
        };
        let elapsed = (raw.time - first.time) * self.columns.time_unit.micros();
        // Past this, steps of a microsecond are lost; no recording lasts 285 years.
        if elapsed.abs() > 9e15 {
            return Err(Reason::UnparsableCell);
        }
        match elapsed.round() as i64 - before as i64 {
            0 => Err(Reason::RepeatedTime),
            ..0 => Err(Reason::BackwardTime),
            _ => Ok(elapsed.round() as u64),
        }
    }

    fn finish(mut self, options: Options) -> Result<Recording, FileError> {
        self.take_back_last();
        self.check_rows(self.raws.len())?;
        let accel: Vec<[f64; 3]> = self.raws.iter().map(|raw| raw.accel).collect();
        let period_us = self.period_us()?;
        let (unit, times_us) = (self.columns.unit, &self.times_us);
        let scale = scale_of(unit, times_us, &accel, options.lsb_per_g)
            .map_err(|problem| FileError::of_line(self.name, self.header_line, problem))?;
        let first_us = self.first_us();
        let (mut rows, late_us) = self.rows(scale.per_g);
        self.check_rows(rows.len())?;
        let gaps = mark_gaps(&mut rows, period_us);
        if let Some((_, unit)) = self.columns.rate {
            rates::check(stretches(&rows), period_us, unit)
                .map_err(|problem| FileError::of_line(self.name, self.header_line, problem))?;
        }
        Ok(Recording {
            file: self.name.to_owned(),
            columns: self.columns,
            start_us: first_us.saturating_add_unsigned(late_us),
            rows,
            scale,
            period_us,
            gaps,
            data_lines: self.data_lines,
            skips: self.skips,
            trailing_bytes: self.trailing_bytes,
            unread_extras: self.unread_extras,
        })
    }

    fn check_rows(&self, rows: usize) -> Result<(), FileError> {
        let skips = Box::new(self.skips.clone());
        if skips.total() > rows as u64 {
            let line = skips.worst().map(|(_, count)| count.first_line);
            let problem = Problem::MostlySkipped { rows, skips };
            return Err(FileError {
                file: self.name.to_owned(),
                line,
                problem,
            });
        }
        if rows < FEWEST_ROWS {
            return Err(FileError::of_file(
                self.name,
                Problem::TooFewRows { rows, skips },
            ));
        }
        Ok(())
    }

    fn period_us(&self) -> Result<u64, FileError> {
        let steps = self.times_us.iter().zip(self.times_us.iter().skip(1));
        let steps = steps
            .map(|(before, after)| (after - before) as f64)
            .collect();
        let period = quantile(steps, 0.5).unwrap_or(0.0).max(1.0);
        let hz = 1e6 / period;
        if RATES_HZ.contains(&hz) {
            return Ok(period as u64);
        }
        let fits = fitting_time(
            period / self.columns.time_unit.micros(),
            self.columns.time_unit,
        );
        let problem = Problem::Rate { hz, fits };
        Err(FileError::of_line(self.name, self.header_line, problem))
    }

    /// The time column at the first row, microseconds; a time beyond what 64 bits hold stops there.
    fn first_us(&self) -> i64 {
        let first = self.raws.first().map_or(0.0, |raw| raw.time);
        (first * self.columns.time_unit.micros()).round() as i64
    }

    /// The rows in g, without those beyond full scale, and how late the first of them is.
    fn rows(&mut self, per_g: f64) -> (Vec<Row>, u64) {
        let mut rows: Vec<Row> = Vec::with_capacity(self.raws.len());
        for (raw, &time_us) in self.raws.drain(..).zip(&self.times_us) {
            let accel_g = raw.accel.map(|a| a / per_g);
            if accel_g.iter().any(|a| a.abs() > FULL_SCALE_G) {
                self.skips.add(Reason::OverRange, raw.line);
                continue;
            }
            if !raw.extras_read {
                self.unread_extras.add(raw.line);
            }
            rows.push(Row {
                line: raw.line,
                time_us,
                accel_g,
                rate_radps: raw.rate_radps,
                counts: raw.counts,
                temperature_c: raw.temperature,
                reference: raw.reference,
                starts_anew: false,
            });
        }
        let first = rows.first().map_or(0, |row| row.time_us);
        rows.iter_mut().for_each(|row| row.time_us -= first);
        (rows, first)
    }
}

/// A blank line or a comment.
fn is_silent(bytes: &[u8]) -> bool {
    let text = bytes.trim_ascii_start();
    text.is_empty() || text.starts_with(b"#")
}

fn header(name: &str, input: &mut Input) -> Result<(Columns, u64), FileError> {
    loop {
        let line = input.number() + 1;
        let refuse = |problem| Err(FileError::of_line(name, line, problem));
        let bytes = match input.next_line() {
            Ok(Some(Line::Whole(bytes) | Line::Unended(bytes))) => bytes,
            Ok(Some(Line::TooLong(start))) if is_binary(start) => return refuse(Problem::Binary),
            Ok(Some(Line::TooLong(_))) => return refuse(Problem::LineTooLong),
            Ok(None) => return Err(FileError::of_file(name, Problem::Empty)),
            Err(error) => return Err(explain(name, input, &error, 0)),
        };
        if is_binary(bytes) {
            return refuse(Problem::Binary);
        }
        if is_silent(bytes) {
            continue;
        }
        let text = String::from_utf8_lossy(bytes);
        let names: Vec<String> = text.split(',').map(clean).collect();
        return match Columns::from_names(&names) {
            Ok(columns) => Ok((columns, line)),
            Err(problem) => refuse(other_separator(&text).unwrap_or(problem)),
        };
    }
}

/// The problem of a header in which something else than a comma stands between the names.
fn other_separator(header: &str) -> Option<Problem> {
    let most = [';', '\t']
        .into_iter()
        .max_by_key(|c| header.matches(*c).count())?;
    let separates = header.matches(most).count() >= 3 && !header.contains(',');
    separates.then_some(Problem::Separator(most))
}

/// True for what no text editor writes. A character cut off at the end is let pass.
fn is_binary(bytes: &[u8]) -> bool {
    let is_cut = |error: std::str::Utf8Error| error.error_len().is_none();
    bytes.contains(&0) || std::str::from_utf8(bytes).is_err_and(|error| !is_cut(error))
}

/// Why there is no line behind the one that was read last, with so many rows before it.
fn explain(name: &str, input: &Input, error: &io::Error, rows: usize) -> FileError {
    let problem = match input.damage(error) {
        Some(Damage::Cut) => Problem::GzipTruncated(rows),
        Some(Damage::Corrupt) => Problem::GzipCorrupt(rows),
        None => return FileError::of_file(name, Problem::not_readable(error)),
    };
    FileError::of_line(name, input.number() + 1, problem)
}

fn reference<'a>(
    places: ReferenceColumns,
    cell: impl Fn(usize) -> &'a str,
) -> Result<Option<Reference>, Reason> {
    let read = |place| optional(cell(place));
    match places {
        ReferenceColumns::Quaternion([w, x, y, z]) => {
            match (read(w)?, read(x)?, read(y)?, read(z)?) {
                (None, None, None, None) => Ok(None),
                (Some(w), Some(x), Some(y), Some(z)) => Attitude::new([w, x, y, z])
                    .map(|attitude| Some(Reference::Attitude(attitude)))
                    .ok_or(Reason::UnparsableCell),
                _ => Err(Reason::MissingCell),
            }
        }
        ReferenceColumns::Slopes([x, y]) => {
            let read = |place: Option<usize>| place.map_or(Ok(None), read);
            let slopes = [read(x)?, read(y)?];
            Ok(slopes
                .iter()
                .any(Option::is_some)
                .then_some(Reference::Slopes(slopes)))
        }
    }
}

/// The other header of time by which a period of this many units would be believable.
fn fitting_time(period: f64, named: TimeUnit) -> Option<&'static str> {
    let fits = |unit: TimeUnit| (25.0..=1000.0).contains(&(1e6 / (period * unit.micros())));
    TIMES
        .into_iter()
        .find(|(_, unit)| *unit != named && fits(*unit))
        .map(|(name, _)| name)
}

/// Acceleration and rate of the rows that follow each other without a gap.
pub fn stretches(rows: &[Row]) -> impl Iterator<Item = Vec<Turning>> {
    let chunks = rows.chunk_by(|_, row| !row.starts_anew && row.rate_radps.is_some());
    let turning = |row: &Row| {
        Some(Turning {
            accel_g: row.accel_g,
            rate_radps: row.rate_radps?,
        })
    };
    chunks.map(move |rows| rows.iter().filter_map(turning).collect())
}

fn mark_gaps(rows: &mut [Row], period_us: u64) -> Count {
    let mut gaps = Count::default();
    let mut before = None;
    for row in rows {
        let gap = before.is_some_and(|time| row.time_us - time > GAP_PERIODS * period_us);
        if gap {
            gaps.add(row.line);
        }
        row.starts_anew = gap || before.is_none();
        before = Some(row.time_us);
    }
    gaps
}

#[cfg(test)]
#[path = "recording_tests.rs"]
mod tests;
