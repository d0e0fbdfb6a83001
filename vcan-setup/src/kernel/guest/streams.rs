//! The guest's side of the command's streams: pipes or a terminal for the command, and threads that
//! carry their bytes to the lines of the caller and back.

use std::fs::File;
use std::io::{self, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::pipe::{PipeFlags, pipe_with};
use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use rustix::pty::{OpenptFlags, grantpt, ioctl_tiocgptpeer, openpt, unlockpt};
use rustix::termios::{Winsize, tcdrain, tcgetpgrp, tcsetwinsize};

use super::super::wire::{ERRORS, Job, LINES, OUTPUT, ToGuest, Window};

/// Bytes carried at once.
const CHUNK_BYTES: usize = 1 << 14;

/// Our ends of the command's streams.
pub(super) struct Streams {
    input: File,
    /// Sources of the lines [`OUTPUT`] and [`ERRORS`]; no second one when both are one terminal.
    outputs: Vec<(usize, File)>,
    terminal: Option<File>,
}

impl Streams {
    /// The command, connected to streams, and our ends of these.
    pub(super) fn connect(job: &Job) -> io::Result<(Command, Self)> {
        match job.window {
            Some(window) => on_terminal(job, window),
            None => on_pipes(job),
        }
    }

    /// Begins to carry bytes. What the caller says about them goes to the first, the second is to
    /// be waited for.
    pub(super) fn start(
        self,
        lines: [File; LINES],
        command: Option<Pid>,
    ) -> io::Result<(Control, Outputs)> {
        let unread: [Arc<AtomicBool>; LINES] = Default::default();
        let (end_seen, input_end) = pipe_with(PipeFlags::CLOEXEC)?;
        let from_caller = lines[OUTPUT].try_clone()?;
        let (input, end_seen) = (self.input, File::from(end_seen));
        // Not waited for: it may wait for input that never comes.
        thread::spawn(move || carry_input(&from_caller, &end_seen, input));
        let mut carriers = Vec::new();
        for (line, source) in self.outputs {
            let (to_caller, unread) = (lines[line].try_clone()?, Arc::clone(&unread[line]));
            carriers.push((line, thread::spawn(move || carry_output(source, to_caller, &unread))));
        }
        let control =
            Control { command, terminal: self.terminal, input_end: input_end.into(), unread };
        Ok((control, Outputs(carriers)))
    }
}

/// The command as a process group without a terminal, its streams pipes.
fn on_pipes(job: &Job) -> io::Result<(Command, Streams)> {
    let (stdin, input) = pipe_with(PipeFlags::CLOEXEC)?;
    let (output, stdout) = pipe_with(PipeFlags::CLOEXEC)?;
    let (errors, stderr) = pipe_with(PipeFlags::CLOEXEC)?;
    let mut command = Command::new(job.command.first().ok_or_else(no_command)?);
    command.args(&job.command[1..]).process_group(0);
    surround(&mut command, job, [stdin, stdout, stderr]);
    let outputs = vec![(OUTPUT, output.into()), (ERRORS, errors.into())];
    Ok((command, Streams { input: input.into(), outputs, terminal: None }))
}

/// The command on a new terminal, of which it leads the session.
fn on_terminal(job: &Job, window: Window) -> io::Result<(Command, Streams)> {
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY;
    let terminal = openpt(flags | OpenptFlags::CLOEXEC)?;
    grantpt(&terminal)?;
    unlockpt(&terminal)?;
    tcsetwinsize(&terminal, as_winsize(window))?;
    let near = || ioctl_tiocgptpeer(&terminal, flags | OpenptFlags::CLOEXEC);
    let (program, words) = job.on_terminal.split_first().ok_or_else(no_command)?;
    let mut command = Command::new(program);
    command.args(words).args(&job.command);
    let terminal_end = |terminal: &OwnedFd| terminal.try_clone().map(File::from);
    let mut outputs = vec![(OUTPUT, terminal_end(&terminal)?)];
    let stderr = if job.errors_to_terminal {
        near()?
    } else {
        let (errors, stderr) = pipe_with(PipeFlags::CLOEXEC)?;
        outputs.push((ERRORS, errors.into()));
        stderr
    };
    surround(&mut command, job, [near()?, near()?, stderr]);
    let input = terminal_end(&terminal)?;
    Ok((command, Streams { input, outputs, terminal: Some(terminal.into()) }))
}

/// Gives a command its environment, folder and streams.
fn surround(command: &mut Command, job: &Job, streams: [OwnedFd; 3]) {
    let [stdin, stdout, stderr] = streams.map(Stdio::from);
    command.env_clear().envs(job.environment.iter().cloned()).current_dir(&job.folder);
    command.stdin(stdin).stdout(stdout).stderr(stderr);
}

fn no_command() -> io::Error {
    io::Error::new(io::ErrorKind::NotFound, "no command")
}

fn as_winsize(window: Window) -> Winsize {
    Winsize { ws_row: window.rows, ws_col: window.columns, ws_xpixel: 0, ws_ypixel: 0 }
}

/// Takes the terminal on standard input for itself and becomes the command: the part of starting it
/// that only the command's own process can do. Returns only when that fails.
pub fn become_on_terminal(command: &[std::ffi::OsString]) -> io::Error {
    let Some((program, arguments)) = command.split_first() else {
        return no_command();
    };
    let taken =
        rustix::process::setsid().and_then(|_| rustix::process::ioctl_tiocsctty(io::stdin()));
    match taken {
        Ok(()) => Command::new(program).args(arguments).exec(),
        Err(error) => error.into(),
    }
}

/// What the caller can do to a running command.
pub(super) struct Control {
    command: Option<Pid>,
    terminal: Option<File>,
    input_end: File,
    unread: [Arc<AtomicBool>; LINES],
}

impl Control {
    /// Does what the caller says; nobody is told about what is too late or makes no sense.
    pub(super) fn obey(&self, message: &ToGuest) {
        match *message {
            ToGuest::InputEnd(bytes) => {
                let _ = (&self.input_end).write_all(&bytes.to_le_bytes());
            }
            ToGuest::Signal(number) => self.signal(number),
            ToGuest::Resize(window) => {
                if let Some(terminal) = &self.terminal {
                    let _ = tcsetwinsize(terminal, as_winsize(window));
                }
            }
            ToGuest::Unread(line) => {
                if let Some(unread) = self.unread.get(usize::from(line)) {
                    unread.store(true, Ordering::Relaxed);
                }
            }
            ToGuest::Start(_) | ToGuest::Farewell => {}
        }
    }

    /// What a terminal sends to a whole group goes to the whole group, the rest to the command.
    fn signal(&self, number: i32) {
        let (Some(command), Some(signal)) = (self.command, Signal::from_named_raw(number)) else {
            return;
        };
        let of_terminal = matches!(signal, Signal::INT | Signal::QUIT | Signal::HUP);
        let group = match &self.terminal {
            Some(terminal) => tcgetpgrp(terminal).ok(),
            None => Some(command),
        };
        let _ = match group.filter(|_| of_terminal) {
            Some(group) => kill_process_group(group, signal),
            None => kill_process(command, signal),
        };
    }
}

/// The threads that carry what the command writes.
pub(super) struct Outputs(Vec<(usize, JoinHandle<u64>)>);

impl Outputs {
    /// Waits until all of it is on its way; how many bytes each line has carried.
    pub(super) fn join(self) -> [u64; LINES] {
        let mut sent = [0; LINES];
        for (line, carrier) in self.0 {
            sent[line] = carrier.join().unwrap_or(0);
        }
        sent
    }
}

/// Carries standard input until it ends, as many bytes as the caller says it has.
fn carry_input(from_caller: &File, end_seen: &File, mut to_command: File) {
    let (mut carried, mut end) = (0_u64, None);
    let mut chunk = [0; CHUNK_BYTES];
    while end.is_none_or(|end| carried < end) {
        let mut files =
            [PollFd::new(from_caller, PollFlags::IN), PollFd::new(end_seen, PollFlags::IN)];
        if poll(&mut files, None).is_err_and(|error| error != rustix::io::Errno::INTR) {
            return;
        }
        let [has_bytes, has_end] = files.map(|file| !file.revents().is_empty());
        if has_end && end.is_none() {
            let mut bytes = [0; 8];
            end = (&mut &*end_seen).read_exact(&mut bytes).ok().map(|()| u64::from_le_bytes(bytes));
        }
        if has_bytes {
            match (&mut &*from_caller).read(&mut chunk) {
                Ok(count) if count > 0 && to_command.write_all(&chunk[..count]).is_ok() => {
                    carried += count as u64;
                }
                // The caller is gone, or the command has closed its standard input.
                _ => return,
            }
        }
    }
}

/// Carries what the command writes to one stream until nobody holds that open any more.
fn carry_output(mut source: File, mut to_caller: File, unread: &AtomicBool) -> u64 {
    let mut carried = 0;
    let mut chunk = [0; CHUNK_BYTES];
    while !unread.load(Ordering::Relaxed) {
        // A terminal that nobody holds open any more ends with an error.
        let Ok(count @ 1..) = source.read(&mut chunk) else {
            break;
        };
        if to_caller.write_all(&chunk[..count]).is_err() {
            break;
        }
        carried += count as u64;
    }
    // Closed now, so that a command whose output nobody reads learns of it.
    drop(source);
    let _ = tcdrain(&to_caller);
    carried
}
