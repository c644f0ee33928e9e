//! Fits the symmetric (or diagonal) matrix and the offsets that an autopilot can express to a full correction.

use autoswing::calibration::Calibration;
use autoswing::frames::{Field, Level, RollPitch};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use crate::log::{FieldCorrection, symmetric_matrix};
use crate::numbers::{square, thinned};
use crate::replay::row::{ReplayRow, heading_deg};
use crate::score::wrap_180;

const MAX_GAUSS_NEWTON_STEPS: usize = 20;
const MAX_HALVINGS: usize = 6;
const MAX_ROWS: usize = 1000;

/// Regularisation of unobservable parameters: change of a matrix element, and of an offset in microtesla, equivalent to
/// 1 deg in one row.
const REGULARISATION_SIGMAS: [f64; 2] = [0.3, 30.0];

/// Banks of normal flight, degrees. The attitudes of normal flight together have the weight of the flown rows: a flight
/// in level turns alone leaves a scale and an offset along z that cancel each other there, and nowhere else.
const BANKS_DEG: [f32; 7] = [-45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0];
/// Pitches of normal flight, degrees.
const PITCHES_DEG: [f32; 3] = [-15.0, 0.0, 15.0];
const HEADING_COUNT: usize = 12;

/// Row with its field in mount axes, its heading by the full correction, degrees, and the square root of its weight.
struct FittedRow {
    row: ReplayRow,
    heading_deg: f64,
    root_weight: f64,
}

/// Fit of an autopilot's correction to a full one.
pub struct SymmetricFit<'a> {
    /// Rows flown.
    pub rows: &'a [ReplayRow],
    /// Rotation by the mounting.
    pub mounting: Matrix3<f64>,
    /// The solved calibration.
    pub calibration: &'a Calibration,
    /// The correction by all coefficients of the calibration, which a symmetric matrix cannot express.
    pub full_correction: FieldCorrection,
    /// Number of unknowns: offsets, diagonal, further elements of the matrix; the others are as in the initial correction.
    pub unknown_count: usize,
}

