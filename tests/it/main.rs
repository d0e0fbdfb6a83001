//! What no single crate can test: the shape of the workspace, and whole rehearsals.

mod architecture;
mod bench;
mod bus_timing;
mod capture;
mod compare;
mod deadline;
mod determinism;
mod diff;
mod distributed_mpc;
mod faults;
mod full_disk;
mod gain;
mod gateway;
mod hazards;
mod ingredients;
mod nominal;
#[path = "../../can-dbc/tests/it/random.rs"]
mod random;
mod real_time;
mod rehearsal;
mod replay;
mod repository;
mod responses;
mod rosters;
mod tidy;
mod usage;
mod vcan_interfaces;
mod vcan_shell;
