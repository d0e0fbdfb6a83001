//! The layer on a straight road: a truck with lagging brakes behind something that follows a
//! script.

use super::*;
use crate::guard::{Guard, Plan, Proposal, Reason};

const MS: u64 = 1_000_000;
/// Lag of the truck's drive and brakes \[s\].
const LAG_S: f64 = 0.25;
/// What rolling costs \[m/s²\].
const RESISTANCE_MPS2: f64 = 0.06;
/// Half the length of what is ahead \[m\].
const HALF_LENGTH_M: f64 = 3.0;

/// A truck whose law holds its speed and sees nothing, and what is ahead of it.
struct Chase {
    guard: Guard,
    time_ms: u64,
    own: OwnMotion,
    force_n: f64,
    gap_m: f64,
    ahead_mps: f64,
    ahead_y_m: f64,
    /// What the law asks for below 25 m/s \[N\].
    pushes_n: f64,
    /// The object disappears from the sensors.
    is_hidden: bool,
    /// Added to the speeds reported \[m/s\], in turn.
    noise_mps: f64,
    page: [Option<Object>; PAGES],
    reasons: Vec<Reason>,
}

impl Chase {
    fn new(own_mps: f64, gap_m: f64, ahead_mps: f64) -> Self {
        Self {
            guard: Guard::new(),
            time_ms: 0,
            own: OwnMotion { trusted: true, forward_mps: own_mps, ..OwnMotion::default() },
            force_n: 0.0,
            gap_m,
            ahead_mps,
            ahead_y_m: 0.0,
            pushes_n: 0.0,
            is_hidden: false,
            noise_mps: 0.0,
            page: [None; PAGES],
            reasons: Vec::new(),
        }
    }

    fn report(&mut self) {
        let turn = if (self.time_ms / 50).is_multiple_of(2) { 1.0 } else { -1.0 };
        let object = Object {
            measured_ns: self.time_ms * MS,
            x_m: self.own.x_m + FRONT_M + self.gap_m + HALF_LENGTH_M,
            y_m: self.ahead_y_m,
            x_mps: self.ahead_mps + turn * self.noise_mps,
            y_mps: 0.0,
            half_length_m: HALF_LENGTH_M,
            half_width_m: 1.1,
        };
        self.page[0] = (!self.is_hidden).then_some(object);
    }

    /// One millisecond in which what is ahead accelerates.
    fn step(&mut self, ahead_mps2: f64) {
        if self.time_ms.is_multiple_of(50) {
            self.report();
        }
        let now_ns = self.time_ms * MS;
        self.own.time_ns = now_ns;
        let force_n = if self.own.forward_mps < 25.0 { self.pushes_n } else { 0.0 };
        let proposal = Proposal { force_n, steering_rad: 0.0, plan: Plan::Solved };
        let admitted = self.guard.admit(now_ns, Some(proposal), self.own, &self.page);
        self.reasons.push(admitted.reason);
        self.force_n += (admitted.force_n - self.force_n) * 1e-3 / LAG_S;
        let own_mps = self.own.forward_mps;
        let accel_mps2 = self.force_n / MASS_KG - RESISTANCE_MPS2;
        self.own.forward_mps = (own_mps + accel_mps2 * 1e-3).max(0.0);
        let ahead_before_mps = self.ahead_mps;
        self.ahead_mps = (self.ahead_mps + ahead_mps2 * 1e-3).max(0.0);
        self.own.x_m += own_mps * 1e-3;
        self.own.y_m += self.own.left_mps * 1e-3;
        self.gap_m += (ahead_before_mps - own_mps) * 1e-3;
        self.time_ms += 1;
    }

    /// Drives for a while; the least gap \[m\].
    fn drive(&mut self, seconds: f64, ahead_mps2: f64) -> f64 {
        let mut least_m = self.gap_m;
        for _ in 0..(seconds * 1e3) as u64 {
            self.step(ahead_mps2);
            least_m = least_m.min(self.gap_m);
        }
        least_m
    }

    fn triggers(&self) -> u32 {
        self.guard.emergency_brakings()
    }
}

#[test]
fn braking_as_required_once_the_brakes_bite_stops_at_the_standoff() {
    let cases = [
        (20.0, 60.0, 0.0, 0.0),
        (18.0, 15.0, 15.0, 6.0),
        (20.0, 12.0, 12.0, 1.0),
        (22.0, 12.3, 22.0, 6.0),
    ];
    for (own_mps, gap_m, ahead_mps, braking_mps2) in cases {
        let ahead = ahead(gap_m, ahead_mps, braking_mps2);
        let required_mps2 = ahead.required_mps2(own_mps);
        let bitten_m = gap_m - (own_mps - ahead_mps) * BITE_S;
        let (mut u, mut v, mut gap, mut least_m) = (own_mps, ahead_mps, bitten_m, bitten_m);
        for _ in 0..200_000 {
            let (before_u, before_v) = (u, v);
            u = (u - required_mps2 * 1e-4).max(0.0);
            v = (v - braking_mps2 * 1e-4).max(0.0);
            gap += 0.5e-4 * (before_v + v - before_u - u);
            least_m = least_m.min(gap);
        }
        assert!((least_m - STANDOFF_M).abs() < 0.01, "{required_mps2} m/s²: {least_m} m left");
    }
}

