//! Tests of the compass field.

use super::super::tests::{
    PERIOD_US, SAMPLE_FIELD, correction_with, instrument_with, level_turn_rates_rad_s, process_reading,
    report_attitude, report_with_rates, saturated_reading, sensor_field, test_calibration, us_after_start,
};
use super::super::*;
use super::*;
use crate::calibration::Orientation;
use testkit::random::Random;

/// Another calibration of the same aircraft; headings differ by up to 12 deg.
fn other_calibration() -> Calibration {
    let w = [[1.05, 0.04, 0.0], [0.03, 0.97, 0.02], [-0.02, 0.0, 1.0]];
    Calibration { w, b_ut: [3.0, -4.0, 2.0], ..test_calibration() }
}

/// Sensor field from which a calibration makes the Earth's field on this heading, in level flight.
fn field_before_calibration(calibration: &Calibration, heading_deg: u16) -> Field<Sensor> {
    let earth_ut = sensor_field(f32::from(heading_deg).to_radians(), RollPitch::default()).ut;
    Field::new(inverse(&calibration.w_matrix()).unwrap() * earth_ut + calibration.b_vector_ut())
}

fn armed(mut correction: Correction) -> Correction {
    correction.is_armed = Some(true);
    correction
}

fn heading_deg(field: Field<Body>) -> f32 {
    RollPitch::default().to_level_frame(field).heading_rad().to_degrees()
}

fn turned_deg(from: Field<Body>, to: Field<Body>) -> f32 {
    wrap_pi((heading_deg(to) - heading_deg(from)).to_radians()).to_degrees()
}

fn is_near(output: Option<Field<Body>>, expected: Field<Body>) -> bool {
    output.is_some_and(|output| (output.ut - expected.ut).norm() < 2e-5)
}

/// The alignment is in both of them, and not in the field in body axes.
#[test]
fn headings_from_the_compass_field_match_ours_in_level_flight() {
    for align_deg in [0.0, 5.0, -30.0, 179.0] {
        for heading in (0_u16..360).step_by(15) {
            let mut instrument = instrument_with(Correction { align_deg, ..correction_with(other_calibration()) });
            report_attitude(&mut instrument, 0, RollPitch::default());
            let field = field_before_calibration(&other_calibration(), heading);
            let estimate = process_reading(&mut instrument, 0, field);
            let (ours_deg, output) = (estimate.heading.unwrap().magnetic_deg(), estimate.compass_field.unwrap());
            for (found_deg, expected_deg) in
                [(heading_deg(output), ours_deg), (ours_deg, f32::from(heading) + align_deg)]
            {
                let difference_deg = wrap_pi((found_deg - expected_deg).to_radians()).to_degrees();
                assert!(difference_deg.abs() < 1e-3, "align {align_deg} heading {heading}: {difference_deg}");
            }
            assert!((output.total_ut() - 50.0).abs() < 1e-3);
            assert!((output.ut.z - estimate.body_field.unwrap().ut.z).abs() < 1e-4);
            assert_eq!(estimate.body_field, Some(other_calibration().calibrated_field(field)));
        }
    }
}

/// If true and measured strength differ by more than a factor of 2, the sensor's scale is kept.
#[test]
fn the_compass_field_has_the_true_strength_where_it_is_known() {
    for (total_ut, sent_ut) in [
        (None, 50.0),
        (Some(47.5), 47.5),
        (Some(95.0), 95.0),
        (Some(110.0), 50.0),
        (Some(27.0), 27.0),
        (Some(22.0), 50.0),
        (Some(f32::NAN), 50.0),
        (Some(-50.0), 50.0),
    ] {
        let mut instrument = instrument_with(Correction { total_ut, ..correction_with(test_calibration()) });
        let output =
            process_reading(&mut instrument, 0, sensor_field(0.7, RollPitch::default())).compass_field.unwrap();
        assert!((output.total_ut() - sent_ut).abs() < 1e-3, "{total_ut:?}: {output:?}");
        assert!((heading_deg(output) - 0.7_f32.to_degrees()).abs() < 1e-3);
    }
}

/// Autopilots look for a compass at start-up, when it is unknown whether a calibration is stored for the chip.
#[test]
fn an_uncalibrated_module_sends_the_raw_field() {
    let mut instrument = instrument_with(Correction::UNCALIBRATED);
    assert_eq!(process_reading(&mut instrument, 0, SAMPLE_FIELD).compass_field, None);
    let mount = Orientation::from_name("yaw90");
    instrument.set_correction(Correction { mount, ..Correction::UNCALIBRATED });
    let estimate = process_reading(&mut instrument, PERIOD_US, SAMPLE_FIELD);
    assert_eq!(estimate.heading, Err(NoHeading::Uncalibrated));
    // A chip rotated to the right has its y axis towards the tail.
    assert_eq!(estimate.compass_field, Some(Field::from_ut(5.0, 20.0, 40.0)));
    let saturated = instrument.on_reading(us_after_start(2 * PERIOD_US), saturated_reading(SAMPLE_FIELD));
    assert_eq!(saturated.compass_field, None);
    assert_eq!(instrument.on_silence(us_after_start(1_000_000)).compass_field, None);
}

