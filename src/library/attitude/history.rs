//! Attitude history of an autopilot: its delayed, discrete reports, and its attitude at the instant of a measurement.

use nalgebra::Vector3;

use super::alignment_detector::InitialAlignmentDetector;
use super::config::AttitudeConfig;
use super::euler_rates::GyroHeading;
use super::lookup::AttitudeLookup;
use super::plausibility::{FreezeDetector, SpikeFilter};
use super::rate_consistency::RateConsistency;
use super::report::{AttitudeReport, BodyRates};
use super::report_queue::ReportQueue;
use super::sender_clock::SenderClock;
use super::stale_attitude_detector::StaleAttitudeDetector;
use crate::frames::{Body, Field, Sensor};
use crate::time::Timestamp;

/// Time after a restart of the sender within which its attitude filter aligns, microseconds: 10 s on an ArduPilot, and
/// some margin. In motion the alignment itself is not detectable.
const ALIGNMENT_AFTER_RESTART_US: u64 = 15_000_000;

/// Counts of rejected reports; each wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RejectedReports {
    /// Reports too far from the prediction of the previous report.
    pub spike_reports: u32,
    /// Repeated reports of a frozen source, and reports with a stale attitude.
    pub frozen_reports: u32,
    /// Reports with body rates that contradict the attitude; used without the rates.
    pub rate_contradictions: u32,
    /// Reports with body rates unlike the own ones, whichever are used.
    pub own_rate_contradictions: u32,
}

impl RejectedReports {
    /// All counts zero.
    pub const NO_REJECTIONS: Self =
        Self { spike_reports: 0, frozen_reports: 0, rate_contradictions: 0, own_rate_contradictions: 0 };
}

/// Recent plausible reports on the module's clock.
#[derive(Debug)]
pub struct AttitudeHistory {
    config: AttitudeConfig,
    reports: ReportQueue<8>,
    sender_clock: SenderClock,
    spike_filter: SpikeFilter,
    freeze_detector: FreezeDetector,
    initial_alignment_detector: InitialAlignmentDetector,
    stale_attitude_detector: StaleAttitudeDetector,
    /// Time of the first report after a restart of the sender.
    restarted_at: Option<Timestamp>,
    /// Time of the last report, while the source is aligning or its attitude is stale.
    last_contradicted_at: Option<Timestamp>,
    rate_consistency: RateConsistency,
    rejected_reports: RejectedReports,
}

impl AttitudeHistory {
    /// History without reports.
    #[must_use]
    pub const fn new(config: AttitudeConfig) -> Self {
        Self {
            config,
            reports: ReportQueue::new(0),
            sender_clock: SenderClock::new(),
            spike_filter: SpikeFilter::new(),
            freeze_detector: FreezeDetector::new(),
            initial_alignment_detector: InitialAlignmentDetector::new(),
            stale_attitude_detector: StaleAttitudeDetector::new(),
            restarted_at: None,
            last_contradicted_at: None,
            rate_consistency: RateConsistency::EMPTY,
            rejected_reports: RejectedReports::NO_REJECTIONS,
        }
    }

    /// Adds a report whose last byte arrived at `arrival`, with the rates of the module's own gyro at its instant, if they are known.
    /// Returns the instant that a plausible report describes.
    pub fn push_report(
        &mut self,
        arrival: Timestamp,
        mut report: AttitudeReport,
        own_rates: Option<BodyRates>,
    ) -> Option<Timestamp> {
        if self.reports.newest().is_some_and(|last_report| last_report.report.sender != report.sender) {
            self.forget_sender(None);
        }
        if self.sender_clock.has_restarted(arrival, report.sender_clock_at_sending, &self.config) {
            self.forget_sender(Some(arrival));
        }
        let at = self.sender_clock.sending_time(arrival, report.sender_clock_at_sending, &self.config);
        // Drops reports out of order. A rebooted sender's are stamped by arrival, hence newer.
        if self.reports.newest().is_some_and(|last_report| last_report.sent_at >= at) {
            return None;
        }
        self.is_plausible(at, &mut report, own_rates).then(|| {
            self.reports.push_report(at, report, self.config.max_integrated_gap_us);
            at.plus_signed_us(-self.config.latency_us)
        })
    }

    /// Forgets all but the counts: clock offset and reports are valid for one run of one sender.
    fn forget_sender(&mut self, restarted_at: Option<Timestamp>) {
        *self = Self {
            reports: self.reports.emptied(),
            rejected_reports: self.rejected_reports,
            restarted_at,
            ..Self::new(self.config)
        };
    }

