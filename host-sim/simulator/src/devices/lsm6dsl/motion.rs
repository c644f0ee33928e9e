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

/// Fault of the chip.
pub trait InertialFault {
    /// Modifies a measurement.
    fn modify_measurement(&mut self, _at_us: u64, _measured: &mut InertialTruth) {}

    /// Register address and bit of a bit that flips now.
    fn register_upset(&mut self, _at_us: u64) -> Option<(u8, u8)> {
        None
    }

    /// Whether the chip does not answer.
    fn is_silent(&self, _at_us: u64) -> bool {
        false
    }
}

impl<F: FnMut(u64, &mut InertialTruth)> InertialFault for F {
    fn modify_measurement(&mut self, at_us: u64, measured: &mut InertialTruth) {
        self(at_us, measured);
    }
}
