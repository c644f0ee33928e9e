//! Report of an attitude source.

use crate::attitude::sender_selector::SenderId;
use crate::frames::RollPitch;
use crate::time::WrappingMillis;
use crate::trig::sqrt;

/// Report of an attitude source, without yaw, which the module itself measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeReport {
    /// Sender of the report.
    pub sender: SenderId,
    /// Sender's clock at sending; 0 for senders without a clock.
    pub sender_clock_at_sending: WrappingMillis,
    /// Roll and pitch.
    pub attitude: RollPitch,
    /// Body rates; `None` from a sender without a gyro.
    pub body_rates: Option<BodyRates>,
}

/// Body rates p, q, r of a gyro, within its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyRates {
    rad_s: [f32; 3],
    /// Heading in the frame in which the source integrates these rates, if it reports it.
    frame_heading_rad: Option<f32>,
    is_rough: bool,
}

impl BodyRates {
    /// Body rates p, q, r, rad/s; `None` if one is no number or beyond the range of gyros, or if all are exactly zero,
    /// as in messages of senders without a gyro.
    #[must_use]
    pub fn from_rad_s(rad_s: [f32; 3]) -> Option<Self> {
        let is_measured = rad_s.iter().any(|rate_rad_s| rate_rad_s.abs() > 0.0)
            && rad_s.iter().all(|rate_rad_s| rate_rad_s.abs() <= MAX_BODY_RATE_RAD_S);
        is_measured.then_some(Self { rad_s, frame_heading_rad: None, is_rough: false })
    }

    /// Body rates p, q, r, rad/s.
    #[must_use]
    pub const fn rad_s(&self) -> [f32; 3] {
        self.rad_s
    }

    /// The rates of a source that integrates them at its own rate: the heading in its frame, radians, whose north is
    /// arbitrary. Its differences are more accurate than an integral of the reported rates, and valid at any pitch.
    #[must_use]
    pub const fn with_frame_heading(self, frame_heading_rad: f32) -> Self {
        Self { frame_heading_rad: Some(frame_heading_rad), ..self }
    }

    /// Rates that any own gyro betters: in whole degrees, or from the differences of angles
    /// ([`RateEstimator`](super::RateEstimator)).
    #[must_use]
    pub const fn as_rough(self) -> Self {
        Self { is_rough: true, ..self }
    }

    pub(super) const fn is_rough(&self) -> bool {
        self.is_rough
    }

    pub(super) const fn frame_heading_rad(&self) -> Option<f32> {
        self.frame_heading_rad
    }

    /// Magnitude of the body rates, rad/s.
    pub(super) fn magnitude_rad_s(&self) -> f32 {
        let [p, q, r] = self.rad_s;
        sqrt(p * p + q * q + r * r)
    }
}

/// Full scale of autopilot gyros (2,000 deg/s) plus a margin, rad/s.
const MAX_BODY_RATE_RAD_S: f32 = 36.0;
