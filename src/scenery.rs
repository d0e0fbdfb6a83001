//! What scenes show besides trucks and obstacles: the scenario's road, and how far the law's
//! potential fields reach.

use bench_sim::Scenario;
use law::Calibration;
use law::parts::SafeDistance;
use traces::{ObstacleTruth, Reach, Scenery, TruckTruth};

/// Least bench time between two decoded messages of one kind on one bus \[ns\]: enough to plot, and
/// every frame is there to be decoded at full rate.
pub const SIGNALS_PERIOD_NS: u64 = 20_000_000;

/// The scenery of a run.
pub fn of(scenario: &Scenario, calibration: &Calibration) -> Scenery {
    let road = &scenario.road;
    let (right_m, left_m) = (road.right_edge_y_m, road.left_edge_y_m);
    let lanes = ((left_m - right_m) / road.lane_width_m.max(1.0)).round() as i32;
    let line_m = |number: i32| right_m + f64::from(number) * road.lane_width_m;
    let lml = calibration.lml;
    Scenery {
        edges_m: Some([right_m, left_m]),
        lane_lines_m: (1..lanes).map(line_m).collect(),
        reach: Some(Reach::new(move |truck, obstacle| safe_distance(&lml, truck, obstacle))),
    }
}

/// X_s and Y_s of Eq. 20 \[m\]: there, the normalised distance is 1.
fn safe_distance(
    lml: &law::LmlCalibration,
    truck: &TruckTruth,
    obstacle: &ObstacleTruth,
) -> [f64; 2] {
    let (sin, cos) = truck.heading_rad.sin_cos();
    let along_mps = truck.forward_mps * cos - truck.lateral_mps * sin;
    let across_mps = truck.forward_mps * sin + truck.lateral_mps * cos;
    let closing = |distance_m: f64, relative_mps: f64| relative_mps * distance_m.signum();
    let safe = SafeDistance::new(
        lml,
        truck.forward_mps,
        closing(obstacle.x_m - truck.x_m, along_mps - obstacle.vx_mps),
        closing(obstacle.y_m - truck.y_m, across_mps - obstacle.vy_mps),
    );
    [safe.x_m, safe.y_m]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_reaches_further_towards_a_truck_that_closes_in() {
        let lml = Calibration::default().lml;
        let obstacle = ObstacleTruth { x_m: 50.0, vx_mps: 15.0, ..ObstacleTruth::default() };
        let at = |forward_mps| {
            safe_distance(&lml, &TruckTruth { forward_mps, ..TruckTruth::default() }, &obstacle)
        };
        let (slow, fast) = (at(15.0), at(19.0));
        let expected_m = lml.time_gap_s * 4.0 + 16.0 / (2.0 * lml.comfort_accel_mps2);
        assert!((fast[0] - slow[0] - expected_m).abs() < 1e-9, "{slow:?} {fast:?}");
    }
}
