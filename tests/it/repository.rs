//! The files of this repository, for the tests that read them.

use std::fs;
use std::path::{Path, PathBuf};

/// Folders that hold what is generated, not what is written.
const GENERATED: [&str; 5] = [".git", "target", "runs", ".venv", "__pycache__"];

/// The repository's top folder.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every written file below `folder`, a path relative to the root ("" for all), sorted.
pub(crate) fn files(folder: &str) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![root().join(folder)];
    while let Some(folder) = folders.pop() {
        let entries = fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
        for entry in entries {
            let entry = entry.expect("an entry of a readable folder");
            let kind = entry.file_type().expect("every entry has a kind");
            if kind.is_file() {
                files.push(entry.path());
            } else if kind.is_dir() && !GENERATED.iter().any(|name| entry.file_name() == *name) {
                folders.push(entry.path());
            }
        }
    }
    files.sort();
    files
}

/// The Rust sources below `folder`, each with its path relative to the root and its text.
pub(crate) fn sources(folder: &str) -> Vec<(String, String)> {
    let is_rust = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "rs");
    files(folder).into_iter().filter(is_rust).map(|path| (shown(&path), read(&path))).collect()
}

/// A path as a person of this repository writes it.
pub(crate) fn shown(path: &Path) -> String {
    path.strip_prefix(root()).unwrap_or(path).display().to_string()
}

/// The text of a file.
pub(crate) fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}
