//! Rehearses a truck-platoon hardware-in-the-loop test over CAN, on a Linux laptop.
//!
//! This package is the command: one module per verb, and the only place that knows both sides of
//! the bus. The parts are crates of their own: `controller-rt` (the ECU) with `law` (the paper's
//! control law), `bench-sim` (the rig), `platoon-dbc` (messages and buses), `traces` (recordings),
//! `vcan-setup` (the host).

#[cfg(not(target_os = "linux"))]
compile_error!("platoon needs Linux: SocketCAN, real-time scheduling and its clocks");

mod bench;
mod blame;
mod bus;
pub mod bus_plan;
mod calibration;
mod campaign;
mod capture;
mod cli;
mod clock;
mod compare;
mod controller;
mod cpu_plan;
mod dashboard;
mod deadline;
mod diff;
mod export;
mod extract;
mod failure;
mod fault;
mod feed;
mod floor;
mod gain;
mod gateway;
mod heap;
mod identify;
mod import;
mod live;
mod miss_budget;
mod play;
mod process;
mod progress;
pub mod rehearse;
mod replay;
mod report;
mod run_folder;
mod scenarios;
mod scenery;
mod service;
mod stall;
mod step_cost;
pub mod summary;
mod sweep;
mod table;
mod timing;
mod trace;
mod vcan;
mod witness;

use std::process::ExitCode;

use clap::Parser;

use cli::{BenchArgs, Cli, ControllerArgs, Verb};
use failure::{EXIT_FAILED, EXIT_PASSED, Failure};
use summary::Verdict;
use vcan::VcanArgs;

pub use cli::RehearseArgs;

/// The command `platoon`: reads the command line, runs the verb, returns the exit code.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    finish(match cli.verb.unwrap_or(Verb::Rehearse(cli.rehearse)) {
        Verb::Vcan(verb) => return vcan::run(&verb, &["vcan"]),
        Verb::Rehearse(args) => rehearse::run(&args),
        Verb::Controller(args) => controller::run(&args).map(|()| Verdict::Pass),
        Verb::Bench(args) => bench::run(&args),
        Verb::Gain(args) => gain::run(&args),
        Verb::Identify(args) => identify::run(&args).map(|()| Verdict::Pass),
        Verb::Deadline(args) => deadline::run(&args),
        Verb::Floor(args) => floor::run(&args).map(|()| Verdict::Pass),
        Verb::Load(args) => deadline::load(&args).map(|()| Verdict::Pass),
        Verb::MissBudget(args) => miss_budget::run(&args).map(|()| Verdict::Pass),
        Verb::StepCost(args) => step_cost::run(&args).map(|()| Verdict::Pass),
        Verb::Blame(args) => blame::run(&args),
        Verb::Sweep(args) => sweep::run(&args),
        Verb::Scenarios(args) => scenarios::run(&args).map(|()| Verdict::Pass),
        Verb::Compare(args) => compare::run(&args),
        Verb::Report(args) => report::run(&args).map(|()| Verdict::Pass),
        Verb::Replay(args) => replay::run(&args),
        Verb::Diff(args) => diff::run(&args),
        Verb::Play(args) => play::run(&args).map(|()| Verdict::Pass),
        Verb::Export(args) => export::run(&args).map(|()| Verdict::Pass),
        Verb::Import(args) => import::run(&args).map(|()| Verdict::Pass),
        Verb::Extract(args) => extract::run(&args).map(|()| Verdict::Pass),
    })
}

/// The thin command `controller-rt`: one ECU and nothing else.
pub fn controller_main() -> ExitCode {
    finish(controller::run(&alone::<ControllerArgs>("controller-rt")).map(|()| Verdict::Pass))
}

/// The thin command `bench-sim`: the rig and nothing else.
pub fn bench_main() -> ExitCode {
    finish(bench::run(&alone::<BenchArgs>("bench-sim")))
}

/// The thin command `vcan-setup`: the host and nothing else.
pub fn vcan_main() -> ExitCode {
    vcan::run(&alone::<VcanArgs>("vcan-setup"), &[])
}

/// Parses the options of one verb as a command line of its own.
fn alone<Options: clap::Args>(name: &'static str) -> Options {
    let command =
        Options::augment_args(clap::Command::new(name).version(env!("CARGO_PKG_VERSION")));
    Options::from_arg_matches(&command.get_matches()).unwrap_or_else(|error| error.exit())
}

/// A verdict or the reason there is none, as an exit code.
fn finish(outcome: Result<Verdict, Failure>) -> ExitCode {
    match outcome {
        Ok(Verdict::Pass) => EXIT_PASSED.into(),
        Ok(Verdict::Fail) => EXIT_FAILED.into(),
        Err(failure) => {
            anstream::eprintln!("platoon: {failure}");
            failure.exit_code()
        }
    }
}
