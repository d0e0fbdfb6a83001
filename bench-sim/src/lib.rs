//! The rig.
mod noise;
pub mod obstacle;
pub mod rectangle;
pub mod truck;
