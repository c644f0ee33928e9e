use super::*;

fn names(aircraft: Kind) -> Vec<&'static str> {
    CASES.iter().filter(|case| case.is_for(aircraft)).map(|case| case.name).collect()
}

/// An aeroplane has the cases it always had, a copter those that make sense of them, and some of its own.
#[test]
fn every_aircraft_has_the_cases_that_make_sense() {
    let [plane, copter] = [Kind::Plane, Kind::Copter].map(names);
    let only = |these: &[&'static str], those: &[&'static str]| -> Vec<&'static str> {
        these.iter().filter(|name| !those.contains(name)).copied().collect()
    };
    assert_eq!(only(&plane, &copter), ["ten-hours", "cal-bank-5"]);
    assert_eq!(
        only(&copter, &plane),
        ["cal-hover", "pushed", "current-5", "current-20", "current-5-told", "current-20-told"]
    );
    assert_eq!(names(Kind::Vtol), copter);
}

#[test]
fn a_copter_s_cases_are_flown_by_a_copter() {
    let drawn = |name| named(name).unwrap().draw(3, Kind::Copter);
    let clean = drawn("clean");
    assert_eq!(clean.world, WorldConfig::random(3).carried_by(Kind::Copter));
    assert_eq!(clean.routine, Routine::of(Kind::Copter, Plan::default(), 0.0));
    let pushed = drawn("pushed").world.attitude_source.push_error_deg;
    assert!((pushed / clean.world.attitude_source.push_error_deg - 2.0).abs() < 1e-9);
    let current_ut = Vector3::from(drawn("current-20").world.current_ut);
    assert!((current_ut.norm() - 20.0).abs() < 1e-9);
    assert_eq!(drawn("current-20").onset, Onset::Always);
    let hover = drawn("cal-hover").routine;
    assert_eq!(hover.legs(), clean.routine.parts[0].legs.repeat(4));
    assert_eq!(hover.command, clean.routine.command);
}

/// What befalls a calibration befalls it before it can be over.
#[test]
fn a_change_while_calibrating_comes_before_its_end() {
    for (aircraft, most_s) in [(Kind::Plane, 195.0), (Kind::Copter, 60.0)] {
        let latest_s =
            (0..200).fold(0.0_f64, |latest_s, seed| match named("cal-moved-5").unwrap().draw(seed, aircraft).onset {
                Onset::Calibrating { after_s, .. } => latest_s.max(after_s),
                other => panic!("{other:?}"),
            });
        assert!((0.9 * most_s..most_s).contains(&latest_s), "{aircraft:?}: {latest_s}");
    }
}
