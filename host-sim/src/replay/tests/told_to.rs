//! What the module is told beforehand.

use super::*;

/// What is told is taken as known to a degree, and is contradicted by four of that: 2.5 deg either way are none, 6 are one.
#[test]
fn the_inclination_is_told_to_the_solver_as_it_is() {
    let (_, compass) = flown();
    let found_deg = f64::from(compass.module.solution.unwrap().calibration.inclination_rad.to_degrees());
    for (off_deg, is_taken) in [(-6.0, false), (-2.5, true), (0.0, true), (2.5, true), (6.0, false)] {
        for selected in [Selected::All, Selected::Turns] {
            let options = Options { selected, inclination_deg: Some(found_deg + off_deg), fit_until_s: None };
            assert_eq!(replay(&compass.rows, &options).accepted.is_ok(), is_taken, "{off_deg} of {selected:?}");
        }
    }
}

/// A module that is told an inclination of another place does not end by itself: each of its trials contradicts that, as its
/// solve does in the end.
#[test]
fn the_inclination_is_told_to_the_device_that_ends_by_itself() {
    let (_, compass) = flown();
    let found_deg = f64::from(compass.module.solution.unwrap().calibration.inclination_rad.to_degrees());
    for (off_deg, ends) in [(0.0, true), (12.0, false)] {
        let options =
            Options { selected: Selected::Flight, inclination_deg: Some(found_deg + off_deg), fit_until_s: None };
        let replayed = replay(&compass.rows, &options);
        assert_eq!((replayed.ended_s.is_some(), replayed.accepted.is_ok()), (ends, ends), "{off_deg}");
    }
}
