//! What led to a difference: the frames consumed before it, and how the runs were set up.

use std::collections::{BTreeMap, VecDeque};

use platoon_dbc::{Frame, decode_signals, message_info};
use serde::Serialize;

use crate::trace::{TickInputs, Trace};

/// Frames of one side that wait for the other's: more than a second of a busy bus. One that finds
/// none among so many has none.
const WAITING_MAX: usize = 4096;

/// A frame that one ECU consumed and the other did not, or not so.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Upstream {
    /// Bench time of the tick that consumed it \[s\].
    pub time_s: f64,
    /// Message, as the DBC calls it, or the identifier.
    pub message: String,
    /// How the two differ, in words.
    pub how: String,
}

/// The frames of both sides, message by message.
#[derive(Debug, Default)]
pub struct Inputs {
    /// What waits for the other side's next frame of that message, by identifier.
    waiting: BTreeMap<u32, [VecDeque<(u64, Frame)>; 2]>,
    first: Option<Upstream>,
    first_ns: u64,
}

impl Inputs {
    /// Takes what a tick consumed on each side, where there was one.
    pub fn add(&mut self, sides: [&Option<TickInputs>; 2]) {
        if self.first.is_some() {
            return; // What comes later explains nothing that was before.
        }
        for (side, inputs) in sides.into_iter().enumerate() {
            let Some(TickInputs { frames, tick }) = inputs else { continue };
            for record in frames {
                let waiting = self.waiting.entry(record.frame.id()).or_default();
                waiting[side].push_back((tick.time_ns, record.frame));
            }
        }
        let found = self.waiting.values_mut().filter_map(first_apart);
        if let Some((time_ns, upstream)) = found.min_by_key(|(time_ns, _)| *time_ns) {
            (self.first_ns, self.first) = (time_ns, Some(upstream));
        }
    }

    /// The first frame in which the two differ so far: another one, or one that only one side had
    /// consumed by now.
    pub fn first_difference(&self) -> Option<Upstream> {
        let early = self.waiting.values().filter_map(|[a, b]| match (a.front(), b.front()) {
            (Some((time_ns, frame)), None) => Some(("first", *time_ns, frame)),
            (None, Some((time_ns, frame))) => Some(("second", *time_ns, frame)),
            _ => None,
        });
        let early = early.min_by_key(|(_, time_ns, _)| *time_ns);
        match early {
            Some((which, time_ns, frame)) if self.first.is_none() || time_ns < self.first_ns => {
                let how = format!("only the {which} run's ECU had consumed it by then");
                Some(told(time_ns, frame, how).1)
            }
            _ => self.first.clone(),
        }
    }
}

/// Pairs off the frames of one message, the n-th with the n-th; the first pair that differs.
fn first_apart(sides: &mut [VecDeque<(u64, Frame)>; 2]) -> Option<(u64, Upstream)> {
    let [a, b] = sides;
    while let (Some((a_ns, of_a)), Some((b_ns, of_b))) = (a.front(), b.front()) {
        if let Some(how) = how(of_a, of_b) {
            return Some(told((*a_ns).min(*b_ns), of_a, how));
        }
        a.pop_front();
        b.pop_front();
    }
    let lonely = |side: &VecDeque<(u64, Frame)>| (side.len() > WAITING_MAX).then(|| side[0]);
    let (which, (time_ns, frame)) =
        lonely(a).map(|one| ("first", one)).or_else(|| lonely(b).map(|one| ("second", one)))?;
    Some(told(time_ns, &frame, format!("only the {which} run's ECU consumed it")))
}

fn told(time_ns: u64, frame: &Frame, how: String) -> (u64, Upstream) {
    let known = message_info(frame.id()).map(|info| info.name.to_owned());
    let message = known.unwrap_or_else(|| format!("{:X}", frame.id()));
    (time_ns, Upstream { time_s: time_ns as f64 * 1e-9, message, how })
}

/// The signals in which two frames of one message differ, in words; `None` when these are counter
/// and checksum only, which follow from how often something was said.
fn how(a: &Frame, b: &Frame) -> Option<String> {
    if a == b {
        return None;
    }
    let mut values = [Vec::new(), Vec::new()];
    for (frame, values) in [a, b].into_iter().zip(&mut values) {
        decode_signals(frame, &mut |signal, raw, reading| values.push((signal, raw, reading)));
    }
    let [a_values, b_values] = values;
    if a_values.is_empty() || a_values.len() != b_values.len() {
        return Some("their bytes".to_owned());
    }
    let differing = a_values.iter().zip(&b_values).filter(|(a, b)| a.1 != b.1);
    let differing = differing.filter(|((signal, ..), _)| !is_protection(signal.name));
    let words = differing.map(|((signal, raw, reading), (_, other_raw, other))| {
        match (reading.value(), other.value()) {
            (Some(a), Some(b)) => format!("{} {a} against {b} {}", signal.name, signal.unit),
            _ => format!("{} raw {raw} against {other_raw}", signal.name),
        }
    });
    let words: Vec<String> = words.map(|words| words.trim_end().to_owned()).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

/// Whether a signal says how a message is protected and not what it says.
fn is_protection(signal: &str) -> bool {
    let is_of_e2e = signal.starts_with("E2e");
    is_of_e2e || signal.ends_with("Checksum") || signal.ends_with("Counter")
}

/// The settings in which two runs differ, `record.key: a against b`.
pub fn settings_apart(traces: &[Trace; 2]) -> Vec<String> {
    let mut all: BTreeMap<String, [Option<String>; 2]> = BTreeMap::new();
    for (side, trace) in traces.iter().enumerate() {
        for (key, value) in settings(trace) {
            all.entry(key).or_default()[side] = Some(value);
        }
    }
    let shown = |value: Option<String>| value.unwrap_or_else(|| "nothing".to_owned());
    let apart = all.into_iter().filter(|(_, [a, b])| a != b);
    apart.map(|(key, [a, b])| format!("{key}: {} against {}", shown(a), shown(b))).collect()
}

fn settings(trace: &Trace) -> Vec<(String, String)> {
    let run = trace.metadata().get("platoon.run").into_iter().flatten();
    let run = run.filter(|(key, _)| *key != "arguments");
    let mut settings: Vec<_> = run.map(|(key, value)| (key.clone(), value.clone())).collect();
    for name in ["scenario", "law"] {
        let text = trace.attached_text(&format!("{name}.toml")).unwrap_or_default();
        if let Ok(table) = text.parse::<toml::Table>() {
            flatten(name, &toml::Value::Table(table), &mut settings);
        }
    }
    settings
}

fn flatten(key: &str, value: &toml::Value, into: &mut Vec<(String, String)>) {
    match value {
        toml::Value::Table(table) => {
            for (name, value) in table {
                flatten(&format!("{key}.{name}"), value, into);
            }
        }
        leaf => into.push((key.to_owned(), leaf.to_string())),
    }
}
