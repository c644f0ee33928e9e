//! The Cramer-Rao bound: how well anybody could know the heading after a flight.
//!
//! Computed from the true parameters. Each instant has three unknowns of its own - heading, roll and pitch - and five
//! measurements: three of the field, two of the attitude. With `J_g` the derivatives of the measurements by the
//! thirteen common unknowns (`A`, `b`, inclination; the total field is the unit), `J_l` those by the instant's own, and
//! all measurements divided by their sigma, its information on the common ones is
//! `J_g^T J_g - J_g^T J_l (J_l^T J_l)^-1 J_l^T J_g`. Nothing is assumed of the airframe.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::trial::{Instant, Trial};
use crate::world::rotation::Euler;

/// Information on the common unknowns.
pub type Matrix13 = SMatrix<f64, 13, 13>;

/// A reading, all that it says about the common unknowns: rows whose squares are its information.
pub type Rows = SMatrix<f64, 2, 13>;

/// RMS heading error over the envelope that no unbiased estimator can fall below, degrees; `None` when the flight does
/// not determine the thirteen unknowns at all.
#[must_use]
pub fn rms_deg(trial: &Trial) -> Option<f64> {
    rms_deg_of(trial, trial.instants())
}

/// The same of some of its instants.
#[must_use]
pub fn rms_deg_of<'a>(trial: &Trial, instants: impl Iterator<Item = &'a Instant>) -> Option<f64> {
    let information: Matrix13 = instants.map(|instant| information(trial, instant)).sum();
    let covariance = information.cholesky()?.inverse();
    let w = trial.a.try_inverse()?;
    let (sum, number) = trial.envelope.attitudes().fold((0.0, 0.0), |(sum, number), euler| {
        let row = heading_row(trial, &w, euler);
        (sum + row.dot(&(covariance * row)), number + 1.0)
    });
    Some((sum / number).sqrt().to_degrees())
}

/// What an instant says about the common unknowns.
fn information(trial: &Trial, instant: &Instant) -> Matrix13 {
    let (common, own) = equations(trial, instant);
    let projected = own.tr_mul(&common);
    // The attitude's rows give roll and pitch information of their own, the field's give heading: never singular, but
    // at a magnetic pole.
    let nuisance = (own.tr_mul(&own)).try_inverse().unwrap_or_else(Matrix3::zeros);
    common.tr_mul(&common) - projected.tr_mul(&(nuisance * projected))
}

/// The same as rows: of its five equations the two combinations that its own unknowns do not touch.
#[must_use]
pub fn rows(trial: &Trial, instant: &Instant) -> Rows {
    let (common, own) = equations(trial, instant);
    let nuisance = (own.tr_mul(&own)).try_inverse().unwrap_or_else(Matrix3::zeros);
    let untouched = SMatrix::<f64, 5, 5>::identity() - own * nuisance * own.transpose();
    // A projection on two dimensions: two of its eigenvalues are one, the others nothing.
    let eigen = untouched.symmetric_eigen();
    let mut order = [0, 1, 2, 3, 4];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let kept = SMatrix::<f64, 5, 2>::from_fn(|row, column| eigen.eigenvectors[(row, order[column])]);
    kept.tr_mul(&common)
}

/// Derivatives of an instant's measurements by the common unknowns and by its own, over their sigmas.
fn equations(trial: &Trial, instant: &Instant) -> (SMatrix<f64, 5, 13>, SMatrix<f64, 5, 3>) {
    let euler = instant.euler;
    let body = trial.body(euler);
    let mut common = SMatrix::<f64, 5, 13>::zeros();
    for i in 0..3 {
        for j in 0..3 {
            common[(i, 3 * i + j)] = body[j];
        }
        common[(i, 9 + i)] = 1.0;
    }
    // Central differences of a smooth function of three angles: 1e-5 leaves an error of 1e-10.
    let by = |change: &dyn Fn(f64) -> Vector3<f64>| (change(1e-5) - change(-1e-5)) / 2e-5;
    let by_dip = by(&|step| trial.a * euler.field(1.0, trial.inclination_rad + step));
    common.fixed_view_mut::<3, 1>(0, 12).copy_from(&by_dip);
    let mut own = SMatrix::<f64, 5, 3>::zeros();
    for (column, derivative) in [
        by(&|step| trial.a * trial.body(Euler { heading_rad: euler.heading_rad + step, ..euler })),
        by(&|step| trial.a * trial.body(Euler { roll_rad: euler.roll_rad + step, ..euler })),
        by(&|step| trial.a * trial.body(Euler { pitch_rad: euler.pitch_rad + step, ..euler })),
    ]
    .iter()
    .enumerate()
    {
        own.fixed_view_mut::<3, 1>(0, column).copy_from(derivative);
    }
    own[(3, 1)] = 1.0;
    own[(4, 2)] = 1.0;
    let sigmas = [trial.sensor_sigma; 3].into_iter().chain([trial.attitude_sigma_rad(instant); 2]);
    for (row, sigma) in sigmas.enumerate() {
        common.row_mut(row).unscale_mut(sigma);
        own.row_mut(row).unscale_mut(sigma);
    }
    (common, own)
}

/// Derivative of the indicated heading by the common unknowns. The field found is `W (m - b)`, so that an error of `A`
/// and `b` moves it by `-W (dA h + db)`.
fn heading_row(trial: &Trial, w: &Matrix3<f64>, euler: Euler) -> SVector<f64, 13> {
    let body = trial.body(euler);
    let to_level = euler.body_from_level().transpose();
    let level = to_level * body;
    let horizontal = level.x * level.x + level.y * level.y;
    let gradient = (to_level.row(0) * level.y - to_level.row(1) * level.x).transpose() / horizontal;
    let by_field = -w.tr_mul(&gradient);
    let mut row = SVector::zeros();
    for i in 0..3 {
        for j in 0..3 {
            row[3 * i + j] = by_field[i] * body[j];
        }
        row[9 + i] = by_field[i];
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::trial::Ranges;

    /// The rows are the information's root: their squares are it, to rounding.
    #[test]
    fn rows_are_the_root_of_the_information() {
        for seed in 0..5 {
            let trial = Trial::draw(&Ranges::HARSH, seed);
            for instant in trial.instants().step_by(40) {
                let (whole, root) = (information(&trial, instant), rows(&trial, instant));
                let difference = root.tr_mul(&root) - whole;
                assert!(difference.norm() < 1e-6 * whole.norm(), "seed {seed}: {}", difference.norm() / whole.norm());
            }
        }
    }

    /// What is measured while it is pushed about says less.
    #[test]
    fn a_flight_that_is_pushed_about_is_known_less() {
        let trial = Trial::draw(&Ranges::HARSH, 7);
        let pushed: Vec<Instant> = trial.instants().map(|instant| Instant { push_m_s2: 5.0, ..*instant }).collect();
        let [calm, pushed] = [rms_deg(&trial).unwrap(), rms_deg_of(&trial, pushed.iter()).unwrap()];
        // 2 deg on top of 0.2 to 1 deg.
        assert!(pushed > 1.5 * calm, "{pushed} {calm}");
    }

    /// Twice as many readings halve the variance.
    #[test]
    fn a_flight_flown_twice_is_known_better_by_the_root_of_two() {
        let trial = Trial::draw(&Ranges::HARSH, 7);
        let once = rms_deg(&trial).unwrap();
        let twice = rms_deg_of(&trial, trial.instants().chain(trial.instants())).unwrap();
        assert!((once / twice - 2_f64.sqrt()).abs() < 1e-9, "{once} {twice}");
    }
}
