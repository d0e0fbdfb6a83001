//! Real-time privileges: ask for all of them, live with what comes, report what that was.
//!
//! A laptop seldom grants everything, and a rehearsal must run all the same, so [`acquire`] never
//! fails. Nor does it believe a call that returned success: policy, priority, affinity and locked
//! memory are read back from the kernel afterwards, and those values are the ones reported.

use std::fmt;
use std::fs::{self, File};
use std::io::Write;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use crate::scheduler;

mod environment;

pub use environment::{Environment, environment};

/// Bit of CAP_NET_ADMIN in a capability mask (capabilities(7)).
pub(crate) const CAP_NET_ADMIN: u32 = 12;
/// Bit of CAP_IPC_LOCK, which lifts the limit on locked memory.
pub(crate) const CAP_IPC_LOCK: u32 = 14;
/// Bit of CAP_SYS_NICE, which lifts the limit on real-time priority.
pub(crate) const CAP_SYS_NICE: u32 = 23;
/// Smallest memlock limit \[bytes\] under which future mappings may be locked too: below it, an
/// ordinary thread stack or buffer would soon be refused and end the process.
const MEMLOCK_BYTES_MIN: u64 = 1 << 30;
/// Stack \[bytes\] touched ahead of time; a control loop with fixed-size problems stays well below.
const PREFAULT_STACK_BYTES: usize = 256 * 1024;
/// Heap \[bytes\] touched ahead of time and kept mapped.
const PREFAULT_HEAP_BYTES: usize = 8 * 1024 * 1024;
/// A page, or a part of one \[bytes\]: one touch in each is enough.
const PAGE_BYTES: usize = 4096;

/// What the calling thread would like to have. The default asks for nothing.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Request {
    /// SCHED_FIFO at this static priority, 1 to 99; `None` leaves the scheduler alone.
    pub priority: Option<u8>,
    /// CPUs the thread may run on; empty leaves the affinity alone.
    pub cpus: Vec<usize>,
    /// Lock the whole process into memory and fault in stack and heap beforehand.
    pub lock_memory: bool,
    /// Keep the CPUs out of deep idle states while [`Obtained::cpu_latency`] lives.
    pub hold_cpu_latency: bool,
}

/// What the calling thread really has, read back from the kernel.
#[derive(Debug)]
pub struct Obtained {
    /// Scheduling policy of the thread.
    pub policy: Policy,
    /// Static priority of the thread; 0 unless the policy is a real-time one.
    pub priority: u8,
    /// CPUs the thread may run on, ascending.
    pub cpus: Vec<usize>,
    /// Whether all present and future memory of the process is locked.
    pub mlock: bool,
    /// The open latency request; dropping it lets the CPUs idle deeply again.
    pub cpu_latency: Option<CpuLatencyHold>,
    /// Everything asked for and not granted, with the remedy.
    pub refused: Vec<Refusal>,
}

/// Scheduling policy of a thread (sched(7)).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Policy {
    /// SCHED_OTHER, SCHED_BATCH or SCHED_IDLE: the kernel's fair share.
    TimeSharing,
    /// SCHED_FIFO: runs until it sleeps.
    Fifo,
    /// SCHED_RR: as FIFO, in turns with its equals.
    RoundRobin,
    /// SCHED_DEADLINE.
    Deadline,
}

impl Policy {
    /// The kernel's own name of the policy.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::TimeSharing => "SCHED_OTHER",
            Self::Fifo => "SCHED_FIFO",
            Self::RoundRobin => "SCHED_RR",
            Self::Deadline => "SCHED_DEADLINE",
        }
    }
}

impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// One of the things a [`Request`] can ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Privilege {
    /// Real-time scheduling priority.
    Priority,
    /// CPU affinity.
    Cpus,
    /// Locked memory.
    Memory,
    /// Shallow CPU idle states.
    CpuLatency,
}

/// A privilege that was asked for and not granted as asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// What was asked for.
    pub privilege: Privilege,
    /// Why it was refused and what would grant it, one line.
    pub reason: String,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.reason)
    }
}

/// An open `/dev/cpu_dma_latency` holding 0 µs; the kernel honours it until the file is closed
/// (Linux PM QoS interface).
#[derive(Debug)]
pub struct CpuLatencyHold {
    _open: File,
}

