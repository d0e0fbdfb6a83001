//! `platoon step-cost`: the CPU time of every step of the law over a whole run.
//!
//! A step is everything from the observation to the decision. The run is in virtual time, so that
//! the machine's other work moves no step to another place; the clock is that of the thread's own
//! CPU time, so that waiting for a CPU is not counted. What others do to caches and clock rates
//! is.

use std::hint::black_box;
use std::sync::{Arc, Mutex};

use controller_rt::{Around, Controller};
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

use crate::campaign::Cell;
use crate::cli::StepCostArgs;
use crate::failure::Failure;
use crate::process;
use crate::progress::ProgressLine;
use crate::rehearse::virtual_time::observe;

/// What the paper reports for a step on its target machine \[µs\] [MCF, section V].
const PAPER_US: f64 = 1_100.0;
/// Readings from which the clock's own cost is told.
const CLOCK_READINGS: usize = 10_000;

/// CPU time of the steps of one truck, or of all \[µs\].
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Cost {
    /// The truck; all of them when there is none.
    truck: Option<usize>,
    /// Steps.
    steps: usize,
    mean_us: f64,
    p50_us: f64,
    p90_us: f64,
    p99_us: f64,
    p999_us: f64,
    max_us: f64,
}

/// What a run's steps cost.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct StepCost {
    scenario: String,
    rate_hz: u32,
    seed: u64,
    /// Half of all readings of the clock cost at most this \[µs\]; it is in every step's time.
    clock_us: f64,
    /// Truck by truck, then all together.
    costs: Vec<Cost>,
}

/// Runs the scenario, prints what its steps cost and writes the JSON.
///
/// # Errors
/// When the scenario makes no sense, the run is interrupted, or the file cannot be written.
pub fn run(args: &StepCostArgs) -> Result<(), Failure> {
    if let Some(path) = &args.json {
        process::check_parent("--json", path)?;
    }
    let cell =
        Cell { seed: args.seed, ..Cell::new(&args.scenario, &args.set, None, args.rate_hz)? };
    let cost = measure(&cell)?;
    cost.print();
    args.json.as_ref().map_or(Ok(()), |path| process::write_json(path, &cost))
}

fn measure(cell: &Cell) -> Result<StepCost, Failure> {
    let trucks = cell.scenario.platoon.trucks;
    let steps = (cell.scenario.duration_s * f64::from(cell.rate_hz)) as usize + 1;
    let times: Vec<Times> =
        (0..trucks).map(|_| Arc::new(Mutex::new(Vec::with_capacity(steps)))).collect();
    let wrap = Box::new(|truck: u8, law| timed(law, Arc::clone(&times[usize::from(truck)])));
    let (stop, line) = (process::stop_flag()?, ProgressLine::new(cell.scenario.duration_s));
    observe(&cell.experiment(), Arc::clone(&stop), Some(&line), wrap, &mut |_| ())?;
    if stop.load(std::sync::atomic::Ordering::Relaxed) {
        return Err(Failure::cannot_start("interrupted: the run is not whole"));
    }
    let taken = |times: &Times| times.lock().map(|times| times.clone()).unwrap_or_default();
    let of_trucks: Vec<Vec<u64>> = times.iter().map(taken).collect();
    let of_all: Vec<u64> = of_trucks.iter().flatten().copied().collect();
    let each = of_trucks.into_iter().enumerate().map(|(truck, times)| Cost::of(Some(truck), times));
    let costs = each.chain([Cost::of(None, of_all)]).flatten().collect();
    Ok(StepCost {
        scenario: cell.scenario.name.clone(),
        rate_hz: cell.rate_hz,
        seed: cell.seed,
        clock_us: clock_us(),
        costs,
    })
}

/// CPU times of steps \[ns\].
type Times = Arc<Mutex<Vec<u64>>>;

