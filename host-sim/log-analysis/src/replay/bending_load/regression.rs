//! Regression of the residual field on a load, with the fit, the attitude's offsets and a drift as further unknowns.
//!
//! The residuals need no heading: with constant iron the corrected fields `h = W (m - b)` have one strength `F` and one
//! vertical component `F sin I`.

use autoswing::frames::Field;
use nalgebra::{DMatrix, DVector, Matrix3, RowVector4, Vector3};

use crate::log::FieldCorrection;
use crate::numbers::{SIGMAS_PER_MEDIAN, mean, median, rms, square};
use crate::replay::change_fit::{FIT_UNKNOWNS, residual_derivatives};
use crate::replay::parameter_fit::half_index_at;
use crate::replay::row::ReplayRow;

/// Unknowns beside the fit: roll and pitch offset, their scale with the bank, latency, and a drift of hard iron.
const OTHER_UNKNOWNS: usize = 7;

/// Length of the blocks whose sums of errors are taken as independent, seconds: longer than gusts and turns last.
const BLOCK_S: f64 = 10.0;

/// Smallest number of blocks, for a covariance of three coefficients.
const MIN_BLOCKS: usize = 12;

/// Clipping limit of residuals, in robust standard deviations: spikes are no load.
const CLIP_SIGMAS: f64 = 4.0;

/// Solutions with the residuals scaled and clipped by the one before.
const ROBUST_ITERATIONS: usize = 3;

/// Least standard deviation of residuals, in their unit: those of a log without noise.
const MIN_SIGMA: f64 = 1e-3;

/// Prior standard deviation of a coefficient times the load's standard deviation, microtesla; for directions that the
/// flight does not show.
const PRIOR_UT: f64 = 50.0;

/// Residuals of the rows without a load: strength and vertical component of each.
pub(super) struct ResidualModel {
    /// Residuals that the unknowns leave, in standard deviations.
    pub residuals: DVector<f64>,
    /// Direction of a disturbance that each residual shows, per standard deviation.
    pub directions: Vec<Vector3<f64>>,
    /// Horizontal part of the field, microtesla.
    pub horizontal_ut: f64,
    jacobian: DMatrix<f64>,
    normal_inverse: DMatrix<f64>,
    blocks: Vec<usize>,
    halves: Vec<usize>,
}

/// Fit of a load.
#[derive(Clone, Debug)]
pub(super) struct LoadFit {
    /// Disturbance per unit of the load, microtesla.
    pub coefficient_ut: Vector3<f64>,
    /// Reduction of the squared residuals, in variances.
    pub reduction: f64,
    /// Reduction of the squared residuals of each half by the coefficients of the other half.
    pub reductions_of_halves: [f64; 2],
    /// Significance, standard deviations of a normal distribution.
    pub sigmas: f64,
    /// Residuals that are left.
    pub residuals: DVector<f64>,
}

impl ResidualModel {
    /// Residuals of a correction that fits most of the rows; hard iron may change at the given times. The fit is not
    /// repeated: with a load in the residuals it would follow the load, where the flight shows an unknown poorly.
    pub fn new(rows: &[ReplayRow], correction: &FieldCorrection, change_times_s: &[f64]) -> Option<Self> {
        let field = |row: &ReplayRow| correction.matrix * raw(row, correction);
        let [total_ut, vertical_ut] = [
            median(rows.iter().map(|row| field(row).norm())),
            median(rows.iter().map(|row| row.down_in_body().dot(&field(row)))),
        ];
        let mut system = LinearSystem::new(rows, correction, [total_ut, vertical_ut], change_times_s)?;
        let (solution, normal_inverse) = system.solve_robustly(total_ut)?;
        let blocks = block_indices(rows);
        (*blocks.last()? >= MIN_BLOCKS).then(|| Self {
            residuals: &system.residuals - &system.jacobian * &solution,
            directions: system.directions,
            horizontal_ut: (square(total_ut) - square(vertical_ut)).max(1.0).sqrt(),
            normal_inverse,
            jacobian: system.jacobian,
            blocks,
            halves: rows.iter().map(|row| half_index_at(row.t_s)).collect(),
        })
    }

