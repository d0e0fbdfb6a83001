//! The caller's side: starts the keeper and through it the kernel, hands the guest its job, carries
//! streams and signals both ways, and learns how it ended.

use std::collections::VecDeque;
use std::ffi::{OsStr, OsString};
use std::fs::{self, DirBuilder};
use std::io::{self, BufRead, BufReader, PipeReader, Read, Write};
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::os::unix::fs::DirBuilderExt;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::{Errno, FdFlags, fcntl_setfd};
use rustix::process::{PidfdFlags, getpgrp, getppid, pidfd_open};
use rustix::termios::{isatty, tcgetpgrp};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2, SIGWINCH};
use signal_hook::iterator::Signals;

use super::keeper::{KILL_NOW, KeeperTask, shell_status};
use super::terminal::Terminal;
use super::wire::{self, ERRORS, Ending, Job, LINES, MESSAGES, OUTPUT, ToCaller, ToGuest};
use super::{Ended, Kernel, KernelError, Program, Task, memory};

/// How long the kernel may take from its start to the guest's first word.
const BOOT_LIMIT: Duration = Duration::from_secs(120);
/// How long the kernel may take to power off.
const POWER_OFF_LIMIT: Duration = Duration::from_secs(20);
/// Time between two looks at whether we may read from the terminal.
const FOREGROUND_LOOK: Duration = Duration::from_millis(100);
/// Lines of the kernel's console kept, and those quoted in an error message.
const CONSOLE_LINES: usize = 200;
const CONSOLE_LINES_SHOWN: usize = 8;
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
/// Bytes carried at once.
const CHUNK_BYTES: usize = 1 << 14;
/// Signals that are the command's business.
const FORWARDED: [i32; 6] = [SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2];

/// What the threads around the conversation report.
enum Event {
    /// The guest says something.
    Said(ToCaller),
    /// Standard input has ended after this many bytes.
    InputEnded(u64),
    /// Nobody reads our standard output, or error, any more.
    Unread(usize),
    /// A signal has come.
    Signal(i32),
    /// The process that started us is gone.
    Orphaned,
    /// The keeper has ended, and with it the kernel.
    PoweredOff(Option<ExitStatus>),
}

/// Runs the task in a freshly booted kernel until its command ends.
///
/// Standard input, output and error are carried to the command and back; when the first two are
/// terminals, the command has one too. Threads of this call may go on waiting for standard input,
/// so the process should end soon after it.
///
/// # Errors
/// [`KernelError`], each variant with the remedy.
pub fn run(kernel: &Kernel, task: &Task, program: &Program) -> Result<Ended, KernelError> {
    let terminal = Terminal::of_caller();
    let job = job(kernel, task, program, terminal.as_ref());
    let (events, reported) = mpsc::channel();
    // Before anything is started, so that a signal finds somebody to end it again.
    watch_signals(&events).map_err(doing("catch signals"))?;
    watch_parent(&events).map_err(doing("watch the calling process"))?;
    let machine = Machine::start(kernel, task, program, &events)?;
    let mut conversation = Conversation {
        machine,
        events,
        reported,
        terminal,
        job: Some(Box::new(job)),
        started: false,
        ending: None,
    };
    let outcome = conversation.hold();
    // The terminal is given back before anybody is told how it ended.
    drop(conversation.terminal.take());
    conversation.conclude(outcome)
}

/// The job in the guest's words.
fn job(kernel: &Kernel, task: &Task, program: &Program, terminal: Option<&Terminal>) -> Job {
    let on_terminal = [program.path.clone().into_os_string()]
        .into_iter()
        .chain(program.on_terminal.iter().map(Into::into));
    Job {
        command: task.command.clone(),
        on_terminal: on_terminal.collect(),
        environment: task.environment.clone(),
        folder: task.folder.clone().into_os_string(),
        umask: current_umask(),
        host: host_name(),
        modules: kernel.modules.clone().map(PathBuf::into_os_string),
        interfaces: task.interfaces.clone(),
        window: terminal.map(Terminal::window),
        errors_to_terminal: rustix::termios::isatty(io::stderr()),
    }
}

