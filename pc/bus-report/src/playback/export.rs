//! All values of the logs as a table, or their frames as another log.
//!
//! In: frames with their news. Out: a CSV or Parquet file: a row for each frame that tells
//! something, a column for each value that there is (see [`super::row`]), and one for each signal
//! of other nodes with a data sheet; or a log of all frames. It is written beside its place and
//! put there when whole.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::PlaybackError;
use super::parquet_file::ParquetFile;
use super::row::{self, COLUMNS, Row};
use super::summary::Summary;
use bus_logs::{Format, Logged, Writer};
use listen::Meaning;
use listen::eds::Device;

/// A table under way.
pub struct Export {
    path: PathBuf,
    beside: PathBuf,
    table: Table,
    /// By device and PDO the first of its columns behind [`COLUMNS`].
    places: Vec<Vec<usize>>,
    extra: Vec<Option<f64>>,
    rows: u64,
}

enum Table {
    Csv(BufWriter<File>),
    Parquet(Box<ParquetFile>),
    Log(Writer<BufWriter<File>>),
}

/// What the endings of a name stand for.
const ENDINGS: [&str; 4] = ["csv", "parquet", "log", "asc"];

/// A table that was written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Exported {
    /// The file.
    pub file: String,
    /// Its rows, or frames of a log.
    pub rows: u64,
}

impl Export {
    /// Begins a table.
    ///
    /// Errors: the name tells no format, is that of a log, or can't be written.
    pub fn create(
        path: &Path,
        inputs: &[PathBuf],
        devices: &[Device],
    ) -> Result<Self, PlaybackError> {
        let name = path.display().to_string();
        let place = path.canonicalize().ok();
        let same = |input: &PathBuf| place.is_some() && input.canonicalize().ok() == place;
        if inputs.iter().any(same) {
            return Err(PlaybackError::ExportOverInput(name));
        }
        let ending = path.extension().and_then(|ending| ending.to_str());
        let ending = ending.unwrap_or_default().to_ascii_lowercase();
        if !ENDINGS.contains(&ending.as_str()) {
            return Err(PlaybackError::ExportName(name));
        }
        let (signals, places) = columns(devices);
        let mut beside = path.as_os_str().to_owned();
        beside.push(".part");
        let beside = PathBuf::from(beside);
        let failed = |why| PlaybackError::Export(path.display().to_string(), why);
        let file = File::create(&beside).map_err(failed)?;
        let buffered = |file| BufWriter::with_capacity(1 << 18, file);
        let table = match ending.as_str() {
            "csv" => {
                let mut out = buffered(file);
                head(&mut out, &signals).map_err(failed)?;
                Table::Csv(out)
            }
            "parquet" => {
                Table::Parquet(Box::new(ParquetFile::new(file, &signals).map_err(failed)?))
            }
            _ => Table::Log(Writer::new(buffered(file), Format::of(path))),
        };
        Ok(Self {
            path: path.to_owned(),
            beside,
            table,
            places,
            extra: vec![None; signals.len()],
            rows: 0,
        })
    }

    /// Takes a frame that the summary has taken.
    pub fn take(
        &mut self,
        logged: &Logged,
        interfaces: &[String],
        news: Meaning,
        summary: &Summary,
    ) -> Result<(), PlaybackError> {
        let interface = interfaces.get(usize::from(logged.interface));
        let interface = interface.map_or("", String::as_str);
        if let Table::Log(log) = &mut self.table {
            self.rows += 1;
            let written = log.write(logged.time_ns, interface, &logged.frame);
            return written.map_err(|why| self.failed(why));
        }
        let Some(watch) = summary.watch(logged.interface) else {
            return Ok(());
        };
        let known = row::of_news(news, watch);
        let foreign = summary.foreign();
        let other = if foreign.is_empty() {
            None
        } else {
            foreign.find(&logged.frame)
        };
        let (node_id, message, values) = match (known, other) {
            (Some(known), _) => known,
            (None, Some((device, _))) => {
                let node_id = foreign
                    .devices()
                    .get(device)
                    .map_or(0, |device| device.node_id);
                (node_id, "pdo", [None; COLUMNS.len()])
            }
            (None, None) => return Ok(()),
        };
        if let Some((device, pdo)) = other {
            self.signals(logged, summary, device, pdo);
        }
        let row = Row {
            time_ns: logged.time_ns,
            interface,
            node_id,
            message,
            values,
        };
        let written = match &mut self.table {
            Table::Csv(out) => line(out, &row, &self.extra),
            Table::Parquet(file) => file.row(&row, &self.extra),
            Table::Log(_) => Ok(()),
        };
        self.extra.fill(None);
        self.rows += 1;
        written.map_err(|why| self.failed(why))
    }