    /// Columns of a load of unit spread, without what the unknowns explain, and its spread.
    fn load_columns(&self, values: &[f64]) -> (DMatrix<f64>, f64) {
        let mean = mean(values.iter().copied());
        let spread = rms(values.iter().map(|value| value - mean));
        let columns = DMatrix::from_fn(self.directions.len(), 3, |i, axis| {
            self.directions[i][axis] * (values[i / 2] - mean) / spread
        });
        (&columns - &self.jacobian * (&self.normal_inverse * (self.jacobian.transpose() * &columns)), spread)
    }

    /// The model of rows whose residuals are scaled and clipped without a load, with the load added again: rare large
    /// currents are no spikes.
    pub fn around_load(
        rows: &[ReplayRow],
        correction: &FieldCorrection,
        change_times_s: &[f64],
        values: &[f64],
        coefficient_ut: Vector3<f64>,
    ) -> Option<Self> {
        let mean = mean(values.iter().copied());
        let raw_coefficient_ut = correction.matrix.try_inverse()? * coefficient_ut;
        let without_load = |(row, value): (&ReplayRow, &f64)| {
            let raw_ut = row.raw_field.ut - (raw_coefficient_ut * (value - mean)).map(|axis| axis as f32);
            ReplayRow { raw_field: Field::new(raw_ut), ..*row }
        };
        let rows: Vec<ReplayRow> = rows.iter().zip(values).map(without_load).collect();
        let mut model = Self::new(&rows, correction, change_times_s)?;
        let (columns, spread) = model.load_columns(values);
        model.residuals += columns * (coefficient_ut * spread);
        Some(model)
    }

    /// Fit of a load with these values at the rows; none if it hardly varies.
    pub fn fit_load(&self, values: &[f64]) -> Option<LoadFit> {
        let (columns, spread) = self.load_columns(values);
        let inverse = normal_inverse(&columns)?;
        let coefficient = inverse * (columns.transpose() * &self.residuals);
        let coefficient = Vector3::from_column_slice(coefficient.as_slice());
        let residuals = &self.residuals - &columns * coefficient;
        Some(LoadFit {
            coefficient_ut: coefficient / spread,
            reduction: self.residuals.norm_squared() - residuals.norm_squared(),
            reductions_of_halves: self.reductions_of_halves(&columns)?,
            sigmas: self.significance(&columns, &residuals, &inverse, &coefficient)?,
            residuals,
        })
        .filter(|fit| fit.sigmas.is_finite() && fit.reduction.is_finite())
    }

    /// Significance of a coefficient by the covariance of the blocks' sums (cluster-robust; K.-Y. Liang, S. L. Zeger,
    /// Biometrika 73, 1986), so that errors that are correlated within a block count once.
    fn significance(
        &self,
        columns: &DMatrix<f64>,
        residuals: &DVector<f64>,
        inverse: &Matrix3<f64>,
        coefficient: &Vector3<f64>,
    ) -> Option<f64> {
        let block_count = self.blocks.last()? + 1;
        let mut sums = vec![Vector3::zeros(); block_count];
        for (i, residual) in residuals.iter().enumerate() {
            sums[self.blocks[i / 2]] += columns.fixed_view::<1, 3>(i, 0).transpose() * *residual;
        }
        let count = block_count as f64;
        let scatter = sums.iter().map(|sum| sum * sum.transpose()).sum::<Matrix3<f64>>() * (count / (count - 1.0));
        let covariance = inverse * scatter * inverse;
        let wald = coefficient.dot(&(covariance.try_inverse()? * coefficient));
        let free = count - 3.0;
        Some(normal_deviate(wald / 3.0 * free / (count - 1.0), 3.0, free))
    }

    /// Standard deviations by which a fit is better than another, by the blocks' differences of squared residuals (Q. H.
    /// Vuong, Econometrica 57, 1989).
    pub fn advantage_sigmas(&self, fit: &LoadFit, other: &LoadFit) -> f64 {
        let mut gains = vec![0.0; self.blocks.last().map_or(0, |last| last + 1)];
        for (i, (residual, by_other)) in fit.residuals.iter().zip(&other.residuals).enumerate() {
            gains[self.blocks[i / 2]] += square(*by_other) - square(*residual);
        }
        gains.iter().sum::<f64>() / gains.iter().copied().map(square).sum::<f64>().sqrt()
    }

