//! Cramér-Rao bound of the heading error after a calibration flight.
//!
//! Each sample has three nuisance parameters (heading, roll, pitch) and five measurements (three field components,
//! roll, pitch). The thirteen common parameters are `A`, `b` and inclination; the total field is the unit. With `J_g`
//! and `J_l` the Jacobians by common and nuisance parameters, in units of the measurement sigmas, the Fisher
//! information of a sample is `J_g^T J_g - J_g^T J_l (J_l^T J_l)^-1 J_l^T J_g`. No prior on the airframe is used.
//! Evaluated at the true parameters.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use simulator::world::rotation::Euler;

use super::random_flight::{RandomFlight, TrueSample};

/// Fisher information of the common parameters.
pub type FisherInformation = SMatrix<f64, 13, 13>;

/// Square root of a sample's Fisher information: `R^T R` is the information.
pub type InformationRoot = SMatrix<f64, 2, 13>;

/// Cramér-Rao bound of the RMS heading error over the envelope, degrees; `None` if the common parameters are
/// unobservable.
#[must_use]
pub fn bound_rms_deg(trial: &RandomFlight) -> Option<f64> {
    bound_deg_of_samples(trial, trial.true_samples())
}

/// Cramér-Rao bound of the heading error from these samples, degrees RMS.
#[must_use]
pub fn bound_deg_of_samples<'a>(
    trial: &RandomFlight,
    true_samples: impl Iterator<Item = &'a TrueSample>,
) -> Option<f64> {
    let information: FisherInformation = true_samples.map(|true_sample| fisher_information(trial, true_sample)).sum();
    let covariance = information.cholesky()?.inverse();
    let correction_matrix = trial.field_matrix.try_inverse()?;
    let (square_sum, heading_count) =
        trial.envelope.attitudes().fold((0.0, 0.0), |(square_sum, heading_count), euler| {
            let row = heading_gradient(trial, &correction_matrix, euler);
            (square_sum + row.dot(&(covariance * row)), heading_count + 1.0)
        });
    Some((square_sum / heading_count).sqrt().to_degrees())
}

/// Fisher information of a sample about the common parameters.
fn fisher_information(trial: &RandomFlight, true_sample: &TrueSample) -> FisherInformation {
    let (common, nuisance_rows) = measurement_jacobians(trial, true_sample);
    let projected = nuisance_rows.tr_mul(&common);
    // Regular except at a magnetic pole: attitude measurements determine roll and pitch, the field determines heading.
    let nuisance = (nuisance_rows.tr_mul(&nuisance_rows)).try_inverse().unwrap_or_else(Matrix3::zeros);
    common.tr_mul(&common) - projected.tr_mul(&(nuisance * projected))
}

/// Jacobian rows of the two combinations of measurements that are independent of the nuisance parameters.
#[must_use]
pub fn information_root(trial: &RandomFlight, true_sample: &TrueSample) -> InformationRoot {
    let (common, nuisance_rows) = measurement_jacobians(trial, true_sample);
    let nuisance = (nuisance_rows.tr_mul(&nuisance_rows)).try_inverse().unwrap_or_else(Matrix3::zeros);
    let projection = SMatrix::<f64, 5, 5>::identity() - nuisance_rows * nuisance * nuisance_rows.transpose();
    // The projection has rank two: two eigenvalues are one, the others zero.
    let eigen = projection.symmetric_eigen();
    let mut order = [0, 1, 2, 3, 4];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let dominant_directions = SMatrix::<f64, 5, 2>::from_fn(|row, column| eigen.eigenvectors[(row, order[column])]);
    dominant_directions.tr_mul(&common)
}

