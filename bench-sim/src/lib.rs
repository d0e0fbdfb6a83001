//! The rig of a platoon rehearsal: everything that is not the controller.
//!
//! Truck plants, scripted obstacles, sensors, the V2V radio, one CAN node per truck, scenarios and
//! what a run is measured by. It plays the part of a real-time simulator: ECUs meet it on CAN only,
//! and it knows nothing of the control law. It reads no clock; time arrives as the number of steps
//! to take, or through a [`platoon_dbc::Clock`]. Everything random comes from one seed, every
//! transcendental function from `libm`: the same seed gives the same frames on every machine.
//!
//! ```
//! use bench_sim::{Rig, Scenario};
//! use platoon_dbc::{Bus, Loopback};
//!
//! let scenario = Scenario::load("obstacle-avoidance", &[]).expect("built in");
//! let (rig_ends, ecu_ends): (Vec<Box<dyn Bus>>, Vec<_>) = (0..scenario.platoon.trucks)
//!     .map(|truck| Loopback::pair(&format!("loopback{truck}"), 4096))
//!     .map(|(rig_end, ecu_end)| (Box::new(rig_end) as Box<dyn Bus>, ecu_end))
//!     .unzip();
//! let mut rig = Rig::new(&scenario, 1, 1000, rig_ends, None).expect("one bus per truck");
//! rig.start();
//! for _ in 0..500 {
//!     rig.step(); // nobody answers, so every truck coasts and then brakes
//! }
//! assert_eq!(rig.results().trucks[3].lost_commands, 1);
//! # drop(ecu_ends);
//! ```

mod channel;
mod metrics;
mod noise;
pub mod obstacle;
mod rectangle;
pub mod rig;
mod roster;
pub mod scenario;
mod sensor;
mod transition;
pub mod truck;
mod truck_node;

pub use channel::ChannelReport;
pub use metrics::{Amplification, Criterion, TruckResult};
pub use rectangle::Rectangle;
pub use rig::{Results, Rig, RigError};
pub use scenario::{Scenario, ScenarioError};
pub use truck_node::NodeCounts;
