//! What the ECU believes about the world: the newest message of each kind, and how old it is.
//!
//! Ages are counted in bench time from the instant the sender measured, so transport and holding
//! count alike. A message is *fresh*, *stale* (still used, with its age) or *lost* (as if it had
//! never come). `Mission` does not age: a plan holds until the next one.

use law::dmpc::Plan;
use law::{Ego, OBSTACLES_MAX, Observation, Plans, V2v};
use platoon_dbc::{
    EgoState, Message, Mission, NavStatus, Obstacle, ObstacleKind, V2vState, V2vTrajectory,
};
use serde::{Deserialize, Serialize};

use crate::guard::{Object, OwnMotion};

/// Periods an `EgoState` stays fresh: two may be missing, as on a bus with a rare lost frame.
pub const EGO_FRESH_PERIODS: u64 = 3;
/// But never less than this \[ns\]: at 1 kHz the rig's own scheduling is late by milliseconds.
pub const EGO_FRESH_LEAST_NS: u64 = 5_000_000;
/// An `EgoState` older than this is lost \[ns\]: two metres at 20 m/s, as long as the guard holds.
pub const EGO_LOST_NS: u64 = 100_000_000;
/// A V2V state older than the delay the gain is designed for is stale \[ns\] [MCF, Table II: h₁].
pub const V2V_FRESH_NS: u64 = 250_000_000;
/// A V2V state older than this is lost \[ns\]: the longest delay plus a dozen lost messages.
pub const V2V_LOST_NS: u64 = 500_000_000;
/// A plan older than this is lost \[ns\]: half of the horizon it was made for.
pub const PLAN_LOST_NS: u64 = 1_000_000_000;
/// An obstacle is stale once one 50 ms report is missing \[ns\].
pub const OBSTACLE_FRESH_NS: u64 = 100_000_000;
/// An obstacle unseen for four reports is lost \[ns\].
pub const OBSTACLE_LOST_NS: u64 = 200_000_000;

/// Trucks a mission can name.
const TRUCKS_MAX: usize = 16;
/// `Obstacle::member` of what is no platoon truck.
const NO_MEMBER: u8 = 255;
/// The longest plausible loop period \[ns\], 10 Hz; a longer or zero one is refused.
const PERIOD_MAX_NS: u32 = 100_000_000;

/// How far a message may be trusted by its age.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Freshness {
    /// As recent as its cycle promises.
    Fresh,
    /// Late, still used.
    Stale,
    /// Too old, or never came.
    Lost,
}

impl Freshness {
    fn of(age_ns: u64, fresh_ns: u64, lost_ns: u64) -> Self {
        match age_ns {
            age if age <= fresh_ns => Self::Fresh,
            age if age <= lost_ns => Self::Stale,
            _ => Self::Lost,
        }
    }
}

/// What became of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Noted {
    /// It is the newest of its kind now.
    Used,
    /// The picture already holds a newer one.
    Outdated,
    /// It is not for this truck's ECU.
    NotMine,
}

/// The newest message of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    truck: u8,
    /// Bench time of the first navigation solution \[ns\].
    began_ns: Option<u64>,
    mission: Option<Mission>,
    ego: Option<EgoState>,
    /// By sender: a truck that is told to follow another one has heard it before.
    heard: [Option<V2vState>; TRUCKS_MAX],
    /// The plans they announced, likewise.
    plans: [Option<V2vTrajectory>; TRUCKS_MAX],
    obstacles: [Option<Obstacle>; OBSTACLES_MAX],
}

impl Picture {
    /// The empty picture of this truck; missions of other trucks are not for it.
    #[must_use]
    pub const fn new(truck: u8) -> Self {
        Self {
            truck,
            began_ns: None,
            mission: None,
            ego: None,
            heard: [None; TRUCKS_MAX],
            plans: [None; TRUCKS_MAX],
            obstacles: [None; OBSTACLES_MAX],
        }
    }

    /// The newest mission.
    #[must_use]
    pub const fn mission(&self) -> Option<&Mission> {
        self.mission.as_ref()
    }

    /// The newest navigation solution, however old.
    #[must_use]
    pub const fn ego(&self) -> Option<&EgoState> {
        self.ego.as_ref()
    }

    /// The loop's period \[ns\], from the mission.
    #[must_use]
    pub fn period_ns(&self) -> Option<u64> {
        self.mission.map(|mission| u64::from(mission.loop_period_ns))
    }

