//! Plan of the accuracy studies, and the evaluation of their solves.

use autoswing::calibration::{ConsiderSigmas, Method, Prior, Samples, Solution, SolveError, Solver};
use log_analysis::numbers::median;
use log_analysis::score::{accepted_by_uncalibrated, within_percent};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde::Serialize;

use super::random_flight::{ConstantErrorSigmas, LaterMeasurementSource, RandomFlight, Recording};

/// Extent of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccuracyPlan {
    /// Number of airframes.
    pub airframe_count: u64,
    /// Noise realisations per airframe. The ratio to the bound has a relative standard error of about `0.3 /
    /// sqrt(draws)`.
    pub noise_draws: u64,
    /// Seed of the first airframe.
    pub seed: u64,
}

/// Evaluates every airframe of a plan in parallel; `on_airframe_done` is called once per airframe, from any thread.
pub(super) fn evaluate_airframes<T: Send>(
    plan: AccuracyPlan,
    on_airframe_done: &(dyn Fn() + Sync),
    evaluate: impl Fn(u64) -> Option<T> + Sync,
) -> Vec<T> {
    let evaluated = (plan.seed..plan.seed + plan.airframe_count).into_par_iter().filter_map(|seed| {
        let airframe_result = evaluate(seed);
        on_airframe_done();
        airframe_result
    });
    evaluated.collect()
}

/// Fraction of heading errors within one and two sigma, percent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SigmaCoverage {
    /// Percentage of headings with an error within one sigma; ideally 68.3.
    pub one_sigma_percent: f64,
    /// Percentage of headings with an error within two sigma; ideally 95.4.
    pub two_sigma_percent: f64,
    /// Number of headings.
    pub headings: usize,
}

/// Coverage is evaluated for every fifth noise realisation.
const COVERAGE_DRAW_INTERVAL: u64 = 5;

const HEADING_COUNT: usize = 16;

/// Solves of one method.
#[derive(Clone, Copy, Default)]
pub(super) struct SolveCounts {
    pub(super) completed_solves: u32,
    refused_solves: u32,
    accepted_solves: u32,
    wrong_solves: u32,
    /// Sum of the mean squared heading errors of all solves, square degrees.
    mean_square_error_sum: f64,
}

impl SolveCounts {
    pub(super) fn rms_deg(&self) -> f64 {
        (self.mean_square_error_sum / f64::from(self.completed_solves)).sqrt()
    }

    pub(super) fn add_solution(&mut self, trial: &RandomFlight, recording: &Recording, solution: Option<&Solution>) {
        let Some(solution) = solution else {
            self.refused_solves += 1;
            return;
        };
        let errors_deg = trial.errors_deg(&solution.calibration);
        let mean_square =
            errors_deg.iter().map(|error_deg| error_deg * error_deg).sum::<f64>() / errors_deg.len() as f64;
        let accepted = accepted_by_uncalibrated(solution, recording.fit_samples(), recording.held_back()).is_ok();
        self.completed_solves += 1;
        self.mean_square_error_sum += mean_square;
        self.accepted_solves += u32::from(accepted);
        self.wrong_solves +=
            u32::from(accepted && mean_square.sqrt() > 3.0 * f64::from(solution.quality.expected_rms_deg));
    }
}

/// Solves of all airframes by one method.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SolveResults {
    /// Solves that returned coefficients, percent.
    pub converged_percent: f64,
    /// Solves that an uncalibrated module accepts, percent.
    pub accepted_percent: f64,
    /// Accepted solves with a true RMS error above three times the estimated one.
    #[serde(rename = "wrong")]
    pub wrong_calibrations: u32,
    /// RMS heading error, median over the airframes, degrees.
    pub rms_median_deg: f64,
}

impl SolveResults {
    pub(super) fn of_airframes(airframes: &[&SolveCounts]) -> Self {
        let total = |count: fn(&SolveCounts) -> u32| airframes.iter().map(|counts| count(counts)).sum::<u32>();
        let solve_count = total(|counts| counts.completed_solves + counts.refused_solves).max(1);
        let percent = |count: u32| 100.0 * f64::from(count) / f64::from(solve_count);
        let solved = airframes.iter().filter(|counts| counts.completed_solves > 0);
        Self {
            converged_percent: percent(total(|counts| counts.completed_solves)),
            accepted_percent: percent(total(|counts| counts.accepted_solves)),
            wrong_calibrations: total(|counts| counts.wrong_solves),
            rms_median_deg: median(solved.map(|counts| counts.rms_deg())),
        }
    }
}

/// Heading errors over their sigmas, without and with the constant errors that the solver considers.
#[derive(Default)]
pub(super) struct NormalisedErrors([Vec<f64>; 2]);

impl NormalisedErrors {
    /// Adds the headings after a flight of every fifth draw, which `record_flight` simulates.
    pub(super) fn add_draw(
        &mut self,
        trial: &RandomFlight,
        draw: u64,
        record_flight: impl Fn(ConstantErrorSigmas) -> (Recording, LaterMeasurementSource),
    ) {
        if draw.is_multiple_of(COVERAGE_DRAW_INTERVAL) {
            for (errors, consider) in self.0.iter_mut().zip([ConsiderSigmas::ZERO, ConsiderSigmas::DEFAULT]) {
                errors.extend(normalised_errors_after_calibration(trial, consider, &record_flight));
            }
        }
    }

    /// Coverage over all airframes.
    pub(super) fn coverage(airframes: &[&Self]) -> [SigmaCoverage; 2] {
        [0, 1].map(|kind| {
            let errors: Vec<f64> = airframes.iter().flat_map(|errors| &errors.0[kind]).copied().collect();
            let [one_sigma_percent, two_sigma_percent] = within_percent(&errors);
            SigmaCoverage { one_sigma_percent, two_sigma_percent, headings: errors.len() }
        })
    }
}

/// Heading errors after a calibration flight, divided by their sigmas. The flight has exactly the attitude errors
/// considered by the solver; `record_flight` simulates them.
fn normalised_errors_after_calibration(
    trial: &RandomFlight,
    consider: ConsiderSigmas,
    record_flight: impl Fn(ConstantErrorSigmas) -> (Recording, LaterMeasurementSource),
) -> Vec<f64> {
    let (recording, mut source) = record_flight(ConstantErrorSigmas::from_considered(consider));
    let Ok(solution) = solve_samples(Method::MaximumLikelihood, recording.fit_samples(), consider) else {
        return Vec::new();
    };
    (0..HEADING_COUNT).filter_map(|_| trial.normalised_heading_error(&solution, &mut source)).collect()
}

pub(super) fn solve_samples(
    method: Method,
    samples: Samples<'_>,
    consider: ConsiderSigmas,
) -> Result<Solution, SolveError> {
    // Samples are single measurements, as are the evaluated headings.
    Solver::with_consider_sigmas(method, samples, &Prior::default(), consider)?.run(samples)
}
