//! What the field model does for the machine once it knows place and day: declination and inclination, unless they were
//! entered, and nothing worse than without.

use super::*;
use crate::earth::{Day, EarthField, Place};

/// 2026-11-22.
fn today() -> Day {
    Day::from_unix_s(20_779 * 86_400).unwrap()
}

/// The field dips by 67.0 deg; 12 deg more than that of the airframe's flights.
fn dresden() -> Place {
    Place::new(51.1, 13.7, 100.0).unwrap()
}

/// It dips by 57 deg: 2 deg more.
fn naples() -> Place {
    Place::new(41.0, 14.0, 100.0).unwrap()
}

impl Bed {
    fn is_at(&mut self, place: Place) {
        assert!(matches!(self.compass.step(Event::Place(place)), Effect::None));
        assert!(matches!(self.compass.step(Event::Day(today())), Effect::None));
    }

    fn in_force(&self) -> (Option<f32>, Option<f32>) {
        let Settings { declination_deg, inclination_deg, .. } = self.compass.settings_in_force();
        (declination_deg, inclination_deg)
    }

    /// The inclination that a calibration with few turns finds, degrees.
    fn found_deg(&mut self) -> f32 {
        self.calibrate(&few_turns(&airframe(), 1)).unwrap();
        self.compass.in_use().unwrap().calibration.inclination_rad.to_degrees()
    }
}

/// Each of the two by itself; taken back, the model's is in force again. What the user has chosen stays what it is, and is
/// what is saved.
#[test]
fn what_was_entered_wins_over_the_model() {
    let mut bed = Bed::new();
    assert_eq!((bed.in_force(), bed.compass.total_ut()), ((None, None), None));
    bed.is_at(dresden());
    let field = EarthField::of(dresden(), today()).unwrap();
    let (declination_deg, inclination_deg) = (field.declination_deg, Some(field.inclination_deg));
    assert!(declination_deg.is_some());
    assert_eq!((bed.in_force(), bed.compass.total_ut()), ((declination_deg, inclination_deg), Some(field.total_ut)));
    assert_eq!(bed.compass.settings(), &Settings::DEFAULT);
    let report = bed.report();
    assert_eq!((report.settings, report.here.field()), (Settings::DEFAULT, Some(&field)));
    bed.saved(Command::Set(Setting::Declination(Some(-3.5)))).unwrap();
    assert_eq!(bed.in_force(), (Some(-3.5), inclination_deg));
    bed.saved(Command::Set(Setting::Inclination(Some(60.0)))).unwrap();
    assert_eq!(bed.in_force(), (Some(-3.5), Some(60.0)));
    bed.saved(Command::Set(Setting::Declination(None))).unwrap();
    assert_eq!(bed.in_force(), (declination_deg, Some(60.0)));
    assert!(matches!(bed.command(Command::Set(Setting::StreamOn(false))), Effect::Save));
    let written = Settings { inclination_deg: Some(60.0), stream_on: false, ..Settings::DEFAULT };
    assert!(matches!(bed.compass.to_save(), Some(Change::Settings(settings)) if *settings == written));
}

/// As one that was entered does: this one is 2 deg off and pulls the one that is found towards it.
#[test]
fn the_model_s_inclination_reaches_the_solver() {
    let without_deg = Bed::new().found_deg();
    let mut bed = Bed::new();
    bed.is_at(naples());
    let with_deg = bed.found_deg();
    assert!(with_deg > without_deg + 0.008, "{with_deg} {without_deg}");
    let mut bed = Bed::new();
    bed.saved(Command::Set(Setting::Inclination(model_deg(naples())))).unwrap();
    assert!((bed.found_deg() - with_deg).abs() < 1e-4);
}

fn model_deg(place: Place) -> Option<f32> {
    EarthField::of(place, today()).map(|field| field.inclination_deg)
}

/// Nobody entered it, so nobody can be asked to correct it: what the samples contradict is left out, and the calibration is
/// the one that there would be without. One that was entered is refused there.
#[test]
fn a_model_that_the_samples_contradict_is_left_out() {
    let mut without = Bed::new();
    without.found_deg();
    let mut bed = Bed::new();
    bed.is_at(dresden());
    bed.found_deg();
    assert_eq!(bed.compass.in_use(), without.compass.in_use());
    let mut bed = Bed::new();
    bed.saved(Command::Set(Setting::Inclination(model_deg(dresden())))).unwrap();
    let refused = bed.calibrate(&few_turns(&airframe(), 1));
    assert!(
        matches!(refused, Err(Refusal::Solve(SolveError::InclinationContradicted { found_deg: 55 }))),
        "{refused:?}"
    );
}

/// Without attitude, samples do not show the inclination: with the model it is known, and headings are held against it.
#[test]
fn who_tumbles_at_a_known_place_knows_the_inclination() {
    for (place, knows) in [(None, false), (Some(dresden()), true)] {
        let mut bed = Bed::new();
        if let Some(place) = place {
            bed.is_at(place);
        }
        bed.done(Command::CalStart(Procedure::Tumble));
        bed.tumble();
        bed.done(Command::CalSolve(None));
        let end = bed.solve();
        bed.settle(end).unwrap();
        assert_eq!(bed.compass.correction().knows_inclination, knows);
        let found_deg = bed.compass.in_use().unwrap().calibration.inclination_rad.to_degrees();
        assert!((found_deg - place.and_then(model_deg).unwrap_or(0.0)).abs() < 0.1, "{found_deg}");
    }
}
