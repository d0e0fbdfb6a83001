//! Where the labels of curves stand: at their ends, none on another.

use super::super::figure::{Curve, Ink};

/// Least distance between two labels [units].
const APART: i32 = 52;

/// The end of a curve and what to write there.
pub struct End {
    /// The label.
    pub name: String,
    /// Its colour.
    pub ink: Ink,
    /// Where the curve ends.
    y: f64,
}

impl End {
    /// The end of a curve; none of an empty one.
    pub fn of(curve: &Curve) -> Option<Self> {
        let &(_, y) = curve.points.last()?;
        Some(Self { name: curve.name.clone(), ink: curve.ink, y })
    }
}

/// Every label with its place, from top to bottom, as near to its curve's end as the others allow.
pub fn spread(mut ends: Vec<End>, place: impl Fn(f64) -> i32) -> Vec<(End, i32)> {
    // Equal ends keep their order.
    ends.sort_by_key(|end| place(end.y));
    let wanted: Vec<i32> = ends.iter().map(|end| place(end.y)).collect();
    let mut places = wanted.clone();
    for index in 1..places.len() {
        places[index] = places[index].max(places[index - 1] + APART);
    }
    // What was pushed down only because of what is above: move the whole stack up by the mean.
    let pushed: i32 = places.iter().zip(&wanted).map(|(place, wanted)| place - wanted).sum();
    let up = pushed / places.len().max(1) as i32;
    ends.into_iter().zip(places.into_iter().map(|place| place - up)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_curves_that_end_together_do_not_cover_each_other() {
        let end = |name: &str, y| End { name: name.into(), ink: Ink::Black, y };
        let ends = vec![end("a", 0.0), end("b", 0.01), end("c", 5.0)];
        let placed = spread(ends, |y| 500 - (100.0 * y) as i32);
        let names: Vec<&str> = placed.iter().map(|(end, _)| end.name.as_str()).collect();
        assert_eq!(names, ["c", "b", "a"]);
        assert!(placed.windows(2).all(|pair| pair[1].1 - pair[0].1 >= APART));
    }
}
