//! The machine's own floor: how late it wakes a thread that does nothing else.
//!
//! The measurement of cyclictest: one thread per CPU sleeps until each point of a fixed time grid
//! and notes how late it was woken. Deadline figures mean nothing without it, because a machine
//! that is late by itself makes every program on it late.
//!
//! A thread that sleeps through several grid points was late for each of them, so each counts as a
//! sample with its own lateness. Counting one sample per wake instead, as a loop easily does, hides
//! long pauses (coordinated omission).

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use hdrhistogram::Histogram;

use crate::clock::MonotonicClock;
use crate::pauses::{PauseLog, PauseWriter};
use crate::realtime::{self, Policy, Refusal, Request};

/// Shortest period \[ns\] accepted; below it the sentinel would load the machine it measures.
const PERIOD_NS_MIN: u64 = 50_000;
/// Longest lateness \[ns\] told apart; a longer one counts as this.
const LATENESS_NS_MAX: u64 = 600_000_000_000;
/// Significant digits of the histogram.
const DIGITS: u8 = 3;
/// Grid points of one pause recorded one by one; the rest of a longer pause (a suspended machine)
/// counts at the lateness of the last of these, an upper bound for each of them.
const SLEPT_THROUGH_EACH_MAX: u64 = 1_000_000;
/// Lateness \[ns\] from which a wake-up counts as a pause of the machine.
const PAUSE_NS_MIN: u64 = 100_000;
/// Wake-ups of a sentinel in one period of the loop that it stands beside.
const WAKES_PER_LOOP: u64 = 4;
/// Shortest period \[ns\] it is given for that: beside faster loops it would disturb.
const BESIDE_PERIOD_NS_MIN: u64 = 125_000;
/// Nanoseconds in a microsecond.
const NS_PER_US: f64 = 1e3;

/// What to measure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FloorOptions {
    /// CPUs to measure, one thread on each.
    pub cpus: Vec<usize>,
    /// Grid period \[ns\].
    pub period_ns: u64,
    /// SCHED_FIFO priority of the threads; `None` for ordinary scheduling.
    pub priority: Option<u8>,
}

impl FloorOptions {
    /// A sentinel beside a loop of this period \[ns\].
    ///
    /// It wakes several times in a period, because it does not see a pause that begins and ends
    /// between two of its wake-ups, and the loop may.
    #[must_use]
    pub fn beside(loop_period_ns: u64, cpus: Vec<usize>, priority: u8) -> Self {
        let wished_ns = (loop_period_ns / WAKES_PER_LOOP).max(BESIDE_PERIOD_NS_MIN);
        let period_ns = wished_ns.min(loop_period_ns).max(PERIOD_NS_MIN);
        Self { cpus, period_ns, priority: Some(priority) }
    }

    /// Longest pause \[ns\] that such a sentinel may fail to note.
    #[must_use]
    pub const fn unseen_ns(&self) -> u64 {
        self.period_ns + PAUSE_NS_MIN
    }
}

/// Why a measurement could not start.
#[derive(Debug, thiserror::Error)]
pub enum FloorError {
    /// No CPU was named.
    #[error("machine floor: no CPU to measure; name at least one")]
    NoCpus,
    /// The period is too short to be measured honestly.
    #[error("machine floor: period {0} ns is too short; at least {PERIOD_NS_MIN} ns")]
    PeriodTooShort(u64),
    /// A thread could not be started.
    #[error("machine floor: no thread for CPU {cpu}: {error}; raise the limit on threads")]
    Thread {
        /// CPU the thread was for.
        cpu: usize,
        /// The system's own words.
        error: io::Error,
    },
}

/// Lateness percentiles \[µs\].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Percentiles {
    /// Median.
    pub p50_us: f64,
    /// 99 of 100 samples are at most this.
    pub p99_us: f64,
    /// 999 of 1000 samples are at most this.
    pub p999_us: f64,
    /// The worst sample.
    pub max_us: f64,
}

/// What one CPU showed.
#[derive(Debug, Clone)]
pub struct CpuFloor {
    /// The CPU asked for.
    pub cpu: usize,
    /// Scheduling policy the thread really had.
    pub policy: Policy,
    /// Static priority the thread really had.
    pub priority: u8,
    /// What the thread asked for and did not get; not empty when it could not be pinned.
    pub refused: Vec<Refusal>,
    /// Lateness \[ns\] of every grid point.
    pub lateness_ns: Histogram<u64>,
    /// Grid points that passed while the thread was still asleep for an earlier one.
    pub slept_through: u64,
}

/// What the machine showed.
#[derive(Debug, Clone)]
pub struct Floor {
    /// One entry per CPU, in the order asked for.
    pub cpus: Vec<CpuFloor>,
}

impl Floor {
    /// Lateness \[ns\] of every grid point of every CPU.
    #[must_use]
    pub fn lateness_ns(&self) -> Histogram<u64> {
        let mut all = empty_histogram();
        for cpu in &self.cpus {
            all.add(&cpu.lateness_ns).expect("the histograms have the same bounds");
        }
        all
    }

