//! The rig: trucks, obstacles, radio and one CAN node per truck, advanced in base steps.
//!
//! A base step is at most 1 ms and divides the loop period. One step:
//!
//! ```text
//! drain every bus -> age the commands -> integrate -> measure -> publish what is due
//! ```
//!
//! Whoever is late advances several steps at once: all are integrated and measured, and only the
//! latest state is published. In virtual time the caller alternates [`Rig::step`] and the ECUs'
//! ticks; in real time [`run`] paces the rig. Same scenario, seed and ECU answers give the same
//! frames, bit for bit.
//!
//! Start-up: [`Rig::invite`] until [`Rig::ready`], then [`Rig::start`], which publishes tick 0 at
//! bench time 0. [`Rig::end`] tells the ECUs that it is over.

mod publish;
mod realtime;
mod results;
#[cfg(test)]
mod tests;

use platoon_dbc::{Bus, EcuMode, Message, Profile, RunState, V2vState, V2vTrajectory, Vehicle};
use traces::Recorder;

use crate::channel::Channel;
use crate::metrics::{Metrics, Sample};
use crate::obstacle::Obstacle;
use crate::roster::{Place, Roster};
use crate::scenario::Scenario;
use crate::sensor::{Detector, Navigation, Snapshot};
use crate::truck::{Command, Truck};
use crate::truck_node::{Tap, TruckNode};

pub use realtime::{Progress, RunEnd, RunError, RunOptions, RunReport, run};
pub use results::{IdentifierResult, Results, WireResult};

/// Longest base step \[ns\].
const BASE_STEP_MAX_NS: u64 = 1_000_000;
/// Slowest loop \[Hz\].
const RATE_MIN_HZ: u32 = 10;
/// Fastest loop \[Hz\].
const RATE_MAX_HZ: u32 = 10_000;

/// Why a rig cannot be built.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RigError {
    /// Every truck needs a bus of its own.
    #[error("the scenario has {trucks} trucks and {buses} buses: give one bus per truck")]
    Buses {
        /// Trucks of the scenario.
        trucks: usize,
        /// Buses given.
        buses: usize,
    },
    /// The loop rate cannot be had.
    #[error("a loop rate of {rate_hz} Hz is impossible: allowed is {RATE_MIN_HZ} to {RATE_MAX_HZ}")]
    Rate {
        /// The rate asked for \[Hz\].
        rate_hz: u32,
    },
}

/// The base step and how many of them make a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Grid {
    step_ns: u64,
    steps_per_tick: u64,
}

impl Grid {
    /// The coarsest grid of at most 1 ms for a loop rate. A rate whose period is no whole number
    /// of nanoseconds per step runs a few nanoseconds per tick fast.
    fn new(rate_hz: u32) -> Self {
        let period_ns = 1_000_000_000 / u64::from(rate_hz);
        let steps_per_tick = period_ns.div_ceil(BASE_STEP_MAX_NS);
        Self { step_ns: period_ns / steps_per_tick, steps_per_tick }
    }

    fn tick_ns(&self) -> u64 {
        self.step_ns * self.steps_per_tick
    }
}

/// When the cyclic publications are due next \[ns\].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Due {
    obstacles_ns: u64,
    mission_ns: u64,
    truth_ns: u64,
    leader_ns: u64,
    leader_plan_ns: u64,
}

/// The test bench. See the module's description.
pub struct Rig {
    scenario: Scenario,
    seed: u64,
    grid: Grid,
    trucks: Vec<Truck>,
    roster: Roster,
    /// What every truck is to do now.
    places: Vec<Place>,
    commands: Vec<Command>,
    nodes: Vec<TruckNode>,
    navigation: Vec<Navigation>,
    detectors: Vec<Detector>,
    snapshots: Vec<Snapshot>,
    channel: Channel<V2vState>,
    /// The same links for announced trajectories: as late and as lossy.
    plans: Channel<V2vTrajectory>,
    metrics: Metrics,
    tap: Tap,
    due: Due,
    steps: u64,
    published: Option<u32>,
    run_state: RunState,
}

