//! Faults a rehearsal puts into its own bench: `KIND@TIME[+DURATION][:key=value,...]`.

use std::fmt;
use std::str::FromStr;

/// Ticks between two stalls when nothing is said.
const STALL_EVERY: u32 = 1000;

/// One fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// What breaks.
    pub kind: FaultKind,
    /// Bench time at which it breaks \[s\].
    pub at_s: f64,
    /// The truck it befalls.
    pub truck: u8,
}

/// Kinds of fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultKind {
    /// The ECU is killed and stays dead.
    KillEcu,
    /// The ECU is stopped for a while, as if its processor hung.
    PauseEcu {
        /// For how long \[s\].
        duration_s: f64,
    },
    /// The ECU's law computes for longer, in one tick of so many. It keeps the CPU meanwhile.
    Stall {
        /// By how much longer \[s\].
        duration_s: f64,
        /// One tick of so many.
        every: u32,
    },
}

impl Fault {
    /// Whether the ECU is out of action at a bench time, and for a pause comes back later.
    pub fn stops(&self, truck: u8, time_s: f64) -> bool {
        let over = match self.kind {
            FaultKind::KillEcu => f64::INFINITY,
            FaultKind::PauseEcu { duration_s } => self.at_s + duration_s,
            FaultKind::Stall { .. } => return false,
        };
        self.truck == truck && (self.at_s..over).contains(&time_s)
    }
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (head, options) = text.split_once(':').unwrap_or((text, ""));
        let (kind, time) = head
            .split_once('@')
            .ok_or_else(|| format!("{text:?} has no time; write kill-ecu@20:truck=2"))?;
        let (at, duration) = match time.split_once('+') {
            Some((at, duration)) => (at, Some(duration)),
            None => (time, None),
        };
        let at_s = seconds(at)?;
        let mut kind = match (kind, duration) {
            ("kill-ecu", None) => FaultKind::KillEcu,
            ("kill-ecu", Some(_)) => return Err("kill-ecu has no duration; leave out +...".into()),
            ("pause-ecu", Some(duration)) => FaultKind::PauseEcu { duration_s: seconds(duration)? },
            ("pause-ecu", None) => {
                return Err("pause-ecu needs a duration: pause-ecu@20+0.5:truck=2".into());
            }
            ("stall", Some(duration)) => {
                FaultKind::Stall { duration_s: seconds(duration)?, every: STALL_EVERY }
            }
            ("stall", None) => {
                return Err("stall needs a duration: stall@5+0.003:truck=2,every=1000".into());
            }
            (other, _) => {
                return Err(format!("no fault {other:?}; there are kill-ecu, pause-ecu, stall"));
            }
        };
        let mut truck = None;
        for option in options.split(',').filter(|option| !option.is_empty()) {
            match option.split_once('=') {
                Some(("truck", n)) => {
                    truck = Some(n.parse().map_err(|_| format!("truck={n} is no truck number"))?);
                }
                Some(("every", n)) => match (&mut kind, n.parse()) {
                    (FaultKind::Stall { every, .. }, Ok(ticks @ 1..)) => *every = ticks,
                    (FaultKind::Stall { .. }, _) => {
                        return Err(format!("every={n} is no number of ticks from 1 on"));
                    }
                    _ => return Err("every=N is an option of stall only".into()),
                },
                _ => return Err(format!("no option {option:?}; there are truck=N and every=N")),
            }
        }
        let truck = truck.ok_or("say which truck: kill-ecu@20:truck=2")?;
        Ok(Self { kind, at_s, truck })
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.kind {
            FaultKind::KillEcu => write!(f, "kill-ecu@{}:truck={}", self.at_s, self.truck),
            FaultKind::PauseEcu { duration_s } => {
                write!(f, "pause-ecu@{}+{duration_s}:truck={}", self.at_s, self.truck)
            }
            FaultKind::Stall { duration_s, every } => {
                let Self { at_s, truck, .. } = self;
                write!(f, "stall@{at_s}+{duration_s}:truck={truck},every={every}")
            }
        }
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|s: &f64| s.is_finite() && *s >= 0.0)
        .ok_or_else(|| format!("{text:?} is no time; give seconds, such as 20 or 0.5"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_as_written() {
        let kill: Fault = "kill-ecu@20:truck=2".parse().expect("well formed");
        assert_eq!(kill, Fault { kind: FaultKind::KillEcu, at_s: 20.0, truck: 2 });
        assert!(kill.stops(2, 1e6) && !kill.stops(2, 19.9) && !kill.stops(1, 30.0));
        let pause: Fault = "pause-ecu@1.5+0.25:truck=0".parse().expect("well formed");
        assert!(pause.stops(0, 1.6) && !pause.stops(0, 1.75));
        let stall: Fault = "stall@2+0.003:truck=1,every=500".parse().expect("well formed");
        assert_eq!(stall.kind, FaultKind::Stall { duration_s: 0.003, every: 500 });
        assert_eq!(stall.to_string().parse(), Ok(stall));
        assert!(!stall.stops(1, 3.0), "it goes on ticking");
    }

    #[test]
    fn nonsense_is_refused_with_a_reason() {
        for nonsense in [
            "",
            "kill-ecu",
            "kill-ecu@20",
            "kill-ecu@x:truck=1",
            "kill-ecu@-1:truck=1",
            "kill-ecu@NaN:truck=1",
            "kill-ecu@1+2:truck=1",
            "pause-ecu@1:truck=1",
            "melt@1:truck=1",
            "stall@1:truck=1",
            "stall@1+0.1:truck=1,every=0",
            "kill-ecu@1:truck=1,every=5",
            "kill-ecu@1:truck=x",
            "kill-ecu@1:trcuk=1",
        ] {
            assert!(nonsense.parse::<Fault>().is_err(), "{nonsense}");
        }
    }
}
