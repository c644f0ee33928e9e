//! Calibration: pure functions from samples to the twelve deviation coefficients. No I/O, no clock, no allocation.
//!
//! # From samples to a calibration
//!
//! Input: [`Samples`] of a left and a right turn. Output: a [`Solution`], whose [`Calibration`] corrects a measured
//! field and whose [`Quality`] holds the expected heading error, or a [`SolveError`].
//!
//! ```
//! use std::f32::consts::TAU;
//!
//! use autoswing::calibration::{CollectionPart, MotorCurrent, Method, Prior, AngleRates, Sample, Samples, solve_samples};
//! use autoswing::frames::{RollPitch, Field, wrap_pi};
//! use autoswing::time::WrappingMillis;
//!
//! // In place of a sensor: the Earth's field of 50 uT and 60 deg of inclination, bent by the iron of an airframe.
//! let measure = |attitude: RollPitch, heading_rad: f32| {
//!     let earth = Field::earth_field(50.0, 60_f32.to_radians(), heading_rad);
//!     let body = attitude.to_body_frame(earth).ut;
//!     Field::from_ut(
//!         1.10 * body.x + 0.04 * body.y + 12.0,
//!         0.93 * body.y - 0.05 * body.z - 8.0,
//!         0.02 * body.x + 1.01 * body.z + 20.0,
//!     )
//! };
//!
//! // A full circle of 60 samples in half a minute, at 25 deg of bank to the left or to the right.
//! let circle = |bank_deg: f32, part: CollectionPart, start_ms: u32| {
//!     (0..60)
//!         .map(move |i| {
//!             let attitude = RollPitch::from_deg(bank_deg, 2.0);
//!             let heading_rad = bank_deg.signum() * TAU * i as f32 / 60.0;
//!             let (field, time) = (measure(attitude, heading_rad), WrappingMillis::new(start_ms + i * 500));
//!             Sample { time, part, ..Sample::new(field, attitude) }
//!         })
//! };
//! let (left, right) = (circle(-25.0, CollectionPart::LEFT, 0), circle(25.0, CollectionPart::RIGHT, 30_000));
//! let turns: Vec<Sample> = left.chain(right).collect();
//! let samples = Samples::new(&turns);
//!
//! let solution = solve_samples(Method::MaximumLikelihood, samples, &Prior::default())?;
//! assert!(solution.quality.expected_rms_deg < 1.0);
//!
//! // From then on: the field of a reading, corrected, levelled by the attitude at its instant, shows the heading.
//! let (attitude, heading_rad) = (RollPitch::from_deg(10.0, -3.0), 1.2);
//! let corrected = solution.calibration.calibrated_field(measure(attitude, heading_rad));
//! let error_rad = wrap_pi(attitude.to_level_frame(corrected).heading_rad() - heading_rad);
//! assert!(error_rad.abs().to_degrees() < 0.1, "{error_rad} rad");
//! # Ok::<(), autoswing::calibration::SolveError>(())
//! ```
//!
//! The method-selection module chooses the method that the samples support. On a device with other work to do, a
//! [`Solver`] makes one pass over the samples at a time.
//!
//! # Folders
//!
//! | room | content |
//! |---|---|
//! | `types/` | samples, method, coefficients, quality, errors |
//! | `linear_algebra` | least squares in `f32` |
//! | `closed_form/` | level, four ellipses, two planes, compass swing; starting points |
//! | `model/` | unknowns, predicted field, residuals, noise, priors |
//! | `fit/` | normal equations, Levenberg-Marquardt iteration |
//! | `statistics/` | autocorrelation, heteroscedasticity, white-noise fraction and systematic part of the residuals |
//! | `hypotheses/` | score tests: hard-iron change, motor current, attitude latency, bank-angle scale error, attitude drift |
//! | `uncertainty/` | Fisher information, covariance, variance of a heading, expected error |
//! | `advice`, `assessment` | recommended manoeuvre; quality and findings of a converged fit |
//! | `solver/` | the solve in steps: starts, restarts, plausibility |
//! | `method_selection`, `verification` | choice of method; comparison on held-back samples |

mod advice;
mod assessment;
mod closed_form;
mod fit;
mod hypotheses;
mod linear_algebra;
pub mod method_selection;
mod model;
mod solver;
mod statistics;
mod types;
mod uncertainty;
pub mod verification;

pub use advice::{Advice, HeadingQuadrant, Manoeuvre, NOTICEABLE_ERROR_RATIO, TiltDirection};
pub use assessment::{Finding, Solution};
pub use solver::stepwise_solver::{SolveProgress, Solver, solve_samples};
pub use types::{
    coefficients::{Calibration, MotorCurrentInterference, Orientation, Prior},
    quality::{
        AttitudeEnvelope, AttitudeLatency, Axis, BankScaleFinding, ConsiderSigmas, DetectedHardIronChange,
        HardIronTimeCourse, Method, Quality, SolveError, UnobservableQuantities,
    },
    samples::{AngleRates, CollectionPart, HeadingMark, MotorCurrent, Sample, Samples},
};
pub use uncertainty::{
    expected_error::Deviation,
    heading_uncertainty::{HeadingUncertainty, HeadingVariance},
};
pub(crate) use {
    closed_form::{conic::PrincipalPlane, starting_point::fit_sphere},
    fit::information_matrix::InformationMatrix,
    linear_algebra::{LeastSquares, inverse, multiply},
    model::{FieldPrediction, JacobianRow},
};

#[cfg(test)]
use linear_algebra::matrix_rows;
#[cfg(test)]
pub(crate) mod tests;
