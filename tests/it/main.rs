//! What no single crate can test: the shape of the workspace, and later whole rehearsals.

mod architecture;
mod repository;
mod tidy;
