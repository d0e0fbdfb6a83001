//! The command `platoon`.

use std::process::ExitCode;

fn main() -> ExitCode {
    platoon::main()
}
