//! The process between caller and kernel, whose one task is that nothing of the kernel is left.
//!
//! User-mode Linux is a family of host processes: the kernel and one for each address space of the
//! guest. When the kernel is killed the others live on, and those that computed keep computing. The
//! keeper is the parent of the kernel and adopts what it leaves behind. It learns of the caller's
//! end, even by SIGKILL, because its standard input is a pipe that only the caller holds open.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{
    Pid, PidfdFlags, Signal, WaitOptions, getpid, kill_process_group, pidfd_open,
    set_child_subreaper, wait,
};

/// How long the guest may take to power off after its caller has gone: it notices by itself and
/// first writes back the files of the command.
const GRACE: Duration = Duration::from_secs(5);
/// What the caller writes to the keeper's standard input to have the kernel killed at once.
pub(super) const KILL_NOW: u8 = b'k';

/// What the keeper is started with, the words after those that choose it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeeperTask {
    /// Folder to remove when the kernel has ended.
    pub scratch: PathBuf,
    /// The kernel and its arguments.
    pub kernel: Vec<OsString>,
}

impl KeeperTask {
    /// The task as words of a command line.
    pub(super) fn words(&self) -> impl Iterator<Item = OsString> {
        [self.scratch.clone().into_os_string()].into_iter().chain(self.kernel.iter().cloned())
    }

    /// The task from words of a command line; none when they are too few.
    #[must_use]
    pub fn from_words(words: &[OsString]) -> Option<Self> {
        let (scratch, kernel) = words.split_first()?;
        (!kernel.is_empty()).then(|| Self { scratch: scratch.into(), kernel: kernel.to_vec() })
    }
}

/// Runs the kernel until it ends or the caller does, and returns the kernel's exit status.
///
/// # Errors
/// When the kernel cannot be started or watched.
pub fn keep(task: &KeeperTask) -> io::Result<u8> {
    set_child_subreaper(Some(getpid()))?;
    let (program, arguments) = task.kernel.split_first().expect("from_words has checked it");
    let kernel = Command::new(program)
        .args(arguments)
        .stdin(Stdio::null())
        // A group of its own, to be killed as one.
        .process_group(0)
        .spawn();
    let status = kernel.and_then(|mut kernel| {
        watch(&kernel)?;
        clear_away(&mut kernel)
    });
    // The kernel removes what it made there unless it was killed.
    let _ = fs::remove_dir_all(&task.scratch);
    status
}

/// Waits until the kernel has ended or must be ended.
fn watch(kernel: &Child) -> io::Result<()> {
    let kernel = pidfd_open(pid_of(kernel), PidfdFlags::empty())?;
    let caller = io::stdin();
    let ready = wait_for(&[caller.as_fd(), kernel.as_fd()], None)?;
    let mut word = [0];
    let leave_time = ready[0] && rustix::io::read(&caller, &mut word) != Ok(1);
    if leave_time {
        wait_for(&[kernel.as_fd()], Some(GRACE))?;
    }
    Ok(())
}

/// Kills the kernel's group and waits until every process it left has ended.
fn clear_away(kernel: &mut Child) -> io::Result<u8> {
    // Nobody may be left in it. Only afterwards is the kernel waited for, which frees its number.
    let _ = kill_process_group(pid_of(kernel), Signal::KILL);
    let status = kernel.wait()?;
    // What it left behind has become ours.
    while let Ok(Some(_)) = wait(WaitOptions::empty()) {}
    Ok(shell_status(status.code(), status.signal()))
}

/// An exit status as a shell says it.
pub(super) fn shell_status(code: Option<i32>, signal: Option<i32>) -> u8 {
    let number = code.or_else(|| signal.map(|number| 128 + number));
    number.and_then(|number| u8::try_from(number & 0xff).ok()).unwrap_or(u8::MAX)
}

fn pid_of(child: &Child) -> Pid {
    Pid::from_raw(child.id().cast_signed()).expect("a child has a number")
}

/// Waits until one of the files is readable or closed; which ones are.
fn wait_for(files: &[BorrowedFd<'_>], limit: Option<Duration>) -> io::Result<Vec<bool>> {
    let limit = limit.map(|limit| Timespec::try_from(limit).expect("a few seconds fit"));
    let mut files: Vec<_> =
        files.iter().map(|file| PollFd::from_borrowed_fd(*file, PollFlags::IN)).collect();
    loop {
        match poll(&mut files, limit.as_ref()) {
            Err(rustix::io::Errno::INTR) => {}
            outcome => {
                outcome?;
                return Ok(files.iter().map(|file| !file.revents().is_empty()).collect());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_task_survives_the_command_line() {
        let kernel = vec!["/opt/a b/linux".into(), "mem=1M".into(), "--".into()];
        let task = KeeperTask { scratch: "/tmp/x y".into(), kernel };
        let words: Vec<OsString> = task.words().collect();
        assert_eq!(KeeperTask::from_words(&words), Some(task));
        assert_eq!(KeeperTask::from_words(&words[..1]), None);
    }

    #[test]
    fn a_signal_is_a_status_above_128() {
        assert_eq!(shell_status(Some(7), None), 7);
        assert_eq!(shell_status(None, Some(libc::SIGTERM)), 143);
    }
}
