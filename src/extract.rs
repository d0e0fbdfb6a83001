//! `platoon extract`: a few seconds of a run as a small trace that replays by itself.
//!
//! The ECUs are recomputed up to where the extract begins, and begin it with a snapshot of their
//! own; what their ticks came to is the expected output. So any moment can be cut out, not only
//! those behind a snapshot, and the extract is a regression test: those in `traces/golden/` are
//! replayed by `cargo test`.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use traces::{
    MemoryRecord, MergeOptions, Overflow, Record, Recorder, RecorderOptions, Source, TickRecord,
    Topic,
};

use crate::cli::ExtractArgs;
use crate::failure::Failure;
use crate::process;
use crate::replay::{self, Question, SNAPSHOT_REACH_NS};
use crate::trace::{EXTRACT, History, Moment, TickInputs, Trace};

/// Cuts a moment out of a run and checks that it replays.
///
/// # Errors
/// When the run cannot be read, lacks the moment or the records before it, or does not replay.
pub fn run(args: &ExtractArgs) -> Result<(), Failure> {
    process::check_parent("-o", &args.out)?;
    let trace = Trace::open(&args.run)?;
    let question = replay::question_as_run(&trace, args.ecu)?;
    let times = times(&trace, args)?;
    let ecus = cut(&trace, &question, &times)?;
    write(&trace, &ecus, &times, args)?;
    let extract = Trace::open(&args.out)?;
    let question = replay::question_as_run(&extract, args.ecu)?;
    let outcome = replay::recompute(&extract, &question)?;
    if !outcome.is_passed() {
        anstream::print!("{outcome}");
        return Err(Failure::with_code(
            crate::failure::EXIT_FAILED,
            format!("{}: does not replay; see above", args.out.display()),
        ));
    }
    let ticks: u64 = ecus.values().map(|ecu| ecu.ticks.len() as u64).sum();
    let bytes = fs::metadata(&args.out).map_or(0, |about| about.len());
    anstream::println!("{ticks} ticks in {} ({} kB)", args.out.display(), bytes / 1000);
    Ok(())
}

/// Bench time of the extract \[ns\].
fn times(trace: &Trace, args: &ExtractArgs) -> Result<Range<u64>, Failure> {
    let rate_hz: Option<u64> = trace.run_fact("rate_hz").and_then(|rate| rate.parse().ok());
    let rate_hz = rate_hz.filter(|rate_hz| *rate_hz > 0).ok_or_else(|| {
        Failure::usage(format!("{}: does not say its rate", trace.path().display()))
    })?;
    let tick_ns = u64::from(args.tick) * 1_000_000_000 / rate_hz;
    let ns = |time_s: f64| (time_s * 1e9) as u64;
    Ok(tick_ns.saturating_sub(ns(args.before))..tick_ns.saturating_add(ns(args.after)) + 1)
}

/// What is kept of one ECU.
#[derive(Default)]
struct Cut {
    /// What it was before the first tick; none at the start of the run.
    memory: Vec<MemoryRecord>,
    ticks: Vec<TickInputs>,
}

/// Recomputes every ECU up to the extract, and keeps the ticks in it.
fn cut(
    trace: &Trace,
    question: &Question,
    times: &Range<u64>,
) -> Result<BTreeMap<u8, Cut>, Failure> {
    let from_ns = times.start.saturating_sub(SNAPSHOT_REACH_NS);
    let is_of_ecu = |topic| matches!(topic, Topic::Rx(_) | Topic::Tick(_) | Topic::Memory(_));
    let mut cutters: BTreeMap<u8, (History, Cutter)> = BTreeMap::new();
    for event in trace.events(is_of_ecu, from_ns..times.end)? {
        let (Topic::Rx(truck) | Topic::Tick(truck) | Topic::Memory(truck)) = event.topic else {
            continue;
        };
        if question.is_about(truck) {
            let fresh = || (History::default(), Cutter::new(question, truck, from_ns > 0, times));
            let (history, cutter) = cutters.entry(truck).or_insert_with(fresh);
            history.push(event, &mut |moment| cutter.live(moment));
        }
    }
    let cuts = cutters.into_iter().map(|(truck, (history, mut cutter))| {
        history.finish(&mut |moment| cutter.live(moment));
        cutter.finish().map(|cut| (truck, cut))
    });
    let cuts = cuts.collect::<Result<BTreeMap<_, _>, _>>()?;
    if cuts.values().all(|cut| cut.ticks.is_empty()) {
        return Err(Failure::usage(format!(
            "{}: has no tick from {:.3} s to {:.3} s; name another --tick",
            trace.path().display(),
            times.start as f64 * 1e-9,
            times.end as f64 * 1e-9
        )));
    }
    Ok(cuts)
}

