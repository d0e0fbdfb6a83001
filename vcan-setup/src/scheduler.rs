//! The scheduling calls no safe crate of ours offers, and nothing else.
//!
//! This is the only file of the crate with `unsafe`: the POSIX scheduler of the calling thread, its
//! use of resources, and glibc's heap tuning.

use std::io;

use rustix::time::{ClockId, clock_gettime};

use crate::account::ThreadUsage;
use crate::realtime::Policy;

/// Puts the calling thread, and no thread or child it starts later, under SCHED_FIFO.
#[expect(unsafe_code, reason = "sched_setscheduler has no safe wrapper")]
pub(crate) fn set_fifo(priority: u8) -> io::Result<()> {
    let param = libc::sched_param { sched_priority: i32::from(priority) };
    // SCHED_RESET_ON_FORK keeps the recorder and other helpers out of the real-time class.
    let policy = libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK;
    // SAFETY: `param` is a valid, initialised sched_param that outlives the call, which only reads
    // it; thread id 0 means the calling thread.
    let status = unsafe { libc::sched_setscheduler(0, policy, &raw const param) };
    if status == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Puts another thread, and those it starts, under SCHED_FIFO.
#[expect(unsafe_code, reason = "sched_setscheduler has no safe wrapper")]
pub(crate) fn set_fifo_of(thread: i32, priority: u8) -> io::Result<()> {
    let param = libc::sched_param { sched_priority: i32::from(priority) };
    // SAFETY: `param` is a valid, initialised sched_param that outlives the call, which only reads
    // it; a thread id that does not exist is an error and nothing else.
    let status = unsafe { libc::sched_setscheduler(thread, libc::SCHED_FIFO, &raw const param) };
    if status == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// The policy and static priority the kernel holds for the calling thread.
#[expect(unsafe_code, reason = "sched_getscheduler and sched_getparam have no safe wrapper")]
pub(crate) fn current() -> (Policy, u8) {
    let mut param = libc::sched_param { sched_priority: 0 };
    // SAFETY: sched_getscheduler takes no pointer; `param` is a valid sched_param that
    // sched_getparam may write, and it outlives the call.
    let (policy, status) =
        unsafe { (libc::sched_getscheduler(0), libc::sched_getparam(0, &raw mut param)) };
    let priority = if status == 0 { param.sched_priority } else { 0 };
    let policy = match policy & !libc::SCHED_RESET_ON_FORK {
        libc::SCHED_FIFO => Policy::Fifo,
        libc::SCHED_RR => Policy::RoundRobin,
        libc::SCHED_DEADLINE => Policy::Deadline,
        _ => Policy::TimeSharing,
    };
    (policy, u8::try_from(priority).unwrap_or(0))
}

/// What the calling thread has used; its time without a CPU is not known here.
#[expect(unsafe_code, reason = "getrusage of one thread has no safe wrapper")]
pub(crate) fn thread_usage() -> io::Result<ThreadUsage> {
    let mut usage = std::mem::MaybeUninit::<libc::rusage>::zeroed();
    // SAFETY: `usage` is a rusage that the call may write, and outlives it; all zeros are a valid
    // rusage, so it is initialised whether the call writes it or not.
    let (status, usage) =
        unsafe { (libc::getrusage(libc::RUSAGE_THREAD, usage.as_mut_ptr()), usage.assume_init()) };
    if status != 0 {
        return Err(io::Error::last_os_error());
    }
    let cpu = clock_gettime(ClockId::ThreadCPUTime);
    Ok(ThreadUsage {
        cpu_ns: cpu.tv_sec.unsigned_abs() * 1_000_000_000 + cpu.tv_nsec.unsigned_abs(),
        run_delay_ns: 0,
        minor_faults: usage.ru_minflt.unsigned_abs(),
        major_faults: usage.ru_majflt.unsigned_abs(),
        voluntary_switches: usage.ru_nvcsw.unsigned_abs(),
        involuntary_switches: usage.ru_nivcsw.unsigned_abs(),
    })
}

/// Tells glibc to keep freed heap memory mapped, so that memory once faulted in stays faulted in.
///
/// Without it a large freed block goes back to the kernel and the next one faults again. Other C
/// libraries have no such switch and nothing is done there.
pub(crate) fn keep_heap_mapped() {
    #[cfg(target_env = "gnu")]
    {
        #[expect(unsafe_code, reason = "mallopt has no safe wrapper")]
        // SAFETY: mallopt takes two integers and is safe to call at any time; both parameters are
        // documented in mallopt(3), and a refused value leaves the default in place.
        unsafe {
            libc::mallopt(libc::M_TRIM_THRESHOLD, -1);
            libc::mallopt(libc::M_MMAP_MAX, 0);
        }
    }
}
