//! Simulated hardware at register and wire level, with realistic timing on the simulation clock.
//!
//! Devices survive a reboot of the module: keep the handle outside the [`Simulation`](testkit::simulation::Simulation)
//! and give clones to its tasks.

pub mod can;
pub mod i2c;
pub mod lis3mdl;
pub mod lsm6dsl;
pub mod nor_flash;
pub mod rm3100;
pub mod sensor;
pub mod spi;
pub mod uart;
