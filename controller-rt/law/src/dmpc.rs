//! Distributed MPC, the baseline of the paper's Table III, as a controller of its own.
//!
//! \[Zheng\]: Y. Zheng, S. E. Li, K. Li, F. Borrelli, J. K. Hedrick, *Distributed Model Predictive
//! Control for Heterogeneous Vehicle Platoons Under Unidirectional Topologies*, IEEE Trans. Control
//! Systems Technology 25(3), 2017; the authors' own program, soc-ucsd/DMPC_for_platoons, says what
//! the paper leaves open.
//!
//! Every [`STEP_S`] a truck plans [`STEPS`] steps ahead ([`Problem`]) and tells its followers the
//! plan. It stays close to what it announced last (F) and to what its neighbours announced (G), and
//! ends its plan in the mean of the slots they leave it, at steady speed: that makes the sum of all
//! costs fall when F >= G, which is the paper's proof of stability. In `pf` a truck listens to the
//! one ahead, in `plf` to the leader as well.
//!
//! Ours is what the paper's simulation does not need: plans that come late are shifted by their age
//! ([`Plan::at`]), a truck too far from its slot approaches it at a bounded speed (`aim`), and a
//! truck that hears nobody's plan supposes constant speed. `docs/dmpc.md` has it all in one place.

mod bounded;
mod drive;
mod plan;
mod problem;

pub use drive::{Discretisation, Drive, State};
pub use plan::{POINTS, Plan};
pub use problem::{Problem, Solved, Terminal, Weights};

use serde::{Deserialize, Serialize};

use crate::calibration::{Calibration, Structure};
use crate::decision::UclReport;
use crate::history::{Motion, seconds_between};
use crate::memory::Memory as LawMemory;
use crate::observation::Observation;
use crate::qp::BLOCKS;

/// Steps of the horizon, N_p.
pub const STEPS: usize = 20;
/// Length of a step, and time between two plans \[s\].
pub const STEP_S: f64 = 0.1;
/// The same \[ns\].
pub const STEP_NS: u64 = 100_000_000;
/// Length of the horizon \[s\].
const HORIZON_S: f64 = STEPS as f64 * STEP_S;

/// The numbers of distributed MPC; weights as in the authors' program.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DmpcCalibration {
    /// Q of trucks that listen to the leader: position \[1/m²\], speed \[s²/m²\].
    pub leader_weight: [f64; 2],
    /// F, against the truck's own announced plan.
    pub own_weight: [f64; 2],
    /// G, against the plan of the truck ahead.
    pub neighbour_weight: [f64; 2],
    /// R, of torque that is not needed to keep the speed \[1/(N m)²\].
    pub input_weight: f64,
    /// Radius of the driven wheels \[m\]; ours for the truck.
    pub wheel_radius_m: f64,
    /// Mechanical efficiency of the drive line η \[-\].
    pub efficiency: f64,
    /// Lag of the drive line τ \[s\]; ours for the truck.
    pub lag_s: f64,
    /// How the model is advanced; ours.
    pub discretisation: Discretisation,
    /// Whether what the leader announces is believed; else it is supposed to keep its speed; ours.
    pub leader_preview: bool,
    /// Speed of approach of a truck too far from its slot \[m/s\]; ours.
    pub approach_mps: f64,
    /// Weight of the planned force in the motion layer, per unit of Q_ref \[1/kN²\]; ours.
    pub force_weight: f64,
}

impl Default for DmpcCalibration {
    fn default() -> Self {
        Self {
            leader_weight: [10.0; 2],
            own_weight: [10.0; 2],
            neighbour_weight: [5.0; 2],
            input_weight: 1.0,
            wheel_radius_m: 0.5,
            efficiency: 0.96,
            lag_s: 0.25,
            discretisation: Discretisation::Hold,
            leader_preview: true,
            approach_mps: 4.0,
            force_weight: 1.0,
        }
    }
}

