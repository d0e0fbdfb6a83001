//! The command line from outside: what it refuses, with which exit code and words, and what it
//! leaves behind when it refuses.

use std::fs;

use platoon_dbc::{PortLease, Udp};

use crate::bench::{self, Run};

/// Arguments, exit code, and what the first line on standard error must name.
type Refusal = (&'static [&'static str], i32, &'static [&'static str]);

const REFUSED: [Refusal; 43] = [
    // The scenario.
    (&["nosuch"], 2, &["\"nosuch\"", "obstacle-avoidance", "TOML"]),
    (&["/dev"], 2, &["/dev", "folder"]),
    // Its numbers.
    (&["--set", "v2v.nosuch=1"], 2, &["v2v.nosuch=1", "unknown", "delay_min_s"]),
    (&["--set", "nosuch=1"], 2, &["nosuch=1", "unknown", "v2v"]),
    (&["--set", "platoon.spacing=50"], 2, &["platoon.spacing", "spacing_m"]),
    (&["--set", "v2v.loss=nan"], 2, &["v2v.loss", "NaN", "0 to 1"]),
    (&["--set", "v2v.loss=NaN"], 2, &["v2v.loss=NaN", "number"]),
    (&["--set", "v2v.loss=inf"], 2, &["v2v.loss", "inf", "0 to 1"]),
    (&["--set", "trucks.1.mass_kg=-5"], 2, &["trucks.1.mass_kg", "-5", "1000 to 60000"]),
    (&["--set", "trucks.7.mass_kg=9000"], 2, &["trucks = 7", "trucks.3"]),
    (&["--set", "obstacles.9.x_m=3"], 2, &["obstacles.9", "obstacles.1 to obstacles.2"]),
    (
        &["--set", "v2v.delay_min_s=0.2", "--set", "v2v.delay_max_s=0.1"],
        2,
        &["v2v.delay_max_s", "0.1", "0.2 to 5"],
    ),
    (&["--set", "platoon.trucks=many"], 2, &["platoon.trucks=many", "whole number"]),
    (&["--set", "platoon.trucks=0"], 2, &["platoon.trucks", "0", "1 to 16"]),
    (&["--set", "platoon.trucks=2.5"], 2, &["platoon.trucks=2.5"]),
    (&["--set", "v2v.loss"], 2, &["v2v.loss", "KEY=VALUE"]),
    (&["--set", "law.nosuch=1"], 2, &["law", "nosuch"]),
    (&["--duration-s", "nan"], 2, &["duration_s", "NaN", "0.1 to 3600"]),
    (&["--duration-s", "-1"], 2, &["duration_s", "-1", "0.1 to 3600"]),
    (&["--v2v-delay", "150-15"], 2, &["150-15", "--v2v-delay", "LO-HI"]),
    (&["--rate-hz", "5"], 2, &["--rate-hz", "5", "10..=10000"]),
    // The trucks.
    (&["--ecu", "9"], 2, &["--ecu 9", "0 to 3"]),
    (&["--ecu", "last"], 2, &["--ecu", "last", "all"]),
    (&["--fault", "kill-ecu@1:truck=9"], 2, &["truck=9", "0 to 3"]),
    (&["--fault", "kill-ecu@20"], 2, &["--fault", "which truck", "truck=2"]),
    (&["--fault", "kill-ecu"], 2, &["--fault", "no time", "kill-ecu@20:truck=2"]),
    (&["--fault", "pause-ecu@20:truck=1"], 2, &["--fault", "duration"]),
    (&["--fault", "melt@20:truck=1"], 2, &["melt", "kill-ecu", "pause-ecu"]),
    (&["--fault", "stall@1+0.003:truck=1", "--virtual-time"], 2, &["stall@1", "--virtual-time"]),
    // Deadlines.
    (&["--cpus", "0:9999"], 2, &["--cpus 0:9999", "9999", "online"]),
    (&["--cpus", "0"], 2, &["--cpus", "auto, any"]),
    (&["--on-overrun", "panic"], 2, &["panic", "skip, hold, abort or queue"]),
    // The bus.
    (&["--virtual-time", "--bus", "udp"], 2, &["--virtual-time", "--bus"]),
    (&["--bus", "socketcan", "--interfaces", "nosuch"], 2, &["--interfaces", "1", "4"]),
    // The gateway.
    (&["--socketcand", "70000"], 2, &["--socketcand", "70000"]),
    (&["--socketcand", "29536", "--virtual-time"], 2, &["--socketcand", "--virtual-time"]),
    (&["--socketcand-beacon"], 2, &["required"]),
    (&["--bus", "udp", "--socketcand", "203.0.113.9:1"], 3, &["203.0.113.9:1", "this machine"]),
    // Its other words.
    (&["--controller", "dmpc-pf", "--profile", "j1939"], 2, &["dmpc-pf", "j1939", "--profile fd"]),
    (
        &["--set", "law.dmpc.own_weight=[4.0, 10.0]"],
        2,
        &["law.dmpc.own_weight", "at least neighbour_weight"],
    ),
    (&["--solver", "magic"], 2, &["--solver", "magic"]),
    (&["--json", "nosuch/summary.json"], 2, &["--json nosuch/summary.json", "folder"]),
    (&["--nosuch"], 2, &["--nosuch"]),
];

