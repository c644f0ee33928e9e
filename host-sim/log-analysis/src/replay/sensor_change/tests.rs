//! Unit tests of `sensor_change`.

use std::sync::LazyLock;

use nalgebra::Vector3;

use super::comparison::is_large;
use super::*;
use crate::replay::change_fit::Hypothesis;
use crate::replay::evaluation::CompassEvaluation;
use crate::replay::tests::compass_of_flown_turns;
use crate::test_flight::{evaluate_compass, record_turns};

/// Rows of the flown turns, and the correction that fits them.
static ROWS: LazyLock<(Vec<ReplayRow>, FieldCorrection)> = LazyLock::new(|| {
    let compass = compass_of_flown_turns().1;
    let correction = compass.parameter_fit.correction().unwrap();
    (compass.rows, correction)
});

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
        let (mut rows, correction) = ROWS.clone();
        for row in rows.iter_mut().filter(|row| row.t_s >= self.at_s) {
            let (factors, offset_ut) = (Vector3::from(self.factors), Vector3::from(self.offset_ut));
            row.raw_field.ut = row.raw_field.ut.component_mul(&factors) + offset_ut;
        }
        find_sensor_change(&rows, &correction, &[])
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

/// Evaluation of the flown turns with the readings of a time on multiplied by a factor.
fn evaluate_with_gain(at_s: f64, factor: f64) -> CompassEvaluation {
    let mut recording = record_turns(0.0).with_parameters(&[("COMPASS_OFS_X", 0.0)]);
    for sample in recording.samples.iter_mut().filter(|sample| sample.time_us as f64 * 1e-6 >= at_s) {
        sample.field_ut[0] = sample.field_ut[0].map(|axis| axis * factor);
    }
    evaluate_compass(&recording)
}

#[test]
fn an_evaluation_reports_a_change_of_gain_instead_of_hard_iron() {
    let compass = evaluate_with_gain(120.0, 1.19);
    let change = compass.causes.sensor_change.unwrap();
    assert!(change.hypothesis == Hypothesis::Gain && (change.factors.x - 1.19).abs() < 0.01, "{change:?}");
    assert!(compass.causes.hard_iron_changes.is_empty(), "{:?}", compass.causes.hard_iron_changes);
    assert_eq!(compass.parameter_fit.last_change_s, Some(change.time_s));
}

/// The last ten seconds are straight: iron along the field explains them as well.
#[test]
fn a_change_of_gain_on_few_headings_is_not_named() {
    assert_eq!(evaluate_with_gain(224.0, 1.19).causes.sensor_change, None);
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
