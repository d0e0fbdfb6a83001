//! How full each truck's bus would be if it were real, at the bit rates of the message plan.
//!
//! A virtual bus has no bit time and hides overload. The figure is the worst case: every frame with
//! the most stuff bits it can need, every obstacle in sight.

use bench_sim::Scenario;
use platoon_dbc::{
    Actuation, BusTiming, EcuStatus, EgoState, FrameFlags, Mission, Obstacle, V2vOut, V2vState,
};

/// Share of a bus that may be planned for; above, low-priority frames wait too long in practice.
const PLANNED_PERCENT_MAX: f64 = 80.0;

/// Extended FD frames with bit rate switch.
const FLAGS: FrameFlags = FrameFlags {
    is_extended: true,
    is_fd: true,
    brs: true,
    esi: false,
    is_rtr: false,
    is_error: false,
};

/// Worst-case load of every truck's bus.
#[derive(Debug, Clone, PartialEq)]
pub struct BusLoad {
    /// Per truck.
    pub percent: Vec<f64>,
    /// Whether all of them can be planned.
    pub fits: bool,
}

impl BusLoad {
    /// The load of a scenario at a loop rate.
    pub fn of(scenario: &Scenario, rate_hz: u32) -> Self {
        let timing = BusTiming::default();
        let loop_hz = f64::from(rate_hz);
        let v2v_hz = 1.0 / scenario.v2v.period_s;
        let seen = scenario.obstacles.len() as f64;
        let percent: Vec<f64> = (0..scenario.platoon.trucks)
            .map(|truck| {
                // A truck hears the leader and its predecessor; for truck 1 they are one.
                let heard = truck.min(2) as f64;
                let ahead = truck as f64;
                let frames = [
                    (EgoState::LENGTH, loop_hz),
                    (Actuation::LENGTH, loop_hz),
                    (V2vState::LENGTH, heard * v2v_hz),
                    (V2vOut::LENGTH, v2v_hz),
                    (Obstacle::LENGTH, (seen + ahead) * per_second(Obstacle::CYCLE_TIME_MS)),
                    (Mission::LENGTH, per_second(Mission::CYCLE_TIME_MS)),
                    (EcuStatus::LENGTH, per_second(EcuStatus::CYCLE_TIME_MS)),
                ];
                let longest_ns = |length| timing.frame_time_ns_max(FLAGS, length) as f64;
                let busy_ns = |&(length, hz): &(usize, f64)| hz * longest_ns(length);
                100.0 * 1e-9 * frames.iter().map(busy_ns).sum::<f64>()
            })
            .collect();
        let fits = percent.iter().all(|&load| load <= PLANNED_PERCENT_MAX);
        Self { percent, fits }
    }
}

fn per_second(cycle_ms: u32) -> f64 {
    1e3 / f64::from(cycle_ms)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plan_fits_at_1_khz_and_not_at_2_khz() {
        let scenario = Scenario::load("obstacle-avoidance", &[]).expect("built in");
        let load = BusLoad::of(&scenario, 1000);
        assert!(load.fits && load.percent.iter().all(|p| (50.0..70.0).contains(p)), "{load:?}");
        assert!(!BusLoad::of(&scenario, 2000).fits);
    }
}
