//! `platoon gain scan`: the whole grid of gains, and which of them nothing on it beats.
//!
//! No matrix inequality is asked: a gain counts when the small-gain theorem promises stability for
//! delays up to the bound at any rate, and is measured by its peak over frequency, its margin for
//! constant delays, and one simulated run of the paper's platooning scenario.

use certificate::simulation::Run;
use std::fs;
use std::path::{Path, PathBuf};

use certificate::{Gain, GainFile, library, margin};
use clap::Args;

use crate::compare::figure::Figure;
use crate::compare::picture;
use crate::failure::Failure;

use super::conditions::parse_seconds;
use super::figures;

/// The grid of K1: first, last and step of each of its three numbers.
const GRID: [(f64, f64, f64); 3] = [(1.4, 6.0, 0.2), (2.0, 6.0, 0.2), (0.2, 2.4, 0.1)];

/// Options of `gain scan`.
#[derive(Debug, Clone, Args)]
pub struct ScanArgs {
    /// Lag of the trucks in seconds.
    #[arg(long, value_name = "S", default_value = "0.45", value_parser = parse_seconds)]
    lag_s: f64,
    /// Longest delay in seconds.
    #[arg(long, value_name = "S", default_value = "0.25", value_parser = parse_seconds)]
    delay_s: f64,
    /// Largest command allowed in the simulated run in m/s².
    #[arg(long, value_name = "MPS2", default_value = "6.5", value_parser = parse_seconds)]
    command_max: f64,
    /// Lines to print.
    #[arg(long, value_name = "N", default_value_t = 20)]
    lines: usize,
    /// Folder for pictures of the trade-off and of the library's margins, and for their numbers.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// A gain by what it is good for; less is better in all of the first three but the margin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Merit {
    gain: Gain,
    /// Peak over frequency from the disturbance to the error, at the longest delay.
    pub peak: f64,
    /// Largest error of the simulated run \[m\].
    error_m: f64,
    /// Longest constant delay \[s\].
    pub margin_s: f64,
    /// Longest delay at any rate, by small gain \[s\].
    any_rate_s: f64,
    /// Largest command of the simulated run \[m/s²\].
    pub command_mps2: f64,
}

impl Merit {
    fn of(gain: Gain, args: &ScanArgs) -> Self {
        let outcome = Run::ramp(gain, args.lag_s).simulate();
        Self {
            gain,
            peak: margin::peaks(&gain, args.lag_s, args.delay_s).error,
            error_m: outcome.error_max_m,
            margin_s: margin::delay_margin_s(&gain, args.lag_s),
            any_rate_s: margin::any_rate_small_gain_s(&gain, args.lag_s),
            command_mps2: outcome.command_max_mps2,
        }
    }

    /// At least as good in everything.
    fn is_as_good_as(&self, other: &Self) -> bool {
        self.peak <= other.peak && self.error_m <= other.error_m && self.margin_s >= other.margin_s
    }

    fn line(&self) -> String {
        let [position, speed, accel] = self.gain.k1;
        format!(
            "{position:.3} {speed:.3} {accel:.3}   {:.3}   {:.3}    {:.3}    {:.3}     {:.2}",
            self.peak, self.error_m, self.margin_s, self.any_rate_s, self.command_mps2
        )
    }
}

