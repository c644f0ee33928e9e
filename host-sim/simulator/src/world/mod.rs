//! The simulated world: vehicle, weather, Earth's field, airframe and autopilot.
//!
//! | file | holds | |---|---| | `simulated_world.rs` | the world as a whole | | `config.rs` | world settings, airframe
//! file | | `aircraft/`, `autopilot.rs`, `weather.rs` | vehicle models, flight plan, wind and turbulence | | `state.rs`
//! | true state at one instant | | `rotation.rs` | rotation from north, east, down to body axes, independent of the
//! library | | `earth.rs`, `airframe.rs` | Earth's field; soft iron, hard iron and mounting | | `published_table1.rs` |
//! airframe and published errors of Liu 2007 table 1 | | `attitude_source/`, `attitude_task.rs` | MAVLink attitude with
//! typical errors | | `gyro.rs` | the autopilot's gyro with the errors of its data sheet | | `fault_interfaces.rs` |
//! how faults change field and attitude | | `msp_autopilot/` | autopilot that uses the module as MSP compass | |
//! `mavlink_autopilot/` | autopilot that answers MAVLink requests | | `flight_place.rs` | place and date of the flight
//! | | `cable_far_end.rs` | selection of the device at a port | | `gauss_markov.rs` | coloured noise |

pub mod aircraft;
pub mod airframe;
pub mod attitude_source;
mod attitude_task;
pub mod autopilot;
pub mod cable_far_end;
mod config;
pub mod earth;
pub mod fault_interfaces;
pub mod flight_place;
pub mod gauss_markov;
pub mod gyro;
pub mod mavlink_autopilot;
mod mavlink_frame;
pub mod msp_autopilot;
pub mod published_table1;
pub mod rotation;
mod simulated_world;
mod state;
pub mod weather;

pub use self::config::{ConfigError, WorldConfig};
pub use self::simulated_world::World;
pub use self::state::{CRUISE_CURRENT_A, TrueState};

#[cfg(test)]
mod tests;
