//! `platoon gain fleet`: trucks that differ, a gain and a proof for each, or one gain for all.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use certificate::{Conditions, Corner, Gain, GainFile, mixed_string_bound};
use clap::Args;
use synthesis::fleet;

use crate::failure::Failure;
use crate::summary::Verdict;

use super::conditions::{Range, find, parse_range, parse_seconds};

/// Time between messages that the gains are checked with \[s\]; no proof depends on it.
const PERIOD_S: f64 = 0.02;

/// Options of `gain fleet`.
#[derive(Debug, Clone, Args)]
pub struct FleetArgs {
    /// How many trucks follow.
    #[arg(long, value_name = "N", default_value_t = 100,
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    trucks: u32,
    /// Their lags in seconds, spread evenly from the least to the largest.
    #[arg(long, value_name = "LO-HI", default_value = "0.3-0.6", value_parser = parse_range)]
    lag_s: Range,
    /// Their gains, acceleration per commanded acceleration, spread likewise.
    #[arg(long, value_name = "G|LO-HI", default_value = "1", value_parser = parse_range)]
    plant_gain: Range,
    /// Longest delay in seconds.
    #[arg(long, value_name = "S", default_value = "0.25", value_parser = parse_seconds)]
    delay_s: f64,
    /// Design nothing: prove what this gain, a file or a name, does in every truck, and with K2 the
    /// bound of what they do to each other.
    #[arg(long, value_name = "FILE|NAME")]
    keep: Option<String>,
    /// Folder for the gain files, a library for `rehearse --gain DIR`.
    #[arg(long, value_name = "DIR", conflicts_with = "keep")]
    out: Option<PathBuf>,
}

impl FleetArgs {
    fn plants(&self) -> Vec<Corner> {
        let steps = f64::from(self.trucks.max(2) - 1);
        let between = |Range(low, high): Range, i: u32| low + (high - low) * f64::from(i) / steps;
        let plant = |i| Corner { lag_s: between(self.lag_s, i), gain: between(self.plant_gain, i) };
        (0..self.trucks).map(plant).collect()
    }

    fn say(&self, i: usize) {
        if i.is_multiple_of(10) {
            anstream::eprintln!("truck {} of {}", i + 1, self.trucks);
        }
    }

    fn refusal(&self, why: impl std::fmt::Display) -> Failure {
        let Range(low, high) = self.lag_s;
        Failure::usage(format!("lags {low}-{high} s, delays up to {} s: {why}", self.delay_s))
    }
}

/// Designs or proves, checks, prints one line per truck and the bound that holds for all.
///
/// # Errors
/// When one of the trucks has no gain or no proof, or a file cannot be written.
pub fn run(args: &FleetArgs) -> Result<Verdict, Failure> {
    match &args.keep {
        Some(name) => keep(args, &find(name)?.gain),
        None => design(args),
    }
}

fn design(args: &FleetArgs) -> Result<Verdict, Failure> {
    let began = Instant::now();
    let files = fleet::design(&args.plants(), args.delay_s, &mut |i| args.say(i))
        .map_err(|why| args.refusal(why))?;
    let is_certified = |file: &&GainFile| {
        certificate::proofs(file, &Conditions::of(file, PERIOD_S)).is_certified()
    };
    let certified = files.iter().filter(is_certified).count();
    let elapsed_s = began.elapsed().as_secs_f64();
    for file in &files {
        let [position, speed, accel] = file.gain.k1;
        anstream::println!(
            "{:10} {}  K1 {position:.3} {speed:.3} {accel:.3}  gamma {}",
            file.name,
            of(&Corner { lag_s: file.plant.lag_min_s, gain: file.plant.gain_min }),
            file.first_gamma().unwrap_or(f64::NAN)
        );
    }
    anstream::println!(
        "\n{certified} of {} trucks designed, proven and checked in {elapsed_s:.1} s; no error \
         exceeds {:.4} times its disturbance, however many follow",
        files.len(),
        fleet::bound(&files).unwrap_or(f64::NAN)
    );
    if let Some(folder) = &args.out {
        write(folder, &files)?;
    }
    Ok(if certified == files.len() { Verdict::Pass } else { Verdict::Fail })
}

fn keep(args: &FleetArgs, gain: &Gain) -> Result<Verdict, Failure> {
    let plants = args.plants();
    let proofs = fleet::shared(gain, &plants, args.delay_s, &mut |i| args.say(i))
        .map_err(|why| args.refusal(why))?;
    for (i, (plant, proof)) in plants.iter().zip(&proofs).enumerate() {
        let own = proof.disturbance_to_error.gamma;
        let forwarded = proof.coupling.as_ref().map_or(0.0, |c| c.forwarded_to_forwarded.gamma);
        anstream::println!(
            "truck-{:<4} {}  gamma {own}, truck to truck {forwarded}",
            i + 1,
            of(plant)
        );
    }
    let bound = mixed_string_bound(&proofs, 0.0);
    match bound {
        Some(bound) => anstream::println!(
            "\nno error exceeds {bound:.4} times the disturbance, in whatever order and however \
             many of these trucks follow (constant delays; {:.4} when they grow by 0.5 s/s)",
            mixed_string_bound(&proofs, 0.5).unwrap_or(f64::INFINITY)
        ),
        None => anstream::println!("\nwhat is forwarded may grow from truck to truck: no bound"),
    }
    Ok(if bound.is_some() { Verdict::Pass } else { Verdict::Fail })
}

fn of(plant: &Corner) -> String {
    format!("lag {:.3} s, gain {:.3}", plant.lag_s, plant.gain)
}

fn write(folder: &Path, files: &[GainFile]) -> Result<(), Failure> {
    let path = |file: &GainFile| folder.join(format!("{}.toml", file.name));
    fs::create_dir_all(folder)
        .and_then(|()| files.iter().try_for_each(|file| fs::write(path(file), file.to_toml())))
        .map_err(|error| Failure::cannot_start(format!("{}: {error}", folder.display())))?;
    anstream::eprintln!("{} gain files written to {}", files.len(), folder.display());
    Ok(())
}
