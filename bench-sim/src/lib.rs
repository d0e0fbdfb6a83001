//! The rig.
mod channel;
mod noise;
pub mod obstacle;
pub mod rectangle;
pub mod scenario;
pub mod truck;
