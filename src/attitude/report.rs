//! Report of an attitude source.

use super::SenderId;
use crate::frames::Attitude;
use crate::time::WrappingMillis;
use crate::trig::sqrt;

/// Report of an attitude source, without yaw, which the module itself measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeReport {
    /// Sender of the report.
    pub sender: SenderId,
    /// Sender's clock at sending; 0 for senders without a clock.
    pub sender_time: WrappingMillis,
    /// Roll and pitch.
    pub attitude: Attitude,
    /// Body rates p, q, r, rad/s; zero if not sent.
    pub rates_rad_s: [f32; 3],
}

impl AttitudeReport {
    /// Whether the report has body rates: not all exactly zero, and within gyro range.
    pub(crate) fn has_rates(&self) -> bool {
        self.rates_rad_s.iter().any(|rate_rad_s| rate_rad_s.abs() > 0.0)
            && self.rates_rad_s.iter().all(|rate_rad_s| rate_rad_s.abs() <= MAX_BODY_RATE_RAD_S)
    }

    /// Magnitude of the body rates, rad/s; `None` without body rates.
    pub(super) fn body_rate_rad_s(&self) -> Option<f32> {
        let [p, q, r] = self.rates_rad_s;
        self.has_rates().then(|| sqrt(p * p + q * q + r * r))
    }
}

/// Full scale of autopilot gyros (2,000 deg/s) plus a margin, rad/s.
const MAX_BODY_RATE_RAD_S: f32 = 36.0;
