//! A control law that now and then computes for too long, as if it had a data-dependent surprise.

use controller_rt::Controller;
use law::{Decision, Observation, Phase};
use platoon_dbc::Clock;

use crate::clock::HostClock;
use crate::fault::{Fault, FaultKind};

/// A law with a stall put in front of some of its steps.
struct Stalling {
    law: Box<dyn Controller>,
    clock: HostClock,
    from_ns: u64,
    lasts_ns: u64,
    every: u32,
    steps: u32,
}

/// The law of a truck's ECU with the stalls that befall it.
pub fn stalling(law: Box<dyn Controller>, faults: &[Fault], truck: u8) -> Box<dyn Controller> {
    let nanoseconds = |seconds: f64| (1e9 * seconds) as u64;
    faults.iter().filter(|fault| fault.truck == truck).fold(law, |law, fault| match fault.kind {
        FaultKind::Stall { duration_s, every } => Box::new(Stalling {
            law,
            clock: HostClock::default(),
            from_ns: nanoseconds(fault.at_s),
            lasts_ns: nanoseconds(duration_s),
            every,
            steps: 0,
        }),
        FaultKind::KillEcu | FaultKind::PauseEcu { .. } => law,
    })
}

impl Controller for Stalling {
    fn step(&mut self, seen: &Observation, mark: &mut dyn FnMut(Phase)) -> Decision {
        if seen.time_ns >= self.from_ns {
            self.steps += 1;
            if self.steps.is_multiple_of(self.every) {
                let until_ns = self.clock.now_ns() + self.lasts_ns;
                while self.clock.now_ns() < until_ns {
                    std::hint::spin_loop();
                }
            }
        }
        self.law.step(seen, mark)
    }

    fn note_applied(&mut self, force_n: f64, steering_rad: f64) {
        self.law.note_applied(force_n, steering_rad);
    }

    fn save(&self, out: &mut [u8]) -> Option<usize> {
        self.law.save(out)
    }

    fn restore(&mut self, bytes: &[u8]) -> bool {
        self.law.restore(bytes)
    }
}
