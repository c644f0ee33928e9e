//! Declination and inclination from the field model.

use super::*;
use autoswing::earth::{Date, EarthField, Position};

/// 2026-11-22.
fn today() -> Date {
    Date::from_unix_s(20_779 * 86_400).unwrap()
}

/// Dresden, with 67 deg of inclination: 12 deg more than in the test flights.
fn dresden() -> Position {
    Position::new(51.1, 13.7, 100.0).unwrap()
}

/// Naples, with 57 deg of inclination: 2 deg more than in the test flights.
fn naples() -> Position {
    Position::new(41.0, 14.0, 100.0).unwrap()
}

fn model_field(place: Position) -> EarthField {
    EarthField::from_model(place, today()).unwrap()
}

impl TestBed<'_> {
    fn report_place(&mut self, place: Position) {
        self.expect_none(Event::Position(place, self.time()));
        self.expect_none(Event::Date(today()));
    }

    fn effective_field_angles_deg(&self) -> (Option<f32>, Option<f32>) {
        let Settings { declination_deg, inclination_deg, .. } = self.compass.effective_settings();
        (declination_deg, inclination_deg)
    }
}

/// An estimator that jumps by 1100 km is accepted once the vehicle is disarmed, as after a transport, but never while
/// it is armed or its armed state is unknown.
#[test]
fn a_distant_position_is_accepted_only_while_disarmed() {
    for (armed, place) in [(None, dresden()), (Some(true), dresden()), (Some(false), naples())] {
        let mut bed = TestBed::new();
        bed.report_armed(armed);
        bed.report_place(dresden());
        for _ in 0..100 {
            bed.report_place(naples());
        }
        assert_eq!(bed.compass.model_field_strength_ut(), Some(model_field(place).total_ut), "{armed:?}");
    }
}

#[test]
fn configured_declination_and_inclination_override_the_model() {
    let mut bed = TestBed::new();
    assert_eq!((bed.effective_field_angles_deg(), bed.compass.model_field_strength_ut()), ((None, None), None));
    bed.report_place(dresden());
    let field = model_field(dresden());
    let (declination_deg, inclination_deg) = (field.declination_deg, Some(field.inclination_deg));
    assert!(declination_deg.is_some());
    assert_eq!(bed.effective_field_angles_deg(), (declination_deg, inclination_deg));
    assert_eq!(bed.compass.model_field_strength_ut(), Some(field.total_ut));
    let report = bed.status_report();
    assert_eq!((report.settings, report.local_field.model_field()), (Settings::DEFAULT, Some(&field)));
    for (setting, angles_deg) in [
        (setting_change("DECLINATION", -3.5), (Some(-3.5), inclination_deg)),
        (setting_change("INCLINATION", 60.0), (Some(-3.5), Some(60.0))),
        (setting_change("DECLINATION", None), (declination_deg, Some(60.0))),
    ] {
        bed.set(setting);
        assert_eq!(bed.effective_field_angles_deg(), angles_deg, "{setting:?}");
    }
    let written = Settings { inclination_deg: Some(60.0), ..Settings::DEFAULT };
    assert_eq!(bed.flash.settings, written, "without the model's angles");
}

/// Unlike a flight, a tumble needs no attitude, and does not determine the inclination.
#[test]
fn a_tumble_needs_no_attitude_and_uses_the_model_s_inclination() {
    for (place, inclination_deg) in [(None, 0.0), (Some(dresden()), model_field(dresden()).inclination_deg)] {
        let mut bed = TestBed::new();
        if let Some(place) = place {
            bed.report_place(place);
        }
        bed.start(Procedure::Tumble);
        assert_eq!(bed.compass.instrument_correction().sample_attitude, SampleAttitude::Unknown);
        bed.tumble();
        bed.expect_done(Command::CalSolve(None));
        assert_eq!(bed.compass.instrument_correction().sample_attitude, SampleAttitude::Interpolated);
        let accuracy = bed.finish_solve().unwrap();
        assert_eq!(accuracy.quality.method, Method::Ellipsoid);
        assert_eq!(accuracy.heading_deg_per_attitude_deg.is_some(), place.is_some());
        assert_eq!(bed.compass.instrument_correction().has_valid_inclination, place.is_some());
        assert!((bed.calibrated_inclination_deg() - inclination_deg).abs() < 0.1);
        bed.start(Procedure::Level);
        assert_eq!(bed.compass.instrument_correction().sample_attitude, SampleAttitude::Interpolated);
    }
}
