//! What happens to this process that concerns the command: signals, and the end of who started it.

use std::fs;
use std::io;
use std::os::fd::AsFd;
use std::sync::mpsc::Sender;
use std::thread;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::process::{PidfdFlags, getppid, pidfd_open};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2, SIGWINCH};
use signal_hook::iterator::Signals;

use super::Event;

/// Signals that are the command's business.
const FORWARDED: [i32; 6] = [SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2];

/// Reports the signals that are the command's business, except those the caller has us ignore.
pub(super) fn signals(events: &Sender<Event>) -> io::Result<()> {
    let ignored = ignored_signals();
    let heeded = FORWARDED.into_iter().filter(|number| ignored >> (number - 1) & 1 == 0);
    let mut arriving = Signals::new(heeded.chain([SIGWINCH]))?;
    let report = events.clone();
    thread::spawn(move || {
        for number in arriving.forever() {
            if report.send(Event::Signal(number)).is_err() {
                return;
            }
        }
    });
    Ok(())
}

/// Reports the end of the process that started us: nobody waits for the command any more. With
/// SIGHUP ignored, as by nohup(1), that is meant to be so.
pub(super) fn parent(events: &Sender<Event>) -> io::Result<()> {
    let wanted = ignored_signals() >> (SIGHUP - 1) & 1 == 1;
    let Some(number) = getppid().filter(|_| !wanted) else {
        return Ok(());
    };
    let watched = pidfd_open(number, PidfdFlags::empty())?;
    let report = events.clone();
    thread::spawn(move || {
        // It is orphaned too when the parent ended before we could watch it.
        let alive = getppid() == Some(number);
        if !alive || wait_readable(&watched).is_ok() {
            let _ = report.send(Event::Orphaned);
        }
    });
    Ok(())
}

/// The signals this process ignores, one bit each.
fn ignored_signals() -> u64 {
    status_field("SigIgn:").and_then(|mask| u64::from_str_radix(&mask, 16).ok()).unwrap_or(0)
}

/// A value of /proc/self/status.
pub(super) fn status_field(name: &str) -> Option<String> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let value = status.lines().find_map(|line| line.strip_prefix(name))?;
    Some(value.trim().to_owned())
}

/// Waits until a file can be read, or is closed.
pub(super) fn wait_readable(file: impl AsFd) -> rustix::io::Result<()> {
    loop {
        match poll(&mut [PollFd::new(&file, PollFlags::IN)], None) {
            Err(Errno::INTR) => {}
            outcome => return outcome.map(|_| ()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_ignored_is_read_from_the_kernels_account() {
        assert_eq!(ignored_signals() >> (libc::SIGKILL - 1) & 1, 0);
        assert_eq!(status_field("NoSuchField:"), None);
    }
}
