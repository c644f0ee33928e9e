//! Interface of the drivers.

use autoswing::inertial::{InertialSample, InertialSensorErrors};

use crate::chip::MeasuringChip;

/// Measurement of an inertial sensor, in the chip's right-handed axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialReading {
    /// Rates and specific force.
    pub sample: InertialSample,
    /// Temperature of the chip, degrees Celsius.
    pub temperature_c: f32,
    /// Whether an axis is at the limit of its range.
    pub is_saturated: bool,
}

/// Gyro and accelerometer in one chip.
pub trait InertialSensor: MeasuringChip<Identity = (), Measurement = InertialReading> {
    /// Errors of the chip by its data sheet.
    fn sensor_errors(&self) -> InertialSensorErrors;
}
