//! Options of `deadline` and of what it starts.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;

use super::{BusKind, BusPlace, LawArgs};
use crate::cpu_plan::CpuPlan;
use crate::deadline::Load;
use crate::fault::Fault;

/// Options of `deadline`.
#[derive(Debug, Clone, Args)]
pub struct DeadlineArgs {
    /// Scenario: a built-in name (see `platoon scenarios`) or the path of a TOML file.
    #[arg(default_value = "obstacle-avoidance")]
    pub scenario: String,
    /// Rates in Hz at which rig and ECUs run over the bus, or none.
    #[arg(long, value_name = "HZ,...|none", default_value = "100,500,1000,2000")]
    pub rates: Rates,
    /// Rates in Hz at which one ECU runs alone, fed from memory with what it received in a run in
    /// virtual time, or none.
    #[arg(long, value_name = "HZ,...|none", default_value = "1000,2000,5000,10000")]
    pub ecu_rates: Rates,
    /// What else the machine has to do meanwhile.
    #[arg(long, value_enum, value_name = "LOAD,...", value_delimiter = ',',
        default_values_t = [Load::Idle, Load::Cpu, Load::Memory, Load::Disk, Load::Faults])]
    pub loads: Vec<Load>,
    /// The nominal rate in Hz: whether it is sustained decides the exit code.
    #[arg(long, value_name = "HZ", default_value_t = 1000,
        value_parser = clap::value_parser!(u32).range(10..=10_000))]
    pub rate_hz: u32,
    /// Only the nominal rate, idle and under all loads at once.
    #[arg(long, conflicts_with_all = ["rates", "ecu_rates", "loads"])]
    pub quick: bool,
    /// Slots of each cell at least. 3840 without a loss are the fewest that show that surely no
    /// more than one in a thousand is lost.
    #[arg(long, value_name = "N", default_value_t = 3840,
        value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub slots: u32,
    /// Bus between rig and ECUs.
    #[arg(long, value_enum, default_value_t = BusKind::Auto)]
    pub bus: BusKind,
    /// Where the bus is.
    #[command(flatten)]
    pub place: BusPlace,
    /// Which CPUs rig and ECUs run on, as in rehearse.
    #[arg(long, value_name = "PLAN", default_value_t = CpuPlan::Auto)]
    pub cpus: CpuPlan,
    /// How the law is run.
    #[command(flatten)]
    pub law_options: LawArgs,
    /// Stalls put into the law, to see that the test finds them, for example
    /// stall@1+0.003:truck=1,every=1000. Cells in which one ECU runs alone have truck 1's.
    #[arg(long, value_name = "SPEC")]
    pub fault: Vec<Fault>,
    /// Folder for deadline.json and deadline.md; it must not hold a run already
    /// (default: `runs/<time>-deadline`).
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Where to write the outcome as JSON too.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Options of `load`.
#[derive(Debug, Clone, Args)]
pub struct LoadArgs {
    /// What to do, without end.
    #[arg(value_enum)]
    pub kind: Load,
    /// Folder for what it writes.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
}

/// Options of `floor`.
#[derive(Debug, Clone, Args)]
pub struct FloorArgs {
    /// CPUs to measure, one thread on each; all when left out.
    #[arg(long, value_name = "CPU,...", value_delimiter = ',')]
    pub cpus: Vec<usize>,
    /// Period in microseconds.
    #[arg(long, value_name = "US", default_value_t = 1000,
        value_parser = clap::value_parser!(u64).range(50..=1_000_000))]
    pub period_us: u64,
    /// Priority of the threads, SCHED_FIFO.
    #[arg(long, value_name = "N", default_value_t = crate::process::RIG_PRIORITY + 1,
        value_parser = clap::value_parser!(u8).range(1..=99))]
    pub priority: u8,
    /// How long, in seconds.
    #[arg(long, value_name = "S", default_value_t = 5,
        value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub duration_s: u64,
    /// Where to write the histograms in the form of cyclictest --json.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Rates of a loop \[Hz\], ascending; none of them is possible.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rates(pub Vec<u32>);

impl FromStr for Rates {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "none" {
            return Ok(Self(Vec::new()));
        }
        let rate = |word: &str| {
            let rate_hz = word.trim().parse().ok().filter(|hz| (10..=10_000).contains(hz));
            rate_hz.ok_or_else(|| {
                format!("{word:?} is no rate; give 10 to 10000 Hz, such as 100,1000, or none")
            })
        };
        let mut rates = text.split(',').map(rate).collect::<Result<Vec<u32>, String>>()?;
        rates.sort_unstable();
        rates.dedup();
        Ok(Self(rates))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_put_in_order_and_nonsense_is_refused() {
        assert_eq!("1000,100,100".parse(), Ok(Rates(vec![100, 1000])));
        assert_eq!("none".parse(), Ok(Rates(Vec::new())));
        for nonsense in ["", "9", "10001", "fast", "100,", "-5"] {
            assert!(nonsense.parse::<Rates>().is_err(), "{nonsense}");
        }
    }
}
