//! Exports the module's solution as autopilot parameters: orientation, then a symmetric matrix.

mod exported_correction;
pub(super) mod orientation;
mod parameter_file;
mod parameter_format;
mod symmetric_fit;

pub use exported_correction::ExportedCorrection;
pub(super) use exported_correction::HeldBackScore;
pub(super) use parameter_file::{file_values, may_compensate_current};
pub use parameter_file::{format_parameter_file, parse_parameter_file};
pub use parameter_format::{CorrectedTerms, ParameterFormat};

use autoswing::calibration::Calibration;
use nalgebra::{Matrix3, SVD, Vector3};

use self::orientation::{ExportedOrientation, FixedOrientation, OrientationKind, OrientationParameters, TurnedSensor};
use self::symmetric_fit::SymmetricFit;
use crate::log::{FieldCorrection, LoggedFlight};
use crate::numbers::{mean, rms};
use crate::replay::row::{ReplayRow, heading_deg};
use crate::replay::row_solve::calibrated_correction;
use crate::score::{GOOD_COMPASS_RMS_DEG, wrap_180};

/// Inputs that all exports of a compass share.
#[derive(Clone, Copy)]
pub(super) struct ExportInputs<'a> {
    pub compass_number: u8,
    /// Rows that the parameters are for.
    pub rows: &'a [ReplayRow],
    /// The Earth's field strength, microtesla, if known.
    pub total_ut: Option<f64>,
    pub format: ParameterFormat,
    pub orientation: Result<OrientationParameters, FixedOrientation>,
    pub terms: CorrectedTerms,
}

impl ExportInputs<'_> {
    /// Exports a calibration with the simplest orientation that loses no more than the error of a good compass, else with
    /// that which loses least.
    pub fn export_simplest(&self, calibration: &Calibration) -> Option<(OrientationKind, ExportedCorrection)> {
        let mut best: Option<(OrientationKind, ExportedCorrection)> = None;
        let kinds: &[OrientationKind] = match self.terms {
            CorrectedTerms::All => &[OrientationKind::Unchanged, OrientationKind::Numbered, OrientationKind::Custom],
            CorrectedTerms::Offsets | CorrectedTerms::Scale => &[OrientationKind::Unchanged],
        };
        for &kind in kinds {
            let Some(export) = self.export_correction(calibration, kind) else { continue };
            if best.as_ref().is_none_or(|(_, best)| export.total_loss_deg() < best.total_loss_deg()) {
                best = Some((kind, export));
            }
            if best.as_ref().is_some_and(|(_, best)| best.total_loss_deg() <= GOOD_COMPASS_RMS_DEG) {
                break;
            }
        }
        best
    }

    /// The rotation that an export loses, if it loses more than the simplest orientation may.
    pub fn lost_rotation(
        &self,
        calibration: &Calibration,
        kind: OrientationKind,
        export: &ExportedCorrection,
    ) -> Option<TurnedSensor> {
        let is_small = export.total_loss_deg() <= GOOD_COMPASS_RMS_DEG;
        if is_small || kind == OrientationKind::Custom || self.terms != CorrectedTerms::All {
            return None;
        }
        let reason = self.orientation.and_then(|parameters| parameters.custom_rotation).err()?;
        let (rotation_from_logged, _) = polar_decomposition(&calibration.w_matrix().map(f64::from))?;
        Some(TurnedSensor { rotation_from_logged, reason })
    }

    /// Exports a calibration with an orientation of a kind; none if the parameters cannot express it.
    pub fn export_correction(&self, calibration: &Calibration, kind: OrientationKind) -> Option<ExportedCorrection> {
        let Self { compass_number, rows, total_ut, format, terms, .. } = *self;
        let full_correction = calibrated_correction(calibration);
        let FieldCorrection { hard_iron_ut, motor_ut_per_a, .. } = full_correction;
        let (rotation, symmetric) = polar_decomposition(&full_correction.matrix)?;
        let orientation = ExportedOrientation::nearest(kind, &rotation, self.orientation, format)?;
        let mounting = orientation.rotation_from_logged;
        let scale = total_ut.map_or(1.0, |total_ut| total_ut / f64::from(calibration.total_ut));
        // INAV has no current compensation; the mean interference goes into the offsets.
        let is_compensated = format != ParameterFormat::Inav && terms == CorrectedTerms::All;
        let offset_current_a = if is_compensated { 0.0 } else { f64::from(calibration.motor_current.mean_current_a) };
        let matrix = mounting * symmetric * mounting.transpose() * scale;
        let unknown_count = terms.unknown_count(format);
        let initial_correction = FieldCorrection {
            matrix: match unknown_count {
                3 => Matrix3::identity() * (matrix.trace() / 3.0),
                6 => Matrix3::from_diagonal(&matrix.diagonal()),
                _ => matrix,
            },
            hard_iron_ut: mounting * (hard_iron_ut + motor_ut_per_a * offset_current_a),
            motor_ut_per_a: if is_compensated { mounting * motor_ut_per_a } else { Vector3::zeros() },
        };
        let symmetric_fit = SymmetricFit { rows, mounting, calibration, full_correction, unknown_count };
        let nearest = symmetric_fit.nearest_correction(initial_correction);
        // A half turn is a symmetric matrix, too, but not a positive one, which corrects no field.
        let mut correction = if nearest.matrix.cholesky().is_some() { nearest } else { initial_correction };
        if terms == CorrectedTerms::Offsets {
            correction.matrix = Matrix3::identity();
        }
        Some(ExportedCorrection {
            compass_number,
            correction,
            orientation,
            heading_loss_deg: heading_loss_deg_of(rows, &mounting, &full_correction, &correction),
            fitted_range_s: None,
            held_back_score: None,
            rms_by_terms_deg: None,
            warnings: warnings(calibration, &orientation, format),
        })
    }
}

