//! Marks of a compass swing, and alignment.

use super::*;

#[test]
fn each_mark_uses_its_own_second_of_samples() {
    let mut bench = TestBed::new();
    assert_eq!(bench.expect_refusal(Command::CalMark(10.0)), Refusal::NotSwinging);
    bench.expect_done(Command::CalStart(Procedure::Turns));
    assert_eq!(bench.expect_refusal(Command::CalMark(10.0)), Refusal::NotSwinging);
    bench.collect_at_rest(test_field(), 8);
    bench.expect_done(Command::CalStop);
    bench.expect_done(Command::CalStart(Procedure::Swing));
    assert_eq!(bench.expect_refusal(Command::CalMark(10.0)), Refusal::NotStationary);
    bench.collect_at_rest(test_field(), 8);
    for outside in [-0.1, 360.1, f32::NAN] {
        assert_eq!(bench.expect_refusal(Command::CalMark(outside)).stable_code(), "out-of-range");
    }
    assert!(matches!(bench.request_reply(Command::CalMark(360.0)), Ok(Reply::MarkCount(1))));
    assert_eq!(bench.expect_refusal(Command::CalMark(0.0)), Refusal::NotStationary);
    bench.collect_at_rest(test_field(), 7);
    assert_eq!(bench.expect_refusal(Command::CalMark(0.0)), Refusal::NotStationary);
    bench.collect_at_rest(test_field(), 1);
    assert!(matches!(bench.request_reply(Command::CalMark(0.0)), Ok(Reply::MarkCount(2))));
    // Samples older than 1 s are ignored.
    bench.collect_at_rest(test_field(), 8);
    bench.now_ms = bench.now_ms.wrapping_add(3000);
    assert_eq!(bench.expect_refusal(Command::CalMark(0.0)), Refusal::NotStationary);
}

#[test]
fn there_is_room_for_36_marks() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Swing));
    for number in 1..=36 {
        bench.collect_at_rest(test_field(), 8);
        assert!(matches!(bench.request_reply(Command::CalMark(10.0)), Ok(Reply::MarkCount(n)) if n == number));
    }
    bench.collect_at_rest(test_field(), 8);
    assert_eq!(bench.expect_refusal(Command::CalMark(10.0)), Refusal::TooManyMarks);
}

#[test]
fn alignment_removes_a_constant_heading_error() {
    let stored_calibrations =
        StoredCalibrations { current_calibration: Some(calibration_record(1)), previous_calibration: None };
    let mut bench = TestBed::with_state(AcceptancePolicy::DEFAULT, stored_calibrations);
    assert_eq!(bench.expect_refusal(Command::Align(Some(100.0))), Refusal::NotStationary);
    assert_eq!(bench.expect_refusal(Command::Align(Some(360.5))).stable_code(), "out-of-range");
    let calibration = calibration_record(1).calibration;
    for (shown_deg, given_heading_deg, align_deg) in [(90.0, 100.0, 10.0), (5.0, 350.0, -15.0), (350.0, 5.0, 15.0)] {
        let earth = Field::earth_field(48.0, 1.0, f32::to_radians(shown_deg));
        bench.collect_at_rest(Field::new(earth.ut + calibration.b_vector_ut()), 8);
        bench.save_by_command(Command::Align(Some(given_heading_deg))).unwrap();
        let found_deg = bench.compass.stored_settings().align_deg;
        assert!((found_deg - align_deg).abs() < 0.01, "{shown_deg} at {given_heading_deg}: {found_deg}");
        assert!((bench.compass.instrument_correction().align_deg - align_deg).abs() < 0.01);
    }
    bench.save_by_command(Command::Align(None)).unwrap();
    assert!(bench.compass.stored_settings().align_deg.abs() < f32::EPSILON);
}

#[test]
fn a_large_alignment_must_be_confirmed() {
    let calibration = calibration_record(1).calibration;
    let mut bench = TestBed::with_state(
        AcceptancePolicy::DEFAULT,
        StoredCalibrations { current_calibration: Some(calibration_record(1)), previous_calibration: None },
    );
    let earth = Field::earth_field(48.0, 1.0, f32::to_radians(90.0));
    let stand = |bench: &mut TestBed| bench.collect_at_rest(Field::new(earth.ut + calibration.b_vector_ut()), 8);
    for (given_heading_deg, align_deg) in [(109.9, 19.9), (70.1, -19.9)] {
        stand(&mut bench);
        bench.save_by_command(Command::Align(Some(given_heading_deg))).unwrap();
        assert!((bench.compass.stored_settings().align_deg - align_deg).abs() < 0.01);
    }
    for (given_heading_deg, align_deg, words) in [
        (110.5, 20.5, "every heading would be turned by 20.5 deg, "),
        (69.5, -20.5, "every heading would be turned by -20.5 deg, "),
        (271.0, -179.0, "every heading would be turned by -179.0 deg, "),
    ] {
        let before_deg = bench.compass.stored_settings().align_deg;
        stand(&mut bench);
        let refused = bench.expect_refusal(Command::Align(Some(given_heading_deg)));
        assert!(bench.compass.stored_settings().align_deg.to_bits() == before_deg.to_bits(), "nothing has changed");
        let repeat = format!("; if that is right: set align {given_heading_deg} yes");
        let refusal_text = refused.to_string();
        assert!(
            refused.stable_code() == "needs-word" && refusal_text.starts_with(words) && refusal_text.ends_with(&repeat),
            "{refusal_text}"
        );
        bench.save_by_command(Command::AlignConfirmed(given_heading_deg)).unwrap();
        assert!((bench.compass.stored_settings().align_deg - align_deg).abs() < 0.01);
    }
    assert_eq!(bench.expect_refusal(Command::AlignConfirmed(360.5)).stable_code(), "out-of-range");
    bench.now_ms = bench.now_ms.wrapping_add(60_000);
    assert_eq!(bench.expect_refusal(Command::AlignConfirmed(100.0)), Refusal::NotStationary);
}