fn ahead(gap_m: f64, forward_mps: f64, braking_mps2: f64) -> Ahead {
    Ahead { gap_m, left_m: 0.0, half_width_m: 1.1, forward_mps, left_mps: 0.0, braking_mps2 }
}

#[test]
fn the_two_cases_agree_where_they_meet() {
    let (own_mps, ahead_mps, braking_mps2) = (20.0, 15.0, 2.0);
    let closing_mps = own_mps - ahead_mps;
    let room_m = ahead_mps * closing_mps / (2.0 * braking_mps2);
    let at = |room_m: f64| {
        let gap_m = room_m + STANDOFF_M + closing_mps * BITE_S;
        ahead(gap_m, ahead_mps, braking_mps2).required_mps2(own_mps)
    };
    assert!((at(room_m + 1e-9) - at(room_m - 1e-9)).abs() < 1e-6);
    assert!(at(room_m - 1.0) > at(room_m) && at(room_m) > at(room_m + 1.0));
}

#[test]
fn contact_is_when_the_gaps_are_driven() {
    // 10 m at 5 m/s; 20 m to something that stops after 4 m; nothing that draws away is reached.
    assert!((ahead(10.0, 15.0, 0.0).contact_s(20.0) - 2.0).abs() < 1e-12);
    assert!((ahead(16.0, 4.0, 2.0).contact_s(10.0) - 2.0).abs() < 1e-12);
    assert_eq!(ahead(10.0, 15.0, 0.0).contact_s(15.0), f64::INFINITY);
    // While it still moves: 0.5 · 4 · t² = 8.
    assert!((ahead(8.0, 20.0, 4.0).contact_s(20.0) - 2.0).abs() < 1e-12);
}

#[test]
fn a_truck_behind_something_that_brakes_hard_stops_and_without_the_layer_does_not() {
    for (own_mps, gap_m, ahead_mps) in [(18.0, 26.0, 15.0), (18.0, 18.0, 18.0), (22.0, 38.0, 17.0)]
    {
        let mut chase = Chase::new(own_mps, gap_m, ahead_mps);
        chase.drive(0.5, 0.0);
        let least_m = chase.drive(10.0, -6.0);
        assert!(least_m >= 0.3, "{own_mps} m/s, {gap_m} m: {least_m} m left");
        assert_eq!(chase.triggers(), 1);
        assert!(chase.own.forward_mps < 0.2, "{} m/s left", chase.own.forward_mps);
        let mut chase = Chase::new(own_mps, gap_m, ahead_mps);
        chase.guard = Guard::new().without_emergency_braking();
        assert!(chase.drive(10.5, -6.0) < 0.0);
        assert_eq!(chase.triggers(), 0);
    }
}

#[test]
fn something_that_stands_in_the_way_is_stopped_for() {
    let mut chase = Chase::new(20.0, 80.0, 0.0);
    let least_m = chase.drive(12.0, 0.0);
    assert!((1.0..4.0).contains(&least_m), "{least_m} m left");
    assert_eq!(chase.triggers(), 1, "one braking, without chatter");
    assert!(chase.reasons.contains(&Reason::Emergency));
}

#[test]
fn a_standing_truck_is_not_pushed_backwards() {
    let mut chase = Chase::new(20.0, 80.0, 0.0);
    chase.drive(15.0, 0.0);
    assert!(chase.force_n > -3_000.0, "{} N at standstill", chase.force_n);
}

#[test]
fn a_truck_that_stopped_waits_for_room_and_then_goes() {
    let mut chase = Chase::new(18.0, 26.0, 15.0);
    chase.drive(0.5, 0.0);
    chase.drive(6.0, -6.0);
    chase.pushes_n = 20_000.0;
    let least_m = chase.drive(6.0, 0.0);
    assert!(least_m >= 0.3, "pushed into it: {least_m} m");
    assert!(chase.own.forward_mps < 0.1);
    let least_m = chase.drive(20.0, 1.5);
    assert!(least_m >= 0.3 && chase.own.forward_mps > 20.0, "{least_m} m");
}

#[test]
fn a_hazard_that_is_gone_releases_the_brakes() {
    for hide in [true, false] {
        let mut chase = Chase::new(18.0, 26.0, 15.0);
        chase.drive(1.0, -6.0);
        assert!(chase.force_n < -10_000.0, "it brakes");
        if hide {
            chase.is_hidden = true;
        } else {
            chase.ahead_y_m = 3.75;
        }
        chase.drive(1.0, 0.0);
        assert_eq!(chase.reasons.last(), Some(&Reason::Passed));
    }
}

