//! Detects a step of hard iron in flight: its time, size and axis.
//!
//! The time that reduces the linearised residuals of strength and vertical component most is selected among candidates.
//! Fits of step and correction, and of the time by their likelihood, alternate.

use nalgebra::Vector3;

use crate::log::FieldCorrection;
use crate::numbers::thinned;
use crate::replay::change_fit::{ChangeFit, FitRow, Hypothesis};
use crate::replay::row::ReplayRow;

/// Least number of rows on either side of a step.
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

/// Largest number of fits with another time.
const MAX_FITS: usize = 8;

/// A step of hard iron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardIronStep {
    /// Flight time of the step, seconds.
    pub time_s: f64,
    /// Size, body axes, microtesla.
    pub step_ut: Vector3<f64>,
    /// Standard deviation of each component, microtesla.
    pub sigma_ut: Vector3<f64>,
}

impl HardIronStep {
    /// Axis with the largest component.
    pub fn axis(&self) -> char {
        ['x', 'y', 'z'][self.step_ut.iamax()]
    }
}

/// Finds a significant step of hard iron in the usable rows, starting from a correction that fits most of them.
pub(super) fn find_step(rows: &[ReplayRow], initial: &FieldCorrection) -> Option<HardIronStep> {
    let usable: Vec<&ReplayRow> = rows.iter().filter(|row| row.is_usable).collect();
    let usable = thinned(&usable, MAX_SEARCHED_ROWS);
    // A current that changes with a step would take it over.
    let fit_row = |row: &&ReplayRow| FitRow::new(row, false).less_interference(&initial.motor_ut_per_a);
    let unchanged: Vec<FitRow> = usable.iter().map(fit_row).collect();
    let without = ChangeFit::from_correction(&unchanged, initial);
    let mut fit = without;
    let mut first_after = without.linearised_step(&unchanged, MIN_ROWS_PER_SIDE)?;
    let mut changed = unchanged.clone();
    for _ in 0..MAX_FITS {
        changed.iter_mut().enumerate().for_each(|(i, row)| row.is_changed = i >= first_after);
        fit = fit.fitted(&changed, Hypothesis::HardIron);
        let [a, b, c, d] = fit.scales_ut(&changed);
        let scales = [a.min(c), b.min(d), a.min(c), b.min(d)];
        let likeliest = fit.likeliest_division(&unchanged, &scales, MIN_ROWS_PER_SIDE)?;
        if likeliest == std::mem::replace(&mut first_after, likeliest) {
            break;
        }
    }
    let sigma_ut = fit.step_sigma_ut(&changed, CORRELATED_ROWS)?;
    let scatter_ratio =
        |range: std::ops::Range<usize>| fit.scatter_ut(&changed[range.clone()]) / without.scatter_ut(&unchanged[range]);
    let is_after_short = changed.len() < 2 * first_after;
    let short_side_ratio = scatter_ratio(if is_after_short { first_after..changed.len() } else { 0..first_after });
    let total_ratio = scatter_ratio(0..changed.len());
    let is_better = total_ratio < MAX_TOTAL_SCATTER_RATIO
        || total_ratio < MAX_TOTAL_SCATTER_RATIO_NEAR_END && short_side_ratio < MAX_SHORT_SIDE_SCATTER_RATIO;
    let step = HardIronStep { time_s: usable.get(first_after)?.t_s, step_ut: fit.offset_ut, sigma_ut };
    let is_significant = fit.offset_ut.component_div(&sigma_ut).amax() > MIN_STEP_SIGMAS;
    (is_significant && step.step_ut.norm() > MIN_STEP_UT && is_better).then_some(step)
}

#[cfg(test)]
mod tests;
