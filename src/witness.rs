//! What this machine can say about the thread of a loop.

use std::path::Path;

use controller_rt::{ThreadTotals, Witness};
use vcan_setup::account::{ThreadAccount, ThreadUsage};
use vcan_setup::pauses::PauseReader;

use crate::heap;

/// The kernel's account of a thread, and the pauses that a sentinel noted.
#[derive(Debug)]
pub struct HostWitness {
    account: ThreadAccount,
    pauses: Option<PauseReader>,
    /// CPUs the thread may run on.
    cpus: Vec<usize>,
}

impl HostWitness {
    /// Watches the calling thread, which may run on these CPUs.
    pub fn of_this_thread(cpus: &[usize], pauses: Option<&Path>) -> Self {
        // Without the log there are fewer causes to find.
        let pauses = pauses.and_then(|path| PauseReader::open(path).ok());
        Self { account: ThreadAccount::open(), pauses, cpus: cpus.to_vec() }
    }
}

impl Witness for HostWitness {
    fn thread(&self) -> Option<ThreadTotals> {
        let ThreadUsage {
            cpu_ns,
            run_delay_ns,
            minor_faults,
            major_faults,
            voluntary_switches,
            involuntary_switches,
        } = self.account.read().ok()?;
        Some(ThreadTotals {
            cpu_ns,
            run_delay_ns,
            minor_faults,
            major_faults,
            voluntary_switches,
            involuntary_switches,
            heap_uses: heap::uses(),
        })
    }

    fn standstill_ns(&self, from_ns: u64, to_ns: u64) -> u64 {
        let Some(pauses) = &self.pauses else { return 0 };
        let lost_ns = self.cpus.iter().map(|&cpu| pauses.standstill_ns(cpu, from_ns, to_ns));
        // Where one of them ran on, the thread could have.
        lost_ns.min().unwrap_or(0)
    }
}
