//! What a tick came to, quantity by quantity: everything of it but how long it took.

use core::fmt;

use traces::{GuardReason, TickOutcome, TickRecord};

/// A value of a quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// A number of 64 bits.
    Double(f64),
    /// A number of 32 bits.
    Single(f32),
    /// A count.
    Count(u32),
    /// A set of constraints, one bit each.
    Set(u128),
    /// What the law answered.
    Outcome(TickOutcome),
    /// What the guard did.
    Guard(GuardReason),
}

impl Value {
    /// Whether every bit is the same: zeros of two signs differ, the same not-a-number does not.
    pub fn is_same(self, other: Self) -> bool {
        match (self, other) {
            (Self::Double(a), Self::Double(b)) => a.to_bits() == b.to_bits(),
            (Self::Single(a), Self::Single(b)) => a.to_bits() == b.to_bits(),
            (a, b) => a == b,
        }
    }

    /// As a number, where it is one.
    pub fn number(self) -> Option<f64> {
        match self {
            Self::Double(value) => Some(value),
            Self::Single(value) => Some(f64::from(value)),
            Self::Count(value) => Some(f64::from(value)),
            Self::Set(_) | Self::Outcome(_) | Self::Guard(_) => None,
        }
    }

    /// How many representable numbers of its width the other one is away; `None` where that makes
    /// no sense.
    pub fn ulps(self, other: Self) -> Option<u64> {
        match (self, other) {
            (Self::Double(a), Self::Double(b)) if a.is_finite() && b.is_finite() => {
                Some(place(a).abs_diff(place(b)))
            }
            (Self::Single(a), Self::Single(b)) if a.is_finite() && b.is_finite() => {
                Some(u64::from(place_of_single(a).abs_diff(place_of_single(b))))
            }
            _ => None,
        }
    }
}

/// The place of a number among all of its width, zeros of both signs at 0.
fn place(value: f64) -> i64 {
    let magnitude = (value.to_bits() & !(1 << 63)).cast_signed();
    if value.is_sign_negative() { -magnitude } else { magnitude }
}

fn place_of_single(value: f32) -> i32 {
    let magnitude = (value.to_bits() & !(1 << 31)).cast_signed();
    if value.is_sign_negative() { -magnitude } else { magnitude }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Double(value) => write!(f, "{value}"),
            Self::Single(value) => write!(f, "{value}"),
            Self::Count(value) => write!(f, "{value}"),
            Self::Set(bits) => {
                let rows = (0..u128::BITS).filter(|row| bits >> row & 1 == 1);
                write!(f, "{{{}}}", rows.map(|row| row.to_string()).collect::<Vec<_>>().join(","))
            }
            Self::Outcome(outcome) => write!(f, "{outcome:?}"),
            Self::Guard(reason) => write!(f, "{reason:?}"),
        }
    }
}

/// Something a tick comes to.
#[derive(Debug)]
pub struct Quantity {
    /// Its name, with the unit's suffix as everywhere.
    pub name: &'static str,
    /// Its unit; empty when dimensionless.
    pub unit: &'static str,
    /// Its value.
    pub of: fn(&TickRecord) -> Value,
}

