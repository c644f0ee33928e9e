//! Attitude history: converts delayed, discrete attitude reports to the attitude at the instant of a measurement.

mod alignment_detector;
mod config;
mod euler_rates;
mod line_selector;
mod plausibility;
mod rate_consistency;
mod rate_estimator;
mod report;
mod sender_clock;
mod sender_selector;
mod stale_attitude_detector;
mod timed_report;

use crate::frames::{Body, Field, RollPitch, Sensor};
use crate::time::Timestamp;
use alignment_detector::InitialAlignmentDetector;
pub use config::AttitudeConfig;
use euler_rates::HeadingIntegral;
pub(crate) use euler_rates::MIN_COS_PITCH;
pub use euler_rates::{EulerRates, GyroHeading};
pub use line_selector::LineSelector;
use plausibility::{FreezeDetector, SpikeFilter};
use rate_consistency::RateConsistency;
pub use rate_estimator::RateEstimator;
pub use report::{AttitudeReport, BodyRates};
use sender_clock::SenderClock;
pub use sender_selector::{Heartbeat, SenderId, SenderSelector};
use stale_attitude_detector::StaleAttitudeDetector;
use timed_report::{TimedReport, extrapolate_attitude, interpolate};

/// Time after a restart of the sender within which its attitude filter aligns, microseconds: 10 s on an ArduPilot, and
/// some margin. In motion the alignment itself is not detectable.
const ALIGNMENT_AFTER_RESTART_US: u64 = 15_000_000;

/// Attitude at a requested instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AttitudeLookup {
    /// Interpolated between two reports.
    Interpolated(RollPitch),
    /// Extrapolated from the newest report with its body rates.
    Extrapolated(RollPitch),
    /// The instant is before the oldest stored report or in a gap; later reports do not change that.
    Missing,
    /// The instant is after the newest report by more than the extrapolation limit, or there is no report yet.
    Stale,
    /// The source repeats the same attitude.
    Frozen,
    /// The source's filter is still converging, or its attitude is stale.
    Contradicted,
}

/// Counts of rejected reports; each wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RejectedReports {
    /// Reports too far from the prediction of the previous report.
    pub spike_reports: u32,
    /// Repeated reports of a frozen source, and reports with a stale attitude.
    pub frozen_reports: u32,
    /// Reports with body rates that contradict the attitude; used without the rates.
    pub rate_contradictions: u32,
}

impl RejectedReports {
    /// All counts zero.
    pub const NO_REJECTIONS: Self = Self { spike_reports: 0, frozen_reports: 0, rate_contradictions: 0 };
}

/// Recent plausible reports on the module's clock.
#[derive(Debug)]
pub struct AttitudeHistory {
    config: AttitudeConfig,
    reports: heapless::Deque<TimedReport, 8>,
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
            reports: heapless::Deque::new(),
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

    /// Adds a report whose last byte arrived at `arrival`.
    pub fn push_report(&mut self, arrival: Timestamp, mut report: AttitudeReport) {
        if self.reports.back().is_some_and(|last_report| last_report.report.sender != report.sender) {
            // Clock offset and history are valid for one sender only.
            *self = Self { rejected_reports: self.rejected_reports, ..Self::new(self.config) };
        }
        if self.sender_clock.has_restarted(arrival, report.sender_clock_at_sending, &self.config) {
            *self =
                Self { rejected_reports: self.rejected_reports, restarted_at: Some(arrival), ..Self::new(self.config) };
        }
        let at = self.sender_clock.sending_time(arrival, report.sender_clock_at_sending, &self.config);
        // Drops reports out of order. A rebooted sender's are stamped by arrival, hence newer.
        if self.reports.back().is_some_and(|last_report| last_report.sent_at >= at) {
            return;
        }
        if !report.has_own_integral() && !self.is_plausible(at, &mut report) {
            return;
        }
        if self.reports.is_full() {
            self.reports.pop_front();
        }
        let integral = self.heading_integral_at(at, &report);
        // Infallible: the oldest was removed if full.
        let _ = self.reports.push_back(TimedReport { sent_at: at, report, heading_integral: integral });
    }

