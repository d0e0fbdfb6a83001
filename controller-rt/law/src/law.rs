//! Algorithm 1 for one truck and one instant: coordinate, build, solve, decide.

use crate::bicycle::Bicycle;
use crate::calibration::{Calibration, Structure};
use crate::decision::{Decision, LmlReport, Outcome, UclReport};
use crate::dmpc::{self, Course, Drive, Plan};
use crate::lml::{self, Request};
use crate::memory::Memory;
use crate::observation::Observation;
use crate::qp::{ActiveSet, BLOCKS, INPUTS, Qp, QpSolver, Solution, SolveStatus};
use crate::single_mpc::{self, Slot};
use crate::surroundings::Surroundings;
use crate::ucl;
use crate::weight::reference_weight;

/// The parts of a step a caller may want to time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The coordination layer has answered.
    Ucl,
    /// The motion layer's QP is built.
    LmlBuild,
    /// The QP is solved.
    Qp,
}

/// What the motion layer has to follow, by the structure.
#[derive(Debug, Clone, Copy, Default)]
struct Aim {
    ucl: UclReport,
    slot: Option<Slot>,
    course: Option<Course>,
    announced: Option<Plan>,
}

/// The control law: immutable calibration and a QP solver.
///
/// Everything that changes is in the [`Memory`] the caller keeps, so one law serves many trucks.
#[derive(Debug, Clone, Copy)]
pub struct Law<S = ActiveSet> {
    calibration: Calibration,
    model: Bicycle,
    drive: Drive,
    solver: S,
}

impl<S: QpSolver> Law<S> {
    /// A law with the given numbers; see [`Calibration::defect`] for what makes sense.
    pub fn new(calibration: Calibration, solver: S) -> Self {
        let Calibration { truck, dmpc, .. } = &calibration;
        let drive = Drive::new(truck, dmpc.lag_s, dmpc.discretisation);
        Self { calibration, model: Bicycle::new(truck), drive, solver }
    }

    /// The law's numbers.
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// One tick: from what the truck sees to force and steering.
    pub fn step(&self, memory: &mut Memory, seen: &Observation) -> Decision {
        self.step_marked(memory, seen, &mut |_| ())
    }

    /// [`step`](Self::step), calling `mark` as each phase ends.
    pub fn step_marked(
        &self,
        memory: &mut Memory,
        seen: &Observation,
        mark: &mut impl FnMut(Phase),
    ) -> Decision {
        if memory.stepped_ns.is_none() {
            self.begin(memory, seen);
        }
        let elapsed_s = Memory::seconds_since(memory.stepped_ns, seen.time_ns);
        memory.stepped_ns = Some(seen.time_ns);
        memory.note_seen(seen);
        let aim = self.aim(memory, seen, elapsed_s);
        memory.asked_mps2 = aim.ucl.accel_mps2;
        mark(Phase::Ucl);

        let (outcome, lml) = if memory.ticks_to_solve == 0 {
            memory.ticks_to_solve = self.calibration.lml_every_ticks.max(1) - 1;
            self.plan_motion(memory, seen, &aim, mark)
        } else {
            memory.ticks_to_solve -= 1;
            (Outcome::Held, LmlReport::default())
        };
        self.decide(memory, seen, elapsed_s, &aim, (outcome, lml))
    }

    /// What the structure's coordinating part asks for.
    fn aim(&self, memory: &mut Memory, seen: &Observation, elapsed_s: f64) -> Aim {
        let cal = &self.calibration;
        match cal.structure {
            Structure::Mcf => {
                Aim { ucl: ucl::coordinate(&cal.ucl, memory, seen, elapsed_s), ..Aim::default() }
            }
            Structure::SingleMpc => {
                let (ucl, slot) = single_mpc::aim(cal, memory, seen);
                Aim { ucl, slot, ..Aim::default() }
            }
            Structure::DmpcPf | Structure::DmpcPlf => {
                let (ucl, course, announced) = dmpc::coordinate(cal, &self.drive, memory, seen);
                Aim { ucl, course: Some(course), announced, ..Aim::default() }
            }
        }
    }

