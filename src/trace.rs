//! A recorded run, opened for reading as typed series: the one place that does so.
//!
//! [`Trace::open`] takes a `run.mcap`, the folder it is in, or the part that one process recorded.
//! [`Trace::events`] streams what recorders wrote; [`History`] puts an ECU's stream in the order in
//! which it happened, tick by tick; [`differences`] holds two ticks together. What a damaged file
//! lost is said by [`Events::damage`], once the events are exhausted.

mod history;
mod quantity;

use std::ops::Range;
use std::path::{Path, PathBuf};

use bench_sim::Scenario;
use clap::ValueEnum;
use law::Calibration;
use platoon_dbc::Profile;
use traces::{Attachment, Loss, Reader, Record, Topic};

use crate::calibration;
use crate::cli::SolverKind;
use crate::failure::Failure;

pub use history::{Gap, History, Moment, TickInputs};
pub use quantity::{Difference, differences};

/// Metadata record of a merged run that says how it was run.
const RUN: &str = "platoon.run";
/// Metadata record of a trace that was cut out of another one.
pub const EXTRACT: &str = "platoon.extract";

/// A trace on disk: what it says about itself. Its events are read anew by each pass.
#[derive(Debug, Clone)]
pub struct Trace {
    path: PathBuf,
    start_wall_ns: u64,
    metadata: Metadata,
    attachments: Vec<Attachment>,
}

/// Metadata records by name.
type Metadata = std::collections::BTreeMap<String, std::collections::BTreeMap<String, String>>;

/// One record of a trace, with its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Bench time \[ns\].
    pub time_ns: u64,
    /// Number its recorder gave it. A process numbers all its records in the order they happened,
    /// so a missing number is a missing record; a gap marker has the number of what follows it.
    pub sequence: u32,
    /// Where it was recorded.
    pub topic: Topic,
    /// What was recorded.
    pub record: Record,
}

impl Trace {
    /// Opens a trace and reads what it says about itself.
    ///
    /// # Errors
    /// When it cannot be read, is no MCAP file, or is none of this program's.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let path = if path.is_dir() { path.join("run.mcap") } else { path.to_owned() };
        let reader = reader(&path)?;
        let start_wall_ns = reader.start_wall_ns().ok_or_else(|| {
            Failure::usage(format!(
                "{}: an MCAP file, but no run of this program, or damaged at its very beginning; \
                 name a run.mcap or a *.part.mcap",
                path.display()
            ))
        })?;
        let (metadata, attachments) = (reader.metadata().clone(), reader.attachments().to_vec());
        Ok(Self { path, start_wall_ns, metadata, attachments })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Wall clock at bench time 0 \[ns since 1970\]; 0 in virtual time.
    pub fn start_wall_ns(&self) -> u64 {
        self.start_wall_ns
    }

    /// All its metadata records by name.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// All the files attached to it.
    pub fn attachments(&self) -> &[Attachment] {
        &self.attachments
    }

    /// What a metadata record says under a key.
    pub fn fact(&self, record: &str, key: &str) -> Option<&str> {
        self.metadata.get(record)?.get(key).map(String::as_str)
    }

    /// What the metadata say about how it was run, such as `seed`, `rate_hz`, `time`.
    pub fn run_fact(&self, key: &str) -> Option<&str> {
        self.fact(RUN, key)
    }

    /// The text of an attached file.
    pub fn attached_text(&self, name: &str) -> Option<&str> {
        let file = self.attachments.iter().find(|attachment| attachment.name == name)?;
        std::str::from_utf8(&file.data).ok()
    }

    /// How many buses it has, as far as it says; else as many as a world can have trucks.
    pub fn buses(&self) -> usize {
        let noted = self
            .metadata
            .get("platoon.bus")
            .map(|bus| bus.keys().filter(|key| key.starts_with("truck")).count());
        noted.filter(|buses| *buses > 0).unwrap_or(traces::TRUCKS_MAX)
    }

    /// What the interface of a truck's bus was called; `truck<i>` when it does not say.
    pub fn interface(&self, bus: u8) -> String {
        let key = format!("truck{bus}");
        let name = self.fact("platoon.bus", &key).unwrap_or(&key);
        name.replace(char::is_whitespace, "_")
    }

    /// How its buses carried messages, by the DBC attached; CAN FD when there is none.
    pub fn profile(&self) -> Profile {
        match self.attached_text("j1939.dbc") {
            Some(_) => Profile::J1939,
            None => Profile::Fd,
        }
    }

