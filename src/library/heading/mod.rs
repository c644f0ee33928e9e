//! Heading from the corrected field and the attitude, and the criteria for withholding it.

use nalgebra::Vector3;

use crate::calibration::{Calibration, HeadingUncertainty};
use crate::frames::{Body, Field, RollPitch, Sensor, wrap_two_pi};
use crate::trig;
use crate::trig::{DEG, sqrt, square};

/// A magnetic heading with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heading {
    /// Magnetic heading, radians, 0..2 pi.
    pub magnetic_rad: f32,
    /// Standard deviation, radians: coefficient covariance, sensor noise and attitude noise at this attitude and field.
    pub sigma_rad: f32,
    /// Share of the variance that is common to consecutive readings, square radians: that of the coefficients.
    pub systematic_variance_rad2: f32,
}

impl Heading {
    /// Magnetic heading, degrees, 0..360.
    #[must_use]
    pub fn magnetic_deg(&self) -> f32 {
        self.magnetic_rad.to_degrees()
    }

    /// The heading with an offset added, degrees.
    #[must_use]
    #[inline]
    pub fn rotated_by_deg(self, degrees: f32) -> Self {
        Self { magnetic_rad: wrap_two_pi(self.magnetic_rad + degrees.to_radians()), ..self }
    }

    /// Raises the systematic variance to `variance_rad2`, square radians, if larger: both values describe the same
    /// errors.
    #[must_use]
    #[inline]
    pub fn with_min_systematic_variance(self, variance_rad2: f32) -> Self {
        let added_rad2 = (variance_rad2 - self.systematic_variance_rad2).max(0.0);
        Self {
            sigma_rad: sqrt(self.sigma_rad * self.sigma_rad + added_rad2),
            systematic_variance_rad2: self.systematic_variance_rad2 + added_rad2,
            ..self
        }
    }

    /// Adds an independent systematic variance, square radians.
    #[must_use]
    #[inline]
    pub fn with_added_systematic_variance(self, variance_rad2: f32) -> Self {
        self.with_min_systematic_variance(self.systematic_variance_rad2 + variance_rad2)
    }

    /// Adds an independent variance that is not systematic, square radians.
    #[must_use]
    pub fn with_added_variance(self, variance_rad2: f32) -> Self {
        if variance_rad2 > 0.0 {
            Self { sigma_rad: sqrt(square(self.sigma_rad) + variance_rad2), ..self }
        } else {
            self
        }
    }

    /// Adds the systematic variance by errors of the attitude, square radians.
    ///
    /// # Errors
    ///
    /// [`NoHeading::AttitudeInaccurate`] if it exceeds the limit, or is not a number, as exactly at the vertical.
    pub fn with_attitude_variance(self, variance_rad2: f32) -> Result<Self, NoHeading> {
        if variance_rad2 <= square(MAX_ATTITUDE_SIGMA_RAD) {
            Ok(self.with_added_systematic_variance(variance_rad2))
        } else {
            Err(NoHeading::AttitudeInaccurate)
        }
    }

    /// Standard deviation, degrees.
    #[must_use]
    pub fn sigma_deg(&self) -> f32 {
        self.sigma_rad.to_degrees()
    }
}

/// Reason for withholding the heading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoHeading {
    /// No recent measurement from the sensor.
    SensorSilent,
    /// The sensor is at its range limit.
    SensorSaturated,
    /// A sensor axis is limited below its range.
    SensorClipped,
    /// A sensor axis repeats a value.
    SensorStuck,
    /// The step from the previous reading is implausible.
    SensorSpike,
    /// No attitude, or too old.
    AttitudeStale,
    /// The attitude source repeats a value.
    AttitudeFrozen,
    /// An error of the attitude turns the heading by more than the limit: with the nose near the vertical, and after a start in motion
    /// without an autopilot.
    AttitudeInaccurate,
    /// No calibration for this sensor and mounting.
    Uncalibrated,
    /// The corrected field is not the Earth's: external iron, a current, or an outdated calibration.
    FieldDisturbed,
    /// Hard iron changed since the calibration and is not yet estimated well enough; or the field turns with the aircraft.
    FieldChanged,
    /// Attitude, body rates and field are inconsistent, most likely due to the attitude.
    AttitudeContradicted,
    /// The module is in safe mode after repeated panics.
    SafeMode,
}

impl NoHeading {
    /// Stable code, as shown by `status`.
    #[must_use]
    pub const fn stable_code(self) -> &'static str {
        match self {
            Self::SensorSilent => "sensor-silent",
            Self::SensorSaturated => "sensor-saturated",
            Self::SensorClipped => "sensor-clipped",
            Self::SensorStuck => "sensor-stuck",
            Self::SensorSpike => "sensor-spike",
            Self::AttitudeStale => "attitude-stale",
            Self::AttitudeFrozen => "attitude-frozen",
            Self::AttitudeInaccurate => "attitude-inaccurate",
            Self::Uncalibrated => "uncalibrated",
            Self::FieldDisturbed => "field-disturbed",
            Self::FieldChanged => "field-changed",
            Self::AttitudeContradicted => "attitude-contradicted",
            Self::SafeMode => "safe-mode",
        }
    }
}

