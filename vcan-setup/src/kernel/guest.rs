//! The first process of the booted kernel: makes it a place where the command can run, runs it,
//! carries its streams, and powers off.
//!
//! It is this very program, found on the host's own files, which are the guest's root. It loads
//! modules and mounts file systems by system calls, so the host needs no kmod, no iproute2 and no
//! shell for it.

mod modules;
mod streams;

use std::ffi::OsStr;
use std::fs::{self, File, Permissions};
use std::io::{self, Write};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use rustix::fs::{Mode, OFlags};
use rustix::mount::{MountFlags, UnmountFlags, mount, mount_bind_recursive, unmount};
use rustix::process::{Pid, Signal, WaitOptions, kill_process_group, umask, wait};
use rustix::system::{RebootCommand, finit_module, reboot, sethostname};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use socketcan::CanInterface;

use super::keeper;
use super::wire::{self, ERRORS, Ending, Job, LINES, MESSAGES, ToCaller, ToGuest};
use crate::{can, scheduler};
use streams::Streams;

pub use streams::become_on_terminal;

/// Index of the loopback interface in every network namespace.
const LOOPBACK_INDEX: u32 = 1;
/// MODULE_INIT_COMPRESSED_FILE of linux/module.h.
const COMPRESSED_FILE: i32 = 4;
/// Frames that may wait for ksoftirqd: those of seconds.
const BACKLOG: u32 = 100_000;
/// Highest priority of SCHED_FIFO.
const PRIORITY_MAX: u8 = 99;
/// Time between two looks at whether what outlives the command has ended.
const LOOK: Duration = Duration::from_millis(10);
/// Looks between SIGTERM and SIGKILL.
const GRACE_LOOKS: u32 = 200;
/// Exit status of a shell for a command that does not exist, and for one that cannot be run.
const NOT_FOUND: u8 = 127;
const NOT_EXECUTABLE: u8 = 126;
/// How long the caller may take to say farewell.
const FAREWELL: Duration = Duration::from_secs(30);

/// Is the first process of a booted kernel until that powers off. In any other place it does
/// nothing.
///
/// # Errors
/// Always: why it could not be that, or could not power off.
pub fn guest() -> io::Error {
    if rustix::process::getpid() != Pid::INIT {
        return io::Error::other("this is for the first process of a booted kernel");
    }
    if let Err(error) = mount_kernel_folders().and_then(|()| serve()) {
        // The console is the caller's, who shows its last lines.
        eprintln!("guest: {error}");
    }
    rustix::fs::sync();
    match reboot(RebootCommand::PowerOff) {
        Ok(()) => io::Error::other("the kernel did not power off"),
        Err(error) => error.into(),
    }
}

/// Mounts what the kernel has to say; makes sure before that this is the kernel meant.
fn mount_kernel_folders() -> io::Result<()> {
    attach("proc", "/proc", "")?;
    let cpu = fs::read_to_string("/proc/cpuinfo")?;
    if !cpu.contains("User Mode Linux") {
        return Err(io::Error::other("this kernel is not user-mode Linux"));
    }
    attach("sysfs", "/sys", "")
}

/// Speaks with the caller and does what it wants.
fn serve() -> io::Result<()> {
    let lines = open_lines()?;
    let mut caller = lines[MESSAGES].try_clone()?;
    wire::send(&mut caller, &ToCaller::Ready)?;
    let Some(ToGuest::Start(job)) = wire::receive(&mut &lines[MESSAGES])? else {
        return Err(io::Error::other("the caller did not say what to do"));
    };
    match prepare(&job).and_then(|()| run(&job, lines)) {
        Ok(end) => report(&mut caller, &end),
        Err(error) => wire::send(&mut caller, &ToCaller::Refused(error.to_string())),
    }
}

/// The serial lines to the caller, fit for any byte.
fn open_lines() -> io::Result<[File; LINES]> {
    let mut lines = Vec::new();
    for number in 0..LINES {
        let path = format!("/dev/ttyS{number}");
        let line = File::options().read(true).write(true).open(&path).map_err(naming(&path))?;
        let mut settings = tcgetattr(&line)?;
        settings.make_raw();
        tcsetattr(&line, OptionalActions::Flush, &settings)?;
        lines.push(line);
    }
    Ok(lines.try_into().expect("one for each number"))
}

/// Makes the booted kernel a place where the command can run.
fn prepare(job: &Job) -> io::Result<()> {
    mount_private_folders(job)?;
    sethostname(job.host.as_encoded_bytes())?;
    for file in job.modules.iter().flat_map(|folder| modules::load_order(Path::new(folder))) {
        for module in file {
            load(&module).map_err(naming(&module.display().to_string()))?;
        }
    }
    lose_no_frames()?;
    CanInterface::open_iface(LOOPBACK_INDEX).bring_up().map_err(io::Error::other)?;
    let names: Vec<&str> = job.interfaces.iter().map(String::as_str).collect();
    can::ensure_vcan(&names).map_err(io::Error::other)?;
    Ok(())
}

