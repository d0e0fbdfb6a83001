//! Which gain an ECU drives with, and whether it may.
//!
//! The check is made where an ECU is put together, not inside it: the loop has no files and does
//! not know what a certificate is. It costs no solver, only the exact evaluation of the proofs that
//! came with the gain, once, before the loop starts.

use certificate::{Conditions, GainFile, Lags, library};
use law::{Calibration, CoordinationLaw, Structure};

use crate::cli::LawArgs;
use crate::failure::Failure;

use super::conditions::{find, shown};

/// Time between messages where nobody says it \[s\]; no proof depends on it.
const PERIOD_S: f64 = 0.02;

/// A calibration whose gain is chosen and admitted.
#[derive(Debug, Clone, PartialEq)]
pub struct Settled {
    /// What the law runs with.
    pub calibration: Calibration,
    /// The gain's number in the library, for `EcuStatus`; 0 when it has none.
    pub gain_id: u8,
    /// What there is to say about the gain; nothing when the law has none.
    pub note: Option<String>,
}

/// The calibration with its gain: named by the options, or looked up by the number of trucks, the
/// lag and the delay bound, and admitted if it is certified for both.
///
/// # Errors
/// When there is no such gain, none fits, or it is not certified and nobody allowed that.
pub fn settled(
    mut calibration: Calibration,
    options: &LawArgs,
    trucks: Option<usize>,
) -> Result<Settled, Failure> {
    let named = options.gain.as_deref().map(find).transpose()?;
    if let Some((_, file)) = &named {
        adopt(&mut calibration, file);
    }
    if !has_gain(&calibration) {
        return Ok(Settled { calibration, gain_id: 0, note: None });
    }
    let looked_up = named.is_none() && calibration.ucl.law == CoordinationLaw::Synthesised;
    let known = if looked_up {
        let found = look_up(&calibration, trucks)?;
        adopt(&mut calibration, &found.1);
        Some(found)
    } else {
        named.or_else(|| in_library(&calibration))
    };
    let gain_id = known.as_ref().map_or(0, |(id, _)| *id);
    let note = match admitted(&calibration, known.as_ref().map(|(_, file)| file)) {
        Ok(note) => note,
        Err(why) if options.uncertified => format!("gain NOT CERTIFIED, allowed by you: {why}"),
        Err(why) => {
            return Err(Failure::cannot_start(format!(
                "{why}; design one with `platoon gain synthesise`, or allow it with --uncertified"
            )));
        }
    };
    Ok(Settled { calibration, gain_id, note: Some(note) })
}

/// Whether the law drives with a gain at all.
fn has_gain(calibration: &Calibration) -> bool {
    use CoordinationLaw::{Feedforward, Published, Synthesised};
    calibration.structure == Structure::Mcf
        && matches!(calibration.ucl.law, Published | Feedforward | Synthesised)
}

/// Takes the gain of a file over.
fn adopt(calibration: &mut Calibration, file: &GainFile) {
    (calibration.ucl.k1, calibration.ucl.k2) = (file.gain.k1, file.gain.k2);
    calibration.ucl.law = if file.gain.leader_feedforward {
        CoordinationLaw::Feedforward
    } else {
        CoordinationLaw::Synthesised
    };
}

/// The best of the library for this lag, delay bound and number of trucks.
fn look_up(calibration: &Calibration, trucks: Option<usize>) -> Result<(u8, GainFile), Failure> {
    let (lag_s, longest_s) = (calibration.ucl.lag_s, calibration.ucl.delay_bound_s);
    // Who does not know the number of trucks needs a gain for any.
    let followers = trucks.map_or(usize::MAX, |trucks| trucks.saturating_sub(1));
    library::best_for(followers, &Lags::only(lag_s), longest_s).ok_or_else(|| {
        Failure::cannot_start(format!(
            "the library has no gain for a lag of {lag_s} s and delays up to {longest_s} s; \
             design one with `platoon gain synthesise` and name it with --gain"
        ))
    })
}