    /// Takes a sound message in.
    pub fn note(&mut self, message: &Message) -> Noted {
        match message {
            Message::EgoState(ego) => {
                self.began_ns.get_or_insert(ego.bench_time_ns);
                replace(&mut self.ego, ego, |held| held.bench_time_ns < ego.bench_time_ns)
            }
            Message::V2vState(state) => self.note_v2v(state),
            Message::V2vTrajectory(plan) => self.note_plan(plan),
            Message::Obstacle(obstacle) => self.note_obstacle(obstacle),
            Message::Mission(mission) => self.note_mission(mission),
            Message::Actuation(_)
            | Message::V2vOut(_)
            | Message::V2vTrajectoryOut(_)
            | Message::EcuStatus(_) => Noted::NotMine,
        }
    }

    fn note_mission(&mut self, mission: &Mission) -> Noted {
        let period_ok = (1..=PERIOD_MAX_NS).contains(&mission.loop_period_ns);
        if mission.truck_index != self.truck || !period_ok {
            return Noted::NotMine;
        }
        self.mission = Some(*mission);
        Noted::Used
    }

    fn note_v2v(&mut self, state: &V2vState) -> Noted {
        let older = |held: &V2vState| held.generation_time_ns < state.generation_time_ns;
        note_heard(self.truck, state.source_truck, &mut self.heard, state, older)
    }

    /// The same for announced plans.
    fn note_plan(&mut self, plan: &V2vTrajectory) -> Noted {
        let older = |held: &V2vTrajectory| held.generation_time_ns < plan.generation_time_ns;
        note_heard(self.truck, plan.source_truck, &mut self.plans, plan, older)
    }

    /// The newest state of a truck this one follows, unless it is lost.
    fn followed(&self, truck: u8, now_ns: u64) -> Option<V2vState> {
        let state = of_others(self.truck, truck, &self.heard)?;
        Some(state).filter(|state| v2v_freshness(state, now_ns) != Freshness::Lost)
    }

    fn note_obstacle(&mut self, obstacle: &Obstacle) -> Noted {
        let Some(held) = self.obstacles.get_mut(usize::from(obstacle.page)) else {
            return Noted::NotMine;
        };
        if obstacle.kind == ObstacleKind::None {
            // An empty page was measured at no particular time.
            *held = None;
            return Noted::Used;
        }
        replace(held, obstacle, |held| held.measured_time_ns <= obstacle.measured_time_ns)
    }

    /// How recent the navigation solution is at `now_ns`; one the sensor disowns is lost.
    #[must_use]
    pub fn ego_freshness(&self, now_ns: u64) -> Freshness {
        let (Some(ego), Some(period_ns)) = (&self.ego, self.period_ns()) else {
            return Freshness::Lost;
        };
        if ego.nav_status == NavStatus::Lost {
            return Freshness::Lost;
        }
        let fresh_ns = (EGO_FRESH_PERIODS * period_ns).max(EGO_FRESH_LEAST_NS);
        let age_ns = now_ns.saturating_sub(ego.bench_time_ns);
        Freshness::of(age_ns, fresh_ns, EGO_LOST_NS.max(fresh_ns))
    }

    /// What the guard needs to know about the truck's own motion at `now_ns`.
    #[must_use]
    pub fn own_motion(&self, now_ns: u64) -> OwnMotion {
        let Some(ego) = self.ego else {
            return OwnMotion::default();
        };
        let (sin, cos) = ego.heading_rad.sin_cos();
        OwnMotion {
            trusted: self.ego_freshness(now_ns) == Freshness::Fresh,
            time_ns: ego.bench_time_ns,
            x_m: ego.position_x_m,
            y_m: ego.position_y_m,
            forward_mps: ego.speed_forward_mps,
            left_mps: ego.speed_forward_mps * sin + ego.speed_lateral_mps * cos,
            left_mps2: ego.speed_forward_mps * ego.yaw_rate_radps,
        }
    }

    /// What the guard must not let the truck run into, by page: every object the sensors report
    /// now, trucks of the platoon like any other. What may be driven over is none.
    #[must_use]
    pub fn objects(&self, now_ns: u64) -> [Option<Object>; OBSTACLES_MAX] {
        self.obstacles.map(|held| {
            let is_solid =
                |held: &Obstacle| !matches!(held.kind, ObstacleKind::None | ObstacleKind::Bump);
            held.filter(|held| is_solid(held) && obstacle_is_alive(held, now_ns)).map(object)
        })
    }

