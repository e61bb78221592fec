//! All values of the logs as a table, or their frames as another log.
//!
//! In: frames with their news. Out: a CSV or Parquet file of the rows that [`super::rows`] makes of
//! them, or a log of all frames. It is written beside its place and put there when whole.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::PlaybackError;
use super::parquet_file::ParquetFile;
use super::row::{COLUMNS, Row};
use super::rows::Rows;
use super::summary::Summary;
use bus_logs::{Format, Logged, Writer};
use listen::Meaning;
use listen::eds::Device;
use output::write::{Existing, Staged};

/// A table under way.
pub struct Export {
    path: PathBuf,
    staged: Staged,
    table: Table,
    made: Rows,
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
    /// Errors: the name tells no format, is that of a log, is of a file that stays, or can't be
    /// written.
    pub fn create(
        path: &Path,
        existing: Existing,
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
        let made = Rows::new(devices);
        let signals = made.signals();
        let failed = |why| PlaybackError::Export(path.to_owned(), why);
        let staged = Staged::begin(path, existing).map_err(failed)?;
        let file = staged.handle().map_err(failed)?;
        let buffered = |file| BufWriter::with_capacity(1 << 18, file);
        let table = match ending.as_str() {
            "csv" => {
                let mut out = buffered(file);
                head(&mut out, signals).map_err(failed)?;
                Table::Csv(out)
            }
            "parquet" => Table::Parquet(Box::new(ParquetFile::new(file, signals).map_err(failed)?)),
            _ => Table::Log(Writer::new(buffered(file), Format::of(path))),
        };
        Ok(Self {
            path: path.to_owned(),
            staged,
            table,
            made,
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
        if let Table::Log(log) = &mut self.table {
            let interface = interfaces.get(usize::from(logged.interface));
            let interface = interface.map_or("", String::as_str);
            self.rows += 1;
            let written = log.write(logged.time_ns, interface, &logged.frame);
            return written.map_err(|why| self.failed(why));
        }
        let Some((row, extra)) = self.made.of(logged, interfaces, news, summary) else {
            return Ok(());
        };
        let written = match &mut self.table {
            Table::Csv(out) => line(out, &row, extra),
            Table::Parquet(file) => file.row(&row, extra),
            Table::Log(_) => Ok(()),
        };
        self.rows += 1;
        written.map_err(|why| self.failed(why))
    }

    fn failed(&self, why: io::Error) -> PlaybackError {
        PlaybackError::Export(self.path.clone(), why)
    }

    /// Puts the whole table in its place.
    pub fn finish(self) -> Result<Exported, PlaybackError> {
        let failed = |why| PlaybackError::Export(self.path.clone(), why);
        match self.table {
            Table::Csv(mut out) => out.flush().map_err(failed)?,
            Table::Parquet(file) => file.finish().map_err(failed)?,
            Table::Log(log) => drop(log.finish().map_err(failed)?),
        }
        let placed = self.staged.sync();
        let placed = placed.and_then(|()| self.staged.put_in_place());
        placed.map_err(failed)?;
        Ok(Exported {
            file: self.path.display().to_string(),
            rows: self.rows,
        })
    }
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
