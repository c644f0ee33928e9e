//! Candidate times of a change of the sensor: jumps of the field, and the step that explains its residuals best.

use super::change::{MAX_FITTED_ROWS, MIN_ROWS_PER_SIDE};
use crate::log::FieldCorrection;
use crate::replay::change_fit::{ChangeFit, FitRow};
use crate::replay::hard_iron_jump::find_jump_times_s;
use crate::replay::replay_run::solve_all_rows;
use crate::replay::row::ReplayRow;
use crate::replay::row_solve::solved_correction;

/// Largest number of jumps that are candidates; more are of another cause, such as wrong body rates.
const MAX_JUMPS: usize = 8;

/// Times at which the field jumps, or a step explains its residuals to a fit of one half of the rows best.
pub(super) fn candidate_times_s(rows: &[ReplayRow], initial: &FieldCorrection) -> Vec<f64> {
    let (first, second) = rows.split_at(rows.len() / 2);
    let solved = [first, second].map(|half| solve_all_rows(half).as_ref().map(solved_correction));
    let stride = rows.len().div_ceil(MAX_FITTED_ROWS).max(1);
    let fit_rows: Vec<FitRow> = rows.iter().step_by(stride).map(|row| FitRow::new(row, false)).collect();
    let mut times_s = Vec::new();
    for correction in solved.into_iter().flatten().chain([*initial]) {
        let without = ChangeFit::from_correction(&fit_rows, &correction);
        let step = without.linearised_step(&fit_rows, MIN_ROWS_PER_SIDE.div_ceil(stride));
        times_s.extend(step.map(|index| rows[index * stride].t_s));
        let jumps_s = find_jump_times_s(rows, &correction);
        if jumps_s.len() <= MAX_JUMPS {
            times_s.extend(jumps_s);
        }
    }
    times_s
}
