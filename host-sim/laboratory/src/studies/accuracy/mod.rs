//! Accuracy study: heading errors of the calibration methods relative to the Cramér-Rao bound.
//!
//! Random airframes, places, flights and instruments, each with many noise realisations, are solved by every method.
//! Results are the RMS heading error over the Cramér-Rao bound and the coverage of the estimated heading sigma.
//!
//! This study uses all samples of turns. The study of whole flights uses the samples that the module retains; its
//! reference is a D-optimal selection.

pub mod cramer_rao;
pub mod d_optimal;
mod evaluation;
pub mod flight;
pub mod flight_study;
pub mod random_flight;
pub mod retention;

use autoswing::calibration::{ConsiderSigmas, Method};
use serde::Serialize;

pub use evaluation::{AccuracyPlan, SigmaCoverage, SolveResults};

use evaluation::{NormalisedErrors, SolveCounts, evaluate_airframes, solve_samples};
use random_flight::{ConstantErrorSigmas, RandomFlight, RandomRanges};

use log_analysis::numbers::{median, quantile};

/// Results of a method.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MethodResult {
    /// Method name.
    pub method: &'static str,
    /// Solves, and their error.
    #[serde(flatten)]
    pub solves: SolveResults,
    /// RMS heading error over the bound, median over the airframes.
    pub ratio_median: f64,
    /// RMS heading error over the bound, 90th percentile over the airframes.
    pub ratio_worst_decile: f64,
}

/// Results of the study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AccuracyResult {
    /// Cramér-Rao bound, median over the airframes, degrees.
    pub bound_median_deg: f64,
    /// Results by method.
    pub methods: Vec<MethodResult>,
    /// Coverage with attitude noise only, which the solver is given.
    pub coverage: SigmaCoverage,
    /// Coverage with the constant errors that the solver considers ([`ConsiderSigmas::DEFAULT`]).
    pub coverage_with_faults: SigmaCoverage,
}

const COMPARED_METHODS: [Method; 3] = [Method::MaximumLikelihood, Method::TwoPlane, Method::FourEllipse];

/// Runs the study. `on_airframe_done` is called once per airframe, from any thread.
#[must_use]
pub fn run_accuracy_study(plan: AccuracyPlan, on_airframe_done: &(dyn Fn() + Sync)) -> AccuracyResult {
    let trials = evaluate_airframes(plan, on_airframe_done, |seed| {
        let trial = RandomFlight::draw_flight(&RandomRanges::WORST_CASE, seed);
        AirframeResult::evaluate_airframe(&trial, plan.noise_draws)
    });
    let [coverage, coverage_with_faults] =
        NormalisedErrors::coverage(&trials.iter().map(|trial| &trial.errors).collect::<Vec<_>>());
    AccuracyResult {
        bound_median_deg: median(trials.iter().map(|trial| trial.bound_deg)),
        methods: COMPARED_METHODS.iter().enumerate().map(|(i, &method)| method_result(&trials, i, method)).collect(),
        coverage,
        coverage_with_faults,
    }
}

struct AirframeResult {
    bound_deg: f64,
    solve_counts_by_method: [SolveCounts; COMPARED_METHODS.len()],
    errors: NormalisedErrors,
}

impl AirframeResult {
    fn evaluate_airframe(trial: &RandomFlight, draws: u64) -> Option<Self> {
        let mut airframe_result = Self {
            bound_deg: cramer_rao::bound_rms_deg(trial)?,
            solve_counts_by_method: [SolveCounts::default(); COMPARED_METHODS.len()],
            errors: NormalisedErrors::default(),
        };
        for draw in 0..draws {
            let (recording, _) = trial.record_flight(draw, ConstantErrorSigmas::NO_ERRORS);
            for (counts, method) in airframe_result.solve_counts_by_method.iter_mut().zip(COMPARED_METHODS) {
                counts.add_solution(
                    trial,
                    &recording,
                    solve_samples(method, recording.fit_samples(), ConsiderSigmas::DEFAULT).ok().as_ref(),
                );
            }
            airframe_result.errors.add_draw(trial, draw, |faults| trial.record_flight(draw, faults));
        }
        Some(airframe_result)
    }
}

fn method_result(trials: &[AirframeResult], index: usize, method: Method) -> MethodResult {
    let airframes = || trials.iter().map(|trial| (trial, &trial.solve_counts_by_method[index]));
    let solved_ones = airframes().filter(|(_, counts)| counts.completed_solves > 0);
    let ratios: Vec<f64> = solved_ones.map(|(trial, counts)| counts.rms_deg() / trial.bound_deg).collect();
    MethodResult {
        method: method.method_name(),
        solves: SolveResults::of_airframes(&airframes().map(|(_, counts)| counts).collect::<Vec<_>>()),
        ratio_median: median(ratios.iter().copied()),
        ratio_worst_decile: quantile(ratios, 0.9).unwrap_or(f64::NAN),
    }
}