/// Scans; prints the gains that beat the published one, and those that nothing on the grid beats.
///
/// # Errors
/// When the published gain is missing, or a file cannot be written.
pub fn run(args: &ScanArgs) -> Result<(), Failure> {
    let (_, file) = library::named("published")
        .ok_or_else(|| Failure::cannot_start("the library has no gain named published"))?;
    let published = Merit::of(Gain { k2: [0.0; 3], ..file.gain }, args);
    let gains: Vec<Gain> = admissible(args).collect();
    let merit = |(i, gain): (usize, &Gain)| {
        if i.is_multiple_of(1000) {
            anstream::eprintln!("gain {i} of {}", gains.len());
        }
        Merit::of(*gain, args)
    };
    let mut allowed: Vec<Merit> = gains.iter().enumerate().map(merit).collect();
    allowed.retain(|merit| merit.command_mps2 <= args.command_max);
    allowed.sort_by(|a, b| a.error_m.total_cmp(&b.error_m));
    let better: Vec<Merit> =
        allowed.iter().filter(|merit| merit.is_as_good_as(&published)).copied().collect();
    let front: Vec<Merit> = front(&allowed);

    anstream::println!("K1                  peak    error m  margin s any rate s command m/s²");
    anstream::println!("{}   the published gain\n", published.line());
    anstream::println!(
        "{} gains of the grid are stable for delays up to {} s at any rate; {} of them beat the \
         published one in peak, error and margin at once:",
        allowed.len(),
        args.delay_s,
        better.len()
    );
    print_some(&better, args.lines);
    anstream::println!(
        "\n{} are beaten by none (the Pareto front), from least error:",
        front.len()
    );
    print_some(&front, args.lines);
    let Some(folder) = &args.out else { return Ok(()) };
    let drawn = [figures::trade_off(&allowed, &published, args.delay_s), library_margins()?];
    drawn.iter().try_for_each(|figure| write(folder, figure))
}

/// The margins of the library's gains, each once.
fn library_margins() -> Result<Figure, Failure> {
    let mut gains: Vec<GainFile> = Vec::new();
    for file in library::all().map_err(Failure::cannot_start)? {
        if gains.iter().all(|known| known.gain.k1 != file.gain.k1) {
            gains.push(file);
        }
    }
    Ok(figures::margins(&gains))
}

/// A figure's picture and its numbers.
fn write(folder: &Path, figure: &Figure) -> Result<(), Failure> {
    let mut files = vec![(format!("{}.svg", figure.file), picture::svg(figure))];
    files.extend(figure.tables());
    fs::create_dir_all(folder)
        .and_then(|()| {
            files.into_iter().try_for_each(|(name, text)| fs::write(folder.join(name), text))
        })
        .map_err(|error| Failure::cannot_start(format!("{}: {error}", folder.display())))?;
    anstream::eprintln!("written to {}", folder.join(format!("{}.svg", figure.file)).display());
    Ok(())
}

/// The gains of the grid that are stable at any rate up to the longest delay.
fn admissible(args: &ScanArgs) -> impl Iterator<Item = Gain> {
    let (lag_s, delay_s) = (args.lag_s, args.delay_s);
    let [first, second, third] = GRID.map(|(from, to, step)| {
        let count = ((to - from) / step).round() as usize;
        (0..=count).map(move |i| from + step * i as f64).collect::<Vec<f64>>()
    });
    let mut gains = Vec::new();
    for k in first.iter().flat_map(|p| second.iter().map(move |s| (*p, *s))) {
        gains.extend(third.iter().map(|accel| Gain { k1: [k.0, k.1, *accel], ..Gain::default() }));
    }
    gains.into_iter().filter(move |gain| {
        // The closed form is cheap and refuses most; the sweep has the last word.
        margin::delay_margin_s(gain, lag_s) > delay_s
            && margin::any_rate_small_gain_s(gain, lag_s) > delay_s
    })
}

/// Those that no other is as good as in everything.
fn front(merits: &[Merit]) -> Vec<Merit> {
    let is_beaten =
        |merit: &Merit| merits.iter().any(|other| other != merit && other.is_as_good_as(merit));
    merits.iter().filter(|merit| !is_beaten(merit)).copied().collect()
}

/// So many of them, evenly spread.
fn print_some(merits: &[Merit], lines: usize) {
    let step = merits.len().div_ceil(lines.max(1)).max(1);
    for merit in merits.iter().step_by(step) {
        anstream::println!("{}", merit.line());
    }
}
