//! The caller's side: starts the keeper and through it the kernel, hands the guest its job, carries
//! streams and signals both ways, and learns how it ended.

mod carriers;
mod console;
mod machine;
mod memory;
mod terminal;
mod watch;

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::PathBuf;
use std::process::ExitStatus;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGHUP, SIGWINCH};

use super::keeper::shell_status;
use super::wire::{Ending, Job, OUTPUT, ToCaller, ToGuest};
use super::{Ended, Kernel, KernelError, Program, Task};
use carriers::carry_input;
use machine::Machine;
use terminal::Terminal;
use watch::status_field;

/// How long the kernel may take from its start to the guest's first word.
const BOOT_LIMIT: Duration = Duration::from_secs(120);
/// How long the kernel may take to power off.
const POWER_OFF_LIMIT: Duration = Duration::from_secs(20);

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
    watch::signals(&events).map_err(doing("catch signals"))?;
    watch::parent(&events).map_err(doing("watch the calling process"))?;
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

fn doing(step: &'static str) -> impl Fn(io::Error) -> KernelError {
    move |error| KernelError::Os { step, error }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mask_is_read_without_changing_it() {
        assert!(current_umask() <= 0o777);
        assert_eq!(current_umask(), current_umask());
    }
}