impl SymmetricFit<'_> {
    /// Matrix and offsets whose headings over usable rows and over [`BANKS_DEG`] are nearest to the full correction's,
    /// by Gauss-Newton with step halving from `initial`. Keeps the field strength.
    pub fn nearest_correction(&self, initial: FieldCorrection) -> FieldCorrection {
        let fitted = self.fitted_rows();
        let unknown_count = self.unknown_count;
        let initial_parts = correction_parts(&initial);
        let built = |p: &DVector<f64>| {
            let [hard_iron_ut, diagonal, off_diagonal] = std::array::from_fn(|part| {
                Vector3::from_fn(|axis, _| p.get(3 * part + axis).copied().unwrap_or(initial_parts[part][axis]))
            });
            FieldCorrection { matrix: symmetric_matrix(&diagonal, &off_diagonal), hard_iron_ut, ..initial }
        };
        let start = DVector::from_iterator(unknown_count, initial_parts.iter().flatten().copied().take(unknown_count));
        let residuals = |p: &DVector<f64>| {
            let correction = built(p);
            let residual = |fitted: &FittedRow| {
                wrap_180(heading_deg(&fitted.row, fitted.row.corrected_field(&correction)) - fitted.heading_deg)
                    * fitted.root_weight
            };
            DVector::from_iterator(fitted.len(), fitted.iter().map(residual))
        };
        let mut best_correction = (start.clone(), residuals(&start).norm_squared());
        for _ in 0..MAX_GAUSS_NEWTON_STEPS {
            let from = residuals(&best_correction.0);
            let mut jacobian = DMatrix::zeros(fitted.len(), unknown_count);
            for i in 0..unknown_count {
                let step = if i < 3 { 0.01 } else { 1e-4 };
                let mut stepped = best_correction.0.clone();
                stepped[i] += step;
                jacobian.set_column(i, &((residuals(&stepped) - &from).map(wrap_180) / step));
            }
            let mut normal = jacobian.transpose() * &jacobian;
            let mut right_side = -(jacobian.transpose() * from);
            for i in 0..unknown_count {
                let weight = square(REGULARISATION_SIGMAS[usize::from(i < 3)]).recip();
                normal[(i, i)] += weight;
                right_side[i] += weight * (start[i] - best_correction.0[i]);
            }
            let Some(cholesky) = normal.cholesky() else { break };
            let step = cholesky.solve(&right_side);
            // Far from the minimum, where headings are not linear in the parameters, a full step can lead uphill.
            let shorter = std::iter::successors(Some(1.0), |scale| Some(0.5 * scale)).take(MAX_HALVINGS);
            let mut candidates = shorter
                .map(|scale| &best_correction.0 + &step * scale)
                .map(|candidate| (residuals(&candidate).norm_squared(), candidate));
            let Some((squares, candidate)) = candidates.find(|(squares, _)| *squares < best_correction.1) else {
                break;
            };
            best_correction = (candidate, squares);
        }
        let fitted_correction = built(&best_correction.0);
        // Headings do not observe the scale.
        let total = |correction: &FieldCorrection| -> f64 {
            fitted.iter().map(|fitted| fitted.row.corrected_field(correction).norm() * square(fitted.root_weight)).sum()
        };
        let size = total(&initial) / total(&fitted_correction);
        if size.is_finite() && size > 0.0 {
            FieldCorrection { matrix: fitted_correction.matrix * size, ..fitted_correction }
        } else {
            initial
        }
    }

    fn fitted_rows(&self) -> Vec<FittedRow> {
        let usable: Vec<&ReplayRow> = self.rows.iter().filter(|row| row.is_usable).collect();
        let fitted_row = |row: &ReplayRow| FittedRow {
            row: row.in_rotated_axes(&self.mounting),
            heading_deg: heading_deg(row, row.corrected_field(&self.full_correction)),
            root_weight: 1.0,
        };
        let mut fitted: Vec<FittedRow> = thinned(&usable, MAX_ROWS).into_iter().map(fitted_row).collect();
        let normal_flight_rows = self.rows_of_normal_flight();
        let root_weight = (fitted.len() as f64 / normal_flight_rows.len().max(1) as f64).sqrt();
        fitted.extend(
            normal_flight_rows.into_iter().map(|normal_flight_row| FittedRow { root_weight, ..normal_flight_row }),
        );
        fitted
    }

    /// Rows that the full correction predicts for all headings at [`BANKS_DEG`] and [`PITCHES_DEG`]; none if it has no
    /// inverse.
    fn rows_of_normal_flight(&self) -> Vec<FittedRow> {
        let Some(inverse) = self.full_correction.matrix.try_inverse() else { return Vec::new() };
        let Calibration { total_ut, inclination_rad, motor_current, .. } = self.calibration;
        let current_a = motor_current.mean_current_a;
        let constant_ut =
            self.full_correction.hard_iron_ut + self.full_correction.motor_ut_per_a * f64::from(current_a);
        let mut rows = Vec::new();
        for bank_deg in BANKS_DEG {
            for pitch_deg in PITCHES_DEG {
                for heading_index in 0..HEADING_COUNT {
                    let heading_deg = heading_index as f32 * (360.0 / HEADING_COUNT as f32);
                    let attitude = RollPitch::from_deg(bank_deg, pitch_deg);
                    let level_field =
                        Field::<Level>::earth_field(*total_ut, *inclination_rad, heading_deg.to_radians());
                    let field = inverse * attitude.to_body_frame(level_field).ut.map(f64::from) + constant_ut;
                    let field = Field::new((self.mounting * field).map(|axis| axis as f32));
                    let row = ReplayRow { current_a: Some(current_a), ..ReplayRow::of_field(0.0, field, attitude) };
                    rows.push(FittedRow { row, heading_deg: f64::from(heading_deg), root_weight: 1.0 });
                }
            }
        }
        rows
    }
}

