//! The module's hardware as its drivers see it: registers, wires, pages. Everything takes its time on the virtual
//! clock.
//!
//! A device outlives the module's tasks: keep its handle outside the [`Simulation`](crate::simulation::Simulation),
//! give the tasks a clone, and it is still there after a reboot.

pub mod i2c;
pub mod lis3mdl;
pub mod nor_flash;
pub mod uart;