#[test]
fn the_raw_field_is_never_sent_after_a_calibration_was_used() {
    let mount = Some(Orientation::IDENTITY_ROTATION);
    let mut instrument = instrument_with(Correction { mount, ..correction_with(test_calibration()) });
    assert!(process_reading(&mut instrument, 0, SAMPLE_FIELD).compass_field.is_some());
    instrument.set_correction(Correction { mount, ..Correction::UNCALIBRATED });
    assert_eq!(process_reading(&mut instrument, PERIOD_US, SAMPLE_FIELD).compass_field, None);
    instrument.set_correction(Correction { mount, ..correction_with(other_calibration()) });
    let calibrated = process_reading(&mut instrument, 2 * PERIOD_US, SAMPLE_FIELD).compass_field;
    assert!(is_near(calibrated, other_calibration().calibrated_field(SAMPLE_FIELD)), "at once");
}

#[test]
fn without_attitude_only_the_field_strength_is_checked() {
    let output = |times: f32, attitude: Option<RollPitch>| {
        let mut instrument = instrument_with(correction_with(test_calibration()));
        if let Some(attitude) = attitude {
            report_attitude(&mut instrument, 0, attitude);
        }
        process_reading(&mut instrument, 0, Field::new(sensor_field(1.0, RollPitch::default()).ut * times))
            .compass_field
            .is_some()
    };
    for (times, expected) in [(1.0, true), (1.15, true), (1.25, false), (0.85, true), (0.75, false)] {
        assert_eq!(output(times, None), expected, "{times}");
        assert_eq!(output(times, Some(RollPitch::default())), expected, "{times} with attitude");
    }
    assert!(!output(f32::NAN, None) && !output(f32::INFINITY, None));
    assert!(!output(1.0, Some(RollPitch::from_deg(0.0, 40.0))), "an inclination that is not the Earth's");
}

fn instrument_with_verdict(verdict: Result<(), NoHeading>) -> Instrument {
    let mut instrument = instrument_with(correction_with(test_calibration()));
    report_attitude(&mut instrument, 0, RollPitch::default());
    (instrument.active_calibration.adjustment.validity, instrument.active_calibration.adjusted_at) =
        (verdict, us_after_start(0));
    instrument
}

/// A field that the monitor rejects is withheld with and without attitude; a rejected attitude does not withhold the
/// field.
#[test]
fn a_field_rejected_by_the_monitor_is_not_sent() {
    let field = sensor_field(1.0, RollPitch::default());
    for (verdict, output) in [
        (Ok(()), true),
        (Err(NoHeading::AttitudeContradicted), true),
        (Err(NoHeading::FieldDisturbed), false),
        (Err(NoHeading::FieldChanged), false),
    ] {
        let mut instrument = instrument_with_verdict(verdict);
        let estimate = process_reading(&mut instrument, 0, field);
        assert_eq!((estimate.heading.err(), estimate.compass_field.is_some()), (verdict.err(), output));
        let stale = process_reading(&mut instrument, 1_000_000, field);
        assert_eq!(
            (stale.heading, stale.compass_field.is_some()),
            (Err(NoHeading::AttitudeStale), output),
            "{verdict:?}"
        );
    }
    let strong = Field::new(field.ut * 1.3);
    assert_eq!(
        process_reading(&mut instrument_with_verdict(Err(NoHeading::AttitudeContradicted)), 0, strong).compass_field,
        None
    );
    // Without attitude the verdict of a disturbed field expires; that of changed hard iron does not.
    for (verdict, us, output) in [
        (NoHeading::FieldDisturbed, 9_000_000, false),
        (NoHeading::FieldDisturbed, 11_000_000, true),
        (NoHeading::FieldChanged, 3_600_000_000, false),
    ] {
        assert_eq!(
            process_reading(&mut instrument_with_verdict(Err(verdict)), us, field).compass_field.is_some(),
            output,
            "{verdict:?} after {us} us"
        );
    }
}

