//! The attitude filter on vehicles without an autopilot, with chips of the data sheet's errors.

use autoswing::inertial::{AttitudeFilter, InertialSample, InertialSensorErrors, SensorOffsets};
use autoswing::time::Timestamp;

use super::*;
use crate::devices::lsm6dsl::MeasurementErrors;
use crate::world::inertial_truth;
use crate::world::rotation::Euler;

/// Errors of tilt after the first minute, RMS in degrees, and the largest in sigmas.
fn tilt_errors(vehicle_kind: VehicleKind, speed_is_known: bool) -> (f64, f64) {
    let errors_of_chip = InertialSensorErrors {
        gyro_offset_rad_s: 0.052,
        gyro_scale: 0.01,
        gyro_cross_axis: 0.01,
        accelerometer_offset_m_s2: 0.1,
    };
    let (mut squares, mut count, mut largest) = (0.0, 0.0, 0_f64);
    for seed in 0..10 {
        let mut aircraft = vehicle(vehicle_kind, Weather::default(), seed);
        // An accelerometer whose offset was aligned.
        let mut chip = MeasurementErrors::new(seed, 0.25);
        let mut filter = AttitudeFilter::new(errors_of_chip, SensorOffsets::UNKNOWN);
        let mut before = *aircraft.true_state();
        for leg in legs().into_iter().chain(legs()).chain(legs()) {
            for after in fly_leg(&mut aircraft, leg) {
                let measured = chip.measure(&inertial_truth(&before, &after, 25.0), 200.0);
                before = after;
                let sample = InertialSample {
                    rates_rad_s: measured.rates_rad_s.cast(),
                    specific_force_m_s2: measured.specific_force_m_s2.cast(),
                };
                let speed_m_s = libm::hypot(after.north_m_s, after.east_m_s) as f32;
                filter.update(Timestamp::from_us(after.time_us), &sample, speed_is_known.then_some(speed_m_s));
                if let Some(found) = filter.attitude().filter(|_| after.time_us > 60_000_000) {
                    let found_angles = Euler {
                        roll_rad: f64::from(found.attitude.roll_rad),
                        pitch_rad: f64::from(found.attitude.pitch_rad),
                        heading_rad: 0.0,
                    };
                    let down = |euler: &Euler| euler.body_from_earth().column(2).into_owned();
                    let error_rad = (down(&found_angles) - down(&after.euler_angles())).norm();
                    squares += square(error_rad.to_degrees());
                    count += 1.0;
                    largest = largest.max(error_rad / f64::from(found.tilt_sigma_rad()));
                }
            }
        }
    }
    ((squares / count).sqrt(), largest)
}

/// With their speed, which GNSS or a log knows, rover and boat are within the 1 deg that a heading of 1 deg at an
/// inclination of 65 deg allows on its own. A copter does without.
#[test]
fn vehicles_without_an_autopilot_know_their_tilt() {
    for (kind, speed_is_known, limit_deg) in
        [(VehicleKind::Rover, true, 0.4), (VehicleKind::Boat, true, 1.0), (VehicleKind::Copter, false, 1.7)]
    {
        let (rms_deg, largest_sigmas) = tilt_errors(kind, speed_is_known);
        assert!(rms_deg < limit_deg && largest_sigmas < 4.5, "{kind:?}: {rms_deg} deg, {largest_sigmas} sigmas");
    }
}