    fn signals(&mut self, logged: &Logged, summary: &Summary, device: usize, pdo: usize) {
        let first = self.places.get(device).and_then(|pdos| pdos.get(pdo));
        let signals = summary.foreign().devices().get(device);
        let signals = signals.and_then(|device| device.pdos.get(pdo));
        if let (Some(first), Some(pdo)) = (first, signals) {
            let places = self.extra.iter_mut().skip(*first);
            let both = places.zip(&pdo.signals);
            both.for_each(|(place, signal)| *place = Some(signal.value(logged.frame.padded())));
        }
    }

    fn failed(&self, why: io::Error) -> PlaybackError {
        PlaybackError::Export(self.path.display().to_string(), why)
    }

    /// Puts the whole table in its place.
    pub fn finish(self) -> Result<Exported, PlaybackError> {
        let failed = |why| PlaybackError::Export(self.path.display().to_string(), why);
        match self.table {
            Table::Csv(mut out) => out.flush().map_err(failed)?,
            Table::Parquet(file) => file.finish().map_err(failed)?,
            Table::Log(log) => drop(log.finish().map_err(failed)?),
        }
        std::fs::rename(&self.beside, &self.path).map_err(failed)?;
        Ok(Exported {
            file: self.path.display().to_string(),
            rows: self.rows,
        })
    }
}

/// Names of the columns of other nodes' signals, and where those of each PDO begin.
fn columns(devices: &[Device]) -> (Vec<String>, Vec<Vec<usize>>) {
    let mut names: Vec<String> = Vec::new();
    let mut places = Vec::new();
    for device in devices {
        let mut of_device = Vec::new();
        for pdo in &device.pdos {
            of_device.push(names.len());
            // Ours have columns of their own.
            if device.is_inclinometer() {
                continue;
            }
            for signal in &pdo.signals {
                let plain = format!("node{}_{}", device.node_id, plain(&signal.name));
                let (index, sub) = signal.place;
                let taken = names.contains(&plain) || COLUMNS.contains(&plain.as_str());
                let name = if taken {
                    format!("{plain}_{index:04x}_{sub}_{:03x}", pdo.cob_id)
                } else {
                    plain
                };
                names.push(name);
            }
        }
        places.push(of_device);
    }
    (names, places)
}

/// Small letters, digits and underscores.
fn plain(name: &str) -> String {
    let letters = name.chars().map(|c| {
        if c.is_ascii_alphanumeric() {
            c.to_ascii_lowercase()
        } else {
            '_'
        }
    });
    let name: String = letters.collect();
    name.trim_matches('_').to_owned()
}

fn head(out: &mut impl Write, signals: &[String]) -> io::Result<()> {
    write!(out, "time_s,interface,node_id,message")?;
    let names = COLUMNS
        .into_iter()
        .chain(signals.iter().map(String::as_str));
    for name in names {
        write!(out, ",{name}")?;
    }
    out.write_all(b"\n")
}

fn line(out: &mut impl Write, row: &Row<'_>, extra: &[Option<f64>]) -> io::Result<()> {
    let (seconds, ns) = (row.time_ns / 1_000_000_000, row.time_ns % 1_000_000_000);
    write!(out, "{seconds}.{ns:09},")?;
    if row.interface.contains([',', '"']) {
        write!(out, "\"{}\"", row.interface.replace('"', "\"\""))?;
    } else {
        out.write_all(row.interface.as_bytes())?;
    }
    write!(out, ",{},{}", row.node_id, row.message)?;
    for value in row.values.iter().chain(extra) {
        match value {
            Some(value) => write!(out, ",{value}")?,
            None => out.write_all(b",")?,
        }
    }
    out.write_all(b"\n")
}
