//! The gains that come with the program: the paper's, and ours.
//!
//! The paper's vehicles look their gain up by the number of trucks and their parameters. So does an
//! ECU here, in this table, which needs no file at run time.

use crate::file::{FileError, GainFile};
use crate::gain::Plants;

/// The files of `controller-rt/gains`, the published gain first.
const TEXTS: [&str; 7] = [
    include_str!("../../gains/published.toml"),
    include_str!("../../gains/published-feedforward.toml"),
    include_str!("../../gains/all-round.toml"),
    include_str!("../../gains/balanced.toml"),
    include_str!("../../gains/least-gamma.toml"),
    include_str!("../../gains/loop.toml"),
    include_str!("../../gains/published-loop.toml"),
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

/// The library's gain with the least proven gamma among those for these plants, this delay and so
/// many followers, those with the paper's numbers aside.
#[must_use]
pub fn best_for(followers: usize, plants: &Plants, longest_s: f64) -> Option<GainFile> {
    let ours = all().ok()?.into_iter().filter(|file| !file.name.starts_with("published"));
    best_of(ours.collect(), followers, plants, longest_s)
}

/// The gain with the least proven gamma among those of `gains` that are for these plants, this
/// delay and so many followers.
#[must_use]
pub fn best_of(
    gains: Vec<GainFile>,
    followers: usize,
    plants: &Plants,
    longest_s: f64,
) -> Option<GainFile> {
    let fits = |file: &GainFile| {
        let is_large_enough = file.trucks_max().is_none_or(|trucks| trucks > followers);
        file.plant.cover(plants) && file.delay.longest_s >= longest_s && is_large_enough
    };
    let gamma = |file: &GainFile| file.first_gamma().unwrap_or(f64::INFINITY);
    gains.into_iter().filter(fits).min_by(|a, b| gamma(a).total_cmp(&gamma(b)))
}
