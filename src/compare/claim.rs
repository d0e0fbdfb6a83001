//! One claim of the paper beside ours.

use serde::{Deserialize, Serialize};

use super::spread::Spread;

/// How far from a published number ours may be and still count as the same, as a share of it.
const NEAR: f64 = 0.15;

/// One claim of the paper beside ours.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// Where the paper says it.
    pub source: String,
    /// What it is about.
    pub what: String,
    /// What the paper says.
    pub published: String,
    /// What we measured, in words: the median and the 5-95 % band.
    pub ours: String,
    /// Whether that is the same.
    pub agreement: Agreement,
    /// Why.
    pub why: String,
    /// The measured number, when the claim is about one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spread: Option<Spread>,
}

/// Whether ours is the same as published.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Agreement {
    /// Within 15 % of the published number, or the statement holds.
    Same,
    /// Not.
    Different,
    /// The two are not of the same thing.
    NotComparable,
}

impl Agreement {
    /// `Same` when a statement holds.
    pub fn when(holds: bool) -> Self {
        if holds { Self::Same } else { Self::Different }
    }

    /// Whether a published number is ours: near our median, or within our band.
    pub fn of_number(published: f64, ours: &Spread) -> Self {
        let is_near = (ours.median - published).abs() <= NEAR * published.abs();
        Self::when(is_near || (ours.p5..=ours.p95).contains(&published))
    }

    /// In a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Same => "same",
            Self::Different => "different",
            Self::NotComparable => "not comparable",
        }
    }
}

impl Claim {
    /// A claim about a number.
    pub fn number(
        (source, what): (&str, &str),
        published: (&str, Agreement),
        (spread, digits, unit): (Spread, usize, &str),
        why: &str,
    ) -> Self {
        let ours = format!("{} {unit}", spread.text(digits)).trim_end().to_owned();
        let (published, agreement) = published;
        let spread = Some(spread);
        Self { ours, spread, ..Self::statement((source, what), published, ("", agreement), why) }
    }

    /// A claim in words.
    pub fn statement(
        (source, what): (&str, &str),
        published: &str,
        (ours, agreement): (&str, Agreement),
        why: &str,
    ) -> Self {
        Self {
            source: source.into(),
            what: what.into(),
            published: published.into(),
            ours: ours.into(),
            agreement,
            why: why.into(),
            spread: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_the_same_when_it_is_near_or_within_the_band() {
        let ours = Spread::of([0.5, 0.6, 0.7, 0.8]).expect("numbers");
        assert_eq!(Agreement::of_number(0.61, &ours), Agreement::Same);
        assert_eq!(Agreement::of_number(0.78, &ours), Agreement::Same);
        assert_eq!(Agreement::of_number(0.9, &ours), Agreement::Different);
    }
}
