//! Fault injection between the world and the module; devices and world contain no fault code.
//!
//! | interface | file | faults |
//! |---|---|---|
//! | magnetometer | `sensor.rs` | measurements and register upsets on the I2C bus |
//! | gyro and accelerometer | `inertial.rs` | measurements, register upsets and silence of the chip |
//! | attitude source | `attitude.rs` | modified messages |
//! | link | `link_faults.rs` | an autopilot that pauses, other senders, forged messages |
//! | field | `field.rs` | hard-iron changes and other fields at the chip |
//!
//! Each fault is active while its [`FaultSwitch`] is on, and depends only on its seed and the simulation time.

pub mod attitude;
mod fault_switch;
pub mod field;
pub mod inertial;
pub mod link_faults;
pub mod sensor;

pub use fault_switch::FaultSwitch;

use std::rc::Rc;

use crate::devices::lsm6dsl::InertialFault;

/// Faults of one module. Default: none.
#[derive(Default)]
pub struct Faults {
    /// Faults of a LIS3MDL.
    pub sensor_faults: Vec<Box<dyn sensor::SensorFault>>,
    /// Faults of gyro and accelerometer.
    pub inertial_faults: Vec<Box<dyn InertialFault>>,
    /// Faults of the attitude source.
    pub attitude_faults: Vec<Box<dyn attitude::AttitudeFault>>,
    /// Faults of the link to the autopilot.
    pub link_faults: Vec<link_faults::LinkFault>,
    /// Field faults, shared with code that needs the true field.
    pub field_faults: Vec<Rc<dyn field::FieldFault>>,
}

#[cfg(test)]
mod tests;
