//! A constant error of the attitude source: its effect, its assumed size, and its test.

use super::score_test::ScoreTest;
use crate::calibration::fit::ConvergedFit;
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::model::SampleEquations;
use crate::calibration::statistics::residuals::ResidualStatistics;
use crate::calibration::types::quality::ConsiderSigmas;
use crate::calibration::types::samples::AngleRates;
use crate::frames::RollPitch;
use crate::trig::sqrt;

/// Row of the [table](super::attitude_error_table) of attitude errors.
pub(in crate::calibration) struct AttitudeError {
    /// Change of roll and pitch by one unit of the error, radians.
    pub attitude_derivative: fn(&AttitudeState) -> [f32; 2],
    /// Standard deviation of the error that is assumed before a test.
    pub assumed_sigma: fn(ConsiderSigmas) -> f32,
    /// Decides whether a tested error is significant. Such an error is not corrected; its square is added to the
    /// variance.
    pub significance_test: Option<fn(&AttitudeErrorTestInput<'_>) -> Option<AttitudeErrorFinding>>,
}

/// Attitude and rates of a sample, with the roll after a low-pass filter.
#[derive(Clone, Copy, Debug)]
pub(in crate::calibration) struct AttitudeState {
    pub attitude: RollPitch,
    pub rates: AngleRates,
    /// [Lagged roll](super::attitude_error_table::LaggedRoll), radians.
    pub lagged_roll_rad: f32,
    /// Elapsed fraction of the flight, less 1/2.
    pub centred_flight_fraction: f32,
}

impl AttitudeState {
    /// State in the middle of the flight, in a turn so long that the lagged roll equals the roll.
    pub const fn steady_turn(attitude: RollPitch, rates: AngleRates) -> Self {
        Self { attitude, rates, lagged_roll_rad: attitude.roll_rad, centred_flight_fraction: 0.0 }
    }
}

impl AttitudeError {
    /// Derivative of a sample's inclination by the error.
    pub fn inclination_derivative(&self, equations: &SampleEquations, state: &AttitudeState) -> f32 {
        let [by_roll, by_pitch] = equations.inclination_derivatives_by_attitude;
        let [roll, pitch] = (self.attitude_derivative)(state);
        by_roll * roll + by_pitch * pitch
    }
}

/// Input of the test for a constant attitude error.
pub(in crate::calibration) struct AttitudeErrorTestInput<'a> {
    /// Sums of the tested error.
    pub score_sums: &'a ScoreTest<1>,
    /// Information of a roll bias: sensitivity of the inclination residuals to roll noise.
    pub roll_information: f32,
    pub linear_system: &'a LinearisedProblem,
    pub residuals: &'a ResidualStatistics,
    pub fit: &'a ConvergedFit<'a>,
    pub assumed_sigma: f32,
}

/// An error that is significant and above the assumed one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::calibration) struct AttitudeErrorFinding {
    pub estimate: f32,
    /// Significance of the estimate, sigmas, the assumed error included.
    pub significance_sigmas: f32,
    /// Squared error to allow for beyond the assumed error.
    pub excess_square: f32,
}

/// Finds an error of which none is assumed by its score, if it has more than `min_sigmas`.
pub(super) fn find_significant_error(
    test: &AttitudeErrorTestInput<'_>,
    min_sigmas: f32,
) -> Option<AttitudeErrorFinding> {
    let score = test.score_sums.eliminate_coefficients(test.linear_system, &test.linear_system.step_to_maximum()?)?;
    let estimate = score.gradient.x / score.information.x;
    let sigma = sqrt(test.residuals.autocorrelation_inflation() / score.information.x);
    significant_finding(estimate, sigma, min_sigmas)
}

fn significant_finding(estimate: f32, sigma: f32, min_sigmas: f32) -> Option<AttitudeErrorFinding> {
    (estimate.abs() > min_sigmas * sigma).then_some(AttitudeErrorFinding {
        estimate,
        significance_sigmas: estimate.abs() / sigma,
        excess_square: estimate * estimate,
    })
}

impl AttitudeErrorFinding {
    /// The assumed standard deviation with the allowance added in quadrature.
    pub fn allowed_sigma(&self, assumed_sigma: f32) -> f32 {
        sqrt(assumed_sigma * assumed_sigma + self.excess_square)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_significant_error_is_found() {
        for estimate in [0.05, -0.05] {
            let found = significant_finding(estimate, 0.01, 2.5).unwrap();
            assert!((found.significance_sigmas - 5.0).abs() < 1e-4 && found.estimate.to_bits() == estimate.to_bits());
            assert!((found.excess_square - 0.05 * 0.05).abs() < 1e-8);
            assert!(significant_finding(0.3 * estimate, 0.01, 2.5).is_none());
        }
        assert!(
            significant_finding(f32::NAN, 0.01, 2.5).is_none() && significant_finding(0.1, f32::NAN, 2.5).is_none()
        );
    }
}
