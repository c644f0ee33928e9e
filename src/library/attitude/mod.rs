//! Attitude in time: an autopilot's delayed, discrete reports and the estimates of the module's own gyro and accelerometer,
//! converted to the attitude and the turn at the instant of a measurement.

mod alignment_detector;
mod autopilot_errors;
mod carried_vertical;
mod config;
mod euler_rates;
mod gyro_frame;
mod history;
mod inertial_line;
mod latency_estimator;
mod line_selector;
mod lookup;
mod module_turn;
mod plausibility;
mod rate_comparison;
mod rate_consistency;
mod rate_estimator;
mod report;
mod report_queue;
mod sender_clock;
mod sender_selector;
mod source;
mod stale_attitude_detector;
mod tilt_comparison;
mod timed_report;
mod vector_motion;

use nalgebra::Matrix2;

use crate::frames::{Body, Field, Sensor};
use crate::inertial::InertialAttitude;
use crate::time::Timestamp;
pub(crate) use autopilot_errors::TILT_ERROR_TIME_S;
pub use autopilot_errors::{AutopilotErrors, GyroOffset, TiltError};
pub use config::AttitudeConfig;
pub(crate) use euler_rates::MIN_COS_PITCH;
pub use euler_rates::{EulerRates, GyroHeading};
use history::AttitudeHistory;
pub use history::RejectedReports;
use inertial_line::{InertialLine, MAX_OWN_GAP_US};
pub use line_selector::LineSelector;
pub use lookup::AttitudeLookup;
pub use rate_estimator::RateEstimator;
pub use report::{AttitudeReport, BodyRates};
pub use sender_selector::{Heartbeat, SenderId, SenderSelector};
pub use source::{AttitudeSource, HAS_OWN_ATTITUDE};

/// Attitude and turn at an instant, of an autopilot and of the module's own sensors.
#[derive(Debug)]
pub struct AttitudeTrack {
    config: AttitudeConfig,
    autopilot: AttitudeHistory,
    own: InertialLine,
}

impl AttitudeTrack {
    /// Track without reports and estimates.
    #[must_use]
    pub const fn new(config: AttitudeConfig) -> Self {
        Self { config, autopilot: AttitudeHistory::new(config), own: InertialLine::new(AttitudeSource::Autopilot) }
    }

    /// Sets the source; a change restarts the track.
    pub fn set_source(&mut self, source: AttitudeSource) {
        if HAS_OWN_ATTITUDE && source != self.own.source() {
            *self = Self { own: InertialLine::new(source), ..Self::new(self.config) };
        }
    }

    /// Sets the estimated angle by which the module has turned in its mount, radians, clockwise as seen from above. The own sensors turn
    /// with it, if their rates have shown a turn.
    pub fn set_mount_turn(&mut self, turn_rad: f32) {
        self.own.set_mount_turn(turn_rad);
    }

    /// Adds an estimate of the own sensors from a sample taken at `at`.
    pub fn push_inertial_attitude(&mut self, at: Timestamp, estimate: &InertialAttitude) {
        if self.own.push_estimate(at, estimate) {
            self.autopilot.forget_motion();
        }
    }

    /// Adds an autopilot's report whose last byte arrived at `arrival`; returns whether its source is used. Own body rates show
    /// a stale attitude, and a long latency, which is corrected, and carry the attitude from report to report.
    pub fn push_report(&mut self, arrival: Timestamp, report: AttitudeReport) -> bool {
        if !self.own.accept_autopilot_report() {
            return false;
        }
        let described_at = arrival.plus_signed_us(-self.config.latency_us);
        let (report, own_rates) = self.own.improved_report(described_at, report, self.autopilot.field_direction());
        if let Some(described_at) = self.autopilot.push_report(arrival, report, own_rates) {
            self.own.carry_attitude(described_at, &report);
        }
        true
    }

    /// Updates the detectors of frozen and of stale attitude with the corrected field of a reading.
    pub fn update_field(&mut self, field: Field<Body>) {
        self.autopilot.update_field(field);
    }

    /// Updates the alignment detector with the raw field of a reading.
    pub fn update_raw_field(&mut self, field: Field<Sensor>) {
        self.autopilot.update_raw_field(field);
    }

    /// Magnitude of the body rates at about an instant, rad/s; `None` without body rates.
    #[must_use]
    pub fn body_rate_rad_s(&self, at: Timestamp) -> Option<f32> {
        let rates = self.own.body_rates_at(at).or_else(|| self.autopilot.newest_body_rates())?;
        Some(rates.magnitude_rad_s())
    }

    /// Covariance of the own attitude's tilt about the level frame's x and y axes, rad^2, if it is in use.
    #[must_use]
    pub fn own_tilt_covariance(&self) -> Option<Matrix2<f32>> {
        self.own.tilt_covariance_in_use()
    }

    /// Variance of the autopilot's tilt, rad^2, if it contradicts the own one.
    #[must_use]
    pub fn excess_tilt_variance(&self) -> Option<f32> {
        self.own.excess_tilt_variance()
    }

    /// Errors of the autopilot at its last report, as the own sensors show them.
    #[must_use]
    pub fn autopilot_errors(&self) -> AutopilotErrors {
        self.own.autopilot_errors()
    }

    /// Latency of the autopilot's attitude that is corrected by own body rates, microseconds; 0 if it is short.
    #[must_use]
    pub fn corrected_latency_us(&self) -> i32 {
        self.own.corrected_latency_us()
    }

    /// Whether own body rates replace the autopilot's, which are wrong.
    #[must_use]
    pub fn are_rates_replaced(&self) -> bool {
        self.own.are_rates_replaced()
    }

    /// Counts of rejected reports.
    #[must_use]
    pub const fn rejected_reports(&self) -> RejectedReports {
        RejectedReports { own_rate_contradictions: self.own.rejected_rates(), ..self.autopilot.rejected_reports() }
    }

    /// Attitude at an instant of measurement, by a source whose attitude is older than configured by `latency_us`.
    #[must_use]
    pub fn attitude_at(&self, at: Timestamp, latency_us: i32) -> AttitudeLookup {
        let at = at.plus_signed_us(latency_us);
        match self.own.estimates_in_use() {
            Some(estimates) => estimates.attitude_at(at, &self.config),
            None => match self.autopilot.attitude_at(at) {
                lookup @ (AttitudeLookup::Interpolated(_) | AttitudeLookup::Extrapolated(_)) => {
                    self.own.carried_attitude_at(at).map_or(lookup, AttitudeLookup::Interpolated)
                }
                lookup => lookup,
            },
        }
    }

    /// Attitude at an instant of measurement, for a sample: missing while the own attitude is inaccurate.
    #[must_use]
    pub fn accurate_attitude_at(&self, at: Timestamp) -> AttitudeLookup {
        if self.own.is_accurate() { self.attitude_at(at, 0) } else { AttitudeLookup::Missing }
    }

    /// Angle rates and integrated heading at an instant, as [`attitude_at`](Self::attitude_at); own ones have no latency.
    /// `None` without an attitude or body rates.
    #[must_use]
    pub fn gyro_heading_at(&self, at: Timestamp, latency_us: i32) -> Option<GyroHeading> {
        match self.own.estimates_in_use() {
            Some(estimates) => estimates.gyro_heading_at(at, MAX_OWN_GAP_US),
            None => self.autopilot.gyro_heading_at(at.plus_signed_us(latency_us)),
        }
    }
}

#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
