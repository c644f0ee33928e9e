//! Attitude of a table that has gyro and accelerometer instead.

use autoswing::inertial::{AttitudeFilter, InertialSample, InertialSensorErrors, SensorOffsets};
use autoswing::time::Timestamp;

use super::super::time_series::Series;

/// Longest interval of the accelerometer that is interpolated, seconds: that of the filter.
const MAX_GAP_S: f64 = 0.1;

/// Largest standard deviation of an attitude that is used, radians: 5 deg, at which the field's inclination scatters as
/// much as by a bad compass.
const MAX_TILT_SIGMA_RAD: f32 = 0.087;

/// Time, roll and pitch of each row of the gyro (rad/s) with a force of the accelerometer (m/s^2), body axes.
pub(super) fn inertial_attitudes<'a>(
    rates: &'a Series<3>,
    forces: &'a Series<3>,
) -> impl Iterator<Item = (f64, [f32; 2])> + 'a {
    let start_s = rates.rows().first().map_or(0.0, |row| row.t_s);
    let mut filter = AttitudeFilter::new(InertialSensorErrors::CALIBRATED, SensorOffsets::UNKNOWN);
    rates.rows().iter().filter_map(move |row| {
        let force = forces.interpolate_or_hold(row.t_s, MAX_GAP_S)?;
        let at = Timestamp::from_us(((row.t_s - start_s) * 1e6) as u64);
        let sample = InertialSample { rates_rad_s: row.row_values.into(), specific_force_m_s2: force.into() };
        filter.update(at, &sample, None);
        let estimate = filter.attitude().filter(|estimate| estimate.tilt_sigma_rad() < MAX_TILT_SIGMA_RAD)?;
        Some((row.t_s, [estimate.attitude.roll_rad, estimate.attitude.pitch_rad]))
    })
}
