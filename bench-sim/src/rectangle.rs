//! Boxes on the road and the distance between them.

/// An oriented rectangle on the road.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    x_m: f64,
    y_m: f64,
    cos: f64,
    sin: f64,
    half_length_m: f64,
    half_width_m: f64,
}

impl Rectangle {
    /// A rectangle about its centre, its length along `heading_rad`.
    pub fn new(x_m: f64, y_m: f64, heading_rad: f64, length_m: f64, width_m: f64) -> Self {
        Self {
            x_m,
            y_m,
            cos: libm::cos(heading_rad),
            sin: libm::sin(heading_rad),
            half_length_m: 0.5 * length_m,
            half_width_m: 0.5 * width_m,
        }
    }

    /// Centre along and across the road \[m\].
    pub fn centre_m(&self) -> (f64, f64) {
        (self.x_m, self.y_m)
    }

    /// Signed distance to another rectangle \[m\]: the gap between the nearest points when they are
    /// apart, minus the depth of the shallowest way out when they overlap.
    pub fn clearance_m(&self, other: &Self) -> f64 {
        let overlap_m = self.overlap_m(other).min(other.overlap_m(self));
        if overlap_m > 0.0 {
            return -overlap_m;
        }
        // The nearest points of two disjoint convex polygons include a corner of one of them.
        let mine = self.corners().into_iter().map(|(x, y)| other.distance_m(x, y));
        let theirs = other.corners().into_iter().map(|(x, y)| self.distance_m(x, y));
        mine.chain(theirs).fold(f64::INFINITY, f64::min)
    }

    /// Lower bound of [`Self::clearance_m`], from the circumscribed circles \[m\].
    pub fn clearance_floor_m(&self, other: &Self) -> f64 {
        let centres_m = length_m(other.x_m - self.x_m, other.y_m - self.y_m);
        centres_m - self.radius_m() - other.radius_m()
    }

    fn radius_m(&self) -> f64 {
        length_m(self.half_length_m, self.half_width_m)
    }

    /// Least overlap of the shadows on this rectangle's own two axes \[m\], not positive when an
    /// axis separates them (separating-axis theorem).
    fn overlap_m(&self, other: &Self) -> f64 {
        let (dx, dy) = (other.x_m - self.x_m, other.y_m - self.y_m);
        let (along, across) = (dx * self.cos + dy * self.sin, dy * self.cos - dx * self.sin);
        let cos = (self.cos * other.cos + self.sin * other.sin).abs();
        let sin = (self.cos * other.sin - self.sin * other.cos).abs();
        let reach_along = other.half_length_m * cos + other.half_width_m * sin;
        let reach_across = other.half_length_m * sin + other.half_width_m * cos;
        let gap_along = along.abs() - self.half_length_m - reach_along;
        let gap_across = across.abs() - self.half_width_m - reach_across;
        -gap_along.max(gap_across)
    }

    fn corners(&self) -> [(f64, f64); 4] {
        let (l, w) = (self.half_length_m, self.half_width_m);
        [(l, w), (l, -w), (-l, -w), (-l, w)].map(|(along, across)| {
            (
                self.x_m + along * self.cos - across * self.sin,
                self.y_m + along * self.sin + across * self.cos,
            )
        })
    }

    /// Distance of a point from this rectangle \[m\], 0 inside.
    fn distance_m(&self, x_m: f64, y_m: f64) -> f64 {
        let (dx, dy) = (x_m - self.x_m, y_m - self.y_m);
        let along = (dx * self.cos + dy * self.sin).abs() - self.half_length_m;
        let across = (dy * self.cos - dx * self.sin).abs() - self.half_width_m;
        length_m(along.max(0.0), across.max(0.0))
    }
}

fn length_m(x_m: f64, y_m: f64) -> f64 {
    (x_m * x_m + y_m * y_m).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4};

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-12
    }

    #[test]
    fn aligned_boxes_are_as_far_as_their_sides() {
        let van = Rectangle::new(0.0, 0.0, 0.0, 6.0, 2.2);
        assert!(close(van.clearance_m(&Rectangle::new(10.0, 0.0, 0.0, 6.0, 2.0)), 4.0));
        assert!(close(van.clearance_m(&Rectangle::new(1.0, 3.0, 0.0, 6.0, 2.0)), 0.9));
        assert!(close(van.clearance_m(&Rectangle::new(9.0, 6.1, 0.0, 6.0, 2.0)), 5.0));
    }

    #[test]
    fn a_turned_box_reaches_with_its_corner() {
        let van = Rectangle::new(0.0, 0.0, 0.0, 2.0, 2.0);
        let turned = Rectangle::new(4.0, 0.0, FRAC_PI_4, 2.0, 2.0);
        assert!(close(van.clearance_m(&turned), 3.0 - 2.0 * FRAC_1_SQRT_2));
        let upright = Rectangle::new(5.0, 0.0, FRAC_PI_2, 6.0, 2.0);
        assert!(close(van.clearance_m(&upright), 3.0));
    }

    #[test]
    fn overlap_is_negative_by_the_shallowest_way_out() {
        let van = Rectangle::new(0.0, 0.0, 0.0, 6.0, 2.0);
        assert!(close(van.clearance_m(&Rectangle::new(1.0, 1.7, 0.0, 6.0, 2.0)), -0.3));
        assert!(close(van.clearance_m(&van), -2.0));
    }

    #[test]
    fn clearance_is_symmetric_and_above_its_floor() {
        let mut seed = 1_u64;
        let mut next = |span: f64| {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            span * ((seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
        };
        for _ in 0..2_000 {
            let a = Rectangle::new(next(20.0), next(20.0), next(6.0), 7.71, 2.5);
            let b = Rectangle::new(next(20.0), next(20.0), next(6.0), 6.0, 2.2);
            let clearance_m = a.clearance_m(&b);
            assert!((clearance_m - b.clearance_m(&a)).abs() < 1e-9);
            assert!(clearance_m >= a.clearance_floor_m(&b) - 1e-9);
        }
    }
}