impl Rig {
    /// A rig at the start of a scenario; bus i is truck i's.
    ///
    /// Equal seeds give equal V2V delays, losses and sensor noise. The recorder takes every frame
    /// from [`Rig::start`] on (and, on buses that echo, those before it, as at bench time 0), and
    /// the world's truth every 10 ms of bench time.
    ///
    /// # Errors
    /// When the number of buses is not the number of trucks, or the loop rate is impossible.
    pub fn new(
        scenario: &Scenario,
        seed: u64,
        loop_rate_hz: u32,
        buses: Vec<Box<dyn Bus>>,
        recorder: Option<Recorder>,
    ) -> Result<Self, RigError> {
        let count = scenario.platoon.trucks;
        if buses.len() != count {
            return Err(RigError::Buses { trucks: count, buses: buses.len() });
        }
        if !(RATE_MIN_HZ..=RATE_MAX_HZ).contains(&loop_rate_hz) {
            return Err(RigError::Rate { rate_hz: loop_rate_hz });
        }
        let grid = Grid::new(loop_rate_hz);
        let keeps_early = buses.iter().any(|bus| bus.echoes());
        let node = |(truck, bus)| {
            let mut node = TruckNode::new(truck, bus, grid.tick_ns());
            node.has_ecu = scenario.has_ecu(truck);
            node
        };
        let sources = scenario.v2v_sources();
        let mut rig = Self {
            trucks: (0..count).map(|truck| truck_at_start(scenario, truck)).collect(),
            roster: Roster::new(scenario),
            places: vec![Place::default(); count],
            commands: vec![Command::default(); count],
            nodes: buses.into_iter().enumerate().map(node).collect(),
            navigation: (0..count).map(|t| Navigation::new(&scenario.sensors, seed, t)).collect(),
            detectors: (0..count).map(|t| Detector::new(&scenario.sensors, seed, t)).collect(),
            snapshots: vec![Snapshot::default(); count],
            channel: Channel::new(&scenario.v2v, &sources, grid.step_ns, seed),
            plans: Channel::new(&scenario.v2v, &sources, grid.step_ns, seed),
            metrics: Metrics::new(scenario),
            tap: Tap::new(recorder, keeps_early),
            due: Due::default(),
            steps: 0,
            published: None,
            run_state: RunState::Preparing,
            scenario: scenario.clone(),
            seed,
            grid,
        };
        rig.call_the_roll();
        Ok(rig)
    }

    /// The same rig on buses that carry their messages as another profile does.
    #[must_use]
    pub fn speaking(mut self, profile: Profile) -> Self {
        for (node, truck) in self.nodes.iter_mut().zip(&self.trucks) {
            let vehicle = Vehicle { mass_kg: truck.mass_kg(), ..Vehicle::default() };
            node.speak(profile, vehicle);
        }
        self
    }

    /// Sends every ECU its mission, with the run still being prepared. To be repeated every 100 ms.
    pub fn invite(&mut self) {
        self.run_state = RunState::Preparing;
        self.publish_mission();
    }

    /// Reads the buses; true once every ECU has said that it is ready.
    pub fn ready(&mut self) -> bool {
        self.listen();
        self.silent_trucks().next().is_none()
    }

    /// Reads the buses outside of the run: what is said there is recorded, but moves no truck.
    pub fn listen(&mut self) {
        for node in &mut self.nodes {
            node.drain(&mut self.tap, |_| {});
        }
    }

    /// Trucks whose ECU has not said yet that it is ready.
    pub fn silent_trucks(&self) -> impl Iterator<Item = usize> {
        let ready =
            |mode: &Option<EcuMode>| matches!(mode, Some(EcuMode::Ready | EcuMode::Running));
        let silent = move |node: &TruckNode| node.has_ecu && !ready(&node.ecu_mode);
        self.nodes.iter().enumerate().filter(move |(_, node)| silent(node)).map(|(truck, _)| truck)
    }

    /// Whether every ECU has said that it ended, and no echo is still to come.
    fn is_silent(&self) -> bool {
        let over = |node: &TruckNode| !node.has_ecu || node.ecu_mode == Some(EcuMode::Ended);
        self.nodes.iter().all(|node| over(node) && !node.is_waiting())
    }

    /// Tells every bus that it is this late \[ns of bench time\]: emulated ones carry their frames.
    pub fn service(&mut self, time_ns: u64) {
        for node in &mut self.nodes {
            node.service(time_ns);
        }
    }

    /// Starts the run: bench time 0, mission running, tick 0. What came before is forgotten.
    pub fn start(&mut self) {
        for node in &mut self.nodes {
            node.begin(self.grid.tick_ns());
        }
        self.tap.open();
        self.run_state = RunState::Running;
        self.measure();
        self.take_snapshots();
        self.publish_mission();
        self.publish();
    }

    /// Advances the rig by one base step.
    pub fn step(&mut self) {
        self.advance(1);
    }

    /// Advances the rig by `steps` base steps after one look at the buses, and publishes what is
    /// due at the end of them. Stops at the end of the scenario.
    pub fn advance(&mut self, steps: u64) {
        self.service(self.time_ns() + steps * self.grid.step_ns);
        self.drain();
        let left = self.steps_total().saturating_sub(self.steps);
        let steps = steps.min(left);
        if steps == 0 {
            return;
        }
        for node in &mut self.nodes {
            node.age(steps * self.grid.step_ns);
        }
        for _ in 0..steps {
            self.integrate();
            self.measure();
        }
        self.publish();
    }

