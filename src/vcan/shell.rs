//! `platoon vcan shell`: a command in a kernel that has CAN, and the parts of this program that
//! make it.

use std::env;
use std::ffi::OsString;
use std::io::{self, IsTerminal};
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use vcan_setup::kernel::{self, KeeperTask, Kernel, KernelError, Program, Task};

use super::interfaces::numbered;
use crate::failure::{EXIT_CANNOT_START, EXIT_USAGE, Failure};

/// The kernel died while the command ran: no exit status of its own (ssh says it so too).
const EXIT_DIED: u8 = 255;
/// There is no such command, or it cannot be run, as shells say it.
const EXIT_NOT_FOUND: u8 = 127;
const EXIT_NOT_EXECUTABLE: u8 = 126;

/// Options of `vcan shell`.
#[derive(Debug, Clone, Args)]
pub struct ShellArgs {
    /// The kernel (default: linux.uml on the PATH; Debian, Ubuntu: package user-mode-linux).
    #[arg(long, value_name = "PATH")]
    uml: Option<PathBuf>,
    /// Folder of the kernel's modules (default: /usr/lib/uml/modules/RELEASE).
    #[arg(long, value_name = "DIR")]
    modules: Option<PathBuf>,
    /// Virtual CAN interfaces to make: how many (truck0, truck1, ...), or their names.
    #[arg(long, value_name = "N|NAME,NAME,...", default_value = "4")]
    interfaces: String,
    /// Memory of the kernel in MiB; only what is used is taken from the host.
    #[arg(long, value_name = "MIB", default_value_t = 1024,
          value_parser = clap::value_parser!(u32).range(64..=1 << 20))]
    memory_mb: u32,
    /// The command and its arguments; your shell when left out.
    #[arg(last = true, value_name = "CMD")]
    command: Vec<OsString>,
}

/// Boots the kernel and runs the command.
pub fn run(args: &ShellArgs, prefix: &[&str]) -> ExitCode {
    let ended = prepare(args, prefix).and_then(|(kernel, task, program)| {
        kernel::run(&kernel, &task, &program).map_err(|error| match error {
            KernelError::Died { .. } => Failure::with_code(EXIT_DIED, error),
            _ => Failure::cannot_start(error),
        })
    });
    match ended {
        Ok(ended) => {
            for note in &ended.notes {
                anstream::eprintln!("platoon: {note}");
            }
            ended.status.into()
        }
        Err(failure) => {
            anstream::eprintln!("platoon: {failure}");
            failure.exit_code()
        }
    }
}

/// Everything the kernel needs to know.
fn prepare(args: &ShellArgs, prefix: &[&str]) -> Result<(Kernel, Task, Program), Failure> {
    let command = match args.command.as_slice() {
        [] => your_shell()?,
        words => words.to_vec(),
    };
    let search = env::var_os("PATH").unwrap_or_default();
    let kernel = Kernel::find(args.uml.as_deref(), args.modules.as_deref(), &search)
        .map_err(Failure::cannot_start)?;
    let failed = |what: &str, error: io::Error| Failure::cannot_start(format!("{what}: {error}"));
    let task = Task {
        command,
        environment: env::vars_os().collect(),
        folder: env::current_dir().map_err(|error| failed("the current folder", error))?,
        interfaces: interface_names(&args.interfaces),
        memory_mib: args.memory_mb,
        temporary: env::temp_dir(),
    };
    let words = |verb: &str| prefix.iter().copied().chain([verb]).map(str::to_owned).collect();
    let program = Program {
        path: env::current_exe().map_err(|error| failed("this program", error))?,
        keeper: words("keep"),
        guest: words("guest"),
        on_terminal: words("terminal"),
    };
    Ok((kernel, task, program))
}

/// The user's shell, for an interactive session.
fn your_shell() -> Result<Vec<OsString>, Failure> {
    if !(io::stdin().is_terminal() && io::stdout().is_terminal()) {
        return Err(Failure::usage(
            "vcan shell: no command and no terminal; say what to run: platoon vcan shell -- CMD",
        ));
    }
    Ok(vec![env::var_os("SHELL").unwrap_or_else(|| "/bin/sh".into())])
}

/// Names of interfaces from a number of them, or a list.
fn interface_names(asked: &str) -> Vec<String> {
    match asked.parse() {
        Ok(count) => numbered(count),
        Err(_) => asked.split(',').map(|name| name.trim().to_owned()).collect(),
    }
}

/// Is the keeper.
pub fn keep(words: &[OsString]) -> ExitCode {
    let Some(task) = KeeperTask::from_words(words) else {
        anstream::eprintln!("platoon: vcan keep is for platoon itself; use vcan shell");
        return EXIT_USAGE.into();
    };
    match kernel::keep(&task) {
        Ok(status) => status.into(),
        Err(error) => {
            // Standard error is the console of the kernel that was not to be.
            eprintln!("{}: {error}", task.kernel[0].to_string_lossy());
            EXIT_CANNOT_START.into()
        }
    }
}

/// Is the first process of the booted kernel.
pub fn guest() -> ExitCode {
    let error = kernel::guest();
    eprintln!("platoon: vcan guest: {error}; use vcan shell");
    EXIT_USAGE.into()
}

/// Becomes a command on its terminal.
pub fn become_on_terminal(command: &[OsString]) -> ExitCode {
    let error = kernel::become_on_terminal(command);
    let name = command.first().map(|name| name.to_string_lossy()).unwrap_or_default();
    eprintln!("platoon: {name}: {error}");
    let missing = error.kind() == io::ErrorKind::NotFound;
    if missing { EXIT_NOT_FOUND } else { EXIT_NOT_EXECUTABLE }.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interfaces_are_counted_or_named() {
        assert_eq!(interface_names("2"), ["truck0", "truck1"]);
        assert_eq!(interface_names("0"), [""; 0]);
        assert_eq!(interface_names("vcan0, can1"), ["vcan0", "can1"]);
    }
}