    /// Percentiles over all CPUs together.
    #[must_use]
    pub fn percentiles(&self) -> Percentiles {
        percentiles(&self.lateness_ns())
    }

    /// Number of grid points measured.
    #[must_use]
    pub fn samples(&self) -> u64 {
        self.cpus.iter().map(|cpu| cpu.lateness_ns.len()).sum()
    }

    /// Grid points slept through, over all CPUs.
    #[must_use]
    pub fn slept_through(&self) -> u64 {
        self.cpus.iter().map(|cpu| cpu.slept_through).sum()
    }
}

/// Percentiles of a lateness histogram in nanoseconds.
#[must_use]
pub fn percentiles(lateness_ns: &Histogram<u64>) -> Percentiles {
    let at = |quantile| lateness_ns.value_at_quantile(quantile) as f64 / NS_PER_US;
    Percentiles {
        p50_us: at(0.5),
        p99_us: at(0.99),
        p999_us: at(0.999),
        max_us: lateness_ns.max() as f64 / NS_PER_US,
    }
}

/// Measures for `duration` and returns: the floor before a run.
///
/// # Errors
/// [`FloorError`] when the options make no sense or a thread cannot be started.
pub fn measure(options: &FloorOptions, duration: Duration) -> Result<Floor, FloorError> {
    let sentinel = Sentinel::start(options)?;
    std::thread::sleep(duration);
    Ok(sentinel.stop())
}

/// A measurement that goes on beside a run until it is stopped. Dropping it stops it too.
#[derive(Debug)]
pub struct Sentinel {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<CpuFloor>>,
}

impl Sentinel {
    /// Starts one thread per CPU.
    ///
    /// # Errors
    /// [`FloorError`] when the options make no sense or a thread cannot be started.
    pub fn start(options: &FloorOptions) -> Result<Self, FloorError> {
        Self::start_noting(options, None)
    }

    /// The same, noting every pause of the machine in a log that others read.
    ///
    /// Only a thread with real-time priority notes any: another one may have been late because
    /// somebody else ran.
    ///
    /// # Errors
    /// As [`start`](Self::start).
    pub fn start_noting(
        options: &FloorOptions,
        log: Option<&PauseLog>,
    ) -> Result<Self, FloorError> {
        if options.cpus.is_empty() {
            return Err(FloorError::NoCpus);
        }
        if options.period_ns < PERIOD_NS_MIN {
            return Err(FloorError::PeriodTooShort(options.period_ns));
        }
        let mut sentinel = Self { stop: Arc::default(), threads: Vec::new() };
        for &cpu in &options.cpus {
            let stop = Arc::clone(&sentinel.stop);
            let request =
                Request { priority: options.priority, cpus: vec![cpu], ..Request::default() };
            let period_ns = options.period_ns;
            let pauses = log.map(|log| log.writer(cpu)).transpose();
            let pauses = pauses.map_err(|error| FloorError::Thread { cpu, error })?;
            let thread = std::thread::Builder::new()
                .name(format!("floor-{cpu}"))
                .spawn(move || watch(cpu, &request, period_ns, pauses, &stop))
                .map_err(|error| FloorError::Thread { cpu, error })?;
            sentinel.threads.push(thread);
        }
        Ok(sentinel)
    }

    /// Stops within a period and returns what was measured.
    #[must_use]
    pub fn stop(mut self) -> Floor {
        self.stop.store(true, Ordering::Relaxed);
        let finish = |thread: JoinHandle<CpuFloor>| thread.join().expect("watch does not panic");
        Floor { cpus: self.threads.drain(..).map(finish).collect() }
    }
}

impl Drop for Sentinel {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A panic in the thread was already printed, and drop has nobody to tell.
            let _ = thread.join();
        }
    }
}

/// The thread on one CPU: sleep until the next grid point, note the lateness, until told to stop.
fn watch(
    cpu: usize,
    request: &Request,
    period_ns: u64,
    pauses: Option<PauseWriter>,
    stop: &AtomicBool,
) -> CpuFloor {
    let mut grid = Grid::new(period_ns);
    let obtained = realtime::acquire(request);
    let mut pauses = pauses.filter(|_| obtained.policy == Policy::Fifo);
    let clock = MonotonicClock;
    let mut due_ns = clock.now_ns() + period_ns;
    while !stop.load(Ordering::Relaxed) {
        clock.sleep_until_ns(due_ns);
        let now_ns = clock.now_ns();
        if now_ns >= due_ns + PAUSE_NS_MIN
            && let Some(pauses) = &mut pauses
        {
            pauses.note(due_ns, now_ns);
        }
        due_ns = grid.woke(due_ns, now_ns);
    }
    CpuFloor {
        cpu,
        policy: obtained.policy,
        priority: obtained.priority,
        refused: obtained.refused,
        lateness_ns: grid.lateness_ns,
        slept_through: grid.slept_through,
    }
}

