//! `platoon scenarios`: what can be rehearsed.

use bench_sim::Scenario;

use crate::cli::ScenariosArgs;
use crate::failure::Failure;

/// Lists the scenarios, or prints one with every number a run would use.
///
/// # Errors
/// When there is no such scenario.
pub fn run(args: &ScenariosArgs) -> Result<(), Failure> {
    match &args.name {
        Some(name) => {
            let scenario = Scenario::load(name, &[]).map_err(Failure::usage)?;
            match Scenario::built_in_text(name) {
                // The text as written has comments with sources.
                Some(text) => anstream::print!("{text}"),
                None => anstream::print!("{}", scenario.to_toml()),
            }
        }
        None => {
            for summary in Scenario::list() {
                anstream::println!("{:28} {}", summary.name, summary.description);
            }
            anstream::println!(
                "\nShow one with `platoon scenarios NAME`, run it with `platoon rehearse NAME`."
            );
        }
    }
    Ok(())
}
