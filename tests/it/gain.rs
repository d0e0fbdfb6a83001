//! `platoon gain`, and what an ECU makes of a gain.

use crate::bench;

#[test]
fn a_gain_is_certified_where_it_holds_and_refused_where_it_does_not() {
    let cases: [(&[&str], i32, &str); 4] = [
        (&["published"], 0, "CERTIFIED"),
        (&["published", "--lag-s", "0.1"], 1, "REFUSED"),
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
fn an_ecu_refuses_a_gain_outside_its_certificate_unless_allowed() {
    let short = ["--virtual-time", "--duration-s", "0.1", "--set", "law.ucl.lag_s=0.1"];
    let refused = bench::rehearse("gain-refused", &short);
    refused.expect_code(3);
    assert!(refused.stderr.contains("--uncertified"), "{}", refused.stderr);
    let allowed = bench::rehearse("gain-allowed", &[&short[..], &["--uncertified"]].concat());
    allowed.expect_code(1);
    assert!(allowed.stdout.contains("NOT CERTIFIED"), "{}", allowed.stdout);
}
