//! Attitude of the module's own gyro and accelerometer, beside that of an autopilot.

use nalgebra::{Matrix2, Vector3};

use super::autopilot_errors::{AutopilotErrors, GyroOffset};
use super::carried_vertical::CarriedVertical;
use super::gyro_frame::{GyroFrame, MAX_STEP_US};
use super::latency_estimator::LatencyEstimator;
use super::rate_comparison::{RateComparison, UsableRates};
use super::report::{AttitudeReport, BodyRates};
use super::report_queue::ReportQueue;
use super::sender_selector::SenderId;
use super::source::{AttitudeSource, HAS_OWN_ATTITUDE};
use super::tilt_comparison::TiltComparison;
use crate::frames::RollPitch;
use crate::inertial::InertialAttitude;
use crate::time::{Timestamp, WrappingMillis};

/// Time after the start in which an autopilot, which boots, may report for the first time, microseconds.
const AUTOPILOT_START_US: u64 = 15_000_000;

/// Longest interval between two estimates whose attitude and rates are used, microseconds: two and a half periods of 50 Hz.
pub(super) const MAX_OWN_GAP_US: u32 = 50_000;

/// Number before the runs of the own integrated heading; those of an autopilot begin with 1.
const NUMBER_BEFORE_RUNS: u8 = 128;

/// Latest estimates; a board without the sensors has none.
type EstimateQueue = ReportQueue<{ if HAS_OWN_ATTITUDE { 8 } else { 1 } }>;

/// Estimates of the attitude filter, and their use.
#[derive(Debug)]
pub(super) struct InertialLine {
    source: AttitudeSource,
    /// Estimates as reports whose time is that of their sample.
    estimates: EstimateQueue,
    tilt_covariance: Matrix2<f32>,
    rest_offset_variance: f32,
    /// Offset of the gyro whose rates the last report has.
    gyro_offset: Option<GyroOffset>,
    is_accurate: bool,
    /// Angle by which the module has turned in its mount, radians, clockwise as seen from above.
    mount_turn_rad: f32,
    has_autopilot_reported: bool,
    rate_comparison: RateComparison,
    gyro_frame: GyroFrame,
    carried_vertical: CarriedVertical,
    latency_estimator: LatencyEstimator,
    tilt_comparison: TiltComparison,
}

impl InertialLine {
    pub const fn new(source: AttitudeSource) -> Self {
        Self {
            source,
            estimates: ReportQueue::new(NUMBER_BEFORE_RUNS),
            tilt_covariance: Matrix2::new(0.0, 0.0, 0.0, 0.0),
            rest_offset_variance: 0.0,
            gyro_offset: None,
            is_accurate: false,
            mount_turn_rad: 0.0,
            has_autopilot_reported: false,
            rate_comparison: RateComparison::new(),
            gyro_frame: GyroFrame::new(),
            carried_vertical: CarriedVertical::new(),
            latency_estimator: LatencyEstimator::new(),
            tilt_comparison: TiltComparison::new(SenderId::new(0)),
        }
    }

    pub const fn source(&self) -> AttitudeSource {
        self.source
    }

    /// Adds the estimate of a sample taken at `at`, unless the source is the autopilot alone; returns whether the sensors have
    /// paused before it, as at a repair: estimates before that may be wrong.
    pub fn push_estimate(&mut self, at: Timestamp, estimate: &InertialAttitude) -> bool {
        let is_used = HAS_OWN_ATTITUDE && self.source != AttitudeSource::Autopilot;
        if !is_used || self.estimates.newest().is_some_and(|last| last.sent_at >= at) {
            return false;
        }
        let estimate =
            if self.mount_turn_rad.abs() > 0.0 { &estimate.of_turned_sensors(self.mount_turn_rad) } else { estimate };
        self.tilt_covariance = estimate.tilt_covariance;
        self.rest_offset_variance = estimate.rest_offset_variance;
        self.is_accurate = estimate.is_accurate;
        let rates_rad_s = match self.source {
            AttitudeSource::Own => Some(estimate.rates_rad_s),
            _ => estimate.measured_rates_rad_s,
        };
        let has_paused = self.estimates.newest().is_some_and(|last| at.us_since(last.sent_at) > MAX_STEP_US);
        let report = AttitudeReport {
            sender: SenderId::new(estimate.start_count.into()),
            sender_clock_at_sending: WrappingMillis::default(),
            attitude: estimate.attitude,
            body_rates: rates_rad_s
                .and_then(|rates_rad_s| BodyRates::from_rad_s(rates_rad_s.into()))
                .map(|rates| rates.with_frame_heading(estimate.frame_heading_rad)),
        };
        if self.source == AttitudeSource::Automatic {
            self.gyro_frame.push_rates(at, estimate.measured_rates_rad_s);
        }
        self.estimates.push_report(at, report, MAX_OWN_GAP_US);
        has_paused
    }

