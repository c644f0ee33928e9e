//! Accuracy after whole flights from which the module retains samples, compared with the Cramér-Rao bound of an optimal
//! selection.

use std::collections::BTreeSet;

use autoswing::calibration::{ConsiderSigmas, Method};
use log_analysis::numbers::{median, quantile};
use serde::Serialize;
use simulator::world::aircraft::VehicleKind;

use super::evaluation::{
    AccuracyPlan, NormalisedErrors, SigmaCoverage, SolveCounts, SolveResults, evaluate_airframes, solve_samples,
};
use super::flight::{FlightPattern, StudyFlight};
use super::random_flight::{ConstantErrorSigmas, RandomFlight, RandomRanges, StudyEnvelope};
use super::{cramer_rao, d_optimal, retention};

/// Results of flights of one pattern.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlightStudyRow {
    /// Vehicle kind.
    pub aircraft: &'static str,
    /// Flight pattern.
    pub pattern: FlightPattern,
    /// Duration, minutes.
    pub minutes: f64,
    /// Number of retained samples, median over the airframes.
    #[serde(rename = "readings")]
    pub retained_samples_median: f64,
    /// Solves, and their error.
    #[serde(flatten)]
    pub solves: SolveResults,
    /// RMS heading error, 90th percentile over the airframes, degrees.
    pub rms_worst_decile_deg: f64,
    /// RMS heading error over the bound of the retained samples, median: loss of the solver.
    #[serde(rename = "kept_ratio_median")]
    pub solver_loss_median: f64,
    /// Bound of the retained samples over the bound of the optimal selection of equal size, median: loss of the
    /// selection.
    #[serde(rename = "choice_ratio_median")]
    pub selection_loss_median: f64,
    /// Bound of the optimal selection of equal size, median over the airframes, degrees.
    pub best_bound_median_deg: f64,
    /// RMS heading error over the bound of the optimal selection, median.
    #[serde(rename = "best_ratio_median")]
    pub error_to_best_bound_median: f64,
    /// RMS heading error over the bound of the optimal selection, 90th percentile.
    #[serde(rename = "best_ratio_worst_decile")]
    pub error_to_best_bound_worst_decile: f64,
    /// Coverage with attitude noise only, which the solver is given.
    pub coverage: SigmaCoverage,
    /// Coverage with the constant errors that the solver considers ([`ConsiderSigmas::DEFAULT`]).
    pub coverage_with_faults: SigmaCoverage,
}

/// Runs the plan for one flight. `on_airframe_done` is called once per airframe, from any thread.
#[must_use]
pub fn run_flight_study(
    flight: StudyFlight,
    plan: AccuracyPlan,
    on_airframe_done: &(dyn Fn() + Sync),
) -> FlightStudyRow {
    let evaluate = |seed| FlightResult::evaluate_trial(flight, seed, plan.noise_draws);
    study_row(flight, &evaluate_airframes(plan, on_airframe_done, evaluate))
}

struct FlightResult {
    retained_count: usize,
    retained_bound_deg: f64,
    best_bound_deg: f64,
    solve_counts: SolveCounts,
    errors: NormalisedErrors,
}

impl FlightResult {
    fn evaluate_trial(flight: StudyFlight, seed: u64, draws: u64) -> Option<Self> {
        let envelope = if flight.kind == VehicleKind::Plane { StudyEnvelope::Banked } else { StudyEnvelope::Tilted };
        let trial = RandomFlight::draw_flight(&RandomRanges::WORST_CASE, seed)
            .with_flight(flight.true_flight(&RandomRanges::WORST_CASE, seed), envelope);
        let record_flight = |draw, error_sigmas| {
            let (samples, source) = trial.record_all_samples(draw, error_sigmas);
            (retention::retain_samples(&samples), source)
        };
        let (recording, _) = record_flight(0, ConstantErrorSigmas::NO_ERRORS);
        let retained_times: BTreeSet<u32> =
            recording.fit_samples().all_samples().map(|sample| sample.time.as_ms()).collect();
        let kept_samples =
            trial.true_samples().filter(|true_sample| retained_times.contains(&true_sample.time.as_ms()));
        let retained_count = retained_times.len();
        let mut flight_result = Self {
            retained_count,
            retained_bound_deg: cramer_rao::bound_deg_of_samples(&trial, kept_samples)?,
            best_bound_deg: d_optimal::bound_rms_deg(&trial, retained_count)?,
            solve_counts: SolveCounts::default(),
            errors: NormalisedErrors::default(),
        };
        for draw in 0..draws {
            let (recording, _) = record_flight(draw, ConstantErrorSigmas::NO_ERRORS);
            let solution =
                solve_samples(Method::MaximumLikelihood, recording.fit_samples(), ConsiderSigmas::DEFAULT).ok();
            flight_result.solve_counts.add_solution(&trial, &recording, solution.as_ref());
            flight_result.errors.add_draw(&trial, draw, |faults| record_flight(draw, faults));
        }
        Some(flight_result)
    }
}

fn study_row(flight: StudyFlight, trials: &[FlightResult]) -> FlightStudyRow {
    let solved_ones = || trials.iter().filter(|trial| trial.solve_counts.completed_solves > 0);
    let ratios: Vec<f64> = solved_ones().map(|trial| trial.solve_counts.rms_deg() / trial.best_bound_deg).collect();
    let worst_decile = |values: Vec<f64>| quantile(values, 0.9).unwrap_or(f64::NAN);
    let [coverage, coverage_with_faults] =
        NormalisedErrors::coverage(&trials.iter().map(|trial| &trial.errors).collect::<Vec<_>>());
    FlightStudyRow {
        aircraft: flight.kind.vehicle_name(),
        pattern: flight.flight_pattern,
        minutes: flight.duration_minutes,
        retained_samples_median: median(trials.iter().map(|trial| trial.retained_count as f64)),
        solves: SolveResults::of_airframes(&trials.iter().map(|trial| &trial.solve_counts).collect::<Vec<_>>()),
        rms_worst_decile_deg: worst_decile(solved_ones().map(|trial| trial.solve_counts.rms_deg()).collect()),
        solver_loss_median: median(solved_ones().map(|trial| trial.solve_counts.rms_deg() / trial.retained_bound_deg)),
        selection_loss_median: median(trials.iter().map(|trial| trial.retained_bound_deg / trial.best_bound_deg)),
        best_bound_median_deg: median(trials.iter().map(|trial| trial.best_bound_deg)),
        error_to_best_bound_median: median(ratios.iter().copied()),
        error_to_best_bound_worst_decile: worst_decile(ratios),
        coverage,
        coverage_with_faults,
    }
}
