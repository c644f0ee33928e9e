//! Candidate times of a change of the sensor: jumps of the field, and changes of the residuals' scatter.

use super::change::MIN_ROWS_PER_SIDE;
use crate::log::FieldCorrection;
use crate::numbers::square;
use crate::replay::hard_iron_jump::find_jump_times_s;
use crate::replay::replay_run::solve_all_rows;
use crate::replay::row::ReplayRow;
use crate::replay::row_solve::solved_correction;

/// Largest number of jumps that are candidates; more are of another cause, such as wrong body rates.
const MAX_JUMPS: usize = 8;

/// Smallest scatter that is compared, microtesla.
const MIN_SCATTER_UT: f64 = 0.01;

/// Times at which the field jumps, or its residuals to a fit of one half of the rows change their scatter.
pub(super) fn candidate_times_s(rows: &[ReplayRow], initial: &FieldCorrection) -> Vec<f64> {
    let (first, second) = rows.split_at(rows.len() / 2);
    let solved = [first, second].map(|half| solve_all_rows(half).as_ref().map(solved_correction));
    let mut times_s = Vec::new();
    for correction in solved.into_iter().flatten().chain([*initial]) {
        times_s.extend(change_of_scatter_s(rows, &correction));
        let jumps_s = find_jump_times_s(rows, &correction);
        if jumps_s.len() <= MAX_JUMPS {
            times_s.extend(jumps_s);
        }
    }
    times_s
}

/// Time that divides the rows into two parts of the least scatter about their own means of strength and vertical
/// component, seconds.
fn change_of_scatter_s(rows: &[ReplayRow], correction: &FieldCorrection) -> Option<f64> {
    let residuals = |row: &ReplayRow| {
        let field = row.corrected_field(correction);
        [field.norm(), row.down_in_body().dot(&field)]
    };
    let sums_to: Vec<ScatterSums> = rows
        .iter()
        .scan(ScatterSums::default(), |sums, row| Some(std::mem::replace(sums, sums.with_row(residuals(row)))))
        .collect();
    let total = sums_to.last()?.with_row(residuals(rows.last()?));
    let cost = |i: usize| sums_to[i].cost() + total.less(&sums_to[i]).cost();
    let divisions = MIN_ROWS_PER_SIDE..rows.len().saturating_sub(MIN_ROWS_PER_SIDE);
    divisions.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).map(|i| rows[i].t_s)
}

/// Sums over rows, of strength and vertical component.
#[derive(Clone, Copy, Default)]
struct ScatterSums {
    count: f64,
    sums_ut: [f64; 2],
    squares_ut2: [f64; 2],
}

impl ScatterSums {
    fn with_row(&self, residuals_ut: [f64; 2]) -> Self {
        Self {
            count: self.count + 1.0,
            sums_ut: [0, 1].map(|i| self.sums_ut[i] + residuals_ut[i]),
            squares_ut2: [0, 1].map(|i| self.squares_ut2[i] + square(residuals_ut[i])),
        }
    }

    fn less(&self, other: &Self) -> Self {
        Self {
            count: self.count - other.count,
            sums_ut: [0, 1].map(|i| self.sums_ut[i] - other.sums_ut[i]),
            squares_ut2: [0, 1].map(|i| self.squares_ut2[i] - other.squares_ut2[i]),
        }
    }

    /// Negative log-likelihood of normally distributed rows about their mean.
    fn cost(&self) -> f64 {
        let variance = |i: usize| self.squares_ut2[i] / self.count - square(self.sums_ut[i] / self.count);
        let logs = [0, 1].map(|i| libm::log(variance(i).max(square(MIN_SCATTER_UT))));
        self.count * (logs[0] + logs[1])
    }
}
