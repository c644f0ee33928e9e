//! The simulated world: vehicle, weather, Earth's field, airframe and autopilot.

pub mod aircraft;
pub mod airframe;
pub mod attitude_source;
pub mod autopilot;
pub mod cable_far_end;
mod config;
pub mod earth;
pub mod fault_interfaces;
pub mod gauss_markov;
pub mod gyro;
pub mod mavlink_autopilot;
mod mavlink_frame;
pub mod msp_autopilot;
pub mod parameter_table;
pub mod published_table1;
pub mod rotation;
mod simulated_world;
mod state;
pub mod weather;

pub use self::config::{ConfigError, WorldConfig};
pub use self::simulated_world::World;
#[cfg(test)]
use self::simulated_world::inertial_truth;
pub use self::state::{CRUISE_CURRENT_A, TrueState};

#[cfg(test)]
mod tests;
