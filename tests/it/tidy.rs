//! House rules that a machine can check.

use std::path::Path;

use crate::repository;

/// Longest line of a Rust source [characters], as in rustfmt.toml.
const COLUMNS_MAX: usize = 100;
/// Largest file \[bytes\] outside the recorded data.
const FILE_BYTES_MAX: u64 = 1 << 20;
/// Folders of recorded data, which may hold larger files.
const RECORDED: [&str; 2] = ["traces/golden/", "controller-rt/law/tests/data/"];
/// Module names that say nothing about what is inside.
const DRAWERS: [&str; 7] = ["utils", "util", "common", "helpers", "helper", "misc", "types"];
/// Every file extension in use; a new one is added here on purpose.
const EXTENSIONS: [&str; 17] = [
    "css", "dbc", "html", "js", "json", "lock", "mcap", "md", "png", "py", "qps", "rs", "sh",
    "svg", "toml", "txt", "yml",
];
/// Files that have no extension.
const NAMES: [&str; 5] = [".gitignore", "LICENSE", "LICENSE-APACHE", "LICENSE-MIT", "run"];

/// The first of the drawers' names among the parts of a path.
fn drawer(path: &str) -> Option<&str> {
    let parts = path.split('/').map(|part| part.strip_suffix(".rs").unwrap_or(part));
    parts.into_iter().find(|part| DRAWERS.contains(part))
}

/// What is wrong with one line of a Rust source.
fn fault(line: &str) -> Option<&'static str> {
    // Put together here so that this file does not accuse itself.
    let unfinished = [concat!("to", "do!("), concat!("unimpl", "emented!(")];
    if line.contains('\t') {
        Some("a tab")
    } else if line.ends_with(' ') || line.ends_with('\r') {
        Some("blanks at the end")
    } else if line.chars().count() > COLUMNS_MAX && !line.contains("://") {
        Some("more than 100 columns")
    } else if unfinished.iter().any(|word| line.contains(word)) {
        Some("unfinished code")
    } else {
        None
    }
}

/// Whether a file's name or extension is one of those in use.
fn is_known(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or("");
    match path.extension().and_then(|extension| extension.to_str()) {
        Some(extension) => EXTENSIONS.contains(&extension),
        None => NAMES.contains(&name),
    }
}

#[test]
fn rust_sources_have_no_faulty_line() {
    let mut faults = Vec::new();
    for (path, text) in repository::sources("") {
        for (number, line) in text.split('\n').enumerate() {
            let fault = fault(line).map(|fault| format!("{path}:{}: {fault}", number + 1));
            faults.extend(fault);
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn no_module_is_a_drawer_for_everything() {
    let sources = repository::sources("");
    let drawers: Vec<_> =
        sources.iter().map(|(path, _)| path).filter(|path| drawer(path).is_some()).collect();
    assert!(drawers.is_empty(), "name these after what they hold: {drawers:#?}");
}

#[test]
fn no_file_is_larger_than_a_megabyte_outside_the_recorded_data() {
    let too_large = |path: &Path| {
        let bytes = path.metadata().map_or(0, |metadata| metadata.len());
        let path = repository::shown(path);
        bytes > FILE_BYTES_MAX && !RECORDED.iter().any(|folder| path.starts_with(folder))
    };
    let large: Vec<_> = repository::files("").into_iter().filter(|path| too_large(path)).collect();
    assert!(large.is_empty(), "{large:#?}");
}

#[test]
fn every_file_is_of_a_kind_we_know() {
    let unknown: Vec<_> =
        repository::files("").into_iter().filter(|path| !is_known(path)).collect();
    assert!(unknown.is_empty(), "remove these, or add their kind to this test: {unknown:#?}");
}

#[test]
fn every_crate_follows_the_workspace_lints() {
    let manifests = repository::files("");
    for path in manifests.iter().filter(|path| path.ends_with("Cargo.toml")) {
        let text = repository::read(path);
        assert!(text.contains("[lints]\nworkspace = true"), "{}", repository::shown(path));
    }
}

#[test]
fn each_fault_is_recognised() {
    assert_eq!(fault("let x = 1;"), None);
    assert_eq!(fault("\tlet x = 1;"), Some("a tab"));
    assert_eq!(fault("let x = 1; "), Some("blanks at the end"));
    assert_eq!(fault(&"ü".repeat(100)), None);
    assert_eq!(fault(&"x".repeat(101)), Some("more than 100 columns"));
    assert_eq!(fault(&format!("// https://{}", "x".repeat(101))), None);
    assert_eq!(fault(concat!("unimpl", "emented!()")), Some("unfinished code"));
    assert_eq!(drawer("traces/src/utils.rs"), Some("utils"));
    assert_eq!(drawer("traces/src/common/ring.rs"), Some("common"));
    assert_eq!(drawer("traces/src/commonly.rs"), None);
    assert!(!is_known(Path::new("crash.bak")));
    assert!(!is_known(Path::new("core")));
}