/// Asserts that a run was refused with this exit code, in words that name these things.
#[track_caller]
fn assert_refused(run: &Run, what: &dyn std::fmt::Debug, code: i32, names: &[&str]) {
    assert_eq!(run.code(), Some(code), "{what:?}: {}", run.stderr);
    let first = run.stderr.lines().next().unwrap_or_default();
    for name in names {
        assert!(first.contains(name), "{what:?}: nothing of {name:?} in {first:?}");
    }
    assert!(run.stdout.is_empty(), "{what:?}: {}", run.stdout);
}

/// Asserts that nothing but the words was left behind.
#[track_caller]
fn assert_left_nothing(run: &Run, what: &dyn std::fmt::Debug) {
    assert!(!run.out().exists(), "{what:?} left a folder");
    assert_eq!(run.left_behind(), Vec::<String>::new(), "{what:?}");
}

#[test]
fn nonsense_is_refused_by_name_and_leaves_nothing_behind() {
    for (arguments, code, names) in REFUSED {
        let run = bench::rehearse("usage-refused", arguments);
        assert_refused(&run, &arguments, code, names);
        assert_left_nothing(&run, &arguments);
    }
}

#[test]
fn our_own_refusals_are_one_line() {
    for arguments in [["--set", "nosuch=1"], ["--ecu", "9"], ["--json", "nosuch/x"]] {
        let run = bench::rehearse("usage-one-line", &arguments);
        assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
        assert!(run.stderr.starts_with("platoon: "), "{}", run.stderr);
    }
}

#[test]
fn a_folder_that_cannot_be_made_is_refused() {
    for out in ["/dev/null/x", "/proc/nosuch/x"] {
        let arguments = ["rehearse", "--virtual-time", "--out", out];
        let run = bench::platoon("usage-no-folder", &arguments);
        assert_refused(&run, &out, 3, &["--out", out, "folder"]);
        assert_left_nothing(&run, &out);
    }
}

#[test]
fn a_folder_that_holds_a_run_is_not_written_into() {
    let arguments = ["rehearse", "--virtual-time", "--duration-s", "0.1", "--out"];
    let first = bench::platoon("usage-first-run", &[&arguments[..], &["run"]].concat());
    assert!(matches!(first.code(), Some(0 | 1)), "{}", first.stderr);
    let folder = first.out();
    let listed = || fs::read_dir(&folder).expect("the first run's folder").count();
    let (trace, files) = (fs::read(folder.join("run.mcap")).expect("a trace"), listed());

    let out = folder.to_str().expect("UTF-8");
    let second = bench::platoon("usage-second-run", &[&arguments[..], &[out]].concat());
    assert_refused(&second, &out, 2, &["--out", out, "holds a run already"]);
    assert!(fs::read(folder.join("run.mcap")).expect("a trace") == trace, "the trace changed");
    assert_eq!(listed(), files);
}

#[test]
fn a_scenario_file_that_is_not_toml_is_refused_with_its_line() {
    let folder = bench::place("usage-scenario-files");
    fs::create_dir_all(&folder).expect("the place of the tests can be written");
    let file = |name: &str, text: &str| {
        let path = folder.join(name);
        fs::write(&path, text).expect("a file in our own folder");
        path.to_str().expect("UTF-8").to_owned()
    };
    let cases = [
        (file("broken.toml", "name = \"x\"\nplatoon = [\n"), &["not valid TOML", "line"][..]),
        (file("other.toml", "name = \"x\"\nduration_s = 10.0\n"), &["platoon"]),
        (file("wrong.toml", "name = 3\n"), &["name"]),
    ];
    for (path, names) in cases {
        let run = bench::rehearse("usage-scenario-file", &[path.as_str(), "--virtual-time"]);
        assert_refused(&run, &path, 2, &[names, &[path.as_str()]].concat());
        assert_left_nothing(&run, &path);
    }
}

