//! Changes of hard iron in a flight, each confirmed by an independent method.

use autoswing::calibration::Solution;
use nalgebra::Vector3;

use super::hard_iron_step::{HardIronStep, MIN_SIGMAS, find_step};
use super::replay_run::solve_all_rows;
use super::row_headings::monitored_changes_ut;
use super::row_solve::solved_correction;
use super::{ReplayRow, is_monitored, rows};
use crate::log::{FieldCorrection, Flight};
use crate::numbers::median;

/// Largest number of changes reported.
const MAX_CHANGES: usize = 8;

/// Largest expected error of a calibration that can confirm a change, degrees RMS: that of the module's acceptance.
const MAX_EXPECTED_DEG: f32 = 3.0;

/// Smallest effect of a change on a level heading, degrees: less is within the error of a good calibration.
const MIN_HEADING_EFFECT_DEG: f64 = 1.0;

/// Largest difference between a step and its confirmation, relative to the step.
const MAX_DISAGREEMENT: f64 = 0.5;

/// Shortest part that the monitor is run on, seconds: it reports a change after 15 s without a failed gate.
const MIN_MONITORED_S: f64 = 30.0;

/// Least ratio of the residuals without the step to those with it, where the monitor does not report it.
const MIN_RESIDUAL_RATIO: f64 = 2.0;

/// A confirmed change of hard iron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardIronChange {
    /// Time, size and uncertainty of the change.
    pub hard_iron_step: HardIronStep,
    /// Largest effect on a level heading, degrees.
    pub heading_effect_deg: f64,
}

/// Finds the changes of hard iron, in order of time, by splitting the flight at the most significant one first.
/// `initial` is a correction that fits most of the rows; `total_ut` the strength of the Earth's field.
#[must_use]
pub fn find_changes(
    rows: &[ReplayRow],
    flight: &Flight,
    initial: &FieldCorrection,
    total_ut: f64,
) -> Vec<HardIronChange> {
    let mut changes = Vec::new();
    search_changes(&ChangeSearch { flight, total_ut }, rows, initial, &mut changes);
    changes.sort_by(|left_change, right_change| {
        left_change.hard_iron_step.time_s.total_cmp(&right_change.hard_iron_step.time_s)
    });
    changes
}

struct ChangeSearch<'a> {
    flight: &'a Flight,
    total_ut: f64,
}

fn search_changes(
    search_of: &ChangeSearch<'_>,
    rows: &[ReplayRow],
    initial: &FieldCorrection,
    changes: &mut Vec<HardIronChange>,
) {
    if changes.len() >= MAX_CHANGES {
        return;
    }
    let Some(step) = find_step(rows, initial).filter(|step| step.size_ut() < search_of.total_ut) else { return };
    let split = |step: &HardIronStep| {
        let (before, after) = rows.split_at(rows.partition_point(|row| row.t_s < step.time_s));
        [before, after]
    };
    let solutions = split(&step).map(solve_all_rows);
    // The initial correction fits the rows neither before nor after the change; from a fit to one side, the estimated
    // step converges to its full size.
    let best_solution = solutions.iter().flatten().min_by(|left_solution, right_solution| {
        left_solution.quality.expected_rms_deg.total_cmp(&right_solution.quality.expected_rms_deg)
    });
    let step = best_solution.and_then(|solution| find_step(rows, &solved_correction(solution))).unwrap_or(step);
    let parts = split(&step);
    let Some(bend_deg) = search_of.confirmed_heading_effect_deg(&step, parts, &solutions) else { return };
    changes.push(HardIronChange { hard_iron_step: step, heading_effect_deg: bend_deg });
    for (part, solution) in parts.into_iter().zip(&solutions) {
        if let Some(solution) = solution {
            search_changes(search_of, part, &solved_correction(solution), changes);
        }
    }
}

impl ChangeSearch<'_> {
    /// Effect of a step on a level heading, degrees, if it is significant and confirmed: the monitor, started with the
    /// calibration of the better observed part of the flight, detects it in the other, or the step halves the
    /// residuals of that other part under the calibration.
    fn confirmed_heading_effect_deg(
        &self,
        step: &HardIronStep,
        [before, after]: [&[ReplayRow]; 2],
        [of_before, of_after]: &[Option<Solution>; 2],
    ) -> Option<f64> {
        let expected_deg =
            |solution: &Option<Solution>| solution.as_ref().map_or(f32::INFINITY, |s| s.quality.expected_rms_deg);
        let (solution, other, sign) = if expected_deg(of_before) <= expected_deg(of_after) {
            (of_before, after, 1.0)
        } else {
            (of_after, before, -1.0)
        };
        let solution = solution.as_ref().filter(|s| s.quality.expected_rms_deg <= MAX_EXPECTED_DEG)?;
        let moved = Vector3::from(step.step_ut);
        let change = solution.calibration.w_matrix().map(f64::from) * moved * sign;
        let duration_s = other.last()?.t_s - other.first()?.t_s;
        let is_monitored = rows::median_step_s(other).is_some_and(is_monitored) && duration_s >= MIN_MONITORED_S;
        let is_detected = is_monitored
            && monitored_changes_ut(other, self.flight, solution).iter().any(|found| is_confirmed_by(found, &change));
        let unmoved = solved_correction(solution);
        let moved = FieldCorrection { hard_iron_ut: unmoved.hard_iron_ut + moved * sign, ..unmoved };
        let [without, with] = [unmoved, moved].map(|correction| median_residual_ut(other, &correction, solution));
        let is_confirmed = is_detected || without > MIN_RESIDUAL_RATIO * with;
        // Horizontal components only: on a single heading the step's component across it is hardly observable, and a
        // significant vertical component changes no heading.
        let is_bend_significant = change.xy().norm() > MIN_SIGMAS * Vector3::from(step.sigma_ut).xy().norm();
        let horizontal_ut = f64::from(solution.calibration.total_ut * libm::cosf(solution.calibration.inclination_rad));
        let bend_deg = libm::atan(change.xy().norm() / horizontal_ut).to_degrees();
        (is_confirmed && is_bend_significant && bend_deg >= MIN_HEADING_EFFECT_DEG).then_some(bend_deg)
    }
}

/// Median residual of strength and vertical component to a calibration, microtesla.
fn median_residual_ut(rows: &[ReplayRow], correction: &FieldCorrection, solution: &Solution) -> f64 {
    let total_ut = f64::from(solution.calibration.total_ut);
    let vertical_ut = total_ut * libm::sin(f64::from(solution.calibration.inclination_rad));
    let usable = rows.iter().filter(|row| row.is_usable);
    median(usable.flat_map(|row| {
        let field = row.corrected_field(correction);
        [field.norm() - total_ut, row.down_in_body().dot(&field) - vertical_ut].map(f64::abs)
    }))
}

fn is_confirmed_by(estimate: &Vector3<f64>, expected: &Vector3<f64>) -> bool {
    (estimate - expected).norm() < MAX_DISAGREEMENT * expected.norm()
}
