//! Option values with a form of their own, and how they are read.

use std::net::{Ipv4Addr, SocketAddr};

/// Which ECUs are processes under test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EcuChoice {
    /// Every truck's.
    All,
    /// One truck's; the rest run beside the rig.
    One(u8),
}

/// Bounds of the V2V transport delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct V2vDelay {
    /// Least delay \[s\].
    pub min_s: f64,
    /// Largest delay \[s\].
    pub max_s: f64,
}

impl V2vDelay {
    /// The scenario overrides that say the same.
    pub fn as_sets(self) -> [(String, String); 2] {
        [("v2v.delay_min_s", self.min_s), ("v2v.delay_max_s", self.max_s)]
            .map(|(key, value)| (key.to_owned(), format!("{value:?}")))
    }
}

/// A time that is not negative \[s\].
pub(super) fn parse_seconds(text: &str) -> Result<f64, String> {
    let allowed = "give seconds of bench time, 0 or more".to_owned();
    let time_s: f64 = text.parse().map_err(|_| allowed.clone())?;
    if time_s.is_finite() && time_s >= 0.0 { Ok(time_s) } else { Err(allowed) }
}

pub(super) fn parse_ecu(text: &str) -> Result<EcuChoice, String> {
    match text {
        "all" => Ok(EcuChoice::All),
        number => number
            .parse()
            .map(EcuChoice::One)
            .map_err(|_| "give all, or the number of a truck from 0 (the leader) on".to_owned()),
    }
}

pub(super) fn parse_delay(text: &str) -> Result<V2vDelay, String> {
    const FORM: &str = "give LO-HI in milliseconds, such as 15-150, or none";
    if text == "none" {
        return Ok(V2vDelay { min_s: 0.0, max_s: 0.0 });
    }
    let (low, high) = text.split_once('-').ok_or(FORM)?;
    let number =
        |part: &str| part.trim().parse::<f64>().ok().filter(|x| x.is_finite() && *x >= 0.0);
    match (number(low), number(high)) {
        (Some(low), Some(high)) if low <= high => {
            Ok(V2vDelay { min_s: 1e-3 * low, max_s: 1e-3 * high })
        }
        (Some(_), Some(_)) => Err(format!("the lower delay is above the upper; {FORM}")),
        _ => Err(FORM.to_owned()),
    }
}

pub(super) fn parse_gateway(text: &str) -> Result<SocketAddr, String> {
    let port = text.parse().map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    port.or_else(|_| text.parse()).map_err(|_| {
        "give a port, such as 29536, or ADDRESS:PORT, such as 192.168.0.7:29536".to_owned()
    })
}

pub(super) fn parse_set(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => {
            Ok((key.trim().to_owned(), value.trim().to_owned()))
        }
        _ => Err("give KEY=VALUE, such as v2v.loss=0.1".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_are_read_in_milliseconds_and_nonsense_is_refused() {
        let delay = parse_delay("15-150").expect("well formed");
        assert!((delay.min_s - 0.015).abs() < 1e-12 && (delay.max_s - 0.15).abs() < 1e-12);
        assert_eq!(parse_delay("none"), Ok(V2vDelay { min_s: 0.0, max_s: 0.0 }));
        for nonsense in ["", "15", "150-15", "a-b", "-5-10", "NaN-1", "1-inf"] {
            assert!(parse_delay(nonsense).is_err(), "{nonsense}");
        }
    }
}