    /// The first tick: a truck that holds its speed, steering straight.
    fn begin(&self, memory: &mut Memory, seen: &Observation) {
        let hold = [self.model.holding_force_kn(seen.ego.forward_mps), 0.0];
        memory.plan = [hold; BLOCKS];
        memory.applied = hold;
    }

    /// The motion layer: assess, weigh, build, solve, and keep the plan.
    fn plan_motion(
        &self,
        memory: &mut Memory,
        seen: &Observation,
        aim: &Aim,
        mark: &mut impl FnMut(Phase),
    ) -> (Outcome, LmlReport) {
        let cal = &self.calibration;
        let since_solve_s = Memory::seconds_since(memory.solved_ns, seen.time_ns);
        memory.solved_ns = Some(seen.time_ns);
        memory.plan = lml::shifted(&memory.plan, since_solve_s);

        let surroundings = Surroundings::new(&cal.lml, &cal.truck, seen);
        let mut potential = 0.0;
        let potentials = surroundings.potentials_now(&cal.lml, seen.ego.x_m, seen.ego.y_m);
        let values = potentials.map(|u| u.value).inspect(|value| potential += value);
        let q_ref = reference_weight(&cal.lml, values);
        let request = Request {
            v_ref_mps: aim.ucl.v_ref_mps,
            slot: aim.slot,
            course: aim.course,
            q_ref,
            plan: memory.plan,
            applied: memory.applied,
            interval_s: since_solve_s,
        };
        let mut qp = Qp::empty();
        lml::build(cal, &self.model, &surroundings, seen, &request, &mut qp);
        mark(Phase::LmlBuild);

        let solution = self.solver.solve(&qp, &mut memory.working_set);
        mark(Phase::Qp);
        let (outcome, slack) = keep_plan(memory, &solution);
        let report = LmlReport { potential, q_ref, slack, qp: solution.report };
        (outcome, report)
    }

    /// The command: towards the plan's first block, no faster than the actuators may move.
    fn decide(
        &self,
        memory: &mut Memory,
        seen: &Observation,
        elapsed_s: f64,
        aim: &Aim,
        (outcome, lml): (Outcome, LmlReport),
    ) -> Decision {
        let cal = &self.calibration.lml;
        let steering_max_deg = cal.steering_max_rad.to_degrees();
        let steering_rate = cal.steering_rate_radps.to_degrees();
        let toward = |i: usize, rate: f64, min: f64, max: f64| {
            let (now, reach) = (memory.applied[i], rate * elapsed_s);
            memory.plan[0][i].clamp(now - reach, now + reach).clamp(min, max)
        };
        let force_kn = toward(0, cal.force_rate_kn_per_s, cal.force_min_kn, cal.force_max_kn);
        let steering_deg = toward(1, steering_rate, -steering_max_deg, steering_max_deg);
        memory.applied = [force_kn, steering_deg];
        Decision {
            force_n: 1e3 * force_kn,
            steering_rad: steering_deg.to_radians(),
            intended_accel_mps2: self.model.acceleration_mps2(force_kn, seen.ego.forward_mps),
            announced: aim.announced,
            outcome,
            ucl: aim.ucl,
            lml,
        }
    }
}

/// Keeps a solution as the new plan; without one the old plan, already shifted, stays.
fn keep_plan(memory: &mut Memory, solution: &Solution) -> (Outcome, [f64; 3]) {
    let outcome = match solution.status {
        SolveStatus::Solved => {
            memory.plan = core::array::from_fn(|b| [solution.z[2 * b], solution.z[2 * b + 1]]);
            Outcome::Solved
        }
        SolveStatus::IterationCap => Outcome::IterationCap,
        SolveStatus::Infeasible => Outcome::Infeasible,
    };
    let slack = match outcome {
        Outcome::Solved => core::array::from_fn(|i| solution.z[INPUTS + i]),
        _ => [f64::NAN; 3],
    };
    (outcome, slack)
}

#[cfg(test)]
#[path = "law/tests.rs"]
mod tests;
