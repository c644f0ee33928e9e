use super::super::*;
use super::*;
use crate::attitude::{AttitudeConfig, BodyRates, SenderId};
use crate::calibration::{HeadingUncertainty, Orientation};
use crate::time::WrappingMillis;
use testkit::random::Random;

const PERIOD_US: u64 = 12_500;
const START_US: u64 = 1_000_000;

fn us_after_start(us: u64) -> Timestamp {
    Timestamp::from_us(START_US + us)
}

fn test_calibration() -> Calibration {
    Calibration { inclination_rad: 1.0, total_ut: 50.0, ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION) }
}

/// Another calibration of the same aircraft; headings differ by up to 12 deg.
fn other_calibration() -> Calibration {
    let w = [[1.05, 0.04, 0.0], [0.03, 0.97, 0.02], [-0.02, 0.0, 1.0]];
    Calibration { w, b_ut: [3.0, -4.0, 2.0], ..test_calibration() }
}

fn correction_with(calibration: Calibration) -> Correction {
    Correction { calibration: Some((calibration, HeadingUncertainty::NO_UNCERTAINTY)), ..Correction::UNCALIBRATED }
}

fn with_armed_state(is_armed: bool, correction: &Correction) -> Correction {
    Correction { is_armed: Some(is_armed), ..correction.clone() }
}

fn instrument_with_correction(correction: Correction) -> Instrument {
    let mut instrument = Instrument::new(InstrumentConfig::new(PERIOD_US as u32));
    instrument.set_correction(correction);
    instrument
}

fn sensor_field(heading_rad: f32, attitude: Attitude) -> Field<Sensor> {
    Field::new(attitude.to_body_frame(Field::earth_field(50.0, 1.0, heading_rad)).ut)
}

fn process_reading(instrument: &mut Instrument, us: u64, field: Field<Sensor>) -> Estimate {
    instrument.on_reading(us_after_start(us), Reading { field, is_saturated: false, was_overwritten: false })
}

fn report_attitude(instrument: &mut Instrument, us: u64, attitude: Attitude) {
    let (source, sender_clock_at_sending) = (SenderId::default(), WrappingMillis::default());
    let arrival = us_after_start(us).plus_signed_us(AttitudeConfig::DEFAULT.latency_us);
    instrument
        .on_attitude(arrival, AttitudeReport { sender: source, sender_clock_at_sending, attitude, body_rates: None });
}

fn heading_deg(field: Field<Body>) -> f32 {
    Attitude::default().to_level_frame(field).heading_rad().to_degrees()
}

fn turned_deg(from: Field<Body>, to: Field<Body>) -> f32 {
    wrap_pi((heading_deg(to) - heading_deg(from)).to_radians()).to_degrees()
}

const SAMPLE_FIELD: Field<Sensor> = Field::from_ut(20.0, -5.0, 40.0);

fn is_near(output: Option<Field<Body>>, expected: Field<Body>) -> bool {
    output.is_some_and(|output| (output.ut - expected.ut).norm() < 2e-5)
}

#[test]
fn headings_from_the_compass_field_match_ours_in_level_flight() {
    for align_deg in [0.0, 5.0, -30.0, 179.0] {
        for heading in (0_u16..360).step_by(15) {
            let mut instrument =
                instrument_with_correction(Correction { align_deg, ..correction_with(other_calibration()) });
            report_attitude(&mut instrument, 0, Attitude::default());
            // Sensor field whose correction is the Earth's field.
            let read_ut = inverse(&other_calibration().w_matrix()).unwrap()
                * sensor_field(f32::from(heading).to_radians(), Attitude::default()).ut
                + other_calibration().b_vector_ut();
            let estimate = process_reading(&mut instrument, 0, Field::new(read_ut));
            let ours_deg = estimate.heading.unwrap().magnetic_deg();
            let difference_deg =
                wrap_pi((heading_deg(estimate.compass_field.unwrap()) - ours_deg).to_radians()).to_degrees();
            assert!(difference_deg.abs() < 1e-3, "align {align_deg} heading {heading}: {difference_deg}");
            assert!((estimate.compass_field.unwrap().total_ut() - 50.0).abs() < 1e-3);
            assert!((estimate.compass_field.unwrap().ut.z - estimate.body_field.unwrap().ut.z).abs() < 1e-4);
        }
    }
}

