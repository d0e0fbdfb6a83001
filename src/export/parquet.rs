//! Tables as Parquet, with units in the schema's metadata: keys `<column>.unit`, `message`, `id`.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};
use platoon_dbc::MessageInfo;

use super::csv::with_ending;
use super::table::Table;

/// Rows of a row group: some megabytes of a message with many signals.
const ROWS: usize = 1 << 16;

/// A Parquet file and the rows it has not got yet, column by column.
struct Parquet {
    writer: SerializedFileWriter<File>,
    times_ns: Vec<i64>,
    columns: Vec<Vec<f64>>,
}

/// Begins a file: `time_ns`, then a column per signal, without value where it is not a number.
pub fn open(stem: &Path, message: &'static MessageInfo) -> io::Result<Box<dyn Table>> {
    let file = File::create(with_ending(stem, "parquet"))?;
    let schema = schema(message).map_err(io::Error::other)?;
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_key_value_metadata(Some(metadata(message)))
        .build();
    let writer = SerializedFileWriter::new(file, schema, Arc::new(properties));
    let writer = writer.map_err(io::Error::other)?;
    let columns = vec![Vec::new(); message.signals.len()];
    Ok(Box::new(Parquet { writer, times_ns: Vec::new(), columns }))
}

fn schema(message: &MessageInfo) -> Result<TypePtr, ParquetError> {
    let time = Type::primitive_type_builder("time_ns", Physical::INT64)
        .with_repetition(Repetition::REQUIRED)
        .build()?;
    let mut fields = vec![Arc::new(time)];
    for signal in message.signals {
        let column = Type::primitive_type_builder(signal.name, Physical::DOUBLE)
            .with_repetition(Repetition::OPTIONAL)
            .build()?;
        fields.push(Arc::new(column));
    }
    Ok(Arc::new(Type::group_type_builder(message.name).with_fields(fields).build()?))
}

fn metadata(message: &MessageInfo) -> Vec<KeyValue> {
    let pair = |key: String, value: &str| KeyValue::new(key, value.to_owned());
    let mut pairs = vec![
        pair("message".into(), message.name),
        pair("id".into(), &format!("0x{:08X}", message.id)),
        pair("time_ns.unit".into(), "ns"),
    ];
    let signals = message.signals.iter().filter(|signal| !signal.unit.is_empty());
    pairs.extend(signals.map(|signal| pair(format!("{}.unit", signal.name), signal.unit)));
    pairs
}

impl Table for Parquet {
    fn row(&mut self, time_ns: u64, values: &[f64]) -> io::Result<()> {
        self.times_ns.push(i64::try_from(time_ns).unwrap_or(i64::MAX));
        for (column, value) in self.columns.iter_mut().zip(values) {
            column.push(*value);
        }
        if self.times_ns.len() == ROWS {
            self.write_group().map_err(io::Error::other)
        } else {
            Ok(())
        }
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.write_group().map_err(io::Error::other)?;
        self.writer.close().map(drop).map_err(io::Error::other)
    }
}

impl Parquet {
    fn write_group(&mut self) -> Result<(), ParquetError> {
        if self.times_ns.is_empty() {
            return Ok(());
        }
        let mut group = self.writer.next_row_group()?;
        if let Some(mut column) = group.next_column()? {
            column.typed::<Int64Type>().write_batch(&self.times_ns, None, None)?;
            column.close()?;
        }
        for column in &mut self.columns {
            write_column(&mut group, column)?;
            column.clear();
        }
        group.close()?;
        self.times_ns.clear();
        Ok(())
    }
}

/// Writes the values there are, and where there are some.
fn write_column(
    group: &mut SerializedRowGroupWriter<'_, File>,
    column: &[f64],
) -> Result<(), ParquetError> {
    let levels: Vec<i16> = column.iter().map(|value| i16::from(!value.is_nan())).collect();
    let values: Vec<f64> = column.iter().copied().filter(|value| !value.is_nan()).collect();
    if let Some(mut writer) = group.next_column()? {
        writer.typed::<DoubleType>().write_batch(&values, Some(&levels), None)?;
        writer.close()?;
    }
    Ok(())
}
