//! What no single crate can test: the shape of the workspace, and whole rehearsals.

mod architecture;
mod bench;
mod determinism;
mod faults;
mod nominal;
mod real_time;
mod rehearsal;
mod repository;
mod tidy;
mod usage;