    /// Sets the angle by which the module has turned in its mount, as far as the rates have shown a turn.
    pub fn set_mount_turn(&mut self, turn_rad: f32) {
        if HAS_OWN_ATTITUDE {
            let shown_rad = self.rate_comparison.module_turn().shown_rad();
            self.mount_turn_rad = turn_rad.max(-shown_rad).min(shown_rad);
        }
    }

    /// Records a report of the autopilot; returns whether it is used.
    pub fn accept_autopilot_report(&mut self) -> bool {
        self.has_autopilot_reported = true;
        !HAS_OWN_ATTITUDE || self.source != AttitudeSource::Own
    }

    /// The estimates, if their attitude is in use. An autopilot that falls silent is not replaced: a calibration with its
    /// attitude includes the alignment of its sensors.
    pub fn estimates_in_use(&self) -> Option<&EstimateQueue> {
        let is_alone = match self.source {
            AttitudeSource::Autopilot => false,
            AttitudeSource::Own => true,
            AttitudeSource::Automatic => {
                !self.has_autopilot_reported
                    && self.estimates.newest().is_some_and(|newest| newest.sent_at.as_us() > AUTOPILOT_START_US)
            }
        };
        (HAS_OWN_ATTITUDE && is_alone).then_some(&self.estimates)
    }

    /// An autopilot's report of an instant, with the attitude advanced by a long latency, and own body rates to check its attitude. Own
    /// rates replace those of the report if they are missing, rough, late or wrong: without a fault its own do as well.
    pub fn improved_report(
        &mut self,
        at: Timestamp,
        report: AttitudeReport,
        field_direction: Option<Vector3<f32>>,
    ) -> (AttitudeReport, Option<BodyRates>) {
        if !HAS_OWN_ATTITUDE {
            return (report, None);
        }
        self.latency_estimator.push_report(&self.gyro_frame, at, report.attitude);
        let (usable, own_rates) = self.usable_rates_at(at, report.body_rates, field_direction);
        let measured = report.body_rates.filter(|rates| !rates.is_rough());
        let of_own_rates = Some(GyroOffset::of_own_rates(self.rest_offset_variance));
        let (body_rates, gyro_offset) = match (usable, measured) {
            (UsableRates::Both, Some(_)) => {
                (measured, self.rate_comparison.autopilot_offset(self.rest_offset_variance))
            }
            (UsableRates::Both | UsableRates::Own, _) => (own_rates, of_own_rates),
            (UsableRates::Autopilots, _) => (report.body_rates, None),
            (UsableRates::Neither, _) => (None, None),
        };
        self.gyro_offset = gyro_offset;
        let attitude = self.latency_estimator.advance_report(&self.gyro_frame, at, report.attitude);
        let improved = AttitudeReport { attitude, body_rates, ..report };
        (improved, own_rates)
    }

