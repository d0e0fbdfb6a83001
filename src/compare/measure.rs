//! Numbers of one run.

use bench_sim::TruckResult;

use crate::campaign::{Outcome, TruckMoment};

/// Largest |s̄_i| of any truck: the error to the truck ahead, as in the paper's Fig. 17 \[m\].
pub fn largest_predecessor_error_m(outcome: &Outcome) -> f64 {
    largest(outcome, |truck| truck.max_abs_predecessor_error_m)
}

/// Largest |ŝ_i| of any truck: the error to the leader \[m\].
pub fn largest_leader_error_m(outcome: &Outcome) -> f64 {
    largest(outcome, |truck| truck.max_abs_leader_error_m)
}

/// ‖s̄_i‖∞ of one truck \[m\]; NaN when there is no such truck.
pub fn predecessor_error_m(outcome: &Outcome, truck: usize) -> f64 {
    outcome.results.trucks.get(truck).map_or(f64::NAN, |truck| truck.max_abs_predecessor_error_m)
}

/// ‖s̄_i‖∞ / ‖s̄_(i-1)‖∞, as in the paper's Table III.
pub fn ratio(outcome: &Outcome, truck: usize) -> f64 {
    predecessor_error_m(outcome, truck) / predecessor_error_m(outcome, truck - 1)
}

/// When every truck has settled in its slot \[s\]; infinite when one never does.
pub fn settled_position_s(outcome: &Outcome) -> f64 {
    largest(outcome, |truck| truck.settled_position_s.unwrap_or(f64::INFINITY))
}

/// When every truck has settled at its speed \[s\]; infinite when one never does.
pub fn settled_speed_s(outcome: &Outcome) -> f64 {
    largest(outcome, |truck| truck.settled_speed_s.unwrap_or(f64::INFINITY))
}

/// When every truck is back in its lane \[s\]; infinite when one never is.
pub fn settled_lateral_s(outcome: &Outcome) -> f64 {
    largest(outcome, |truck| truck.settled_lateral_s.unwrap_or(f64::INFINITY))
}

/// Least distance of a truck to an obstacle \[m\]; infinite without one.
pub fn clearance_m(outcome: &Outcome) -> f64 {
    least(outcome, |truck| truck.min_obstacle_clearance_m.unwrap_or(f64::INFINITY))
}

/// Least distance between two trucks \[m\].
pub fn gap_m(outcome: &Outcome) -> f64 {
    least(outcome, |truck| truck.min_truck_gap_m.unwrap_or(f64::INFINITY))
}

/// Largest |road-wheel angle| \[rad\].
pub fn steering_rad(outcome: &Outcome) -> f64 {
    largest(outcome, |truck| truck.max_abs_steer_rad)
}

/// Largest |lateral acceleration| \[m/s²\].
pub fn lateral_accel_mps2(outcome: &Outcome) -> f64 {
    largest(outcome, |truck| truck.max_abs_lateral_accel_mps2)
}

/// Furthest off its lane's centre that a truck is, 10 s after it came back from passing \[m\].
pub fn off_centre_m(outcome: &Outcome) -> f64 {
    largest(outcome, |truck| truck.max_abs_off_centre_m.unwrap_or(0.0))
}

/// Lane crossings of the truck that is furthest from two.
pub fn crossings(outcome: &Outcome) -> f64 {
    let trucks = outcome.results.trucks.iter();
    let odd = trucks.map(|truck| truck.lane_crossings).max_by_key(|&count| count.abs_diff(2));
    odd.map_or(f64::NAN, f64::from)
}

/// How many trucks were behind obstacle 1 and never passed it.
pub fn not_passed(outcome: &Outcome) -> f64 {
    let behind = |truck: &&TruckResult| {
        truck.met_obstacles.contains(&1) && !truck.passed_obstacles.contains(&1)
    };
    outcome.results.trucks.iter().filter(behind).count() as f64
}

/// When a truck's centre of gravity first is 1 m left of its lane's centre \[s\]; infinite when it
/// never is.
pub fn first_out_s(outcome: &Outcome, truck: usize) -> f64 {
    let out = |moment: &&crate::campaign::Moment| moment.trucks[truck].y_m > 1.0;
    outcome.trajectory.iter().find(out).map_or(f64::INFINITY, |moment| moment.time_s)
}

/// Mean of a truck's number from a time on; NaN without samples.
pub fn mean_after(
    outcome: &Outcome,
    truck: usize,
    from_s: f64,
    of: impl Fn(&TruckMoment) -> f64,
) -> f64 {
    let values = between(outcome, truck, (from_s, f64::INFINITY), of);
    values.iter().sum::<f64>() / values.len() as f64
}

/// A truck's number at every sampled moment of a time span \[s\].
pub fn between(
    outcome: &Outcome,
    truck: usize,
    (from_s, until_s): (f64, f64),
    of: impl Fn(&TruckMoment) -> f64,
) -> Vec<f64> {
    let inside =
        |moment: &&crate::campaign::Moment| moment.time_s >= from_s && moment.time_s <= until_s;
    let moments = outcome.trajectory.iter().filter(inside);
    moments.filter_map(|moment| moment.trucks.get(truck)).map(of).collect()
}

fn largest(outcome: &Outcome, of: impl Fn(&TruckResult) -> f64) -> f64 {
    outcome.results.trucks.iter().map(of).fold(f64::NAN, f64::max)
}

fn least(outcome: &Outcome, of: impl Fn(&TruckResult) -> f64) -> f64 {
    outcome.results.trucks.iter().map(of).fold(f64::NAN, f64::min)
}
