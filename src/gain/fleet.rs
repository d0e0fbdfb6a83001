//! `platoon gain fleet`: trucks that differ, a gain and a proof for each.

use std::time::Instant;

use certificate::Lags;
use clap::Args;
use synthesis::fleet;

use crate::failure::Failure;

use super::conditions::{parse_lags, parse_seconds};

/// Options of `gain fleet`.
#[derive(Debug, Clone, Args)]
pub struct FleetArgs {
    /// How many trucks follow.
    #[arg(long, value_name = "N", default_value_t = 100,
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    trucks: u32,
    /// Their lags in seconds, spread evenly from the least to the largest.
    #[arg(long, value_name = "LO-HI", default_value = "0.3-0.6", value_parser = parse_lags)]
    lag_s: Lags,
    /// Longest delay in seconds.
    #[arg(long, value_name = "S", default_value = "0.25", value_parser = parse_seconds)]
    delay_s: f64,
}

/// Designs and prints one line per truck, and the bound that holds for all.
///
/// # Errors
/// When one of them has no gain.
pub fn run(args: &FleetArgs) -> Result<(), Failure> {
    let Lags { lag_min_s, lag_max_s } = args.lag_s;
    let steps = f64::from(args.trucks.max(2) - 1);
    let lag = |i: u32| lag_min_s + (lag_max_s - lag_min_s) * f64::from(i) / steps;
    let lags_s: Vec<f64> = (0..args.trucks).map(lag).collect();
    let began = Instant::now();
    let say = &mut |i: usize| {
        if i.is_multiple_of(10) {
            anstream::eprintln!("truck {i} of {}", args.trucks);
        }
    };
    let trucks = fleet::design(&lags_s, args.delay_s, say).map_err(|why| {
        Failure::usage(format!("lags {:?}, delay {} s: {why}", args.lag_s, args.delay_s))
    })?;
    let elapsed_s = began.elapsed().as_secs_f64();
    for (i, truck) in trucks.iter().enumerate() {
        let gamma = truck.proofs.disturbance_to_error.gamma;
        let [position, speed, accel] = truck.gain.k1;
        anstream::println!(
            "{:5}  lag {:.3} s  K1 {position:.3} {speed:.3} {accel:.3}  gamma {gamma:.4}",
            i + 1,
            truck.lag_s
        );
    }
    anstream::println!(
        "\n{} trucks designed and proven in {elapsed_s:.1} s; no error exceeds {:.4} times its \
         disturbance, however many follow",
        trucks.len(),
        fleet::bound(&trucks)
    );
    Ok(())
}
