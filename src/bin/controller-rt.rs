//! The command `controller-rt`: `platoon controller` for machines that need only that part.

use std::process::ExitCode;

fn main() -> ExitCode {
    platoon::controller_main()
}
