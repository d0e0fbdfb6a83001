//! Options of `sweep`.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;

use super::LawArgs;
use super::values::parse_set;

/// Most seeds of one sweep: what comes of every run is kept until the end.
const SEEDS_MAX: u64 = 100_000;

/// Options of `sweep`.
#[derive(Debug, Clone, Args)]
pub struct SweepArgs {
    /// Scenarios: built-in names (see `platoon scenarios`) or paths of TOML files.
    #[arg(default_value = "obstacle-avoidance")]
    pub scenarios: Vec<String>,
    /// Seeds FIRST-LAST of everything random, or a single one.
    #[arg(long, value_name = "FIRST-LAST", default_value = "1-20")]
    pub seeds: SeedRange,
    /// Plants, as `plant.model` names them; the scenario's own when left out.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub plant: Vec<String>,
    /// Rate of the control loop in Hz.
    #[arg(long, value_name = "HZ", default_value_t = 100,
        value_parser = clap::value_parser!(u32).range(10..=10_000))]
    pub rate_hz: u32,
    /// How the law is run.
    #[command(flatten)]
    pub law_options: LawArgs,
    /// Override a number of the scenarios; may be given more than once.
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, String)>,
    /// Threads to run in; as many as there are CPUs when left out. The results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Where to write every figure as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Seeds in a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SeedRange(pub RangeInclusive<u64>);

impl FromStr for SeedRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const FORM: &str = "give FIRST-LAST, such as 1001-1100, or one number";
        let number = |part: &str| part.trim().parse::<u64>().map_err(|_| FORM.to_owned());
        let (first, last) = match text.split_once('-') {
            Some((first, last)) => (number(first)?, number(last)?),
            None => (number(text)?, number(text)?),
        };
        if first > last {
            return Err(format!("the first seed is above the last; {FORM}"));
        }
        if last - first >= SEEDS_MAX {
            return Err(format!("these are more than {SEEDS_MAX} seeds; sweep them in parts"));
        }
        Ok(Self(first..=last))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_a_range_or_a_number() {
        let parsed = |text: &str| text.parse::<SeedRange>().map(|range| range.0);
        assert_eq!(parsed("1001-1100"), Ok(1001..=1100));
        assert_eq!(parsed("7"), Ok(7..=7));
        for text in ["", "a", "1-", "-5", "9-1", "1-2-3", "0-100000"] {
            assert!(parsed(text).is_err(), "{text:?}");
        }
    }
}