/// Makes the kernel hand frames over before any process runs, however busy real-time ones keep it.
///
/// A frame sent on a `vcan` waits in the processor's backlog for ksoftirqd, an ordinary thread.
/// While processes under SCHED_FIFO use all the time there is, and this kernel is slow, it does not
/// run, and the backlog drops what is more than its limit (net.core.netdev_max_backlog, 1000).
fn lose_no_frames() -> io::Result<()> {
    fs::write("/proc/sys/net/core/netdev_max_backlog", BACKLOG.to_string())?;
    for process in fs::read_dir("/proc")?.flatten() {
        let name = fs::read_to_string(process.path().join("comm")).unwrap_or_default();
        let number = process.file_name().to_str().and_then(|number| number.parse().ok());
        if let Some(number) = number.filter(|_| name.starts_with("ksoftirqd/")) {
            scheduler::set_fifo_of(number, PRIORITY_MAX)?;
        }
    }
    Ok(())
}

/// Loads one module unless it is there already.
fn load(file: &Path) -> io::Result<()> {
    let module = File::open(file)?;
    let is_plain = file.extension() == Some(OsStr::new("ko"));
    match finit_module(&module, c"", if is_plain { 0 } else { COMPRESSED_FILE }) {
        Ok(()) | Err(rustix::io::Errno::EXIST) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// Mounts what belongs to this kernel and not to the host's: terminals, shared memory, run-time
/// state. Folders below them that the command uses stay visible.
fn mount_private_folders(job: &Job) -> io::Result<()> {
    let kept = folders_in_use(job);
    // The kernel has put its own /dev over the host's already.
    unmount("/dev", UnmountFlags::DETACH)?;
    let keep = |path: &PathBuf| rustix::fs::open(path, OFlags::PATH, Mode::empty()).ok();
    let kept: Vec<_> = kept.into_iter().filter_map(|path| Some((keep(&path)?, path))).collect();
    attach("devtmpfs", "/dev", "mode=0755")?;
    for (folder, options) in [("/dev/pts", "ptmxmode=0666,mode=0620"), ("/dev/shm", "mode=1777")] {
        fs::create_dir_all(folder)?;
        let kind = if folder == "/dev/pts" { "devpts" } else { "tmpfs" };
        attach(kind, folder, options)?;
    }
    if Path::new("/run").is_dir() {
        attach("tmpfs", "/run", "mode=0755")?;
        fs::create_dir_all("/run/lock")?;
        fs::set_permissions("/run/lock", Permissions::from_mode(0o1777))?;
    }
    for (name, target) in [("fd", ""), ("stdin", "/0"), ("stdout", "/1"), ("stderr", "/2")] {
        // Some kernels' device folder has them already.
        let _ = symlink(format!("/proc/self/fd{target}"), format!("/dev/{name}"));
    }
    for (folder, path) in kept {
        restore(&folder, &path)?;
    }
    let runtime = job.environment.iter().find(|(name, _)| name == "XDG_RUNTIME_DIR");
    if let Some((_, folder)) = runtime.filter(|(_, folder)| !Path::new(folder).exists()) {
        // Only a folder in our own /run can be made here; any other is the command's business.
        if Path::new(folder).starts_with("/run") && fs::create_dir_all(folder).is_ok() {
            fs::set_permissions(folder, Permissions::from_mode(0o700))?;
        }
    }
    Ok(())
}

/// The folders below /run and /dev/shm that the command runs in, or looks for programs in.
fn folders_in_use(job: &Job) -> Vec<PathBuf> {
    let path = job.environment.iter().find(|(name, _)| name == "PATH");
    let programs = path.iter().flat_map(|(_, folders)| std::env::split_paths(folders));
    let program = job.command.first().and_then(|name| Path::new(name).parent()).map(Into::into);
    let hidden =
        |path: &PathBuf| ["/run", "/var/run", "/dev/shm"].iter().any(|at| path.starts_with(at));
    [PathBuf::from(&job.folder)].into_iter().chain(programs).chain(program).filter(hidden).collect()
}

/// Makes a folder visible again that a mount has hidden.
fn restore(folder: &OwnedFd, path: &Path) -> io::Result<()> {
    fs::create_dir_all(path)?;
    let source = format!("/proc/self/fd/{}", folder.as_raw_fd());
    mount_bind_recursive(source, path).map_err(io::Error::from).map_err(naming("bind mount"))
}

/// Mounts a file system that has no device.
fn attach(kind: &str, folder: &str, options: &str) -> io::Result<()> {
    let options = std::ffi::CString::new(options)?;
    mount(kind, folder, kind, MountFlags::NOSUID, options.as_c_str())
        .map_err(io::Error::from)
        .map_err(naming(folder))
}

/// How the command and everything it started ended.
struct End {
    status: u8,
    sent: [u64; LINES],
    farewell: mpsc::Receiver<()>,
}

/// Runs the command to its end, and ends whatever it leaves running.
fn run(job: &Job, lines: [File; LINES]) -> io::Result<End> {
    umask(Mode::from_raw_mode(job.umask));
    let (mut command, streams) = Streams::connect(job)?;
    let spawned = command.spawn();
    // The streams end when the last copy of the command's ends of them is closed.
    drop(command);
    let mut messages = lines[MESSAGES].try_clone()?;
    let (child, status) = match spawned {
        Ok(child) => (Pid::from_raw(child.id().cast_signed()), None),
        Err(error) => (None, Some(not_run(job, &error, &lines[ERRORS])?)),
    };
    wire::send(&mut messages, &ToCaller::Started)?;
    let (say_farewell, farewell) = mpsc::channel();
    let (control, outputs) = streams.start(lines, child)?;
    thread::spawn(move || {
        while let Ok(Some(message)) = wire::receive(&mut messages) {
            if message == ToGuest::Farewell {
                // Nobody waits for it any more when the time for it has passed.
                let _ = say_farewell.send(());
            } else {
                control.obey(&message);
            }
        }
        // Without its caller the command has no reason to go on.
        let _ = kill_process_group(Pid::INIT, Signal::KILL);
    });
    let status = match (child, status) {
        (Some(child), _) => wait_for_command(child)?,
        (None, status) => status.expect("one or the other"),
    };
    end_the_others();
    Ok(End { status, sent: outputs.join(), farewell })
}

/// Says why the command did not start; the exit status by which a shell says it too.
fn not_run(job: &Job, error: &io::Error, mut errors: &File) -> io::Result<u8> {
    let name = job.command.first().map_or_else(Default::default, |name| name.to_string_lossy());
    writeln!(errors, "platoon: {name}: {error}")?;
    Ok(if error.kind() == io::ErrorKind::NotFound { NOT_FOUND } else { NOT_EXECUTABLE })
}

/// Waits for the command, and on the way for every orphan: they are the first process's.
fn wait_for_command(command: Pid) -> io::Result<u8> {
    loop {
        match wait(WaitOptions::empty()) {
            Ok(Some((pid, status))) if pid == command => {
                return Ok(keeper::shell_status(status.exit_status(), status.terminating_signal()));
            }
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
}

/// Ends what the command left running: politely first, so that it can close its files.
fn end_the_others() {
    for (signal, looks) in [(Signal::TERM, GRACE_LOOKS), (Signal::KILL, u32::MAX)] {
        // There may be nobody.
        let _ = kill_process_group(Pid::INIT, signal);
        for _ in 0..looks {
            match wait(WaitOptions::NOHANG) {
                Err(rustix::io::Errno::CHILD) => return,
                Ok(Some(_)) => {}
                Ok(None) | Err(_) => thread::sleep(LOOK),
            }
        }
    }
}

/// Tells the caller how it ended and waits until that has everything.
fn report(caller: &mut File, end: &End) -> io::Result<()> {
    let unwritten = write_back().err().map(|error| error.to_string());
    let ending = Ending {
        status: end.status,
        sent: end.sent,
        killed_for_memory: killed_for_memory(),
        unwritten,
    };
    wire::send(caller, &ToCaller::Ended(ending))?;
    // A caller that does not answer is gone, and the end is the same.
    let _ = end.farewell.recv_timeout(FAREWELL);
    Ok(())
}

/// Writes what the command left in files to the host.
fn write_back() -> io::Result<()> {
    let root = File::open("/")?;
    rustix::fs::syncfs(&root)?;
    Ok(())
}

/// Processes the kernel has killed for want of memory.
fn killed_for_memory() -> u64 {
    let text = fs::read_to_string("/proc/vmstat").unwrap_or_default();
    let count = text.lines().find_map(|line| line.strip_prefix("oom_kill "));
    count.and_then(|count| count.trim().parse().ok()).unwrap_or(0)
}

/// Puts the name of what an error is about before it.
fn naming(what: &str) -> impl Fn(io::Error) -> io::Error {
    let what = what.to_owned();
    move |error| io::Error::new(error.kind(), format!("{what}: {error}"))
}
