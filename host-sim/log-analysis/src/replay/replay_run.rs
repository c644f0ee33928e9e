//! Replays rows: samples by the instrument, a solution by the module or of a selection, headings of all rows.

use autoswing::calibration::{Sample, Solution};
use autoswing::collection::RetainedSamples;
use autoswing::instrument::{Instrument, InstrumentConfig};

use super::module_run::ModuleRun;
use super::result::{HeadingRow, ReplayOptions, ReplayResult, RowSelection};
use super::row::ReplayRow;
use super::row_headings::{compute_headings, estimate, instrument_config, score};
use super::row_solve::{RunOutcome, SolverPrior, from_all, from_turns};
use crate::log::Flight;

/// Replays rows, in order of time, without attitudes between them.
#[must_use]
pub fn replay(rows: &[ReplayRow], options: &ReplayOptions) -> ReplayResult {
    replay_with(rows, None, options)
}

/// Replays rows with the flight's attitudes between them.
#[must_use]
pub fn replay_with(rows: &[ReplayRow], flight: Option<&Flight>, options: &ReplayOptions) -> ReplayResult {
    let config = instrument_config(rows);
    let usable = fitted(rows, options, config);
    let run = match options.selected {
        RowSelection::All => from_all(&usable, &SolverPrior::new(options, config)),
        RowSelection::Turns => from_turns(&usable, &SolverPrior::new(options, config)),
        RowSelection::Flight => {
            let mut retained = RetainedSamples::EMPTY;
            let mut module = ModuleRun::new(options, config.readings_per_sample(), &mut retained);
            module.collect(&usable);
            module.into_outcome()
        }
    };
    let RunOutcome { solution, accepted, fitted_s, ended_s } = run;
    let shown = solution.as_ref().map_or_else(Vec::new, |solution| compute_headings(rows, flight, solution, config));
    let scored_headings = |heading: fn(&HeadingRow) -> [f64; 2]| {
        let mut each = shown.iter().map(heading);
        score(rows, |_| each.next().map(|[heading_deg, sigma_deg]| (heading_deg, sigma_deg)))
    };
    let (raw, smooth) =
        (scored_headings(|shown| [shown.heading_deg, shown.sigma_deg]), scored_headings(HeadingRow::sent_deg));
    let samples = fitted_s.len();
    ReplayResult { solution, accepted, samples, fitted_s, ended_s, headings: shown, score: raw, smoothed_score: smooth }
}

pub(super) fn solve_all_rows(rows: &[ReplayRow]) -> Option<Solution> {
    let config = instrument_config(rows);
    let options = ReplayOptions::with_selection(RowSelection::All);
    from_all(&fitted(rows, &options, config), &SolverPrior::new(&options, config)).solution
}

/// Samples of the usable rows before the fit limit.
fn fitted(rows: &[ReplayRow], options: &ReplayOptions, config: InstrumentConfig) -> Vec<Sample> {
    let usable = rows.iter().filter(|row| row.usable && options.fit_until_s.is_none_or(|until_s| row.t_s < until_s));
    let start_s = rows.first().map_or(0.0, |row| row.t_s);
    let mut instrument = Instrument::new(config);
    usable
        .flat_map(|row| {
            estimate(&mut instrument, row, start_s);
            std::iter::from_fn(|| instrument.next_sample()).collect::<Vec<_>>()
        })
        .collect()
}
