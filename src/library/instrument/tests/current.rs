//! Motor-current compensation of readings.

use super::*;
use crate::calibration::MotorCurrentInterference;

/// 0.5 uT/A in total, calibrated at 20 +- 10 A.
const INTERFERENCE: MotorCurrentInterference = MotorCurrentInterference {
    ut_per_a: [0.3, 0.0, 0.4],
    sigma_ut_per_a: 0.01,
    mean_current_a: 20.0,
    current_sigma_a: 10.0,
};

const ATTITUDE: RollPitch = RollPitch { roll_rad: 0.2, pitch_rad: -0.1 };

fn instrument_with_interference() -> Instrument {
    instrument_with(correction_with(Calibration { motor_current: INTERFERENCE, ..test_calibration() }))
}

fn field_with_current(current_a: f32) -> Field<Sensor> {
    Field::new(sensor_field(2.0, ATTITUDE).ut + nalgebra::Vector3::from(INTERFERENCE.ut_per_a) * current_a)
}

/// Two seconds of reports and readings with a current, then 0.5 s of readings without attitude.
fn fly_with_current(instrument: &mut Instrument, current_a: f32) -> [Estimate; 2] {
    let mut last = [Estimate::EMPTY; 2];
    for us in (0..2_500_000).step_by(PERIOD_US as usize) {
        instrument.on_current(us_after_start(us), current_a);
        let has_attitude = us < 2_000_000;
        if has_attitude && us % 25_000 == 0 {
            report_attitude(instrument, us, ATTITUDE);
        }
        last[usize::from(!has_attitude)] = process_reading(instrument, us + LATENCY_US, field_with_current(current_a));
        while instrument.next_sample().is_some() {}
        instrument.update_monitor();
    }
    last
}

/// Without attitude the check of the strength uses the compensated field, too (20 uT at 40 A).
#[test]
fn at_a_reported_current_the_interference_is_compensated() {
    for current_a in [0.0, 20.0, 40.0] {
        let [with, without] = fly_with_current(&mut instrument_with_interference(), current_a);
        let body = sensor_field(2.0, ATTITUDE).ut;
        assert!((with.heading.unwrap().magnetic_rad - 2.0).abs() < 1e-3, "{current_a}: {with:?}");
        assert!((with.body_field.unwrap().ut - body).norm() < 1e-3, "{current_a}: {with:?}");
        assert!((with.compass_field.unwrap().ut - body).norm() < 0.1, "{current_a}: {with:?}");
        assert_eq!(without.heading, Err(NoHeading::AttitudeStale));
        assert!((without.compass_field.unwrap().ut - body).norm() < 0.1, "{current_a}: {without:?}");
        assert_eq!((with.current_a, without.current_a), (Some(current_a), Some(current_a)));
    }
}

/// Valid for 3 s; afterwards the mean current is assumed, and its standard deviation of 10 A adds 5 uT to the
/// uncertainty.
#[test]
fn a_reported_current_is_valid_for_three_seconds() {
    for (silent_us, current_a) in [(2_900_000, Some(40.0)), (3_100_000, None)] {
        let mut instrument = instrument_with_interference();
        instrument.on_current(us_after_start(0), 40.0);
        assert_eq!(instrument.on_silence(us_after_start(silent_us)).current_a, current_a);
    }
    // Without a report only the sigma differs, because the mean current is assumed.
    let sigma_rad = |current_a: Option<f32>| {
        let mut instrument = instrument_with_interference();
        if let Some(current_a) = current_a {
            instrument.on_current(us_after_start(0), current_a);
        }
        report_attitude(&mut instrument, 0, ATTITUDE);
        process_reading(&mut instrument, 0, field_with_current(20.0)).heading.unwrap().sigma_rad
    };
    let more_rad = (sigma_rad(None).powi(2) - sigma_rad(Some(20.0)).powi(2)).sqrt();
    assert!((more_rad - 5.0 / (50.0 * 1_f32.cos())).abs() < 0.01, "{more_rad}");
}

/// 100 A, within five times the currents of the calibration, are 40 uT more than flow at 20 A. The heading is that of the
/// mean current, with its sigma. Without a contradiction, or at another strength, too, the report is used.
#[test]
fn a_current_that_the_field_strength_contradicts_is_not_used() {
    for (reported_a, flowing_a, used_a) in
        [(100.0, 20.0, None), (25.0, 20.0, Some(25.0)), (100.0, 100.0, Some(100.0)), (100.0, 60.0, Some(100.0))]
    {
        let mut instrument = instrument_with_interference();
        report_attitude(&mut instrument, 0, ATTITUDE);
        instrument.on_current(us_after_start(0), reported_a);
        let estimate = process_reading(&mut instrument, 0, field_with_current(flowing_a));
        assert_eq!(estimate.current_a, used_a, "{reported_a} {flowing_a}");
        assert_eq!(instrument.rejection_counts().contradicted_currents, u32::from(used_a.is_none()));
        assert!(used_a.is_some() || estimate.heading.is_ok_and(|heading| (heading.magnetic_rad - 2.0).abs() < 1e-3));
    }
}

#[test]
fn samples_keep_their_current() {
    for sample_attitude in [SampleAttitude::Interpolated, SampleAttitude::Unknown] {
        let mut instrument = instrument_with(Correction { sample_attitude, ..Correction::UNCALIBRATED });
        let mut found = Vec::new();
        for us in (0..1_000_000).step_by(PERIOD_US as usize) {
            instrument.on_current(us_after_start(us), 16.0);
            report_attitude(&mut instrument, us, ATTITUDE);
            process_reading(&mut instrument, us, SAMPLE_FIELD);
            found.extend(take_samples(&mut instrument));
        }
        assert!(found.len() >= 8, "{}", found.len());
        assert!(found.iter().all(|sample| sample.current.amperes() == Some(16.0)), "{sample_attitude:?}");
    }
}
