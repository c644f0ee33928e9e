//! Detects a step of hard iron in flight: its time, size and axis.
//!
//! The residuals of strength and vertical component of each row are linearised in `W`, `b`, `F`, `F sin I` and a step of `b` at a candidate time. The
//! candidate with the largest reduction of squared residuals is selected; one backward pass accumulates all normal
//! equations. Gauss-Newton iterations refine size and time.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use crate::log::FieldCorrection;
use crate::numbers::{median, square};
use crate::replay::fit_residuals::{FIT_UNKNOWNS, residual_derivatives};
use crate::replay::row::ReplayRow;

/// Number of unknowns without the step.
const UNKNOWNS_WITHOUT_STEP: usize = FIT_UNKNOWNS;
/// Number of unknowns with the three components of the step.
const UNKNOWNS_WITH_STEP: usize = UNKNOWNS_WITHOUT_STEP + 3;

/// Number of candidate times of the step.
const CANDIDATE_TIMES: usize = 120;
/// Least number of rows on either side of a candidate time.
const MIN_ROWS_PER_SIDE: usize = 60;

/// Largest number of rows in which a hard-iron step is searched.
const MAX_SEARCHED_ROWS: usize = 4000;

/// Smallest detected step: its largest component in standard deviations.
const MIN_STEP_SIGMAS: f64 = 8.0;
/// Smallest detected step, microtesla; smaller ones hardly affect headings.
const MIN_STEP_UT: f64 = 1.0;
/// Largest ratio of the median residual of all rows with the step to that without, at which a step is detected.
const MAX_TOTAL_SCATTER_RATIO: f64 = 0.85;

/// Largest such ratio of the rows on the shorter side alone, for a step near either end of the rows.
const MAX_SHORT_SIDE_SCATTER_RATIO: f64 = 0.6;
/// Largest ratio of all rows for such a step: rejects false steps of 1 to 4 uT in a VTOL's hover, which increase other
/// residuals.
const MAX_TOTAL_SCATTER_RATIO_NEAR_END: f64 = 0.97;

/// Number of successive rows with correlated errors, about one second; inflates the step's variance.
const CORRELATED_ROWS: f64 = 10.0;

/// Largest number of iterations: a large step clips residuals and takes about a dozen.
const MAX_ITERATIONS: usize = 40;
/// Change of the step in an iteration at convergence, standard deviations.
const CONVERGED_SIGMAS: f64 = 0.1;

/// Clipping limit of residuals, in robust standard deviations.
const CLIP_SIGMAS: f64 = 3.0;

/// A step of hard iron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardIronStep {
    /// Flight time of the step, seconds.
    pub time_s: f64,
    /// Size, body axes, microtesla.
    pub step_ut: [f64; 3],
    /// Standard deviation of each component, microtesla.
    pub sigma_ut: [f64; 3],
}

impl HardIronStep {
    /// Magnitude of the step, microtesla.
    #[must_use]
    pub fn size_ut(&self) -> f64 {
        Vector3::from(self.step_ut).norm()
    }

    /// Axis with the largest component.
    #[must_use]
    pub fn axis(&self) -> char {
        ['x', 'y', 'z'][Vector3::from(self.step_ut).iamax()]
    }
}

/// Finds a significant step of hard iron in the usable rows, starting from a correction that fits most of them.
#[must_use]
pub(super) fn find_step(rows: &[ReplayRow], initial: &FieldCorrection) -> Option<HardIronStep> {
    let usable: Vec<&ReplayRow> = rows.iter().filter(|row| row.is_usable).collect();
    let row_stride = usable.len().div_ceil(MAX_SEARCHED_ROWS).max(1);
    let usable: Vec<&ReplayRow> = usable.into_iter().step_by(row_stride).collect();
    let without = StepEstimate::from_correction(&usable, initial);
    let mut estimate = without.clone();
    let mut change = None;
    for _ in 0..MAX_ITERATIONS {
        let (previous_step_ut, previous_row) = (estimate.step_ut, change.map(|(first_row_after, _)| first_row_after));
        let (first_row_after, sigma) = estimate.estimate_step(&usable, previous_row)?;
        change = Some((estimate.first_row_after_step(&usable).unwrap_or(first_row_after), sigma));
        let is_settled = (estimate.step_ut - previous_step_ut).component_div(&sigma).amax() < CONVERGED_SIGMAS;
        if is_settled && change.map(|(first_row_after, _)| first_row_after) == previous_row {
            break;
        }
    }
    let (first_row_after, sigma) = change?;
    let scatter_ratio = |rows: &[&ReplayRow], first_row_after| {
        estimate.residual_scatter(rows, Some(first_row_after)) / without.residual_scatter(rows, None)
    };
    let (before, after) = usable.split_at(first_row_after);
    let short_side_ratio =
        if after.len() < before.len() { scatter_ratio(after, 0) } else { scatter_ratio(before, before.len()) };
    let total_ratio = scatter_ratio(&usable, first_row_after);
    let is_better = total_ratio < MAX_TOTAL_SCATTER_RATIO
        || total_ratio < MAX_TOTAL_SCATTER_RATIO_NEAR_END && short_side_ratio < MAX_SHORT_SIDE_SCATTER_RATIO;
    let hard_iron_step =
        HardIronStep { time_s: usable[first_row_after].t_s, step_ut: estimate.step_ut.into(), sigma_ut: sigma.into() };
    let sigmas = estimate.step_ut.component_div(&sigma).amax();
    (sigmas > MIN_STEP_SIGMAS && hard_iron_step.size_ut() > MIN_STEP_UT && is_better).then_some(hard_iron_step)
}

