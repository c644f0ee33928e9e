//! Accuracy after whole flights from which the module retains samples, compared with the Cramér-Rao bound of an optimal
//! selection.

use std::collections::BTreeSet;

use autoswing::calibration::{ConsiderSigmas, Method};
use log_analysis::numbers::{median, quantile};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde::Serialize;
use simulator::world::aircraft::VehicleKind;

use super::evaluation::{
    AccuracyPlan, COVERAGE_DRAW_INTERVAL, SigmaCoverage, SolveCounts, normalised_errors_after_calibration,
    sigma_coverage, solve_samples,
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
    /// Solves that returned coefficients, percent.
    pub converged_percent: f64,
    /// Solves that an uncalibrated module accepts, percent.
    pub accepted_percent: f64,
    /// Accepted solves with a true RMS error above three times the estimated one.
    #[serde(rename = "wrong")]
    pub wrong_calibrations: u32,
    /// RMS heading error, median over the airframes, degrees.
    pub rms_median_deg: f64,
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
    let trials: Vec<FlightResult> = (plan.seed..plan.seed + plan.airframe_count)
        .into_par_iter()
        .filter_map(|seed| {
            let flight_result = FlightResult::evaluate_trial(flight, seed, plan.noise_draws);
            on_airframe_done();
            flight_result
        })
        .collect();
    study_row(flight, &trials)
}

struct FlightResult {
    retained_count: usize,
    retained_bound_deg: f64,
    best_bound_deg: f64,
    solve_counts: SolveCounts,
    /// Heading errors over their estimated sigmas.
    normalised_errors: Vec<f64>,
    normalised_errors_with_faults: Vec<f64>,
}

impl FlightResult {
    fn evaluate_trial(flight: StudyFlight, seed: u64, draws: u64) -> Option<Self> {
        let envelope = if flight.kind == VehicleKind::Plane { StudyEnvelope::Banked } else { StudyEnvelope::Tilted };
        let trial = RandomFlight::draw_flight(&RandomRanges::WORST_CASE, seed)
            .with_flight(flight.true_flight(&RandomRanges::WORST_CASE, seed), envelope);
        let retained_times: BTreeSet<u32> =
            retention::retain_samples(&trial.record_all_samples(0, ConstantErrorSigmas::NO_ERRORS).0)
                .fit_samples()
                .all_samples()
                .map(|sample| sample.time.as_ms())
                .collect();
        let kept_samples =
            trial.true_samples().filter(|true_sample| retained_times.contains(&true_sample.time.as_ms()));
        let retained_count = retained_times.len();
        let mut flight_result = Self {
            retained_count,
            retained_bound_deg: cramer_rao::bound_deg_of_samples(&trial, kept_samples)?,
            best_bound_deg: d_optimal::bound_rms_deg(&trial, retained_count)?,
            solve_counts: SolveCounts::default(),
            normalised_errors: Vec::new(),
            normalised_errors_with_faults: Vec::new(),
        };
        for draw in 0..draws {
            let recording =
                retention::retain_samples(&trial.record_all_samples(draw, ConstantErrorSigmas::NO_ERRORS).0);
            let solution =
                solve_samples(Method::MaximumLikelihood, recording.fit_samples(), ConsiderSigmas::DEFAULT).ok();
            flight_result.solve_counts.add_solution(&trial, &recording, solution.as_ref());
            if draw % COVERAGE_DRAW_INTERVAL == 0 {
                let record = |faults| {
                    let (samples, source) = trial.record_all_samples(draw, faults);
                    (retention::retain_samples(&samples), source)
                };
                flight_result.normalised_errors.extend(normalised_errors_after_calibration(
                    &trial,
                    ConsiderSigmas::ZERO,
                    record,
                ));
                flight_result.normalised_errors_with_faults.extend(normalised_errors_after_calibration(
                    &trial,
                    ConsiderSigmas::DEFAULT,
                    record,
                ));
            }
        }
        Some(flight_result)
    }
}

fn study_row(flight: StudyFlight, trials: &[FlightResult]) -> FlightStudyRow {
    let total_count = |count_of: fn(&SolveCounts) -> u32| {
        trials.iter().map(|flight_result| count_of(&flight_result.solve_counts)).sum::<u32>()
    };
    let (solved_count, refused_count) = (
        total_count(|solve_counts| solve_counts.completed_solves),
        total_count(|solve_counts| solve_counts.refused_solves),
    );
    let percent = |solve_count: u32| 100.0 * f64::from(solve_count) / f64::from((solved_count + refused_count).max(1));
    let solved_ones = || trials.iter().filter(|flight_result| flight_result.solve_counts.completed_solves > 0);
    let rms_deg = |solve_count| {
        quantile(solved_ones().map(|flight_result| flight_result.solve_counts.rms_deg()), solve_count)
            .unwrap_or(f64::NAN)
    };
    let ratios =
        || solved_ones().map(|flight_result| flight_result.solve_counts.rms_deg() / flight_result.best_bound_deg);
    let kept_ratios =
        solved_ones().map(|flight_result| flight_result.solve_counts.rms_deg() / flight_result.retained_bound_deg);
    let all_of = |errors: fn(&FlightResult) -> &Vec<f64>| trials.iter().flat_map(errors).copied().collect::<Vec<f64>>();
    FlightStudyRow {
        aircraft: flight.kind.vehicle_name(),
        pattern: flight.flight_pattern,
        minutes: flight.duration_minutes,
        retained_samples_median: median(trials.iter().map(|flight_result| flight_result.retained_count as f64)),
        converged_percent: percent(solved_count),
        accepted_percent: percent(total_count(|solve_counts| solve_counts.accepted_solves)),
        wrong_calibrations: total_count(|solve_counts| solve_counts.wrong_solves),
        rms_median_deg: rms_deg(0.5),
        rms_worst_decile_deg: rms_deg(0.9),
        solver_loss_median: median(kept_ratios),
        selection_loss_median: median(
            trials.iter().map(|flight_result| flight_result.retained_bound_deg / flight_result.best_bound_deg),
        ),
        best_bound_median_deg: median(trials.iter().map(|flight_result| flight_result.best_bound_deg)),
        error_to_best_bound_median: median(ratios()),
        error_to_best_bound_worst_decile: quantile(ratios(), 0.9).unwrap_or(f64::NAN),
        coverage: sigma_coverage(&all_of(|flight_result| &flight_result.normalised_errors)),
        coverage_with_faults: sigma_coverage(&all_of(|flight_result| &flight_result.normalised_errors_with_faults)),
    }
}
