//! What the operating system can say about the thread that runs the loop.
//!
//! The crate asks nobody itself: whoever runs an [`Ecu`](crate::Ecu) hands it a witness, as it
//! hands it a clock. In virtual time there is nobody to ask.

/// Totals of one thread since it began. What the system does not tell stays 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ThreadTotals {
    /// CPU time used \[ns\].
    pub cpu_ns: u64,
    /// Time spent runnable but without a CPU \[ns\].
    pub run_delay_ns: u64,
    /// Page faults served without I/O.
    pub minor_faults: u64,
    /// Page faults that read from a disk.
    pub major_faults: u64,
    /// Times the thread waited for something.
    pub voluntary_switches: u64,
    /// Times the CPU was taken from it.
    pub involuntary_switches: u64,
    /// Times it asked the heap for memory or gave some back.
    pub heap_uses: u64,
}

impl ThreadTotals {
    /// Nothing at all.
    pub const NOTHING: Self = Self {
        cpu_ns: 0,
        run_delay_ns: 0,
        minor_faults: 0,
        major_faults: 0,
        voluntary_switches: 0,
        involuntary_switches: 0,
        heap_uses: 0,
    };

    /// What was added since `earlier`.
    #[must_use]
    pub const fn since(&self, earlier: &Self) -> Self {
        Self {
            cpu_ns: self.cpu_ns.saturating_sub(earlier.cpu_ns),
            run_delay_ns: self.run_delay_ns.saturating_sub(earlier.run_delay_ns),
            minor_faults: self.minor_faults.saturating_sub(earlier.minor_faults),
            major_faults: self.major_faults.saturating_sub(earlier.major_faults),
            voluntary_switches: self.voluntary_switches.saturating_sub(earlier.voluntary_switches),
            involuntary_switches: self
                .involuntary_switches
                .saturating_sub(earlier.involuntary_switches),
            heap_uses: self.heap_uses.saturating_sub(earlier.heap_uses),
        }
    }
}

/// Who can be asked about the thread of the loop. Nothing here may allocate, block or panic.
pub trait Witness: Send {
    /// Totals of the calling thread, or `None` when they are not known. Asked twice a tick.
    fn thread(&self) -> Option<ThreadTotals>;

    /// For how much of the time from `from_ns` to `to_ns` on the loop's clock the machine stood
    /// still, as far as a sentinel beside the loop noticed \[ns\]. Asked only about misses.
    fn standstill_ns(&self, from_ns: u64, to_ns: u64) -> u64;
}

/// The witness where there is none.
#[derive(Debug, Clone, Copy, Default)]
pub struct Nobody;

impl Witness for Nobody {
    fn thread(&self) -> Option<ThreadTotals> {
        None
    }

    fn standstill_ns(&self, _from_ns: u64, _to_ns: u64) -> u64 {
        0
    }
}
