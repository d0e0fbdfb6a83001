//! The running kernel, seen from outside: its keeper, its lines, its console.

use std::ffi::{OsStr, OsString};
use std::fs::DirBuilder;
use std::io::{self, Write};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::fs::DirBuilderExt;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, Stdio};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use rustix::io::{FdFlags, fcntl_setfd};

use super::super::keeper::{KILL_NOW, KeeperTask};
use super::super::wire::{self, ERRORS, LINES, MESSAGES, OUTPUT, ToGuest};
use super::super::{Kernel, KernelError, Program, Task};
use super::carriers::carry_output;
use super::console::Console;
use super::{Event, doing, memory};

/// What the kernel is told besides what differs from task to task: the host's files are its root,
/// what it has to say goes to its standard output.
const KERNEL_OPTIONS: [&str; 9] = [
    "umid=kernel",
    "rootfstype=hostfs",
    "rootflags=/",
    "rw",
    "con=null",
    "con0=null,fd:1",
    "console=tty0",
    "quiet",
    "loglevel=1",
];

/// The running kernel.
pub(super) struct Machine {
    /// The keeper lives as long as this is open.
    lifeline: ChildStdin,
    /// The kernel's folder, which the keeper removes when it is not killed itself.
    pub(super) scratch: PathBuf,
    pub(super) lines: [UnixStream; LINES],
    /// The threads that carry the command's output and errors, and what each has carried.
    pub(super) carriers: Vec<(usize, JoinHandle<u64>)>,
    pub(super) console: Arc<Mutex<Console>>,
}

impl Machine {
    /// Starts the keeper, which starts the kernel.
    pub(super) fn start(
        kernel: &Kernel,
        task: &Task,
        program: &Program,
        events: &Sender<Event>,
    ) -> Result<Self, KernelError> {
        let memory = memory::place(task.memory_mib, &task.temporary)?;
        let (lines, guest_ends) = lines().map_err(doing("make the lines to the kernel"))?;
        let (console, console_end) = io::pipe().map_err(doing("make the kernel's console"))?;
        let scratch =
            scratch_folder(&task.temporary).map_err(doing("make a folder for the kernel"))?;
        let keeper = KeeperTask {
            kernel: kernel_words(kernel, task, program, &scratch, &guest_ends),
            scratch: scratch.clone(),
        };
        let mut child = console_end
            .try_clone()
            .and_then(|console_too| {
                Command::new(&program.path)
                    .args(&program.keeper)
                    .args(keeper.words())
                    // Where user-mode Linux keeps the guest's memory.
                    .env("TMPDIR", memory)
                    .stdin(Stdio::piped())
                    .stdout(console_end)
                    .stderr(console_too)
                    // Ctrl-C is for the command, not for the kernel it runs in.
                    .process_group(0)
                    .spawn()
            })
            .map_err(doing("start the keeper of the kernel"))?;
        drop(guest_ends);
        let lifeline = child.stdin.take().expect("asked for above");
        let report = events.clone();
        thread::spawn(move || report.send(Event::PoweredOff(child.wait().ok())));
        let console = Console::collect(console);
        let carriers = listen(&lines, events).map_err(doing("read from the kernel"))?;
        Ok(Self { lifeline, scratch, lines, carriers, console })
    }

    pub(super) fn say(&mut self, message: &ToGuest) {
        // A guest that is gone is noticed by the end of its keeper.
        let _ = wire::send(&mut self.lines[MESSAGES], message);
    }

    pub(super) fn kill(&mut self) {
        // A keeper that is gone has killed it already.
        let _ = self.lifeline.write_all(&[KILL_NOW]);
    }
}

/// Starts the threads that listen to the guest; those that carry bytes, each with its line.
fn listen(
    lines: &[UnixStream; LINES],
    events: &Sender<Event>,
) -> io::Result<Vec<(usize, JoinHandle<u64>)>> {
    let (mut messages, report) = (lines[MESSAGES].try_clone()?, events.clone());
    thread::spawn(move || {
        while let Ok(Some(message)) = wire::receive(&mut messages) {
            if report.send(Event::Said(message)).is_err() {
                return;
            }
        }
    });
    let mut carriers = Vec::new();
    for line in [OUTPUT, ERRORS] {
        let (from_guest, report) = (lines[line].try_clone()?, events.clone());
        carriers.push((line, thread::spawn(move || carry_output(line, from_guest, &report))));
    }
    Ok(carriers)
}

/// The ends of the lines: ours, and those the kernel inherits by their numbers.
fn lines() -> io::Result<([UnixStream; LINES], Vec<OwnedFd>)> {
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for _ in 0..LINES {
        let (our, their) = UnixStream::pair()?;
        fcntl_setfd(&their, FdFlags::empty())?;
        ours.push(our);
        theirs.push(OwnedFd::from(their));
    }
    Ok((ours.try_into().expect("one pair for each line"), theirs))
}

/// A folder of our own for the kernel's control socket; its path must be short.
fn scratch_folder(temporary: &Path) -> io::Result<PathBuf> {
    for number in 0.. {
        let name = format!("platoon-kernel-{}-{number}", std::process::id());
        let path = temporary.join(name);
        match DirBuilder::new().mode(0o700).create(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            outcome => return outcome.map(|()| path),
        }
    }
    unreachable!("a process has made fewer folders than there are numbers")
}

/// The kernel's command line.
fn kernel_words(
    kernel: &Kernel,
    task: &Task,
    program: &Program,
    scratch: &Path,
    guest_ends: &[OwnedFd],
) -> Vec<OsString> {
    let option = |name: &str, value: &OsStr, end: &str| {
        let mut word = OsString::from(name);
        word.push(value);
        word.push(end);
        word
    };
    let mut words = vec![
        kernel.path.clone().into_os_string(),
        format!("mem={}M", task.memory_mib).into(),
        option("uml_dir=", scratch.as_os_str(), "/"),
        // The kernel itself takes the quotes away again.
        option("init=\"", program.path.as_os_str(), "\""),
    ];
    words.extend(KERNEL_OPTIONS.map(Into::into));
    for (number, end) in guest_ends.iter().enumerate() {
        words.push(format!("ssl{number}=fd:{}", end.as_raw_fd()).into());
    }
    words.push("--".into());
    words.extend(program.guest.iter().map(Into::into));
    words
}
