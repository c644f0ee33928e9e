use super::*;

/// The prior has a standard deviation of 1 deg; samples contradict it beyond 4.
#[test]
fn the_inclination_is_told_to_the_solver_as_it_is() {
    let (_, compass) = flown();
    let found_deg = f64::from(compass.module.solution.unwrap().calibration.inclination_rad.to_degrees());
    for (off_deg, is_taken) in [(-6.0, false), (-2.5, true), (0.0, true), (2.5, true), (6.0, false)] {
        for selected in [RowSelection::All, RowSelection::Turns] {
            let options =
                ReplayOptions { inclination_deg: Some(found_deg + off_deg), ..ReplayOptions::with_selection(selected) };
            assert_eq!(replay(&compass.rows, &options).accepted.is_ok(), is_taken, "{off_deg} of {selected:?}");
        }
    }
}

/// A contradicted prior fails every trial solve.
#[test]
fn the_inclination_is_told_to_the_device_that_ends_by_itself() {
    let (_, compass) = flown();
    let found_deg = f64::from(compass.module.solution.unwrap().calibration.inclination_rad.to_degrees());
    for (off_deg, ends) in [(0.0, true), (12.0, false)] {
        let options = ReplayOptions {
            inclination_deg: Some(found_deg + off_deg),
            ..ReplayOptions::with_selection(RowSelection::Flight)
        };
        let replayed = replay(&compass.rows, &options);
        assert_eq!((replayed.ended_s.is_some(), replayed.accepted.is_ok()), (ends, ends), "{off_deg}");
    }
}

/// A place on the Greenwich meridian with a modelled inclination, within 0.5 deg.
fn here(inclination_deg: f64) -> (Position, Date) {
    let day = Date::from_unix_s(1_767_225_600).unwrap();
    let is_there = |place: &Position| {
        let field = EarthField::from_model(*place, day).unwrap();
        (f64::from(field.inclination_deg) - inclination_deg).abs() < 0.5
    };
    let place =
        (-160..160).filter_map(|half_deg: i16| Position::new(f32::from(half_deg) / 2.0, 0.0, 100.0)).find(is_there);
    (place.unwrap(), day)
}

/// A modelled inclination is dropped if contradicted; a configured one is not, and takes precedence.
#[test]
fn the_field_model_gives_way_to_samples_that_contradict_it() {
    let (_, compass) = flown();
    let found_deg = f64::from(compass.module.solution.unwrap().calibration.inclination_rad.to_degrees());
    for selected in [RowSelection::All, RowSelection::Turns, RowSelection::Flight] {
        let untold = ReplayOptions::with_selection(selected);
        let of = |options: ReplayOptions| replay(&compass.rows, &options);
        let expected_deg = |replayed: &ReplayResult| replayed.solution.unwrap().quality.expected_rms_deg;
        let [there, elsewhere] =
            [0.0, 12.0].map(|off_deg| ReplayOptions { place_and_day: Some(here(found_deg + off_deg)), ..untold });
        assert!(expected_deg(&of(there)) < expected_deg(&of(untold)), "{selected:?}: it is one unknown less");
        let (with, without) = (of(elsewhere), of(untold));
        assert_eq!(
            (with.accepted.clone(), with.ended_s, expected_deg(&with)),
            (Ok(()), without.ended_s, expected_deg(&without)),
            "{selected:?}"
        );
        let by_person = of(ReplayOptions { inclination_deg: Some(found_deg + 12.0), ..there });
        assert!(by_person.accepted.is_err(), "{selected:?}");
    }
}
