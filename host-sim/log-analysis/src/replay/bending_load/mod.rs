//! What bends the field of a compass: the logged load that explains the field best beside the fit, and a load with a
//! constant period.
//!
//! Strength and vertical component of the corrected field are regressed on each load. A load is named if it is
//! significant, bends headings, explains each half of the flight by the other, and explains more than any motion of the
//! aircraft does.

mod candidates;
mod finding;
mod periodic;
mod regression;

pub use finding::{BendingCause, BendingLoad};

use nalgebra::{DVector, Vector3};

use candidates::{LoadCandidate, load_candidates, load_name, motion_candidates};
use periodic::{corrected_sigmas, find_line};
use regression::{LoadFit, ResidualModel};

use super::field_change::{HardIronChange, MIN_HEADING_EFFECT_DEG, heading_effect_deg};
use super::row::ReplayRow;
use crate::log::{FieldCorrection, LoadSource, LoggedFlight};
use crate::numbers::{mean, square, thinned};

/// Largest number of rows of the regression; more are thinned.
const MAX_ROWS: usize = 5000;

/// Least significance, standard deviations.
const MIN_SIGMAS: f64 = 5.0;

/// Least part of the squared residuals of a half that the coefficients of the other half explain.
const MIN_EXPLAINED_FRACTION: f64 = 0.1;

/// Largest squared correlation with a motion of the aircraft: a load that follows it as closely cannot be separated
/// from it, as the current of a rover on slopes from its pitch.
const MAX_MOTION_CORRELATION: f64 = 0.9;

/// Least advantage of one motor, or of a pair, over the others and all together, standard deviations.
const MIN_ADVANTAGE_SIGMAS: f64 = 3.0;

/// Fits of a load after the first, each with the residuals clipped around the load of the one before.
const REFINEMENTS: usize = 3;

/// Loads that bend the field in the usable rows: at most one logged, and one periodic. `initial` is a correction that
/// fits most of the rows.
pub fn find_bending_loads(
    rows: &[ReplayRow],
    flight: &LoggedFlight,
    initial: &FieldCorrection,
    changes: &[HardIronChange],
) -> Vec<BendingLoad> {
    let usable: Vec<ReplayRow> = rows.iter().filter(|row| row.is_usable).copied().collect();
    let thinned = thinned(&usable, MAX_ROWS);
    let change_times_s: Vec<f64> = changes.iter().map(|change| change.time_s).collect();
    let model = |rows: &[ReplayRow]| ResidualModel::new(rows, initial, &change_times_s);
    let around = |values: &[f64], coefficient_ut: Vector3<f64>| {
        ResidualModel::around_load(&thinned, initial, &change_times_s, values, coefficient_ut)
    };
    let logged = model(&thinned).and_then(|model| find_logged_load(&model, &around, flight, &thinned));
    let periodic = model(&usable).and_then(|model| find_periodic_load(&model, flight, &usable, logged.as_ref()));
    logged.map(|(load, _)| load).into_iter().chain(periodic).collect()
}

/// A load, and the sources whose values its size is that of.
type NamedLoad = (BendingLoad, Vec<LoadSource>);

/// Model around a load with these values and this coefficient.
type ModelAroundLoad<'a> = dyn Fn(&[f64], Vector3<f64>) -> Option<ResidualModel> + 'a;

fn find_logged_load(
    model: &ResidualModel,
    around: &ModelAroundLoad<'_>,
    flight: &LoggedFlight,
    rows: &[ReplayRow],
) -> Option<NamedLoad> {
    let candidates = load_candidates(flight, rows);
    let count = candidates.len() as f64;
    let fits = candidates.into_iter().filter_map(|candidate| Some((model.fit_load(&candidate.values)?, candidate)));
    let fits: Vec<(LoadFit, LoadCandidate)> = fits.collect();
    let (fit, candidate) = fits.iter().max_by(|(a, _), (b, _)| a.reduction.total_cmp(&b.reduction))?;
    // Motors that work together cannot be told apart, unless one of them, or a pair, is clearly the best.
    let mut rivals =
        fits.iter().filter(|(_, other)| other.family == candidate.family && other.sources != candidate.sources);
    let is_certain = rivals.all(|(other, _)| model.advantage_sigmas(fit, other) >= MIN_ADVANTAGE_SIGMAS);
    let named = if is_certain || candidate.family.is_empty() { &candidate.sources } else { &candidate.family };
    let (fit, sources) = (fit.clone(), named.clone());
    let motions = motion_candidates(rows);
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
    let load = BendingLoad {
        size_ut: (fit.coefficient_ut * reference).norm(),
        heading_effect_deg: heading_effect_deg(fit.coefficient_ut * reference, model.horizontal_ut),
        sigmas: corrected_sigmas(fit.sigmas, count),
        cause: BendingCause::Logged {
            name: load_name(flight, &sources),
            sources,
            at_current_a: candidate.sources.iter().all(|source| source.is_current()).then_some(reference),
        },
    };
    let is_cause =
        is_named(&load) && explained_fraction(&model, &fit) > explained_by_motion && holds_in_halves(&model, &fit);
    is_cause.then(|| (load, candidate.sources.clone()))
}

fn squared_correlation(one: &[f64], other: &[f64]) -> f64 {
    let [one, other] =
        [one, other].map(|values| DVector::from_column_slice(values).add_scalar(-mean(values.iter().copied())));
    square(one.dot(&other)) / (one.norm_squared() * other.norm_squared())
}

/// Fit of a load with the residuals clipped around it, and its model.
fn refined_fit(around: &ModelAroundLoad<'_>, values: &[f64], first: LoadFit) -> Option<(ResidualModel, LoadFit)> {
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

fn is_named(load: &BendingLoad) -> bool {
    load.sigmas >= MIN_SIGMAS && load.heading_effect_deg >= MIN_HEADING_EFFECT_DEG
}

fn holds_in_halves(model: &ResidualModel, fit: &LoadFit) -> bool {
    let least = MIN_EXPLAINED_FRACTION * model.residuals.norm_squared() / 2.0;
    fit.reductions_of_halves.iter().all(|reduction| *reduction > least)
}

fn find_periodic_load(
    model: &ResidualModel,
    flight: &LoggedFlight,
    rows: &[ReplayRow],
    logged: Option<&NamedLoad>,
) -> Option<BendingLoad> {
    let left = logged.and_then(|(_, sources)| {
        let candidates = load_candidates(flight, rows);
        let same = candidates.into_iter().find(|other| other.sources == *sources)?;
        Some(model.fit_load(&same.values)?.residuals)
    });
    let residuals = left.as_ref().unwrap_or(&model.residuals);
    let line = find_line(rows, residuals.as_slice(), &model.directions, MIN_SIGMAS)?;
    let load = BendingLoad {
        cause: BendingCause::Periodic(line.period_s),
        size_ut: line.amplitude_ut.norm(),
        heading_effect_deg: heading_effect_deg(line.amplitude_ut, model.horizontal_ut),
        sigmas: line.sigmas,
    };
    is_named(&load).then_some(load)
}

#[cfg(test)]
mod tests;
