use std::sync::LazyLock;

use super::*;
use crate::log;
use crate::log::csv::FieldUnit;
use crate::log::log_writers::{FlightRecording, encode_dataflash};
use crate::replay::evaluation::{EvaluationOptions, evaluate_flight};
use crate::test_flight::record_turns;

/// Four minutes of turns, in which the first motor answers gusts and the second has a constant output.
static TURNS: LazyLock<FlightRecording> = LazyLock::new(|| {
    let mut recording = record_turns(0.0);
    let mut random = testkit::random::Random(7);
    let mut gust = 0.0;
    for sample in &mut recording.samples {
        gust = 0.9 * gust + 0.06 * f64::from(random.normal());
        let other = 0.5 + 0.05 * f64::from(random.normal());
        sample.outputs = vec![other, 0.4 + 0.1 * other, other * other, (0.5_f64 + gust).clamp(0.0, 1.0)];
    }
    recording.parameters =
        [("COMPASS_OFS_X", 0.0), ("SERVO1_FUNCTION", 4.0)].map(|(name, value)| (name.to_owned(), value)).to_vec();
    recording
});

fn bending_load(recording: &FlightRecording) -> Option<BendingLoad> {
    let flight = log::read_flight(&mut encode_dataflash(recording).as_slice(), FieldUnit::Milligauss).unwrap();
    let options = EvaluationOptions { field_latency_s: Some(0.0), ..EvaluationOptions::DEFAULT };
    evaluate_flight(&flight, &options).compasses[0].bending_load.clone()
}

#[test]
fn the_output_that_bends_the_field_is_named_with_its_size() {
    for (function, name) in [(74.0, "motor (output 4): "), (21.0, "rudder (output 4): ")] {
        let mut recording = TURNS.clone();
        recording.parameters.push(("SERVO4_FUNCTION".to_owned(), function));
        for sample in &mut recording.samples {
            sample.field_ut[0][0] += 4.0 * sample.outputs[3];
            sample.field_ut[0][1] -= 3.0 * sample.outputs[3];
        }
        let load = bending_load(&recording).unwrap();
        assert!(load.to_string().starts_with(name), "{load}");
        assert!((load.size_ut - 5.0).abs() < 0.5 && (load.heading_effect_deg - 9.0).abs() < 1.5, "{load}");
    }
}

/// The field follows two of four motors, which are named together; an untouched flight has no load.
#[test]
fn motors_are_one_load() {
    let mut recording = TURNS.clone();
    let mut random = testkit::random::Random(7);
    for sample in &mut recording.samples {
        let common = sample.outputs[3];
        sample.outputs = (0..4).map(|_| common + 0.02 * f64::from(random.normal())).collect();
    }
    let motors = [33.0, 34.0, 35.0, 36.0].into_iter().zip(1..);
    recording.parameters = motors.map(|(motor, output)| (format!("SERVO{output}_FUNCTION"), motor)).collect();
    recording.parameters.push(("COMPASS_OFS_X".to_owned(), 0.0));
    assert_eq!(bending_load(&recording), None);
    for sample in &mut recording.samples {
        sample.field_ut[0][0] += 8.0 * (sample.outputs[0] + sample.outputs[3]);
    }
    let load = bending_load(&recording).unwrap();
    assert!(load.to_string().starts_with("motors (outputs 1, 2, 3 and 4): "), "{load}");
}
