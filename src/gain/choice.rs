//! Which gain an ECU drives with, and whether it may.
//!
//! The check is made where an ECU is put together, not inside it: the loop has no files and does
//! not know what a certificate is. It costs no solver, only the exact evaluation of the proofs that
//! came with the gain, once, before the loop starts.

use std::path::Path;

use certificate::{Conditions, GainFile, Plants, library};
use law::{Calibration, CoordinationLaw, Structure};

use crate::cli::{LawArgs, UclKind};
use crate::failure::Failure;

use super::conditions::{find, folder, shown};

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

/// Whether a gain is to be looked up, so that the size of the platoon matters: a whole folder is
/// named, or none is and a synthesised one asked for. Otherwise it is the calibration's.
pub fn is_looked_up(calibration: &Calibration, options: &LawArgs) -> bool {
    match &options.gain {
        Some(name) => is_folder(name),
        None => has_gain(calibration) && options.ucl == Some(UclKind::Synthesised),
    }
}

/// A gain of the built-in library goes before a folder of the same name.
fn is_folder(name: &str) -> bool {
    library::named(name).is_none() && Path::new(name).is_dir()
}

/// The calibration with its gain: named by the options, or looked up by the number of trucks, what
/// is driven and the delay bound, and admitted if it is certified for all of that.
///
/// # Errors
/// When there is no such gain, none fits, or it is not certified and nobody allowed that.
pub fn settled(
    mut calibration: Calibration,
    options: &LawArgs,
    trucks: Option<usize>,
) -> Result<Settled, Failure> {
    let file = match options.gain.as_deref() {
        _ if is_looked_up(&calibration, options) => {
            Some(look_up(&calibration, options.gain.as_deref(), trucks)?)
        }
        Some(name) => Some(find(name)?),
        None => None,
    };
    if let Some(file) = &file {
        adopt(&mut calibration, file);
    }
    if !has_gain(&calibration) {
        return Ok(Settled { calibration, gain_id: 0, note: None });
    }
    let gain_id = number(&calibration);
    let note = match admitted(&calibration, proof(&calibration, file).as_ref(), trucks) {
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

/// What the calibration says that its gain drives.
fn driven(calibration: &Calibration) -> Plants {
    let [lag_min_s, lag_max_s] = calibration.ucl.lags_s();
    let [gain_min, gain_max] = calibration.ucl.driven_gains();
    Plants { lag_min_s, lag_max_s, gain_min, gain_max }
}

/// The best gain of a folder, or of the library, for what is driven, the delay bound and the number
/// of trucks.
fn look_up(
    calibration: &Calibration,
    gains: Option<&str>,
    trucks: Option<usize>,
) -> Result<GainFile, Failure> {
    let (plants, longest_s) = (driven(calibration), calibration.ucl.delay_bound_s);
    // Who does not know the number of trucks needs a gain for any.
    let followers = trucks.map_or(usize::MAX, |trucks| trucks.saturating_sub(1));
    let found = match gains {
        Some(path) => library::best_of(folder(path)?, followers, &plants, longest_s),
        None => library::best_for(followers, &plants, longest_s),
    };
    found.ok_or_else(|| {
        let size = trucks.map_or("any number of".to_owned(), |trucks| trucks.to_string());
        Failure::cannot_start(format!(
            "{} has no gain for {size} trucks, {} and delays up to {longest_s} s; design one \
             with `platoon gain synthesise` and name it with --gain",
            gains.unwrap_or("the library"),
            shown(&plants)
        ))
    })
}

/// The first number in the library of the gain that the law drives with, or 0.
fn number(calibration: &Calibration) -> u8 {
    let feeds = calibration.ucl.law == CoordinationLaw::Feedforward;
    let is_it =
        |file: &GainFile| is_same(calibration, file) && file.gain.leader_feedforward == feeds;
    let all = library::all().unwrap_or_default();
    all.iter().position(is_it).map_or(0, |place| place as u8 + 1)
}

fn is_same(calibration: &Calibration, file: &GainFile) -> bool {
    (file.gain.k1, file.gain.k2) == (calibration.ucl.k1, calibration.ucl.k2)
}

/// Who proves the gain: the file it came from, unless that is for something else and the library
/// has the same gain with a proof for what is driven.
fn proof(calibration: &Calibration, file: Option<GainFile>) -> Option<GainFile> {
    let plants = driven(calibration);
    if file.as_ref().is_some_and(|file| file.plant.cover(&plants)) {
        return file;
    }
    let same = library::all().unwrap_or_default();
    let mut same: Vec<_> = same.into_iter().filter(|file| is_same(calibration, file)).collect();
    let fitting = same.iter().position(|file| file.plant.cover(&plants));
    match fitting {
        Some(place) => Some(same.swap_remove(place)),
        None => file.or_else(|| same.into_iter().next()),
    }
}

/// What the certificate is worth here, or why it is not enough.
fn admitted(
    calibration: &Calibration,
    file: Option<&GainFile>,
    trucks: Option<usize>,
) -> Result<String, String> {
    let ucl = &calibration.ucl;
    let Some(file) = file else {
        return Err(format!("the gain K1 {:?}, K2 {:?} has no certificate", ucl.k1, ucl.k2));
    };
    let conditions = Conditions {
        plants: driven(calibration),
        longest_s: ucl.delay_bound_s,
        period_s: PERIOD_S,
    };
    let covers =
        file.plant.cover(&conditions.plants) && file.delay.longest_s >= conditions.longest_s;
    let for_delays = |plants, longest_s| format!("{}, delays up to {longest_s} s", shown(plants));
    let is_for =
        format!("gain {} is for {}", file.name, for_delays(&file.plant, file.delay.longest_s));
    let asked = for_delays(&conditions.plants, conditions.longest_s);
    if !covers {
        return Err(format!(
            "{is_for}, not for what it drives: {asked} (law.ucl.lag_s, gain_per_lead_s, \
             lead_time_s, delay_bound_s)"
        ));
    }
    let stability = certificate::stability(file, &conditions);
    if let Some(finding) = stability.findings.iter().find(|finding| !finding.is_passed) {
        return Err(format!("gain {}: {} does not hold", file.name, finding.what));
    }
    Ok(format!(
        "{is_for} at any rate, certified {}; the loop it drives has {asked}",
        sizes(file, trucks)
    ))
}

/// For which sizes of the platoon the proofs are. Stability does not depend on the size: the loop
/// is block triangular. The bound of the errors does, where it was proven for a platoon.
fn sizes(file: &GainFile, trucks: Option<usize>) -> String {
    match (file.trucks_max(), trucks) {
        (None, _) => "for any number of trucks".to_owned(),
        (Some(most), Some(now)) if now > most => {
            format!("stable for any number of trucks, with its gamma only up to {most} of {now}")
        }
        (Some(most), _) => format!("with its gamma for up to {most} trucks, stable for any"),
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
    fn the_default_gain_is_admitted_for_the_loop_it_drives() {
        let settled = settle(&[], |_| ()).expect("certified");
        let note = settled.note.expect("it has a gain");
        assert!(note.contains("loop") && note.contains("any number"), "{note}");
        assert_eq!(settled.calibration, Calibration::default());
    }

    #[test]
    fn the_published_gain_is_admitted_for_the_loop_it_really_drives() {
        let settled = settle(&["--ucl", "published"], |_| ()).expect("certified");
        assert_eq!((settled.gain_id, settled.calibration.ucl.k1[0]), (1, 2.156));
        let note = settled.note.expect("it has a gain");
        assert!(note.contains("published-loop") && note.contains("any number"), "{note}");
    }

    #[test]
    fn a_gain_is_refused_outside_its_certificate_unless_allowed() {
        type Change = fn(&mut Calibration);
        let changes: [(Change, &str); 4] = [
            (|c| c.ucl.lag_s = 0.1, "0.092-0.108 s"),
            (|c| c.ucl.lead_time_s = 2.5, "gain 1.9521-2.0729"),
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

    /// What was designed for Theorem 1's plant is too strong for what is driven here.
    #[test]
    fn a_gain_for_another_plant_is_refused_by_name() {
        let refused = settle(&["--gain", "least-gamma"], |_| ()).map(drop).expect_err("lag 0.45 s");
        assert!(refused.to_string().contains("not for what it drives"), "{refused}");
    }

    #[test]
    fn a_synthesised_gain_is_looked_up_for_what_is_driven() {
        let settled = settle(&["--ucl", "synthesised"], |_| ()).expect("one fits");
        let (id, file) = library::named("loop").expect("built in");
        assert_eq!((settled.gain_id, settled.calibration.ucl.k1), (id, file.gain.k1));
        let none = settle(&["--ucl", "synthesised"], |c| c.ucl.lag_s = 0.8).map(drop);
        assert!(none.expect_err("no such gain").to_string().contains("the library has no gain"));
    }

    #[test]
    fn a_gain_that_does_not_exist_is_named() {
        let refused = settle(&["--gain", "nosuch"], |_| ()).map(drop).expect_err("no such gain");
        assert!(refused.to_string().contains("nosuch"), "{refused}");
    }
}