/// Asks the kernel for everything in `request` on behalf of the calling thread, then reads back
/// what it has.
///
/// Threads started later do not inherit the real-time policy. Memory locking is for the whole
/// process and lasts until it ends.
pub fn acquire(request: &Request) -> Obtained {
    let mut refused = Vec::new();
    // Memory first: faulting pages in is slow and must not happen at real-time priority.
    if request.lock_memory {
        lock_memory(&mut refused);
    }
    if !request.cpus.is_empty() {
        pin(&request.cpus, &mut refused);
    }
    let cpu_latency = if request.hold_cpu_latency { hold_cpu_latency(&mut refused) } else { None };
    if let Some(priority) = request.priority {
        raise(priority, &mut refused);
    }
    let (policy, priority) = scheduler::current();
    Obtained {
        policy,
        priority,
        cpus: affinity(),
        mlock: request.lock_memory
            && locked_memory_bytes() > 0
            && !refused.iter().any(|refusal| refusal.privilege == Privilege::Memory),
        cpu_latency,
        refused,
    }
}

/// SCHED_FIFO at `priority`, or at the highest priority the limit allows.
fn raise(priority: u8, refused: &mut Vec<Refusal>) {
    let Err(error) = scheduler::set_fifo(priority) else {
        return;
    };
    let limit = getrlimit(Resource::Rtprio).current.map_or(99, |limit| limit.min(99));
    let fallback = u8::try_from(limit).unwrap_or(99).min(priority);
    let granted = fallback > 0 && scheduler::set_fifo(fallback).is_ok();
    let outcome = if granted { format!("runs at {fallback}") } else { "runs without it".into() };
    let reason = format!(
        "SCHED_FIFO {priority}: {error}; {outcome} (real-time priority limit {limit}; allow it \
         with an rtprio line in /etc/security/limits.d, or CAP_SYS_NICE)"
    );
    refused.push(Refusal { privilege: Privilege::Priority, reason });
}

/// Restricts the calling thread to `cpus`.
fn pin(cpus: &[usize], refused: &mut Vec<Refusal>) {
    let mut set = CpuSet::new();
    for &cpu in cpus.iter().filter(|&&cpu| cpu < CpuSet::MAX_CPU) {
        set.set(cpu);
    }
    let error = sched_setaffinity(None, &set).err();
    let granted = affinity();
    if cpus.iter().all(|cpu| granted.contains(cpu)) && error.is_none() {
        return;
    }
    let why = error.map_or_else(|| "not all exist or are allowed".into(), |e| e.to_string());
    let reason = format!("CPUs {cpus:?}: {why}; runs on {granted:?} (see /sys/devices/system/cpu)");
    refused.push(Refusal { privilege: Privilege::Cpus, reason });
}

/// CPUs the calling thread may run on, ascending.
fn affinity() -> Vec<usize> {
    let Ok(set) = sched_getaffinity(None) else {
        return Vec::new();
    };
    (0..CpuSet::MAX_CPU).filter(|&cpu| set.is_set(cpu)).collect()
}

/// Locks present and future memory, then faults in stack and heap.
fn lock_memory(refused: &mut Vec<Refusal>) {
    let limit = getrlimit(Resource::Memlock).current;
    let limited = limit.is_some_and(|bytes| bytes < MEMLOCK_BYTES_MIN);
    if limited && !has_capability(CAP_IPC_LOCK) {
        // Locking future mappings under a small limit would make a later allocation fail.
        let kib = limit.unwrap_or(0) / 1024;
        let reason = format!(
            "locked memory: the limit is {kib} KiB; runs unlocked (allow it with \
             `ulimit -l unlimited`, a memlock line in /etc/security/limits.d, or CAP_IPC_LOCK)"
        );
        refused.push(Refusal { privilege: Privilege::Memory, reason });
    } else if let Err(error) = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE) {
        let reason =
            format!("locked memory: {error}; runs unlocked (free memory, or CAP_IPC_LOCK)");
        refused.push(Refusal { privilege: Privilege::Memory, reason });
    }
    scheduler::keep_heap_mapped();
    prefault_heap();
    prefault_stack();
}

/// Touches heap that stays mapped after it is freed.
fn prefault_heap() {
    let mut heap = Vec::<u8>::with_capacity(PREFAULT_HEAP_BYTES);
    heap.resize(PREFAULT_HEAP_BYTES, 1);
    std::hint::black_box(&mut heap);
}

/// Touches the stack below this frame, one write a page.
#[inline(never)]
fn prefault_stack() {
    let mut stack = [0_u8; PREFAULT_STACK_BYTES];
    for byte in stack.iter_mut().step_by(PAGE_BYTES) {
        *byte = 1;
    }
    std::hint::black_box(&mut stack);
}