    /// Carries the vertical of an autopilot's report that is plausible, and describes this instant, and compares it with the own one.
    pub fn carry_attitude(&mut self, at: Timestamp, report: &AttitudeReport) {
        if !HAS_OWN_ATTITUDE {
            return;
        }
        self.carried_vertical.push_report(&self.gyro_frame, at, report.attitude);
        if self.tilt_comparison.sender() != report.sender {
            self.tilt_comparison = TiltComparison::new(report.sender);
        }
        if let Some(newest) = self.estimates.newest()
            && let Some(carried) = self.carried_vertical.down_in_body_at(&self.gyro_frame, newest.sent_at)
        {
            let own = newest.report.attitude.tilt_rotation().down_in_body();
            self.tilt_comparison.compare_verticals(newest.sent_at, carried, own, self.tilt_covariance.trace());
        } else {
            self.tilt_comparison.pause();
        }
    }

    fn comparable_tilts(&self) -> Option<&TiltComparison> {
        let is_comparable =
            HAS_OWN_ATTITUDE && self.estimates_in_use().is_none() && !self.rate_comparison.are_own_refused();
        is_comparable.then_some(&self.tilt_comparison)
    }

    /// Variance of the tilt, rad^2, of an autopilot whose vertical contradicts the own one.
    pub fn excess_tilt_variance(&self) -> Option<f32> {
        self.comparable_tilts().map(TiltComparison::excess_variance).filter(|variance| *variance > 0.0)
    }

    /// Errors of the autopilot at its last report.
    pub fn autopilot_errors(&self) -> AutopilotErrors {
        let tilt = self.comparable_tilts().and_then(TiltComparison::tilt_error);
        AutopilotErrors {
            tilt,
            gyro_offset: self.gyro_offset,
            unexplained_turn_rad: self.rate_comparison.module_turn().unexplained_rad(),
        }
    }

    /// Attitude of the carried vertical at an instant, unless the autopilot contradicts the own body rates.
    pub fn carried_attitude_at(&self, at: Timestamp) -> Option<RollPitch> {
        if HAS_OWN_ATTITUDE && !self.rate_comparison.are_own_refused() {
            self.carried_vertical.attitude_at(&self.gyro_frame, at)
        } else {
            None
        }
    }

    /// Which rates may be used at the instant of an autopilot's report, and the own ones, if they may. A long latency explains any
    /// difference.
    fn usable_rates_at(
        &mut self,
        at: Timestamp,
        autopilots: Option<BodyRates>,
        field_direction: Option<Vector3<f32>>,
    ) -> (UsableRates, Option<BodyRates>) {
        let Some(own) = self.estimates.body_rates_at(at, MAX_OWN_GAP_US) else {
            return (UsableRates::Autopilots, None);
        };
        let usable = if self.latency_estimator.latency_us() > 0 {
            self.rate_comparison.forgive_difference();
            UsableRates::Own
        } else if let Some(autopilots) = autopilots {
            self.rate_comparison.compare_rates(at, own, autopilots, field_direction)
        } else {
            self.rate_comparison.usable()
        };
        (usable, Some(own).filter(|_| matches!(usable, UsableRates::Both | UsableRates::Own)))
    }

    /// Latency of the autopilot's attitude that is corrected, microseconds.
    pub fn corrected_latency_us(&self) -> i32 {
        self.latency_estimator.latency_us()
    }

    /// Whether own rates replace wrong ones.
    pub fn are_rates_replaced(&self) -> bool {
        HAS_OWN_ATTITUDE && self.rate_comparison.usable() == UsableRates::Own
    }

    /// Number of reports whose body rates differ from the own ones.
    pub const fn rejected_rates(&self) -> u32 {
        self.rate_comparison.difference_count()
    }

    /// Body rates at an instant.
    pub fn body_rates_at(&self, at: Timestamp) -> Option<BodyRates> {
        if HAS_OWN_ATTITUDE && !self.rate_comparison.are_own_refused() {
            self.estimates.body_rates_at(at, MAX_OWN_GAP_US)
        } else {
            None
        }
    }

    /// Whether the attitude in use is known well enough for a sample.
    pub fn is_accurate(&self) -> bool {
        self.estimates_in_use().is_none() || self.is_accurate
    }

    /// Covariance of the tilt about the level frame's x and y axes, rad^2, if the own attitude is in use.
    pub fn tilt_covariance_in_use(&self) -> Option<Matrix2<f32>> {
        self.estimates_in_use().map(|_| self.tilt_covariance)
    }
}
