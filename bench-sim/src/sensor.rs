//! What a truck perceives: its own navigation solution, and the things around it.
//!
//! Noise is that of a fused navigation solution (inertial unit and satellite receiver): first-order
//! correlated over 0.5 s, position 1 cm, speed 0.01 m/s, acceleration 0.05 m/s², all times
//! `sensors.noise` (0 switches it off). Objects are reported with the same position and speed
//! noise. Numbers are ours.

use platoon_dbc::{EgoState, NavStatus, Obstacle as ObstacleMessage, ObstacleKind};

use crate::noise::{Correlated, Dice, Stream};
use crate::obstacle::{Kind, Motion, Obstacle};
use crate::scenario::Sensors;
use crate::truck::{FRONT_OVERHANG_M, REAR_OVERHANG_M, Truck, TruckState, WIDTH_M};

/// Position noise at `sensors.noise = 1`, each axis \[m\].
const POSITION_SIGMA_M: f64 = 0.01;
/// Speed noise at `sensors.noise = 1`, each axis \[m/s\].
const SPEED_SIGMA_MPS: f64 = 0.01;
/// Acceleration noise at `sensors.noise = 1` \[m/s²\].
const ACCEL_SIGMA_MPS2: f64 = 0.05;

/// Objects a truck reports at most: as many as `platoon.dbc` has pages.
pub(crate) const PAGES: usize = 8;

/// `Member` of an object that is no platoon truck.
const NO_MEMBER: u8 = 255;

/// A truck's state at one point of the loop's grid.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Snapshot {
    pub(crate) tick: u32,
    pub(crate) time_ns: u64,
    pub(crate) state: TruckState,
    pub(crate) accel_mps2: f64,
}

/// The navigation solution of one truck.
#[derive(Debug, Clone)]
pub(crate) struct Navigation {
    /// X, Y, forward speed, lateral speed, forward acceleration.
    noise: Correlated<5>,
    last_ns: u64,
}

impl Navigation {
    pub(crate) fn new(sensors: &Sensors, seed: u64, truck: usize) -> Self {
        let (p, v) = (POSITION_SIGMA_M, SPEED_SIGMA_MPS);
        let sigma = [p, p, v, v, ACCEL_SIGMA_MPS2].map(|sigma| sigma * sensors.noise);
        let dice = Dice::new(seed, Stream::Navigation { truck });
        Self { noise: Correlated::new(dice, sigma), last_ns: 0 }
    }

    /// The solution for a snapshot; snapshots come in order of time.
    pub(crate) fn solve(&mut self, seen: &Snapshot) -> EgoState {
        self.noise.advance(seen.time_ns.saturating_sub(self.last_ns) as f64 * 1e-9);
        self.last_ns = seen.time_ns;
        let [x_m, y_m, forward_mps, lateral_mps, accel_mps2] = *self.noise.value();
        EgoState {
            tick: seen.tick,
            bench_time_ns: seen.time_ns,
            position_x_m: seen.state.x_m + x_m,
            position_y_m: seen.state.y_m + y_m,
            heading_rad: libm::remainder(seen.state.heading_rad, core::f64::consts::TAU),
            speed_forward_mps: seen.state.forward_mps + forward_mps,
            speed_lateral_mps: seen.state.lateral_mps + lateral_mps,
            yaw_rate_radps: seen.state.yaw_radps,
            accel_forward_mps2: seen.accel_mps2 + accel_mps2,
            nav_status: NavStatus::Valid,
        }
    }
}

/// Everything there is to be seen at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    pub(crate) time_ns: u64,
    pub(crate) trucks: &'a [Truck],
    pub(crate) obstacles: &'a [Obstacle],
}

/// A thing that can be reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Target {
    /// Obstacle by its place in the scenario.
    Obstacle(usize),
    /// Platoon truck by its index.
    Truck(usize),
}

/// Up to a page per target, nearest first.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    found: [(f64, Target); PAGES],
    count: usize,
}

