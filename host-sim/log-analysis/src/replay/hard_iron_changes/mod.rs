//! Changes of hard iron in a flight, each confirmed by an independent method.

mod turn_confirmation;

use autoswing::calibration::Solution;
use nalgebra::Vector3;

use super::data_loss::measured_turns;
use super::hard_iron_jump::{
    FittedCorrection, absolute_residuals_ut, cancel_each_other, find_jump_times_s, find_jumps,
};
use super::hard_iron_step::{HardIronStep, find_step};
use super::replay_run::solve_all_rows;
use super::row_solve::solved_correction;
use super::{data_loss, rows};
use crate::log::{FieldCorrection, LoggedFlight};
use crate::numbers::median;
use crate::replay::row::{ReplayRow, split_at_time};
use crate::replay::row_headings::is_monitored;
use turn_confirmation::is_change_possible;

/// Largest number of changes reported.
const MAX_CHANGES: usize = 8;

/// Largest expected error of a calibration that can confirm a change, degrees RMS: that of the module's acceptance.
const MAX_EXPECTED_ERROR_DEG: f32 = 3.0;

/// Smallest effect of a cause on a level heading, degrees: less is within the error of a good calibration.
pub(super) const MIN_HEADING_EFFECT_DEG: f64 = 1.0;

/// Smallest horizontal part of a change, in its standard deviations. That the field changed at that time is known from
/// all three components.
const MIN_HORIZONTAL_SIGMAS: f64 = 5.0;

/// Largest difference between a step and its confirmation, relative to the step.
const MAX_RELATIVE_DISAGREEMENT: f64 = 0.5;

/// Least ratio of the residuals without a step to those with it that confirms a step.
const MIN_RESIDUAL_RATIO: f64 = 2.0;

/// A confirmed change of hard iron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoggedHardIronChange {
    /// Time, size and uncertainty of the change.
    pub hard_iron_step: HardIronStep,
    /// Largest effect on a level heading, degrees.
    pub heading_effect_deg: f64,
}

/// Largest difference in time between a jump and the step that refines it, seconds.
const MAX_REFINEMENT_SHIFT_S: f64 = 1.5;

/// Start of a temporary change, seconds: that of the change before the last, if the last one cancels it.
#[must_use]
pub fn temporary_change_start_s(changes: &[LoggedHardIronChange]) -> Option<f64> {
    let [.., first, last] = changes else { return None };
    let [one, other] = [first, last].map(|change| change.hard_iron_step.step_ut);
    cancel_each_other(&one, &other).then_some(first.hard_iron_step.time_s)
}

/// Finds the changes of hard iron, in order of time: jumps, and in the parts between them steps, by splitting a part at
/// the most significant one first. `initial` is a correction that fits most of the rows; `total_ut` the strength of the
/// Earth's field.
pub fn find_changes(
    rows: &[ReplayRow],
    flight: &LoggedFlight,
    initial: &FieldCorrection,
    total_ut: f64,
) -> Vec<LoggedHardIronChange> {
    let (mut found, correction) = refined_jumps(rows, flight, initial);
    for part in split_at_changes(rows, &found) {
        let solution = if found.is_empty() { None } else { solve_all_rows(part).filter(is_accurate) };
        find_steps(part, &solution.as_ref().map_or(correction, solved_correction), total_ut, &mut found);
    }
    found.sort_by(|a, b| a.hard_iron_step.time_s.total_cmp(&b.hard_iron_step.time_s));
    if found.is_empty() {
        return found;
    }
    let turns = measured_turns(flight);
    let parts = split_at_changes(rows, &found);
    let is_possible = |index: usize| {
        let around = [parts[index], parts[index + 1]].concat();
        is_change_possible(flight, &around, &turns, &found[index].hard_iron_step, initial)
    };
    (0..found.len()).filter(|index| is_possible(*index)).map(|index| found[index]).collect()
}

