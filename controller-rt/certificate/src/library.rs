//! The gains that come with the program: the paper's, and ours.
//!
//! The paper's vehicles look their gain up by the number of trucks and their parameters. So does an
//! ECU here, in this table, which needs no file at run time.

use crate::file::{FileError, GainFile};
use crate::gain::Lags;

/// The files of `controller-rt/gains`, the published gain first.
const TEXTS: [&str; 6] = [
    include_str!("../../gains/published.toml"),
    include_str!("../../gains/published-feedforward.toml"),
    include_str!("../../gains/all-round.toml"),
    include_str!("../../gains/balanced.toml"),
    include_str!("../../gains/least-gamma.toml"),
    include_str!("../../gains/short-lag.toml"),
];

/// All gains of the library.
///
/// # Errors
/// When one of the files that were built in is damaged.
pub fn all() -> Result<Vec<GainFile>, FileError> {
    TEXTS.iter().map(|text| GainFile::parse(text)).collect()
}

/// The gain of this name, and its number in the library, counted from 1.
#[must_use]
pub fn named(name: &str) -> Option<(u8, GainFile)> {
    let position = |(i, file): (usize, GainFile)| (i as u8 + 1, file);
    all().ok()?.into_iter().enumerate().map(position).find(|(_, file)| file.name == name)
}

/// The gain with the least proven gamma among those for these lags, this delay and so many
/// followers, those with the paper's numbers aside; with its number in the library.
#[must_use]
pub fn best_for(followers: usize, lags: &Lags, longest_s: f64) -> Option<(u8, GainFile)> {
    let fits = |file: &GainFile| {
        let is_long_enough =
            file.vehicle.is_some() || file.platoon.iter().any(|p| p.followers >= followers);
        !file.name.starts_with("published")
            && file.plant.cover(lags)
            && file.delay.longest_s >= longest_s
            && is_long_enough
    };
    let gamma = |file: &GainFile| file.first_gamma().unwrap_or(f64::INFINITY);
    all()
        .ok()?
        .into_iter()
        .enumerate()
        .filter(|(_, file)| fits(file))
        .min_by(|(_, a), (_, b)| gamma(a).total_cmp(&gamma(b)))
        .map(|(i, file)| (i as u8 + 1, file))
}
