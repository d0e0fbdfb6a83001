//! Merging the parts of a run into one trace: ordered, decoded, with what belongs to it.
//!
//! Messages are put in order of bench time; equal times keep the order of the parts, and within
//! a part the order of recording. Bench time 0 of every part is put on the first part's wall
//! clock, because processes read the wall clock a little apart. Parts of killed processes are
//! merged as far as they go, and the report says where they end. It streams: no part is held in
//! memory.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use mcap::McapError;
use thiserror::Error;

use crate::focus::Focus;
use crate::input::{Input, PartReport};
use crate::merged::Merged;
use crate::reader::Message;
use crate::scan::Attachment;
use crate::scenery::Scenery;

/// Name of the metadata record that says what each part held.
const PARTS: &str = "platoon.parts";

/// What goes into the merged trace besides the parts.
#[derive(Debug, Clone, Default)]
pub struct MergeOptions {
    /// Files to attach, such as `platoon.dbc` and the scenario.
    pub attachments: Vec<Attachment>,
    /// Metadata records by name, such as version, seed, and the machine.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// What scenes show besides trucks and obstacles.
    pub scenery: Scenery,
    /// The parts of the run that are kept whole; all of it when there is none.
    pub focus: Option<Focus>,
}

/// Why there is no merged trace.
#[derive(Debug, Error)]
pub enum MergeError {
    /// No part can be read.
    #[error("nothing to merge: no part can be read ({0}); was anything recorded?")]
    NoPart(String),
    /// The merged trace cannot be created or moved into place.
    #[error("cannot create {path}: {source}; choose a folder with room that can be written")]
    Create {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The merged trace cannot be written.
    #[error("cannot write {path}: {source}; is the disk full? the parts are still there")]
    Write {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        source: McapError,
    },
}

/// What a merge did.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MergeReport {
    /// Messages in the merged trace, decoded ones included.
    pub messages: u64,
    /// Its size in bytes.
    pub bytes: u64,
    /// Messages that stand after later ones because they came more than a second late.
    pub out_of_order: u64,
    /// The parts, in the order given.
    pub parts: Vec<PartReport>,
}

/// Merges parts into `out`, which appears only when it is complete.
///
/// # Errors
/// When no part can be read, or `out` cannot be written.
pub fn merge(
    parts: &[PathBuf],
    out: &Path,
    options: &MergeOptions,
) -> Result<MergeReport, MergeError> {
    merge_thinned(parts, out, options, 0)
}

/// As [`merge`], with at least `decoded_period_ns` of bench time between two decoded messages of
/// one kind on one bus: a third smaller at 20 ms. The recorded frames are all there either way.
///
/// # Errors
/// As [`merge`].
pub fn merge_thinned(
    parts: &[PathBuf],
    out: &Path,
    options: &MergeOptions,
    decoded_period_ns: u64,
) -> Result<MergeReport, MergeError> {
    let mut inputs = parts.iter().map(|path| Input::open(path)).collect::<Vec<_>>();
    if inputs.iter().all(|input| input.report.unreadable.is_some()) {
        let reasons = inputs.iter().filter_map(|input| input.report.unreadable.as_deref());
        return Err(MergeError::NoPart(reasons.collect::<Vec<_>>().join("; ")));
    }
    let unfinished = Unfinished::create(out)?;
    let (messages, out_of_order) = unfinished.fill(&mut inputs, options, decoded_period_ns)?;
    let bytes = unfinished.keep(out)?;
    let parts = inputs.into_iter().map(|input| input.report).collect();
    Ok(MergeReport { messages, bytes, out_of_order, parts })
}

/// The merged file while it is being written, under another name; removed unless kept.
struct Unfinished {
    path: PathBuf,
    is_kept: Cell<bool>,
}

impl Unfinished {
    fn create(out: &Path) -> Result<Self, MergeError> {
        let mut name = out.as_os_str().to_owned();
        name.push(".part");
        let path = PathBuf::from(name);
        match File::create(&path) {
            Ok(_) => Ok(Self { path, is_kept: Cell::new(false) }),
            Err(source) => Err(MergeError::Create { path, source }),
        }
    }

    fn fill(
        &self,
        inputs: &mut [Input],
        options: &MergeOptions,
        decoded_period_ns: u64,
    ) -> Result<(u64, u64), MergeError> {
        let path = || self.path.clone();
        let file = File::options().write(true).open(&self.path);
        let file = file.map_err(|source| MergeError::Create { path: path(), source })?;
        write_all(BufWriter::with_capacity(1 << 20, file), inputs, options, decoded_period_ns)
            .map_err(|source| MergeError::Write { path: path(), source })
    }

    fn keep(&self, out: &Path) -> Result<u64, MergeError> {
        let rename = || -> io::Result<u64> {
            let bytes = fs::metadata(&self.path)?.len();
            fs::rename(&self.path, out)?;
            Ok(bytes)
        };
        let bytes = rename().map_err(|source| MergeError::Create { path: out.into(), source })?;
        self.is_kept.set(true);
        Ok(bytes)
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        if !self.is_kept.get() {
            // Best effort: the error that led here is reported.
            let _ = fs::remove_file(&self.path);
        }
    }
}

fn write_all(
    file: BufWriter<File>,
    inputs: &mut [Input],
    options: &MergeOptions,
    decoded_period_ns: u64,
) -> Result<(u64, u64), McapError> {
    let start_wall_ns = inputs.iter().find_map(Input::start_wall_ns).unwrap_or(0);
    inputs.iter_mut().for_each(|input| input.assume_start_wall_ns(start_wall_ns));
    let mut merged = Merged::create(file, start_wall_ns, options, decoded_period_ns)?;
    for (name, pairs) in &options.metadata {
        merged.metadata(name, pairs.clone())?;
    }
    for attachment in &options.attachments {
        merged.attach(attachment)?;
    }
    while let Some(message) = next_message(inputs) {
        merged.write(&message)?;
    }
    inputs.iter_mut().for_each(Input::complete);
    let notes = inputs.iter().map(|input| (input.report.name(), input.report.to_string()));
    merged.metadata(PARTS, notes.collect())?;
    let out_of_order = inputs.iter().map(Input::stragglers).sum();
    Ok((merged.finish()?, out_of_order))
}

/// The earliest message; the first part's when several are equally early.
fn next_message(inputs: &mut [Input]) -> Option<Message> {
    let times = inputs.iter_mut().enumerate();
    let times = times.filter_map(|(index, input)| Some((input.peek_ns()?, index)));
    let (_, earliest) = times.min()?;
    inputs[earliest].pop()
}

#[cfg(test)]
mod tests;
