//! Numbers side by side: one formula for neighbouring prediction steps, in whatever vector
//! registers the machine has.

use core::ops::{Add, AddAssign, Mul, Neg, Sub};

/// As many as fit the widest registers used. Every lane is worked on by itself: what registers
/// there are changes no result.
pub const LANES: usize = 4;

/// Numbers on which every operation works one by one.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub struct Lanes(pub [f64; LANES]);

impl Lanes {
    /// All zero.
    pub const ZERO: Self = Self::all(0.0);

    /// The same number in every lane.
    pub const fn all(x: f64) -> Self {
        Self([x; LANES])
    }

    /// Sine and cosine, as exact as `libm`'s, whose polynomials these are (FDLIBM, `k_sin.c` and
    /// `k_cos.c`). Angles that need no reduction, all those of a truck on its road, take no branch.
    #[inline(always)]
    pub fn sin_cos(self) -> (Self, Self) {
        if self.0.iter().all(|x| x.abs() <= core::f64::consts::FRAC_PI_4) {
            return (self.sine(), self.cosine());
        }
        self.reduced()
    }

    #[cold]
    fn reduced(self) -> (Self, Self) {
        let both = self.0.map(libm::sincos);
        (Self(both.map(|(sin, _)| sin)), Self(both.map(|(_, cos)| cos)))
    }

    #[inline(always)]
    fn sine(self) -> Self {
        const S: [f64; 6] = [
            -1.666_666_666_666_663_2e-1,
            8.333_333_333_322_49e-3,
            -1.984_126_982_985_795e-4,
            2.755_731_370_707_006_8e-6,
            -2.505_076_025_340_686_3e-8,
            1.589_690_995_211_55e-10,
        ];
        let z = self * self;
        let rest = (z * S[3] + S[2]) * z + S[1] + z * (z * z) * (z * S[5] + S[4]);
        self + z * self * (z * rest + S[0])
    }

    #[inline(always)]
    fn cosine(self) -> Self {
        const C: [f64; 6] = [
            4.166_666_666_666_66e-2,
            -1.388_888_888_887_411e-3,
            2.480_158_728_947_673e-5,
            -2.755_731_435_139_066_3e-7,
            2.087_572_321_298_175e-9,
            -1.135_964_755_778_819_5e-11,
        ];
        let z = self * self;
        let w = z * z;
        let rest = z * ((z * C[2] + C[1]) * z + C[0]) + w * w * ((z * C[5] + C[4]) * z + C[3]);
        let half = z * 0.5;
        let near = -half + 1.0;
        // What rounding took from 1 - z/2 is given back.
        near + ((-near + 1.0 - half) + z * rest)
    }
}

impl Add for Lanes {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]])
    }
}

impl Add<f64> for Lanes {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: f64) -> Self {
        self + Self::all(other)
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Lanes {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]])
    }
}

impl Mul for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]])
    }
}

impl Mul<f64> for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: f64) -> Self {
        self * Self::all(other)
    }
}

impl Neg for Lanes {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        let a = self.0;
        Self([-a[0], -a[1], -a[2], -a[3]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_and_cosines_are_those_of_libm() {
        for n in -2000..2000 {
            let x = 1e-3 * f64::from(n);
            for pair in [[x, 0.5 * x], [-x, 1e-3 * x]] {
                let angles = core::array::from_fn(|lane| pair[lane % 2]);
                let (sin, cos) = Lanes(angles).sin_cos();
                for (lane, angle) in angles.into_iter().enumerate() {
                    assert!((sin.0[lane] - libm::sin(angle)).abs() < 3e-16, "sin {angle}");
                    assert!((cos.0[lane] - libm::cos(angle)).abs() < 3e-16, "cos {angle}");
                }
            }
        }
    }

    #[test]
    fn an_angle_that_is_not_finite_stays_so_and_leaves_the_others_alone() {
        for poison in [f64::NAN, f64::INFINITY] {
            for angle in [0.1, 2.0] {
                let (sin, cos) =
                    Lanes(core::array::from_fn(|lane| [poison, angle][lane % 2])).sin_cos();
                assert!(sin.0[0].is_nan() && cos.0[0].is_nan());
                assert!((sin.0[1] - libm::sin(angle)).abs() < 1e-16);
                assert!((cos.0[1] - libm::cos(angle)).abs() < 1e-16);
            }
        }
    }
}