/// Full path through the monitor: 2 uT of added hard iron are compensated.
#[test]
fn added_hard_iron_is_compensated_in_the_compass_field() {
    let mut instrument = instrument_with(correction_with(test_calibration()));
    let mut random = Random(3);
    let mut last = None;
    for i in 0..80 * 120_u64 {
        let us = i * PERIOD_US;
        let heading_rad = 20_f32.to_radians() * us as f32 * 1e-6;
        let attitude = RollPitch::from_deg(5.0 + 0.1 * random.normal(), 0.1 * random.normal());
        if i % 2 == 0 {
            report_with_rates(&mut instrument, us, attitude, level_turn_rates_rad_s());
        }
        let noise = Vector3::from_fn(|_, _| 0.1 * random.normal());
        let hard_iron_change_ut = Vector3::new(2.0, 0.0, 0.0);
        let true_field = sensor_field(heading_rad, RollPitch::from_deg(5.0, 0.0)).ut;
        let estimate = process_reading(&mut instrument, us, Field::new(true_field + hard_iron_change_ut + noise));
        while instrument.next_sample().is_some() {}
        instrument.update_monitor();
        last = estimate.compass_field.map(|output| (output.ut - noise - true_field).norm());
    }
    assert!(instrument.active_calibration.adjusted_at > us_after_start(119_000_000), "the last sample");
    assert!(last.is_some_and(|off_ut| off_ut < 0.7), "{last:?} of 2 uT is left");
}

/// Compass field of a reading, without its plausibility checks.
fn output_at(instrument: &mut Instrument, us: u64, field: Field<Sensor>) -> Option<Field<Body>> {
    let Instrument { active_calibration: active, compass_field, .. } = instrument;
    compass_field.output_field(us_after_start(us), active, field, active.calibrated_field(field))
}

fn output_of_readings(
    instrument: &mut Instrument,
    from_us: u64,
    seconds: u64,
    field: Field<Sensor>,
) -> Vec<Field<Body>> {
    (0..seconds * 100).map(|i| output_at(instrument, from_us + i * 10_000, field).unwrap()).collect()
}

fn max_turn_rate_deg_s(output: &[Field<Body>]) -> f32 {
    output.windows(2).map(|pair| turned_deg(pair[0], pair[1]).abs() * 100.0).fold(0.0, f32::max)
}

/// Also in a field of another strength, whose calibration is scaled.
#[test]
fn while_armed_a_new_calibration_turns_the_heading_by_1_deg_s() {
    for (old, new, total_ut) in [
        (test_calibration(), other_calibration(), None),
        (other_calibration(), test_calibration(), None),
        (other_calibration(), test_calibration(), Some(40.0)),
    ] {
        let [old, correction] =
            [old, new].map(|calibration| armed(Correction { total_ut, ..correction_with(calibration) }));
        let strength_ratio = total_ut.unwrap_or(50.0) / 50.0;
        let mut worst = 0_f32;
        for heading in (0_u16..360).step_by(10) {
            let field = field_before_calibration(&new, heading);
            let mut instrument = instrument_with(old.clone());
            let before = output_at(&mut instrument, 0, field).unwrap();
            instrument.set_correction(correction.clone());
            let output = output_of_readings(&mut instrument, 0, 40, field);
            assert!(is_near(Some(output[0]), before));
            let expected = Field::new(new.calibrated_field(field).ut * strength_ratio);
            assert!(is_near(output.last().copied(), expected));
            let fastest_deg_s = max_turn_rate_deg_s(&output);
            // f32 rounding of 1e-5 deg per 10 ms is 1e-3 deg/s.
            assert!(fastest_deg_s < 1.01, "{total_ut:?} heading {heading}: {fastest_deg_s}");
            worst = worst.max(fastest_deg_s);
        }
        assert!(worst > 0.9, "{total_ut:?}: {worst}");
    }
}

/// For a change of 100 deg the field passes near zero, where headings turn fast.
#[test]
fn a_change_of_100_deg_also_turns_at_1_deg_s() {
    let field = sensor_field(0.3, RollPitch::default());
    let mut instrument = instrument_with(armed(correction_with(test_calibration())));
    output_at(&mut instrument, 0, field);
    instrument.set_correction(armed(Correction { align_deg: 100.0, ..correction_with(test_calibration()) }));
    let output = output_of_readings(&mut instrument, 0, 200, field);
    let fastest_deg_s = max_turn_rate_deg_s(&output);
    assert!((0.9..1.01).contains(&fastest_deg_s), "{fastest_deg_s}");
    assert!((turned_deg(output[0], output[output.len() - 1]) - 100.0).abs() < 0.01);
}