fn warnings(calibration: &Calibration, orientation: &ExportedOrientation, format: ParameterFormat) -> Vec<String> {
    let mut warnings = Vec::new();
    if format == ParameterFormat::Inav && calibration.motor_current.is_applied() {
        warnings.push("motor-current interference cannot be expressed".to_owned());
    }
    let is_turned = orientation.rotation_from_logged != Matrix3::identity();
    let words = orientation::rotation_words(&orientation.rotation_from_logged);
    if is_turned && orientation.parameters.is_some() {
        warnings
            .push(format!("the sensor is turned by {words} against its orientation, which these parameters correct"));
    } else if is_turned {
        warnings.push(format!("the sensor is turned by {words} against the log's orientation: check align_mag"));
    }
    warnings
}

/// The field of a row, microtesla, as the autopilot corrects it by exported parameters: with the digits of the file.
pub fn field_by_exported_parameters(
    flight: &LoggedFlight,
    export: &ExportedCorrection,
    format: ParameterFormat,
) -> impl Fn(&ReplayRow) -> Vector3<f64> + use<> {
    let (rotation, correction) = parameter_file::correction_by_file(flight, export, format);
    // The orientation parameter turns the field to body axes first, so that the heading is that of the body.
    move |row| row.in_rotated_axes(&rotation).corrected_field(&correction)
}

fn polar_decomposition(matrix: &Matrix3<f64>) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
    let SVD { u, v_t, singular_values } = SVD::new(*matrix, true, true);
    let (u, v_t) = (u?, v_t?);
    let turn = u * v_t;
    let symmetric = v_t.transpose() * Matrix3::from_diagonal(&singular_values) * v_t;
    (turn.determinant() > 0.0).then_some((turn, symmetric))
}

/// Heading difference of a full correction and of one after a mounting, over usable rows, degrees: RMS less mean, and mean.
fn heading_loss_deg_of(
    rows: &[ReplayRow],
    mounting: &Matrix3<f64>,
    full_correction: &FieldCorrection,
    exported: &FieldCorrection,
) -> [f64; 2] {
    let usable = rows.iter().filter(|row| row.is_usable);
    let differences: Vec<f64> = usable
        .map(|row| {
            let exported_deg = heading_deg(row, row.in_rotated_axes(mounting).corrected_field(exported));
            wrap_180(exported_deg - heading_deg(row, row.corrected_field(full_correction)))
        })
        .collect();
    let mean_deg = mean(differences.iter().copied());
    [rms(differences.iter().map(|difference| difference - mean_deg)), mean_deg]
}

#[cfg(test)]
mod tests {
    use autoswing::frames::Field;
    use nalgebra::Rotation3;

    use super::*;
    use crate::log::symmetric_matrix;
    use crate::replay::tests::{LEVEL_ROW_FIELD_UT, level_row};

    #[test]
    fn a_mirrored_matrix_has_no_rotation() {
        let turn = Rotation3::from_euler_angles(0.1, -0.2, 0.3);
        let symmetric = symmetric_matrix(&Vector3::new(1.1, 0.9, 1.0), &Vector3::new(0.1, 0.0, -0.05));
        let (rotation, remainder) = polar_decomposition(&(turn.matrix() * symmetric)).unwrap();
        assert!(
            (rotation - turn.matrix()).norm() < 1e-9 && (remainder - symmetric).norm() < 1e-9,
            "{rotation} {remainder}"
        );
        assert!(polar_decomposition(&-symmetric).is_none());
    }

    /// A rotation of the field by 3 deg to the right lowers all headings by 3 deg. Hard iron `b` bends level headings by
    /// `b / H sin(heading)`, RMS `b / H / sqrt 2`.
    #[test]
    fn the_heading_loss_is_an_rms_about_a_mean() {
        let mut rows: Vec<ReplayRow> = (0..36).map(|i| level_row(f64::from(i), f64::from(i) * 10.0)).collect();
        rows.push(ReplayRow { is_usable: false, raw_field: Field::from_ut(-9.0, 30.0, 0.0), ..rows[3] });
        let rotated = FieldCorrection {
            matrix: Rotation3::from_axis_angle(&Vector3::z_axis(), f64::to_radians(3.0)).into_inner(),
            hard_iron_ut: Vector3::new(0.25, 0.0, 0.0),
            ..FieldCorrection::identity()
        };
        let [rms_deg, mean_deg] =
            heading_loss_deg_of(&rows, &Matrix3::identity(), &FieldCorrection::identity(), &rotated);
        let expected_rms_deg = (0.25 / LEVEL_ROW_FIELD_UT[0] / 2_f64.sqrt()).to_degrees();
        assert!((rms_deg / expected_rms_deg - 1.0).abs() < 0.01, "{rms_deg} {expected_rms_deg}");
        assert!((mean_deg + 3.0).abs() < 0.01, "{mean_deg}");
    }
}