/// The object sensor of one truck: which target is on which page.
///
/// It looks `range_m` ahead and `behind_m` back for obstacles, and `range_m` ahead for other
/// trucks of the platoon. With more targets than pages the nearest are reported. A target keeps
/// its page while it is reported; a page whose target is gone is sent once as empty.
#[derive(Debug, Clone)]
pub(crate) struct Detector {
    truck: usize,
    range_m: f64,
    behind_m: f64,
    pages: [Option<Target>; PAGES],
    /// X, Y, speed along X, speed along Y.
    noise: [Correlated<4>; PAGES],
    last_ns: u64,
}

impl Detector {
    pub(crate) fn new(sensors: &Sensors, seed: u64, truck: usize) -> Self {
        let (p, v) = (POSITION_SIGMA_M, SPEED_SIGMA_MPS);
        let sigma = [p, p, v, v].map(|sigma| sigma * sensors.noise);
        let noise = |page| Correlated::new(Dice::new(seed, Stream::Target { truck, page }), sigma);
        Self {
            truck,
            range_m: sensors.range_m,
            behind_m: sensors.behind_m,
            pages: [None; PAGES],
            noise: core::array::from_fn(noise),
            last_ns: 0,
        }
    }

    /// Looks around and reports every page in use, and every page that just became empty.
    pub(crate) fn scan(&mut self, seen: &Surroundings, mut report: impl FnMut(ObstacleMessage)) {
        let elapsed_s = seen.time_ns.saturating_sub(self.last_ns) as f64 * 1e-9;
        self.last_ns = seen.time_ns;
        let nearest = self.nearest(seen);
        for page in 0..PAGES {
            self.noise[page].advance(elapsed_s);
            if self.pages[page].is_some_and(|target| !nearest.holds(target)) {
                self.pages[page] = None;
                report(empty_page(page, seen.time_ns));
            }
        }
        for target in nearest.targets() {
            self.assign(target);
        }
        for page in 0..PAGES {
            if let Some(target) = self.pages[page] {
                report(self.measure(page, target, seen));
            }
        }
    }

    /// Gives a target a free page, unless it has one.
    fn assign(&mut self, target: Target) {
        if self.pages.contains(&Some(target)) {
            return;
        }
        if let Some(page) = self.pages.iter().position(Option::is_none) {
            self.pages[page] = Some(target);
            self.noise[page].restart();
        }
    }

    fn nearest(&self, seen: &Surroundings) -> Nearest {
        let mut nearest = Nearest::new();
        let time_s = seen.time_ns as f64 * 1e-9;
        for (index, obstacle) in seen.obstacles.iter().enumerate() {
            let motion = obstacle.motion(time_s);
            let ahead_m = self.ahead_m(seen, (motion.x_m, motion.y_m));
            if obstacle.present(time_s) && ahead_m >= -self.behind_m && ahead_m <= self.range_m {
                nearest.offer(ahead_m.abs(), Target::Obstacle(index));
            }
        }
        for (index, truck) in seen.trucks.iter().enumerate() {
            let ahead_m = self.ahead_m(seen, truck.rectangle().centre_m());
            if index != self.truck && ahead_m > 0.0 && ahead_m <= self.range_m {
                nearest.offer(ahead_m, Target::Truck(index));
            }
        }
        nearest
    }

    /// How far a point lies ahead of this truck's CG, along its heading \[m\].
    fn ahead_m(&self, seen: &Surroundings, (x_m, y_m): (f64, f64)) -> f64 {
        let own = seen.trucks[self.truck].state();
        let (cos, sin) = (libm::cos(own.heading_rad), libm::sin(own.heading_rad));
        (x_m - own.x_m) * cos + (y_m - own.y_m) * sin
    }