    /// Tells every ECU that the run is over.
    pub fn end(&mut self) {
        self.run_state = RunState::Ended;
        self.publish_mission();
        for node in &mut self.nodes {
            node.end();
        }
    }

    /// Bench time \[ns\].
    pub fn time_ns(&self) -> u64 {
        self.steps * self.grid.step_ns
    }

    /// Newest tick published.
    pub fn tick(&self) -> u32 {
        self.tap.tick
    }

    /// Base steps taken.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Length of a base step \[ns\].
    pub fn base_step_ns(&self) -> u64 {
        self.grid.step_ns
    }

    /// Base steps per tick of the loop.
    pub fn steps_per_tick(&self) -> u64 {
        self.grid.steps_per_tick
    }

    /// Whether the scenario is over.
    pub fn finished(&self) -> bool {
        self.steps >= self.steps_total()
    }

    /// The scenario being run.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// The trucks, leader first.
    pub fn trucks(&self) -> &[Truck] {
        &self.trucks
    }

    /// The bus of a truck.
    pub fn bus(&self, truck: usize) -> &dyn Bus {
        self.nodes[truck].bus()
    }

    /// Gives the recorder back, to be finished.
    pub fn take_recorder(&mut self) -> Option<Recorder> {
        for node in &mut self.nodes {
            node.give_up_waiting(&mut self.tap);
        }
        self.tap.recorder.take()
    }

    fn steps_total(&self) -> u64 {
        self.scenario.duration_ns().div_ceil(self.grid.step_ns)
    }

    fn obstacles(&self) -> &[Obstacle] {
        &self.scenario.obstacles
    }

    /// Reads every bus; commands go to the trucks, broadcasts to the channel.
    fn drain(&mut self) {
        self.tap.time_ns = self.time_ns();
        for (truck, node) in self.nodes.iter_mut().enumerate() {
            let (channel, plans, now_ns) = (&mut self.channel, &mut self.plans, self.tap.time_ns);
            node.drain(&mut self.tap, |message| match message {
                Message::V2vOut(heard) => {
                    let generated_ns = heard.generation_time_ns;
                    channel.broadcast(truck, generated_ns, now_ns, publish::relayed(truck, heard));
                }
                Message::V2vTrajectoryOut(heard) => {
                    let generated_ns = heard.generation_time_ns;
                    plans.broadcast(
                        truck,
                        generated_ns,
                        now_ns,
                        publish::relayed_plan(truck, heard),
                    );
                }
                _ => {}
            });
        }
    }

    fn integrate(&mut self) {
        let step_ns = self.grid.step_ns;
        for (truck, (node, command)) in
            self.trucks.iter_mut().zip(self.nodes.iter_mut().zip(&mut self.commands))
        {
            *command = node.watch.command(truck, step_ns);
            truck.step(command, step_ns as f64 * 1e-9);
        }
        self.steps += 1;
        self.tap.time_ns = self.time_ns();
        self.call_the_roll();
        if self.steps.is_multiple_of(self.grid.steps_per_tick) {
            self.take_snapshots();
        }
    }

    /// Finds out what every truck is to do now; a change is told at once, and while it goes on.
    fn call_the_roll(&mut self) {
        let (time_ns, trucks) = (self.time_ns(), &self.trucks);
        let time_s = time_ns as f64 * 1e-9;
        if self.roster.advance(time_s, |truck| trucks[truck].state().x_m) {
            self.due.mission_ns = time_ns;
        }
        self.roster.places(time_s, &mut self.places);
    }

    fn measure(&mut self) {
        let time_ns = self.time_ns();
        self.metrics.sample(&Sample {
            time_ns,
            trucks: &self.trucks,
            places: &self.places,
            commands: &self.commands,
            obstacles: &self.scenario.obstacles,
        });
        if time_ns >= self.due.truth_ns {
            self.record_truth();
            self.due.truth_ns += publish::TRUTH_PERIOD_NS;
        }
    }

    fn take_snapshots(&mut self) {
        let tick = (self.steps / self.grid.steps_per_tick) as u32;
        for (snapshot, truck) in self.snapshots.iter_mut().zip(&self.trucks) {
            *snapshot = Snapshot {
                tick,
                time_ns: self.steps * self.grid.step_ns,
                state: *truck.state(),
                accel_mps2: truck.acceleration().forward_mps2,
            };
        }
    }
}

fn truck_at_start(scenario: &Scenario, truck: usize) -> Truck {
    let start = scenario.start(truck);
    Truck::new(scenario.truck(truck), start.x_m, start.y_m, start.speed_mps)
}
