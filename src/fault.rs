//! Faults a rehearsal puts into its own bench: `KIND@TIME[+DURATION][:key=value,...]`.

use std::fmt;
use std::str::FromStr;

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
}

impl Fault {
    /// Whether the ECU is out of action at a bench time, and for a pause comes back later.
    pub fn stops(&self, truck: u8, time_s: f64) -> bool {
        let over = match self.kind {
            FaultKind::KillEcu => f64::INFINITY,
            FaultKind::PauseEcu { duration_s } => self.at_s + duration_s,
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
        let kind = match (kind, duration) {
            ("kill-ecu", None) => FaultKind::KillEcu,
            ("kill-ecu", Some(_)) => return Err("kill-ecu has no duration; leave out +...".into()),
            ("pause-ecu", Some(duration)) => FaultKind::PauseEcu { duration_s: seconds(duration)? },
            ("pause-ecu", None) => {
                return Err("pause-ecu needs a duration: pause-ecu@20+0.5:truck=2".into());
            }
            (other, _) => {
                return Err(format!("no fault {other:?}; there are kill-ecu and pause-ecu"));
            }
        };
        let mut truck = None;
        for option in options.split(',').filter(|option| !option.is_empty()) {
            match option.split_once('=') {
                Some(("truck", n)) => {
                    truck = Some(n.parse().map_err(|_| format!("truck={n} is no truck number"))?);
                }
                _ => return Err(format!("no option {option:?}; the one there is is truck=N")),
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
            "kill-ecu@1:truck=x",
            "kill-ecu@1:trcuk=1",
        ] {
            assert!(nonsense.parse::<Fault>().is_err(), "{nonsense}");
        }
    }
}