/// If true and measured strength differ by more than a factor of 2, the sensor's scale is kept.
#[test]
fn the_compass_field_has_the_true_strength_where_it_is_known() {
    for (total_ut, told_ut) in [
        (None, 50.0),
        (Some(47.5), 47.5),
        (Some(100.0), 100.0),
        (Some(100.1), 50.0),
        (Some(25.0), 25.0),
        (Some(24.9), 50.0),
        (Some(f32::NAN), 50.0),
        (Some(-50.0), 50.0),
    ] {
        let mut instrument = instrument_with_correction(Correction { total_ut, ..correction_with(test_calibration()) });
        report_attitude(&mut instrument, 0, Attitude::default());
        let output = process_reading(&mut instrument, 0, sensor_field(0.7, Attitude::default())).compass_field.unwrap();
        assert!((output.total_ut() - told_ut).abs() < 1e-3, "{total_ut:?}: {output:?}");
        assert!((heading_deg(output) - 0.7_f32.to_degrees()).abs() < 1e-3);
    }
}

/// Autopilots look for a compass at start-up, when it is unknown whether a calibration is stored for the chip.
#[test]
fn an_uncalibrated_module_sends_the_raw_field() {
    let mut instrument = instrument_with_correction(Correction::UNCALIBRATED);
    assert_eq!(process_reading(&mut instrument, 0, SAMPLE_FIELD).compass_field, None);
    let mount = Orientation::from_name("yaw90");
    instrument.set_correction(Correction { mount, ..Correction::UNCALIBRATED });
    let estimate = process_reading(&mut instrument, PERIOD_US, SAMPLE_FIELD);
    assert_eq!(estimate.heading, Err(NoHeading::Uncalibrated));
    // A chip rotated to the right has its y axis towards the tail.
    assert_eq!(estimate.compass_field, Some(Field::from_ut(5.0, 20.0, 40.0)));
    let saturated = Reading { field: SAMPLE_FIELD, is_saturated: true, was_overwritten: false };
    assert_eq!(instrument.on_reading(us_after_start(2 * PERIOD_US), saturated).compass_field, None);
    assert_eq!(instrument.on_silence(us_after_start(1_000_000)).compass_field, None);
}

#[test]
fn the_raw_field_is_never_sent_after_a_calibration_was_used() {
    let mount = Some(Orientation::IDENTITY_ROTATION);
    let mut instrument = instrument_with_correction(Correction { mount, ..correction_with(test_calibration()) });
    assert!(process_reading(&mut instrument, 0, SAMPLE_FIELD).compass_field.is_some());
    instrument.set_correction(Correction { mount, ..Correction::UNCALIBRATED });
    assert_eq!(process_reading(&mut instrument, PERIOD_US, SAMPLE_FIELD).compass_field, None);
    instrument.set_correction(Correction { mount, ..correction_with(other_calibration()) });
    assert!(
        is_near(
            process_reading(&mut instrument, 2 * PERIOD_US, SAMPLE_FIELD).compass_field,
            other_calibration().calibrated_field(SAMPLE_FIELD)
        ),
        "at once"
    );
}

