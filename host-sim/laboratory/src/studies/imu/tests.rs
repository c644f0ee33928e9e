//! Trial of an exact sensor.

use autoswing::inertial::{GRAVITY_M_S2, InertialSample};

use super::*;

/// A sensor on a table that is turned about the vertical, in a field of 50 uT: truth, and rows at 250 Hz.
fn turned_table(duration_s: u32) -> Vec<TrialRow> {
    (0..duration_s * 250)
        .map(|i| {
            let t_s = f64::from(i) / 250.0;
            let turning_s = (t_s - 3.0).max(0.0);
            let truth = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.4 + 0.2 * turning_s);
            let in_body = |reference: [f64; 3]| (truth.inverse() * Vector3::from(reference)).cast::<f32>();
            TrialRow {
                t_s,
                inertial: InertialSample {
                    rates_rad_s: in_body([0.0, 0.0, if turning_s > 0.0 { 0.2 } else { 0.0 }]),
                    specific_force_m_s2: in_body([0.0, 0.0, -f64::from(GRAVITY_M_S2)]),
                },
                field: Field::new(in_body([25.0, 0.0, 43.3])),
                truth: Some(truth),
                is_scored: t_s > 4.0,
            }
        })
        .collect()
}

#[test]
fn an_exact_sensor_has_no_errors() {
    let score = score_trial(&turned_table(20)).unwrap();
    assert!(score.inclination_deg < 0.1 && score.heading_deg.unwrap() < 0.5, "{score:?}");
    assert!(score.heading_percent > 99.0, "{score:?}");
}