/// A law whose steps are timed.
fn timed(law: Box<dyn Controller>, times: Times) -> Box<dyn Controller> {
    Box::new(Around::new(law, move |law, seen, _| {
        let before_ns = thread_cpu_ns();
        let decision = black_box(law.step(black_box(seen), &mut |_| ()));
        let took_ns = thread_cpu_ns() - before_ns;
        if let Ok(mut times) = times.lock() {
            times.push(took_ns);
        }
        decision
    }))
}

/// CPU time of the calling thread \[ns\].
fn thread_cpu_ns() -> u64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
}

/// What reading the clock costs, in the median \[µs\].
fn clock_us() -> f64 {
    let between = |_| {
        let before_ns = thread_cpu_ns();
        thread_cpu_ns() - before_ns
    };
    let readings = (0..CLOCK_READINGS).map(between).collect();
    Cost::of(None, readings).map_or(f64::NAN, |cost| cost.p50_us)
}

impl Cost {
    /// What times \[ns\] come to; `None` of nothing.
    fn of(truck: Option<usize>, mut times: Vec<u64>) -> Option<Self> {
        times.sort_unstable();
        let max_ns = *times.last()?;
        // The smallest time that so many do not exceed.
        let at = |share: f64| {
            let rank = (share * times.len() as f64).ceil() as usize;
            1e-3 * times[rank.clamp(1, times.len()) - 1] as f64
        };
        Some(Self {
            truck,
            steps: times.len(),
            mean_us: 1e-3 * times.iter().sum::<u64>() as f64 / times.len() as f64,
            p50_us: at(0.5),
            p90_us: at(0.9),
            p99_us: at(0.99),
            p999_us: at(0.999),
            max_us: 1e-3 * max_ns as f64,
        })
    }

    fn print(&self) {
        let who = self.truck.map_or("all".to_owned(), |truck| format!("truck {truck}"));
        anstream::println!(
            "{who:10} {:8} {:8.1} {:8.1} {:8.1} {:8.1} {:8.1} {:8.1}",
            self.steps,
            self.mean_us,
            self.p50_us,
            self.p90_us,
            self.p99_us,
            self.p999_us,
            self.max_us
        );
    }
}

impl StepCost {
    fn print(&self) {
        anstream::println!(
            "{}: CPU time of law.step in µs, {} Hz, seed {}",
            self.scenario,
            self.rate_hz,
            self.seed
        );
        anstream::println!(
            "{:10} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8}",
            "",
            "steps",
            "mean",
            "p50",
            "p90",
            "p99",
            "p99.9",
            "max"
        );
        self.costs.iter().for_each(Cost::print);
        if let Some(all) = self.costs.last() {
            anstream::println!(
                "below the paper's {PAPER_US:.0} µs by {:.0} in the mean, {:.0} at p99.9; reading \
                 the clock, {:.1} µs, is part of every step",
                PAPER_US / all.mean_us,
                PAPER_US / all.p999_us,
                self.clock_us
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_times_that_were_taken() {
        let cost = Cost::of(Some(1), (1..=1_000).rev().map(|us| 1_000 * us).collect());
        let cost = cost.expect("a thousand times");
        assert_eq!((cost.p50_us, cost.p90_us, cost.p99_us), (500.0, 900.0, 990.0));
        assert_eq!((cost.p999_us, cost.max_us, cost.mean_us), (999.0, 1_000.0, 500.5));
        assert_eq!(Cost::of(None, Vec::new()), None);
    }

    #[test]
    fn every_step_of_every_truck_is_timed() {
        let sets = [("duration_s", "0.5"), ("platoon.trucks", "2")];
        let sets = sets.map(|(key, value)| (key.to_owned(), value.to_owned()));
        let cell = Cell::new("obstacle-avoidance", &sets, None, 50).expect("a scenario of ours");
        let cost = measure(&cell).expect("it runs");
        let steps: Vec<(Option<usize>, usize)> =
            cost.costs.iter().map(|cost| (cost.truck, cost.steps)).collect();
        assert_eq!(steps, [(Some(0), 25), (Some(1), 25), (None, 50)]);
        assert!(cost.costs.iter().all(|cost| cost.mean_us > 0.0), "{cost:?}");
    }
}