fn find_steps(rows: &[ReplayRow], initial: &FieldCorrection, total_ut: f64, changes: &mut Vec<LoggedHardIronChange>) {
    if changes.len() >= MAX_CHANGES {
        return;
    }
    let Some(step) = find_step(rows, initial).filter(|step| step.step_ut.norm() < total_ut) else { return };
    let solutions = split_at_time(rows, step.time_s).map(solve_all_rows);
    // The initial correction fits the rows neither before nor after the change; from a fit to one side, the estimated
    // step converges to its full size.
    let best_solution =
        solutions.iter().flatten().min_by(|a, b| expected_error_deg(a).total_cmp(&expected_error_deg(b)));
    let step = best_solution.and_then(|solution| find_step(rows, &solved_correction(solution))).unwrap_or(step);
    let parts = split_at_time(rows, step.time_s);
    let Some(heading_effect_deg) = confirmed_heading_effect_deg(&step, parts, &solutions) else { return };
    changes.push(LoggedHardIronChange { hard_iron_step: step, heading_effect_deg });
    for (part, solution) in parts.into_iter().zip(&solutions) {
        if let Some(solution) = solution {
            find_steps(part, &solved_correction(solution), total_ut, changes);
        }
    }
}

fn is_accurate(solution: &Solution) -> bool {
    expected_error_deg(solution) <= MAX_EXPECTED_ERROR_DEG
}

fn expected_error_deg(solution: &Solution) -> f32 {
    solution.quality.expected_rms_deg
}

/// Parts of the rows between times in order, seconds.
fn split_at_times(rows: &[ReplayRow], times_s: impl Iterator<Item = f64>) -> Vec<&[ReplayRow]> {
    let mut rest = rows;
    let mut parts: Vec<&[ReplayRow]> = times_s
        .map(|at_s| {
            let [before, after] = split_at_time(rest, at_s);
            rest = after;
            before
        })
        .collect();
    parts.push(rest);
    parts
}

fn split_at_changes<'rows>(rows: &'rows [ReplayRow], changes: &[LoggedHardIronChange]) -> Vec<&'rows [ReplayRow]> {
    split_at_times(rows, changes.iter().map(|change| change.hard_iron_step.time_s))
}

/// Jumps that affect headings, each refined by a step of the rows around it, and the correction used to find them,
/// fitted to the best observed part between jumps.
fn refined_jumps(
    rows: &[ReplayRow],
    flight: &LoggedFlight,
    initial: &FieldCorrection,
) -> (Vec<LoggedHardIronChange>, FieldCorrection) {
    let has_rates = data_loss::has_integrable_rates(flight);
    if !has_rates || !rows::median_step_s(rows).is_some_and(is_monitored) {
        return (Vec::new(), *initial);
    }
    let parts = split_at_times(rows, find_jump_times_s(rows, initial).into_iter());
    let solved = parts.into_iter().filter_map(|part| Some((part, solve_all_rows(part).filter(is_accurate)?)));
    let Some((fitted, solution)) =
        solved.min_by(|(_, a), (_, b)| expected_error_deg(a).total_cmp(&expected_error_deg(b)))
    else {
        return (Vec::new(), *initial);
    };
    let correction = solved_correction(&solution);
    let fitted_range_s = fitted.first().zip(fitted.last()).map_or([0.0; 2], |(first, last)| [first.t_s, last.t_s]);
    let refined_jumps = find_jumps(
        rows,
        &FittedCorrection {
            correction,
            fitted_range_s,
            earth_total_and_vertical_ut: earth_total_and_vertical_ut(&solution),
        },
    );
    if refined_jumps.len() > MAX_CHANGES {
        return (Vec::new(), *initial);
    }
    let parts = split_at_times(rows, refined_jumps.iter().map(|jump| jump.time_s));
    let changes = refined_jumps.iter().enumerate().filter_map(|(i, jump)| {
        let around = [parts[i], parts[i + 1]].concat();
        let step = find_step(&around, &correction).filter(|step| is_same_change(step, jump)).unwrap_or(*jump);
        let heading_effect_deg = step_effect_deg(&step, &solution)?;
        Some(LoggedHardIronChange { hard_iron_step: step, heading_effect_deg })
    });
    let changes: Vec<LoggedHardIronChange> = changes.collect();
    let correction = if changes.is_empty() { *initial } else { correction };
    (changes, correction)
}

