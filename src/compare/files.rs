//! What the comparison leaves: Markdown, JSON, pictures, and the numbers of the figures.

use std::fs;
use std::path::{Path, PathBuf};

use super::comparison::Comparison;
use super::figure::Figure;
use super::{markdown, picture};
use crate::cli::CompareArgs;
use crate::failure::Failure;
use crate::process;

/// Makes sure, before a long comparison, that everything asked for has a place.
///
/// # Errors
/// When it has none.
pub fn check(args: &CompareArgs) -> Result<(), Failure> {
    for (option, path) in [("--json", &args.json), ("--markdown", &args.markdown)] {
        if let Some(path) = path {
            process::check_parent(option, path)?;
        }
    }
    match &args.out {
        Some(out) => make_folder(out),
        None => Ok(()),
    }
}

/// Writes what is asked for.
///
/// # Errors
/// When something cannot be written.
pub fn write(
    args: &CompareArgs,
    comparison: &Comparison,
    figures: &[Figure],
) -> Result<(), Failure> {
    if let Some(path) = &args.json {
        process::write_json(path, comparison)?;
    }
    if let Some(path) = &args.markdown {
        write_markdown(path, comparison, figures)?;
    }
    let Some(out) = &args.out else {
        return Ok(());
    };
    process::write_json(&out.join("results.json"), comparison)?;
    write_markdown(&out.join("results.md"), comparison, figures)?;
    let data = out.join("data");
    make_folder(&data)?;
    for (name, text) in figures.iter().flat_map(Figure::tables) {
        write_text(data.join(name), &text)?;
    }
    anstream::eprintln!("results.md, results.json, pictures/ and data/ are in {}", out.display());
    Ok(())
}

/// The page, and beside it the pictures that it shows.
fn write_markdown(path: &Path, comparison: &Comparison, figures: &[Figure]) -> Result<(), Failure> {
    write_text(path.to_path_buf(), &markdown::page(comparison))?;
    let pictures = path.with_file_name("pictures");
    if !figures.is_empty() {
        make_folder(&pictures)?;
    }
    figures.iter().try_for_each(|figure| {
        write_text(pictures.join(format!("{}.svg", figure.file)), &picture::svg(figure))
    })
}

fn make_folder(path: &Path) -> Result<(), Failure> {
    fs::create_dir_all(path).map_err(|error| {
        Failure::cannot_start(format!("cannot make the folder {}: {error}", path.display()))
    })
}

fn write_text(path: PathBuf, text: &str) -> Result<(), Failure> {
    fs::write(&path, text)
        .map_err(|error| Failure::cannot_start(format!("cannot write {}: {error}", path.display())))
}
