//! The command `bench-sim`: `platoon bench` for machines that need only that part.

use std::process::ExitCode;

fn main() -> ExitCode {
    platoon::bench_main()
}
