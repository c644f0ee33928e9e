//! Unit tests of changes of hard iron, and of the sensor.

mod steps;

use nalgebra::Vector3;

use super::comparison::is_large;
use super::*;
use crate::replay::change_fit::Hypothesis;
use crate::replay::evaluation::CompassEvaluation;
use crate::replay::tests::compass_of_flown_turns;
use crate::test_flight::{HORIZONTAL_FIELD_UT, SOFT_IRON, evaluate_compass, record_turns};

const TOTAL_UT: f64 = 50.0;

/// Changes found in the flown turns, by a flight with or without measured rates, with steps of the raw field: times,
/// seconds, and microtesla.
fn changes_by_steps(has_rates: bool, steps: &[(f64, [f32; 3])]) -> Vec<HardIronChange> {
    let (mut flight, mut compass) = compass_of_flown_turns();
    flight.has_measured_rates = has_rates;
    for row in &mut compass.rows {
        for (_, step_ut) in steps.iter().filter(|(at_s, _)| row.t_s >= *at_s) {
            row.raw_field.ut += Vector3::from(*step_ut);
        }
        row.logged_field = row.raw_field;
    }
    let initial = compass.parameter_fit.correction().unwrap();
    find_changes(&compass.rows, &flight, &initial, TOTAL_UT).unwrap()
}

/// Times to a second, steps to a fifth, heading effects to a fifth of those by the soft iron of the flight.
fn assert_changes(found: &[HardIronChange], steps: &[(f64, [f32; 3])], about: &str) {
    assert_eq!(found.len(), steps.len(), "{about}: {found:?}");
    for (change, (at_s, step_ut)) in found.iter().zip(steps) {
        let step_ut = Vector3::from(*step_ut).map(f64::from);
        let off_ut = change.step_ut - step_ut;
        assert!((change.time_s - at_s).abs() < 1.0, "{about}: {change:?}");
        assert!(off_ut.norm() < 0.2 * step_ut.norm(), "{about}: {change:?}");
        let moved_ut = SOFT_IRON.try_inverse().unwrap() * step_ut;
        let effect_deg = libm::atan(moved_ut.xy().norm() / HORIZONTAL_FIELD_UT).to_degrees();
        assert!((change.heading_effect_deg / effect_deg - 1.0).abs() < 0.2, "{about}: {change:?} {effect_deg}");
    }
}

#[test]
fn steps_of_hard_iron_are_found_with_their_effect_on_headings() {
    for (has_rates, steps) in [
        (true, &[(120.0, [6.0, -4.0, 3.0])][..]),
        (true, &[(60.0, [-4.0, 6.0, 3.0])]),
        (true, &[(180.0, [5.0, 5.0, -4.0])]),
        (true, &[(75.0, [6.0, -4.0, 3.0]), (150.0, [-2.0, 7.0, 4.0])]),
        (true, &[]),
        (false, &[(120.0, [6.0, -4.0, 3.0])]),
        (false, &[(60.0, [-4.0, 6.0, 3.0])]),
        (false, &[(180.0, [5.0, 5.0, -4.0])]),
        (false, &[]),
    ] {
        assert_changes(&changes_by_steps(has_rates, steps), steps, &format!("{has_rates} {steps:?}"));
    }
}

#[test]
fn a_step_of_the_strength_of_the_earths_field_is_none_of_hard_iron() {
    assert_changes(&changes_by_steps(false, &[(120.0, [50.0, -20.0, 30.0])]), &[], "62 uT");
}

#[test]
fn no_rows_are_between_changes_that_are_closer_than_the_time_left_out() {
    let (_, compass) = compass_of_flown_turns();
    for (times_s, is_empty) in [([100.0, 100.2], true), ([100.0, 101.0], true), ([100.0, 105.0], false)] {
        assert_eq!(rows_between(&compass.rows, times_s).is_empty(), is_empty, "{times_s:?}");
    }
}

