//! Integration tests of the contract: the buses behave alike, and a bad DBC stops the build.

mod conformance;
mod generator;
