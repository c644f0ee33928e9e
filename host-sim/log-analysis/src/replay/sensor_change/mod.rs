//! Detects a change of a magnetometer in flight: its gain, the sign or gain of an axis, or its registers.
//!
//! Iron is additive; a change of the sensor is proportional to the reading. At candidate times both hypotheses are fitted
//! together with the correction, and compared by their evidence in Laplace's approximation (D. MacKay, "Bayesian
//! interpolation", 1992), with residuals that are correlated for seconds.

mod comparison;

use nalgebra::Vector5;

use super::hard_iron_changes::LoggedHardIronChange;
use crate::log::FieldCorrection;
use crate::numbers::square;
use crate::replay::hard_iron_jump::find_jump_times_s;
use crate::replay::replay_run::solve_all_rows;
use crate::replay::row::ReplayRow;
use crate::replay::row_solve::solved_correction;
use comparison::{Comparison, MIN_ROWS_PER_SIDE, SKIPPED_S};

pub use comparison::SensorChange;

/// Candidates closer than this are one, seconds.
const MAX_SAME_TIME_S: f64 = 1.0;

/// Finds the change of the sensor with the most evidence. `initial` is a correction that fits most of the rows.
pub fn find_sensor_change(
    rows: &[ReplayRow],
    initial: &FieldCorrection,
    changes: &[LoggedHardIronChange],
) -> Option<SensorChange> {
    let usable: Vec<ReplayRow> = rows.iter().filter(|row| row.is_usable).copied().collect();
    let changes_s: Vec<f64> = changes.iter().map(|change| change.hard_iron_step.time_s).collect();
    let mut times_s = [changes_s.clone(), candidate_times_s(&usable, initial)].concat();
    times_s.sort_by(f64::total_cmp);
    times_s.dedup_by(|later, earlier| *later - *earlier < MAX_SAME_TIME_S);
    // A change of hard iron at another time spoils the fits: then only the rows up to that time are compared.
    decide_among(&usable, &times_s).or_else(|| {
        times_s.iter().find_map(|&time_s| {
            let part = rows_around(&usable, time_s, &changes_s);
            if part.len() < usable.len() { decide_among(part, &[time_s]) } else { None }
        })
    })
}

/// The change of the sensor at the candidate time with the best fit of any hypothesis, if that is evident.
fn decide_among(rows: &[ReplayRow], times_s: &[f64]) -> Option<SensorChange> {
    let comparisons = times_s.iter().filter_map(|&time_s| Comparison::new(rows, time_s));
    let best = comparisons.min_by(|a, b| a.mean_objective().total_cmp(&b.mean_objective()))?;
    let refined_s = best.refined_time_s(rows)?;
    if (refined_s - best.time_s).abs() < SKIPPED_S {
        return best.decide(refined_s);
    }
    Comparison::new(rows, refined_s)?.decide(refined_s)
}

/// Rows between the changes before and after a time.
fn rows_around<'rows>(rows: &'rows [ReplayRow], time_s: f64, changes_s: &[f64]) -> &'rows [ReplayRow] {
    let others = || changes_s.iter().filter(|other_s| (**other_s - time_s).abs() > 2.0 * MAX_SAME_TIME_S);
    let from_s = others().filter(|other_s| **other_s < time_s).copied().fold(f64::NEG_INFINITY, f64::max);
    let to_s = others().filter(|other_s| **other_s > time_s).copied().fold(f64::INFINITY, f64::min);
    let index = |at_s: f64| rows.partition_point(|row| row.t_s < at_s);
    &rows[index(from_s + SKIPPED_S)..index(to_s - SKIPPED_S)]
}

/// Largest number of jumps that are candidates; more are of another cause, such as wrong body rates.
const MAX_JUMPS: usize = 8;

/// Smallest scatter that is compared, microtesla.
const MIN_SCATTER_UT: f64 = 0.01;

/// Times at which the field jumps, or its residuals to a fit of one half of the rows change their scatter.
fn candidate_times_s(rows: &[ReplayRow], initial: &FieldCorrection) -> Vec<f64> {
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

#[cfg(test)]
mod tests;