/// A copter turns for half a minute, then stands on one heading, where strength and inclination leave the horizontal
/// part of a step free along a circle. By the body rates, a reference, or without both the headings on each side, a step
/// along the circle is no change unless it turned the heading; a step along the field is one without that.
#[test]
fn a_step_that_did_not_turn_the_heading_is_no_change() {
    use autoswing::frames::{Field, Level, RollPitch};

    use crate::log::LoggedFlight;
    use crate::test_flight::flight_of_motion;

    let heading_rad = |t_s: f64| (0.3 * t_s.min(30.0)) as f32;
    let with_rates = flight_of_motion(10.0, 600, |t_s| {
        ([0.0, 0.0, heading_rad(t_s)], [0.0, 0.0, if t_s < 30.0 { 0.3 } else { 0.0 }])
    });
    let without_rates = LoggedFlight { has_measured_rates: false, ..with_rates.clone() };
    let rows = |step_ut: [f32; 3], has_reference: bool| -> Vec<ReplayRow> {
        let row = |i: i32| {
            let t_s = f64::from(i) / 10.0;
            let earth = Field::<Level>::earth_field(50.0, 60_f32.to_radians(), heading_rad(t_s)).ut;
            let field = earth + if t_s >= 35.0 { Vector3::from(step_ut) } else { Vector3::zeros() };
            let reference_deg = has_reference.then(|| f64::from(heading_rad(t_s).to_degrees()));
            ReplayRow { reference_deg, ..ReplayRow::of_field(t_s, Field::new(field), RollPitch::default()) }
        };
        (0..600).map(row).collect()
    };
    // On this heading the field is ahead by -22.6 uT and to the right by -10.7 uT: turned by 50 deg it is as strong.
    let across = [-9.0, -8.13].map(|heading_rad| {
        let (sin, cos) = libm::sincosf(heading_rad);
        [25.0 * cos, 25.0 * sin]
    });
    let along_circle = [across[1][0] - across[0][0], across[1][1] - across[0][1], 0.0];
    let along_field = [0.3 * across[0][0], 0.3 * across[0][1], 0.0];
    for (name, flight, has_reference, happened_ut, claimed_ut, is_possible) in [
        ("rates, none happened", &with_rates, false, [0.0; 3], along_circle, false),
        ("rates, happened", &with_rates, false, along_circle, along_circle, true),
        ("rates, along the field", &with_rates, false, along_field, along_field, true),
        ("reference, none happened", &without_rates, true, [0.0; 3], along_circle, false),
        ("reference, happened", &without_rates, true, along_circle, along_circle, true),
        ("one heading after it", &without_rates, false, along_circle, along_circle, false),
    ] {
        let change = HardIronChange {
            time_s: 35.0,
            step_ut: Vector3::from(claimed_ut).map(f64::from),
            sigma_ut: Vector3::repeat(0.1),
            heading_effect_deg: 40.0,
        };
        let rows = rows(happened_ut, has_reference);
        let turns = measured_turns(flight);
        let before = FieldCorrection::identity();
        let corrections = [before, FieldCorrection { hard_iron_ut: change.step_ut, ..before }];
        let candidate = Candidate { time_s: change.time_s, jump: None };
        let found =
            is_change_possible(flight, &rows, &turns, &FoundChange { change, misfit: 0.0, candidate, corrections });
        assert_eq!(found, is_possible, "{name}");
    }
}

/// A change of the flown turns' readings: a factor for each axis, and an offset.
#[derive(Clone, Copy, Debug)]
struct Change {
    at_s: f64,
    factors: [f32; 3],
    offset_ut: [f32; 3],
}

const fn gain(at_s: f64, factor: f32) -> Change {
    Change { at_s, factors: [factor; 3], offset_ut: [0.0; 3] }
}

const fn iron(at_s: f64, offset_ut: [f32; 3]) -> Change {
    Change { at_s, factors: [1.0; 3], offset_ut }
}

impl Change {
    fn found(&self) -> Option<SensorChange> {
        let (flight, mut compass) = compass_of_flown_turns();
        let initial = compass.parameter_fit.correction().unwrap();
        for row in compass.rows.iter_mut().filter(|row| row.t_s >= self.at_s) {
            let (factors, offset_ut) = (Vector3::from(self.factors), Vector3::from(self.offset_ut));
            row.raw_field.ut = row.raw_field.ut.component_mul(&factors) + offset_ut;
            row.logged_field = row.raw_field;
        }
        find_changes(&compass.rows, &flight, &initial, TOTAL_UT).err()
    }

    /// Asserts the time to 1 s and the factors, unless all registers changed, to 0.01.
    fn assert_found(&self, expected: Option<Hypothesis>) {
        let found = self.found();
        assert_eq!(found.map(|change| change.hypothesis), expected, "{self:?}: {found:?}");
        if let Some(change) = found {
            let off = (change.factors - Vector3::from(self.factors).map(f64::from)).amax();
            assert!((change.time_s - self.at_s).abs() < 1.0, "{self:?}: {change:?}");
            assert!(off < 0.01 || expected == Some(Hypothesis::Registers), "{self:?}: {change:?}");
        }
    }
}

