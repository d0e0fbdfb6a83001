//! What a gain is for, in words: lags, delays, and where its file is.

use std::fs;
use std::path::Path;

use certificate::{GainFile, Plants, Rate, library};

use crate::failure::Failure;

/// A gain of the library by its name, or a file by its path.
///
/// # Errors
/// When there is neither.
pub fn find(name: &str) -> Result<GainFile, Failure> {
    match library::named(name) {
        Some((_, file)) => Ok(file),
        None => read(Path::new(name)),
    }
}

/// All gain files of a folder, by name.
///
/// # Errors
/// When it cannot be read, has none, or one of them is no gain file.
pub fn folder(path: &str) -> Result<Vec<GainFile>, Failure> {
    let unreadable = |error| Failure::usage(format!("gains in {path}: {error}"));
    let entries = fs::read_dir(path).map_err(unreadable)?;
    let mut paths: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    paths.sort();
    if paths.is_empty() {
        return Err(Failure::usage(format!("gains in {path}: no .toml file is there")));
    }
    paths.iter().map(|path| read(path)).collect()
}

fn read(path: &Path) -> Result<GainFile, Failure> {
    let name = path.display();
    let text = fs::read_to_string(path).map_err(|error| {
        Failure::usage(format!(
            "gain {name}: {error}; name a file, or a gain that `platoon gain list` shows"
        ))
    })?;
    GainFile::parse(&text).map_err(|error| Failure::usage(format!("gain {name}: {error}")))
}

/// Plants in words: their lag in seconds, and their gain where it is not 1.
pub fn shown(plants: &Plants) -> String {
    let lag = range_shown((plants.lag_min_s, plants.lag_max_s));
    match (plants.gain_min, plants.gain_max) {
        (1.0, 1.0) => format!("lag {lag} s"),
        gains => format!("lag {lag} s, gain {}", range_shown(gains)),
    }
}

/// Digits shown of a bound; what is left out is rounding.
const PLACES: f64 = 1e4;

fn range_shown((low, high): (f64, f64)) -> String {
    let [low, high] = [low, high].map(|x| (x * PLACES).round() / PLACES);
    if low == high { low.to_string() } else { format!("{low}-{high}") }
}

/// A lag or a gain, or the least and the largest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range(pub f64, pub f64);

/// One number, or the least and the largest.
pub fn parse_range(text: &str) -> Result<Range, String> {
    const FORM: &str = "give a number greater than 0, such as 0.45, or a range, such as 0.15-0.27";
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|x| x.is_finite() && *x > 0.0);
    let (low, high) = text.split_once('-').unwrap_or((text, text));
    match (number(low), number(high)) {
        (Some(low), Some(high)) if low <= high => Ok(Range(low, high)),
        _ => Err(FORM.to_owned()),
    }
}

/// The plants of a lag and a gain.
pub fn plants(lag_s: Range, plant_gain: Range) -> Plants {
    let (Range(lag_min_s, lag_max_s), Range(gain_min, gain_max)) = (lag_s, plant_gain);
    Plants { lag_min_s, lag_max_s, gain_min, gain_max }
}

/// `any`, or the largest derivative of the delay.
pub fn parse_rate(text: &str) -> Result<Rate, String> {
    if text == "any" {
        return Ok(Rate::Any);
    }
    let below = text.parse().ok().filter(|mu| (0.0..1.0).contains(mu)).map(Rate::Below);
    below.ok_or_else(|| "give any, or a number from 0 up to less than 1".to_owned())
}

/// A positive number of seconds.
pub fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0);
    seconds.ok_or_else(|| "give a number of seconds greater than 0".to_owned())
}

/// The three gains of a vehicle's state.
pub fn parse_three(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite()))
        .collect();
    let three = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    three.ok_or_else(|| "give three gains, such as 2.156,3.175,0.998".to_owned())
}
