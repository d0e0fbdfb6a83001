//! The arrows between the crates, and what the inner ones must not know.
//!
//! An arrow X -> Y means that X may use Y, in code, tests and build scripts alike. A new arrow is
//! the rarest kind of change: it is made here first, with its reason in docs/decisions.

use std::process::Command;

use serde_json::Value;

use crate::repository;

/// Every crate of ours with the crates of ours it may use.
const ARROWS: [(&str, &[&str]); 10] = [
    (
        "platoon",
        &[
            "bench-sim",
            "certificate",
            "controller-rt",
            "law",
            "platoon-dbc",
            "synthesis",
            "traces",
            "vcan-setup",
        ],
    ),
    ("controller-rt", &["law", "platoon-dbc", "traces"]),
    ("bench-sim", &["platoon-dbc", "traces"]),
    ("traces", &["platoon-dbc"]),
    ("law", &[]),
    ("synthesis", &["certificate"]),
    ("certificate", &[]),
    ("lapack-src", &[]),
    ("platoon-dbc", &[]),
    ("vcan-setup", &[]),
];

/// Crates that reach the operating system, a bus or a file, which the law must not bring in.
const NOT_FOR_THE_LAW: [&str; 8] =
    ["rustix", "libc", "socketcan", "mcap", "tokio", "crossbeam", "clarabel", "toml"];

/// Ways to a clock or to the process's environment.
const CLOCK_OR_ENVIRONMENT: [&str; 6] =
    ["Instant::", "SystemTime", "env::var", "env::args", "clock_gettime", "thread::sleep"];

/// Ways to anything outside the law's arguments, allocation included.
const OUTSIDE: [&str; 7] =
    ["std::", "alloc::", "extern crate", "println!", "asm!", "rdtsc", "__cpuid"];

/// What cargo knows of the workspace's own packages.
fn metadata() -> Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(repository::root())
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("cargo metadata prints JSON")
}

/// The name and the dependencies (of every kind) of each package.
fn packages(metadata: &Value) -> Vec<(&str, Vec<&Value>)> {
    let packages = metadata["packages"].as_array().expect("a list of packages");
    packages
        .iter()
        .map(|package| {
            let dependencies = package["dependencies"].as_array().expect("a list");
            (package["name"].as_str().expect("a name"), dependencies.iter().collect())
        })
        .collect()
}

/// Arrows in `metadata` that `ARROWS` does not have. A path dependency is one of ours.
fn forbidden_arrows(metadata: &Value) -> Vec<String> {
    let mut forbidden = Vec::new();
    for (from, dependencies) in packages(metadata) {
        let allowed = ARROWS.iter().find(|(name, _)| *name == from).map(|(_, allowed)| *allowed);
        for dependency in dependencies.iter().filter(|dependency| !dependency["path"].is_null()) {
            let to = dependency["name"].as_str().expect("a name");
            if !allowed.is_some_and(|allowed| allowed.contains(&to)) {
                forbidden.push(format!("{from} -> {to}"));
            }
        }
    }
    forbidden
}

/// A source without its comments and without the tests at its foot.
fn shipped(source: &str) -> String {
    let code = source.split("#[cfg(test)]").next().unwrap_or(source);
    let without_comment = |line: &str| line.split("//").next().unwrap_or("").to_owned();
    code.lines().map(without_comment).collect::<Vec<_>>().join("\n")
}

/// `path: word` for every one of `words` in the shipped sources of `folder`.
fn mentions(folder: &str, words: &[&str]) -> Vec<String> {
    let sources = repository::sources(folder);
    assert!(!sources.is_empty(), "{folder} has sources");
    let mut found = Vec::new();
    for (path, text) in sources.iter().filter(|(path, _)| !is_test(path)) {
        let code = shipped(text);
        let hits = words.iter().filter(|word| code.contains(**word));
        found.extend(hits.map(|word| format!("{path}: {word}")));
    }
    found
}

/// Whether a path is a test by its place.
fn is_test(path: &str) -> bool {
    path.ends_with("/tests.rs") || path.contains("/tests/")
}

#[test]
fn no_crate_uses_another_against_the_arrows() {
    assert_eq!(forbidden_arrows(&metadata()), Vec::<String>::new());
}

#[test]
fn every_crate_of_the_workspace_has_its_arrows_stated() {
    let metadata = metadata();
    let mut built: Vec<&str> = packages(&metadata).into_iter().map(|(name, _)| name).collect();
    let mut stated: Vec<&str> = ARROWS.iter().map(|(name, _)| *name).collect();
    built.sort_unstable();
    stated.sort_unstable();
    assert_eq!(built, stated);
}

#[test]
fn a_forbidden_arrow_is_noticed_in_dev_dependencies_too() {
    let metadata = serde_json::json!({ "packages": [
        { "name": "bench-sim", "dependencies": [
            { "name": "law", "kind": "dev", "path": "/x/law" },
            { "name": "traces", "kind": null, "path": "/x/traces" },
            { "name": "libm", "kind": null },
        ]},
        { "name": "stranger", "dependencies": [
            { "name": "law", "kind": "build", "path": "/x/law" },
        ]},
    ]});
    assert_eq!(forbidden_arrows(&metadata), ["bench-sim -> law", "stranger -> law"]);
}

#[test]
fn the_rig_does_not_know_the_law_by_any_name() {
    let words = ["law::", "controller_rt", "use law", "controller-rt/"];
    assert_eq!(mentions("bench-sim", &words), Vec::<String>::new());
}

#[test]
fn the_law_is_a_no_std_crate() {
    let lib = repository::read(&repository::root().join("controller-rt/law/src/lib.rs"));
    let attribute = |line: &str| line.trim() == "#![no_std]";
    assert!(lib.lines().any(attribute), "controller-rt/law/src/lib.rs begins with #![no_std]");
}

#[test]
fn the_law_reaches_nothing_but_its_arguments() {
    let words = [&OUTSIDE[..], &CLOCK_OR_ENVIRONMENT[..]].concat();
    assert_eq!(mentions("controller-rt/law/src", &words), Vec::<String>::new());
}

#[test]
fn the_law_depends_on_nothing_that_reaches_the_operating_system() {
    let metadata = metadata();
    for (name, dependencies) in packages(&metadata) {
        let shipped = dependencies.iter().filter(|dependency| dependency["kind"].is_null());
        let names = shipped.filter_map(|dependency| dependency["name"].as_str());
        let forbidden: Vec<_> = names.filter(|name| NOT_FOR_THE_LAW.contains(name)).collect();
        assert!(name != "law" || forbidden.is_empty(), "{forbidden:?}");
    }
}

#[test]
fn time_reaches_rig_and_ecu_only_as_an_argument() {
    for folder in ["bench-sim/src", "controller-rt/src"] {
        assert_eq!(mentions(folder, &CLOCK_OR_ENVIRONMENT), Vec::<String>::new());
    }
}

#[test]
fn comments_and_tests_do_not_count_as_code() {
    let source = "//! std::fs\nlet x = 1; // std::env\n#[cfg(test)]\nmod tests { use std::fs; }";
    assert_eq!(shipped(source), "\nlet x = 1; ");
}