    /// Everything the law may know at `now_ns`; `None` while the truck does not know where it is.
    #[must_use]
    pub fn observe(&self, now_ns: u64) -> Option<Observation> {
        let (mission, ego) = (self.mission?, self.ego?);
        if self.ego_freshness(now_ns) != Freshness::Fresh {
            return None;
        }
        let leader = self.followed(mission.leader_truck, now_ns);
        let predecessor = self.followed(mission.predecessor_truck, now_ns);
        let planned = |truck: u8| announced(of_others(self.truck, truck, &self.plans), now_ns);
        // Nobody has been heard at the start, for a delay's time; that is no sign of a dead radio.
        let is_early = mission.place > 0
            && self.began_ns.is_none_or(|began_ns| now_ns.saturating_sub(began_ns) < V2V_LOST_NS);
        let platoon = Platoon {
            leader: (mission.place > 0).then_some(mission.leader_truck),
            predecessor: (mission.place > 0).then_some(mission.predecessor_truck),
            own_x_m: ego.position_x_m,
            hears_leader: leader.is_some() || is_early,
            predecessor_x_m: match (predecessor, is_early) {
                (None, true) => Some(f64::NEG_INFINITY),
                (heard, _) => heard.map(|state| state.position_x_m),
            },
        };
        Some(Observation {
            time_ns: now_ns,
            ego: own_state(&ego),
            mission: plan(&mission),
            leader: leader.as_ref().map(broadcast),
            predecessor: predecessor.as_ref().map(broadcast),
            plans: Plans {
                leader: planned(mission.leader_truck),
                predecessor: planned(mission.predecessor_truck),
            },
            obstacles: self.obstacles.map(|held| {
                let obstacle = held.filter(|held| obstacle_is_alive(held, now_ns))?;
                seen_obstacle(&obstacle, &platoon)
            }),
        })
    }

    /// Writes the picture; the bytes used, `None` when they do not fit.
    #[must_use]
    pub fn save(&self, out: &mut [u8]) -> Option<usize> {
        postcard::to_slice(self, out).ok().map(|used| used.len())
    }

    /// The picture of this truck that [`save`](Self::save) wrote; `None` when it is damaged or
    /// another truck's.
    #[must_use]
    pub fn restore(truck: u8, bytes: &[u8]) -> Option<Self> {
        let (picture, rest) = postcard::take_from_bytes::<Self>(bytes).ok()?;
        (rest.is_empty() && picture.truck == truck).then_some(picture)
    }
}

/// Puts a radio message of truck `source` into its place, unless that is `own`.
fn note_heard<T: Copy>(
    own: u8,
    source: u8,
    places: &mut [Option<T>; TRUCKS_MAX],
    message: &T,
    older: impl Fn(&T) -> bool,
) -> Noted {
    match places.get_mut(usize::from(source)).filter(|_| source != own) {
        Some(held) => replace(held, message, older),
        None => Noted::NotMine,
    }
}

/// What truck `source` last sent; nothing for `own`, which a leader follows by name.
fn of_others<T: Copy>(own: u8, source: u8, places: &[Option<T>; TRUCKS_MAX]) -> Option<T> {
    places.get(usize::from(source)).copied().flatten().filter(|_| source != own)
}

/// Puts `message` into its place unless the held one is not `older`.
fn replace<T: Copy>(place: &mut Option<T>, message: &T, older: impl Fn(&T) -> bool) -> Noted {
    if place.as_ref().is_some_and(|held| !older(held)) {
        return Noted::Outdated;
    }
    *place = Some(*message);
    Noted::Used
}

fn v2v_freshness(state: &V2vState, now_ns: u64) -> Freshness {
    let age_ns = now_ns.saturating_sub(state.generation_time_ns);
    Freshness::of(age_ns, V2V_FRESH_NS, V2V_LOST_NS)
}

fn obstacle_is_alive(obstacle: &Obstacle, now_ns: u64) -> bool {
    let age_ns = now_ns.saturating_sub(obstacle.measured_time_ns);
    Freshness::of(age_ns, OBSTACLE_FRESH_NS, OBSTACLE_LOST_NS) != Freshness::Lost
}

/// This truck's place among the others, as far as it knows.
#[derive(Debug, Clone, Copy)]
struct Platoon {
    /// The truck that leads, and the one that this truck follows; none when it leads.
    leader: Option<u8>,
    predecessor: Option<u8>,
    own_x_m: f64,
    /// The leader's V2V lives.
    hears_leader: bool,
    /// Where the predecessor is, while its V2V lives or has not had time to be heard; `None` for a
    /// truck that leads.
    predecessor_x_m: Option<f64>,
}

