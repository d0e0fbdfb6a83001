use super::*;
use crate::observation::{Ego, Mission, Observation, Obstacle, Plans};
use crate::potential::{Field, SafeDistance};
use crate::qp::{ActiveSet, QpSolver, SolveStatus, WorkingSet};

fn seen(obstacle: Option<Obstacle>) -> Observation {
    let mut obstacles = [None; 8];
    obstacles[0] = obstacle;
    Observation {
        time_ns: 1_000_000_000,
        ego: Ego {
            time_ns: 1_000_000_000,
            x_m: 100.0,
            y_m: 0.4,
            heading_rad: 0.02,
            forward_mps: 18.0,
            yaw_radps: 0.01,
            ..Ego::default()
        },
        mission: Mission {
            trucks: 4,
            spacing_m: 50.0,
            set_speed_mps: 18.0,
            lane_width_m: 3.75,
            right_edge_y_m: -1.875,
            left_edge_y_m: 5.625,
            ..Mission::default()
        },
        leader: None,
        predecessor: None,
        plans: Plans::default(),
        obstacles,
    }
}

fn request() -> Request {
    Request {
        v_ref_mps: 17.0,
        q_ref: 200.0,
        slot: None,
        course: None,
        plan: [[1.0, 0.5], [2.0, 0.2], [0.5, -0.4], [-1.0, -0.3], [0.3, 0.1]],
        applied: [0.8, 0.3],
        interval_s: 0.05,
    }
}

fn built(cal: &Calibration, around: &Surroundings, seen: &Observation, request: &Request) -> Qp {
    let mut qp = Qp::empty();
    build(cal, &Bicycle::new(&cal.truck), around, seen, request, &mut qp);
    qp
}

/// Eq. 21's cost by the nonlinear rollout, in the prototype's words: no QP involved.
fn cost(
    seen: &Observation,
    request: &Request,
    plan: &[[f64; 2]; BLOCKS],
    safe: SafeDistance,
) -> f64 {
    let cal = Calibration::default();
    let model = Bicycle::new(&cal.truck);
    let ego = &seen.ego;
    let start =
        [ego.forward_mps, ego.lateral_mps, ego.yaw_radps, ego.heading_rad, ego.x_m, ego.y_m];
    let mut sum = 0.0;
    predict(&model, &start, plan, |k, instant| {
        let y = instant.state[Y];
        sum += cal.lml.q_y * y * y;
        if let Some(slot) = request.slot {
            let x = slot.x_m + slot.speed_mps * ahead_s(k);
            sum += slot.weight * (instant.state[X] - x).powi(2);
        }
        sum += request.q_ref * (instant.state[SPEED] - request.v_ref_mps).powi(2);
        if let Some(o) = seen.obstacles[0] {
            let x_o = o.x_m + o.vx_mps * ahead_s(k);
            let (dx, dy) = (instant.state[X] - x_o, y - o.y_m);
            sum += cal.lml.q_obs * Field::new(&cal.lml).obstacle(o.kind, safe, dx, dy).value;
        }
        for i in 0..2 {
            sum += cal.lml.s[i] * plan[block(k)][i].powi(2);
        }
    });
    let (mut before, mut share) = (request.applied, request.interval_s / STEP_S);
    for block in plan {
        for i in 0..2 {
            sum += share * cal.lml.r[i] * (block[i] - before[i]).powi(2);
        }
        (before, share) = (*block, 1.0);
    }
    sum
}

/// A van half in the next lane: far enough to the side that no passing rule bends its potential,
/// near enough to the truck's own path to be felt whole.
fn van() -> Obstacle {
    Obstacle {
        x_m: 120.0,
        y_m: 2.7,
        vx_mps: 15.0,
        length_m: 6.0,
        width_m: 2.2,
        time_ns: 1_000_000_000,
        ..Obstacle::default()
    }
}

#[test]
fn the_qps_gradient_is_that_of_the_nonlinear_cost() {
    let cal = Calibration::default();
    let slot = Slot { x_m: 103.0, speed_mps: 18.5, weight: 80.0 };
    for (obstacle, slot) in [(None, None), (Some(van()), None), (None, Some(slot))] {
        let (seen, request) = (seen(obstacle), Request { slot, ..request() });
        let surroundings = Surroundings::new(&cal.lml, &cal.truck, &seen);
        let qp = built(&cal, &surroundings, &seen, &request);
        let ego = &seen.ego;
        let closing_y = ego.cross_speed_mps();
        let safe =
            SafeDistance::new(&cal.lml, ego.forward_mps, ego.road_speed_mps() - 15.0, closing_y);
        for j in 0..INPUTS {
            let mut slope = qp.gradient[j];
            for i in 0..INPUTS {
                slope += qp.hessian[(j, i)] * request.plan[i / 2][i % 2];
            }
            let nudge = 1e-4;
            let moved = |sign: f64| {
                let mut plan = request.plan;
                plan[j / 2][j % 2] += sign * nudge;
                cost(&seen, &request, &plan, safe)
            };
            let difference = (moved(1.0) - moved(-1.0)) / (2.0 * nudge);
            let error = (slope - difference).abs() / difference.abs().max(1.0);
            assert!(error < 1e-5, "input {j}: {slope} against {difference}");
        }
    }
}

#[test]
fn the_hessian_is_symmetric_and_positive_definite_even_on_top_of_an_obstacle() {
    let cal = Calibration::default();
    let on_top = Obstacle { x_m: 100.0, y_m: 0.4, vx_mps: 18.0, ..van() };
    let seen = seen(Some(on_top));
    let surroundings = Surroundings::new(&cal.lml, &cal.truck, &seen);
    let qp = built(&cal, &surroundings, &seen, &request());
    assert_eq!(qp.hessian, qp.hessian.transpose());
    assert!(qp.hessian.cholesky().is_some());
    let solution = ActiveSet.solve(&qp, &mut WorkingSet::default());
    assert_eq!(solution.status, SolveStatus::Solved);
}

#[test]
fn shifting_by_parts_of_a_step_adds_up_to_shifting_by_one() {
    let plan = request().plan;
    assert_eq!(shifted(&plan, 0.0), plan);
    let whole = shifted(&plan, STEP_S);
    assert_eq!(whole[0], plan[1]);
    assert_eq!(whole[BLOCKS - 1], plan[BLOCKS - 1]);
    let half = shifted(&plan, 0.5 * STEP_S);
    assert!((half[0][0] - 0.5 * (plan[0][0] + plan[1][0])).abs() < 1e-12);
}