    /// Tests a report against the ones before and against the field; drops rates that contradict the attitude.
    fn is_plausible(&mut self, at: Timestamp, report: &mut AttitudeReport, own_rates: Option<BodyRates>) -> bool {
        self.freeze_detector.process_report(at, report);
        if self.freeze_detector.frozen_at().is_some() {
            self.rejected_reports.frozen_reports = self.rejected_reports.frozen_reports.wrapping_add(1);
            return false;
        }
        let max_gap_us = u64::from(self.config.max_gap_us);
        let last_report = self.reports.newest().filter(|last_report| at.us_since(last_report.sent_at) <= max_gap_us);
        if self.spike_filter.is_spike(last_report, at, report.attitude) {
            self.rejected_reports.spike_reports = self.rejected_reports.spike_reports.wrapping_add(1);
            return false;
        }
        // Contradicting rates cannot show that the aircraft is at rest.
        let is_aligning = self.initial_alignment_detector.process_report(at, report)
            && !self.rate_consistency.is_contradicted()
            || self.restarted_at.is_some_and(|restart| at.us_since(restart) < ALIGNMENT_AFTER_RESTART_US);
        let is_stale = self.stale_attitude_detector.process_report(at, report, own_rates);
        self.last_contradicted_at = (is_aligning || is_stale).then_some(at);
        if is_stale {
            self.rejected_reports.frozen_reports = self.rejected_reports.frozen_reports.wrapping_add(1);
        }
        if is_aligning || is_stale {
            return false;
        }
        if self.rate_consistency.process_report(at, report) {
            self.rejected_reports.rate_contradictions = self.rejected_reports.rate_contradictions.wrapping_add(1);
            report.body_rates = None;
        }
        true
    }

    /// Updates the detectors of frozen and of stale attitude with the corrected field of a reading.
    pub fn update_field(&mut self, field: Field<Body>) {
        self.stale_attitude_detector.update_field(field);
        self.freeze_detector.update_field(field);
    }

    /// Forgets the motion by body rates that may have been wrong, and what it has shown.
    pub const fn forget_motion(&mut self) {
        self.stale_attitude_detector = StaleAttitudeDetector::new();
        self.reports.end_run();
    }

    /// Direction of the last corrected field in body axes.
    pub const fn field_direction(&self) -> Option<Vector3<f32>> {
        self.stale_attitude_detector.field_direction()
    }

    /// Updates the alignment detector with the raw field of a reading.
    pub fn update_raw_field(&mut self, field: Field<Sensor>) {
        self.initial_alignment_detector.update_field(field);
    }

    /// Newest body rates; `None` without body rates.
    pub fn newest_body_rates(&self) -> Option<BodyRates> {
        self.reports.newest()?.report.body_rates
    }

    /// Counts of rejected reports.
    #[must_use]
    pub const fn rejected_reports(&self) -> RejectedReports {
        self.rejected_reports
    }

    /// Attitude at an instant of measurement.
    #[must_use]
    pub fn attitude_at(&self, at: Timestamp) -> AttitudeLookup {
        let sent_at = self.report_time_for_instant(at);
        let lookup = self.reports.attitude_at(sent_at, &self.config);
        let is_after_newest = self.reports.newest().is_some_and(|newest| sent_at > newest.sent_at);
        self.rejection_reason(sent_at).filter(|_| is_after_newest).unwrap_or(lookup)
    }

    /// Angle rates and integrated heading at an instant; `None` without an attitude or body rates.
    #[must_use]
    pub fn gyro_heading_at(&self, at: Timestamp) -> Option<GyroHeading> {
        let sent_at = self.report_time_for_instant(at);
        let max_extrapolation_us =
            if self.rejection_reason(sent_at).is_none() { self.config.max_extrapolation_us } else { 0 };
        self.reports.gyro_heading_at(sent_at, max_extrapolation_us)
    }

    /// Time of sending of the report that describes the instant `at`.
    const fn report_time_for_instant(&self, at: Timestamp) -> Timestamp {
        at.plus_signed_us(self.config.latency_us)
    }

    /// Reason to reject reports sent at `sent_at`, if any.
    fn rejection_reason(&self, sent_at: Timestamp) -> Option<AttitudeLookup> {
        let max_age_us = u64::from(self.config.max_extrapolation_us);
        let is_recent =
            |event_at: Option<Timestamp>| event_at.is_some_and(|event_at| sent_at.us_since(event_at) <= max_age_us);
        if is_recent(self.freeze_detector.frozen_at()) {
            Some(AttitudeLookup::Frozen)
        } else {
            is_recent(self.last_contradicted_at).then_some(AttitudeLookup::Contradicted)
        }
    }
}
