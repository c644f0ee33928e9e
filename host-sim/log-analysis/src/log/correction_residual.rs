//! Difference between a corrected field and the raw field of the same compass, corrected by the parameters of the log.

use nalgebra::Vector3;

use super::correction::FieldCorrection;
use super::time_series::{Series, TimedRow};
use crate::numbers::median;

/// Difference of a logged corrected field from the corrected raw field, body axes, microtesla.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CorrectionResidual {
    /// Number of simultaneous rows.
    pub row_count: usize,
    /// Median difference, by axis.
    pub constant_ut: Vector3<f64>,
    /// Median distance from the median difference.
    pub scatter_ut: f64,
    /// Corrected offset of the parameters: what a constant difference is, if offsets are not applied as the reader
    /// expects.
    pub offset_ut: Vector3<f64>,
}

impl CorrectionResidual {
    /// Compares simultaneous rows from a time on; none without any. The raw field is in body axes.
    pub(super) fn new(
        raw: &Series<3>,
        corrected: &Series<6>,
        correction: &FieldCorrection,
        current: &Series<1>,
        from_s: f64,
    ) -> Option<Self> {
        /// Longest interval of corrected rows that is interpolated, seconds.
        const MAX_GAP_S: f64 = 0.15;
        let difference = |row: &TimedRow<3>| {
            let [x, y, z, ..] = corrected.interpolate(row.t_s, MAX_GAP_S)?.map(f64::from);
            let current_a = current.interpolate_or_hold(row.t_s, 2.0).map_or(0.0, |[amperes]| f64::from(amperes));
            Some(Vector3::new(x, y, z) - correction.correct_field(row.row_values.map(f64::from).into(), current_a))
        };
        let rows = raw.rows().iter().filter(|row| row.t_s >= from_s);
        let differences: Vec<Vector3<f64>> = rows.filter_map(difference).collect();
        let constant_ut = Vector3::from_fn(|axis, _| median(differences.iter().map(|difference| difference[axis])));
        let scatter_ut = median(differences.iter().map(|difference| (difference - constant_ut).norm()));
        let offset_ut = correction.matrix * correction.hard_iron_ut;
        (!differences.is_empty()).then_some(Self { row_count: differences.len(), constant_ut, scatter_ut, offset_ut })
    }

    /// Whether the constant difference is that of offsets with another sign, or of none.
    pub fn is_of_offsets(&self) -> bool {
        let is_like =
            |multiple: f64| (self.constant_ut - self.offset_ut * multiple).norm() < 0.5 * self.constant_ut.norm();
        is_like(1.0) || is_like(2.0)
    }
}