impl PartialEq for Quantity {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

/// Makes the table of quantities.
macro_rules! quantities {
    ($($name:literal, $unit:literal, |$tick:ident| $value:expr;)*) => {
        /// All quantities: the command first, then what led to it.
        pub const QUANTITIES: &[Quantity] = &[
            $(Quantity { name: $name, unit: $unit, of: |$tick| $value },)*
        ];
    };
}

quantities! {
    "force_n", "N", |t| Value::Double(t.force_n);
    "steering_rad", "rad", |t| Value::Double(t.steering_rad);
    "outcome", "", |t| Value::Outcome(t.outcome);
    "guard_reason", "", |t| Value::Guard(t.guard_reason);
    "working_set", "", |t| Value::Set(t.working_set_bits());
    "qp_iterations", "", |t| Value::Count(t.qp_iterations);
    "qp_changes", "", |t| Value::Count(t.qp_changes);
    "kkt_residual", "", |t| Value::Single(t.kkt_residual);
    "reference_mps", "m/s", |t| Value::Double(t.reference_mps);
    "accel_mps2", "m/s²", |t| Value::Double(t.accel_mps2);
    "leader_error_m", "m", |t| Value::Single(t.leader_error[0]);
    "leader_error_mps", "m/s", |t| Value::Single(t.leader_error[1]);
    "leader_error_mps2", "m/s²", |t| Value::Single(t.leader_error[2]);
    "predecessor_error_m", "m", |t| Value::Single(t.predecessor_error[0]);
    "predecessor_error_mps", "m/s", |t| Value::Single(t.predecessor_error[1]);
    "predecessor_error_mps2", "m/s²", |t| Value::Single(t.predecessor_error[2]);
    "leader_age_s", "s", |t| Value::Single(t.leader_age_s);
    "predecessor_age_s", "s", |t| Value::Single(t.predecessor_age_s);
    "adaptive_weight", "", |t| Value::Single(t.adaptive_weight);
    "potential", "", |t| Value::Single(t.potential);
    "slack_y_m", "m", |t| Value::Single(t.slack[0]);
    "slack_gap_m", "m", |t| Value::Single(t.slack[1]);
    "slack_accel_mps2", "m/s²", |t| Value::Single(t.slack[2]);
}

/// Two values of one quantity that are not the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    /// Which quantity.
    pub quantity: &'static Quantity,
    /// Its value here.
    pub here: Value,
    /// Its value there.
    pub there: Value,
}

impl fmt::Display for Difference {
    /// The values, and how far they are apart in units and in representable numbers.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { quantity: Quantity { name, unit, .. }, here, there } = self;
        write!(f, "{name} {here} against {there}")?;
        let apart = here.number().zip(there.number()).map(|(here, there)| (here - there).abs());
        if let Some(apart) = apart.filter(|apart| apart.is_finite()) {
            let unit = if unit.is_empty() { "" } else { &format!(" {unit}") };
            write!(f, ", apart by {apart:e}{unit}")?;
        }
        match here.ulps(*there) {
            Some(ulps) => write!(f, " ({ulps} ulp)"),
            None => Ok(()),
        }
    }
}

/// All quantities in which two ticks differ.
pub fn differences(here: &TickRecord, there: &TickRecord) -> impl Iterator<Item = Difference> {
    let pairs = QUANTITIES.iter().map(|quantity| Difference {
        quantity,
        here: (quantity.of)(here),
        there: (quantity.of)(there),
    });
    pairs.filter(|pair| !pair.here.is_same(pair.there))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_told_in_units_and_in_representable_numbers() {
        let here = TickRecord { force_n: 1.0, ..TickRecord::default() };
        let there = TickRecord { force_n: 1.0_f64.next_up().next_up(), ..here };
        let found = differences(&here, &there).next().expect("differs");
        assert_eq!((found.quantity.name, found.here.ulps(found.there)), ("force_n", Some(2)));
        assert!(found.to_string().contains(" N (2 ulp)"), "{found}");
    }

    #[test]
    fn the_sign_of_zero_is_a_difference_and_the_same_nan_is_none() {
        let here = TickRecord { leader_age_s: f32::NAN, ..TickRecord::default() };
        let there = TickRecord { steering_rad: -0.0, ..here };
        let found = differences(&here, &there).next().expect("differs");
        assert_eq!((found.quantity.name, found.here.ulps(found.there)), ("steering_rad", Some(0)));
        assert_eq!(differences(&here, &here).next(), None);
    }

    #[test]
    fn numbers_of_both_signs_are_as_far_apart_as_there_are_numbers_between() {
        let least = f64::from_bits(1);
        assert_eq!(Value::Double(least).ulps(Value::Double(-least)), Some(2));
        assert_eq!(Value::Double(f64::NAN).ulps(Value::Double(1.0)), None);
    }
}