#[test]
fn a_missing_or_frozen_attitude_keeps_the_compass_field() {
    let level = Attitude::default();
    let mut instrument = instrument_with_correction(correction_with(test_calibration()));
    let missing = process_reading(&mut instrument, 0, sensor_field(1.0, level));
    assert_eq!((missing.heading, missing.compass_field.is_some()), (Err(NoHeading::AttitudeStale), true));
    report_attitude(&mut instrument, 0, level);
    let stale = process_reading(&mut instrument, 900_000, sensor_field(1.0, level));
    assert_eq!((stale.heading, stale.compass_field.is_some()), (Err(NoHeading::AttitudeStale), true));
    for i in 0..30 {
        report_attitude(&mut instrument, 1_000_000 + i * 20_000, Attitude::from_deg(0.003 * i.min(20) as f32, 0.0));
        let field = Field::new(sensor_field(1.0, level).ut * (1.0 + 1e-4 * i as f32));
        let estimate = process_reading(&mut instrument, 1_000_000 + i * 20_000 + 20_001, field);
        assert!(estimate.compass_field.is_some(), "{:?}", estimate.heading);
    }
    let estimate = process_reading(&mut instrument, 1_600_002, sensor_field(1.0, level));
    assert_eq!((estimate.heading, estimate.compass_field.is_some()), (Err(NoHeading::AttitudeFrozen), true));
}

#[test]
fn without_attitude_only_the_field_strength_is_checked() {
    let output = |times: f32, attitude: Option<Attitude>| {
        let mut instrument = instrument_with_correction(correction_with(test_calibration()));
        if let Some(attitude) = attitude {
            report_attitude(&mut instrument, 0, attitude);
        }
        process_reading(&mut instrument, 0, Field::new(sensor_field(1.0, Attitude::default()).ut * times))
            .compass_field
            .is_some()
    };
    for (times, expected) in [(1.0, true), (1.199, true), (1.201, false), (0.801, true), (0.799, false)] {
        assert_eq!(output(times, None), expected, "{times}");
        assert_eq!(output(times, Some(Attitude::default())), expected, "{times} with attitude");
    }
    assert!(!output(f32::NAN, None) && !output(f32::INFINITY, None));
    assert!(!output(1.0, Some(Attitude::from_deg(0.0, 40.0))), "an inclination that is not the Earth's");
}

fn instrument_with_verdict(verdict: Result<(), NoHeading>) -> Instrument {
    let mut instrument = instrument_with_correction(correction_with(test_calibration()));
    report_attitude(&mut instrument, 0, Attitude::default());
    (instrument.active_calibration.adjustment.validity, instrument.active_calibration.adjusted_at) =
        (verdict, us_after_start(0));
    instrument
}

/// A field that the monitor rejects is withheld with and without attitude; a rejected attitude does not withhold the
/// field.
#[test]
fn a_field_rejected_by_the_monitor_is_not_sent() {
    let field = sensor_field(1.0, Attitude::default());
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
        (NoHeading::FieldDisturbed, 10_000_000, false),
        (NoHeading::FieldDisturbed, 10_000_001, true),
        (NoHeading::FieldChanged, 3_600_000_000, false),
    ] {
        assert_eq!(
            process_reading(&mut instrument_with_verdict(Err(verdict)), us, field).compass_field.is_some(),
            output,
            "{verdict:?} after {us} us"
        );
    }
}

#[test]
fn the_compass_field_uses_the_monitored_calibration() {
    let mut instrument = instrument_with_correction(correction_with(test_calibration()));
    let monitored = Calibration { b_ut: [1.0, 0.0, 0.0], ..test_calibration() };
    instrument.active_calibration.adjusted_calibration = Some((monitored, HeadingUncertainty::NO_UNCERTAINTY));
    assert!(is_near(
        process_reading(&mut instrument, 0, SAMPLE_FIELD).compass_field,
        monitored.calibrated_field(SAMPLE_FIELD)
    ));
    instrument.set_correction(with_armed_state(true, &correction_with(test_calibration())));
    assert!(is_near(
        process_reading(&mut instrument, PERIOD_US, SAMPLE_FIELD).compass_field,
        monitored.calibrated_field(SAMPLE_FIELD)
    ));
}

