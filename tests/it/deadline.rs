//! `platoon deadline` from outside. What it finds depends on the machine; that its words, its exit
//! code and what it leaves agree does not.

use serde_json::Value;

use crate::bench;

#[test]
fn a_test_ends_with_the_exit_code_of_its_verdict_and_leaves_its_table() {
    let arguments = ["deadline", "--rates", "none", "--ecu-rates", "100", "--rate-hz", "100"];
    let more = ["--loads", "faults", "--slots", "100", "--out", "run", "--json", "own.json"];
    let run = bench::platoon("deadline-small", &[&arguments[..], &more].concat());
    let read = |path: std::path::PathBuf| -> Value {
        let text =
            std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path:?}: {error}"));
        serde_json::from_str(&text).expect("JSON")
    };
    let json = read(run.out().join("deadline.json"));
    let verdict = json["verdict"].as_str().expect("a word");
    let code = match verdict {
        "pass" => 0,
        "fail" => 1,
        "inconclusive" => 4,
        other => panic!("{other}"),
    };
    run.expect_code(code);
    let cells = json["cells"].as_array().expect("cells");
    assert_eq!(cells.len(), 1, "{cells:?}");
    assert_eq!(cells[0]["verdict"], verdict);
    assert_eq!((&cells[0]["load"], &cells[0]["rate_hz"]), (&"faults".into(), &100.into()));
    assert!(cells[0]["timing"]["slots"].as_u64() >= Some(100), "{cells:?}");
    assert!(cells[0]["evidence"].as_str().is_some_and(|words| words.contains("slots lost")));
    assert!(
        run.stdout.contains("one ECU alone") && run.stdout.contains("100 Hz"),
        "{}",
        run.stdout
    );
    let files = std::fs::read_dir(run.out()).expect("the test's folder");
    let mut names: Vec<_> = files.map(|file| file.expect("a file").file_name()).collect();
    names.sort();
    assert_eq!(names, ["deadline.json", "deadline.md"]);
}

#[test]
fn what_cannot_be_tested_is_refused_before_anything_runs() {
    let refused: [(&[&str], &[&str]); 5] = [
        (&["--rates", "fast"], &["fast", "100,1000"]),
        (&["--loads", "noise"], &["noise"]),
        (&["--fault", "kill-ecu@1:truck=1"], &["kill-ecu@1:truck=1", "stalls only"]),
        (&["--fault", "stall@1+0.003:truck=9"], &["truck=9", "0 to 3"]),
        (&["--json", "nosuch/deadline.json"], &["--json nosuch/deadline.json", "folder"]),
    ];
    for (arguments, names) in refused {
        let run = bench::platoon("deadline-refused", &[&["deadline"], arguments].concat());
        run.expect_code(2);
        let all_named = names.iter().all(|name| run.stderr.contains(name));
        assert!(all_named, "{arguments:?}: no {names:?} in {}", run.stderr);
        assert!(!run.out().exists(), "{arguments:?} left a folder");
    }
}
