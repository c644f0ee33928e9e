//! Marks of a compass swing, and alignment.

use super::*;

impl TestBed<'_> {
    /// A second at rest on a magnetic heading, with the field that this calibration corrects.
    fn stand_on_heading(&mut self, heading_deg: f32, calibration: &Calibration) {
        let earth = Field::earth_field(48.0, 1.0, heading_deg.to_radians());
        self.collect_at_rest(Field::new(earth.ut + calibration.b_vector_ut()), 8);
    }

    fn expect_mark_count(&mut self, heading_deg: f32, count: u16) {
        let reply = self.request_reply(Command::CalMark(heading_deg));
        assert!(matches!(reply, Ok(Reply::MarkCount(found)) if found == count), "{count}: {reply:?}");
    }
}

#[test]
fn each_mark_uses_its_own_second_of_samples() {
    let mut bed = TestBed::new();
    assert_eq!(bed.expect_refusal(Command::CalMark(10.0)), Refusal::NotSwinging);
    bed.start(Procedure::Turns);
    assert_eq!(bed.expect_refusal(Command::CalMark(10.0)), Refusal::NotSwinging);
    bed.collect_at_rest(test_field(), 8);
    bed.expect_done(Command::CalStop);
    bed.start(Procedure::Swing);
    assert_eq!(bed.expect_refusal(Command::CalMark(10.0)), Refusal::NotStationary);
    bed.collect_at_rest(test_field(), 8);
    for outside in [-0.1, 360.1, f32::NAN] {
        assert_eq!(bed.expect_refusal(Command::CalMark(outside)).stable_code(), "out-of-range");
    }
    bed.expect_mark_count(360.0, 1);
    assert_eq!(bed.expect_refusal(Command::CalMark(0.0)), Refusal::NotStationary);
    bed.collect_at_rest(test_field(), 7);
    assert_eq!(bed.expect_refusal(Command::CalMark(0.0)), Refusal::NotStationary);
    bed.collect_at_rest(test_field(), 1);
    bed.expect_mark_count(0.0, 2);
    bed.collect_at_rest(test_field(), 8);
    bed.advance_clock(3000);
    assert_eq!(bed.expect_refusal(Command::CalMark(0.0)), Refusal::NotStationary, "samples of 3 s ago");
}

#[test]
fn there_is_room_for_36_marks() {
    let mut bed = TestBed::new();
    bed.start(Procedure::Swing);
    for count in 1..=36_u16 {
        bed.collect_at_rest(test_field(), 8);
        bed.expect_mark_count(10.0 * f32::from(count), count);
    }
    bed.collect_at_rest(test_field(), 8);
    assert_eq!(bed.expect_refusal(Command::CalMark(10.0)), Refusal::TooManyMarks);
    let headings_rad = bed.compass.collector.fit_samples().marks.iter().map(|mark| mark.heading_rad);
    assert!(headings_rad.eq((1..=36_u16).map(|count| (10.0 * f32::from(count)).to_radians())));
}

/// Mountings are within 20 deg of a right angle: a larger alignment is more likely an error of the command, and must be
/// confirmed.
#[test]
fn alignment_removes_a_constant_heading_error() {
    let calibration = calibration_record(1).calibration;
    let mut bed = TestBed::with_calibrations(&[calibration_record(1)]);
    let align_commands: [fn(f32) -> Command; 2] = [|deg| Command::Align(Some(deg)), Command::AlignConfirmed];
    for align in align_commands {
        assert_eq!(bed.expect_refusal(align(100.0)), Refusal::NotStationary);
        assert_eq!(bed.expect_refusal(align(360.5)).stable_code(), "out-of-range");
    }
    for (shown_deg, given_deg, align_deg, is_confirmed) in [
        (90.0, 100.0, 10.0, false),
        (5.0, 350.0, -15.0, false),
        (350.0, 5.0, 15.0, false),
        (90.0, 109.0, 19.0, false),
        (90.0, 71.0, -19.0, false),
        (90.0, 111.0, 21.0, true),
        (90.0, 69.0, -21.0, true),
        (90.0, 271.0, -179.0, true),
    ] {
        bed.stand_on_heading(shown_deg, &calibration);
        if is_confirmed {
            let before_deg = bed.compass.stored_settings().align_deg;
            let refused = bed.expect_refusal(Command::Align(Some(given_deg)));
            assert!(bed.compass.stored_settings().align_deg.to_bits() == before_deg.to_bits(), "nothing has changed");
            let Refusal::LargeAlignment { heading_deg, align_deg: refused_deg } = refused else {
                panic!("{refused:?}")
            };
            assert!((heading_deg - given_deg).abs() < 0.01 && (refused_deg - align_deg).abs() < 0.01, "{refused:?}");
            bed.expect_saved(Command::AlignConfirmed(given_deg));
        } else {
            bed.expect_saved(Command::Align(Some(given_deg)));
        }
        for found_deg in [bed.flash.settings.align_deg, bed.compass.instrument_correction().align_deg] {
            assert!((found_deg - align_deg).abs() < 0.01, "{shown_deg} at {given_deg}: {found_deg}");
        }
    }
    bed.expect_saved(Command::Align(None));
    assert!(bed.compass.stored_settings().align_deg.abs() < f32::EPSILON);
}
