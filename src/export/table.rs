//! Frames as tables: one per bus and message, a row per frame, a column per signal.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use platoon_dbc::{MessageInfo, Reading, decode_signals, message_info};
use traces::FrameRecord;

/// A table being written: bench time, then the message's signals in the order of the DBC.
pub trait Table {
    /// Appends a row; not a number is no value.
    fn row(&mut self, time_ns: u64, values: &[f64]) -> io::Result<()>;

    /// Writes what is left and closes the file.
    fn finish(self: Box<Self>) -> io::Result<()>;
}

/// Begins a table of a message in a file whose path lacks its ending.
pub type Open = fn(&Path, &'static MessageInfo) -> io::Result<Box<dyn Table>>;

/// The tables of a run.
pub struct Tables {
    folder: PathBuf,
    open: Open,
    tables: BTreeMap<(u8, u32), Box<dyn Table>>,
    values: Vec<f64>,
}

impl Tables {
    /// None yet; each is begun with its first frame.
    pub fn new(folder: PathBuf, open: Open) -> Self {
        Self { folder, open, tables: BTreeMap::new(), values: Vec::new() }
    }

    /// Appends a frame to its table; one that no DBC knows is in none.
    pub fn add(&mut self, record: &FrameRecord) -> io::Result<()> {
        let Some(message) = message_info(record.frame.id()) else { return Ok(()) };
        self.values.clear();
        self.values.resize(message.signals.len(), f64::NAN);
        let values = &mut self.values;
        let mut place = 0;
        let decoded = decode_signals(&record.frame, &mut |signal, _, reading| {
            // Signals are visited in the order of the table.
            while !std::ptr::eq(&raw const message.signals[place], signal) {
                place += 1;
            }
            if let Reading::Value(value) = reading {
                values[place] = value;
            }
        });
        if decoded.is_none() {
            return Ok(()); // Neither of the length nor of the format the message has.
        }
        let key = (record.bus, message.id);
        if !self.tables.contains_key(&key) {
            let name = format!("bus{}.{}", record.bus, message.name);
            self.tables.insert(key, (self.open)(&self.folder.join(name), message)?);
        }
        match self.tables.get_mut(&key) {
            Some(table) => table.row(record.time_ns, &self.values),
            None => Ok(()),
        }
    }

    /// Closes all tables.
    pub fn finish(self) -> io::Result<()> {
        self.tables.into_values().try_for_each(Table::finish)
    }
}
