//! `platoon vcan up`, `down` and `check` from outside: words and exit codes.
//!
//! What they do to interfaces is tested in `vcan-setup/tests/vcan.rs`; those here that need a
//! kernel with CAN are run there by `./test.sh socketcan`.

use std::process::{Command, Output};
use std::time::Duration;

use crate::bench::{self, eventually};

fn vcan(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_platoon"))
        .arg("vcan")
        .args(words)
        .output()
        .expect("the command starts")
}

#[track_caller]
fn assert_ended(output: &Output, code: i32, words: &[&str]) {
    let said = [&output.stdout[..], &output.stderr[..]].concat();
    let said = String::from_utf8_lossy(&said);
    assert_eq!(output.status.code(), Some(code), "{said}");
    for word in words {
        assert!(said.contains(word), "nothing of {word:?} in {said}");
    }
}

#[test]
fn a_name_that_can_be_no_interface_is_wrong_usage() {
    for verb in ["up", "down"] {
        assert_ended(&vcan(&[verb, "--names", "truck0,a b"]), 2, &["\"a b\"", "15 characters"]);
    }
    assert_ended(&vcan(&["up", "--names", "a", "--count", "2"]), 2, &["--names"]);
}

#[test]
fn the_help_says_what_the_exit_codes_mean() {
    assert_ended(&vcan(&["check", "--help"]), 0, &["Exit status: 0", "else 3"]);
    assert_ended(&vcan(&["shell", "--help"]), 0, &["3 when the kernel cannot be started", "255"]);
}

#[test]
fn another_kind_of_interface_is_refused_by_its_kind() {
    assert_ended(&vcan(&["down", "--names", "lo"]), 3, &["lo", "hardware", "not vcan"]);
}

#[test]
fn the_findings_agree_with_the_exit_code_on_any_machine() {
    let place = bench::place("vcan-check");
    std::fs::create_dir_all(&place).expect("the place of the tests can be written");
    let file = place.join("check.json");
    let path = file.to_str().expect("UTF-8");
    let output = vcan(&["check", "--names", "pt-none", "--json", path]);
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&file).expect("written")).expect("JSON");
    let can_rehearse = json["can_rehearse"].as_bool().expect("a truth value");
    let code = if can_rehearse { 0 } else { 3 };
    assert_ended(&output, code, &["pt-none", "CAN sockets", "PREEMPT_RT", "memlock"]);
    for group in ["can", "real_time"] {
        for finding in json[group].as_array().expect("a list") {
            let is_ok = finding["state"] == "ok";
            assert_eq!(is_ok, finding["remedy"].is_null(), "{finding}");
        }
    }
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn up_and_down_say_what_they_did_and_check_agrees() {
    let names = ["--names", "pt-u0,pt-u1"];
    let run = |verb: &str| vcan(&[&[verb], &names[..]].concat());
    assert_ended(&run("check"), 0, &["not there; a run makes it"]);
    assert_ended(&run("up"), 0, &["pt-u0: made", "pt-u1: made"]);
    assert_ended(&run("up"), 0, &["pt-u0: was there already"]);
    assert_ended(&run("check"), 0, &["vcan, MTU 72, up, quiet"]);
    assert_ended(&run("down"), 0, &["pt-u0: removed", "pt-u1: removed"]);
    assert_ended(&run("down"), 0, &["pt-u0: was not there"]);
}

#[test]
#[ignore = "needs a kernel with vcan and CAP_NET_ADMIN: ./test.sh runs it"]
fn an_interface_in_use_is_refused_and_still_there() {
    let names = ["--names", "pt-v0"];
    assert_ended(&vcan(&["up", names[0], names[1]]), 0, &["made"]);
    let mut sender = Command::new("cangen").args(["pt-v0", "-g", "5"]).spawn().expect("can-utils");
    // The sender needs a moment to start.
    eventually("traffic", Duration::from_secs(60), || {
        let check = vcan(&["check", names[0], names[1]]);
        (check.status.code() == Some(3)).then_some(())
    });
    assert_ended(&vcan(&["down", names[0], names[1]]), 3, &["pt-v0 carries traffic", "stays"]);
    sender.kill().expect("a process of our own");
    sender.wait().expect("it ends");
    assert_ended(&vcan(&["down", names[0], names[1]]), 0, &["pt-v0: removed"]);
}
