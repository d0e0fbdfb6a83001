//! The integrator all models share: one classical Runge-Kutta step (RK4).

/// A state that is also its own time derivative, with every unit divided by a second.
pub(super) trait Integrable: Copy {
    /// This state plus `dt_s` seconds of a derivative.
    fn plus(&self, rate: &Self, dt_s: f64) -> Self;
}

/// The state `dt_s` seconds after `start`, by the classical Runge-Kutta step of fourth order.
pub(super) fn rk4_step<S: Integrable>(start: S, dt_s: f64, rate: impl Fn(&S) -> S) -> S {
    let k1 = rate(&start);
    let k2 = rate(&start.plus(&k1, 0.5 * dt_s));
    let k3 = rate(&start.plus(&k2, 0.5 * dt_s));
    let k4 = rate(&start.plus(&k3, dt_s));
    start.plus(&k1, dt_s / 6.0).plus(&k2, dt_s / 3.0).plus(&k3, dt_s / 3.0).plus(&k4, dt_s / 6.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Position and speed of a swing x'' = -x.
    #[derive(Clone, Copy)]
    struct Swing {
        x: f64,
        v: f64,
    }

    impl Integrable for Swing {
        fn plus(&self, rate: &Self, dt_s: f64) -> Self {
            Self { x: self.x + dt_s * rate.x, v: self.v + dt_s * rate.v }
        }
    }

    /// Error of the swing after one second in so many steps.
    fn error(steps: u32) -> f64 {
        let mut swing = Swing { x: 1.0, v: 0.0 };
        for _ in 0..steps {
            swing = rk4_step(swing, 1.0 / f64::from(steps), |s| Swing { x: s.v, v: -s.x });
        }
        (swing.x - libm::cos(1.0)).abs()
    }

    #[test]
    fn half_the_step_has_a_sixteenth_of_the_error() {
        let ratio = error(10) / error(20);
        assert!((14.0..18.0).contains(&ratio), "{ratio}");
    }
}
