//! Tables as CSV [RFC 4180]: a head with names and units, then numbers.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use platoon_dbc::MessageInfo;

use super::table::Table;

/// A CSV file.
struct Csv(BufWriter<File>);

/// Begins a file with its head: `time_s`, then `Signal [unit]`.
pub fn open(stem: &Path, message: &'static MessageInfo) -> io::Result<Box<dyn Table>> {
    let mut file = BufWriter::new(File::create(with_ending(stem, "csv"))?);
    write!(file, "time_s")?;
    for signal in message.signals {
        match signal.unit {
            "" => write!(file, ",{}", signal.name)?,
            unit => write!(file, ",{} [{unit}]", signal.name)?,
        }
    }
    writeln!(file)?;
    Ok(Box::new(Csv(file)))
}

/// The path with an ending behind its dots.
pub fn with_ending(stem: &Path, ending: &str) -> std::path::PathBuf {
    let mut name = stem.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}

impl Table for Csv {
    fn row(&mut self, time_ns: u64, values: &[f64]) -> io::Result<()> {
        let Self(file) = self;
        write!(file, "{}.{:09}", time_ns / 1_000_000_000, time_ns % 1_000_000_000)?;
        for value in values {
            match value.is_nan() {
                true => write!(file, ",")?,
                false => write!(file, ",{value}")?,
            }
        }
        writeln!(file)
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.0.flush()
    }
}
