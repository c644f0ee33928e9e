//! Integrity study: headings output as good while a fault is active.
//!
//! Each [`FaultCase`] is a fault during the calibration or in the flight after it. Random airframes at random places
//! fly it with the firmware's own tasks ([`flight`]); the statistics count output headings whose error is not covered
//! by their sigma. True headings come from the simulator.

pub mod fault_case;
pub mod flight;
mod integrity_plan;
mod integrity_row;
mod legs_after_calibration;
mod statistics;
mod sweep;

use rayon::prelude::*;

pub use fault_case::{ALL_CASES, FaultCase, SWEEP_FAMILIES};
pub use integrity_plan::{AttitudeProtocol, IntegrityPlan};
pub use integrity_row::IntegrityRow;
pub use statistics::HeadingStatistics;
pub use sweep::{BEGINS_S, DURATIONS_S, Sweep, SweepCell, all_changes, run_sweep};

use flight::CaseFlightResult;
use integrity_row::case_row;

/// Flies all cases in parallel; calls `on_flight_done` after every flight. The result does not depend on the number of
/// cores.
pub fn run_integrity_study(
    plan: IntegrityPlan,
    cases: &[&'static FaultCase],
    on_flight_done: &(dyn Fn() + Sync),
) -> Vec<IntegrityRow> {
    let flights: Vec<(usize, u64)> = cases
        .iter()
        .enumerate()
        .flat_map(|(i, case)| {
            (0..case.flight_count(plan.flights_per_case))
                .map(move |flight_index| (i, plan.seed.wrapping_add(flight_index)))
        })
        .collect();
    let all_results: Vec<(usize, CaseFlightResult)> = flights
        .into_par_iter()
        .map(|(i, seed)| {
            let result = (i, flight::fly_case(cases[i], seed, &plan));
            on_flight_done();
            result
        })
        .collect();
    let results_of =
        |i: usize| all_results.iter().filter(move |(case, _)| *case == i).map(|(_, on_flight_done)| on_flight_done);
    cases.iter().enumerate().map(|(i, case)| case_row(case.case_name, &results_of(i).collect::<Vec<_>>())).collect()
}

/// Total number of flights.
#[must_use]
pub fn flight_count(plan: IntegrityPlan, cases: &[&'static FaultCase]) -> u64 {
    cases.iter().map(|case| case.flight_count(plan.flights_per_case)).sum()
}
