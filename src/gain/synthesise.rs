//! `platoon gain synthesise`: from what is wanted to a file that a check has accepted.

use std::fs;
use std::path::PathBuf;

use certificate::{Conditions, DelayBound, Gain, GainFile, Plants, Rate};
use clap::{Args, ValueEnum};
use synthesis::prove::{self, Claim};
use synthesis::tradeoff::{self, Candidate, Limits, Objective};
use synthesis::{Design, Disturbance, Platoon, Undesigned, complementarity, convex, wirtinger};

use crate::cli::Word;
use crate::failure::Failure;
use crate::summary::Verdict;

use super::certify;
use super::conditions::{
    Range, find, parse_range, parse_rate, parse_seconds, parse_three, plants, shown,
};

/// The gamma from which a search for the least one starts: far above any useful one.
const GAMMA_WORST: f64 = 2.0;
/// How close to the least gamma a bisection goes, relative.
const BISECTION: f64 = 0.02;
/// Time between messages that the gain is certified with at once \[s\].
const PERIOD_S: f64 = 0.02;

/// Options of `gain synthesise`.
#[derive(Debug, Clone, Args)]
pub struct SynthesiseArgs {
    /// Name of the gain.
    #[arg(long, default_value = "synthesised")]
    name: String,
    /// Where it comes from, for people who read the file.
    #[arg(long, value_name = "TEXT")]
    about: Option<String>,
    /// Lag of the trucks in seconds, or the least and the largest.
    #[arg(long, value_name = "S|LO-HI", default_value = "0.45", value_parser = parse_range)]
    lag_s: Range,
    /// Gain of the trucks, acceleration per commanded acceleration, or the least and the largest.
    #[arg(long, value_name = "G|LO-HI", default_value = "1", value_parser = parse_range)]
    plant_gain: Range,
    /// Longest delay in seconds.
    #[arg(long, value_name = "S", default_value = "0.25", value_parser = parse_seconds)]
    delay_s: f64,
    /// How fast the delay may grow: any, or a bound of its derivative below 1.
    #[arg(long, value_name = "any|MU", default_value = "any", value_parser = parse_rate)]
    rate: Rate,
    /// Way to the gain.
    #[arg(long, value_enum, default_value_t = Method::Convex)]
    method: Method,
    /// Design many, and choose by what is wanted; prints the table of those that none beats.
    #[arg(long, value_enum, conflicts_with_all = ["method", "gamma", "followers",
          "common_disturbance", "keep", "k1"])]
    objective: Option<Wanted>,
    /// What --objective may choose from: gamma at most.
    #[arg(long, value_name = "GAMMA", value_parser = parse_seconds, requires = "objective")]
    gamma_max: Option<f64>,
    /// The same: stable for constant delays of at least so many seconds.
    #[arg(long, value_name = "S", value_parser = parse_seconds, requires = "objective")]
    margin_min_s: Option<f64>,
    /// The same: the largest command in the paper's platooning manoeuvre, in m/s², about what the
    /// actuators can do.
    #[arg(long, value_name = "MPS2", value_parser = parse_seconds, requires = "objective")]
    command_max: Option<f64>,
    /// Gamma to reach; the least there is when left out. Only with --method complementarity.
    #[arg(long, value_name = "GAMMA", value_parser = parse_seconds)]
    gamma: Option<f64>,
    /// Followers that are designed together.
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u8).range(1..=4))]
    followers: u8,
    /// Let all followers have the leader's disturbance instead of one each.
    #[arg(long)]
    common_disturbance: bool,
    /// Design nothing: prove what this gain (a file or a name) can claim here.
    #[arg(long, value_name = "FILE|NAME", conflicts_with = "k1")]
    keep: Option<String>,
    /// Design nothing: prove what K1 can claim here.
    #[arg(long, value_name = "K,K,K", value_parser = parse_three, allow_hyphen_values = true)]
    k1: Option<[f64; 3]>,
    /// K2 beside --k1.
    #[arg(long, value_name = "K,K,K", value_parser = parse_three, requires = "k1",
          allow_hyphen_values = true)]
    k2: Option<[f64; 3]>,
    /// Feed the leader's acceleration forward.
    #[arg(long)]
    feedforward: bool,
    /// Platoons of up to so many followers get a proof of their own.
    #[arg(long, value_name = "N", default_value_t = 3,
          value_parser = clap::value_parser!(u8).range(0..=5))]
    prove: u8,
    /// Where to write the gain file; printed when left out.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Ways to a gain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    /// Convex bound, search over its parameter, refinement: the least gamma.
    Convex,
    /// The paper's cone complementarity linearisation.
    Complementarity,
    /// Wirtinger's inequality instead of Jensen's, for delays of any rate; one follower.
    Wirtinger,
}

/// What a gain is chosen by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Wanted {
    /// The least gamma.
    Gamma,
    /// The longest constant delay.
    Margin,
    /// The least of the largest commands.
    Command,
    /// What gives up least in each of the three.
    Balanced,
}

impl From<Wanted> for Objective {
    fn from(wanted: Wanted) -> Self {
        match wanted {
            Wanted::Gamma => Self::Gamma,
            Wanted::Margin => Self::Margin,
            Wanted::Command => Self::Command,
            Wanted::Balanced => Self::Balanced,
        }
    }
}

