//! How deadlines are kept and judged: options that rehearse, bench and controller share.

use std::path::PathBuf;

use clap::Args;
use controller_rt::{OnOverrun, Overruns};

use crate::cpu_plan::CpuPlan;
use crate::fault::Fault;

/// Deadlines of a rehearsal.
#[derive(Debug, Clone, Args)]
pub struct TimingArgs {
    /// What the ECUs do about ticks that come too late.
    #[command(flatten)]
    pub overrun: OverrunArgs,
    /// Which CPUs rig and ECUs run on: auto, any (wherever the kernel puts them), or
    /// RIG:ECU,ECU,..., ECUs beyond the last taking turns, for example 0:1 or 0:1,0,1,0.
    #[arg(long, value_name = "PLAN", default_value_t = CpuPlan::Auto)]
    pub cpus: CpuPlan,
    /// Let the exit code tell about deadlines too: 1 when they were missed, 4 when this machine is
    /// too late by itself to tell.
    #[arg(long)]
    pub strict_timing: bool,
}

/// What an ECU does about ticks that come too late.
#[derive(Debug, Clone, Args)]
pub struct OverrunArgs {
    /// What an ECU does about a tick that comes too late: skip passes over the slots that are past,
    /// hold also sends the command before instead of the late one, abort ends the run, queue makes
    /// up for late slots in a burst.
    #[arg(long, value_name = "skip|hold|abort|queue", default_value_t = OnOverrun::Skip)]
    pub on_overrun: OnOverrun,
    /// Slots lost in the first so many seconds do not count.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = parse_grace)]
    pub startup_grace_s: f64,
    /// Slots an ECU may lose after that before --on-overrun abort ends the run.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub max_overloads: u64,
}

/// What only a supervised process is told.
#[derive(Debug, Clone, Args)]
pub struct SupervisedArgs {
    /// Where the supervisor's sentinel notes pauses of the machine.
    #[arg(long, value_name = "FILE", hide = true)]
    pub pauses: Option<PathBuf>,
    /// Faults that strike inside an ECU's process.
    #[arg(long, value_name = "SPEC", hide = true)]
    pub fault: Vec<Fault>,
}

impl OverrunArgs {
    /// The policy with its limits.
    pub fn overruns(&self) -> Overruns {
        Overruns {
            policy: self.on_overrun,
            grace_ns: (1e9 * self.startup_grace_s) as u64,
            allowed: self.max_overloads,
        }
    }

    /// The same options for another process.
    pub fn as_arguments(&self) -> Vec<String> {
        let words = [
            ("--on-overrun", self.on_overrun.to_string()),
            ("--startup-grace-s", self.startup_grace_s.to_string()),
            ("--max-overloads", self.max_overloads.to_string()),
        ];
        words.into_iter().flat_map(|(flag, word)| [flag.to_owned(), word]).collect()
    }
}

fn parse_grace(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|s: &f64| (0.0..=3600.0).contains(s));
    seconds.ok_or_else(|| "give seconds from 0 to 3600".to_owned())
}
