//! The way of the trucks through a run, sampled as it happens, and what their law weighs.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bench_sim::Rig;
use controller_rt::{Around, Controller};
use traces::{ObstacleTruth, TruckTruth};

use super::Cell;

/// How closely a run is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sampling {
    /// Not at all.
    #[default]
    None,
    /// Every so many nanoseconds of bench time, at the ticks of the loop.
    Every(u64),
}

impl Sampling {
    /// Every so many milliseconds.
    pub const fn every_ms(period_ms: u64) -> Self {
        Self::Every(1_000_000 * period_ms)
    }
}

/// The sampled moments of a run, in the order of time.
pub type Trajectory = Vec<Moment>;

/// The world at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// Bench time \[s\].
    pub time_s: f64,
    /// The trucks, leader first.
    pub trucks: Vec<TruckMoment>,
    /// The obstacles in the scenario's order; `None` before one appears.
    pub obstacles: Vec<Option<ObstacleMoment>>,
}

/// One obstacle at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObstacleMoment {
    /// Centre along the road \[m\].
    pub x_m: f64,
    /// Centre across the road \[m\].
    pub y_m: f64,
    /// Length of its box \[m\].
    pub length_m: f64,
    /// Width of its box \[m\].
    pub width_m: f64,
}

/// One truck at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruckMoment {
    /// CG along the road \[m\].
    pub x_m: f64,
    /// CG across the road \[m\], positive to the left.
    pub y_m: f64,
    /// Speed along the body's forward axis \[m/s\].
    pub speed_mps: f64,
    /// Force commanded \[N\].
    pub force_n: f64,
    /// Steering angle commanded \[rad\].
    pub steering_rad: f64,
    /// Position error to the leader \[m\].
    pub leader_error_m: f64,
    /// Position error to the truck ahead \[m\].
    pub predecessor_error_m: f64,
    /// Transport delay of the V2V link from the leader \[s\].
    pub leader_delay_s: f64,
    /// Adaptive weight Q_ref of the reference speed \[s²/m²\] [MCF, Eq. 22]; NaN before the law has
    /// spoken.
    pub q_ref: f64,
}

impl TruckMoment {
    fn new(truth: &TruckTruth, q_ref: f64) -> Self {
        Self {
            x_m: truth.x_m,
            y_m: truth.y_m,
            speed_mps: truth.forward_mps,
            force_n: truth.force_command_n,
            steering_rad: truth.steering_command_rad,
            leader_error_m: truth.leader_error_m,
            predecessor_error_m: truth.predecessor_error_m,
            leader_delay_s: truth.leader_delay_s,
            q_ref,
        }
    }
}

/// What the ECUs' laws said last, one value per truck, which no bus carries.
pub(super) struct Overheard {
    /// The bits of Q_ref.
    q_ref: Vec<Arc<AtomicU64>>,
}

impl Overheard {
    pub(super) fn of(trucks: usize) -> Self {
        let silent = || Arc::new(AtomicU64::new(f64::NAN.to_bits()));
        Self { q_ref: (0..trucks).map(|_| silent()).collect() }
    }

    /// The law of a truck, with an ear to it.
    pub(super) fn wrap(&self, truck: u8, law: Box<dyn Controller>) -> Box<dyn Controller> {
        let q_ref = Arc::clone(&self.q_ref[usize::from(truck)]);
        Box::new(Around::new(law, move |law, seen, mark| {
            let decision = law.step(seen, mark);
            q_ref.store(decision.lml.q_ref.to_bits(), Ordering::Relaxed);
            decision
        }))
    }

    fn q_ref(&self, truck: usize) -> f64 {
        f64::from_bits(self.q_ref[truck].load(Ordering::Relaxed))
    }
}

/// Follows one run.
pub(super) struct Sampler<'a> {
    overheard: &'a Overheard,
    sampling: Sampling,
    due_ns: u64,
    trajectory: Trajectory,
    /// When each obstacle appears \[s\]; `None` once it is there.
    awaited_s: Vec<Option<f64>>,
    spawn_clearance_m: Option<f64>,
}

impl<'a> Sampler<'a> {
    pub(super) fn new(cell: &Cell, overheard: &'a Overheard) -> Self {
        Self {
            overheard,
            sampling: cell.sampling,
            due_ns: 0,
            trajectory: Trajectory::new(),
            awaited_s: cell.scenario.obstacles.iter().map(|o| Some(o.appears_s)).collect(),
            spawn_clearance_m: None,
        }
    }

    /// Looks at the rig, at the start of a tick.
    pub(super) fn see(&mut self, rig: &Rig) {
        let time_s = rig.time_ns() as f64 * 1e-9;
        if self.awaited_s.iter().flatten().any(|&appears_s| time_s >= appears_s) {
            self.see_appearing(rig, time_s);
        }
        if let Sampling::Every(period_ns) = self.sampling
            && rig.time_ns() >= self.due_ns
        {
            self.due_ns += period_ns;
            self.sample(rig);
        }
    }

    pub(super) fn end(self) -> (Trajectory, Option<f64>) {
        (self.trajectory, self.spawn_clearance_m)
    }

    fn see_appearing(&mut self, rig: &Rig, time_s: f64) {
        for (awaited_s, obstacle) in self.awaited_s.iter_mut().zip(&rig.scenario().obstacles) {
            if awaited_s.take_if(|appears_s| time_s >= *appears_s).is_none() {
                continue;
            }
            let rectangle = obstacle.rectangle(&obstacle.motion(time_s));
            for truck in rig.trucks() {
                let clearance_m = truck.rectangle().clearance_m(&rectangle);
                let least_m = self.spawn_clearance_m.get_or_insert(clearance_m);
                *least_m = least_m.min(clearance_m);
            }
        }
    }

    fn sample(&mut self, rig: &Rig) {
        let truth = rig.truth();
        let truck = |(index, truck)| TruckMoment::new(truck, self.overheard.q_ref(index));
        let obstacle = |o: &ObstacleTruth| {
            let ObstacleTruth { x_m, y_m, length_m, width_m, .. } = *o;
            o.present.then_some(ObstacleMoment { x_m, y_m, length_m, width_m })
        };
        self.trajectory.push(Moment {
            time_s: truth.time_ns as f64 * 1e-9,
            trucks: truth.trucks.iter().enumerate().map(truck).collect(),
            obstacles: truth.obstacles.iter().map(obstacle).collect(),
        });
    }
}
