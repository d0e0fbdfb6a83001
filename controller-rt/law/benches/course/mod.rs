//! A follower that passes a slow van at 1 kHz: what it sees, tick by tick.
//!
//! The truck is a point that the law's own commands drive, good enough to change lane with; the
//! plants live on the other side of the bus.

use law::qp::{ActiveSet, BLOCKS};
use law::{Ego, Law, Memory, Mission, Observation, Obstacle, Plans, V2v};

/// Ticks of the course.
const TICKS: u64 = 1_200;
const PERIOD_NS: u64 = 10_000_000;
/// Front to rear axle \[m\].
const WHEELBASE_M: f64 = 5.0;

/// The course.
pub struct Course {
    /// Every observation kept, ten milliseconds apart.
    pub seen: Vec<Observation>,
    /// States and plans about which to linearise.
    pub plans: Vec<([f64; 6], [[f64; 2]; BLOCKS])>,
}

/// Drives the course.
pub fn course(law: &Law<ActiveSet>) -> Course {
    let mut ego = Ego { forward_mps: 18.0, ..Ego::default() };
    let mut memory = Memory::new();
    let mut course = Course { seen: Vec::new(), plans: Vec::new() };
    for tick in 0..TICKS {
        let seen = seen(&ego, tick);
        let decision = law.step(&mut memory, &seen);
        course.seen.push(seen);
        let (force, steering) = (1e-3 * decision.force_n, decision.steering_rad.to_degrees());
        let start = [ego.forward_mps, 0.0, ego.yaw_radps, ego.heading_rad, ego.x_m, ego.y_m];
        let plan = [1.0, 0.8, 0.6, 0.4, 0.2].map(|share| [share * force, share * steering]);
        course.plans.push((start, plan));
        drive(&mut ego, decision.intended_accel_mps2, decision.steering_rad);
    }
    course
}

/// One tick of a truck whose wheels roll where they point.
fn drive(ego: &mut Ego, accel_mps2: f64, steering_rad: f64) {
    let dt_s = 1e-9 * PERIOD_NS as f64;
    ego.accel_mps2 = accel_mps2;
    ego.forward_mps = (ego.forward_mps + dt_s * accel_mps2).max(0.0);
    ego.yaw_radps = ego.forward_mps * steering_rad / WHEELBASE_M;
    ego.heading_rad += dt_s * ego.yaw_radps;
    ego.x_m += dt_s * ego.forward_mps * ego.heading_rad.cos();
    ego.y_m += dt_s * ego.forward_mps * ego.heading_rad.sin();
}

fn seen(ego: &Ego, tick: u64) -> Observation {
    let (time_ns, time_s) = (tick * PERIOD_NS, 1e-9 * (tick * PERIOD_NS) as f64);
    let van = |x_m: f64, y_m: f64, vx_mps: f64| Obstacle {
        time_ns,
        x_m: x_m + vx_mps * time_s,
        y_m,
        vx_mps,
        length_m: 6.0,
        width_m: 2.2,
        ..Obstacle::default()
    };
    let mut obstacles = [None; law::OBSTACLES_MAX];
    obstacles[0] = Some(van(35.0, 0.0, 15.0));
    obstacles[1] = Some(van(110.0, 3.75, 17.0));
    // Messages of the two ahead, sent every 20 ms and 100 ms old.
    let sent_ns = (time_ns.saturating_sub(100 * PERIOD_NS) / (20 * PERIOD_NS)) * (20 * PERIOD_NS);
    let ahead = |distance_m: f64| V2v {
        generated_ns: sent_ns,
        x_m: distance_m + 18.0 * 1e-9 * sent_ns as f64,
        speed_mps: 18.0,
        ..V2v::default()
    };
    Observation {
        time_ns,
        ego: Ego { time_ns, ..*ego },
        mission: Mission {
            truck: 2,
            trucks: 4,
            predecessor: 1,
            spacing_m: 50.0,
            leader_distance_m: 100.0,
            set_speed_mps: 18.0,
            lane_width_m: 3.75,
            right_edge_y_m: -1.875,
            left_edge_y_m: 5.625,
            ..Mission::default()
        },
        leader: Some(ahead(100.0)),
        predecessor: Some(ahead(50.0)),
        plans: Plans::default(),
        obstacles,
    }
}