/// What a truck remembers of its last plan.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Memory {
    /// Which step of bench time it was made in.
    step: Option<u64>,
    /// Its inputs \[m/s²\].
    inputs: [f64; STEPS],
    /// The plan, as it was announced.
    plan: Option<Plan>,
    /// Force asked of the motion layer at the tick before \[kN\].
    force_kn: Option<f64>,
}

/// The force the motion layer has to follow where nothing is in the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Course {
    /// In each control block \[kN\].
    pub force_kn: [f64; BLOCKS],
    /// At the tick before \[kN\].
    pub before_kn: f64,
    /// Weight per unit of Q_ref \[1/kN²\].
    pub weight: f64,
}

/// The slots a truck is to keep, as plans of its own position.
#[derive(Debug, Clone, Copy, Default)]
struct Slots {
    leader: Option<Plan>,
    neighbour: Option<Plan>,
}

impl Slots {
    /// What a truck of the topology may use of what is heard.
    fn new(cal: &Calibration, memory: &LawMemory, seen: &Observation) -> Self {
        let mission = &seen.mission;
        let place = mission.truck;
        if place == 0 {
            return Self::default();
        }
        let now_ns = seen.ego.time_ns;
        let plan = |told: Option<Plan>, heard: Option<Motion>, distance_m: f64| {
            // Without a plan, and in its absence a state, there is nothing to keep a slot behind.
            let steady = heard.map(|m| Plan::steady(m.time_ns, m.x_m, m.speed_mps));
            let plan = told.or(steady)?.shifted_to(now_ns);
            Some(plan.behind(distance_m))
        };
        let hears_leader = place == 1 || cal.structure == Structure::DmpcPlf;
        let told = seen.plans.leader.filter(|_| cal.dmpc.leader_preview);
        Self {
            leader: hears_leader
                .then(|| plan(told, memory.leader.newest(), mission.leader_distance_m))
                .flatten(),
            neighbour: match place {
                1 => None,
                _ => plan(seen.plans.predecessor, memory.predecessor.newest(), mission.spacing_m),
            },
        }
    }

    /// The mean over the slots there are.
    fn mean(&self, of: impl Fn(&Plan) -> f64) -> Option<f64> {
        let mut values = [self.leader.as_ref(), self.neighbour.as_ref()].into_iter().flatten();
        let first = of(values.next()?);
        Some(values.next().map_or(first, |second| 0.5 * (first + of(second))))
    }
}

/// Plans when it is time to, and says what the motion layer is to do until then.
pub fn coordinate(
    cal: &Calibration,
    drive: &Drive,
    memory: &mut LawMemory,
    seen: &Observation,
) -> (UclReport, Course, Option<Plan>) {
    let mut announced = None;
    let slots = Slots::new(cal, memory, seen);
    let step = seen.time_ns / STEP_NS;
    if memory.dmpc.step != Some(step) {
        memory.dmpc.step = Some(step);
        let solved = plan(cal, drive, &memory.dmpc, &slots, seen);
        memory.dmpc.inputs = solved.inputs;
        memory.dmpc.plan = Some(solved.plan);
        announced = Some(solved.plan);
    }
    let own = memory.dmpc.plan.unwrap_or_else(|| steady(seen));
    let kn_per_accel = 1e-3 * cal.truck.mass_kg;
    let age = age_in_steps(&own, seen.time_ns);
    let force_kn: [f64; BLOCKS] =
        core::array::from_fn(|b| kn_per_accel * input_at(drive, &memory.dmpc, &own, age + b));
    let before_kn = memory.dmpc.force_kn.replace(force_kn[0]).unwrap_or(force_kn[0]);
    let course = Course { force_kn, before_kn, weight: cal.dmpc.force_weight };
    (report(memory, seen, &slots, &own), course, announced)
}

