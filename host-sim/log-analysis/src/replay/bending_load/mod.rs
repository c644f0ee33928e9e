//! What bends the field of a compass: the logged load that explains the field best beside the fit.
//!
//! Strength and vertical component of the corrected field are regressed on each load. A load is named if it is
//! significant, bends headings, explains each half of the flight by the other, and explains more than any motion of the
//! aircraft does.

mod candidates;
mod finding;
mod output_role;
mod regression;

pub use finding::BendingLoad;

use nalgebra::Vector3;

use candidates::{load_candidates, load_name, motion_candidates};
use regression::{LoadFit, ResidualModel};

use super::hard_iron_changes::LoggedHardIronChange;
use super::row::ReplayRow;
use crate::log::{FieldCorrection, LoggedFlight};

/// Largest number of rows of the regression; more are thinned.
const MAX_ROWS: usize = 5000;

/// Least significance, standard deviations.
const MIN_SIGMAS: f64 = 5.0;

/// Least effect on a level heading, degrees.
const MIN_HEADING_EFFECT_DEG: f64 = 1.0;

/// Least part of the squared residuals of a half that the coefficients of the other half explain.
const MIN_EXPLAINED_FRACTION: f64 = 0.1;

/// Largest squared correlation with a motion of the aircraft: a load that follows it as closely cannot be separated
/// from it, as the current of a rover on slopes from its pitch.
const MAX_MOTION_CORRELATION: f64 = 0.9;

/// Fits of a load after the first, each with the residuals clipped around the load of the one before.
const REFINEMENTS: usize = 3;

/// The logged load that bends the field in the usable rows. `initial` is a correction that fits most of the rows.
#[must_use]
pub fn find_bending_load(
    rows: &[ReplayRow],
    flight: &LoggedFlight,
    initial: &FieldCorrection,
    changes: &[LoggedHardIronChange],
) -> Option<BendingLoad> {
    let usable: Vec<&ReplayRow> = rows.iter().filter(|row| row.is_usable).collect();
    let rows: Vec<ReplayRow> = usable.iter().step_by(usable.len().div_ceil(MAX_ROWS).max(1)).map(|row| **row).collect();
    let change_times_s: Vec<f64> = changes.iter().map(|change| change.hard_iron_step.time_s).collect();
    let model = ResidualModel::new(&rows, initial, &change_times_s)?;
    let around = |values: &[f64], coefficient_ut: Vector3<f64>| {
        ResidualModel::around_load(&rows, initial, &change_times_s, values, coefficient_ut)
    };
    let candidates = load_candidates(flight, &rows);
    let candidate_count = candidates.len() as f64;
    let fits = candidates.into_iter().filter_map(|candidate| Some((model.fit_load(&candidate.values)?, candidate)));
    let (fit, candidate) = fits.max_by(|(a, _), (b, _)| a.reduction.total_cmp(&b.reduction))?;
    let motions = motion_candidates(&rows);
    if motions.iter().any(|values| squared_correlation(values, &candidate.values) > MAX_MOTION_CORRELATION) {
        return None;
    }
    let motions = motions.into_iter().filter_map(|values| Some((model.fit_load(&values)?, values)));
    let motion = motions.max_by(|(a, _), (b, _)| a.reduction.total_cmp(&b.reduction));
    if motion.as_ref().is_some_and(|(motion, _)| motion.reduction >= fit.reduction) {
        return None;
    }
    let (model, fit) = refined_fit(around, &candidate.values, fit)?;
    let by_motion = motion.and_then(|(motion, values)| refined_fit(around, &values, motion));
    let explained_by_motion = by_motion.map_or(0.0, |(model, motion)| explained_fraction(&model, &motion));
    let reference = candidate.reference_value();
    let size_ut = fit.coefficient_ut * reference;
    let load = BendingLoad {
        name: load_name(flight, &candidate.sources),
        at_current_a: candidate.is_current().then_some(reference),
        sources: candidate.sources,
        size_ut: size_ut.norm(),
        heading_effect_deg: libm::atan(size_ut.xy().norm() / model.horizontal_ut).to_degrees(),
        sigmas: corrected_sigmas(fit.sigmas, candidate_count),
    };
    let is_cause = load.sigmas >= MIN_SIGMAS
        && load.heading_effect_deg >= MIN_HEADING_EFFECT_DEG
        && explained_fraction(&model, &fit) > explained_by_motion
        && holds_in_halves(&model, &fit);
    is_cause.then_some(load)
}

/// Standard deviations that remain after `count` trials: the tail of a normal distribution falls as `exp(-z^2 / 2)`.
fn corrected_sigmas(sigmas: f64, count: f64) -> f64 {
    let squared = sigmas * sigmas.max(0.0) - 2.0 * libm::log(count.max(1.0));
    squared.max(0.0).sqrt()
}

fn squared_correlation(one: &[f64], other: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let [one_mean, other_mean] = [mean(one), mean(other)];
    let [products, one_squares, other_squares] = one.iter().zip(other).fold([0.0; 3], |[xy, xx, yy], (x, y)| {
        let [x, y] = [x - one_mean, y - other_mean];
        [xy + x * y, xx + x * x, yy + y * y]
    });
    products * products / (one_squares * other_squares)
}

/// Fit of a load with the residuals clipped around it, and its model. `around` makes the model around a load with these
/// values and this coefficient.
fn refined_fit(
    around: impl Fn(&[f64], Vector3<f64>) -> Option<ResidualModel>,
    values: &[f64],
    first: LoadFit,
) -> Option<(ResidualModel, LoadFit)> {
    let mut refined = (around(values, first.coefficient_ut)?, first);
    for _ in 0..REFINEMENTS {
        refined.1 = refined.0.fit_load(values)?;
        refined.0 = around(values, refined.1.coefficient_ut)?;
    }
    Some(refined)
}

/// Part of the squared residuals that a load explains.
fn explained_fraction(model: &ResidualModel, fit: &LoadFit) -> f64 {
    fit.reduction / model.residuals.norm_squared()
}

fn holds_in_halves(model: &ResidualModel, fit: &LoadFit) -> bool {
    let least = MIN_EXPLAINED_FRACTION * model.residuals.norm_squared() / 2.0;
    fit.reductions_of_halves.iter().all(|reduction| *reduction > least)
}

#[cfg(test)]
mod tests;
