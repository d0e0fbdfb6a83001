//! Trucks on the plant Theorem 1 assumes: a' = (u - a)/tau, tau = 0.45 s, spacing 20 m, leader from
//! 20 to 22 m/s at 2 m/s² between 1 s and 2 s (Zheng et al. 2016).

use super::*;
use crate::observation::{Ego, Mission, Plans, V2v};

pub const FOLLOWERS: usize = 3;
const TAU_S: f64 = 0.45;
const SPACING_M: f64 = 20.0;
const MS: u64 = 1_000_000;
/// How long a run lasts \[ms\].
const DURATION_MS: usize = 12_000;
/// From when on the trucks are to be in their slots \[ms\].
const SETTLED_MS: usize = 6_000;
/// Messages kept on their way: more than any delay and period here.
const SLOTS: usize = 512;

/// How late messages are, in ms, for one follower.
#[derive(Clone, Copy)]
pub enum Delay {
    Constant(usize),
    /// Between 50 and 150 ms, changing by at most 0.2 s/s, each follower its own.
    Random(u64),
}

/// The string of trucks, its radio and its law.
#[derive(Clone, Copy)]
pub struct Setup {
    pub cal: UclCalibration,
    pub delay: Delay,
    /// Time between two messages of a truck \[ms\].
    pub message_period_ms: usize,
}

/// What a run showed.
pub struct Run {
    /// Largest |error to the predecessor| of each follower \[m\].
    pub peak_m: [f64; FOLLOWERS],
    /// Error to the leader at the end \[m\].
    pub last_m: [f64; FOLLOWERS],
    /// Largest |error to the leader| from 6 s on, any follower's \[m\].
    pub settled_m: f64,
    /// Error to the predecessor at the end \[m\].
    pub last_gap_m: [f64; FOLLOWERS],
    /// Highest speed of a follower \[m/s\].
    pub speed_max_mps: f64,
}

#[derive(Clone, Copy)]
struct Vehicle {
    x_m: f64,
    speed_mps: f64,
    accel_mps2: f64,
    intended_mps2: f64,
}

impl Vehicle {
    fn message(&self, time_ns: u64) -> V2v {
        V2v {
            generated_ns: time_ns,
            x_m: self.x_m,
            speed_mps: self.speed_mps,
            accel_mps2: self.accel_mps2,
            intended_accel_mps2: self.intended_mps2,
            ..V2v::default()
        }
    }

    /// Exact for a command held over the step.
    fn answer(&mut self, command_mps2: f64, dt_s: f64) {
        let before = self.accel_mps2;
        self.accel_mps2 = command_mps2 + (before - command_mps2) * libm::exp(-dt_s / TAU_S);
        self.intended_mps2 = command_mps2;
        self.move_on(0.5 * (before + self.accel_mps2), dt_s);
    }

    fn move_on(&mut self, accel_mps2: f64, dt_s: f64) {
        self.x_m += dt_s * (self.speed_mps + 0.5 * dt_s * accel_mps2);
        self.speed_mps += dt_s * accel_mps2;
    }
}

impl Delay {
    /// The delay of follower `i`'s messages at `k` ms \[ms\].
    fn at(self, i: usize, k: usize) -> usize {
        let seed = match self {
            Self::Constant(delay_ms) => return delay_ms,
            Self::Random(seed) => seed,
        };
        // Straight lines between knots every 500 ms, and at most 100 ms apart: 0.2 s/s.
        let knot = |n: usize| {
            let mut x = seed.wrapping_mul(1_000_003) ^ (1000 * n + i) as u64;
            // SplitMix64.
            x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
            x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            50.0 + 100.0 * ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
        };
        let (n, share) = (k / 500, (k % 500) as f64 / 500.0);
        libm::round(knot(n) + share * (knot(n + 1) - knot(n))) as usize
    }
}

