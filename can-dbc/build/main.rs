//! Generates the codec from `platoon.dbc`, the single source of the contract.
//!
//! `model` reads and judges the DBC, `names` turns its names into Rust's, `emit` writes the code.
//! A DBC this generator cannot serve faithfully stops the build with one line that names the
//! message, the signal and the remedy.

mod emit;
mod model;
mod names;

use std::path::PathBuf;

const SOURCE: &str = "platoon.dbc";

fn main() {
    println!("cargo::rerun-if-changed={SOURCE}");
    println!("cargo::rerun-if-changed=build");
    if let Err(refusal) = generate() {
        println!("cargo::error={SOURCE}: {refusal}");
        std::process::exit(1);
    }
}

fn generate() -> Result<(), String> {
    let text = std::fs::read_to_string(SOURCE).map_err(|error| format!("cannot read: {error}"))?;
    let contract = model::Contract::read(&text)?;
    let target = PathBuf::from(std::env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?);
    std::fs::write(target.join("messages.rs"), emit::code(&contract))
        .map_err(|error| format!("cannot write messages.rs: {error}"))
}
