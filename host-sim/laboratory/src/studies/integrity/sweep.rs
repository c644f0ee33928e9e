//! Sweeps: a family of changes over durations and times of begin, as maps of wrong headings.

use rayon::prelude::*;
use serde::Serialize;

use super::fault_case::{Change, FaultCase};
use super::flight::{CaseFlightResult, fly_drawn_case};
use super::integrity_plan::IntegrityPlan;
use super::integrity_row::{IntegrityRow, case_row};
use super::statistics::HeadingStatistics;

/// Durations of a change, seconds.
pub const DURATIONS_S: [f64; 11] = [0.0, 1.0, 2.0, 4.0, 8.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0];

/// Times from the start of the flight to the begin of a change, seconds.
pub const BEGINS_S: [f64; 7] = [0.0, 5.0, 15.0, 30.0, 60.0, 120.0, 300.0];

/// Quantile of the normal distribution of a one-sided bound of 95 %.
const BOUND_SIGMAS: f64 = 1.645;

/// Results of one duration and begin.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SweepCell {
    /// Whether the flights follow a power-on and a rest, instead of the calibration.
    pub follows_power_on: bool,
    /// Begin of the change, seconds after the start of the flight.
    pub begin_s: f64,
    /// Duration of the change, seconds.
    pub duration_s: f64,
    /// Accepted calibrations, which were flown on.
    pub flights: usize,
    /// Bad headings, percent of all output since the begin.
    pub bad_percent: f64,
    /// Lower bound of `bad_percent` over flights, one-sided 95 %.
    pub bad_bound_percent: f64,
    /// Largest heading error, degrees.
    pub worst_deg: f64,
    /// Largest error that was exceeded for 10 s at sigmas of 2 deg or less, degrees.
    pub worst_10s_deg: f64,
}

/// Results of a family.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sweep {
    /// All flights of the family.
    pub total: IntegrityRow,
    /// The cells, by start, begin and duration.
    pub cells: Vec<SweepCell>,
}

/// Flies a family in parallel, with `flights_per_case` flights of each change; calls `on_flight_done` after each.
pub fn run_sweep(
    plan: IntegrityPlan,
    family: &FaultCase,
    changes: &[Change],
    on_flight_done: &(dyn Fn() + Sync),
) -> Sweep {
    let flights: Vec<Change> = changes.iter().flat_map(|change| (0..plan.flights_per_case).map(|_| *change)).collect();
    let fly = |(index, change): (usize, Change)| {
        let seed = plan.seed.wrapping_add(index as u64);
        let drawn = family.draw_change(change, seed, plan.aircraft, plan.attitude_protocol);
        let result = fly_drawn_case(family, drawn, seed, &plan);
        on_flight_done();
        result
    };
    let results: Vec<CaseFlightResult> = flights.into_par_iter().enumerate().map(fly).collect();
    let results_of_cells = results.chunks((results.len() / changes.len().max(1)).max(1));
    Sweep {
        total: case_row(family.case_name, &results.iter().collect::<Vec<_>>()),
        cells: changes.iter().zip(results_of_cells).map(|(change, results)| sweep_cell(*change, results)).collect(),
    }
}

/// All durations and begins, after the calibration and after a power-on.
#[must_use]
pub fn all_changes() -> Vec<Change> {
    let changes_of = |follows_power_on| {
        let of_begin = move |begin_s| {
            DURATIONS_S.into_iter().map(move |duration_s| Change { begin_s, duration_s, follows_power_on })
        };
        BEGINS_S.into_iter().flat_map(of_begin)
    };
    [false, true].into_iter().flat_map(changes_of).collect()
}

fn sweep_cell(Change { begin_s, duration_s, follows_power_on }: Change, results: &[CaseFlightResult]) -> SweepCell {
    let flown: Vec<&HeadingStatistics> =
        results.iter().filter(|result| result.calibration.is_ok()).map(|result| &result.output_statistics).collect();
    let all = flown.iter().fold(HeadingStatistics::default(), |all, flight| all.merged_with(flight));
    let percents: Vec<f64> = flown.iter().map(|flight| flight.bad_percent()).collect();
    SweepCell {
        follows_power_on,
        begin_s,
        duration_s,
        flights: flown.len(),
        bad_percent: all.bad_percent(),
        bad_bound_percent: lower_bound(&percents),
        worst_deg: all.worst_deg,
        worst_10s_deg: all.worst_10s_deg,
    }
}

/// Lower bound of the mean of a population, one-sided 95 %; 0 of fewer than two values.
fn lower_bound(values: &[f64]) -> f64 {
    if values.len() < 2 {
        return 0.0;
    }
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / (count - 1.0);
    (mean - BOUND_SIGMAS * (variance / count).sqrt()).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean 2, standard deviation 2 of four flights.
    #[test]
    fn the_bound_is_below_the_mean_by_its_own_sigmas() {
        let bound = lower_bound(&[0.5, 0.5, 2.0, 5.0]);
        assert!((bound - (2.0 - 1.645 * 4.5_f64.sqrt() / 2.0)).abs() < 1e-9, "{bound}");
        assert!(lower_bound(&[9.0]) <= 0.0 && lower_bound(&[0.0, 9.0]) <= 0.0);
    }
}