/// The file mode creation mask, from the kernel's own account: reading it by umask(2) changes it.
fn current_umask() -> u32 {
    status_field("Umask:").and_then(|mask| u32::from_str_radix(&mask, 8).ok()).unwrap_or(0o022)
}

fn host_name() -> OsString {
    rustix::system::uname().nodename().to_string_lossy().into_owned().into()
}

/// The running kernel, seen from outside.
struct Machine {
    /// The keeper lives as long as this is open.
    lifeline: ChildStdin,
    /// The kernel's folder, which the keeper removes when it is not killed itself.
    scratch: PathBuf,
    lines: [UnixStream; LINES],
    /// The threads that carry the command's output and errors, and what each has carried.
    carriers: Vec<(usize, JoinHandle<u64>)>,
    console: Arc<Mutex<Console>>,
}

impl Machine {
    /// Starts the keeper, which starts the kernel.
    fn start(
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

    fn say(&mut self, message: &ToGuest) {
        // A guest that is gone is noticed by the end of its keeper.
        let _ = wire::send(&mut self.lines[MESSAGES], message);
    }

    fn kill(&mut self) {
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

/// The exchange with the guest.
struct Conversation {
    machine: Machine,
    events: Sender<Event>,
    reported: Receiver<Event>,
    terminal: Option<Terminal>,
    /// What the guest is to do, until it was told.
    job: Option<Box<Job>>,
    started: bool,
    ending: Option<Ending>,
}

/// Why the conversation ended.
enum Outcome {
    /// The kernel has ended.
    PoweredOff(Option<ExitStatus>),
    /// We end it, with this exit status.
    Abandoned(u8),
    /// It did not do in time what it should.
    Late,
    /// The guest will not do the job.
    Refused(String),
}

impl Conversation {
    /// Answers events until the kernel has ended or has to be ended.
    fn hold(&mut self) -> Outcome {
        loop {
            let event = match self.limit() {
                Some(limit) => self.reported.recv_timeout(limit),
                None => self.reported.recv().map_err(|_| RecvTimeoutError::Disconnected),
            };
            let Ok(event) = event else {
                return Outcome::Late;
            };
            if let Some(outcome) = self.answer(event) {
                return outcome;
            }
        }
    }

    /// How long the next event may take; a running command may take for ever.
    fn limit(&self) -> Option<Duration> {
        match (&self.ending, self.started) {
            (Some(_), _) => Some(POWER_OFF_LIMIT),
            (None, true) => None,
            (None, false) => Some(BOOT_LIMIT),
        }
    }

    fn answer(&mut self, event: Event) -> Option<Outcome> {
        match event {
            Event::Said(ToCaller::Ready) => {
                let job = self.job.take()?;
                self.machine.say(&ToGuest::Start(job));
            }
            Event::Said(ToCaller::Started) => self.begin_input(),
            Event::Said(ToCaller::Refused(why)) => return Some(Outcome::Refused(why)),
            Event::Said(ToCaller::Ended(ending)) => {
                self.ending = Some(ending);
                self.machine.say(&ToGuest::Farewell);
            }
            Event::InputEnded(bytes) => self.machine.say(&ToGuest::InputEnd(bytes)),
            Event::Unread(line) => self.machine.say(&ToGuest::Unread(line as u8)),
            Event::Signal(SIGWINCH) => {
                if let Some(window) = self.terminal.as_ref().map(Terminal::window) {
                    self.machine.say(&ToGuest::Resize(window));
                }
            }
            Event::Signal(number) if self.started => self.machine.say(&ToGuest::Signal(number)),
            Event::Signal(number) => {
                return Some(Outcome::Abandoned(shell_status(None, Some(number))));
            }
            Event::Orphaned => return Some(Outcome::Abandoned(shell_status(None, Some(SIGHUP)))),
            Event::PoweredOff(status) => return Some(Outcome::PoweredOff(status)),
        }
        None
    }

    /// The command runs: the keys and bytes of the caller are its own now.
    fn begin_input(&mut self) {
        self.started = true;
        if let Some(terminal) = &mut self.terminal {
            // One that cannot be changed is used as it is.
            let _ = terminal.make_raw();
        }
        if let Ok(to_guest) = self.machine.lines[OUTPUT].try_clone() {
            let report = self.events.clone();
            thread::spawn(move || carry_input(to_guest, &report));
        }
    }

    /// Makes sure that the kernel is gone and says how it went.
    fn conclude(mut self, outcome: Outcome) -> Result<Ended, KernelError> {
        let status = match outcome {
            Outcome::PoweredOff(status) => status,
            // The keeper sees us end, and gives the guest time to write back its files.
            Outcome::Abandoned(status) if self.started => {
                return Ok(Ended { status, notes: Vec::new() });
            }
            Outcome::Abandoned(_) | Outcome::Late | Outcome::Refused(_) => {
                self.machine.kill();
                self.wait_for_end()
            }
        };
        // Gone already unless somebody killed the keeper.
        let _ = fs::remove_dir_all(&self.machine.scratch);
        match (outcome, self.ending.take()) {
            (Outcome::Abandoned(status), _) => Ok(Ended { status, notes: Vec::new() }),
            (Outcome::Refused(why), _) => Err(KernelError::Refused(why)),
            (_, Some(ending)) => Ok(self.everything_carried(&ending)),
            (_, None) => Err(self.failure(status)),
        }
    }

    fn wait_for_end(&self) -> Option<ExitStatus> {
        while let Ok(event) = self.reported.recv_timeout(POWER_OFF_LIMIT) {
            if let Event::PoweredOff(status) = event {
                return status;
            }
        }
        None
    }

    /// The command's own end, after the last byte of its output.
    fn everything_carried(self, ending: &Ending) -> Ended {
        let mut notes = Vec::new();
        for (line, carrier) in self.machine.carriers {
            let carried = carrier.join().unwrap_or(0);
            let sent = ending.sent[line];
            if carried < sent {
                notes.push(format!(
                    "{} of {sent} bytes of standard {} were lost on the way out of the kernel",
                    sent - carried,
                    if line == OUTPUT { "output" } else { "error" }
                ));
            }
        }
        if ending.killed_for_memory > 0 {
            notes.push(format!(
                "the kernel ran out of memory and killed {} process(es); give it more with \
                 --memory-mb",
                ending.killed_for_memory
            ));
        }
        notes.extend(ending.unwritten.as_ref().map(|why| {
            format!("not all files could be written to the host: {why}; is the disk full?")
        }));
        Ended { status: ending.status, notes }
    }

    /// Why there is no end of the command: before it began, or in the middle.
    fn failure(self, status: Option<ExitStatus>) -> KernelError {
        let status = status.map_or_else(|| "did not end".into(), |status| status.to_string());
        let console = self
            .machine
            .console
            .lock()
            .map_or_else(|_| String::new(), |console| console.to_string());
        if self.started {
            KernelError::Died { status, console }
        } else {
            KernelError::Boot { status, console }
        }
    }
}

/// The last lines of the kernel's console.
#[derive(Debug, Default)]
struct Console(VecDeque<String>);

impl Console {
    /// Reads the console until it is closed.
    fn collect(console: PipeReader) -> Arc<Mutex<Self>> {
        let collected = Arc::new(Mutex::new(Self::default()));
        let shared = Arc::clone(&collected);
        thread::spawn(move || {
            for line in BufReader::new(console).split(b'\n').map_while(Result::ok) {
                let Ok(mut console) = shared.lock() else {
                    return;
                };
                console.add(&String::from_utf8_lossy(&line));
            }
        });
        collected
    }

    fn add(&mut self, line: &str) {
        let line = line.trim_end();
        if !line.is_empty() {
            self.0.push_back(line.into());
            self.0.drain(..self.0.len().saturating_sub(CONSOLE_LINES));
        }
    }
}

impl std::fmt::Display for Console {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // A panic says why in its first line and then goes on at length.
        let panic = self.0.iter().rposition(|line| line.contains("Kernel panic"));
        let first = panic.unwrap_or_else(|| self.0.len().saturating_sub(CONSOLE_LINES_SHOWN));
        for line in self.0.iter().skip(first).take(CONSOLE_LINES_SHOWN) {
            write!(f, "\n  {line}")?;
        }
        Ok(())
    }
}

/// Reports the signals that are the command's business, except those the caller has us ignore.
fn watch_signals(events: &Sender<Event>) -> io::Result<()> {
    let ignored = ignored_signals();
    let heeded = FORWARDED.into_iter().filter(|number| ignored >> (number - 1) & 1 == 0);
    let mut signals = Signals::new(heeded.chain([SIGWINCH]))?;
    let report = events.clone();
    thread::spawn(move || {
        for number in signals.forever() {
            if report.send(Event::Signal(number)).is_err() {
                return;
            }
        }
    });
    Ok(())
}

/// Reports the end of the process that started us: nobody waits for the command any more. With
/// SIGHUP ignored, as by nohup(1), that is meant to be so.
fn watch_parent(events: &Sender<Event>) -> io::Result<()> {
    let wanted = ignored_signals() >> (SIGHUP - 1) & 1 == 1;
    let Some(parent) = getppid().filter(|_| !wanted) else {
        return Ok(());
    };
    let watched = pidfd_open(parent, PidfdFlags::empty())?;
    let report = events.clone();
    thread::spawn(move || {
        // It is orphaned too when the parent ended before we could watch it.
        let alive = getppid() == Some(parent);
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
fn status_field(name: &str) -> Option<String> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let value = status.lines().find_map(|line| line.strip_prefix(name))?;
    Some(value.trim().to_owned())
}

/// Carries standard input to the guest until it ends.
fn carry_input(mut to_guest: UnixStream, events: &Sender<Event>) {
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
fn carry_output(line: usize, mut from_guest: UnixStream, events: &Sender<Event>) -> u64 {
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

fn wait_readable(file: impl AsFd) -> rustix::io::Result<()> {
    loop {
        match poll(&mut [PollFd::new(&file, PollFlags::IN)], None) {
            Err(Errno::INTR) => {}
            outcome => return outcome.map(|_| ()),
        }
    }
}

fn doing(step: &'static str) -> impl Fn(io::Error) -> KernelError {
    move |error| KernelError::Os { step, error }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_console_is_quoted_from_the_panic_on_and_never_at_length() {
        let mut console = Console::default();
        for number in 0..1000 {
            console.add(&format!("line {number}"));
        }
        assert!(console.to_string().ends_with("line 999"));
        assert_eq!(console.to_string().lines().count(), 1 + CONSOLE_LINES_SHOWN);
        console.add("Kernel panic - not syncing: No working init found.");
        for _ in 0..20 {
            console.add("Call Trace:");
            console.add("");
        }
        assert!(console.to_string().starts_with("\n  Kernel panic"), "{console}");
        assert_eq!(console.to_string().lines().count(), 1 + CONSOLE_LINES_SHOWN);
    }

    #[test]
    fn the_mask_and_the_ignored_signals_are_read_from_the_kernels_account() {
        assert!(current_umask() <= 0o777);
        assert_eq!(ignored_signals() >> (libc::SIGKILL - 1) & 1, 0);
        assert_eq!(status_field("NoSuchField:"), None);
    }
}
