//! `platoon gain`, and what an ECU makes of a gain.

use std::time::Duration;

use crate::bench;

/// How long the rig may take to invite its ECUs before it counts as hung.
const LIMIT: Duration = Duration::from_secs(60);

#[test]
fn a_gain_is_certified_where_it_holds_and_refused_where_it_does_not() {
    let cases: [(&[&str], i32, &str); 5] = [
        (&["published"], 0, "CERTIFIED"),
        (&["published", "--lag-s", "0.1"], 1, "REFUSED"),
        (&["published", "--plant-gain", "1-1.5"], 1, "REFUSED"),
        (&["published", "--delay-s", "0.5"], 1, "REFUSED"),
        (&["nosuch"], 2, "nosuch"),
    ];
    for (words, code, word) in cases {
        let run = bench::platoon("gain-certify", &[&["gain", "certify"], words].concat());
        run.expect_code(code);
        let said = run.stdout.contains(word) || run.stderr.contains(word);
        assert!(said, "{words:?}: {}{}", run.stdout, run.stderr);
    }
}

#[test]
fn a_designed_gain_is_certified_and_written() {
    let design = ["gain", "synthesise", "--name", "mine", "--lag-s", "0.2", "--prove", "0"];
    let run = bench::platoon("gain-design", &design);
    run.expect_code(0);
    assert!(run.stdout.contains("name = \"mine\""), "{}", run.stdout);
    assert!(run.stderr.contains("CERTIFIED"), "{}", run.stderr);
}

#[test]
fn a_gain_is_chosen_among_many_by_what_is_wanted() {
    let design = ["gain", "synthesise", "--prove", "0", "--command-max", "3.5", "--objective"];
    let run = bench::platoon("gain-choice", &[&design[..], &["balanced"]].concat());
    run.expect_code(0);
    let chosen: Vec<&str> = run.stderr.lines().filter(|line| line.ends_with("chosen")).collect();
    assert_eq!(chosen.len(), 1, "{}", run.stderr);
    let command = chosen[0].split_whitespace().rev().nth(1).and_then(|word| word.parse().ok());
    assert!(command.is_some_and(|command: f64| command <= 3.5), "{}", chosen[0]);
}

#[test]
fn trucks_that_differ_have_gains_and_a_folder_of_them_is_a_library() {
    let fleet = ["gain", "fleet", "--trucks", "3", "--lag-s", "0.3-0.5", "--out", "gains"];
    let run = bench::platoon("gain-fleet", &fleet);
    run.expect_code(0);
    assert!(run.stdout.contains("3 of 3 trucks designed"), "{}", run.stdout);
    // None of them is for what an ECU drives here.
    let folder = bench::place("gain-fleet").join("gains");
    let folder = folder.to_str().expect("the place of the tests is UTF-8");
    let refused = bench::rehearse_virtually("gain-folder", &["platooning", "--gain", folder]);
    refused.expect_code(3);
    assert!(refused.stderr.contains("gains has no gain for 4 trucks"), "{}", refused.stderr);
}

#[test]
fn an_ecu_refuses_a_gain_outside_its_certificate_unless_allowed() {
    let short = ["--virtual-time", "--duration-s", "0.1", "--set", "law.ucl.lag_s=0.1"];
    let refused = bench::rehearse("gain-refused", &short);
    refused.expect_code(3);
    assert!(refused.stderr.contains("--uncertified"), "{}", refused.stderr);
    let allowed = bench::rehearse("gain-allowed", &[&short[..], &["--uncertified"]].concat());
    allowed.expect_code(1);
    assert!(allowed.stdout.contains("NOT CERTIFIED"), "{}", allowed.stdout);
}

/// Ours for the loop it drives, in a short run; the published gain drives in every other test.
#[test]
fn platooning_passes_with_a_gain_that_is_looked_up() {
    let words = ["platooning", "--ucl", "synthesised", "--rate-hz", "50"];
    let run = bench::rehearse_virtually("gain-looked-up", &words);
    run.expect_code(0);
    assert!(run.stdout.contains("gain loop is for"), "{}", run.stdout);
}

#[test]
fn an_ecu_alone_looks_its_gain_up_when_its_mission_comes() {
    let hosted = ["--host", "2", "--host", "3"];
    let short = ["bench", "platooning", "--bus", "udp", "--rate-hz", "50", "--duration-s", "1"];
    let rig = bench::start("gain-rig", &[&short[..], &hosted].concat());
    let port = bench::eventually("the rig's invitation", LIMIT, || {
        let said = rig.said();
        let invitation = said.lines().find(|line| line.contains("--truck 1"))?;
        Some(invitation.split_whitespace().last()?.to_owned())
    });
    let joined = ["controller", "--truck", "1", "--bus", "udp", "--port", &port];
    let ecu = bench::platoon("gain-ecu", &[&joined[..], &["--ucl", "synthesised"]].concat());
    ecu.expect_code(0);
    assert!(ecu.stderr.contains("gain loop is for"), "{}", ecu.stderr);
    assert!(!ecu.stderr.contains(" 0 ticks"), "{}", ecu.stderr);
    rig.finish(LIMIT);
}

#[test]
#[ignore = "seven runs at 1 kHz; ./test.sh --long runs it"]
fn heavy_platooning_passes_with_every_gain_of_the_library() {
    for file in certificate::library::all().expect("well formed") {
        // Those designed for the paper's plant are not certified for what drives here.
        let words = ["platooning", "--gain", &file.name, "--uncertified"];
        bench::rehearse_virtually(&format!("gain-{}", file.name), &words).expect_code(0);
    }
}
