//! Generates the codecs from `platoon.dbc` and `j1939.dbc`, the single sources of the contract.
//!
//! `model`, `signal` and `layout` read and judge a DBC, `names` turns its names into Rust's, `emit`
//! and `tables` write the code. A DBC this generator cannot serve faithfully stops the build with
//! one line that names the message, the signal and the remedy.

mod emit;
mod layout;
mod model;
mod names;
mod signal;
mod tables;

use model::Contract;
use std::path::Path;

fn main() {
    println!("cargo::rerun-if-changed=build");
    if let Err(refusal) = generate() {
        println!("cargo::error={refusal}");
        std::process::exit(1);
    }
}

fn generate() -> Result<(), String> {
    let target = std::env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?;
    let fd = read("platoon.dbc", None)?;
    let j1939 = read("j1939.dbc", Some(&fd))?;
    write(&fd, "platoon.dbc", &Path::new(&target).join("messages.rs"))?;
    write(&j1939, "j1939.dbc", &Path::new(&target).join("j1939.rs"))
}

fn read(source: &str, elder: Option<&Contract>) -> Result<Contract, String> {
    println!("cargo::rerun-if-changed={source}");
    let text = std::fs::read_to_string(source);
    let text = text.map_err(|error| format!("{source}: cannot read: {error}"))?;
    Contract::read(&text, elder).map_err(|refusal| format!("{source}: {refusal}"))
}

fn write(contract: &Contract, source: &str, target: &Path) -> Result<(), String> {
    let code = format!("// Generated from {source} by can-dbc/build. Do not edit.\n\n");
    std::fs::write(target, code + &emit::code(contract))
        .map_err(|error| format!("cannot write {}: {error}", target.display()))
}