/// Jacobians of a sample's measurements by common and nuisance parameters, in units of the measurement sigmas.
fn measurement_jacobians(trial: &RandomFlight, true_sample: &TrueSample) -> (SMatrix<f64, 5, 13>, SMatrix<f64, 5, 3>) {
    let euler = true_sample.euler;
    let body_field = trial.body_field(euler);
    let mut common = SMatrix::<f64, 5, 13>::zeros();
    for i in 0..3 {
        for column_index in 0..3 {
            common[(i, 3 * i + column_index)] = body_field[column_index];
        }
        common[(i, 9 + i)] = 1.0;
    }
    // Central differences with a step of 1e-5 have an error of about 1e-10.
    let numerical_derivative = |change: &dyn Fn(f64) -> Vector3<f64>| (change(1e-5) - change(-1e-5)) / 2e-5;
    let field_by_inclination =
        numerical_derivative(&|step| trial.field_matrix * euler.body_field(1.0, trial.inclination_rad + step));
    common.fixed_view_mut::<3, 1>(0, 12).copy_from(&field_by_inclination);
    let mut nuisance_rows = SMatrix::<f64, 5, 3>::zeros();
    for (column, derivative) in [
        numerical_derivative(&|step| {
            trial.field_matrix * trial.body_field(Euler { heading_rad: euler.heading_rad + step, ..euler })
        }),
        numerical_derivative(&|step| {
            trial.field_matrix * trial.body_field(Euler { roll_rad: euler.roll_rad + step, ..euler })
        }),
        numerical_derivative(&|step| {
            trial.field_matrix * trial.body_field(Euler { pitch_rad: euler.pitch_rad + step, ..euler })
        }),
    ]
    .iter()
    .enumerate()
    {
        nuisance_rows.fixed_view_mut::<3, 1>(0, column).copy_from(derivative);
    }
    nuisance_rows[(3, 1)] = 1.0;
    nuisance_rows[(4, 2)] = 1.0;
    let sigmas = [trial.relative_sensor_sigma; 3].into_iter().chain([trial.attitude_sigma_rad(true_sample); 2]);
    for (row, sigma) in sigmas.enumerate() {
        common.row_mut(row).unscale_mut(sigma);
        nuisance_rows.row_mut(row).unscale_mut(sigma);
    }
    (common, nuisance_rows)
}

/// Derivative of the indicated heading by the common parameters. The corrected field is `W (m - b)`, so errors `dA` and
/// `db` change it by `-W (dA h + db)`.
fn heading_gradient(trial: &RandomFlight, correction_matrix: &Matrix3<f64>, euler: Euler) -> SVector<f64, 13> {
    let body_field = trial.body_field(euler);
    let to_level = euler.body_from_level().transpose();
    let level_field = to_level * body_field;
    let horizontal = level_field.x * level_field.x + level_field.y * level_field.y;
    let gradient = (to_level.row(0) * level_field.y - to_level.row(1) * level_field.x).transpose() / horizontal;
    let heading_by_field = -correction_matrix.tr_mul(&gradient);
    let mut row = SVector::zeros();
    for i in 0..3 {
        for column_index in 0..3 {
            row[3 * i + column_index] = heading_by_field[i] * body_field[column_index];
        }
        row[9 + i] = heading_by_field[i];
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::accuracy::random_flight::RandomRanges;

    #[test]
    fn information_root_squares_to_the_information() {
        for seed in 0..5 {
            let trial = RandomFlight::draw_flight(&RandomRanges::WORST_CASE, seed);
            for true_sample in trial.true_samples().step_by(40) {
                let (information, root) =
                    (fisher_information(&trial, true_sample), information_root(&trial, true_sample));
                let difference = root.tr_mul(&root) - information;
                assert!(
                    difference.norm() < 1e-6 * information.norm(),
                    "seed {seed}: {}",
                    difference.norm() / information.norm()
                );
            }
        }
    }

    #[test]
    fn disturbing_acceleration_raises_the_cramer_rao_bound() {
        let trial = RandomFlight::draw_flight(&RandomRanges::WORST_CASE, 7);
        let turbulent: Vec<TrueSample> = trial
            .true_samples()
            .map(|true_sample| TrueSample { disturbing_acceleration_m_s2: 5.0, ..*true_sample })
            .collect();
        let [calm, turbulent] =
            [bound_rms_deg(&trial).unwrap(), bound_deg_of_samples(&trial, turbulent.iter()).unwrap()];
        // The acceleration adds 2 deg of tilt error to 0.2 to 1 deg of noise.
        assert!(turbulent > 1.5 * calm, "{turbulent} {calm}");
    }

    #[test]
    fn a_flight_flown_twice_is_known_better_by_the_root_of_two() {
        let trial = RandomFlight::draw_flight(&RandomRanges::WORST_CASE, 7);
        let bound_deg = bound_rms_deg(&trial).unwrap();
        let twice = bound_deg_of_samples(&trial, trial.true_samples().chain(trial.true_samples())).unwrap();
        assert!((bound_deg / twice - 2_f64.sqrt()).abs() < 1e-9, "{bound_deg} {twice}");
    }
}
