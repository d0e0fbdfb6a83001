//! Integration tests of the contract: the buses behave alike, and a bad DBC stops the build.

mod bus_time;
mod conformance;
mod emulated;
mod generator;
mod random;
