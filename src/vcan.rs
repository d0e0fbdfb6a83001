//! `platoon vcan`: the host. Virtual CAN interfaces, and a kernel that has CAN where it has none.

mod interfaces;
mod report;
mod shell;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Args, Subcommand};

use crate::failure::Failure;
use crate::summary::Verdict;

pub use interfaces::Interfaces;
pub use report::CheckArgs;

pub use shell::ShellArgs;

/// Options of `vcan`.
#[derive(Debug, Clone, Args)]
pub struct VcanArgs {
    /// What to do.
    #[command(subcommand)]
    verb: VcanVerb,
}

/// The verbs of `vcan`.
#[derive(Debug, Clone, Subcommand)]
pub enum VcanVerb {
    /// Make virtual CAN interfaces fit for CAN FD; those that are there already are left alone.
    Up(Interfaces),
    /// Remove virtual CAN interfaces that carry no traffic; any other kind is refused.
    Down(Interfaces),
    /// Say whether a rehearsal over vcan can run here, and how ready the machine is for real time.
    ///
    /// Exit status: 0 when a rehearsal over these interfaces can run here, now (they are there, or
    /// a run can make them), else 3. Warnings, and everything about real time, do not change it.
    Check(CheckArgs),
    /// Run a command in a kernel that has CAN: user-mode Linux, an ordinary process.
    ///
    /// The command runs with the host's files, with your rights, in this folder, with these
    /// arguments and this environment; what it writes to files is on the host afterwards. It is
    /// root of its own network, with interfaces truck0, truck1, ... up and fit for CAN FD.
    ///
    /// Exit status: the command's own (128 and the number of the signal that ended it); 3 when the
    /// kernel cannot be started, 255 when it died on the way, 127 or 126 when there is no such
    /// command.
    Shell(ShellArgs),
    /// Started by `shell`: sees to it that nothing of the kernel is left.
    #[command(hide = true)]
    Keep(Words),
    /// Started by the booted kernel as its first process.
    #[command(hide = true)]
    Guest(Words),
    /// Started in the booted kernel for a command on a terminal.
    #[command(hide = true)]
    Terminal(Words),
}

/// Words of one part of this program for another.
#[derive(Debug, Clone, Args)]
pub struct Words {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    words: Vec<OsString>,
}

/// Runs a verb; `prefix` are the words of the command line that lead to [`VcanArgs`].
pub fn run(args: &VcanArgs, prefix: &[&str]) -> ExitCode {
    match &args.verb {
        VcanVerb::Up(interfaces) => finish(interfaces.up()),
        VcanVerb::Down(interfaces) => finish(interfaces.down()),
        VcanVerb::Check(args) => finish(report::run(args)),
        VcanVerb::Shell(args) => shell::run(args, prefix),
        VcanVerb::Keep(words) => shell::keep(&words.words),
        VcanVerb::Guest(_) => shell::guest(),
        VcanVerb::Terminal(words) => shell::become_on_terminal(&words.words),
    }
}

/// The exit code of a verb that judges no rehearsal.
fn finish(outcome: Result<(), Failure>) -> ExitCode {
    crate::finish(outcome.map(|()| Verdict::Pass))
}