/// Runs the platoon for 12 s.
pub fn run_platoon(setup: &Setup) -> Run {
    // Theorem 1 knows no actuator limits.
    let cal = UclCalibration { accel_min_mps2: -100.0, accel_max_mps2: 100.0, ..setup.cal };
    let mut vehicles: [Vehicle; FOLLOWERS + 1] = core::array::from_fn(|i| Vehicle {
        x_m: -SPACING_M * i as f64,
        speed_mps: 20.0,
        accel_mps2: 0.0,
        intended_mps2: 0.0,
    });
    let mut air = [[V2v::default(); FOLLOWERS + 1]; SLOTS];
    let mut memories = [Memory::new(); FOLLOWERS];
    let mut run = Run::new();
    for k in 0..DURATION_MS {
        let now_ns = k as u64 * MS;
        air[k % SLOTS] = core::array::from_fn(|i| vehicles[i].message(now_ns));
        let mut commands = [0.0; FOLLOWERS];
        for i in 1..=FOLLOWERS {
            let heard = k.checked_sub(setup.delay.at(i, k)).map(|latest| {
                let sent = latest - latest % setup.message_period_ms;
                air[sent % SLOTS]
            });
            let seen = observation(i, &vehicles[i], heard, now_ns);
            memories[i - 1].note_seen(&seen);
            commands[i - 1] = coordinate(&cal, &memories[i - 1], &seen, 1e-3).accel_mps2;
            memories[i - 1].asked_mps2 = commands[i - 1];
        }
        let leader_mps2 = if (1_000..2_000).contains(&k) { 2.0 } else { 0.0 };
        vehicles[0].accel_mps2 = leader_mps2;
        vehicles[0].intended_mps2 = leader_mps2;
        vehicles[0].move_on(leader_mps2, 1e-3);
        for (vehicle, command) in vehicles[1..].iter_mut().zip(commands) {
            vehicle.answer(command, 1e-3);
        }
        run.note(k, &vehicles);
    }
    run
}

fn observation(
    truck: usize,
    vehicle: &Vehicle,
    heard: Option<[V2v; FOLLOWERS + 1]>,
    time_ns: u64,
) -> Observation {
    Observation {
        time_ns,
        ego: Ego {
            time_ns,
            x_m: vehicle.x_m,
            forward_mps: vehicle.speed_mps,
            accel_mps2: vehicle.accel_mps2,
            ..Ego::default()
        },
        mission: Mission {
            truck: truck as u8,
            trucks: FOLLOWERS as u8 + 1,
            predecessor: truck as u8 - 1,
            spacing_m: SPACING_M,
            leader_distance_m: truck as f64 * SPACING_M,
            set_speed_mps: 20.0,
            ..Mission::default()
        },
        leader: heard.map(|all| all[0]),
        predecessor: heard.map(|all| all[truck - 1]),
        plans: Plans::default(),
        obstacles: [None; crate::OBSTACLES_MAX],
    }
}

impl Run {
    fn new() -> Self {
        let none = [0.0; FOLLOWERS];
        Self { peak_m: none, last_m: none, settled_m: 0.0, last_gap_m: none, speed_max_mps: 0.0 }
    }

    fn note(&mut self, k: usize, vehicles: &[Vehicle; FOLLOWERS + 1]) {
        for i in 0..FOLLOWERS {
            let gap_m = vehicles[i].x_m - vehicles[i + 1].x_m - SPACING_M;
            self.last_gap_m[i] = gap_m;
            self.peak_m[i] = self.peak_m[i].max(gap_m.abs());
            let slots_m = (i + 1) as f64 * SPACING_M;
            self.last_m[i] = vehicles[0].x_m - vehicles[i + 1].x_m - slots_m;
            self.speed_max_mps = self.speed_max_mps.max(vehicles[i + 1].speed_mps);
            if k >= SETTLED_MS {
                self.settled_m = self.settled_m.max(self.last_m[i].abs());
            }
        }
    }
}