#[derive(Clone)]
struct StepEstimate {
    matrix: Matrix3<f64>,
    hard_iron_ut: Vector3<f64>,
    strength_ut: f64,
    vertical_ut: f64,
    motor_ut_per_a: Vector3<f64>,
    step_ut: Vector3<f64>,
}

impl StepEstimate {
    fn from_correction(rows: &[&ReplayRow], correction: &FieldCorrection) -> Self {
        let corrected = |row: &&ReplayRow| row.corrected_field(correction);
        let strength = median(rows.iter().map(|row| corrected(row).norm()));
        let vertical_ut = median(rows.iter().map(|row| row.down_in_body().dot(&corrected(row))));
        Self {
            matrix: correction.matrix,
            hard_iron_ut: correction.hard_iron_ut,
            strength_ut: strength,
            vertical_ut,
            motor_ut_per_a: correction.motor_ut_per_a,
            step_ut: Vector3::zeros(),
        }
    }

    fn without_hard_iron(&self, row: &ReplayRow) -> Vector3<f64> {
        row.raw_field.ut.map(f64::from) - self.hard_iron_ut - self.motor_ut_per_a * row.current_a.map_or(0.0, f64::from)
    }

    /// Corrected field of a row before or after the step.
    fn corrected_field(&self, row: &ReplayRow, is_after: bool) -> Vector3<f64> {
        let step_ut = if is_after { self.step_ut } else { Vector3::zeros() };
        self.matrix * (self.without_hard_iron(row) - step_ut)
    }

    fn residuals(&self, row: &ReplayRow, is_after: bool) -> [f64; 2] {
        let field = self.corrected_field(row, is_after);
        [field.norm() - self.strength_ut, row.down_in_body().dot(&field) - self.vertical_ut]
    }

    fn residual_scatter(&self, rows: &[&ReplayRow], first_row_after: Option<usize>) -> f64 {
        let all = rows.iter().enumerate().flat_map(|(i, row)| {
            self.residuals(row, first_row_after.is_some_and(|first_row_after| i >= first_row_after))
        });
        median(all.map(f64::abs))
    }

    /// One Gauss-Newton iteration. Selects the candidate time unless given; returns the first row after the step and
    /// the step's standard deviation.
    fn estimate_step(&mut self, rows: &[&ReplayRow], given_first_row: Option<usize>) -> Option<(usize, Vector3<f64>)> {
        let scale = (1.4826 * self.residual_scatter(rows, given_first_row)).max(1e-6);
        // Normal equations of the rows from each candidate on; after the loop, of all rows.
        let candidate_rows: Vec<usize> =
            (1..=CANDIDATE_TIMES).map(|i| rows.len() * i / (CANDIDATE_TIMES + 1)).collect();
        let mut sums: Vec<(usize, DMatrix<f64>, DVector<f64>)> = Vec::new();
        let (mut matrix, mut right_side) =
            (DMatrix::zeros(UNKNOWNS_WITHOUT_STEP, UNKNOWNS_WITHOUT_STEP), DVector::zeros(UNKNOWNS_WITHOUT_STEP));
        let mut squares = 0.0;
        for (i, row) in rows.iter().enumerate().rev() {
            let is_after = given_first_row.is_some_and(|first_row_after| i >= first_row_after);
            for (residual, row_derivatives) in
                self.residuals(row, is_after).into_iter().zip(self.residual_derivatives(row, is_after))
            {
                let clipped = residual.clamp(-CLIP_SIGMAS * scale, CLIP_SIGMAS * scale);
                squares += clipped * clipped;
                matrix.ger(1.0, &row_derivatives, &row_derivatives, 1.0);
                right_side.axpy(-clipped, &row_derivatives, 1.0);
            }
            let is_candidate =
                given_first_row.map_or_else(|| candidate_rows.contains(&i), |first_row_after| first_row_after == i);
            if is_candidate && i >= MIN_ROWS_PER_SIDE && rows.len() - i >= MIN_ROWS_PER_SIDE {
                sums.push((i, matrix.clone(), right_side.clone()));
            }
        }
        let best = sums
            .iter()
            .filter_map(|(i, matrix_after, right_side_after)| {
                let (solution, reduction, sigma) =
                    solve_unknowns(&matrix, &right_side, matrix_after, right_side_after, &self.prior_sigmas())?;
                Some((*i, solution, reduction, sigma))
            })
            .max_by(|(_, _, a, _), (_, _, b, _)| a.total_cmp(b))?;
        let (first_row_after, solution, _, sigma) = best;
        self.add_to_unknowns(&solution);
        let variance = squares / (2.0 * rows.len() as f64);
        Some((first_row_after, sigma * (variance * CORRELATED_ROWS).sqrt()))
    }