#[test]
fn a_busy_port_is_refused_by_number() {
    // Away from where runs look first, so that this test takes nothing from the others.
    let lease = PortLease::acquire(Udp::FIRST_PORT + 1000).expect("some port is free");
    let port = lease.port().to_string();
    let run = bench::rehearse("usage-busy-port", &["--bus", "udp", "--port", &port]);
    assert_refused(&run, &port, 3, &["--port", &port]);
    assert_left_nothing(&run, &port);
}

#[test]
fn an_interface_that_is_not_there_is_refused_with_the_reason() {
    let arguments = ["--bus", "socketcan", "--interfaces", "nosuch0,nosuch1,nosuch2,nosuch3"];
    let run = bench::rehearse("usage-no-interface", &arguments);
    let kernel_has_can = vcan_setup::can::kernel_support().is_available();
    let reason = if kernel_has_can { "nosuch0" } else { "this kernel has no CAN" };
    assert_refused(&run, &arguments, 3, &["nosuch0", reason]);
    assert_left_nothing(&run, &arguments);
}

#[test]
fn a_lone_ecu_or_rig_that_cannot_start_leaves_nothing_behind() {
    let cases: [(&[&str], i32, &[&str]); 5] = [
        (&["controller", "--truck", "1", "--bus", "loopback"], 2, &["loopback"]),
        (&["controller", "--truck", "1", "--bus", "socketcan", "--interfaces", "no1"], 3, &["no1"]),
        (&["controller", "--truck", "1", "--law", "nosuch.toml"], 3, &["--law nosuch.toml"]),
        (&["bench", "nosuch"], 2, &["\"nosuch\""]),
        (&["bench", "--bus", "udp", "--host", "9"], 2, &["--host 9", "0 to 3"]),
    ];
    for (arguments, code, names) in cases {
        let run = bench::platoon("usage-lone", &[arguments, &["--out", "run"]].concat());
        assert_refused(&run, &arguments, code, names);
        assert_left_nothing(&run, &arguments);
    }
}

#[test]
fn scenarios_are_listed_and_printed_as_they_can_be_run() {
    let list = bench::platoon("usage-list", &["scenarios"]);
    list.expect_code(0);
    for name in ["obstacle-avoidance", "hil-obstacle-avoidance"] {
        assert!(list.stdout.lines().any(|line| line.starts_with(name)), "{}", list.stdout);
        let printed = bench::platoon("usage-print", &["scenarios", name]);
        printed.expect_code(0);
        let table: toml::Table = printed.stdout.parse().expect("a scenario prints as TOML");
        assert_eq!(table["name"].as_str(), Some(name));
    }
    let unknown = bench::platoon("usage-unknown", &["scenarios", "nosuch"]);
    assert_refused(&unknown, &"scenarios nosuch", 2, &["\"nosuch\"", "obstacle-avoidance"]);
}

#[test]
fn every_verb_explains_itself() {
    let verbs: [(&[&str], &str); 7] = [
        (&["--help"], "rehearse"),
        (&["rehearse", "--help"], "--virtual-time"),
        (&["controller", "--help"], "--truck"),
        (&["bench", "--help"], "--host"),
        (&["scenarios", "--help"], "Usage"),
        (&["compare", "--help"], "--seeds"),
        (&["--version"], env!("CARGO_PKG_VERSION")),
    ];
    for (arguments, word) in verbs {
        let run = bench::platoon("usage-help", arguments);
        run.expect_code(0);
        assert!(run.stdout.contains(word), "{arguments:?}: {}", run.stdout);
        assert!(run.stderr.is_empty(), "{arguments:?}: {}", run.stderr);
    }
}

#[test]
fn json_is_written_where_it_was_asked_for() {
    let arguments = ["--virtual-time", "--duration-s", "0.1", "--json", "copy.json"];
    let run = bench::rehearse("usage-json", &arguments);
    run.expect_code(1);
    let copy = fs::read(run.out().with_file_name("copy.json")).expect("the JSON asked for");
    let summary = fs::read(run.out().join("summary.json")).expect("the summary");
    assert!(copy == summary, "the copy differs from summary.json");
}