/// Designs, proves, checks, writes.
///
/// # Errors
/// When there is no such gain, or the file cannot be written.
pub fn run(args: &SynthesiseArgs) -> Result<Verdict, Failure> {
    let (gain, about) = chosen(args)?;
    let claim = Claim {
        name: args.name.clone(),
        about: args.about.clone().unwrap_or(about),
        gain,
        plants: args.plants(),
        delay: args.delay(),
        followers: usize::from(args.prove),
    };
    let say = &mut |what: &str| anstream::eprintln!("proving: {what}");
    let file = match prove::prove(&claim, say) {
        Ok(file) => file,
        Err(why) => {
            anstream::eprintln!("gain {}: no proof: {why}", claim.name);
            return Ok(Verdict::Fail);
        }
    };
    let conditions = Conditions::of(&file, PERIOD_S);
    let certified = certificate::certify(&file, &conditions);
    anstream::eprintln!("{}", certify::page(&file, &conditions, &certified));
    if !certified.is_certified() {
        return Ok(Verdict::Fail);
    }
    write(args, &file)?;
    Ok(Verdict::Pass)
}

impl SynthesiseArgs {
    fn delay(&self) -> DelayBound {
        DelayBound { longest_s: self.delay_s, rate: self.rate }
    }

    fn refusal(&self, why: impl std::fmt::Display) -> Failure {
        let plants = shown(&self.plants());
        Failure::usage(format!("{plants}, delays up to {} s: {why}", self.delay_s))
    }

    fn plants(&self) -> Plants {
        plants(self.lag_s, self.plant_gain)
    }

    /// The platoons at the corners of the plants.
    fn corners(&self) -> Vec<Platoon> {
        let disturbance =
            if self.common_disturbance { Disturbance::Common } else { Disturbance::Independent };
        let platoon =
            |plant| Platoon { disturbance, ..Platoon::alike(usize::from(self.followers), plant) };
        self.plants().corners().into_iter().map(platoon).collect()
    }
}

/// The gain to prove, and where it comes from.
fn chosen(args: &SynthesiseArgs) -> Result<(Gain, String), Failure> {
    let (gain, about) = if let Some(name) = &args.keep {
        let file = find(name)?;
        (file.gain, file.about)
    } else if let Some(k1) = args.k1 {
        let k2 = args.k2.unwrap_or([0.0; 3]);
        (Gain { k1, k2, leader_feedforward: false }, "given by hand".to_owned())
    } else if let Some(objective) = args.objective {
        (chosen_among_many(args, objective)?.gain, format!("{} of many designs", objective.word()))
    } else {
        let design = designed(args).map_err(|why| args.refusal(why))?;
        let steps = design.iterations;
        (design.common_gain(), format!("{} after {steps} programs", args.method.described()))
    };
    Ok((Gain { leader_feedforward: gain.leader_feedforward || args.feedforward, ..gain }, about))
}

/// Designs many, shows those that none beats, and takes the one that is wanted.
fn chosen_among_many(args: &SynthesiseArgs, wanted: Wanted) -> Result<Candidate, Failure> {
    let say = &mut |number, count| anstream::eprintln!("design {number} of {count}");
    let plants = args.plants();
    let found =
        tradeoff::candidates(&plants, args.delay_s, say).map_err(|why| args.refusal(why))?;
    let limits = Limits {
        gamma_max: args.gamma_max.unwrap_or(Limits::NONE.gamma_max),
        margin_min_s: args.margin_min_s.unwrap_or(Limits::NONE.margin_min_s),
        command_max_mps2: args.command_max.unwrap_or(Limits::NONE.command_max_mps2),
    };
    let chosen = tradeoff::choose(&found, wanted.into(), &limits);
    anstream::eprintln!("K1                  gamma   margin s any rate s error m command m/s²");
    for one in tradeoff::front(&found) {
        let [position, speed, accel] = one.gain.k1;
        let mark = if chosen == Some(one) { "  chosen" } else { "" };
        anstream::eprintln!(
            "{position:.3} {speed:.3} {accel:.3}   {:.4}  {:.3}    {:.3}      {:.3}   {:.2}{mark}",
            one.gamma,
            one.margin_s,
            one.any_rate_s,
            one.error_m,
            one.command_mps2
        );
    }
    chosen.ok_or_else(|| args.refusal("no design keeps the limits; widen them"))
}

fn designed(args: &SynthesiseArgs) -> Result<Design, Undesigned> {
    let (corners, delay) = (args.corners(), args.delay());
    match args.method {
        Method::Convex => convex::refined(&corners, delay, &mut |step, gamma| {
            anstream::eprintln!("refinement {step}: gamma {gamma:.4}");
        }),
        Method::Wirtinger => wirtinger::search(&args.corners()[..], args.delay_s),
        Method::Complementarity => {
            let say = &mut |step| anstream::eprintln!("linearisation {step}");
            match args.gamma {
                Some(gamma) => complementarity::reach(&corners[0], delay, gamma, say),
                None => complementarity::least(&corners[0], delay, GAMMA_WORST, BISECTION, say),
            }
        }
    }
}

impl Method {
    const fn described(self) -> &'static str {
        match self {
            Self::Convex => "convex bound of Theorem 1, refined",
            Self::Complementarity => "Theorem 1 by cone complementarity",
            Self::Wirtinger => "Wirtinger's inequality with a descriptor",
        }
    }
}

fn write(args: &SynthesiseArgs, file: &GainFile) -> Result<(), Failure> {
    let text = file.to_toml();
    match &args.out {
        None => anstream::print!("{text}"),
        Some(path) => {
            fs::write(path, text).map_err(|error| {
                Failure::cannot_start(format!("cannot write {}: {error}", path.display()))
            })?;
            anstream::eprintln!("written to {}", path.display());
        }
    }
    Ok(())
}
