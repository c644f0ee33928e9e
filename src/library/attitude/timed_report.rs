//! Reports in the history, and the attitude between two of them and after one.

use core::f32::consts::FRAC_PI_2;

use super::euler_rates::HeadingIntegral;
use crate::attitude::euler_rates::EulerRates;
use crate::attitude::report::AttitudeReport;
use crate::frames::{RollPitch, wrap_pi};
use crate::time::Timestamp;

/// Report with its time of sending and the integrated heading rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct TimedReport {
    pub sent_at: Timestamp,
    pub report: AttitudeReport,
    pub heading_integral: HeadingIntegral,
}

/// Linear interpolation, by the shorter way in roll.
pub(super) fn interpolate(before: RollPitch, after: RollPitch, fraction: f32) -> RollPitch {
    RollPitch {
        roll_rad: wrap_pi(before.roll_rad + fraction * wrap_pi(after.roll_rad - before.roll_rad)),
        pitch_rad: before.pitch_rad + fraction * (after.pitch_rad - before.pitch_rad),
    }
}

/// Extrapolation with the body rates; without them, the attitude of the report.
pub(super) fn extrapolate_attitude(newest: &TimedReport, ahead_s: f32) -> RollPitch {
    let RollPitch { roll_rad, pitch_rad } = newest.report.attitude;
    let EulerRates { roll_rad_s, pitch_rad_s, .. } = newest.heading_integral.euler_rates.unwrap_or_default();
    RollPitch {
        roll_rad: wrap_pi(roll_rad + roll_rad_s * ahead_s),
        pitch_rad: (pitch_rad + pitch_rad_s * ahead_s).clamp(-FRAC_PI_2, FRAC_PI_2),
    }
}
