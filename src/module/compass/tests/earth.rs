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

impl TestBed {
    fn set_place(&mut self, place: Position) {
        assert!(matches!(self.compass.process_event(Event::Position(place, self.time())), Effect::None));
        assert!(matches!(self.compass.process_event(Event::Date(today())), Effect::None));
    }

    fn effective_field_angles_deg(&self) -> (Option<f32>, Option<f32>) {
        let Settings { declination_deg, inclination_deg, .. } = self.compass.effective_settings();
        (declination_deg, inclination_deg)
    }

    /// Estimated inclination after few turns, degrees.
    fn solved_inclination_deg(&mut self) -> f32 {
        self.calibrate(&few_turns(&airframe(), 1)).unwrap();
        self.compass.active_record().unwrap().calibration.inclination_rad.to_degrees()
    }
}

/// An estimator that jumps by 1100 km is accepted once the vehicle is disarmed, as after a transport, but never while
/// it is armed or its armed state is unknown.
#[test]
fn a_distant_position_is_accepted_only_while_disarmed() {
    for (armed, is_accepted) in [(None, false), (Some(true), false), (Some(false), true)] {
        let mut bench = TestBed::new();
        bench.compass.process_event(Event::ArmedStateReported(armed));
        bench.set_place(dresden());
        for _ in 0..100 {
            bench.set_place(naples());
        }
        let expected = EarthField::from_model(if is_accepted { naples() } else { dresden() }, today());
        assert_eq!(bench.compass.model_field_strength_ut(), expected.map(|field| field.total_ut), "{armed:?}");
    }
}

#[test]
fn configured_declination_and_inclination_override_the_model() {
    let mut bench = TestBed::new();
    assert_eq!((bench.effective_field_angles_deg(), bench.compass.model_field_strength_ut()), ((None, None), None));
    bench.set_place(dresden());
    let field = EarthField::from_model(dresden(), today()).unwrap();
    let (declination_deg, inclination_deg) = (field.declination_deg, Some(field.inclination_deg));
    assert!(declination_deg.is_some());
    assert_eq!(
        (bench.effective_field_angles_deg(), bench.compass.model_field_strength_ut()),
        ((declination_deg, inclination_deg), Some(field.total_ut))
    );
    assert_eq!(bench.compass.stored_settings(), &Settings::DEFAULT);
    let report = bench.status_report();
    assert_eq!((report.settings, report.local_field.model_field()), (Settings::DEFAULT, Some(&field)));
    bench.save_by_command(Command::Set(SettingChange::Declination(Some(-3.5)))).unwrap();
    assert_eq!(bench.effective_field_angles_deg(), (Some(-3.5), inclination_deg));
    bench.save_by_command(Command::Set(SettingChange::Inclination(Some(60.0)))).unwrap();
    assert_eq!(bench.effective_field_angles_deg(), (Some(-3.5), Some(60.0)));
    bench.save_by_command(Command::Set(SettingChange::Declination(None))).unwrap();
    assert_eq!(bench.effective_field_angles_deg(), (declination_deg, Some(60.0)));
    assert!(matches!(bench.send_command(Command::Set(SettingChange::StreamOn(false))), Effect::Save));
    let written = Settings { inclination_deg: Some(60.0), stream_on: false, ..Settings::DEFAULT };
    assert!(matches!(bench.compass.pending_change(), Some(StoreChange::Settings(settings)) if *settings == written));
}

#[test]
fn the_model_s_inclination_reaches_the_solver() {
    let without_deg = TestBed::new().solved_inclination_deg();
    let mut bench = TestBed::new();
    bench.set_place(naples());
    let with_deg = bench.solved_inclination_deg();
    assert!(with_deg > without_deg + 0.008, "{with_deg} {without_deg}");
    let mut bench = TestBed::new();
    bench.save_by_command(Command::Set(SettingChange::Inclination(model_inclination_deg(naples())))).unwrap();
    assert!((bench.solved_inclination_deg() - with_deg).abs() < 1e-4);
}

fn model_inclination_deg(place: Position) -> Option<f32> {
    EarthField::from_model(place, today()).map(|field| field.inclination_deg)
}

#[test]
fn a_model_inclination_contradicted_by_the_samples_is_ignored() {
    let mut bench_without_model = TestBed::new();
    bench_without_model.solved_inclination_deg();
    let mut bench = TestBed::new();
    bench.set_place(dresden());
    bench.solved_inclination_deg();
    assert_eq!(bench.compass.active_record(), bench_without_model.compass.active_record());
    let mut bench = TestBed::new();
    bench.save_by_command(Command::Set(SettingChange::Inclination(model_inclination_deg(dresden())))).unwrap();
    let refused = bench.calibrate(&few_turns(&airframe(), 1));
    assert!(
        matches!(refused, Err(Refusal::Solve(SolveError::InclinationContradicted { found_deg: 55 }))),
        "{refused:?}"
    );
}

#[test]
fn a_tumble_at_a_known_position_uses_the_model_s_inclination() {
    for (place, knows) in [(None, false), (Some(dresden()), true)] {
        let mut bench = TestBed::new();
        if let Some(place) = place {
            bench.set_place(place);
        }
        bench.expect_done(Command::CalStart(Procedure::Tumble));
        bench.tumble();
        bench.expect_done(Command::CalSolve(None));
        let end = bench.run_solve();
        bench.outcome_after_save(end).unwrap();
        assert_eq!(bench.compass.instrument_correction().has_valid_inclination, knows);
        let solved_inclination_deg = bench.compass.active_record().unwrap().calibration.inclination_rad.to_degrees();
        assert!(
            (solved_inclination_deg - place.and_then(model_inclination_deg).unwrap_or(0.0)).abs() < 0.1,
            "{solved_inclination_deg}"
        );
    }
}