#[test]
fn ordinary_following_and_approaching_never_trigger() {
    // Equal speed at every distance, and 2 m/s² of braking ahead with as much of one's own.
    for gap_m in [5.0, 12.3, 40.0] {
        let mut chase = Chase::new(20.0, gap_m, 20.0);
        chase.noise_mps = 0.01;
        chase.drive(5.0, 0.0);
        assert_eq!(chase.triggers(), 0, "{gap_m} m");
    }
    let mut chase = Chase::new(18.5, 30.0, 15.0);
    chase.noise_mps = 0.01;
    assert!(chase.drive(7.0, 0.0) < 8.0);
    assert_eq!(chase.triggers(), 0, "closing at 3 m/s down to 8 m");
}

#[test]
fn a_truck_that_creeps_up_stops_before_it_touches() {
    for own_mps in [0.8, 1.2, 2.0, 4.0] {
        let mut chase = Chase::new(own_mps, 8.0, 0.0);
        // What rolling costs.
        chase.pushes_n = RESISTANCE_MPS2 * MASS_KG;
        let least_m = chase.drive(15.0, 0.0);
        assert!(least_m > 0.1, "{own_mps} m/s: {least_m} m left");
    }
}

#[test]
fn the_other_lane_is_not_in_the_way() {
    for left_m in [-3.75, 3.75] {
        let mut chase = Chase::new(20.0, 60.0, 0.0);
        chase.ahead_y_m = left_m;
        chase.drive(5.0, 0.0);
        assert_eq!(chase.triggers(), 0);
    }
}

#[test]
fn a_truck_that_swerves_in_time_is_not_braked() {
    let mut chase = Chase::new(18.0, 66.0, 0.0);
    // A lane change of 3.5 s, begun with 1.6 m/s² across.
    for k in 0..3_600 {
        let phase = (f64::from(k) * 1e-3 / 3.5).min(1.0) * core::f64::consts::TAU;
        let peak_mps2 = 3.75 * core::f64::consts::TAU / (3.5 * 3.5);
        chase.own.left_mps2 = peak_mps2 * phase.sin();
        chase.own.left_mps += chase.own.left_mps2 * 1e-3;
        chase.step(0.0);
    }
    assert!(chase.gap_m < 2.0);
    assert_eq!(chase.triggers(), 0);
}

#[test]
fn a_truck_that_drifts_back_into_the_way_is_braked() {
    let mut chase = Chase::new(18.0, 45.0, 0.0);
    (chase.own.y_m, chase.own.left_mps) = (3.0, -1.0);
    chase.drive(0.1, 0.0);
    assert_eq!(chase.triggers(), 1);
}

#[test]
fn a_truck_that_goes_blind_goes_on_braking() {
    let mut chase = Chase::new(18.0, 26.0, 15.0);
    chase.drive(1.2, -6.0);
    let before_n = chase.force_n;
    chase.own.trusted = false;
    chase.drive(0.5, -6.0);
    assert!(chase.force_n < 0.9 * before_n, "{before_n} N, then {} N", chase.force_n);
}

#[test]
fn another_object_on_the_same_page_is_not_taken_for_a_braking_one() {
    let mut chase = Chase::new(20.0, 30.0, 25.0);
    chase.drive(1.0, 0.0);
    // Slower by 4 m/s from one report to the next: 80 m/s², if it were the same.
    (chase.gap_m, chase.ahead_mps) = (60.0, 21.0);
    chase.drive(1.0, 0.0);
    assert_eq!(chase.triggers(), 0);
}

#[test]
fn deceleration_is_found_within_three_reports_and_through_noise() {
    let report = |k: u64, x_mps: f64| Object {
        measured_ns: k * 50 * MS,
        x_m: 0.05 * k as f64 * x_mps,
        y_m: 0.0,
        x_mps,
        y_mps: 0.0,
        half_length_m: 3.0,
        half_width_m: 1.1,
    };
    let mut track = Track::new(report(0, 15.0));
    for k in 1..=3 {
        track.note(&report(k, 15.0 - 0.3 * k as f64));
        track.note(&report(k, 15.0 - 0.3 * k as f64));
    }
    assert!((4.0..6.0).contains(&track.braking_mps2()), "{}", track.braking_mps2());
    let mut track = Track::new(report(0, 15.0));
    for k in 1..200 {
        let noise_mps = if k % 2 == 0 { 0.01 } else { -0.01 };
        track.note(&report(k, 15.0 + noise_mps));
        assert!(track.braking_mps2() < 0.5);
    }
}

#[test]
fn a_restored_guard_goes_on_as_the_saved_one() {
    let mut chase = Chase::new(18.0, 26.0, 15.0);
    chase.drive(0.9, -6.0);
    assert!(chase.guard.emergency.is_braking());
    let mut bytes = [0; 2048];
    let used = postcard::to_slice(&chase.guard, &mut bytes).expect("fits");
    let mut restored: Guard = postcard::from_bytes(used).expect("sound");
    let proposal = Some(Proposal { force_n: 0.0, steering_rad: 0.0, plan: Plan::Solved });
    for k in 0..200 {
        let now_ns = (chase.time_ms + k) * MS;
        let saved = chase.guard.admit(now_ns, proposal, chase.own, &chase.page);
        assert_eq!(restored.admit(now_ns, proposal, chase.own, &chase.page), saved);
    }
}
