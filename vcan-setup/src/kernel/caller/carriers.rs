//! The threads that carry bytes between our own streams and the lines of the guest.

use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::Sender;
use std::thread;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::process::getpgrp;
use rustix::termios::{isatty, tcgetpgrp};

use super::super::wire::OUTPUT;
use super::Event;
use super::watch::wait_readable;

/// Time between two looks at whether we may read from the terminal.
const FOREGROUND_LOOK: Duration = Duration::from_millis(100);
/// Bytes carried at once.
const CHUNK_BYTES: usize = 1 << 14;

/// Carries standard input to the guest until it ends.
pub(super) fn carry_input(mut to_guest: UnixStream, events: &Sender<Event>) {
    let mut carried = 0_u64;
    let mut chunk = [0; CHUNK_BYTES];
    loop {
        wait_for_foreground();
        match rustix::io::read(io::stdin(), &mut chunk) {
            Ok(count @ 1..) => {
                if to_guest.write_all(&chunk[..count]).is_err() {
                    return;
                }
                carried += count as u64;
            }
            Err(Errno::INTR) => {}
            Err(Errno::AGAIN) => {
                let _ = wait_readable(io::stdin());
            }
            // Closed, or a terminal that is gone.
            Ok(0) | Err(_) => break,
        }
    }
    // Nobody to tell means that it is over.
    let _ = events.send(Event::InputEnded(carried));
}

/// Returns when standard input may be read: a terminal is for its foreground processes, and would
/// stop any other that reads.
fn wait_for_foreground() {
    while isatty(io::stdin()) {
        let _ = wait_readable(io::stdin());
        if tcgetpgrp(io::stdin()).is_ok_and(|group| group != getpgrp()) {
            thread::sleep(FOREGROUND_LOOK);
        } else {
            return;
        }
    }
}

/// Carries what comes on a line to our own stream until the kernel closes it, and goes on counting
/// when nobody reads that any more.
pub(super) fn carry_output(line: usize, mut from_guest: UnixStream, events: &Sender<Event>) -> u64 {
    let mut carried = 0_u64;
    let mut is_read = true;
    let mut chunk = [0; CHUNK_BYTES];
    while let Ok(count @ 1..) = from_guest.read(&mut chunk) {
        carried += count as u64;
        if is_read && write_whole(line, &chunk[..count]).is_err() {
            is_read = false;
            let _ = events.send(Event::Unread(line));
        }
    }
    carried
}

/// Writes to our own standard output or error, past the buffers of the standard library.
fn write_whole(line: usize, mut bytes: &[u8]) -> rustix::io::Result<()> {
    let (stdout, stderr) = (io::stdout(), io::stderr());
    let file = if line == OUTPUT { stdout.as_fd() } else { stderr.as_fd() };
    while !bytes.is_empty() {
        match rustix::io::write(file, bytes) {
            Ok(count) => bytes = &bytes[count..],
            Err(Errno::INTR) => {}
            Err(Errno::AGAIN) => {
                poll(&mut [PollFd::new(&file, PollFlags::OUT)], None)?;
            }
            Err(error) => return Err(error),
        }
    }
    Ok(())
}