/// Effect of a step on a level heading, degrees, if it is significant and confirmed: under the calibration of the better
/// observed part of the flight, the step halves the residuals of the other part.
fn confirmed_heading_effect_deg(
    step: &HardIronStep,
    [rows_before, rows_after]: [&[ReplayRow]; 2],
    [solution_before, solution_after]: &[Option<Solution>; 2],
) -> Option<f64> {
    let error_deg = |solution: &Option<Solution>| solution.as_ref().map_or(f32::INFINITY, expected_error_deg);
    let (solution, other_rows, sign) = if error_deg(solution_before) <= error_deg(solution_after) {
        (solution_before, rows_after, 1.0)
    } else {
        (solution_after, rows_before, -1.0)
    };
    let solution = solution.as_ref().filter(|solution| is_accurate(solution))?;
    let without_step = solved_correction(solution);
    let with_step = FieldCorrection { hard_iron_ut: without_step.hard_iron_ut + step.step_ut * sign, ..without_step };
    let [residual_without_step_ut, residual_with_step_ut] =
        [without_step, with_step].map(|correction| median_residual_ut(other_rows, &correction, solution));
    let is_confirmed = residual_without_step_ut > MIN_RESIDUAL_RATIO * residual_with_step_ut;
    step_effect_deg(step, solution).filter(|_| is_confirmed)
}

/// Largest effect of a step on a level heading, degrees, if significant. Horizontal components only: on a single heading
/// the component across it is hardly observable, and a significant vertical component changes no heading.
fn step_effect_deg(step: &HardIronStep, solution: &Solution) -> Option<f64> {
    let change_ut = solution.calibration.w_matrix().map(f64::from) * step.step_ut;
    let horizontal_field_ut = solution.calibration.total_ut * libm::cosf(solution.calibration.inclination_rad);
    let is_significant = change_ut.xy().norm() > MIN_HORIZONTAL_SIGMAS * step.sigma_ut.xy().norm();
    let heading_effect_deg = heading_effect_deg(change_ut, horizontal_field_ut.into());
    (is_significant && heading_effect_deg >= MIN_HEADING_EFFECT_DEG).then_some(heading_effect_deg)
}

/// Largest effect of a disturbance on a level heading, degrees.
pub(super) fn heading_effect_deg(disturbance_ut: Vector3<f64>, horizontal_ut: f64) -> f64 {
    libm::atan(disturbance_ut.xy().norm() / horizontal_ut).to_degrees()
}

/// Whether a step is the same change as a jump.
fn is_same_change(step: &HardIronStep, jump: &HardIronStep) -> bool {
    let is_same_size = (step.step_ut - jump.step_ut).norm() < MAX_RELATIVE_DISAGREEMENT * jump.step_ut.norm();
    (step.time_s - jump.time_s).abs() < MAX_REFINEMENT_SHIFT_S && is_same_size
}

/// Median residual of strength and vertical component to a calibration, microtesla.
fn median_residual_ut(rows: &[ReplayRow], correction: &FieldCorrection, solution: &Solution) -> f64 {
    let earth_total_and_vertical_ut = earth_total_and_vertical_ut(solution);
    let usable = rows.iter().filter(|row| row.is_usable);
    median(
        usable
            .flat_map(|row| absolute_residuals_ut(row, &row.corrected_field(correction), &earth_total_and_vertical_ut)),
    )
}

/// Strength and vertical component of the Earth's field by a calibration, microtesla.
fn earth_total_and_vertical_ut(solution: &Solution) -> [f64; 2] {
    let total_ut = f64::from(solution.calibration.total_ut);
    [total_ut, total_ut * libm::sin(f64::from(solution.calibration.inclination_rad))]
}

#[cfg(test)]
mod tests;
