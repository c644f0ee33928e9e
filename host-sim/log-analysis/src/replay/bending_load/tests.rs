use std::f64::consts::TAU;
use std::sync::LazyLock;

use super::*;
use crate::log::log_writers::{FlightRecording, FlightSample};
use crate::test_flight::{evaluate_compass, record_turns};

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
    recording.with_parameters(&[("COMPASS_OFS_X", 0.0), ("SERVO1_FUNCTION", 4.0), ("SERVO4_FUNCTION", 74.0)])
});

fn loads_of(recording: &FlightRecording) -> Vec<BendingLoad> {
    evaluate_compass(recording).causes.bending_loads
}

/// Loads of the flight with a disturbance at a time, microtesla in body axes.
fn loads_with(disturbance_ut: impl Fn(f64, &FlightSample) -> [f64; 3]) -> Vec<BendingLoad> {
    let mut recording = TURNS.clone();
    for sample in &mut recording.samples {
        let added_ut = disturbance_ut(sample.time_us as f64 * 1e-6, sample);
        sample.field_ut[0] = std::array::from_fn(|axis| sample.field_ut[0][axis] + added_ut[axis]);
    }
    loads_of(&recording)
}

#[test]
fn a_load_with_a_constant_period_is_found_with_its_amplitude() {
    for period_s in [0.31, 2.0, 3.4] {
        let loads = loads_with(|t_s, _| [0.0, 3.0 * libm::sin(TAU * t_s / period_s), 0.0]);
        let [load] = loads.as_slice() else { panic!("{period_s} s: {loads:?}") };
        let BendingCause::Periodic(found_s) = load.cause else { panic!("{load}") };
        assert!((found_s / period_s - 1.0).abs() < 0.03 && (load.size_ut - 3.0).abs() < 0.6, "{period_s} s: {load}");
    }
}

#[test]
fn the_output_that_bends_the_field_is_named_with_its_size() {
    let loads = loads_with(|_, sample| [4.0 * sample.outputs[3], -3.0 * sample.outputs[3], 0.0]);
    let [load] = loads.as_slice() else { panic!("{loads:?}") };
    assert!(load.to_string().starts_with("right motor (output 4): "), "{load}");
    assert!((load.size_ut - 5.0).abs() < 0.5 && (load.heading_effect_deg - 9.0).abs() < 1.5, "{load}");
}

/// The field follows the right motors of an X frame. They are named if the motors work differently; where all do nearly the
/// same, they cannot be told apart.
#[test]
fn a_pair_of_motors_is_named_if_it_is_clearly_the_best() {
    for (difference, name) in [(0.1, "right motors (outputs 1 and 4): "), (0.004, "motors (outputs 1, 2, 3 and 4): ")] {
        let mut recording = TURNS.clone();
        let mut random = testkit::random::Random(7);
        for sample in &mut recording.samples {
            let common = sample.outputs[3];
            sample.outputs = (0..4).map(|_| common + difference * f64::from(random.normal())).collect();
            sample.field_ut[0][0] += 8.0 * (sample.outputs[0] + sample.outputs[3]);
        }
        let frame = [("FRAME_CLASS", 1.0), ("FRAME_TYPE", 1.0), ("COMPASS_OFS_X", 0.0)];
        let motors = [("SERVO1_FUNCTION", 33.0), ("SERVO2_FUNCTION", 34.0), ("SERVO3_FUNCTION", 35.0)];
        let motors = [&frame[..], &motors, &[("SERVO4_FUNCTION", 36.0)]].concat();
        let loads = loads_of(&recording.with_parameters(&motors));
        let [load] = loads.as_slice() else { panic!("{loads:?}") };
        assert!(load.to_string().starts_with(name), "{load}");
    }
}
