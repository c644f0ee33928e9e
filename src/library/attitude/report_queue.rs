//! Recent reports of one source, and their attitude and integrated heading at an instant.

use heapless::HistoryBuf;

use super::config::AttitudeConfig;
use super::euler_rates::{GyroHeading, HeadingIntegral};
use super::lookup::AttitudeLookup;
use super::report::{AttitudeReport, BodyRates};
use super::timed_report::{TimedReport, extrapolate_attitude, interpolate};
use crate::frames::RollPitch;
use crate::time::Timestamp;

/// Reports in the order of their times.
#[derive(Debug)]
pub(super) struct ReportQueue<const N: usize> {
    reports: HistoryBuf<TimedReport, N>,
    /// Number before that of the first run of the integrated heading.
    number_before_runs: u8,
    /// Whether the next report starts a new run.
    is_run_ended: bool,
}

impl<const N: usize> ReportQueue<N> {
    /// An empty queue. Run numbers of two sources must differ.
    pub const fn new(number_before_runs: u8) -> Self {
        Self { reports: HistoryBuf::new(), number_before_runs, is_run_ended: false }
    }

    /// An empty queue, whose next report starts a new run.
    pub fn emptied(&self) -> Self {
        Self::new(self.newest().map_or(self.number_before_runs, |newest| newest.heading_integral.run_number))
    }

    pub fn newest(&self) -> Option<&TimedReport> {
        self.reports.recent()
    }

    /// Adds a report, later than the newest one. After a gap of more than `max_integrated_gap_us`, from another sender, or
    /// after the [end](Self::end_run) of a run, a new run of the integrated heading starts.
    pub fn push_report(&mut self, sent_at: Timestamp, report: AttitudeReport, max_integrated_gap_us: u32) {
        let is_run_ended = core::mem::take(&mut self.is_run_ended);
        let heading_integral = match self.newest() {
            Some(last) => {
                let gap_us = sent_at.us_since(last.sent_at);
                let is_continued =
                    gap_us <= u64::from(max_integrated_gap_us) && last.report.sender == report.sender && !is_run_ended;
                last.heading_integral.integrate_to_report(&report, is_continued.then_some(gap_us as f32 * 1e-6))
            }
            None => HeadingIntegral::before_run(self.number_before_runs).integrate_to_report(&report, None),
        };
        self.reports.write(TimedReport { sent_at, report, heading_integral });
    }

    /// Ends the run of the integrated heading, whose rates may have been wrong.
    pub const fn end_run(&mut self) {
        self.is_run_ended = true;
    }

    /// Attitude of the instant that reports sent at `sent_at` describe.
    pub fn attitude_at(&self, sent_at: Timestamp, config: &AttitudeConfig) -> AttitudeLookup {
        let Some(newest) = self.newest() else { return AttitudeLookup::Stale };
        let ahead_us = sent_at.us_since(newest.sent_at);
        if sent_at == newest.sent_at {
            AttitudeLookup::Interpolated(newest.report.attitude)
        } else if ahead_us > u64::from(config.max_extrapolation_us) {
            AttitudeLookup::Stale
        } else if ahead_us > 0 {
            AttitudeLookup::Extrapolated(extrapolate_attitude(newest, ahead_us as f32 * 1e-6))
        } else {
            self.surrounding_reports(sent_at)
                .and_then(|(before, after)| interpolate_between(before, after, sent_at, config.max_gap_us))
                .map_or(AttitudeLookup::Missing, AttitudeLookup::Interpolated)
        }
    }

    /// Angle rates and integrated heading of that instant; extrapolated by at most `max_extrapolation_us`. `None` without
    /// body rates.
    pub fn gyro_heading_at(&self, sent_at: Timestamp, max_extrapolation_us: u32) -> Option<GyroHeading> {
        let newest = self.newest()?;
        if sent_at >= newest.sent_at {
            let ahead_us = sent_at.us_since(newest.sent_at);
            return newest
                .heading_integral
                .extrapolate_integral(ahead_us as f32 * 1e-6)
                .filter(|_| ahead_us <= u64::from(max_extrapolation_us));
        }
        let (before, after) = self.surrounding_reports(sent_at)?;
        let gap_us = after.sent_at.us_since(before.sent_at) as f32;
        before.heading_integral.interpolate(
            &after.heading_integral,
            gap_us * 1e-6,
            sent_at.us_since(before.sent_at) as f32 / gap_us,
        )
    }

    /// Body rates of that instant without an integrated heading, those of the newest report at most `max_gap_us` after it; `None` without any.
    pub fn body_rates_at(&self, sent_at: Timestamp, max_gap_us: u32) -> Option<BodyRates> {
        let Some((before, after)) = self.surrounding_reports(sent_at) else {
            let newest = self.newest()?;
            let is_recent = sent_at >= newest.sent_at && sent_at.us_since(newest.sent_at) <= u64::from(max_gap_us);
            return BodyRates::from_rad_s(newest.report.body_rates.filter(|_| is_recent)?.rad_s());
        };
        let fraction = sent_at.us_since(before.sent_at) as f32 / after.sent_at.us_since(before.sent_at) as f32;
        let [from, to] = [before.report.body_rates?.rad_s(), after.report.body_rates?.rad_s()];
        BodyRates::from_rad_s(core::array::from_fn(|axis| from[axis] + fraction * (to[axis] - from[axis])))
    }

    /// Reports before and after `sent_at`; the first may be at `sent_at`.
    fn surrounding_reports(&self, sent_at: Timestamp) -> Option<(&TimedReport, &TimedReport)> {
        let mut pairs = self.reports.oldest_ordered().zip(self.reports.oldest_ordered().skip(1));
        pairs.find(|(before, after)| (before.sent_at..after.sent_at).contains(&sent_at))
    }
}

fn interpolate_between(
    before: &TimedReport,
    after: &TimedReport,
    sent_at: Timestamp,
    max_gap_us: u32,
) -> Option<RollPitch> {
    let gap_us = after.sent_at.us_since(before.sent_at);
    let fraction = sent_at.us_since(before.sent_at) as f32 / gap_us as f32;
    (sent_at == before.sent_at || gap_us <= u64::from(max_gap_us))
        .then(|| interpolate(before.report.attitude, after.report.attitude, fraction))
}
