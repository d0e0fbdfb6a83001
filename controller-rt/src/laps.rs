//! One tick's times, phase by phase.

use law::Phase;
use platoon_dbc::Clock;

/// Phases of a tick, its whole among them.
pub const PHASES: usize = 9;

/// Durations of one tick \[ns\]. A phase that did not take place is `None`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PhaseTimes {
    /// From due to awake.
    pub wake_ns: u64,
    /// Asking the witness, draining and decoding.
    pub drain_ns: u64,
    /// Building the observation.
    pub observe_ns: u64,
    /// The law's coordination layer.
    pub ucl_ns: Option<u64>,
    /// The law's motion layer up to the QP.
    pub lml_build_ns: Option<u64>,
    /// Solving the QP.
    pub qp_ns: Option<u64>,
    /// The guard, with what the law does after its last phase.
    pub guard_ns: u64,
    /// Encoding and sending.
    pub send_ns: u64,
    /// From due to everything sent: the tick's response time.
    pub total_ns: u64,
}

impl PhaseTimes {
    /// Phases in the order of the loop, by the names reports use.
    #[must_use]
    pub fn named(&self) -> [(&'static str, Option<u64>); PHASES] {
        [
            ("wake", Some(self.wake_ns)),
            ("drain", Some(self.drain_ns)),
            ("observe", Some(self.observe_ns)),
            ("ucl", self.ucl_ns),
            ("lml_build", self.lml_build_ns),
            ("qp", self.qp_ns),
            ("guard", Some(self.guard_ns)),
            ("send", Some(self.send_ns)),
            ("total", Some(self.total_ns)),
        ]
    }
}

/// Reads the clock at the end of each phase.
pub struct Laps<'clock> {
    clock: &'clock dyn Clock,
    due_ns: u64,
    last_ns: u64,
    times: PhaseTimes,
}

impl<'clock> Laps<'clock> {
    /// Starts now, for a tick that was due at `due_ns` on the clock.
    pub fn start(clock: &'clock dyn Clock, due_ns: u64) -> Self {
        let last_ns = clock.now_ns();
        let times = PhaseTimes { wake_ns: last_ns.saturating_sub(due_ns), ..PhaseTimes::default() };
        Self { clock, due_ns, last_ns, times }
    }

    /// The clock reading of the last lap \[ns\].
    #[must_use]
    pub const fn last_ns(&self) -> u64 {
        self.last_ns
    }

    /// Ends draining.
    pub fn drained(&mut self) {
        self.times.drain_ns = self.lap();
    }

    /// Ends observing.
    pub fn observed(&mut self) {
        self.times.observe_ns = self.lap();
    }

    /// Ends one of the law's phases.
    pub fn stepped(&mut self, phase: Phase) {
        let lap_ns = Some(self.lap());
        match phase {
            Phase::Ucl => self.times.ucl_ns = lap_ns,
            Phase::LmlBuild => self.times.lml_build_ns = lap_ns,
            Phase::Qp => self.times.qp_ns = lap_ns,
        }
    }

    /// Ends guarding.
    pub fn guarded(&mut self) {
        self.times.guard_ns = self.lap();
    }

    /// Ends sending, and with it what has a deadline; all its times.
    pub fn sent(&mut self) -> PhaseTimes {
        self.times.send_ns = self.lap();
        self.times.total_ns = self.last_ns.saturating_sub(self.due_ns);
        self.times
    }

    /// The clock reading when the finished tick has been handed to the recorder \[ns\].
    pub fn recorded(&mut self) -> u64 {
        self.lap();
        self.last_ns
    }

    fn lap(&mut self) -> u64 {
        let now_ns = self.clock.now_ns();
        let lap_ns = now_ns.saturating_sub(self.last_ns);
        self.last_ns = now_ns;
        lap_ns
    }
}
