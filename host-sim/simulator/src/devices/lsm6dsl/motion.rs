//! Motion that an inertial sensor measures.

use nalgebra::Vector3;

/// Motion at an instant, in the chip's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialTruth {
    /// Rates, rad/s.
    pub rates_rad_s: Vector3<f64>,
    /// Specific force, m/s^2.
    pub specific_force_m_s2: Vector3<f64>,
    /// Temperature of the chip, degrees Celsius.
    pub temperature_c: f64,
}

/// Motion as a function of simulation time in microseconds.
pub type InertialSource = Box<dyn FnMut(u64) -> InertialTruth>;
