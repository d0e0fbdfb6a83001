//! A kernel with CAN where the host's has none: user-mode Linux, an ordinary process.
//!
//! The guest's root is the host's own files, with the caller's own rights, so a command finds there
//! what it would find on the host, and what it writes to files is on the host afterwards. Needed
//! is the kernel (Debian and Ubuntu: package `user-mode-linux`) and nothing else: no privilege, no
//! KVM, no disk image, no module on the host.
//!
//! Three processes of this program take part. The caller ([`run`]) carries streams and signals. The
//! keeper ([`keep`]) starts the kernel and sees to it that nothing of it outlives the caller. The
//! guest ([`guest`]) is the first process inside. A command on a terminal is started through a
//! fourth ([`become_on_terminal`]). A program that uses this module gives words of its command line
//! to the last three, see [`Program`].

mod caller;
mod guest;
mod keeper;
mod wire;

use std::ffi::{OsStr, OsString};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

pub use caller::run;
pub use guest::{become_on_terminal, guest};
pub use keeper::{KeeperTask, keep};

/// Name of the kernel as a program.
const PROGRAM: &str = "linux.uml";
/// Where packages put the modules of such kernels, a folder for each release.
const MODULES: &str = "/usr/lib/uml/modules";

/// A kernel that can be booted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Kernel {
    /// The program.
    pub path: PathBuf,
    /// Its release, such as `6.1.176`.
    pub release: String,
    /// Folder of its modules; none when it has CAN built in.
    pub modules: Option<PathBuf>,
}

impl Kernel {
    /// Finds a kernel and its modules: those given, or the usual ones.
    ///
    /// `search` is a list of folders as in PATH.
    ///
    /// # Errors
    /// [`KernelError`] saying what is missing.
    pub fn find(
        asked: Option<&Path>,
        modules: Option<&Path>,
        search: &OsStr,
    ) -> Result<Self, KernelError> {
        let path = match asked {
            Some(path) => path.to_owned(),
            None => std::env::split_paths(search)
                .map(|folder| folder.join(PROGRAM))
                .find(|path| path.is_file())
                .ok_or(KernelError::NotInstalled)?,
        };
        let release = ask(&path, "--version")?;
        let release = release.lines().last().unwrap_or_default().trim().to_owned();
        let folder = modules.map_or_else(|| Path::new(MODULES).join(&release), Path::to_owned);
        let modules = if folder.join("modules.dep").is_file() {
            Some(folder)
        } else if modules.is_none() && has_can_built_in(&ask(&path, "--showconfig")?) {
            None
        } else {
            return Err(KernelError::NoModules { release, folder });
        };
        Ok(Self { path, release, modules })
    }
}

/// What a kernel prints when asked about itself.
fn ask(kernel: &Path, option: &str) -> Result<String, KernelError> {
    let failed = |error| KernelError::NotRunnable { path: kernel.into(), error };
    let output = Command::new(kernel).arg(option).stdin(Stdio::null()).output().map_err(failed)?;
    if !output.status.success() {
        return Err(failed(io::Error::other(format!("{option}: {}", output.status))));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Whether a kernel's configuration has everything for a rehearsal built in.
fn has_can_built_in(configuration: &str) -> bool {
    ["CONFIG_CAN=y", "CONFIG_CAN_RAW=y", "CONFIG_CAN_VCAN=y"]
        .iter()
        .all(|line| configuration.lines().any(|have| have == *line))
}

/// What to run, and around what.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Task {
    /// The command and its arguments.
    pub command: Vec<OsString>,
    /// Its environment.
    pub environment: Vec<(OsString, OsString)>,
    /// Its current directory.
    pub folder: PathBuf,
    /// CAN FD interfaces to make before it starts.
    pub interfaces: Vec<String>,
    /// Memory of the kernel \[MiB\].
    pub memory_mib: u32,
    /// Folder for temporary files of the host.
    pub temporary: PathBuf,
}

/// How this program is started again in its other parts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Program {
    /// The program's own file.
    pub path: PathBuf,
    /// Words that make it call [`keep`] with the words after them.
    pub keeper: Vec<String>,
    /// Words that make it call [`guest`]; other words may follow and mean nothing.
    pub guest: Vec<String>,
    /// Words that make it call [`become_on_terminal`] with the words after them.
    pub on_terminal: Vec<String>,
}

