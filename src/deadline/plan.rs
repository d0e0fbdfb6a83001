//! Which cells a test has, in which order, and how long each takes.

use serde::{Deserialize, Serialize};

use super::load::Load;

/// Startup grace of a cell \[s\].
pub const GRACE_S: f64 = 0.5;
/// Shortest time that is judged of a cell \[s\]: pauses of a machine come in bursts, and a cell
/// that is over in an instant sees one burst or none.
const JUDGED_S_MIN: f64 = 3.0;
/// How much longer a cell of the nominal rate is: it decides.
const NOMINAL_FACTOR: f64 = 1.5;
/// A little more than is needed, so that nothing hangs on the last slot.
const MARGIN: f64 = 1.02;

/// What is under test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Subject {
    /// Rig and every ECU, each a process, over the bus.
    Bench,
    /// One ECU, fed from memory.
    Ecu,
}

/// One cell of the table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// What is under test.
    pub subject: Subject,
    /// Rate of the control loop \[Hz\].
    pub rate_hz: u32,
    /// What else the machine has to do.
    pub load: Load,
    /// Bench time, the startup grace included \[s\].
    pub duration_s: f64,
}

/// What a test is to cover.
#[derive(Debug, Clone, PartialEq)]
pub struct Scope {
    /// Rates over the bus \[Hz\].
    pub rates_hz: Vec<u32>,
    /// Rates of one ECU alone \[Hz\].
    pub ecu_rates_hz: Vec<u32>,
    /// Loads.
    pub loads: Vec<Load>,
    /// The rate that decides \[Hz\].
    pub nominal_hz: u32,
    /// Slots of a cell at least.
    pub slots: u32,
    /// ECUs there are over the bus.
    pub ecus: usize,
}

impl Scope {
    /// The same, with the nominal rate among the rates of the bus.
    #[must_use]
    pub fn with_nominal(mut self) -> Self {
        if !self.rates_hz.contains(&self.nominal_hz)
            && !self.ecu_rates_hz.contains(&self.nominal_hz)
        {
            self.rates_hz.push(self.nominal_hz);
            self.rates_hz.sort_unstable();
        }
        self
    }

    /// Every cell, load by load: what disturbs a machine for minutes then falls on many rates of
    /// one load rather than on one rate of all.
    pub fn cells(&self) -> Vec<Cell> {
        let subjects = [(Subject::Bench, &self.rates_hz), (Subject::Ecu, &self.ecu_rates_hz)];
        let of_load = |load: Load| {
            subjects.into_iter().flat_map(move |(subject, rates)| {
                rates.iter().map(move |&rate_hz| self.cell(subject, rate_hz, load))
            })
        };
        self.loads.iter().flat_map(|&load| of_load(load)).collect()
    }

    fn cell(&self, subject: Subject, rate_hz: u32, load: Load) -> Cell {
        let ecus = match subject {
            Subject::Bench => self.ecus.max(1),
            Subject::Ecu => 1,
        };
        let slots_per_s = f64::from(rate_hz) * ecus as f64;
        let needed_s = MARGIN * f64::from(self.slots) / slots_per_s;
        let factor = if rate_hz == self.nominal_hz { NOMINAL_FACTOR } else { 1.0 };
        let judged_s = factor * needed_s.max(JUDGED_S_MIN);
        // Whole hundredths, which is what a person reads.
        let duration_s = (100.0 * (GRACE_S + judged_s)).ceil() / 100.0;
        Cell { subject, rate_hz, load, duration_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scope() -> Scope {
        Scope {
            rates_hz: vec![100, 1000, 2000],
            ecu_rates_hz: vec![1000, 10_000],
            loads: vec![Load::Idle, Load::Disk],
            nominal_hz: 1000,
            slots: 3840,
            ecus: 4,
        }
    }

    #[test]
    fn every_rate_meets_every_load_once() {
        let cells = scope().cells();
        let names: Vec<_> = cells.iter().map(|c| (c.load, c.subject, c.rate_hz)).collect();
        let of = |load| {
            use Subject::{Bench, Ecu};
            [(Bench, 100), (Bench, 1000), (Bench, 2000), (Ecu, 1000), (Ecu, 10_000)]
                .map(|(subject, rate_hz)| (load, subject, rate_hz))
        };
        assert_eq!(names, [of(Load::Idle), of(Load::Disk)].concat());
    }

    #[test]
    fn every_cell_has_the_slots_it_needs_after_the_grace() {
        for cell in scope().cells() {
            let ecus = if cell.subject == Subject::Bench { 4.0 } else { 1.0 };
            let slots = (cell.duration_s - GRACE_S) * f64::from(cell.rate_hz) * ecus;
            assert!(slots >= 3840.0, "{cell:?}: {slots}");
        }
    }

    #[test]
    fn the_default_test_takes_less_than_five_minutes_of_bench_time() {
        let every = [Load::Idle, Load::Cpu, Load::Memory, Load::Disk, Load::Faults];
        let scope = Scope {
            rates_hz: vec![100, 500, 1000, 2000],
            ecu_rates_hz: vec![1000, 2000, 5000, 10_000],
            loads: every.to_vec(),
            ..scope()
        };
        // Starting and ending processes takes about two seconds a cell.
        let total_s: f64 = scope.cells().iter().map(|cell| cell.duration_s + 2.0).sum();
        assert!(total_s < 290.0, "{total_s} s");
    }

    #[test]
    fn the_nominal_rate_is_always_tested_and_longest() {
        let scope = Scope { rates_hz: vec![100, 500], ecu_rates_hz: Vec::new(), ..scope() };
        let cells = scope.with_nominal().cells();
        let nominal = cells.iter().find(|cell| cell.rate_hz == 1000).expect("the nominal rate");
        assert_eq!(nominal.subject, Subject::Bench);
        assert!(nominal.duration_s > 4.9, "{nominal:?}");
    }
}
