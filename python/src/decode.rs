//! Logs of a bus as a stream of Arrow record batches.
//!
//! In: names of logs and data sheets, as `plumb replay` takes them. Out: the rows that its
//! `--export` writes, `time_s` as float64, `interface` and `message` as text, `node_id` as int32,
//! all others as float64 that may be null; each field has its unit in its metadata. A batch is
//! made when it is asked for, so memory does not grow with the logs. Whoever asks for the first
//! batch reads the logs: DuckDB asks for several streams, and for batches of one of them.
//!
//! Left out: what a frame means (`listen`), and what a row holds (`bus_report::playback`).

use std::collections::HashMap;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use arrow_array::builder::{Float64Builder, Int32Builder, StringBuilder};
use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{ArrayRef, RecordBatch, RecordBatchReader};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef};
use bus_report::period::LogsReport;
use bus_report::playback::{COLUMNS, Given, Options, Row, Table, unit};
use listen::PlanOptions;
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

use crate::error::said;
use crate::signals;

/// Rows of a batch: 16 MB with the columns that every table has.
const ROWS: usize = 1 << 16;

/// Frames that a batch is made of at most, which may have no row: half a second, after which
/// whoever reads can handle signals.
const FRAMES: usize = 1 << 20;

/// Why there is no stream, or no batch of it.
const READ_ALREADY: &str = "this log was read already; decode it again";

/// A log under way: an Arrow stream of the rows that `plumb replay --export` writes.
#[pyclass(frozen)]
pub struct Decoder {
    logs: Arc<Mutex<Option<Stream>>>,
    schema: SchemaRef,
    came_to: Arc<Mutex<CameTo>>,
}

/// What was counted so far.
#[derive(Default)]
struct CameTo {
    logs: LogsReport,
    incomplete: Option<String>,
    failure: Option<String>,
}

/// A stream that was asked for, the logs that have not been begun, and the same once it has begun
/// them.
struct Asked {
    schema: SchemaRef,
    logs: Arc<Mutex<Option<Stream>>>,
    begun: Option<Stream>,
}

/// The batches.
struct Stream {
    table: Table,
    schema: SchemaRef,
    came_to: Arc<Mutex<CameTo>>,
    has_ended: bool,
}

#[pymethods]
impl Decoder {
    /// Opens logs. `nodes` are node-ids A, B, A, B; `from` and `to` as on the command line.
    #[new]
    #[pyo3(signature = (logs, eds, nodes, channel, begin, end))]
    fn new(
        py: Python<'_>,
        logs: Vec<PathBuf>,
        eds: Vec<String>,
        nodes: Vec<u8>,
        channel: Option<String>,
        begin: Option<String>,
        end: Option<String>,
    ) -> PyResult<Self> {
        let (begin, to) = (moment("begin", begin)?, moment("end", end)?);
        let eds = eds.iter().map(|sheet| sheet.parse());
        let options = Options {
            channel,
            plan: PlanOptions {
                nodes,
                eds: eds.collect::<Result<_, _>>().map_err(said)?,
            },
            to,
            ..Options::default()
        };
        // A pipe lets who opens it wait for its writer.
        let table = signals::wait_for(py, move || Table::open(&logs, &options, begin))?;
        let table = table.map_err(said)?;
        let came_to = Arc::new(Mutex::new(CameTo {
            logs: table.logs(),
            ..CameTo::default()
        }));
        let schema = Arc::new(schema(table.signals()));
        let stream = Stream {
            schema: Arc::clone(&schema),
            table,
            came_to: Arc::clone(&came_to),
            has_ended: false,
        };
        Ok(Self {
            logs: Arc::new(Mutex::new(Some(stream))),
            schema,
            came_to,
        })
    }

    /// A stream by the Arrow PyCapsule interface. Its schema may be read any number of times; the
    /// first stream of which a batch is read has the logs.
    ///
    /// Errors: `plumb.Error` where another stream has begun them.
    #[pyo3(signature = (requested_schema = None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        // The consumer casts what it wants in another type.
        drop(requested_schema);
        if lock(&self.logs).is_none() {
            return Err(said(READ_ALREADY));
        }
        let stream = FFI_ArrowArrayStream::new(Box::new(Asked {
            schema: Arc::clone(&self.schema),
            logs: Arc::clone(&self.logs),
            begun: None,
        }));
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }

    /// Frames read so far.
    #[getter]
    fn frames(&self) -> u64 {
        lock(&self.came_to).logs.frames
    }

    /// The logs that were found, in their order.
    #[getter]
    fn files(&self) -> Vec<String> {
        lock(&self.came_to).logs.files.clone()
    }

    /// Lines that gave no frame so far: reason, count, and file and line of the first.
    #[getter]
    fn skipped(&self) -> Vec<(String, u64, String, u64)> {
        let came_to = lock(&self.came_to);
        let kinds = came_to.logs.skipped.iter();
        kinds
            .map(|kind| {
                (
                    kind.reason.clone(),
                    kind.count,
                    kind.file.clone(),
                    kind.first_line,
                )
            })
            .collect()
    }

    /// Files whose end is missing or damaged, and how.
    #[getter]
    fn damaged(&self) -> Vec<String> {
        lock(&self.came_to).logs.damaged.clone()
    }

    /// Files of a folder that are no logs.
    #[getter]
    fn not_logs(&self) -> Vec<String> {
        lock(&self.came_to).logs.not_logs.clone()
    }

    /// At the end of the log, the sentence on what of it could not be read.
    #[getter]
    fn incomplete(&self) -> Option<String> {
        lock(&self.came_to).incomplete.clone()
    }

    /// Where the stream has ended early, the sentence on why: whoever reads it words it anew.
    #[getter]
    fn failure(&self) -> Option<String> {
        lock(&self.came_to).failure.clone()
    }
}

