//! Candidate times of a change.

use nalgebra::Vector5;

use super::jump::{Jump, find_jumps};
use crate::log::FieldCorrection;
use crate::numbers::{square, thinned};
use crate::replay::change_fit::{ChangeFit, FitRow};
use crate::replay::replay_run::solve_all_rows;
use crate::replay::row::ReplayRow;
use crate::replay::row_solve::solved_correction;

/// Least number of rows on a side of a change.
pub(super) const MIN_ROWS_PER_SIDE: usize = 60;

/// Candidates closer than this are one, seconds.
const MAX_SAME_TIME_S: f64 = 1.0;

/// Largest number of jumps that are candidates; more are of another cause, such as wrong body rates.
const MAX_JUMPS: usize = 16;

/// Largest number of rows in which a step is searched.
const MAX_SEARCHED_ROWS: usize = 4000;

/// Smallest scatter that is compared, microtesla.
const MIN_SCATTER_UT: f64 = 0.01;

/// A candidate time, seconds, with the jump of the field then, if it jumps.
#[derive(Clone, Copy, Debug)]
pub struct Candidate {
    pub time_s: f64,
    pub jump: Option<Jump>,
}

/// Times at which the field jumps, a step reduces the residuals most, or the residuals change their scatter: by a
/// correction that fits most of the rows, and by the fits of both halves.
pub fn find_candidates(rows: &[ReplayRow], initial: &FieldCorrection, has_turns: bool) -> Vec<Candidate> {
    let (first, second) = rows.split_at(rows.len() / 2);
    let fits = [first, second].into_iter().filter_map(|half| solve_all_rows(half).as_ref().map(solved_correction));
    let corrections: Vec<FieldCorrection> = std::iter::once(*initial).chain(fits).collect();
    let jumps = corrections.iter().filter(|_| has_turns).map(|correction| find_jumps(rows, correction));
    let jumps = jumps.filter(|jumps| jumps.len() <= MAX_JUMPS).flatten();
    let jumps = jumps.map(|jump| Candidate { time_s: jump.time_s, jump: Some(jump) });
    let times_s =
        corrections.iter().flat_map(|correction| [scatter_change_s(rows, correction), step_s(rows, correction)]);
    let others = times_s.flatten().map(|time_s| Candidate { time_s, jump: None });
    let mut found: Vec<Candidate> = Vec::new();
    for candidate in jumps.chain(others) {
        if found.iter().all(|other| (other.time_s - candidate.time_s).abs() >= MAX_SAME_TIME_S) {
            found.push(candidate);
        }
    }
    found
}

/// Time of the step of hard iron that reduces the linearised residuals most, seconds.
fn step_s(rows: &[ReplayRow], correction: &FieldCorrection) -> Option<f64> {
    let rows = thinned(rows, MAX_SEARCHED_ROWS);
    let unchanged: Vec<FitRow> = rows.iter().map(|row| FitRow::new(row, false)).collect();
    let fit = ChangeFit::from_correction(&unchanged, correction);
    Some(rows.get(fit.linearised_step(&unchanged, MIN_ROWS_PER_SIDE)?)?.t_s)
}

/// Time that divides the rows into two parts of the least scatter about their own means of strength and vertical
/// component, seconds.
fn scatter_change_s(rows: &[ReplayRow], correction: &FieldCorrection) -> Option<f64> {
    let sums_of = |row: &ReplayRow| {
        let field = row.corrected_field(correction);
        let (strength_ut, vertical_ut) = (field.norm(), row.down_in_body().dot(&field));
        Vector5::new(1.0, strength_ut, vertical_ut, square(strength_ut), square(vertical_ut))
    };
    let add_row = |sums: &mut Vector5<f64>, row: &ReplayRow| Some(std::mem::replace(sums, *sums + sums_of(row)));
    let sums_to: Vec<Vector5<f64>> = rows.iter().scan(Vector5::zeros(), add_row).collect();
    let total = sums_to.last()? + sums_of(rows.last()?);
    let cost = |i: usize| scatter_cost(&sums_to[i]) + scatter_cost(&(total - sums_to[i]));
    let divisions = MIN_ROWS_PER_SIDE..rows.len().saturating_sub(MIN_ROWS_PER_SIDE);
    divisions.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).map(|i| rows[i].t_s)
}

/// Negative log-likelihood of normally distributed rows about their mean, by their number and the sums and sums of squares
/// of both components.
fn scatter_cost(sums: &Vector5<f64>) -> f64 {
    let count = sums[0];
    let variance = |i: usize| sums[2 + i] / count - square(sums[i] / count);
    let logs = [1, 2].map(|i| libm::log(variance(i).max(square(MIN_SCATTER_UT))));
    count * (logs[0] + logs[1])
}
