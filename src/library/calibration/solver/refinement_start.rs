//! Starting point of a refinement, and the model with which it begins.

use nalgebra::Matrix3;

use super::solve_attempts::AttemptStart;
use crate::calibration::closed_form::starting_point::{self, SensorResponse, StartingPoint};
use crate::calibration::closed_form::{compass_swing, four_ellipse, level_ellipse, two_plane};
use crate::calibration::fit::levenberg_marquardt::Refinement;
use crate::calibration::model::{Likelihood, ModelConfig};
use crate::calibration::types::error::SolveError;
use crate::calibration::types::method::Method;
use crate::calibration::types::orientation::Orientation;
use crate::calibration::types::prior::Prior;
use crate::calibration::types::quality::AttitudeEnvelope;
use crate::calibration::types::samples::{CollectionPart, Samples};

#[derive(Clone, Copy, Debug)]
pub(super) struct SampleCorrections {
    pub latency_s: f32,
    /// Motor-current interference, uT/A, chip axes.
    pub ut_per_a: [f32; 3],
}

impl SampleCorrections {
    pub const NO_CORRECTIONS: Self = Self { latency_s: 0.0, ut_per_a: [0.0; 3] };
}

fn solve_closed_form(
    method: Method,
    samples: Samples<'_>,
    rotation: &Matrix3<f32>,
    inclination_rad: Option<f32>,
) -> Result<SensorResponse, SolveError> {
    match method {
        Method::Level => level_ellipse::solve_level_ellipse(samples, rotation),
        Method::FourEllipse => four_ellipse::solve_four_ellipse(samples, rotation, inclination_rad),
        Method::TwoPlane | Method::MaximumLikelihood => two_plane::solve_two_plane(samples, rotation),
        Method::CompassSwing => compass_swing::solve_compass_swing(samples.marks, rotation, inclination_rad),
        Method::Ellipsoid => Err(SolveError::NotDetermined(CollectionPart::FREE)),
    }
}

#[inline(never)]
pub(super) fn choose_starting_point(
    method: Method,
    samples: Samples<'_>,
    prior: &Prior,
) -> Result<(StartingPoint, AttemptStart), SolveError> {
    let rotation = prior.mount.body_from_sensor();
    let matches_mounting =
        |start: &StartingPoint| Orientation::nearest_to_rotation(&start.w) == Orientation::IDENTITY_ROTATION;
    if samples.has_free_flight_samples()
        && method != Method::Ellipsoid
        && let Some(start) = starting_point::vertical_component_start(samples, &rotation)
    {
        return Ok((start, AttemptStart::ClosedForm));
    }
    let closed_form_start = match solve_closed_form(method, samples, &rotation, prior.inclination_rad) {
        Ok(response) => response.starting_point(),
        // Where the closed form has no solution, these methods start from the sphere fit.
        Err(_) if matches!(method, Method::MaximumLikelihood | Method::Ellipsoid) => None,
        Err(error) => return Err(error),
    };
    match closed_form_start {
        Some(start) if method == Method::MaximumLikelihood && !matches_mounting(&start) => {
            // Two planes need the direction of turn, which the bank gives only for aircraft that bank into turns.
            let vertical_start = starting_point::vertical_component_start(samples, &rotation).filter(matches_mounting);
            Ok((vertical_start.unwrap_or(start), AttemptStart::ClosedForm))
        }
        Some(start) => Ok((start, AttemptStart::ClosedForm)),
        None if method.is_refined() => Ok((
            starting_point::sphere_start(samples, &rotation).ok_or(SolveError::NotConverged)?,
            AttemptStart::Sphere,
        )),
        None => Err(SolveError::NotConverged),
    }
}

pub(super) fn begin_refinement(
    method: Method,
    prior: &Prior,
    samples: Samples<'_>,
    start: &StartingPoint,
    corrections: SampleCorrections,
) -> Result<Refinement, SolveError> {
    let config = match method {
        Method::Level => ModelConfig::WITH_FIXED_MOUNTING,
        Method::Ellipsoid => ModelConfig::WITHOUT_ATTITUDE,
        Method::FourEllipse | Method::TwoPlane | Method::MaximumLikelihood | Method::CompassSwing => {
            ModelConfig::DEFAULT
        }
    };
    let mut likelihood =
        Likelihood { latency_s: corrections.latency_s, ..Likelihood::new(prior, config, samples, start.field_unit_ut) };
    likelihood.motor_current.ut_per_a = corrections.ut_per_a;
    if method == Method::CompassSwing && AttitudeEnvelope::for_samples(method, samples) == AttitudeEnvelope::Level {
        // The inclination is unobservable on level ground, and fixed at its start value.
        likelihood.known_inclination_rad = Some(start.inclination_rad);
    }
    let unknowns = likelihood.unknowns_from_start(start).ok_or(SolveError::NotConverged)?;
    Ok(Refinement::new(likelihood, samples, unknowns, method.is_refined()))
}