    fn measure(&self, page: usize, target: Target, seen: &Surroundings) -> ObstacleMessage {
        let [x_m, y_m, x_mps, y_mps] = *self.noise[page].value();
        let truth = target.truth(seen);
        ObstacleMessage {
            position_x_m: truth.position_x_m + x_m,
            position_y_m: truth.position_y_m + y_m,
            speed_x_mps: truth.speed_x_mps + x_mps,
            speed_y_mps: truth.speed_y_mps + y_mps,
            page: page as u8,
            ..truth
        }
    }
}

impl Nearest {
    fn new() -> Self {
        Self { found: [(f64::INFINITY, Target::Obstacle(usize::MAX)); PAGES], count: 0 }
    }

    /// Keeps a target if it is among the nearest.
    fn offer(&mut self, distance_m: f64, target: Target) {
        let place = self.found[..self.count].partition_point(|&(d, _)| d <= distance_m);
        if place == PAGES {
            return;
        }
        self.count = (self.count + 1).min(PAGES);
        self.found[place..self.count].rotate_right(1);
        self.found[place] = (distance_m, target);
    }

    fn targets(&self) -> impl Iterator<Item = Target> {
        self.found[..self.count].iter().map(|&(_, target)| target)
    }

    fn holds(&self, target: Target) -> bool {
        self.targets().any(|found| found == target)
    }
}

impl Target {
    /// The noise-free report of this target, on no page yet.
    fn truth(self, seen: &Surroundings) -> ObstacleMessage {
        let report = empty_page(0, seen.time_ns);
        match self {
            Self::Obstacle(index) => {
                let obstacle = &seen.obstacles[index];
                let motion = obstacle.motion(seen.time_ns as f64 * 1e-9);
                ObstacleMessage {
                    kind: reported_kind(obstacle.kind),
                    length_m: obstacle.length_m,
                    width_m: obstacle.width_m,
                    ..placed(report, &motion, motion.heading_rad())
                }
            }
            Self::Truck(index) => {
                let truck = &seen.trucks[index];
                let ((x_m, y_m), (x_mps, y_mps)) =
                    (truck.rectangle().centre_m(), truck.road_velocity_mps());
                let heading_rad =
                    libm::remainder(truck.state().heading_rad, core::f64::consts::TAU);
                ObstacleMessage {
                    kind: ObstacleKind::PlatoonTruck,
                    member: index as u8,
                    length_m: FRONT_OVERHANG_M + REAR_OVERHANG_M,
                    width_m: WIDTH_M,
                    ..placed(report, &Motion { x_m, y_m, x_mps, y_mps }, heading_rad)
                }
            }
        }
    }
}

fn placed(report: ObstacleMessage, motion: &Motion, heading_rad: f64) -> ObstacleMessage {
    ObstacleMessage {
        position_x_m: motion.x_m,
        position_y_m: motion.y_m,
        speed_x_mps: motion.x_mps,
        speed_y_mps: motion.y_mps,
        heading_rad,
        ..report
    }
}

fn empty_page(page: usize, time_ns: u64) -> ObstacleMessage {
    ObstacleMessage {
        page: page as u8,
        kind: ObstacleKind::None,
        member: NO_MEMBER,
        measured_time_ns: time_ns,
        position_x_m: 0.0,
        position_y_m: 0.0,
        speed_x_mps: 0.0,
        speed_y_mps: 0.0,
        heading_rad: 0.0,
        length_m: 0.0,
        width_m: 0.0,
    }
}

