//! A change of hard iron, and its effect on headings.

use nalgebra::Vector3;

/// Smallest effect of a cause on a level heading, degrees: less is within the error of a good calibration.
pub(in crate::replay) const MIN_HEADING_EFFECT_DEG: f64 = 1.0;

/// Largest norm of the sum of two changes that cancel each other, relative to the larger change.
const MAX_CANCELLED_REMAINDER: f64 = 0.35;

/// A change of hard iron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardIronChange {
    /// Flight time of the change, seconds.
    pub time_s: f64,
    /// Step of the raw field, body axes, microtesla.
    pub step_ut: Vector3<f64>,
    /// Standard deviation of each component, microtesla.
    pub sigma_ut: Vector3<f64>,
    /// Largest effect on a level heading, degrees.
    pub heading_effect_deg: f64,
}

impl HardIronChange {
    /// Axis with the largest component.
    #[must_use]
    pub fn axis(&self) -> char {
        ['x', 'y', 'z'][self.step_ut.iamax()]
    }
}

/// Start of a temporary change, seconds: that of the change before the last, if the last one cancels it.
#[must_use]
pub fn temporary_change_start_s(changes: &[HardIronChange]) -> Option<f64> {
    let [.., first, last] = changes else { return None };
    let remainder_ut = (first.step_ut + last.step_ut).norm();
    let larger_ut = first.step_ut.norm().max(last.step_ut.norm());
    (remainder_ut < MAX_CANCELLED_REMAINDER * larger_ut).then_some(first.time_s)
}

/// Largest effect of a disturbance on a level heading, degrees.
pub(in crate::replay) fn heading_effect_deg(disturbance_ut: Vector3<f64>, horizontal_ut: f64) -> f64 {
    libm::atan(disturbance_ut.xy().norm() / horizontal_ut).to_degrees()
}