/// Where a log begins or ends.
fn moment<T: FromStr<Err = String>>(name: &str, text: Option<String>) -> PyResult<Option<T>> {
    let parsed = text.map(|text| text.parse().map_err(|why| (text, why)));
    parsed
        .transpose()
        .map_err(|(text, why): (String, String)| said(format!("{name} is {text:?}: {why}")))
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Iterator for Asked {
    type Item = Result<RecordBatch, ArrowError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.begun.is_none() {
            self.begun = lock(&self.logs).take();
        }
        match &mut self.begun {
            Some(stream) => stream.next(),
            None => Some(Err(ArrowError::InvalidArgumentError(
                READ_ALREADY.to_owned(),
            ))),
        }
    }
}

impl RecordBatchReader for Asked {
    fn schema(&self) -> SchemaRef {
        Arc::clone(&self.schema)
    }
}

impl Iterator for Stream {
    type Item = Result<RecordBatch, ArrowError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.has_ended {
            return None;
        }
        let mut batch = Batch::new(self.table.signals().len());
        let most = (ROWS, FRAMES);
        let given = (self.table).give(most, |row, extra| batch.add(row, extra));
        let mut came_to = lock(&self.came_to);
        came_to.logs = self.table.logs();
        match given {
            Ok(Given::Some(_)) => Some(batch.finish(&self.schema)),
            Ok(Given::Last(rows)) => {
                self.has_ended = true;
                came_to.incomplete = self.table.incomplete().map(|why| why.to_string());
                (rows > 0).then(|| batch.finish(&self.schema))
            }
            Err(why) => {
                self.has_ended = true;
                came_to.failure = Some(why.to_string());
                Some(Err(ArrowError::ExternalError(Box::new(why))))
            }
        }
    }
}

/// Columns that are being filled.
struct Batch {
    times: Float64Builder,
    interfaces: StringBuilder,
    nodes: Int32Builder,
    messages: StringBuilder,
    numbers: Vec<Float64Builder>,
}

impl Batch {
    /// No row yet, and so many columns behind [`COLUMNS`].
    fn new(signals: usize) -> Self {
        Self {
            times: Float64Builder::new(),
            interfaces: StringBuilder::new(),
            nodes: Int32Builder::new(),
            messages: StringBuilder::new(),
            numbers: (0..COLUMNS.len() + signals)
                .map(|_| Float64Builder::new())
                .collect(),
        }
    }

    fn add(&mut self, row: &Row<'_>, extra: &[Option<f64>]) {
        self.times.append_value(row.time_s());
        self.interfaces.append_value(row.interface);
        self.nodes.append_value(i32::from(row.node_id));
        self.messages.append_value(row.message);
        let values = row.values.iter().chain(extra);
        for (column, value) in self.numbers.iter_mut().zip(values) {
            column.append_option(*value);
        }
    }

    fn finish(mut self, schema: &SchemaRef) -> Result<RecordBatch, ArrowError> {
        let mut columns: Vec<ArrayRef> = vec![
            Arc::new(self.times.finish()),
            Arc::new(self.interfaces.finish()),
            Arc::new(self.nodes.finish()),
            Arc::new(self.messages.finish()),
        ];
        let numbers = self.numbers.iter_mut();
        columns.extend(numbers.map(|column| Arc::new(column.finish()) as ArrayRef));
        RecordBatch::try_new(Arc::clone(schema), columns)
    }
}

fn schema(signals: &[String]) -> Schema {
    let mut fields = vec![
        with_unit(Field::new("time_s", DataType::Float64, false)),
        Field::new("interface", DataType::Utf8, false),
        Field::new("node_id", DataType::Int32, false),
        Field::new("message", DataType::Utf8, false),
    ];
    let ours = COLUMNS.into_iter();
    fields.extend(ours.map(|name| with_unit(Field::new(name, DataType::Float64, true))));
    let signals = signals.iter();
    fields.extend(signals.map(|name| Field::new(name, DataType::Float64, true)));
    Schema::new(fields)
}

/// The field with its unit, where its name tells one.
fn with_unit(field: Field) -> Field {
    match unit(field.name()) {
        Some(unit) => field.with_metadata(HashMap::from([("unit".to_owned(), unit.to_owned())])),
        None => field,
    }
}
