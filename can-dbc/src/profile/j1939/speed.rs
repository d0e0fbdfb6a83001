//! The forward speed that a truck's standard frames tell.
//!
//! CCVS1 brings the speed every 100 ms in steps of 1/256 km/h. In between it is continued by the
//! trapezoidal rule over bench time with u' = a + v r: a and r from VDC2 (a in steps of 0.1 m/s²),
//! the lateral speed v from the navigation solution.

use serde::{Deserialize, Serialize};

/// Five periods of CCVS1, after which its speed is unknown \[ns\].
const HELD_MAX_NS: u64 = 500_000_000;

/// What is known of the forward speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct SpeedEstimate {
    /// Speed of a CCVS1 whose instant is not known yet \[m/s\].
    heard_mps: Option<f64>,
    newest: Option<Known>,
}

/// The speed at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Known {
    time_ns: u64,
    heard_ns: u64,
    speed_mps: f64,
    rate_mps2: f64,
}

impl SpeedEstimate {
    /// Notes the speed of a CCVS1; it is that of the navigation solution completed next.
    pub(super) fn hear(&mut self, speed_mps: f64) {
        self.heard_mps = Some(speed_mps);
    }

    /// The speed at `time_ns`, where it changes at `rate_mps2`; `None` while none is known.
    pub(super) fn at(&mut self, time_ns: u64, rate_mps2: f64) -> Option<f64> {
        let (speed_mps, heard_ns) = match self.heard_mps.take() {
            Some(heard_mps) => (heard_mps, time_ns),
            None => self.newest.and_then(|known| known.continued(time_ns, rate_mps2))?,
        };
        self.newest = Some(Known { time_ns, heard_ns, speed_mps, rate_mps2 });
        Some(speed_mps)
    }
}

impl Known {
    fn continued(&self, time_ns: u64, rate_mps2: f64) -> Option<(f64, u64)> {
        let elapsed_s = time_ns.checked_sub(self.time_ns)? as f64 * 1e-9;
        if time_ns - self.heard_ns > HELD_MAX_NS {
            return None;
        }
        let change_mps = 0.5 * (self.rate_mps2 + rate_mps2) * elapsed_s;
        // CCVS1 knows no reverse.
        Some(((self.speed_mps + change_mps).max(0.0), self.heard_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn the_speed_is_unknown_until_heard_and_half_a_second_after_the_last() {
        let mut speed = SpeedEstimate::default();
        assert_eq!(speed.at(0, 1.0), None);
        speed.hear(20.0);
        assert_eq!(speed.at(10 * MS, 0.0), Some(20.0));
        assert_eq!(speed.at(510 * MS, 0.0), Some(20.0));
        assert_eq!(speed.at(520 * MS, 0.0), None);
        assert_eq!(speed.at(530 * MS, 0.0), None);
    }

    #[test]
    fn between_its_frames_the_speed_follows_the_acceleration() {
        // v = 20 + sin t, known every 100 ms, asked every 10 ms.
        let mut speed = SpeedEstimate::default();
        for tick in 0..1_000_u64 {
            let time_s = tick as f64 * 0.01;
            if tick % 10 == 0 {
                speed.hear(20.0 + time_s.sin());
            }
            let known = speed.at(tick * 10 * MS, time_s.cos()).expect("heard");
            assert!((known - 20.0 - time_s.sin()).abs() < 1e-5, "{time_s}");
        }
    }

    #[test]
    fn a_truck_that_brakes_to_a_stop_does_not_roll_backwards() {
        let mut speed = SpeedEstimate::default();
        speed.hear(0.1);
        speed.at(0, -5.0);
        assert_eq!(speed.at(100 * MS, -5.0), Some(0.0));
    }

    #[test]
    fn a_clock_that_jumps_back_forgets_the_speed() {
        let mut speed = SpeedEstimate::default();
        speed.hear(20.0);
        assert!(speed.at(1_000 * MS, 0.0).is_some());
        assert_eq!(speed.at(0, 0.0), None);
    }
}
