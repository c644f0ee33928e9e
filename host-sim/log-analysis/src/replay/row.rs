//! A row of simultaneous data.

use autoswing::attitude::{BodyRates, EulerRates};
use autoswing::frames::{Body, Field, RollPitch, Sensor};
use nalgebra::{Matrix3, Vector3};

use crate::log::FieldCorrection;

/// A row of simultaneous data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReplayRow {
    /// Flight time of the measurement, seconds.
    pub t_s: f64,
    /// Raw field, body axes.
    pub raw_field: Field<Sensor>,
    /// The field as the autopilot corrected it, body axes.
    pub logged_field: Field<Sensor>,
    /// The autopilot's attitude.
    pub attitude: RollPitch,
    /// Body rates p, q, r, rad/s, if available.
    pub rates_rad_s: Option<[f32; 3]>,
    /// Battery current, amperes, if known.
    pub current_a: Option<f32>,
    /// Whether the row is used for fit and score.
    pub is_usable: bool,
    /// Reference heading, degrees from an arbitrary north.
    pub reference_deg: Option<f64>,
}

impl ReplayRow {
    /// Usable row of a field that the autopilot does not correct, without rates, current and reference.
    pub(super) const fn of_field(t_s: f64, field: Field<Sensor>, attitude: RollPitch) -> Self {
        Self {
            t_s,
            raw_field: field,
            logged_field: field,
            attitude,
            rates_rad_s: None,
            current_a: None,
            is_usable: true,
            reference_deg: None,
        }
    }

    /// Direction of down, body axes.
    #[must_use]
    pub fn down_in_body(&self) -> Vector3<f64> {
        down_in_body(self.attitude)
    }

    /// The row with its raw field in rotated axes.
    #[must_use]
    pub fn in_rotated_axes(&self, rotation_matrix: &Matrix3<f64>) -> Self {
        let field = rotation_matrix * self.raw_field.ut.map(f64::from);
        Self { raw_field: Field::new(field.map(|axis| axis as f32)), ..*self }
    }

    /// Field as the autopilot corrected it, microtesla.
    pub fn logged_ut(&self) -> Vector3<f64> {
        self.logged_field.ut.map(f64::from)
    }

    /// Rate of the heading by the body rates, rad/s.
    pub(super) fn heading_rate_rad_s(&self) -> Option<f64> {
        let rates = BodyRates::from_rad_s(self.rates_rad_s?)?;
        Some(EulerRates::from_body_rates(rates, self.attitude).heading_rad_s.into())
    }

    /// Heading by the field as the autopilot corrected it, degrees.
    #[must_use]
    pub fn logged_heading_deg(&self) -> f64 {
        heading_deg(self, self.logged_ut())
    }

    /// Corrected field, microtesla; an unknown current counts as zero.
    pub fn corrected_field(&self, correction: &FieldCorrection) -> Vector3<f64> {
        correction.correct_field(self.raw_field.ut.map(f64::from), self.current_a.map_or(0.0, f64::from))
    }
}

/// Integral of a rate from the first row to each.
pub(super) fn integrals<'a>(
    rows: impl IntoIterator<Item = &'a ReplayRow>,
    rate: impl Fn(&ReplayRow) -> f64,
) -> Vec<f64> {
    let (mut integral, mut last) = (0.0, None);
    let integral_to = |row: &ReplayRow| {
        let (t_s, rate) = (row.t_s, rate(row));
        let (last_s, last_rate) = last.replace((t_s, rate)).unwrap_or((t_s, rate));
        integral += (t_s - last_s) * (last_rate + rate) / 2.0;
        integral
    };
    rows.into_iter().map(integral_to).collect()
}

/// Rows before a time, and from it on, seconds.
pub(super) fn split_at_time(rows: &[ReplayRow], t_s: f64) -> [&[ReplayRow]; 2] {
    rows.split_at(rows.partition_point(|row| row.t_s < t_s)).into()
}

/// Heading of a row by a corrected field, degrees.
pub(crate) fn heading_deg(row: &ReplayRow, corrected: Vector3<f64>) -> f64 {
    let field: Field<Body> = Field::new(corrected.map(|axis| axis as f32));
    f64::from(row.attitude.to_level_frame(field).heading_rad().to_degrees())
}

/// Direction of down at an attitude, body axes.
pub(super) fn down_in_body(attitude: RollPitch) -> Vector3<f64> {
    let [(sin_roll, cos_roll), (sin_pitch, cos_pitch)] =
        [attitude.roll_rad, attitude.pitch_rad].map(|angle| libm::sincos(f64::from(angle)));
    Vector3::new(-sin_pitch, sin_roll * cos_pitch, cos_roll * cos_pitch)
}
