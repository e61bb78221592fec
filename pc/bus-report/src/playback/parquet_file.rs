//! A table as a Parquet file.
//!
//! In: rows. Out: the file, with the columns of the CSV: `time_s` as DOUBLE, `interface` and
//! `message` as text, `node_id` as INT32, all others as DOUBLE that may be null. Rows are kept
//! until a group is full, so memory doesn't grow with the table.

use std::fs::File;
use std::io;
use std::sync::Arc;

use parquet::basic::{ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int32Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{Type, TypePtr};

use super::row::{COLUMNS, Row};

/// Rows of a group.
const GROUP: usize = 1 << 17;

/// A file under way.
pub struct ParquetFile {
    writer: SerializedFileWriter<File>,
    times: Vec<f64>,
    interfaces: Vec<ByteArray>,
    nodes: Vec<i32>,
    messages: Vec<ByteArray>,
    numbers: Vec<Numbers>,
}

/// A column that may be null.
#[derive(Default)]
struct Numbers {
    values: Vec<f64>,
    /// 1 where there is a value.
    there: Vec<i16>,
}

fn as_io(error: ParquetError) -> io::Error {
    match error {
        ParquetError::External(source) => io::Error::other(source),
        other => io::Error::other(other.to_string()),
    }
}

fn column(name: &str, physical: Physical, repetition: Repetition) -> io::Result<TypePtr> {
    let converted = match physical {
        Physical::BYTE_ARRAY => ConvertedType::UTF8,
        _ => ConvertedType::NONE,
    };
    let built = Type::primitive_type_builder(name, physical)
        .with_repetition(repetition)
        .with_converted_type(converted)
        .build();
    built.map(Arc::new).map_err(as_io)
}

impl ParquetFile {
    /// Begins a file; `signals` are the columns behind those that every table has.
    pub fn new(file: File, signals: &[String]) -> io::Result<Self> {
        let mut fields = vec![
            column("time_s", Physical::DOUBLE, Repetition::REQUIRED)?,
            column("interface", Physical::BYTE_ARRAY, Repetition::REQUIRED)?,
            column("node_id", Physical::INT32, Repetition::REQUIRED)?,
            column("message", Physical::BYTE_ARRAY, Repetition::REQUIRED)?,
        ];
        let names = COLUMNS
            .into_iter()
            .chain(signals.iter().map(String::as_str));
        for name in names {
            fields.push(column(name, Physical::DOUBLE, Repetition::OPTIONAL)?);
        }
        let mut numbers = Vec::new();
        numbers.resize_with(fields.len() - 4, Numbers::default);
        let schema = Type::group_type_builder("plumb")
            .with_fields(fields)
            .build();
        let schema = schema.map_err(as_io)?;
        let properties = WriterProperties::builder().build();
        let writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties));
        Ok(Self {
            writer: writer.map_err(as_io)?,
            times: Vec::new(),
            interfaces: Vec::new(),
            nodes: Vec::new(),
            messages: Vec::new(),
            numbers,
        })
    }

    /// Adds a row.
    pub fn row(&mut self, row: &Row<'_>, extra: &[Option<f64>]) -> io::Result<()> {
        self.times.push(row.time_s());
        // Most rows are of the interface of the one before; its bytes are shared.
        let interface = match self.interfaces.last() {
            Some(last) if last.data() == row.interface.as_bytes() => last.clone(),
            _ => ByteArray::from(row.interface),
        };
        self.interfaces.push(interface);
        self.nodes.push(i32::from(row.node_id));
        self.messages
            .push(ByteArray::from(row.message.as_bytes().to_vec()));
        for (column, value) in self.numbers.iter_mut().zip(row.values.iter().chain(extra)) {
            column.there.push(i16::from(value.is_some()));
            column.values.extend(value);
        }
        if self.times.len() >= GROUP {
            self.flush().map_err(as_io)?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), ParquetError> {
        if self.times.is_empty() {
            return Ok(());
        }
        let mut group = self.writer.next_row_group()?;
        let mut place = 0;
        while let Some(mut column) = group.next_column()? {
            match place {
                0 => column
                    .typed::<DoubleType>()
                    .write_batch(&self.times, None, None)?,
                1 => column
                    .typed::<ByteArrayType>()
                    .write_batch(&self.interfaces, None, None)?,
                2 => column
                    .typed::<Int32Type>()
                    .write_batch(&self.nodes, None, None)?,
                3 => column
                    .typed::<ByteArrayType>()
                    .write_batch(&self.messages, None, None)?,
                _ => {
                    match self.numbers.get(place - 4) {
                        Some(Numbers { values, there }) => column
                            .typed::<DoubleType>()
                            .write_batch(values, Some(there), None)?,
                        None => 0,
                    }
                }
            };
            column.close()?;
            place += 1;
        }
        group.close()?;
        self.times.clear();
        self.interfaces.clear();
        self.nodes.clear();
        self.messages.clear();
        for column in &mut self.numbers {
            column.values.clear();
            column.there.clear();
        }
        Ok(())
    }

    /// Writes what is left, and the end.
    pub fn finish(mut self) -> io::Result<()> {
        self.flush().map_err(as_io)?;
        self.writer.close().map_err(as_io)?;
        Ok(())
    }
}
