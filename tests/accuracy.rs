//! The estimator against the Cramer-Rao bound, and the truth of its sigmas: `host-sim bench accuracy`, smaller.

use std::sync::OnceLock;

use host_sim::accuracy::flight::{Flight, Pattern};
use host_sim::accuracy::{Coverage, Outcome, Plan, Result, flights, run};
use host_sim::world::aircraft::Kind;

/// 40 airframes, 20 flights of each: the ratio of one airframe scatters by 0.3 / sqrt(20) = 7 % by chance, so that the
/// worst decile is 1.28 times that above what it is with many flights.
fn outcome() -> &'static Outcome {
    static OUTCOME: OnceLock<Outcome> = OnceLock::new();
    OUTCOME.get_or_init(|| run(Plan { airframes: 40, draws: 20, seed: 1000 }, &|| {}))
}

fn maximum_likelihood() -> Result {
    outcome().methods[0]
}

#[test]
fn maximum_likelihood_sits_at_the_bound() {
    let result = maximum_likelihood();
    assert_eq!(result.method, "maximum-likelihood");
    assert!(result.ratio_median <= 1.05, "{result:?}");
    assert!(result.ratio_worst_decile <= 1.15 + 0.09, "{result:?}");
}

#[test]
fn every_solve_converges_and_none_is_accepted_wrongly() {
    let result = maximum_likelihood();
    assert!((result.converged_percent, result.wrong) == (100.0, 0), "{result:?}");
    // None of these flights is too poor for the module.
    assert!(result.accepted_percent >= 99.0, "{result:?}");
}

/// Within three points of a normal distribution's, the chance of 2,560 headings (one point) included.
#[test]
fn sigma_is_true() {
    for Coverage { one_sigma_percent, two_sigma_percent, headings } in
        [outcome().coverage, outcome().coverage_with_faults]
    {
        assert_eq!(headings, 40 * 4 * 16);
        assert!((one_sigma_percent - 68.3).abs() <= 3.0, "{one_sigma_percent}");
        assert!((two_sigma_percent - 95.4).abs() <= 3.0, "{two_sigma_percent}");
    }
}

/// Wandering attitude is what the closed forms cannot take; the order of the methods is that of their assumptions.
#[test]
fn the_closed_forms_are_as_far_behind_as_they_must_be() {
    let [ml, two_plane, four_ellipse] = [0, 1, 2].map(|i| outcome().methods[i].rms_median_deg);
    assert!(ml < two_plane && two_plane < four_ellipse, "{ml} {two_plane} {four_ellipse}");
}

/// The same airframes whatever the number of threads or the order in which they finish.
#[test]
fn a_run_is_a_function_of_its_seed() {
    let small = Plan { airframes: 4, draws: 2, seed: 7 };
    assert_eq!(run(small, &|| {}), run(small, &|| {}));
}

/// Of a copter, small: `host-sim bench accuracy --aircraft copter`. The scatter is that of above.
#[test]
fn a_copter_is_calibrated_by_its_routine_either_way_round() {
    for pattern in [Pattern::Routine, Pattern::Mirrored] {
        let flight = Flight { kind: Kind::Copter, pattern, minutes: 3.0 };
        let row = flights::run(flight, Plan { airframes: 20, draws: 5, seed: 1000 }, &|| {});
        assert!(row.converged_percent >= 100.0 && row.accepted_percent >= 95.0 && row.wrong == 0, "{row:?}");
        assert!(row.rms_median_deg <= 0.8 && row.rms_worst_decile_deg <= 1.6, "{row:?}");
        // What the solver makes of what was kept: it takes all attitudes for equally good, and those of pushes are not.
        assert!((0.9..=1.25).contains(&row.kept_ratio_median), "{row:?}");
        // The device's own collection against the best set of as many readings that could have been chosen afterwards.
        assert!((0.85..=1.15).contains(&row.best_ratio_median), "{row:?}");
        assert_eq!(row.coverage.headings, 20 * 16);
        let again = flights::run(flight, Plan { airframes: 2, draws: 2, seed: 7 }, &|| {});
        assert_eq!(again, flights::run(flight, Plan { airframes: 2, draws: 2, seed: 7 }, &|| {}));
    }
}

/// Without a plan, small. What is kept is nearly as good as the best set of as many readings; there is no chance in the
/// choice, which costs 5 % of a copter and 6 % of an aeroplane: one in four is held back. The solver's part scatters by
/// 4 % with so many.
#[test]
fn whoever_wanders_is_calibrated_as_well_as_could_be_chosen_afterwards() {
    for (kind, most_by_choice) in [(Kind::Copter, 1.08), (Kind::Plane, 1.09)] {
        let flight = Flight { kind, pattern: Pattern::Wandering, minutes: 3.0 };
        let row = flights::run(flight, Plan { airframes: 20, draws: 5, seed: 1000 }, &|| {});
        assert!(row.accepted_percent >= 95.0, "{row:?}");
        assert!(row.choice_ratio_median <= most_by_choice, "{row:?}");
        assert!(row.best_ratio_median <= 1.1 + 0.08, "{row:?}");
    }
}