    /// Reduction of the squared residuals in each half by the coefficients of the other.
    fn reductions_of_halves(&self, columns: &DMatrix<f64>) -> Option<[f64; 2]> {
        let rows_of =
            |half: usize| -> Vec<usize> { (0..self.residuals.len()).filter(|i| self.halves[i / 2] == half).collect() };
        let parts = [0, 1].map(|half| {
            let indices = rows_of(half);
            (columns.select_rows(&indices), self.residuals.select_rows(&indices))
        });
        let coefficient = |half: usize| {
            let (columns, residuals) = &parts[half];
            let projection = columns.transpose() * residuals;
            Some(normal_inverse(columns)? * Vector3::from_column_slice(projection.as_slice()))
        };
        let coefficients = [coefficient(0)?, coefficient(1)?];
        Some([0, 1].map(|half| {
            let (columns, residuals) = &parts[half];
            residuals.norm_squared() - (residuals - columns * coefficients[1 - half]).norm_squared()
        }))
    }
}

/// Inverse of the normal matrix of three columns, with the prior.
fn normal_inverse(columns: &DMatrix<f64>) -> Option<Matrix3<f64>> {
    let normal = columns.transpose() * columns;
    (normal.fixed_view::<3, 3>(0, 0) + Matrix3::identity() / square(PRIOR_UT)).try_inverse()
}

/// Normal deviate of a value of the F distribution (E. Paulson, Annals of Mathematical Statistics 13, 1942).
pub(super) fn normal_deviate(value: f64, numerator_freedom: f64, denominator_freedom: f64) -> f64 {
    let [a, b] = [numerator_freedom, denominator_freedom].map(|freedom| 2.0 / (9.0 * freedom));
    let root = libm::cbrt(value);
    ((1.0 - b) * root - (1.0 - a)) / (b * square(root) + a).sqrt()
}

/// Index of each row's block, without gaps.
fn block_indices(rows: &[ReplayRow]) -> Vec<usize> {
    let mut blocks: Vec<usize> = Vec::with_capacity(rows.len());
    let mut block_start_s = rows.first().map_or(0.0, |row| row.t_s);
    let mut block = 0;
    for row in rows {
        if row.t_s - block_start_s >= BLOCK_S {
            block += 1;
            block_start_s = row.t_s;
        }
        blocks.push(block);
    }
    blocks
}

/// Raw field without hard iron.
fn raw(row: &ReplayRow, correction: &FieldCorrection) -> Vector3<f64> {
    row.raw_field.ut.map(f64::from) - correction.hard_iron_ut
}

/// The Earth's field of this strength and vertical component, in the vertical plane of a measured one.
fn earth_field(measured: Vector3<f64>, down: Vector3<f64>, [total_ut, vertical_ut]: [f64; 2]) -> Vector3<f64> {
    let horizontal = measured - down * down.dot(&measured);
    let horizontal_ut = (square(total_ut) - square(vertical_ut)).max(0.0).sqrt();
    down * vertical_ut + horizontal.try_normalize(f64::EPSILON).unwrap_or_default() * horizontal_ut
}

/// Linearised residuals, in their robust standard deviations.
struct LinearSystem {
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
    directions: Vec<Vector3<f64>>,
}

impl LinearSystem {
    fn new(
        rows: &[ReplayRow],
        correction: &FieldCorrection,
        earth_ut: [f64; 2],
        change_times_s: &[f64],
    ) -> Option<Self> {
        let inverse = correction.matrix.try_inverse()?;
        let unknowns = FIT_UNKNOWNS + OTHER_UNKNOWNS + 3 * change_times_s.len();
        let mut residuals = DVector::zeros(2 * rows.len());
        let mut jacobian = DMatrix::zeros(2 * rows.len(), unknowns);
        let mut directions = vec![Vector3::zeros(); 2 * rows.len()];
        let middle_s = rows.get(rows.len() / 2).map_or(0.0, |row| row.t_s);
        for (i, row) in rows.iter().enumerate() {
            let down = row.down_in_body();
            let measured = correction.matrix * raw(row, correction);
            let values = [measured.norm() - earth_ut[0], down.dot(&measured) - earth_ut[1]];
            // A measured field has the disturbance, too, which its derivatives would explain.
            let field = earth_field(measured, down, earth_ut);
            let derivatives = residual_derivatives(&correction.matrix, inverse * field, down);
            for (kind, direction) in [field.normalize(), down].into_iter().enumerate() {
                let at = 2 * i + kind;
                (residuals[at], directions[at]) = (values[kind], direction);
                let mut line = jacobian.row_mut(at);
                line.columns_mut(0, FIT_UNKNOWNS).copy_from(&derivatives[kind].transpose());
                if kind == 1 {
                    let derivatives = attitude_derivatives(row, field);
                    line.columns_mut(FIT_UNKNOWNS, 4).copy_from(&RowVector4::from(derivatives));
                }
                let drift = direction * (row.t_s - middle_s) / 100.0;
                line.columns_mut(FIT_UNKNOWNS + 4, 3).copy_from(&drift.transpose());
                let changed = change_times_s.iter().filter(|at_s| row.t_s >= **at_s).count();
                for change in 0..changed {
                    line.columns_mut(FIT_UNKNOWNS + OTHER_UNKNOWNS + 3 * change, 3).copy_from(&direction.transpose());
                }
            }
        }
        Some(Self { residuals, jacobian, directions })
    }

