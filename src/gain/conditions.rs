//! What a gain is for, in words: lags, delays, and where its file is.

use std::fs;

use certificate::{GainFile, Lags, Rate, library};

use crate::failure::Failure;

/// A gain of the library by its name, or a file by its path; with its number in the library.
///
/// # Errors
/// When there is neither.
pub fn find(name: &str) -> Result<(u8, GainFile), Failure> {
    if let Some(found) = library::named(name) {
        return Ok(found);
    }
    let text = fs::read_to_string(name).map_err(|error| {
        Failure::usage(format!(
            "gain {name}: {error}; name a file, or a gain that `platoon gain list` shows"
        ))
    })?;
    let file =
        GainFile::parse(&text).map_err(|error| Failure::usage(format!("gain {name}: {error}")))?;
    Ok((0, file))
}

/// Lags as users type them.
pub fn shown(lags: &Lags) -> String {
    let Lags { lag_min_s, lag_max_s } = lags;
    if lag_min_s == lag_max_s { lag_min_s.to_string() } else { format!("{lag_min_s}-{lag_max_s}") }
}

/// One lag, or the least and the largest.
pub fn parse_lags(text: &str) -> Result<Lags, String> {
    const FORM: &str = "give a lag in seconds, such as 0.45, or a range, such as 0.15-0.27";
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|x| x.is_finite() && *x > 0.0);
    let (low, high) = text.split_once('-').unwrap_or((text, text));
    match (number(low), number(high)) {
        (Some(lag_min_s), Some(lag_max_s)) if lag_min_s <= lag_max_s => {
            Ok(Lags { lag_min_s, lag_max_s })
        }
        _ => Err(FORM.to_owned()),
    }
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