/// The time grid's book-keeping; reads no clock and allocates nothing once made.
struct Grid {
    period_ns: u64,
    lateness_ns: Histogram<u64>,
    slept_through: u64,
}

impl Grid {
    fn new(period_ns: u64) -> Self {
        Self { period_ns, lateness_ns: empty_histogram(), slept_through: 0 }
    }

    /// Notes a wake at `now_ns` for the point due at `due_ns`, and every point passed since;
    /// returns the first point still to come.
    fn woke(&mut self, due_ns: u64, now_ns: u64) -> u64 {
        let late_ns = now_ns.saturating_sub(due_ns);
        let passed = late_ns / self.period_ns;
        let each = passed.min(SLEPT_THROUGH_EACH_MAX);
        for point in 0..=each {
            self.lateness_ns.saturating_record(late_ns - point * self.period_ns);
        }
        self.lateness_ns.saturating_record_n(late_ns - each * self.period_ns, passed - each);
        self.slept_through += passed;
        due_ns + (passed + 1) * self.period_ns
    }
}

/// An empty histogram with the bounds of this module.
fn empty_histogram() -> Histogram<u64> {
    Histogram::new_with_bounds(1, LATENESS_NS_MAX, DIGITS).expect("the bounds are valid constants")
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn a_punctual_wake_is_one_sample() {
        let mut grid = Grid::new(MS);
        assert_eq!(grid.woke(5 * MS, 5 * MS + 30_000), 6 * MS);
        assert_eq!(grid.lateness_ns.len(), 1);
        assert!(grid.lateness_ns.equivalent(grid.lateness_ns.max(), 30_000));
        assert_eq!(grid.slept_through, 0);
    }

    #[test]
    fn every_grid_point_slept_through_is_a_late_sample() {
        let mut grid = Grid::new(MS);
        // Due at 10 ms, woken at 14.5 ms: the points at 10, 11, 12, 13 and 14 ms were all late.
        assert_eq!(grid.woke(10 * MS, 14 * MS + MS / 2), 15 * MS);
        assert_eq!(grid.slept_through, 4);
        for late_ns in [500_000, 1_500_000, 2_500_000, 3_500_000, 4_500_000] {
            assert_eq!(grid.lateness_ns.count_at(late_ns), 1);
        }
    }

    #[test]
    fn a_pause_moves_the_percentiles_by_its_length_and_not_by_one_sample() {
        let mut grid = Grid::new(MS);
        let mut due_ns = MS;
        for _ in 0..900 {
            due_ns = grid.woke(due_ns, due_ns + 20_000);
        }
        grid.woke(due_ns, due_ns + 100 * MS);
        let percentiles = percentiles(&grid.lateness_ns);
        assert!((percentiles.p50_us - 20.0).abs() < 0.1);
        assert!(percentiles.p99_us > 80_000.0, "{percentiles:?}");
    }

    #[test]
    fn a_suspended_machine_does_not_keep_the_sentinel_busy_for_ever() {
        let mut grid = Grid::new(MS);
        let day_ns = 86_400_000 * MS;
        assert_eq!(grid.woke(0, day_ns), day_ns + MS);
        assert_eq!(grid.lateness_ns.len(), 86_400_001);
        assert_eq!(grid.slept_through, 86_400_000);
    }

    #[test]
    fn a_clock_before_the_deadline_counts_as_punctual() {
        let mut grid = Grid::new(MS);
        assert_eq!(grid.woke(3 * MS, 2 * MS), 4 * MS);
        assert_eq!(grid.lateness_ns.max(), 0);
    }

    #[test]
    fn a_blocking_measurement_covers_its_whole_grid() {
        let cpu = realtime::acquire(&Request::default()).cpus[0];
        let options = FloorOptions { cpus: vec![cpu], period_ns: MS, priority: None };
        let floor = measure(&options, Duration::from_millis(50)).expect("one thread can start");
        // The grid starts when the thread does; however late that is, no point after it is lost.
        assert!(floor.samples() > floor.slept_through());
        assert_eq!(floor.cpus[0].cpu, cpu);
        let percentiles = floor.percentiles();
        assert!(percentiles.p50_us <= percentiles.p999_us);
        assert!(percentiles.p999_us <= percentiles.max_us * 1.001);
    }

    #[test]
    fn a_sentinel_that_is_dropped_leaves_no_thread_behind() {
        let options = FloorOptions { cpus: vec![0], period_ns: MS, priority: None };
        let sentinel = Sentinel::start(&options).expect("one thread can start");
        let stop = Arc::downgrade(&sentinel.stop);
        drop(sentinel);
        assert_eq!(stop.strong_count(), 0);
    }

    #[test]
    fn senseless_options_are_refused() {
        let options = FloorOptions { cpus: vec![], period_ns: MS, priority: None };
        assert!(matches!(Sentinel::start(&options), Err(FloorError::NoCpus)));
        let options = FloorOptions { cpus: vec![0], period_ns: 10, priority: None };
        assert!(matches!(Sentinel::start(&options), Err(FloorError::PeriodTooShort(10))));
    }
}