    /// Solution, and inverse of the normal matrix, after scaling by the robust standard deviation of the residuals that it
    /// leaves; these are clipped.
    fn solve_robustly(&mut self, total_ut: f64) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let mut solution = DVector::zeros(self.jacobian.ncols());
        let mut normal_inverse = None;
        for _ in 0..ROBUST_ITERATIONS {
            self.scale_and_clip(&solution);
            let inverse = self.normal_inverse(total_ut)?;
            solution = &inverse * (self.jacobian.transpose() * &self.residuals);
            normal_inverse = Some(inverse);
        }
        Some((solution, normal_inverse?))
    }

    /// Divides the equations of each kind by the robust standard deviation of their residuals after a solution, and clips
    /// these residuals.
    fn scale_and_clip(&mut self, solution: &DVector<f64>) {
        let explained = &self.jacobian * solution;
        for kind in 0..2 {
            let of_kind = (kind..self.residuals.len()).step_by(2);
            let left = |at: usize| self.residuals[at] - explained[at];
            let sigma = (SIGMAS_PER_MEDIAN * median(of_kind.clone().map(|at| left(at).abs()))).max(MIN_SIGMA);
            for at in of_kind {
                let left = self.residuals[at] - explained[at];
                self.residuals[at] = explained[at] / sigma + (left / sigma).clamp(-CLIP_SIGMAS, CLIP_SIGMAS);
                self.directions[at] /= sigma;
                self.jacobian.row_mut(at).unscale_mut(sigma);
            }
        }
    }

    /// Inverse of the normal matrix. A weak prior holds unknowns that the flight does not show; the strength is fixed,
    /// since `W` sets the scale.
    fn normal_inverse(&self, total_ut: f64) -> Option<DMatrix<f64>> {
        let mut normal = self.jacobian.transpose() * &self.jacobian;
        for i in 0..normal.nrows() {
            let prior_sigma = match i {
                0..9 => 0.3,
                12 => 1e-3,
                FIT_UNKNOWNS..18 => 0.2,
                _ => total_ut,
            };
            normal[(i, i)] += square(prior_sigma).recip();
        }
        Some(normal.cholesky()?.inverse())
    }
}

/// Derivatives of the vertical component by an offset of roll, of pitch, a scale of roll, and a latency.
fn attitude_derivatives(row: &ReplayRow, field: Vector3<f64>) -> [f64; 4] {
    let [(sin_roll, cos_roll), (sin_pitch, cos_pitch)] =
        [row.attitude.roll_rad, row.attitude.pitch_rad].map(|angle| libm::sincos(f64::from(angle)));
    let by_roll = Vector3::new(0.0, cos_roll * cos_pitch, -sin_roll * cos_pitch).dot(&field);
    let by_pitch = Vector3::new(-cos_pitch, -sin_roll * sin_pitch, -cos_roll * sin_pitch).dot(&field);
    let rates = row.rates_rad_s.map_or_else(Vector3::zeros, |rates| Vector3::from(rates).map(f64::from));
    let by_time = row.down_in_body().cross(&rates).dot(&field);
    [by_roll, by_pitch, by_roll * f64::from(row.attitude.roll_rad), by_time]
}