    /// Tests a report against the ones before and against the field; drops rates that contradict the attitude. A source
    /// that integrates its rates to its attitude cannot contradict itself.
    fn is_plausible(&mut self, at: Timestamp, report: &mut AttitudeReport) -> bool {
        self.freeze_detector.process_report(at, report);
        if self.freeze_detector.frozen_at().is_some() {
            self.rejected_reports.frozen_reports = self.rejected_reports.frozen_reports.wrapping_add(1);
            return false;
        }
        let max_gap_us = u64::from(self.config.max_gap_us);
        let last_report = self.reports.back().filter(|last_report| at.us_since(last_report.sent_at) <= max_gap_us);
        if self.spike_filter.is_spike(last_report, at, report.attitude) {
            self.rejected_reports.spike_reports = self.rejected_reports.spike_reports.wrapping_add(1);
            return false;
        }
        // Contradicting rates cannot show that the aircraft is at rest.
        let is_aligning = self.initial_alignment_detector.process_report(at, report)
            && !self.rate_consistency.is_contradicted()
            || self.restarted_at.is_some_and(|restart| at.us_since(restart) < ALIGNMENT_AFTER_RESTART_US);
        let is_stale = self.stale_attitude_detector.process_report(at, report);
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

    /// Updates the alignment detector with the raw field of a reading.
    pub fn update_raw_field(&mut self, field: Field<Sensor>) {
        self.initial_alignment_detector.update_field(field);
    }

    /// Magnitude of the newest body rates, rad/s; `None` without body rates.
    #[must_use]
    pub fn body_rate_rad_s(&self) -> Option<f32> {
        Some(self.reports.back()?.report.body_rates?.magnitude_rad_s())
    }

    /// Counts of rejected reports.
    #[must_use]
    pub const fn rejected_reports(&self) -> RejectedReports {
        self.rejected_reports
    }

    /// Attitude at an instant of measurement.
    #[must_use]
    pub fn attitude_at(&self, at: Timestamp) -> AttitudeLookup {
        let Some(newest) = self.reports.back() else { return AttitudeLookup::Stale };
        let sent_at = self.report_time_for_instant(at);
        if sent_at == newest.sent_at {
            return AttitudeLookup::Interpolated(newest.report.attitude);
        }
        let ahead_us = sent_at.us_since(newest.sent_at);
        if ahead_us > 0 {
            return match self.rejection_reason(sent_at) {
                Some(doubted) => doubted,
                None if ahead_us <= u64::from(self.config.max_extrapolation_us) => {
                    AttitudeLookup::Extrapolated(extrapolate_attitude(newest, ahead_us as f32 * 1e-6))
                }
                None => AttitudeLookup::Stale,
            };
        }
        self.surrounding_reports(sent_at)
            .and_then(|(before, after)| self.interpolate_between(before, after, sent_at))
            .map_or(AttitudeLookup::Missing, AttitudeLookup::Interpolated)
    }

    /// Angle rates and integrated heading at an instant; `None` without an attitude or body rates.
    #[must_use]
    pub fn gyro_heading_at(&self, at: Timestamp) -> Option<GyroHeading> {
        let newest = self.reports.back()?;
        let sent_at = self.report_time_for_instant(at);
        if sent_at >= newest.sent_at {
            let ahead_us = sent_at.us_since(newest.sent_at);
            let can_extrapolate =
                ahead_us <= u64::from(self.config.max_extrapolation_us) && self.rejection_reason(sent_at).is_none();
            return newest
                .heading_integral
                .extrapolate_integral(ahead_us as f32 * 1e-6)
                .filter(|_| can_extrapolate || ahead_us == 0);
        }
        let (before, after) = self.surrounding_reports(sent_at)?;
        let gap_us = after.sent_at.us_since(before.sent_at) as f32;
        before.heading_integral.interpolate(
            &after.heading_integral,
            gap_us * 1e-6,
            sent_at.us_since(before.sent_at) as f32 / gap_us,
        )
    }

    /// Time of sending of the report that describes the instant `at`.
    const fn report_time_for_instant(&self, at: Timestamp) -> Timestamp {
        at.plus_signed_us(self.config.latency_us)
    }

    fn heading_integral_at(&self, at: Timestamp, report: &AttitudeReport) -> HeadingIntegral {
        let Some(last_report) = self.reports.back() else {
            return HeadingIntegral::EMPTY.integrate_to_report(report, None);
        };
        let gap_us = at.us_since(last_report.sent_at);
        let step_s = (gap_us <= u64::from(self.config.max_integrated_gap_us)).then_some(gap_us as f32 * 1e-6);
        last_report.heading_integral.integrate_to_report(report, step_s)
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

    /// Reports before and after `sent_at`; the first may be at `sent_at`.
    fn surrounding_reports(&self, sent_at: Timestamp) -> Option<(&TimedReport, &TimedReport)> {
        let mut pairs = self.reports.iter().zip(self.reports.iter().skip(1));
        pairs.find(|(before, after)| (before.sent_at..after.sent_at).contains(&sent_at))
    }

    fn interpolate_between(&self, before: &TimedReport, after: &TimedReport, sent_at: Timestamp) -> Option<RollPitch> {
        let gap_us = after.sent_at.us_since(before.sent_at);
        let fraction = sent_at.us_since(before.sent_at) as f32 / gap_us as f32;
        (sent_at == before.sent_at || gap_us <= u64::from(self.config.max_gap_us))
            .then(|| interpolate(&before.report, &after.report, fraction))
    }
}

#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
