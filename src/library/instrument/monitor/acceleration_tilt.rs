//! Acceleration-induced tilt error of the attitude.
//!
//! Attitude sources use accelerometers, which cannot distinguish acceleration from tilt. A multirotor raises its nose
//! to brake and lowers it to accelerate, so a pitch excursion predicts a worse attitude than during the calibration,
//! before the gates detect it. Bank does not: an aeroplane banks in coordinated turns, without sideways acceleration.
//!
//! Reported pitch and integrated pitch rate must both show the excursion: a jump of the attitude alone is an error, and
//! rates projected with a wrong bank integrate to arbitrary angles. With an own attitude beside, the difference of the two measures
//! the error, of roll as well.

use crate::attitude::EulerRates;
use crate::frames::RollPitch;

/// Tilt error per pitch excursion. A multirotor that brakes by tilt and drag decelerates by about `2 g` times the
/// excursion; attitude sources err by 0.4 deg per m/s^2, which makes 0.15.
const TILT_ERROR_PER_EXCURSION: f32 = 0.15;

/// Upper limit of the tilt error, radians. Larger pitch is a steep climb, not braking; on a recorded flight with 90 deg
/// bank, a higher limit only weakened the heading measurement.
const MAX_TILT_ERROR_RAD: f32 = 0.015;

/// Time constant of the pitch average, seconds; a sustained climb is not an excursion.
const AVERAGING_TIME_S: f32 = 20.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct AccelerationTilt {
    last_pitch_rad: Option<f32>,
    /// Excursion by reported pitch and by integrated pitch rate, radians.
    reported_pitch_excursion_rad: f32,
    integrated_pitch_excursion_rad: f32,
    /// Variance by the difference from the own attitude, rad^2.
    measured_variance_rad2: f32,
}

impl AccelerationTilt {
    pub const INITIAL: Self = Self {
        last_pitch_rad: None,
        reported_pitch_excursion_rad: 0.0,
        integrated_pitch_excursion_rad: 0.0,
        measured_variance_rad2: 0.0,
    };

    pub fn update_tilt(
        &mut self,
        RollPitch { pitch_rad, .. }: RollPitch,
        euler_rates: &EulerRates,
        measured_variance_rad2: f32,
        step_s: f32,
    ) {
        self.measured_variance_rad2 = measured_variance_rad2;
        let last_rad = self.last_pitch_rad.replace(pitch_rad).unwrap_or(pitch_rad);
        let decay = (1.0 - step_s / AVERAGING_TIME_S).max(0.0);
        self.reported_pitch_excursion_rad = decay * (self.reported_pitch_excursion_rad + pitch_rad - last_rad);
        self.integrated_pitch_excursion_rad =
            decay * (self.integrated_pitch_excursion_rad + euler_rates.pitch_rad_s * step_s);
    }

    /// Variance of the tilt error about each horizontal axis, square radians.
    pub fn variance_rad2(&self) -> f32 {
        let off_rad = (TILT_ERROR_PER_EXCURSION
            * self.reported_pitch_excursion_rad.abs().min(self.integrated_pitch_excursion_rad.abs()))
        .min(MAX_TILT_ERROR_RAD);
        off_rad * off_rad + self.measured_variance_rad2
    }
}
