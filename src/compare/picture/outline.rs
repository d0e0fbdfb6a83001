//! Fewer points for the same line: Douglas and Peucker's method, 1973.

/// Points of a line that stay; what is left out was nearer to the rest than half a unit.
pub fn simplified(points: &[(f64, f64)], unit: (f64, f64)) -> Vec<(f64, f64)> {
    let mut kept = vec![false; points.len()];
    let mut open = vec![(0, points.len().saturating_sub(1))];
    while let Some((first, last)) = open.pop() {
        let Some((from, to)) = points.get(first).zip(points.get(last)) else {
            continue;
        };
        (kept[first], kept[last]) = (true, true);
        let distance = |index: &usize| distance(points[*index], *from, *to, unit);
        let between = first + 1..last.max(first + 1);
        let furthest = between.max_by(|a, b| distance(a).total_cmp(&distance(b)));
        if let Some(middle) = furthest.filter(|index| distance(index) > 0.5) {
            open.extend([(first, middle), (middle, last)]);
        }
    }
    points.iter().zip(kept).filter_map(|(point, kept)| kept.then_some(*point)).collect()
}

/// The outline of a band about a curve.
pub fn of_band(points: &[(f64, f64)], band: &[(f64, f64)], unit: (f64, f64)) -> Vec<(f64, f64)> {
    let edge = |of: fn(&(f64, f64)) -> f64| {
        let edge: Vec<_> = points.iter().zip(band).map(|((x, _), b)| (*x, of(b))).collect();
        simplified(&edge, unit)
    };
    let (low, high) = (edge(|(low, _)| *low), edge(|(_, high)| *high));
    low.into_iter().chain(high.into_iter().rev()).collect()
}

/// Distance of a point from the straight line between two others, in units.
fn distance(point: (f64, f64), from: (f64, f64), to: (f64, f64), unit: (f64, f64)) -> f64 {
    let scaled = |(x, y): (f64, f64)| ((x - from.0) / unit.0, (y - from.1) / unit.1);
    let ((px, py), (dx, dy)) = (scaled(point), scaled(to));
    let length = f64::hypot(dx, dy);
    if length == 0.0 { f64::hypot(px, py) } else { (px * dy - py * dx).abs() / length }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_needs_its_ends_only_and_a_corner_stays() {
        let straight: Vec<_> = (0..100).map(|x| (f64::from(x), 2.0 * f64::from(x))).collect();
        assert_eq!(simplified(&straight, (1.0, 1.0)), [(0.0, 0.0), (99.0, 198.0)]);
        let corner: Vec<_> = (0..101).map(|x| (f64::from(x), f64::from(x - 50).abs())).collect();
        assert_eq!(simplified(&corner, (1.0, 1.0)), [(0.0, 50.0), (50.0, 0.0), (100.0, 50.0)]);
        assert_eq!(simplified(&[], (1.0, 1.0)), []);
    }
}