/// One plan. When nothing can be solved, the last one goes on.
fn plan(
    cal: &Calibration,
    drive: &Drive,
    memory: &Memory,
    slots: &Slots,
    seen: &Observation,
) -> Solved {
    let ego = &seen.ego;
    let speed_mps = ego.road_speed_mps();
    let last = memory.plan.unwrap_or_else(|| steady(seen));
    let age = age_in_steps(&last, ego.time_ns);
    let problem = Problem {
        drive,
        input_limits_mps2: [cal.lml.force_min_kn, cal.lml.force_max_kn]
            .map(|force_kn| 1e3 * force_kn / cal.truck.mass_kg),
        weights: &Weights::new(&cal.dmpc, cal.truck.mass_kg),
        start: [ego.x_m, speed_mps, ego.accel_mps2 + drive.holding(speed_mps).0],
        start_ns: ego.time_ns,
        inputs: core::array::from_fn(|k| input_at(drive, memory, &last, age + k)),
        leader: slots.leader,
        own: last.shifted_to(ego.time_ns),
        neighbour: slots.neighbour,
        terminal: aim(cal, slots, seen),
    };
    problem.solve().unwrap_or_else(|| problem.rolled_out(problem.inputs, 0))
}

/// Where the horizon has to end.
///
/// The mean of the slots, at their mean speed \[Zheng\]. A truck further from its slot than a
/// constant deceleration over the horizon covers cannot be there in time: it is only asked to end
/// its plan faster or slower than its neighbours by the speed of approach. Without neighbours the
/// speed changes towards the set speed by as much.
fn aim(cal: &Calibration, slots: &Slots, seen: &Observation) -> Terminal {
    let approach_mps = cal.dmpc.approach_mps;
    let own_mps = seen.ego.road_speed_mps();
    let Some(error_m) = slots.mean(|slot| slot.x_m[0]).map(|x_m| x_m - seen.ego.x_m) else {
        let wanted_mps = seen.mission.set_speed_mps - own_mps;
        let speed_mps = own_mps + wanted_mps.min(approach_mps).max(-approach_mps);
        return Terminal { x_m: None, speed_mps };
    };
    let speed_mps = slots.mean(|slot| slot.speed_mps[STEPS]).unwrap_or(own_mps);
    if error_m.abs() > 0.5 * approach_mps * HORIZON_S {
        let speed_mps = (speed_mps + approach_mps.copysign(error_m)).max(0.0);
        return Terminal { x_m: None, speed_mps };
    }
    Terminal { x_m: slots.mean(|slot| slot.x_m[STEPS]), speed_mps }
}

/// The plan of a truck that has none.
fn steady(seen: &Observation) -> Plan {
    Plan::steady(seen.ego.time_ns, seen.ego.x_m, seen.ego.road_speed_mps())
}

/// Whole steps since a plan was made.
fn age_in_steps(plan: &Plan, time_ns: u64) -> usize {
    let steps = seconds_between(plan.start_ns, time_ns) / STEP_S;
    // What is late by less than a thousandth of a step is rounding.
    libm::floor(steps + 1e-3).max(0.0) as usize
}

/// The input of a plan in its step `k`; past its end the one that keeps its last speed.
fn input_at(drive: &Drive, memory: &Memory, plan: &Plan, k: usize) -> f64 {
    match memory.plan {
        Some(_) if k < STEPS => memory.inputs[k],
        _ => drive.holding(plan.speed_mps[STEPS]).0,
    }
}

/// What was done, in the words of the coordination layer.
fn report(memory: &LawMemory, seen: &Observation, slots: &Slots, own: &Plan) -> UclReport {
    let age = |message: Option<Motion>| {
        message.map_or(f64::NAN, |m| seconds_between(m.time_ns, seen.time_ns))
    };
    let (_, now_mps) = own.at(seen.time_ns);
    let (_, next_mps) = own.at(seen.time_ns + STEP_NS);
    let mut report = UclReport {
        v_ref_mps: next_mps,
        accel_mps2: (next_mps - now_mps) / STEP_S,
        leader_age_s: age(memory.leader.newest()),
        predecessor_age_s: age(memory.predecessor.newest()),
        ..UclReport::default()
    };
    if let Some(slot) = slots.leader.or(slots.neighbour) {
        report.x_own.x = slot.x_m[0] - seen.ego.x_m;
        report.x_own.y = slot.speed_mps[0] - seen.ego.forward_mps;
    }
    report
}

#[cfg(test)]
#[path = "dmpc/tests.rs"]
mod tests;