impl Platoon {
    /// Whether keeping a distance to this truck is somebody's business already.
    ///
    /// Platoon trucks are kept apart by the coordination layer while their V2V lives; as obstacles
    /// besides they would push the platoon apart.
    /// - Leader and predecessor are looked after while their own V2V lives.
    /// - A truck ahead that is neither is the predecessor's business while that lives and is
    ///   between, whatever platoon it belongs to. Once the predecessor has passed it, or when there
    ///   is no predecessor, it is in this truck's way.
    /// - A truck behind looks after itself while it is there.
    fn looks_after(&self, obstacle: &Obstacle) -> bool {
        match obstacle.member {
            NO_MEMBER => false,
            member if Some(member) == self.predecessor => self.predecessor_x_m.is_some(),
            member if Some(member) == self.leader => self.hears_leader,
            _ if obstacle.position_x_m < self.own_x_m => true,
            _ => self.predecessor_x_m.is_some_and(|x_m| x_m < obstacle.position_x_m),
        }
    }
}

/// The obstacle for the law; `None` for an empty page and for a platoon truck that is looked after.
fn seen_obstacle(obstacle: &Obstacle, platoon: &Platoon) -> Option<law::Obstacle> {
    let kind = match obstacle.kind {
        ObstacleKind::None => return None,
        ObstacleKind::Vehicle => law::ObstacleKind::Vehicle,
        ObstacleKind::Pedestrian => law::ObstacleKind::Pedestrian,
        ObstacleKind::Bump => law::ObstacleKind::Bump,
        ObstacleKind::PlatoonTruck if platoon.looks_after(obstacle) => return None,
        ObstacleKind::PlatoonTruck => law::ObstacleKind::Vehicle,
    };
    Some(law::Obstacle {
        kind,
        time_ns: obstacle.measured_time_ns,
        x_m: obstacle.position_x_m,
        y_m: obstacle.position_y_m,
        vx_mps: obstacle.speed_x_mps,
        vy_mps: obstacle.speed_y_mps,
        length_m: obstacle.length_m,
        width_m: obstacle.width_m,
    })
}

/// The object as the guard wants it: its box along and across the road.
fn object(obstacle: Obstacle) -> Object {
    let (sin, cos) = obstacle.heading_rad.sin_cos();
    let (sin, cos) = (sin.abs(), cos.abs());
    Object {
        measured_ns: obstacle.measured_time_ns,
        x_m: obstacle.position_x_m,
        y_m: obstacle.position_y_m,
        x_mps: obstacle.speed_x_mps,
        y_mps: obstacle.speed_y_mps,
        half_length_m: 0.5 * (obstacle.length_m * cos + obstacle.width_m * sin),
        half_width_m: 0.5 * (obstacle.length_m * sin + obstacle.width_m * cos),
    }
}

fn own_state(ego: &EgoState) -> Ego {
    Ego {
        time_ns: ego.bench_time_ns,
        x_m: ego.position_x_m,
        y_m: ego.position_y_m,
        heading_rad: ego.heading_rad,
        forward_mps: ego.speed_forward_mps,
        lateral_mps: ego.speed_lateral_mps,
        yaw_radps: ego.yaw_rate_radps,
        accel_mps2: ego.accel_forward_mps2,
    }
}

fn plan(mission: &Mission) -> law::Mission {
    law::Mission {
        truck: mission.place,
        trucks: mission.platoon_size,
        leader: mission.leader_truck,
        predecessor: mission.predecessor_truck,
        spacing_m: mission.spacing_m,
        leader_distance_m: mission.leader_distance_m,
        set_speed_mps: mission.set_speed_mps,
        desired_y_m: mission.desired_y_m,
        lane_width_m: mission.lane_width_m,
        right_edge_y_m: mission.right_edge_y_m,
        left_edge_y_m: mission.left_edge_y_m,
    }
}

/// A plan that is not lost.
fn announced(heard: Option<V2vTrajectory>, now_ns: u64) -> Option<Plan> {
    let heard = heard?;
    let is_lost = now_ns.saturating_sub(heard.generation_time_ns) > PLAN_LOST_NS;
    let plan = Plan::from_speeds(heard.generation_time_ns, heard.position_x_m, &heard.speed_mps);
    (!is_lost).then_some(plan)
}

fn broadcast(state: &V2vState) -> V2v {
    V2v {
        generated_ns: state.generation_time_ns,
        x_m: state.position_x_m,
        y_m: state.position_y_m,
        speed_mps: state.speed_mps,
        accel_mps2: state.accel_mps2,
        intended_accel_mps2: state.intended_accel_mps2,
    }
}

#[cfg(test)]
mod tests;