/// The blend goes from the raw field to a calibration, and to another calibration before it ends.
#[test]
fn a_further_change_starts_from_the_present_blend() {
    let mount = Some(Orientation::IDENTITY_ROTATION);
    let field = sensor_field(0.3, RollPitch::default());
    let mut instrument = instrument_with(armed(Correction { mount, ..Correction::UNCALIBRATED }));
    output_at(&mut instrument, 0, field);
    let aligned = |align_deg| armed(Correction { align_deg, mount, ..correction_with(test_calibration()) });
    instrument.set_correction(aligned(10.0));
    let mut all = output_of_readings(&mut instrument, 0, 5, field);
    instrument.set_correction(aligned(-10.0));
    all.extend(output_of_readings(&mut instrument, 5_000_000, 5, field));
    // Repeating a correction does not restart the blend.
    instrument.set_correction(aligned(-10.0));
    all.extend(output_of_readings(&mut instrument, 10_000_000, 20, field));
    assert!(max_turn_rate_deg_s(&all) < 1.01, "{}", max_turn_rate_deg_s(&all));
    let turned = |i: usize| turned_deg(all[0], all[i]);
    assert!((4.0..5.0).contains(&turned(499)), "{}", turned(499));
    assert!((-10.01..-9.99).contains(&turned(all.len() - 1)));
    let arrived = all.iter().position(|output| turned_deg(all[0], *output) < -9.99).unwrap();
    assert!((1_900..2_100).contains(&arrived), "15 deg more in some 15 s: {arrived}");
}

fn is_applied_at_once(instrument: &mut Instrument, us: u64, correction: Correction) -> bool {
    let field = sensor_field(0.3, RollPitch::default());
    output_at(instrument, us, field);
    instrument.set_correction(correction);
    is_near(output_at(instrument, us + 1, field), other_calibration().calibrated_field(field))
}

#[test]
fn while_disarmed_a_new_calibration_applies_at_once() {
    for (is_armed, expected) in [(Some(false), true), (Some(true), false), (None, false)] {
        let mut instrument = instrument_with(Correction { is_armed, ..correction_with(test_calibration()) });
        let correction = Correction { is_armed, ..correction_with(other_calibration()) };
        assert_eq!(is_applied_at_once(&mut instrument, 0, correction), expected, "{is_armed:?}");
    }
    // An armed vehicle may rest.
    let mut instrument = instrument_with(armed(correction_with(test_calibration())));
    for i in 0..200 {
        report_attitude(&mut instrument, i * 20_000, RollPitch::default());
    }
    assert!(!is_applied_at_once(&mut instrument, 4_000_000, armed(correction_with(other_calibration()))));
}

/// Without an armed state, two seconds of constant attitude mean on the ground. A source may have steps of 0.1 deg.
#[test]
fn two_seconds_of_constant_attitude_are_rest() {
    // Period of the reports and their duration, seconds; a move of roll and pitch, degrees; silence after them,
    // seconds.
    for (period_s, seconds, [roll_deg, pitch_deg], silence_s, expected) in [
        (0.02, 2.1, [0.0, 0.0], 0.0, true),
        (0.02, 1.9, [0.0, 0.0], 0.0, false),
        (0.02, 3.0, [0.2, 0.0], 0.0, true),
        (0.02, 3.0, [0.5, 0.0], 0.0, false),
        (0.02, 3.0, [-0.5, 0.0], 0.0, false),
        (0.02, 3.0, [0.0, 0.2], 0.0, true),
        (0.02, 3.0, [0.0, -0.5], 0.0, false),
        // Missing reports are no rest.
        (0.4, 3.2, [0.0, 0.0], 0.0, true),
        (0.6, 3.6, [0.0, 0.0], 0.0, false),
        (0.02, 3.0, [0.0, 0.0], 0.4, true),
        (0.02, 3.0, [0.0, 0.0], 0.6, false),
    ] {
        let mut instrument = instrument_with(correction_with(test_calibration()));
        let us = |s: f32| (s * 1e6) as u64;
        let steps = us(seconds) / us(period_s);
        for i in 0..=steps {
            let attitude = if i == steps / 2 { RollPitch::from_deg(roll_deg, pitch_deg) } else { RollPitch::default() };
            report_attitude(&mut instrument, i * us(period_s), attitude);
        }
        // Reports arrive with a latency of 20 ms.
        let asked_us = steps * us(period_s) + 20_000 + us(silence_s);
        let is_at_rest = is_applied_at_once(&mut instrument, asked_us, correction_with(other_calibration()));
        assert_eq!(is_at_rest, expected, "{period_s} s, {seconds} s, {roll_deg} {pitch_deg} deg, {silence_s} s");
    }
}

#[test]
fn rest_is_detected_on_a_slope_and_upside_down() {
    for mean_roll_deg in [10.0, 180.0] {
        let mut rest = RestDetector { rest_start: None, last_attitude_at: us_after_start(0) };
        for i in 0..200 {
            let roll_deg: f32 = mean_roll_deg + if i % 2 == 0 { 0.05 } else { -0.05 };
            let attitude = RollPitch { roll_rad: wrap_pi(roll_deg.to_radians()), pitch_rad: -0.14 };
            rest.update_rest(us_after_start(i * 20_000), attitude);
        }
        assert!(rest.is_at_rest(us_after_start(3_980_000)), "{mean_roll_deg} deg");
    }
}