/// Full path through the monitor: 2 uT of added hard iron are compensated.
#[test]
fn added_hard_iron_is_compensated_in_the_compass_field() {
    let mut instrument = instrument_with_correction(correction_with(test_calibration()));
    let mut random = Random(3);
    let mut last = None;
    for i in 0..80 * 120_u64 {
        let us = i * PERIOD_US;
        let heading_rad = 20_f32.to_radians() * us as f32 * 1e-6;
        let attitude = Attitude::from_deg(5.0 + 0.1 * random.normal(), 0.1 * random.normal());
        if i % 2 == 0 {
            let (source, sender_clock_at_sending) = (SenderId::default(), WrappingMillis::default());
            let roll_rad = 5_f32.to_radians();
            let rates_rad_s = [0.0, roll_rad.sin(), roll_rad.cos()].map(|part| 20_f32.to_radians() * part);
            let report = AttitudeReport {
                sender: source,
                sender_clock_at_sending,
                attitude,
                body_rates: BodyRates::from_rad_s(rates_rad_s),
            };
            instrument.on_attitude(us_after_start(us).plus_signed_us(AttitudeConfig::DEFAULT.latency_us), report);
        }
        let noise = Vector3::from_fn(|_, _| 0.1 * random.normal());
        let hard_iron_change_ut = Vector3::new(2.0, 0.0, 0.0);
        let true_field = sensor_field(heading_rad, Attitude::from_deg(5.0, 0.0)).ut;
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

#[test]
fn while_armed_a_new_calibration_turns_the_heading_by_1_deg_s() {
    for (old, new) in [(test_calibration(), other_calibration()), (other_calibration(), test_calibration())] {
        let mut worst = 0_f32;
        for heading in (0_u16..360).step_by(10) {
            let read_ut = inverse(&new.w_matrix()).unwrap()
                * sensor_field(f32::from(heading).to_radians(), Attitude::default()).ut
                + new.b_vector_ut();
            let field = Field::new(read_ut);
            let mut instrument = instrument_with_correction(with_armed_state(true, &correction_with(old)));
            let before = output_at(&mut instrument, 0, field).unwrap();
            instrument.set_correction(with_armed_state(true, &correction_with(new)));
            let output = output_of_readings(&mut instrument, 0, 40, field);
            assert!(is_near(Some(output[0]), before));
            assert!(is_near(output.last().copied(), new.calibrated_field(field)));
            let fastest_deg_s = max_turn_rate_deg_s(&output);
            // f32 rounding of 1e-5 deg per 10 ms is 1e-3 deg/s.
            assert!(fastest_deg_s < 1.01, "heading {heading}: {fastest_deg_s}");
            worst = worst.max(fastest_deg_s);
        }
        assert!(worst > 0.9, "{worst}");
    }
}

/// For a change of 100 deg the field passes near zero, where headings turn fast.
#[test]
fn a_change_of_100_deg_also_turns_at_1_deg_s() {
    let field = sensor_field(0.3, Attitude::default());
    let mut instrument = instrument_with_correction(with_armed_state(true, &correction_with(test_calibration())));
    output_at(&mut instrument, 0, field);
    instrument.set_correction(Correction {
        align_deg: 100.0,
        ..with_armed_state(true, &correction_with(test_calibration()))
    });
    let output = output_of_readings(&mut instrument, 0, 200, field);
    let fastest_deg_s = max_turn_rate_deg_s(&output);
    assert!((0.9..1.01).contains(&fastest_deg_s), "{fastest_deg_s}");
    assert!((turned_deg(output[0], output[output.len() - 1]) - 100.0).abs() < 0.01);
}

/// The blend goes from the raw field to a calibration, and to another calibration before it ends.
#[test]
fn a_further_change_starts_from_the_present_blend() {
    let mount = Some(Orientation::IDENTITY_ROTATION);
    let field = sensor_field(0.3, Attitude::default());
    let mut instrument =
        instrument_with_correction(with_armed_state(true, &Correction { mount, ..Correction::UNCALIBRATED }));
    output_at(&mut instrument, 0, field);
    let aligned =
        |align_deg| with_armed_state(true, &Correction { align_deg, mount, ..correction_with(test_calibration()) });
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

#[test]
fn a_blend_continues_after_disarming() {
    let field = sensor_field(0.3, Attitude::default());
    let mut instrument = instrument_with_correction(with_armed_state(true, &correction_with(test_calibration())));
    output_at(&mut instrument, 0, field);
    let changed = Correction { align_deg: 10.0, ..correction_with(test_calibration()) };
    instrument.set_correction(with_armed_state(true, &changed));
    let before = output_of_readings(&mut instrument, 0, 5, field);
    instrument.set_correction(with_armed_state(false, &changed));
    let after = output_of_readings(&mut instrument, 5_000_000, 1, field);
    assert!(turned_deg(before[before.len() - 1], after[0]).abs() < 0.02);
}

fn is_applied_at_once(instrument: &mut Instrument, us: u64, correction: Correction) -> bool {
    let field = sensor_field(0.3, Attitude::default());
    output_at(instrument, us, field);
    instrument.set_correction(correction);
    is_near(output_at(instrument, us + 1, field), other_calibration().calibrated_field(field))
}

#[test]
fn while_disarmed_a_new_calibration_applies_at_once() {
    for (is_armed, expected) in [(Some(false), true), (Some(true), false), (None, false)] {
        let mut instrument = instrument_with_correction(Correction { is_armed, ..correction_with(test_calibration()) });
        let correction = Correction { is_armed, ..correction_with(other_calibration()) };
        assert_eq!(is_applied_at_once(&mut instrument, 0, correction), expected, "{is_armed:?}");
    }
    let mut instrument = instrument_with_correction(with_armed_state(true, &correction_with(test_calibration())));
    for i in 0..200 {
        report_attitude(&mut instrument, i * 20_000, Attitude::default());
    }
    assert!(!is_applied_at_once(
        &mut instrument,
        4_000_000,
        with_armed_state(true, &correction_with(other_calibration()))
    ));
}

/// Without an armed state, two seconds of constant attitude mean on the ground.
#[test]
fn two_seconds_of_constant_attitude_are_rest() {
    let latency_us = AttitudeConfig::DEFAULT.latency_us.unsigned_abs();
    let rests = |step_us: u64, seconds: f32, moves_deg: (f32, f32), asked_after_us: u64| {
        let mut instrument = instrument_with_correction(correction_with(test_calibration()));
        let steps = (seconds * 1e6) as u64 / step_us;
        for i in 0..=steps {
            let (roll_deg, pitch_deg) = if i == steps / 2 { moves_deg } else { (0.0, 0.0) };
            report_attitude(&mut instrument, i * step_us, Attitude::from_deg(roll_deg, pitch_deg));
        }
        let us = steps * step_us + u64::from(latency_us) + asked_after_us;
        is_applied_at_once(&mut instrument, us, correction_with(other_calibration()))
    };
    assert!(rests(20_000, 2.0, (0.0, 0.0), 0));
    assert!(!rests(20_000, 1.98, (0.0, 0.0), 0));
    for (moves_deg, expected) in
        [((0.28, 0.0), true), ((0.3, 0.0), false), ((-0.3, 0.0), false), ((0.0, 0.28), true), ((0.0, -0.3), false)]
    {
        assert_eq!(rests(20_000, 3.0, moves_deg, 0), expected, "{moves_deg:?}");
    }
    // Gaps between reports and missing reports are not rest.
    assert!(rests(500_000, 3.0, (0.0, 0.0), 0) && !rests(500_001, 3.1, (0.0, 0.0), 0));
    assert!(rests(20_000, 3.0, (0.0, 0.0), 500_000) && !rests(20_000, 3.0, (0.0, 0.0), 500_001));
}

#[test]
fn rest_is_detected_on_a_slope_and_upside_down() {
    for mean_roll_deg in [10.0, 180.0] {
        let mut rest = RestDetector { rest_start: None, last_attitude_at: us_after_start(0) };
        for i in 0..200 {
            let roll_deg: f32 = mean_roll_deg + if i % 2 == 0 { 0.05 } else { -0.05 };
            let attitude = Attitude { roll_rad: wrap_pi(roll_deg.to_radians()), pitch_rad: -0.14 };
            rest.update_rest(us_after_start(i * 20_000), attitude);
        }
        assert!(rest.is_at_rest(us_after_start(3_980_000)), "{mean_roll_deg} deg");
    }
}

#[test]
fn every_blend_ends() {
    let mut random = Random(9);
    for _ in 0..2_000 {
        let mut any = || {
            let mut number = || random.uniform(-3.0, 3.0);
            let w = [(); 3].map(|()| [(); 3].map(|()| number()));
            Calibration { w, b_ut: [(); 3].map(|()| 30.0 * number()), ..test_calibration() }
        };
        let (from, to) = (any(), any());
        let active = ActiveCalibration::new(correction_with(to));
        let [before, after] = [from, to].map(|calibration| FieldMap::new(&calibration, &active.output_map));
        let seconds = blend_duration_s(&before, &after, &to, &active);
        assert!((0.0..=MAX_BLEND_S).contains(&seconds), "{seconds}");
    }
    let flat = Calibration { w: [[0.0; 3]; 3], ..test_calibration() };
    let active = ActiveCalibration::new(correction_with(flat));
    let map = FieldMap::new(&flat, &active.output_map);
    assert!(blend_duration_s(&map, &map, &flat, &active).abs() < 1e-9, "a singular map applies at once");
}

/// In level flight on any heading the fastest moment of a blend has 1 deg/s, less the sampling margin of 5 %, also in a
/// field of another strength.
#[test]
fn the_fastest_moment_of_a_blend_has_1_deg_s() {
    for (b_ut, total_ut) in [([2.0, 0.0, 0.0], None), ([-6.0, 9.0, 1.0], None), ([6.0, 3.0, 0.0], Some(40.0))] {
        let active = ActiveCalibration::new(Correction { total_ut, ..correction_with(test_calibration()) });
        let [from, to] = [Calibration { b_ut, ..other_calibration() }, test_calibration()]
            .map(|calibration| FieldMap::new(&calibration, &active.output_map));
        let seconds = blend_duration_s(&from, &to, &test_calibration(), &active);
        let sensor_field = to.inverse().unwrap();
        let fastest_rad = (0_u16..360)
            .flat_map(|heading| {
                let earth = Field::earth_field(total_ut.unwrap_or(50.0), 1.0, f32::from(heading).to_radians());
                let field = sensor_field(Attitude::default().to_body_frame(earth));
                let heading_rad = |step: u16| {
                    heading_deg(from.interpolate(&to, f32::from(step) / 1000.0).map_field(field)).to_radians()
                };
                (0..1000).map(|step| wrap_pi(heading_rad(step + 1) - heading_rad(step)).abs()).collect::<Vec<_>>()
            })
            .fold(0.0, f32::max);
        let fastest_deg_s = fastest_rad.to_degrees() * 1000.0 / seconds;
        assert!((0.93..=1.0).contains(&fastest_deg_s), "{b_ut:?}: {fastest_deg_s}");
    }
}

#[test]
fn a_blend_with_unknown_inclination_takes_longer() {
    let seconds = |knows_inclination| {
        let correction = Correction { has_valid_inclination: knows_inclination, ..correction_with(test_calibration()) };
        let active = ActiveCalibration::new(correction);
        let from = FieldMap::new(&Calibration { b_ut: [2.0, 0.0, 0.0], ..test_calibration() }, &active.output_map);
        blend_duration_s(&from, &FieldMap::new(&test_calibration(), &active.output_map), &test_calibration(), &active)
    };
    assert!(seconds(false) > 1.3 * seconds(true), "{} {}", seconds(false), seconds(true));
}

#[test]
fn corrections_with_same_headings_are_recognised() {
    let correction = correction_with(test_calibration());
    let changed = [
        with_armed_state(true, &correction),
        Correction { total_ut: Some(48.0), ..correction.clone() },
        Correction { mount: Some(Orientation::IDENTITY_ROTATION), ..correction.clone() },
    ];
    assert!(changed.iter().all(|other| other.gives_same_headings(&correction)));
    let others = [
        correction_with(other_calibration()),
        Correction { align_deg: 1.0, ..correction.clone() },
        Correction { has_valid_inclination: false, ..correction.clone() },
    ];
    assert!(others.iter().all(|other| !other.gives_same_headings(&correction)));
}
