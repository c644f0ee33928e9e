//! Baseline calibrations of the same rows: sphere and ellipsoid fits.

use nalgebra::{Matrix3, SVector, SymmetricEigen, Vector3};

use crate::least_squares::LeastSquares;
use crate::log::FieldCorrection;

const MIN_ROWS: usize = 20;

/// Fits a sphere to fields in microtesla by linear least squares of `|m|^2 = 2 c m + k`; returns the correction.
pub fn fit_sphere(fields: &[Vector3<f64>]) -> Option<FieldCorrection> {
    let (scaled, mean, scale) = normalised_points(fields)?;
    let mut fit = LeastSquares::new();
    for point in scaled {
        fit.add_row(&(point * 2.0).push(1.0), point.norm_squared(), 1.0);
    }
    Some(FieldCorrection::without_current(Matrix3::identity(), mean + fit.solve()?.xyz() * scale))
}

/// Fits an ellipsoid to fields in microtesla by linear least squares of the quadric `m A m + 2 b m = 1`; returns the
/// symmetric correction to a sphere of equal volume, or none for another quadric.
pub fn fit_ellipsoid(fields: &[Vector3<f64>]) -> Option<FieldCorrection> {
    let (scaled, mean, scale) = normalised_points(fields)?;
    let mut fit = LeastSquares::new();
    for point in scaled {
        let [x, y, z] = point.into();
        let terms = [x * x, y * y, z * z, 2.0 * x * y, 2.0 * x * z, 2.0 * y * z, 2.0 * x, 2.0 * y, 2.0 * z];
        fit.add_row(&SVector::from(terms), 1.0, 1.0);
    }
    let [xx, yy, zz, xy, xz, yz, x, y, z] = fit.solve()?.into();
    let quadric = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let linear = Vector3::new(x, y, z);
    let centre = -(quadric.try_inverse()? * linear);
    let shape = quadric / (1.0 + (quadric * centre).dot(&centre));
    let eigen = SymmetricEigen::new(shape);
    if !eigen.eigenvalues.iter().all(|value| *value > 1e-9) {
        return None;
    }
    let root = Matrix3::from_diagonal(&eigen.eigenvalues.map(f64::sqrt));
    let matrix = eigen.eigenvectors * root * eigen.eigenvectors.transpose();
    let radius = libm::pow(matrix.determinant(), -1.0 / 3.0);
    Some(FieldCorrection::without_current(matrix * radius, mean + centre * scale))
}

/// Fields about their mean in units of their RMS distance, the mean and that unit.
fn normalised_points(fields: &[Vector3<f64>]) -> Option<(Vec<Vector3<f64>>, Vector3<f64>, f64)> {
    if fields.len() < MIN_ROWS {
        return None;
    }
    let mean = fields.iter().sum::<Vector3<f64>>() / fields.len() as f64;
    let scale = (fields.iter().map(|field| (field - mean).norm_squared()).sum::<f64>() / fields.len() as f64).sqrt();
    (scale > 1e-6).then(|| (fields.iter().map(|field| (field - mean) / scale).collect(), mean, scale))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A field of 50 uT in 200 evenly distributed directions, distorted by known iron.
    fn distorted_fields(matrix: &Matrix3<f64>, centre: Vector3<f64>) -> Vec<Vector3<f64>> {
        let direction = |i: usize| {
            let (z, angle) = (1.0 - 2.0 * (i as f64 + 0.5) / 200.0, i as f64 * 2.4);
            Vector3::new((1.0 - z * z).sqrt() * libm::cos(angle), (1.0 - z * z).sqrt() * libm::sin(angle), z)
        };
        (0..200).map(|i| matrix * direction(i) * 50.0 + centre).collect()
    }

    #[test]
    fn a_sphere_is_found() {
        let centre = Vector3::new(10.0, -20.0, 300.0);
        let correction = fit_sphere(&distorted_fields(&Matrix3::identity(), centre)).unwrap();
        assert!((correction.hard_iron_ut - centre).norm() < 1e-6, "{correction:?}");
    }

    #[test]
    fn an_ellipsoid_is_found_with_its_axes() {
        let soft = Matrix3::new(1.1, 0.05, -0.02, 0.05, 0.9, 0.03, -0.02, 0.03, 1.05);
        let centre = Vector3::new(-30.0, 5.0, 12.0);
        let correction = fit_ellipsoid(&distorted_fields(&soft, centre)).unwrap();
        assert!((correction.hard_iron_ut - centre).norm() < 1e-6, "{correction:?}");
        let product = correction.matrix * soft;
        assert!((product / product[(0, 0)] - Matrix3::identity()).norm() < 1e-6, "{product}");
        assert!((correction.matrix.determinant() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn too_few_or_degenerate_fields_give_no_fit() {
        assert!(fit_sphere(&distorted_fields(&Matrix3::identity(), Vector3::zeros())[..19]).is_none());
        assert!(fit_sphere(&vec![Vector3::new(1.0, 2.0, 3.0); 100]).is_none());
        let coplanar: Vec<_> =
            (0..100).map(|i| Vector3::new(libm::cos(f64::from(i)), libm::sin(f64::from(i)), 2.0)).collect();
        assert!(fit_ellipsoid(&coplanar).is_none());
    }
}