    /// Adds a vector of all unknowns.
    fn add_to_unknowns(&mut self, change: &DVector<f64>) {
        self.matrix += Matrix3::from_row_slice(&change.as_slice()[..9]);
        let vector = |from: usize| Vector3::new(change[from], change[from + 1], change[from + 2]);
        self.hard_iron_ut += vector(9);
        self.strength_ut += change[12];
        self.vertical_ut += change[13];
        self.step_ut += vector(UNKNOWNS_WITHOUT_STEP);
    }

    /// First row after the step, by least squared residuals of the current estimates.
    fn first_row_after_step(&self, rows: &[&ReplayRow]) -> Option<usize> {
        let scale = 1.4826 * self.residual_scatter(rows, None);
        let squares = |row: &ReplayRow, is_after: bool| -> f64 {
            self.residuals(row, is_after)
                .iter()
                .map(|residual| square(residual.clamp(-CLIP_SIGMAS * scale, CLIP_SIGMAS * scale)))
                .sum()
        };
        // Cumulative sum over the rows: squared residuals as before the step, less those as after it.
        let mut reduction = 0.0;
        let sums: Vec<f64> = rows
            .iter()
            .map(|row| {
                reduction += squares(row, false) - squares(row, true);
                reduction
            })
            .collect();
        let candidates = MIN_ROWS_PER_SIDE..rows.len().saturating_sub(MIN_ROWS_PER_SIDE);
        let sums_before = candidates.map(|first_row_after| (first_row_after, sums[first_row_after - 1]));
        sums_before.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(first_row_after, _)| first_row_after)
    }

    /// Derivatives of both residuals by the unknowns.
    fn residual_derivatives(&self, row: &ReplayRow, is_after: bool) -> [DVector<f64>; 2] {
        let step_ut = if is_after { self.step_ut } else { Vector3::zeros() };
        residual_derivatives(&self.matrix, self.without_hard_iron(row) - step_ut, row.down_in_body())
    }

    /// Prior standard deviations, for unobservable unknowns. The strength is fixed, since `W` sets the scale.
    fn prior_sigmas(&self) -> [f64; UNKNOWNS_WITH_STEP] {
        std::array::from_fn(|i| match i {
            0..9 => 0.3,
            12 => 1e-3,
            _ => self.strength_ut,
        })
    }
}

/// Returns the unknowns, the reduction of squared residuals, and the step's standard deviation at unit residual
/// variance.
fn solve_unknowns(
    matrix: &DMatrix<f64>,
    right_side: &DVector<f64>,
    matrix_after: &DMatrix<f64>,
    right_side_after: &DVector<f64>,
    prior_sigmas: &[f64; UNKNOWNS_WITH_STEP],
) -> Option<(DVector<f64>, f64, Vector3<f64>)> {
    let mut all = DMatrix::zeros(UNKNOWNS_WITH_STEP, UNKNOWNS_WITH_STEP);
    all.view_mut((0, 0), (UNKNOWNS_WITHOUT_STEP, UNKNOWNS_WITHOUT_STEP)).copy_from(matrix);
    let step = matrix_after.view((0, 9), (UNKNOWNS_WITHOUT_STEP, 3)).into_owned();
    all.view_mut((0, UNKNOWNS_WITHOUT_STEP), (UNKNOWNS_WITHOUT_STEP, 3)).copy_from(&step);
    all.view_mut((UNKNOWNS_WITHOUT_STEP, 0), (3, UNKNOWNS_WITHOUT_STEP)).copy_from(&step.transpose());
    all.view_mut((UNKNOWNS_WITHOUT_STEP, UNKNOWNS_WITHOUT_STEP), (3, 3)).copy_from(&matrix_after.view((9, 9), (3, 3)));
    for (i, scale) in prior_sigmas.iter().enumerate() {
        all[(i, i)] += square(*scale).recip();
    }
    let mut sides = DVector::zeros(UNKNOWNS_WITH_STEP);
    sides.rows_mut(0, UNKNOWNS_WITHOUT_STEP).copy_from(right_side);
    sides.rows_mut(UNKNOWNS_WITHOUT_STEP, 3).copy_from(&right_side_after.rows(9, 3));
    let cholesky = all.cholesky()?;
    let solved = cholesky.solve(&sides);
    let reduction = solved.dot(&sides);
    let inverse = cholesky.inverse();
    let sigma =
        Vector3::from_fn(|i, _| inverse[(UNKNOWNS_WITHOUT_STEP + i, UNKNOWNS_WITHOUT_STEP + i)].max(0.0).sqrt());
    Some((solved, reduction, sigma))
}

#[cfg(test)]
mod tests;
