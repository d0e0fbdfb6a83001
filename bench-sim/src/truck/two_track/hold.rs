//! Standstill: when a truck is held where it is, and what the road then gives it.
//!
//! A truck that has all but stopped is put to rest and held while three things hold it: brakes and
//! rolling resistance against a push forward, the hill holder against a pull backward, friction
//! against both and against sliding sideways. Held, it does not move at all, whatever its tyres'
//! springs would do; its suspension still settles under the forces that hold it.

use super::actuators::Turning;
use super::state::{AXLES, State, WHEELS};
use super::{Forces, TwoTrack, suspension};

/// A truck slower than this comes to rest if it can be held \[m/s, rad/s\]: forward, to the side
/// and turning. The hardest braking takes 0.006 m/s in a step of 1 ms.
const REST_SPEED: [f64; 3] = [0.02, 0.05, 0.05];

impl TwoTrack {
    /// Puts the truck to rest, keeps it there, or lets it go.
    pub(super) fn settle_or_hold(&mut self) {
        let s = &self.state;
        let [forward, left, turning] = REST_SPEED;
        let slow = s.forward_mps.abs() < forward
            && s.lateral_mps.abs() < left
            && s.yaw_radps.abs() < turning;
        self.held = slow && self.can_be_held();
        if self.held {
            let s = &mut self.state;
            (s.forward_mps, s.lateral_mps, s.yaw_radps) = (0.0, 0.0, 0.0);
            s.spin_radps = [0.0; WHEELS];
            self.turning = [Turning::Locked; WHEELS];
            s.slip = [0.0; WHEELS];
            s.tan_slip = [0.0; WHEELS];
        }
    }

    /// Whether a truck at rest stays there.
    fn can_be_held(&self) -> bool {
        let (s, p) = (&self.state, &self.parameters);
        let still = State { forward_mps: 0.0, lateral_mps: 0.0, ..*s };
        let forces = self.body_forces(&still);
        let [along_mps2, across_mps2, into_mps2] = forces.gravity_mps2;
        let pulled_n = p.mass_kg * along_mps2 + forces.air_n[0];
        let aside_n = p.mass_kg * across_mps2 + forces.air_n[1];
        let resisted_n = s.brake_n[0] + s.brake_n[1] + p.rolling * p.mass_kg * into_mps2;
        let pushed_n = pulled_n + p.engine_force_n(s);
        pushed_n <= resisted_n && libm::hypot(pushed_n, aside_n) <= self.grip_n(into_mps2)
    }

    /// Most the road can hold the truck with \[N\].
    fn grip_n(&self, into_mps2: f64) -> f64 {
        let (s, p) = (&self.state, &self.parameters);
        let loads_n = suspension::wheel_loads_n(p, s, into_mps2);
        let cos = libm::cos(s.heading_rad);
        let peak_n = |i: usize| {
            let tyres = p.tyres_per_wheel[i / 2];
            let x_m = s.x_m + p.axle_ahead_m(i / 2) * cos;
            let friction = p.surroundings.friction_at(x_m);
            tyres * p.tyres(i / 2).under(loads_n[i] / tyres, friction).peak_n
        };
        (0..WHEELS).map(peak_n).sum()
    }

    /// The forces that hold a truck at rest: each axle's share along the truck, and across it what
    /// balances forces and moments.
    pub(super) fn holding_forces(&self, s: &State) -> Forces {
        let p = &self.parameters;
        let mut forces = self.body_forces(s);
        let [along_mps2, across_mps2, _] = forces.gravity_mps2;
        let along_n = -(p.mass_kg * along_mps2 + forces.air_n[0]);
        let across_n = -(p.mass_kg * across_mps2 + forces.air_n[1]);
        for axle in 0..AXLES {
            let sign = [-1.0, 1.0][axle];
            forces.axle_forward_n[axle] = p.static_share(axle) * along_n;
            forces.axle_left_n[axle] =
                p.static_share(axle) * across_n + sign * forces.yaw_nm / p.wheelbase_m();
        }
        forces
    }

    /// Roll acceleration of a truck at rest \[rad/s²\].
    pub(super) fn held_roll_radps2(&self, s: &State, forces: &Forces) -> f64 {
        let p = &self.parameters;
        let q = p.sprung_kg() * p.roll_arm_m();
        let moment_nm = self.roll_moment_nm(s, forces) - q * forces.gravity_mps2[1];
        moment_nm / (p.roll_inertia_kgm2 + q * p.roll_arm_m())
    }
}
