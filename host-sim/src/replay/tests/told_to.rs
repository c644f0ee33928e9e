//! What the module is told beforehand.

use super::*;

/// What is told is taken as known to a degree, and is contradicted by four of that: 2.5 deg either way are none, 6 are one.
#[test]
fn the_inclination_is_told_to_the_solver_as_it_is() {
    let (_, compass) = flown();
    let found_deg = f64::from(compass.module.solution.unwrap().calibration.inclination_rad.to_degrees());
    for (off_deg, is_taken) in [(-6.0, false), (-2.5, true), (0.0, true), (2.5, true), (6.0, false)] {
        for selected in [Selected::All, Selected::Turns] {
            let options = Options { inclination_deg: Some(found_deg + off_deg), ..Options::of(selected) };
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
        let options = Options { inclination_deg: Some(found_deg + off_deg), ..Options::of(Selected::Flight) };
        let replayed = replay(&compass.rows, &options);
        assert_eq!((replayed.ended_s.is_some(), replayed.accepted.is_ok()), (ends, ends), "{off_deg}");
    }
}

/// A place on the meridian of Greenwich where the field model has this inclination, to half a degree.
fn here(inclination_deg: f64) -> (Place, Day) {
    let day = Day::from_unix_s(1_767_225_600).unwrap();
    let is_there = |place: &Place| {
        let field = EarthField::of(*place, day).unwrap();
        (f64::from(field.inclination_deg) - inclination_deg).abs() < 0.5
    };
    let place =
        (-160..160).filter_map(|half_deg: i16| Place::new(f32::from(half_deg) / 2.0, 0.0, 100.0)).find(is_there);
    (place.unwrap(), day)
}

/// What the field model says of a place is as good as told, and gives way where samples contradict it, as the module has it; what a
/// person told does not, and goes before the model.
#[test]
fn the_field_model_gives_way_to_samples_that_contradict_it() {
    let (_, compass) = flown();
    let found_deg = f64::from(compass.module.solution.unwrap().calibration.inclination_rad.to_degrees());
    for selected in [Selected::All, Selected::Turns, Selected::Flight] {
        let untold = Options::of(selected);
        let of = |options: Options| replay(&compass.rows, &options);
        let expected_deg = |replayed: &Replayed| replayed.solution.unwrap().quality.expected_rms_deg;
        let [there, elsewhere] = [0.0, 12.0].map(|off_deg| Options { here: Some(here(found_deg + off_deg)), ..untold });
        assert!(expected_deg(&of(there)) < expected_deg(&of(untold)), "{selected:?}: it is one unknown less");
        let (with, without) = (of(elsewhere), of(untold));
        assert_eq!(
            (with.accepted.clone(), with.ended_s, expected_deg(&with)),
            (Ok(()), without.ended_s, expected_deg(&without)),
            "{selected:?}"
        );
        let by_person = of(Options { inclination_deg: Some(found_deg + 12.0), ..there });
        assert!(by_person.accepted.is_err(), "{selected:?}");
    }
}
