//! Motion that an inertial sensor on the vehicle measures.

use autoswing::inertial::GRAVITY_M_S2;
use log_analysis::numbers::f32_as_f64;
use nalgebra::Vector3;

use super::aircraft::STEP_US;
use super::simulated_world::World;
use super::state::TrueState;
use crate::devices::lsm6dsl::{InertialSource, InertialTruth};

/// Temperature of a board in use, degrees Celsius.
const BOARD_TEMPERATURE_C: f64 = 30.0;

impl World {
    /// Input of an inertial sensor whose axes are those of the body.
    #[must_use]
    pub fn inertial_source(&self) -> InertialSource {
        let world = self.clone();
        Box::new(move |at_us| {
            let before = world.true_state(at_us.saturating_sub(STEP_US));
            inertial_truth(&before, &world.true_state(at_us), BOARD_TEMPERATURE_C)
        })
    }
}

/// Mean motion between two states, in body axes. The vehicle keeps its height.
#[must_use]
pub fn inertial_truth(before: &TrueState, after: &TrueState, temperature_c: f64) -> InertialTruth {
    let step_s = after.time_us.saturating_sub(before.time_us).max(1) as f64 * 1e-6;
    let gained = Vector3::new(after.north_m_s - before.north_m_s, after.east_m_s - before.east_m_s, 0.0);
    let force = gained / step_s - Vector3::new(0.0, 0.0, f32_as_f64(GRAVITY_M_S2));
    InertialTruth {
        rates_rad_s: after.body_rates_rad_s().into(),
        specific_force_m_s2: after.euler_angles().body_from_earth() * force,
        temperature_c,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: an acceleration of 1 g to the right at a bank of 45 deg is a coordinated turn, with sqrt(2) g along the
    /// body's z axis.
    #[test]
    fn a_coordinated_turn_has_its_force_along_the_z_axis() {
        let before = TrueState { heading_rad: 0.7, roll_rad: std::f64::consts::FRAC_PI_4, ..TrueState::default() };
        let gained_m_s = 9.806_65 * 0.01;
        let after = TrueState {
            time_us: 10_000,
            north_m_s: -libm::sin(0.7) * gained_m_s,
            east_m_s: libm::cos(0.7) * gained_m_s,
            heading_rate_rad_s: 0.4,
            ..before
        };
        let truth = inertial_truth(&before, &after, 20.0);
        let expected = Vector3::new(0.0, 0.0, -9.806_65 * 2_f64.sqrt());
        assert!((truth.specific_force_m_s2 - expected).norm() < 1e-5, "{}", truth.specific_force_m_s2);
        assert!((truth.rates_rad_s - Vector3::new(0.0, 0.4, 0.4) / 2_f64.sqrt()).norm() < 1e-12);
    }
}