/// Opens `/dev/cpu_dma_latency` with a request for 0 µs.
fn hold_cpu_latency(refused: &mut Vec<Refusal>) -> Option<CpuLatencyHold> {
    let path = "/dev/cpu_dma_latency";
    let hold = || -> std::io::Result<File> {
        let mut file = File::options().write(true).open(path)?;
        file.write_all(&0_i32.to_ne_bytes())?;
        Ok(file)
    };
    match hold() {
        Ok(open) => Some(CpuLatencyHold { _open: open }),
        Err(error) => {
            let reason = format!("{path}: {error}; CPUs may idle deeply (open it to this user)");
            refused.push(Refusal { privilege: Privilege::CpuLatency, reason });
            None
        }
    }
}

/// Locked memory of this process \[bytes\], from the kernel's own count.
fn locked_memory_bytes() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = status_field(&status, "VmLck:").and_then(|value| value.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}

/// Whether this process holds the capability of bit `bit` right now.
pub(crate) fn has_capability(bit: u32) -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status_field(&status, "CapEff:").and_then(|hex| u64::from_str_radix(hex, 16).ok());
    mask.is_some_and(|mask| mask >> bit & 1 == 1)
}

/// First word after `key` in the text of /proc/self/status.
fn status_field<'a>(status: &'a str, key: &str) -> Option<&'a str> {
    status.lines().find_map(|line| line.strip_prefix(key))?.split_whitespace().next()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs `body` on a thread of its own, so that no privilege leaks into the other tests.
    fn on_own_thread<T: Send>(body: impl FnOnce() -> T + Send) -> T {
        std::thread::scope(|scope| scope.spawn(body).join().expect("the body does not panic"))
    }

    #[test]
    fn asking_for_nothing_changes_nothing() {
        let obtained = on_own_thread(|| {
            let cpus_before = affinity();
            let obtained = acquire(&Request::default());
            assert_eq!(obtained.cpus, cpus_before);
            obtained
        });
        assert!(obtained.refused.is_empty());
        assert!(obtained.cpu_latency.is_none());
        assert!(!obtained.mlock);
    }

    #[test]
    fn a_priority_is_either_held_or_refused_with_a_remedy() {
        let obtained =
            on_own_thread(|| acquire(&Request { priority: Some(2), ..Request::default() }));
        if obtained.policy == Policy::Fifo && obtained.priority == 2 {
            assert!(obtained.refused.is_empty());
        } else {
            assert_eq!(obtained.refused[0].privilege, Privilege::Priority);
            assert!(obtained.refused[0].to_string().contains("limits.d"));
        }
    }

    #[test]
    fn an_impossible_priority_is_refused_and_never_reported_as_held() {
        let obtained =
            on_own_thread(|| acquire(&Request { priority: Some(200), ..Request::default() }));
        assert!(obtained.priority <= 99);
        assert_eq!(obtained.refused[0].privilege, Privilege::Priority);
    }

    #[test]
    fn a_thread_started_from_a_real_time_thread_is_an_ordinary_one() {
        let child = on_own_thread(|| {
            acquire(&Request { priority: Some(3), ..Request::default() });
            on_own_thread(scheduler::current)
        });
        assert_eq!(child, (Policy::TimeSharing, 0));
    }

    #[test]
    fn the_affinity_reported_is_the_affinity_set() {
        let cpu = affinity()[0];
        let request = Request { cpus: vec![cpu], ..Request::default() };
        let obtained = on_own_thread(|| acquire(&request));
        assert_eq!(obtained.cpus, [cpu]);
        assert!(obtained.refused.is_empty());
    }

    #[test]
    fn cpus_that_do_not_exist_are_refused() {
        for cpus in [vec![CpuSet::MAX_CPU + 7], vec![0, CpuSet::MAX_CPU - 1]] {
            let request = Request { cpus, ..Request::default() };
            let obtained = on_own_thread(|| acquire(&request));
            assert_eq!(obtained.refused[0].privilege, Privilege::Cpus);
            assert!(!obtained.cpus.is_empty());
        }
    }

    #[test]
    fn memory_is_locked_exactly_when_it_is_not_refused() {
        let request = Request { lock_memory: true, hold_cpu_latency: true, ..Request::default() };
        let obtained = on_own_thread(|| acquire(&request));
        let refused = |privilege| obtained.refused.iter().any(|r| r.privilege == privilege);
        assert_eq!(obtained.mlock, !refused(Privilege::Memory));
        assert_eq!(obtained.cpu_latency.is_some(), !refused(Privilege::CpuLatency));
    }

    #[test]
    fn a_status_field_is_found_by_its_whole_key() {
        let status = "VmLckX:\t 7 kB\nVmLck:\t    12 kB\nCapEff:\t0000000000001000\n";
        assert_eq!(status_field(status, "VmLck:"), Some("12"));
        assert_eq!(status_field(status, "CapEff:"), Some("0000000000001000"));
        assert_eq!(status_field(status, "VmPin:"), None);
    }
}
