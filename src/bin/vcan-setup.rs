//! The command `vcan-setup`: `platoon vcan` for machines that need only that part.

use std::process::ExitCode;

fn main() -> ExitCode {
    platoon::vcan_main()
}