/// One ECU on its way to the extract.
struct Cutter {
    truck: u8,
    replica: controller_rt::Replica,
    times: Range<u64>,
    is_in_step: bool,
    /// The last tick before the extract.
    before: Option<TickRecord>,
    cut: Cut,
    is_broken: bool,
}

impl Cutter {
    fn new(question: &Question, truck: u8, is_midway: bool, times: &Range<u64>) -> Self {
        Self {
            truck,
            replica: question.replica(truck, &std::sync::Arc::default()),
            times: times.clone(),
            is_in_step: !is_midway,
            before: None,
            cut: Cut::default(),
            is_broken: false,
        }
    }

    fn live(&mut self, moment: Moment) {
        match moment {
            Moment::Tick(inputs) if inputs.tick.time_ns < self.times.start => {
                if self.is_in_step {
                    self.replica.tick(&inputs.frames, &inputs.tick, &mut |_| ());
                }
                self.before = Some(inputs.tick);
            }
            Moment::Tick(inputs) => {
                self.is_broken |= !self.is_in_step;
                if self.cut.ticks.is_empty()
                    && let Some(before) = &self.before
                {
                    self.cut.memory = self.replica.snapshot(before);
                }
                self.cut.ticks.push(*inputs);
            }
            Moment::Snapshot { bytes, .. } if !self.is_in_step && self.cut.ticks.is_empty() => {
                self.is_in_step = self.replica.restore(&bytes);
            }
            Moment::Snapshot { .. } => {}
            Moment::Gap(_) => self.is_in_step = false,
        }
    }

    fn finish(self) -> Result<Cut, Failure> {
        if self.is_broken {
            return Err(Failure::usage(format!(
                "ECU {}: records are missing there or since the snapshot before, so it would not \
                 replay; name another --tick, or another --ecu",
                self.truck
            )));
        }
        Ok(self.cut)
    }
}

/// Writes the parts of the extract and merges them.
fn write(
    trace: &Trace,
    ecus: &BTreeMap<u8, Cut>,
    times: &Range<u64>,
    args: &ExtractArgs,
) -> Result<(), Failure> {
    let mut parts = vec![part(args, trace, Source::Rig, |recorder| {
        let trucks: Vec<u8> = ecus.keys().copied().collect();
        let is_of_rig = move |topic| match topic {
            Topic::Frames(bus) => trucks.contains(&bus),
            topic => topic == Topic::Truth,
        };
        for event in trace.events(is_of_rig, times.clone())? {
            match event.record {
                Record::Frame(frame) => recorder.push(frame),
                Record::Truth(truth) => recorder.push(*truth),
                _ => true,
            };
        }
        Ok(())
    })?];
    for (truck, cut) in ecus {
        parts.push(part(args, trace, Source::Ecu(*truck), |recorder| {
            for memory in &cut.memory {
                recorder.push(*memory);
            }
            for TickInputs { frames, tick } in &cut.ticks {
                for frame in frames {
                    recorder.push(*frame);
                }
                recorder.push(*tick);
            }
            Ok(())
        })?);
    }
    let mut metadata = trace.metadata().clone();
    metadata.retain(|name, _| name.starts_with("platoon.") && !name.starts_with("platoon.part"));
    metadata.remove("platoon.merged");
    metadata.insert(
        EXTRACT.to_owned(),
        BTreeMap::from([
            ("tick".to_owned(), args.tick.to_string()),
            ("from_s".to_owned(), (times.start as f64 * 1e-9).to_string()),
            ("until_s".to_owned(), (times.end as f64 * 1e-9).to_string()),
        ]),
    );
    let attachments = trace.attachments().to_vec();
    let options = MergeOptions { attachments, metadata, ..MergeOptions::default() };
    let merged = traces::merge(&parts, &args.out, &options);
    for part in parts {
        // A part that cannot be removed only takes room.
        let _ = fs::remove_file(part);
    }
    merged.map(drop).map_err(Failure::cannot_start)
}

/// Records one process's part beside the extract.
fn part(
    args: &ExtractArgs,
    trace: &Trace,
    source: Source,
    fill: impl FnOnce(&mut Recorder) -> Result<(), Failure>,
) -> Result<PathBuf, Failure> {
    let path = beside(&args.out, source);
    let options = RecorderOptions {
        start_wall_ns: trace.start_wall_ns(),
        overflow: Overflow::Wait,
        ..RecorderOptions::new(source)
    };
    let mut recorder = Recorder::start(&path, options).map_err(Failure::cannot_start)?;
    fill(&mut recorder)?;
    match recorder.finish().error {
        Some(error) => Err(Failure::cannot_start(format!("{}: {error}", path.display()))),
        None => Ok(path),
    }
}

fn beside(out: &Path, source: Source) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(format!(".{source}.part.mcap"));
    name.into()
}
