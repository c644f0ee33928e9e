//! Replays rows: samples by the instrument, a solution by the module or of a selection, headings of all rows.

use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{Orientation, Prior, Sample, Solution};
use autoswing::collection::RetainedSamples;
use autoswing::instrument::{Instrument, InstrumentConfig};

use super::module_run::ModuleRun;
use super::result::{CalibrationOutcome, EarthFieldPrior, HeadingRow, ReplayResult, RowSelection};
use super::row::ReplayRow;
use super::row_headings::{compute_headings, estimate_heading, instrument_config, score_rows};
use super::row_solve::{is_determined, solve_evenly_thinned, solve_retained_samples, solver_prior};
use crate::log::LoggedFlight;

/// Replays rows, in order of time, with the flight's attitudes between them.
#[must_use]
pub fn replay_rows(
    rows: &[ReplayRow],
    flight: Option<&LoggedFlight>,
    selection: RowSelection,
    prior: &EarthFieldPrior,
) -> ReplayResult {
    let config = instrument_config(rows);
    let usable = samples_of_usable_rows(rows, config);
    let outcome = match selection {
        RowSelection::All => solve_evenly_thinned(&usable, &solver_prior(prior, config)),
        RowSelection::Turns => calibrate_module(&usable, Procedure::Turns, prior, config),
        RowSelection::Flight => calibrate_module(&usable, Procedure::Flight, prior, config),
    };
    let solution = outcome.solution.as_ref();
    let headings = solution.map_or_else(Vec::new, |solution| compute_headings(rows, flight, solution, config));
    let scored_headings = |heading: fn(&HeadingRow) -> [f64; 2]| {
        let mut remaining_headings = headings.iter().map(heading);
        score_rows(rows, |_| remaining_headings.next().map(|[heading_deg, sigma_deg]| (heading_deg, sigma_deg)))
    };
    let score = scored_headings(|row| [row.heading_deg, row.sigma_deg]);
    let smoothed_score = scored_headings(HeadingRow::sent_and_sigma_deg);
    ReplayResult { outcome, headings, score, smoothed_score }
}

/// The module's calibration from samples that it collects by a procedure.
fn calibrate_module(
    samples: &[Sample],
    procedure: Procedure,
    prior: &EarthFieldPrior,
    config: InstrumentConfig,
) -> CalibrationOutcome {
    let mut retained = RetainedSamples::EMPTY;
    let mut module = ModuleRun::new(procedure, prior, config.readings_per_sample(), &mut retained);
    module.collect_samples(samples);
    module.into_outcome()
}

/// Solves the usable rows, evenly thinned.
pub(super) fn solve_all_rows(rows: &[ReplayRow]) -> Option<Solution> {
    solve_rows(rows, &EarthFieldPrior::default(), Orientation::IDENTITY_ROTATION).solution
}

/// Solves the usable rows of a sensor in a mounting, evenly thinned, and evaluates whether the module would accept the
/// result. Where that fails, as in flights that are mostly straight, solves the samples that the module would retain of
/// all of them.
pub(super) fn solve_rows(rows: &[ReplayRow], prior: &EarthFieldPrior, mount: Orientation) -> CalibrationOutcome {
    let config = instrument_config(rows);
    let (samples, prior) = (samples_of_usable_rows(rows, config), Prior { mount, ..solver_prior(prior, config) });
    more_certain_outcome(solve_evenly_thinned(&samples, &prior), || solve_retained_samples(&samples, &prior))
}

/// The outcome with the smaller expected error; the alternative is solved only if the flight does not determine the first
/// one.
fn more_certain_outcome(
    first: CalibrationOutcome,
    alternative: impl FnOnce() -> CalibrationOutcome,
) -> CalibrationOutcome {
    if first.solution.as_ref().is_some_and(is_determined) {
        return first;
    }
    let expected_error_deg = |outcome: &CalibrationOutcome| {
        outcome.solution.as_ref().map_or(f32::INFINITY, |solution| solution.quality.expected_rms_deg)
    };
    let alternative = alternative();
    if expected_error_deg(&alternative) < expected_error_deg(&first) { alternative } else { first }
}

/// Samples of the usable rows.
fn samples_of_usable_rows(rows: &[ReplayRow], config: InstrumentConfig) -> Vec<Sample> {
    let usable = rows.iter().filter(|row| row.is_usable);
    let start_s = rows.first().map_or(0.0, |row| row.t_s);
    let mut instrument = Instrument::new(config);
    usable
        .flat_map(|row| {
            estimate_heading(&mut instrument, row, start_s);
            std::iter::from_fn(|| instrument.next_sample()).collect::<Vec<_>>()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::tests::compass_of_flown_turns;

    /// An outcome with an expected error, or without a solution if the error is infinite.
    fn outcome(expected_deg: f32) -> CalibrationOutcome {
        let mut solution = *compass_of_flown_turns().1.parameter_fit.solution().unwrap();
        solution.quality.expected_rms_deg = expected_deg;
        let solution = expected_deg.is_finite().then_some(solution);
        CalibrationOutcome { solution, acceptance: Ok(()), fitted_count: 0, collection_end_s: None }
    }

    /// Poor is over 2 deg.
    #[test]
    fn an_alternative_replaces_a_poor_solution_if_it_is_better() {
        for (first_deg, alternative_deg, expected_deg) in
            [(1.5, 1.0, 1.5), (2.5, 1.0, 1.0), (2.5, 3.0, 2.5), (2.5, f32::INFINITY, 2.5), (f32::INFINITY, 3.0, 3.0)]
        {
            let chosen = more_certain_outcome(outcome(first_deg), || outcome(alternative_deg));
            let chosen_deg = chosen.solution.unwrap().quality.expected_rms_deg;
            assert!((chosen_deg - expected_deg).abs() < 1e-6, "{first_deg} {alternative_deg}: {chosen_deg}");
        }
    }
}