/// Offsets, diagonal, and elements xy, xz and yz.
pub fn correction_parts(correction: &FieldCorrection) -> [Vector3<f64>; 3] {
    let matrix = &correction.matrix;
    [correction.hard_iron_ut, matrix.diagonal(), Vector3::new(matrix[(0, 1)], matrix[(0, 2)], matrix[(1, 2)])]
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;
    use crate::replay::tests::compass_of_flown_turns;

    /// A correction that a sensor at a known mounting and a symmetric matrix express exactly is found from the identity,
    /// whatever is fixed of it: Gauss-Newton on residuals that vanish. Headings are `f32`: 3e-5 deg.
    #[test]
    fn a_correction_that_the_autopilot_can_express_is_found_exactly() {
        let (_, compass) = compass_of_flown_turns();
        let mut calibration = compass.parameter_fit.solution().unwrap().calibration;
        calibration.motor_current.mean_current_a = 12.0;
        let mounting = *Rotation3::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2).matrix();
        for (unknown_count, diagonal, off_diagonal_entries) in
            [(9, [1.08, 0.93, 1.02], [0.04, -0.03, 0.06]), (6, [1.08, 0.93, 1.02], [0.0; 3]), (3, [1.0; 3], [0.0; 3])]
        {
            let autopilot = FieldCorrection {
                matrix: symmetric_matrix(&diagonal.into(), &off_diagonal_entries.into()),
                hard_iron_ut: Vector3::new(4.0, -6.0, 9.0),
                motor_ut_per_a: Vector3::new(0.1, -0.2, 0.3),
            };
            let full_correction = FieldCorrection {
                matrix: autopilot.matrix * mounting,
                hard_iron_ut: mounting.transpose() * autopilot.hard_iron_ut,
                motor_ut_per_a: mounting.transpose() * autopilot.motor_ut_per_a,
            };
            let inverse = full_correction.matrix.try_inverse().unwrap();
            let row_of = |(i, row): (usize, &ReplayRow)| {
                let current_a = 5.0 + (i % 7) as f32;
                let level_field =
                    Field::<Level>::earth_field(calibration.total_ut, calibration.inclination_rad, 0.01 * i as f32);
                let raw = inverse * row.attitude.to_body_frame(level_field).ut.map(f64::from)
                    + full_correction.hard_iron_ut
                    + full_correction.motor_ut_per_a * f64::from(current_a);
                let raw_field = Field::new(raw.map(|axis| axis as f32));
                ReplayRow { raw_field, current_a: Some(current_a), ..*row }
            };
            let rows: Vec<ReplayRow> = compass.rows.iter().enumerate().map(row_of).collect();
            let fit = SymmetricFit { rows: &rows, mounting, calibration: &calibration, full_correction, unknown_count };
            let initial = FieldCorrection { motor_ut_per_a: autopilot.motor_ut_per_a, ..FieldCorrection::identity() };
            let found = fit.nearest_correction(initial);
            // Headings do not observe the scale.
            let matrix = found.matrix * (autopilot.matrix.trace() / found.matrix.trace());
            assert!((matrix - autopilot.matrix).amax() < 1e-4, "{unknown_count}: {matrix}");
            assert!((found.hard_iron_ut - autopilot.hard_iron_ut).amax() < 0.01, "{unknown_count}: {found:?}");
            let strength_ut = |correction: &FieldCorrection| {
                let normal_rows = fit.rows_of_normal_flight().into_iter().map(|fitted| fitted.row);
                let rows = normal_rows.chain(rows.iter().map(|row| row.in_rotated_axes(&mounting)));
                rows.map(|row| row.corrected_field(correction).norm()).sum::<f64>()
            };
            assert!((strength_ut(&found) / strength_ut(&initial) - 1.0).abs() < 0.01, "{unknown_count}: {found:?}");
        }
    }
}
