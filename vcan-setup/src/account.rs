//! What the kernel knows about one thread: CPU time, time without a CPU, page faults, switches.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

use crate::scheduler;

/// Bytes of `/proc/thread-self/schedstat`: three numbers of at most twenty digits.
const SCHEDSTAT_BYTES: usize = 64;

/// An open account of the thread that opened it.
///
/// Reading it takes two system calls and a clock, about two microseconds, and allocates nothing.
#[derive(Debug)]
pub struct ThreadAccount {
    /// The thread's schedstat; none on a kernel without scheduler statistics.
    schedstat: Option<File>,
}

/// Totals of a thread since it began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ThreadUsage {
    /// CPU time \[ns\].
    pub cpu_ns: u64,
    /// Time spent runnable but without a CPU \[ns\]; 0 on a kernel that does not tell.
    pub run_delay_ns: u64,
    /// Page faults served without I/O.
    pub minor_faults: u64,
    /// Page faults that read from a disk.
    pub major_faults: u64,
    /// Times the thread waited for something.
    pub voluntary_switches: u64,
    /// Times the CPU was taken from it.
    pub involuntary_switches: u64,
}

impl ThreadAccount {
    /// Opens the account of the calling thread.
    #[must_use]
    pub fn open() -> Self {
        Self { schedstat: File::open("/proc/thread-self/schedstat").ok() }
    }

    /// The totals. Must be called by the thread that opened the account.
    ///
    /// # Errors
    /// When the kernel does not tell.
    pub fn read(&self) -> io::Result<ThreadUsage> {
        let usage = scheduler::thread_usage()?;
        Ok(ThreadUsage { run_delay_ns: self.run_delay_ns().unwrap_or(0), ..usage })
    }

    /// Second number of the schedstat (Documentation/scheduler/sched-stats.rst).
    fn run_delay_ns(&self) -> Option<u64> {
        let mut bytes = [0; SCHEDSTAT_BYTES];
        let length = self.schedstat.as_ref()?.read_at(&mut bytes, 0).ok()?;
        let text = std::str::from_utf8(&bytes[..length]).ok()?;
        text.split_ascii_whitespace().nth(1)?.parse().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn computing_costs_cpu_time_and_touching_new_memory_costs_faults() {
        let account = ThreadAccount::open();
        let before = account.read().expect("Linux tells");
        let pages = vec![1_u8; 64 << 20];
        let sum: u64 = pages.iter().step_by(4096).map(|byte| u64::from(*byte)).sum();
        let after = account.read().expect("Linux tells");
        assert_eq!(sum, (64 << 20) / 4096);
        assert!(after.cpu_ns > before.cpu_ns);
        assert!(after.minor_faults > before.minor_faults, "large pages or small, there are some");
    }

    #[test]
    fn waiting_is_a_voluntary_switch() {
        let account = ThreadAccount::open();
        let before = account.read().expect("Linux tells");
        std::thread::sleep(std::time::Duration::from_millis(2));
        let after = account.read().expect("Linux tells");
        assert!(after.voluntary_switches > before.voluntary_switches);
    }
}
