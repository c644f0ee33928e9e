use autoswing::earth::{Date, EarthField, Position};

use super::*;

/// Inclination of the flown turns, degrees.
fn flown_inclination_deg(compass: &CompassEvaluation) -> f64 {
    f64::from(compass.parameter_fit.solution().unwrap().calibration.inclination_rad.to_degrees())
}

/// The prior has a standard deviation of 1 deg; samples contradict it beyond 4. A contradicted prior fails every trial
/// solve.
#[test]
fn a_configured_inclination_is_used_by_the_solver_and_its_trial_solves() {
    let (_, compass) = compass_of_flown_turns();
    for selected in [RowSelection::All, RowSelection::Turns, RowSelection::Flight] {
        for (off_deg, is_accepted) in [(-12.0, false), (-2.0, true), (0.0, true), (2.0, true), (12.0, false)] {
            let inclination_deg = Some(flown_inclination_deg(&compass) + off_deg);
            let options = ReplayOptions { inclination_deg, ..ReplayOptions::with_selection(selected) };
            let result = replay_rows(&compass.rows, &options);
            assert_eq!(result.acceptance.is_ok(), is_accepted, "{selected:?} {off_deg}");
            let is_ended_by_module = selected == RowSelection::Flight && result.collection_end_s.is_some();
            assert_eq!(is_ended_by_module, selected == RowSelection::Flight && is_accepted, "{selected:?} {off_deg}");
        }
    }
}

/// A place on the Greenwich meridian with a modelled inclination, within 0.5 deg.
fn place_with_inclination(inclination_deg: f64) -> (Position, Date) {
    let day = Date::from_unix_s(1_767_225_600).unwrap();
    let is_there = |position: &Position| {
        let field = EarthField::from_model(*position, day).unwrap();
        (f64::from(field.inclination_deg) - inclination_deg).abs() < 0.5
    };
    let position =
        (-160..160).filter_map(|half_deg: i16| Position::new(f32::from(half_deg) / 2.0, 0.0, 100.0)).find(is_there);
    (position.unwrap(), day)
}

/// A modelled inclination is dropped if contradicted; a configured one is not, and takes precedence.
#[test]
fn a_contradicted_model_inclination_is_dropped() {
    let (_, compass) = compass_of_flown_turns();
    let found_deg = flown_inclination_deg(&compass);
    for selected in [RowSelection::All, RowSelection::Turns, RowSelection::Flight] {
        let without_place = ReplayOptions::with_selection(selected);
        let run_replay = |options: ReplayOptions| replay_rows(&compass.rows, &options);
        let expected_deg = |replay_result: &ReplayResult| replay_result.solution.unwrap().quality.expected_rms_deg;
        let [there, elsewhere] = [0.0, 12.0].map(|off_deg| ReplayOptions {
            place_and_day: Some(place_with_inclination(found_deg + off_deg)),
            ..without_place
        });
        assert!(
            expected_deg(&run_replay(there)) < expected_deg(&run_replay(without_place)),
            "{selected:?}: it is one unknown less"
        );
        let (with, without) = (run_replay(elsewhere), run_replay(without_place));
        assert_eq!(
            (with.acceptance.clone(), with.collection_end_s, expected_deg(&with)),
            (Ok(()), without.collection_end_s, expected_deg(&without)),
            "{selected:?}"
        );
        let by_person = run_replay(ReplayOptions { inclination_deg: Some(found_deg + 12.0), ..there });
        assert!(by_person.acceptance.is_err(), "{selected:?}");
    }
}
