//! A control law that now and then computes for too long, as if it had a data-dependent surprise.

use controller_rt::{Around, Controller};
use law::Observation;
use platoon_dbc::Clock;

use crate::clock::HostClock;
use crate::fault::{Fault, FaultKind};

/// What puts a stall in front of some steps.
struct Stall {
    clock: HostClock,
    from_ns: u64,
    lasts_ns: u64,
    every: u32,
    steps: u32,
}

impl Stall {
    fn befall(&mut self, seen: &Observation) {
        if seen.time_ns < self.from_ns {
            return;
        }
        self.steps += 1;
        if self.steps.is_multiple_of(self.every) {
            self.clock.compute_until_ns(self.clock.now_ns() + self.lasts_ns);
        }
    }
}

/// The law of a truck's ECU with the stalls that befall it.
pub fn stalling(law: Box<dyn Controller>, faults: &[Fault], truck: u8) -> Box<dyn Controller> {
    let nanoseconds = |seconds: f64| (1e9 * seconds) as u64;
    faults.iter().filter(|fault| fault.truck == truck).fold(law, |law, fault| match fault.kind {
        FaultKind::Stall { duration_s, every } => {
            let mut stall = Stall {
                clock: HostClock::default(),
                from_ns: nanoseconds(fault.at_s),
                lasts_ns: nanoseconds(duration_s),
                every,
                steps: 0,
            };
            Box::new(Around::new(law, move |law, seen, mark| {
                stall.befall(seen);
                law.step(seen, mark)
            }))
        }
        FaultKind::KillEcu | FaultKind::PauseEcu { .. } => law,
    })
}