/// The library's entry with exactly this gain, preferring one that is for this lag.
fn in_library(calibration: &Calibration) -> Option<(u8, GainFile)> {
    let ucl = &calibration.ucl;
    let lags = Lags::only(ucl.lag_s);
    let same = library::all().ok()?.into_iter().zip(1..);
    let mut same: Vec<_> = same
        .filter(|(file, _)| (file.gain.k1, file.gain.k2) == (ucl.k1, ucl.k2))
        .map(|(file, id)| (id, file))
        .collect();
    same.sort_by_key(|(_, file)| !file.plant.cover(&lags));
    same.into_iter().next()
}

/// What the certificate is worth here, or why it is not enough.
fn admitted(calibration: &Calibration, file: Option<&GainFile>) -> Result<String, String> {
    let ucl = &calibration.ucl;
    let Some(file) = file else {
        return Err(format!("the gain K1 {:?}, K2 {:?} has no certificate", ucl.k1, ucl.k2));
    };
    let conditions = Conditions {
        lags: Lags::only(ucl.lag_s),
        longest_s: ucl.delay_bound_s,
        period_s: PERIOD_S,
    };
    let covers = file.plant.cover(&conditions.lags) && file.delay.longest_s >= conditions.longest_s;
    let is_for = format!(
        "gain {} is for a lag of {} s and delays up to {} s",
        file.name,
        shown(&file.plant),
        file.delay.longest_s
    );
    let asked = format!("a lag of {} s and delays up to {} s", ucl.lag_s, ucl.delay_bound_s);
    if !covers {
        return Err(format!("{is_for}, not for {asked} (law.ucl.lag_s, law.ucl.delay_bound_s)"));
    }
    let stability = certificate::stability(file, &conditions);
    match stability.findings.iter().find(|finding| !finding.is_passed) {
        Some(finding) => Err(format!("gain {}: {} does not hold", file.name, finding.what)),
        None => Ok(format!("{is_for} at any rate, certified; the law declares {asked}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Cli;
    use clap::Parser;

    fn settle(words: &[&str], change: fn(&mut Calibration)) -> Result<Settled, Failure> {
        let cli = Cli::parse_from([&["platoon"], words].concat());
        let mut calibration = Calibration::default();
        change(&mut calibration);
        let options = &cli.rehearse.law_options;
        settled(options.applied_to(calibration), options, Some(4))
    }

    #[test]
    fn the_published_gain_is_admitted_for_the_lag_it_was_designed_for() {
        let settled = settle(&[], |_| ()).expect("certified");
        assert_eq!(settled.gain_id, 1);
        assert!(settled.note.is_some_and(|note| note.contains("published")));
        assert_eq!(settled.calibration, Calibration::default());
    }

    #[test]
    fn a_gain_is_refused_outside_its_certificate_unless_allowed() {
        type Change = fn(&mut Calibration);
        let changes: [(Change, &str); 3] = [
            (|c| c.ucl.lag_s = 0.1, "0.1 s"),
            (|c| c.ucl.delay_bound_s = 0.5, "0.5 s"),
            (|c| c.ucl.k1[1] = 3.0, "no certificate"),
        ];
        for (change, word) in changes {
            let refused = settle(&[], change).map(drop).expect_err("not certified").to_string();
            assert!(refused.contains(word) && refused.contains("--uncertified"), "{refused}");
            let allowed = settle(&["--uncertified"], change).expect("allowed");
            assert!(allowed.note.is_some_and(|note| note.contains("NOT CERTIFIED")));
        }
    }

    #[test]
    fn laws_without_a_gain_need_no_certificate() {
        for words in [["--ucl", "ploeg"], ["--ucl", "none"], ["--controller", "single-mpc"]] {
            let settled = settle(&words, |c| c.ucl.lag_s = 0.01).expect("no gain, no question");
            assert_eq!((settled.gain_id, settled.note), (0, None));
        }
    }

    #[test]
    fn a_gain_that_does_not_exist_is_named() {
        let refused = settle(&["--gain", "nosuch"], |_| ()).map(drop).expect_err("no such gain");
        assert!(refused.to_string().contains("nosuch"), "{refused}");
    }
}