fn reported_kind(kind: Kind) -> ObstacleKind {
    match kind {
        Kind::Vehicle => ObstacleKind::Vehicle,
        Kind::Pedestrian => ObstacleKind::Pedestrian,
        Kind::Bump => ObstacleKind::Bump,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truck::TruckParameters;

    fn van(x_m: f64, appears_s: f64) -> Obstacle {
        Obstacle {
            kind: Kind::Vehicle,
            x_m,
            y_m: 0.0,
            speed_mps: 0.0,
            appears_s,
            length_m: 6.0,
            width_m: 2.2,
            lane_change: Vec::new(),
            speed_change: Vec::new(),
        }
    }

    fn trucks(positions_m: &[f64]) -> Vec<Truck> {
        let truck = |&x_m: &f64| Truck::new(TruckParameters::default(), x_m, 0.0, 0.0);
        positions_m.iter().map(truck).collect()
    }

    fn scan(
        detector: &mut Detector,
        time_ns: u64,
        trucks: &[Truck],
        obstacles: &[Obstacle],
    ) -> Vec<ObstacleMessage> {
        let mut reports = Vec::new();
        detector.scan(&Surroundings { time_ns, trucks, obstacles }, |report| reports.push(report));
        reports
    }

    #[test]
    fn obstacles_are_seen_within_range_while_present_and_until_far_behind() {
        let trucks = trucks(&[0.0]);
        let mut detector = Detector::new(&Sensors::default(), 1, 0);
        let obstacles =
            [van(80.0, 0.0), van(80.1, 0.0), van(-30.0, 0.0), van(-30.1, 0.0), van(5.0, 9.0)];
        let seen = scan(&mut detector, 0, &trucks, &obstacles);
        let places: Vec<f64> = seen.iter().map(|report| report.position_x_m).collect();
        assert_eq!(places, [-30.0, 80.0]);
    }

    #[test]
    fn a_leaving_obstacle_is_sent_once_as_none_and_others_keep_their_page() {
        let trucks = trucks(&[0.0]);
        let mut detector = Detector::new(&Sensors::default(), 1, 0);
        let both = scan(&mut detector, 0, &trucks, &[van(10.0, 0.0), van(20.0, 0.0)]);
        assert_eq!(both.len(), 2);
        let left = [van(10.0, 99.0), van(20.0, 0.0)];
        let after = scan(&mut detector, 1, &trucks, &left);
        assert_eq!((after[0].page, after[0].kind), (both[0].page, ObstacleKind::None));
        assert_eq!((after[1].page, after[1].position_x_m), (both[1].page, 20.0));
        assert_eq!(scan(&mut detector, 2, &trucks, &left).len(), 1);
    }

    #[test]
    fn platoon_trucks_ahead_are_reported_as_members_by_their_box() {
        let trucks = trucks(&[100.0, 50.0, 0.0]);
        let seen = |truck| {
            let mut detector = Detector::new(&Sensors::default(), 1, truck);
            scan(&mut detector, 0, &trucks, &[])
        };
        assert!(seen(0).is_empty());
        let by_last = seen(2);
        assert_eq!(by_last.len(), 1);
        assert_eq!((by_last[0].kind, by_last[0].member), (ObstacleKind::PlatoonTruck, 1));
        assert!((by_last[0].position_x_m - (50.0 - 1.545)).abs() < 1e-12);
    }

    #[test]
    fn of_too_many_targets_the_nearest_are_reported() {
        let trucks = trucks(&[0.0]);
        let mut detector = Detector::new(&Sensors::default(), 1, 0);
        let many: Vec<_> = (1..=12).rev().map(|k| van(f64::from(k) * 5.0, 0.0)).collect();
        let mut seen: Vec<_> =
            scan(&mut detector, 0, &trucks, &many).iter().map(|r| r.position_x_m).collect();
        seen.sort_by(f64::total_cmp);
        assert_eq!(seen, [5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0]);
    }

    #[test]
    fn noise_is_off_by_default_and_scales() {
        let snapshot = Snapshot { time_ns: 1_000_000, ..Snapshot::default() };
        let solve = |noise| {
            let sensors = Sensors { noise, ..Sensors::default() };
            Navigation::new(&sensors, 5, 0).solve(&snapshot).position_x_m
        };
        assert_eq!(solve(0.0), 0.0);
        assert!(solve(1.0) != 0.0 && (solve(2.0) / solve(1.0) - 2.0).abs() < 1e-12);
    }
}