/// How a task ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ended {
    /// Exit status of the command as a shell says it: 128 and the signal's number when one ended
    /// it, 127 when there is no such command, 126 when it cannot be run.
    pub status: u8,
    /// What else the caller should know, each a line with the remedy.
    pub notes: Vec<String>,
}

/// Why a task did not run, or not to its end. Every message ends with the remedy.
#[derive(Debug, thiserror::Error)]
pub enum KernelError {
    /// There is no kernel to boot.
    #[error(
        "no kernel to boot: {PROGRAM} is not on the PATH; Debian, Ubuntu: `sudo apt install \
         user-mode-linux`; elsewhere build one (`make ARCH=um`, with CONFIG_HOSTFS and \
         CONFIG_CAN_VCAN) and give its path with --uml"
    )]
    NotInstalled,
    /// The program given is not a kernel that runs here.
    #[error("kernel {}: {error}; give the path of a user-mode Linux with --uml", path.display())]
    NotRunnable {
        /// The program.
        path: PathBuf,
        /// The system's own words.
        error: io::Error,
    },
    /// The kernel's modules are not there.
    #[error(
        "kernel {release}: no modules.dep in {}; give the folder of its modules with --modules",
        folder.display()
    )]
    NoModules {
        /// Release of the kernel.
        release: String,
        /// Where they should be.
        folder: PathBuf,
    },
    /// There is no room for the kernel's memory.
    #[error(
        "no room for {asked_mib} MiB of memory: {} has {free_mib} MiB free; free some, give the \
         kernel less with --memory-mb, or in a container more with `docker run --shm-size=2g`",
        place.display()
    )]
    NoMemory {
        /// Memory asked for \[MiB\].
        asked_mib: u32,
        /// Memory there is \[MiB\].
        free_mib: u64,
        /// Where it would be.
        place: PathBuf,
    },
    /// The kernel ended, or hung, before the command could start.
    #[error(
        "the kernel does not boot here ({status}); user-mode Linux needs ptrace(2) and memory \
         that may be executed. The last lines of its console:{console}"
    )]
    Boot {
        /// Its exit status.
        status: String,
        /// The end of its console.
        console: String,
    },
    /// The kernel booted but could not be made ready for the command.
    #[error("the booted kernel is of no use: {0}; give another with --uml and --modules")]
    Refused(String),
    /// The kernel ended in the middle of the command.
    #[error(
        "the kernel died while the command ran ({status}); give it more memory with --memory-mb. \
         The last lines of its console:{console}"
    )]
    Died {
        /// Its exit status.
        status: String,
        /// The end of its console.
        console: String,
    },
    /// The host refused a step.
    #[error("cannot {step}: {error}; free some memory and processes")]
    Os {
        /// The step.
        step: &'static str,
        /// The system's own words.
        error: io::Error,
    },
}

impl KernelError {
    /// Whether the command had begun: then its effects may be there.
    #[must_use]
    pub fn after_the_start(&self) -> bool {
        matches!(self, Self::Died { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_kernel_the_package_is_named() {
        let error = Kernel::find(None, None, OsStr::new("/nosuch")).expect_err("nothing there");
        assert!(error.to_string().contains("apt install user-mode-linux"), "{error}");
    }

    #[test]
    fn a_path_that_is_no_kernel_is_refused_by_name() {
        for path in ["/nosuch/linux.uml", "/dev/null", "/bin/false"] {
            let error = Kernel::find(Some(Path::new(path)), None, OsStr::new("")).expect_err(path);
            assert!(error.to_string().contains(path), "{error}");
            assert!(error.to_string().contains("--uml"), "{error}");
        }
    }

    #[test]
    fn a_kernel_has_can_only_with_all_of_its_parts() {
        assert!(has_can_built_in("CONFIG_CAN=y\nCONFIG_CAN_RAW=y\nCONFIG_CAN_VCAN=y\n"));
        assert!(!has_can_built_in("CONFIG_CAN=y\nCONFIG_CAN_RAW=m\nCONFIG_CAN_VCAN=y\n"));
        assert!(!has_can_built_in(""));
    }
}
