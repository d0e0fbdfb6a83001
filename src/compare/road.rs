//! Movement figures: the road from above at some instants, and everybody's lateral position.

use bench_sim::truck::{FRONT_OVERHANG_M, REAR_OVERHANG_M, WIDTH_M};

use super::figure::{Body, Figure, Ink, Panel, Strip, Vehicle};
use super::figures::{curve, over_time};
use crate::campaign::{Moment, ObstacleMoment, Outcome, TruckMoment};

/// Instants of the merging scenario \[s\].
pub const MERGING_S: [f64; 6] = [0.5, 4.0, 8.0, 16.0, 26.0, 40.0];
/// Instants of the obstacle avoidance scenarios \[s\]; obstacle 2 blocks the road at 49 s.
pub const AVOIDANCE_S: [f64; 6] = [5.0, 22.0, 37.0, 49.0, 58.0, 80.0];

/// The movement of the first seed's run, and the lateral positions of all.
pub fn movement(
    of: &str,
    file: &str,
    title: &str,
    outcomes: &[Outcome],
    times_s: &[f64],
) -> Option<Figure> {
    let first = outcomes.first()?;
    let at = |time_s: &f64| first.trajectory.iter().find(|moment| moment.time_s >= *time_s);
    let strips: Vec<Strip> = times_s.iter().filter_map(at).map(strip).collect();
    let trucks = first.trajectory.first()?.trucks.len();
    let across = (0..trucks).map(|truck| curve(outcomes, truck, |moment| moment.y_m)).collect();
    Some(Figure {
        of: of.into(),
        file: file.into(),
        title: title.into(),
        caption: "Above: the road at some instants, driving to the right, lane 2 above lane 1; \
                  grey: obstacles; widths not to scale. Below: lateral positions."
            .into(),
        panels: vec![
            Panel { title: "position relative to the leader".into(), body: Body::Road(strips) },
            Panel {
                title: "lateral position".into(),
                body: over_time("Lateral position", "m", across),
            },
        ],
    })
}

/// The vehicles at a moment, along the road from the leader.
fn strip(moment: &Moment) -> Strip {
    let origin_m = moment.trucks[0].x_m;
    let truck = |(index, truck): (usize, &TruckMoment)| Vehicle {
        name: if index == 0 { "L".into() } else { index.to_string() },
        ink: Ink::of_truck(index),
        rear_m: truck.x_m - REAR_OVERHANG_M - origin_m,
        front_m: truck.x_m + FRONT_OVERHANG_M - origin_m,
        y_m: truck.y_m,
        width_m: WIDTH_M,
    };
    let obstacle = |obstacle: &ObstacleMoment| Vehicle {
        name: String::new(),
        ink: Ink::Grey,
        rear_m: obstacle.x_m - 0.5 * obstacle.length_m - origin_m,
        front_m: obstacle.x_m + 0.5 * obstacle.length_m - origin_m,
        y_m: obstacle.y_m,
        width_m: obstacle.width_m,
    };
    let trucks = moment.trucks.iter().enumerate().map(truck);
    let obstacles = moment.obstacles.iter().flatten().map(obstacle);
    Strip { time_s: moment.time_s, vehicles: trucks.chain(obstacles).collect() }
}