/// From a tenth to nine tenths of the flight, which is straight in its last tenth.
#[test]
fn a_changed_gain_axis_or_register_is_found_with_its_factors() {
    for (at_s, factor) in [(26.0, 1.19), (50.0, 0.84), (120.0, 1.05), (120.0, 0.7), (190.0, 1.19), (190.0, 0.95)] {
        gain(at_s, factor).assert_found(Some(Hypothesis::Gain));
    }
    for (factors, offset_ut, expected) in [
        ([1.0, -1.0, 1.0], [0.0; 3], Hypothesis::AxisGain(1)),
        ([1.0, 1.0, -1.0], [0.0; 3], Hypothesis::AxisGain(2)),
        ([1.3, 1.0, 1.0], [0.0; 3], Hypothesis::AxisGain(0)),
        ([0.4, 0.4, 0.1], [10.0, -5.0, 2.5], Hypothesis::Registers),
    ] {
        Change { at_s: 100.0, factors, offset_ut }.assert_found(Some(expected));
    }
}

/// On the single heading of the last 25 s, iron along an axis resembles a gain of that axis, and a small gain resembles
/// iron. An axis that is constant has no gain; another warning names it.
#[test]
fn what_hard_iron_or_a_stuck_axis_explains_is_no_change_of_the_sensor() {
    for change in [
        iron(120.0, [0.0; 3]),
        iron(26.0, [6.0, -4.0, 3.0]),
        iron(60.0, [1.5, 0.0, 1.5]),
        iron(120.0, [0.0, 12.0, 0.0]),
        iron(120.0, [0.0, 0.0, -8.0]),
        iron(190.0, [-20.0, 10.0, 20.0]),
        iron(214.0, [0.0, 6.0, 0.0]),
        iron(214.0, [6.0, 0.0, 0.0]),
        iron(214.0, [0.0, 0.0, 6.0]),
        gain(214.0, 1.02),
        Change { at_s: 120.0, factors: [1.0, 0.0, 1.0], offset_ut: [0.0, 12.0, 0.0] },
    ] {
        change.assert_found(None);
    }
}

#[test]
fn small_and_infinite_gains_are_no_changes() {
    let axis = Hypothesis::AxisGain(1);
    for (hypothesis, factors, is_change) in [
        (Hypothesis::Gain, [1.03; 3], true),
        (Hypothesis::Gain, [1.01; 3], false),
        (axis, [1.0, 0.9, 1.0], true),
        (axis, [1.0, 0.97, 1.0], false),
        (axis, [1.0, 1e3, 1.0], false),
        (axis, [1.0, 1e-3, 1.0], false),
        (Hypothesis::Registers, [0.8, 1.0, 1.0], true),
        (Hypothesis::Registers, [0.9, 1.1, 1.0], false),
        (Hypothesis::Registers, [0.8, 1.0, 1e3], false),
        (Hypothesis::HardIron, [1.0; 3], false),
    ] {
        assert_eq!(is_large(hypothesis, &Vector3::from(factors)), is_change, "{hypothesis:?} {factors:?}");
    }
}

/// An evaluation names a change of gain instead of hard iron, and fits the flight after it. The last ten seconds are
/// straight: iron along the field explains them as well.
#[test]
fn an_evaluation_names_a_change_of_gain_unless_it_is_on_few_headings() {
    for (at_s, is_named) in [(120.0, true), (224.0, false)] {
        let mut recording = record_turns(0.0).with_parameters(&[("COMPASS_OFS_X", 0.0)]);
        for sample in recording.samples.iter_mut().filter(|sample| sample.time_us as f64 * 1e-6 >= at_s) {
            sample.field_ut[0] = sample.field_ut[0].map(|axis| axis * 1.19);
        }
        let CompassEvaluation { causes, parameter_fit, .. } = evaluate_compass(&recording);
        assert_eq!(
            causes.sensor_change.map(|change| change.hypothesis),
            is_named.then_some(Hypothesis::Gain),
            "{at_s}"
        );
        if let Some(change) = causes.sensor_change {
            assert!((change.factors.x - 1.19).abs() < 0.01 && causes.hard_iron_changes.is_empty(), "{change:?}");
            assert_eq!(parameter_fit.last_change_s, Some(change.time_s));
        }
    }
}

#[test]
fn a_change_is_named_with_its_time() {
    let end = "at 402 s: that is the sensor, not iron; no parameters fit both";
    for (hypothesis, factors, start) in [
        (Hypothesis::Gain, [1.19; 3], "the sensor's gain changed by a factor of 1.19"),
        (Hypothesis::AxisGain(2), [1.0, 1.0, -1.1], "the sign of the sensor's z axis changed"),
        (Hypothesis::AxisGain(1), [1.0, -0.5, 1.0], "the gain of the sensor's y axis changed by a factor of -0.50"),
        (Hypothesis::AxisGain(0), [0.5, 1.0, 1.0], "the gain of the sensor's x axis changed by a factor of 0.50"),
        (Hypothesis::Registers, [0.4; 3], "the sensor's gains and offset changed, as by a reset of its registers,"),
    ] {
        let change = SensorChange { time_s: 401.8, hypothesis, factors: factors.into() };
        assert_eq!(change.to_string(), format!("{start} {end}"));
    }
}
