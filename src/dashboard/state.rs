//! What the dashboard knows of a run.

use std::collections::VecDeque;

use traces::{Message, MissCause, Record, TickRecord, Topic, TruthRecord};

/// Span over which rates and percentiles are taken \[ns\].
const WINDOW_NS: u64 = 1_000_000_000;

/// What does not change during a run.
#[derive(Debug, Clone, Default)]
pub struct Run {
    /// Name of the scenario.
    pub scenario: String,
    /// How long it is to last \[s\].
    pub duration_s: f64,
    /// Period of the control loop \[ns\].
    pub period_ns: u64,
    /// Number of trucks.
    pub trucks: usize,
    /// Y of the road's right edge \[m\].
    pub right_edge_y_m: f64,
    /// Width of a lane \[m\].
    pub lane_width_m: f64,
    /// Number of lanes.
    pub lanes: usize,
}

/// What is known of one ECU.
#[derive(Debug, Clone, Default)]
pub struct Ecu {
    /// Its newest tick.
    pub tick: Option<TickRecord>,
    /// Ticks seen.
    pub ticks: u64,
    /// Of those, late.
    pub late: u64,
    /// Ticks passed over.
    pub skipped: u64,
    /// What made the last late one late.
    pub cause: Option<MissCause>,
    /// Bench time and duration of the ticks of the window \[ns\].
    recent: VecDeque<(u64, u32)>,
}

impl Ecu {
    fn take(&mut self, tick: &TickRecord) {
        self.ticks += 1;
        self.skipped += u64::from(tick.skipped);
        if tick.missed {
            self.late += 1;
            self.cause = Some(tick.miss_cause);
        }
        self.recent.push_back((tick.time_ns, tick.total_ns));
        self.tick = Some(*tick);
    }

    /// Durations of the window that half, 99 % and all ticks keep \[µs\].
    pub fn percentiles_us(&self) -> Option<[f64; 3]> {
        let mut sorted: Vec<u32> = self.recent.iter().map(|(_, total_ns)| *total_ns).collect();
        sorted.sort_unstable();
        let last = sorted.len().checked_sub(1)?;
        let at = |share: f64| 1e-3 * f64::from(sorted[(share * last as f64).round() as usize]);
        Some([at(0.5), at(0.99), at(1.0)])
    }
}

/// The dashboard's picture of a run.
#[derive(Debug, Clone, Default)]
pub struct State {
    /// What does not change.
    pub run: Run,
    /// The newest world.
    pub truth: Option<Box<TruthRecord>>,
    /// The ECUs by truck.
    pub ecus: Vec<Ecu>,
    /// Bench time of the frames of the window, by bus \[ns\].
    frames: Vec<VecDeque<u64>>,
}

impl State {
    /// Nothing is known yet.
    pub fn new(run: Run) -> Self {
        let ecus = vec![Ecu::default(); run.trucks];
        let frames = vec![VecDeque::new(); run.trucks];
        Self { run, truth: None, ecus, frames }
    }

    /// Takes a recorded message over.
    pub fn take(&mut self, message: &Message) {
        if let Some(Topic::Frames(bus)) = message.channel.kind {
            let frames = self.frames.get_mut(usize::from(bus));
            frames.into_iter().for_each(|times| times.push_back(message.time_ns()));
            return;
        }
        match message.record() {
            Ok(Record::Truth(truth)) => self.truth = Some(truth),
            Ok(Record::Tick(tick)) => {
                let ecu = self.ecus.get_mut(usize::from(tick.ecu));
                ecu.into_iter().for_each(|ecu| ecu.take(&tick));
            }
            _ => {}
        }
    }

    /// Forgets what is older than the window.
    pub fn begin_window(&mut self) {
        let from_ns = self.time_ns().saturating_sub(WINDOW_NS);
        for ecu in &mut self.ecus {
            let old = ecu.recent.partition_point(|(time_ns, _)| *time_ns < from_ns);
            ecu.recent.drain(..old);
        }
        for times in &mut self.frames {
            let old = times.partition_point(|time_ns| *time_ns < from_ns);
            times.drain(..old);
        }
    }

    /// Bench time of the newest world \[ns\].
    pub fn time_ns(&self) -> u64 {
        self.truth.as_ref().map_or(0, |truth| truth.time_ns)
    }

    /// Frames of the last second, by bus.
    pub fn frame_rates(&self) -> impl Iterator<Item = usize> {
        self.frames.iter().map(VecDeque::len)
    }
}