    /// Who solved its QPs; the active-set method when it does not say.
    pub fn solver(&self) -> SolverKind {
        let word = self.run_fact("solver");
        word.and_then(|word| SolverKind::from_str(word, false).ok())
            .unwrap_or(SolverKind::ActiveSet)
    }

    /// The scenario it is a run of, with the law's numbers as they were after every option of the
    /// run, and then with changes.
    ///
    /// # Errors
    /// When none is attached, it makes no sense, or a change does not fit.
    pub fn scenario(&self, sets: &[(String, String)]) -> Result<Scenario, Failure> {
        let mut table = self.table("scenario.toml")?;
        table.insert("law".to_owned(), toml::Value::Table(self.table("law.toml")?));
        let source = format!("{}: scenario.toml", self.path.display());
        Scenario::from_text(&source, &table.to_string(), sets).map_err(Failure::usage)
    }

    /// The law's calibration that all trucks of a scenario of this trace have in common.
    ///
    /// # Errors
    /// When it makes no sense.
    pub fn calibration(&self, scenario: &Scenario) -> Result<Calibration, Failure> {
        calibration::from_table(&self.path.display().to_string(), &scenario.law)
    }

    /// Whether the guards' emergency layer was off.
    pub fn was_without_emergency_braking(&self) -> bool {
        self.run_fact("arguments").is_some_and(|words| words.contains("--no-emergency-braking"))
    }

    fn table(&self, name: &str) -> Result<toml::Table, Failure> {
        self.required(name)?.parse().map_err(|error: toml::de::Error| {
            let reason = error.message().replace('\n', " ");
            Failure::usage(format!("{}: {name}: {reason}", self.path.display()))
        })
    }

    fn required(&self, name: &str) -> Result<&str, Failure> {
        self.attached_text(name).ok_or_else(|| {
            Failure::usage(format!(
                "{}: has no {name} attached; name the run.mcap that `platoon rehearse` made",
                self.path.display()
            ))
        })
    }

    /// Streams the records of the topics `wants` accepts, within a span of bench time \[ns\], in
    /// the order of the file: by time, and what one process recorded at one time in its order.
    ///
    /// # Errors
    /// When the file cannot be read any more.
    pub fn events(
        &self,
        wants: impl Fn(Topic) -> bool + Send + 'static,
        times: Range<u64>,
    ) -> Result<Events, Failure> {
        let reader = reader(&self.path)?
            .with_channels(move |channel| channel.kind.is_some_and(&wants))
            .with_times(times);
        Ok(Events { reader, undecodable: 0 })
    }
}

/// A span of bench time \[ns\] from two of its ends \[s\]; `until` is what the second is called.
///
/// # Errors
/// When it is empty.
pub fn seconds(
    from_s: Option<f64>,
    until_s: Option<f64>,
    until: &str,
) -> Result<Range<u64>, Failure> {
    let ns = |time_s: f64| (time_s * 1e9).round() as u64;
    let times = from_s.map_or(0, ns)..until_s.map_or(u64::MAX, ns);
    if times.is_empty() {
        return Err(Failure::usage(format!("--from must be before {until}")));
    }
    Ok(times)
}

fn reader(path: &Path) -> Result<Reader, Failure> {
    Reader::open(path).map_err(Failure::usage)
}

/// The events of one pass through a trace.
pub struct Events {
    reader: Reader,
    undecodable: u64,
}

impl Events {
    /// What of the file could not be read, in words; `None` when all of it could.
    ///
    /// Final once the events are exhausted.
    pub fn damage(&self) -> Option<String> {
        let Loss { is_truncated, bytes, chunks, records } = self.reader.loss();
        let records = records + self.undecodable;
        let told = [
            is_truncated.then(|| "it has no end: cut, or its writer was killed".to_owned()),
            (bytes > 0).then(|| format!("{bytes} bytes unreadable")),
            (chunks > 0).then(|| format!("{chunks} chunks unreadable")),
            (records > 0).then(|| format!("{records} records unreadable")),
        ];
        let told: Vec<String> = told.into_iter().flatten().collect();
        (!told.is_empty()).then(|| told.join(", "))
    }
}

impl Iterator for Events {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        loop {
            let message = self.reader.next()?;
            let Some(topic) = message.channel.kind else { continue };
            match message.record() {
                Ok(record) => {
                    let (time_ns, sequence) = (message.time_ns(), message.sequence);
                    return Some(Event { time_ns, sequence, topic, record });
                }
                Err(_) => self.undecodable += 1,
            }
        }
    }
}

#[cfg(test)]
mod tests;