/// Acceptance limits of a heading; `None` disables a limit.
#[derive(Clone, Copy, Debug)]
pub struct HeadingLimits {
    /// Largest relative deviation of field strength from the calibration's: twice the 10 % by which it changes over
    /// 1000 km.
    pub max_strength_deviation: Option<f32>,
    /// Cosine of the largest inclination deviation from the calibration's, 12 deg: twice its change over 1000 km, and
    /// more than the attitude error in a sharp manoeuvre.
    pub min_cos_of_inclination_deviation: Option<f32>,
}

impl HeadingLimits {
    /// Limits for flights within 1000 km of the place of calibration.
    pub const DEFAULT: Self =
        Self { max_strength_deviation: Some(0.2), min_cos_of_inclination_deviation: Some(0.978_1) };

    /// No limits, for display only.
    pub const ANY_FIELD: Self = Self { max_strength_deviation: None, min_cos_of_inclination_deviation: None };

    /// Whether the limits are disabled, as in [`ANY_FIELD`](Self::ANY_FIELD).
    #[must_use]
    pub const fn accepts_any_field(&self) -> bool {
        self.max_strength_deviation.is_none()
    }

    /// These limits without that of inclination.
    #[must_use]
    pub const fn without_inclination_limit(self) -> Self {
        Self { min_cos_of_inclination_deviation: None, ..self }
    }
}

/// Heading from a raw field, its attitude and a calibration (Liu 2007 eq. 8, 7 and 3).
///
/// # Errors
///
/// [`NoHeading::FieldDisturbed`] if the corrected field deviates from the calibration's by more than the limits.
pub fn compute_heading(
    limits: HeadingLimits,
    calibration: &Calibration,
    uncertainty: &HeadingUncertainty,
    field: Field<Sensor>,
    attitude: RollPitch,
) -> Result<Heading, NoHeading> {
    heading_from_corrected_field(
        limits,
        calibration,
        uncertainty,
        (field, calibration.calibrated_field(field)),
        attitude,
    )
}

/// Heading from an already corrected field. `field` holds the raw field and the corrected one.
///
/// # Errors
///
/// As [`compute_heading`].
pub fn heading_from_corrected_field(
    limits: HeadingLimits,
    calibration: &Calibration,
    uncertainty: &HeadingUncertainty,
    (field, body): (Field<Sensor>, Field<Body>),
    attitude: RollPitch,
) -> Result<Heading, NoHeading> {
    let tilt = attitude.tilt_rotation();
    let level = tilt.to_level_frame(body);
    let [x, y, z] = [level.ut.x, level.ut.y, level.ut.z].map(|ut| ut / calibration.total_ut);
    let normalised_field = Vector3::new(x, y, z);
    if exceeds_limits(limits, calibration, &normalised_field) {
        return Err(NoHeading::FieldDisturbed);
    }
    let variance = uncertainty.heading_variance(calibration, field, &tilt, level);
    let heading = Heading {
        magnetic_rad: level.heading_rad(),
        sigma_rad: variance.sigma_rad(),
        systematic_variance_rad2: variance.coefficient_variance_rad2,
    };
    if attitude.pitch_rad.abs() <= MAX_USUAL_PITCH_RAD {
        Ok(heading)
    } else {
        steep_heading(heading, uncertainty.attitude_sigma_rad, attitude)
    }
}

/// Pitch above which an attitude is steep.
const MAX_USUAL_PITCH_RAD: f32 = 75.0 * DEG;

/// Largest heading sigma by errors of the attitude, radians: 8 deg, the limit of the monitor.
const MAX_ATTITUDE_SIGMA_RAD: f32 = 8.0 * DEG;

/// Heading at a steep attitude. Near the vertical roll and heading turn about almost the same axis, so that an error of
/// the attitude changes both by its size over the cosine of the pitch.
fn steep_heading(heading: Heading, attitude_sigma_rad: f32, attitude: RollPitch) -> Result<Heading, NoHeading> {
    let (_, cos_pitch) = trig::sin_cos(attitude.pitch_rad);
    heading.with_attitude_variance(square(attitude_sigma_rad / cos_pitch))
}

/// Whether the level field, relative to the calibrated strength, violates the limits; NaN and infinity do.
fn exceeds_limits(limits: HeadingLimits, calibration: &Calibration, field: &Vector3<f32>) -> bool {
    let horizontal_squared = field.x * field.x + field.y * field.y;
    let total_squared = horizontal_squared + field.z * field.z;
    // Field strength times the cosine of the inclination deviation.
    let (sin, cos) = trig::sin_cos(calibration.inclination_rad);
    let along_reference = cos * sqrt(horizontal_squared) + sin * field.z;
    // Compares signed squares, to avoid a square root.
    let is_strength_accepted = limits.max_strength_deviation.is_none_or(|deviation| {
        let (min_strength, max_strength) = ((1.0 - deviation).max(0.0), 1.0 + deviation);
        total_squared >= min_strength * min_strength && total_squared <= max_strength * max_strength
    });
    let is_inclination_accepted = limits
        .min_cos_of_inclination_deviation
        .is_none_or(|min_cos| along_reference * along_reference.abs() >= min_cos * min_cos.abs() * total_squared);
    !(total_squared.is_finite() && is_strength_accepted && is_inclination_accepted)
}

#[cfg(test)]
mod tests;
