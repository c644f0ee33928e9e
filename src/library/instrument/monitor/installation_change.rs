//! Changes of the installation since the calibration: significance test, and when to report them.

use nalgebra::Vector3;

use crate::time::Timestamp;
use crate::trig::{DEG, VectorLength as _};

/// Change of hard iron since the calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardIronChange {
    /// Change of the corrected field, body axes, microtesla.
    pub change_ut: Vector3<f32>,
    /// Standard deviation of the least certain component, microtesla.
    pub sigma_ut: f32,
}

/// Turn of the module in its mount since the calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MountTurn {
    /// Turn about the body's z axis, clockwise from above, radians.
    pub turn_rad: f32,
    /// Standard deviation of the turn, radians.
    pub sigma_rad: f32,
}

/// Change of the installation: hard iron, or the direction of the mount.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InstallationChange {
    /// Hard iron of the airframe.
    HardIron(HardIronChange),
    /// The module turned in its mount.
    Mount(MountTurn),
}

impl InstallationChange {
    /// Whether the change differs enough from the last report for another one.
    fn differs_from(&self, reported: &Self) -> bool {
        match (self, reported) {
            (Self::HardIron(now), Self::HardIron(reported)) => {
                let least_ut = (REPORT_AGAIN_SIGMAS * now.sigma_ut).max(MIN_REPORT_AGAIN_UT);
                (now.change_ut - reported.change_ut).vector_length() > least_ut
            }
            (Self::Mount(now), Self::Mount(reported)) => {
                let least_rad = (REPORT_AGAIN_SIGMAS * now.sigma_rad).max(MIN_MOUNT_TURN_RAD);
                (now.turn_rad - reported.turn_rad).abs() > least_rad
            }
            _ => true,
        }
    }
}

/// Reports each change once, not more often than every 30 s, and at most five times a flight.
#[derive(Clone, Copy, Debug)]
pub struct ChangeReporter {
    last_reported: Option<InstallationChange>,
    last_report_at: Option<Timestamp>,
    /// Reports since the vehicle was last disarmed.
    report_count: u8,
}

/// Smallest difference from the last report that causes another one, sigmas.
const REPORT_AGAIN_SIGMAS: f32 = 3.0;
/// Smallest difference of hard iron from the last report, microtesla: the estimate itself varies by less.
const MIN_REPORT_AGAIN_UT: f32 = 2.0;

/// Shortest time between two reports, microseconds: iron that comes and goes is not reported at each turn.
const MIN_REPORT_PERIOD_US: u64 = 30_000_000;

/// Most reports in a flight.
const MAX_REPORTS_PER_FLIGHT: u8 = 5;

impl ChangeReporter {
    /// Reporter that has reported no change yet.
    pub const NOTHING_REPORTED: Self = Self { last_reported: None, last_report_at: None, report_count: 0 };

    /// Returns the present change if it is to be reported; `Some(None)` if all is as calibrated again.
    pub fn report_if_changed(
        &mut self,
        at: Timestamp,
        is_armed: bool,
        now: Option<InstallationChange>,
    ) -> Option<Option<InstallationChange>> {
        if !is_armed {
            self.report_count = 0;
        }
        if self.report_count >= MAX_REPORTS_PER_FLIGHT
            || self.last_report_at.is_some_and(|last| at.us_since(last) < MIN_REPORT_PERIOD_US)
        {
            return None;
        }
        let is_news = match (self.last_reported, now) {
            (None, None) => false,
            (Some(reported), Some(now)) => now.differs_from(&reported),
            (Some(_), None) | (None, Some(_)) => true,
        };
        is_news.then(|| {
            (self.last_reported, self.last_report_at) = (now, Some(at));
            self.report_count += 1;
            now
        })
    }
}

/// Smallest reported change of hard iron, relative to the field strength: 1 uT in 50 uT, at least 1 deg of heading.
pub(super) const MIN_HARD_IRON_CHANGE: f32 = 0.02;

/// Smallest reported turn of the mount, radians.
pub(super) const MIN_MOUNT_TURN_RAD: f32 = 3.0 * DEG;

/// Significance threshold of a change of hard iron, sigmas of the least certain component.
pub(super) const HARD_IRON_SIGNIFICANCE_SIGMAS: f32 = 5.0;

/// Significance threshold of a turn of the mount, sigmas: iron that stays is no more certain, and would be reported alone.
pub(super) const MOUNT_TURN_SIGNIFICANCE_SIGMAS: f32 = 3.0;

/// Time without a failed gate before a report, seconds, for objects that pass by.
const MIN_UNDISTURBED_S: f32 = 15.0;

const HYSTERESIS_RATIO: f32 = 0.75;

/// Whether a change of one kind is significant.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChangeDetector {
    min_size: f32,
    min_sigmas: f32,
    is_significant: bool,
    undisturbed_s: f32,
}

impl ChangeDetector {
    /// Detector of changes of `min_size` and `min_sigmas` and more.
    pub const fn new(min_size: f32, min_sigmas: f32) -> Self {
        Self { min_size, min_sigmas, is_significant: false, undisturbed_s: 0.0 }
    }

    /// Updates with the size of the estimated change and its sigma, `step_s` after the last.
    pub fn update_detection(&mut self, size: f32, sigma: f32, is_withholding: bool, step_s: f32) -> bool {
        self.undisturbed_s = if is_withholding { 0.0 } else { self.undisturbed_s + step_s };
        self.is_significant = if self.is_significant {
            // A larger sigma does not end a reported change.
            size > HYSTERESIS_RATIO * self.min_size
        } else {
            self.undisturbed_s >= MIN_UNDISTURBED_S && size > self.min_size.max(self.min_sigmas * sigma)
        };
        self.is_significant
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DETECTOR: ChangeDetector = ChangeDetector::new(MIN_HARD_IRON_CHANGE, HARD_IRON_SIGNIFICANCE_SIGMAS);

    /// Whether a change of this size and sigma is significant after `seconds` at 10 Hz.
    fn is_detected(detector: &mut ChangeDetector, [size, sigma]: [f32; 2], is_withholding: bool, seconds: u16) -> bool {
        (0..10 * seconds).fold(false, |_, _| detector.update_detection(size, sigma, is_withholding, 0.1))
    }

    fn hard_iron_change(change_ut: Vector3<f32>) -> InstallationChange {
        InstallationChange::HardIron(HardIronChange { change_ut, sigma_ut: 0.1 })
    }

    #[test]
    fn each_change_is_reported_once() {
        let change = |y_ut: f32| Some(hard_iron_change(Vector3::new(0.0, y_ut, 0.0)));
        let mut reporter = ChangeReporter::NOTHING_REPORTED;
        let mut at = Timestamp::from_us(0);
        for (now, expected) in [
            (None, None),
            (change(4.0), Some(change(4.0))),
            (change(4.1), None),
            (change(5.9), None),
            (change(2.1), None),
            (change(6.1), Some(change(6.1))),
            (change(4.2), None),
            (change(-6.0), Some(change(-6.0))),
            (None, Some(None)),
            (None, None),
        ] {
            at = at.plus_us(MIN_REPORT_PERIOD_US);
            assert_eq!(reporter.report_if_changed(at, false, now), expected, "{now:?}");
        }
    }

    #[test]
    fn a_flight_has_five_reports_at_most() {
        let mut reporter = ChangeReporter::NOTHING_REPORTED;
        let mut reports = |from: u64, is_armed: bool| {
            let change = Some(hard_iron_change(Vector3::new(5.0, 0.0, 0.0)));
            let update = |i: &u64| {
                let at = Timestamp::from_us(i * MIN_REPORT_PERIOD_US);
                reporter.report_if_changed(at, is_armed, change.filter(|_| i.is_multiple_of(2))).is_some()
            };
            (from..from + 20).filter(update).count()
        };
        assert_eq!(reports(0, true), 5);
        assert_eq!(reports(21, false), 20);
        assert_eq!(reports(41, true), 4, "and the last one on the ground");
    }

    /// Objects that pass by are no change; nor does a disturbance end a reported one.
    #[test]
    fn a_change_is_reported_after_15_undisturbed_seconds_and_until_it_vanishes() {
        let mut detector = DETECTOR;
        // Size and sigma of the change, disturbed field, seconds; whether it is significant then.
        for (change, is_withholding, seconds, expected) in [
            ([0.1, 0.01], true, 30, false),
            ([0.1, 0.01], false, 14, false),
            ([0.1, 0.01], false, 2, true),
            ([0.1, 0.2], true, 5, true),
            ([0.018, 0.01], false, 1, true),
            ([0.012, 0.01], false, 1, false),
            ([0.018, 0.001], false, 20, false),
        ] {
            assert_eq!(is_detected(&mut detector, change, is_withholding, seconds), expected, "{change:?} {seconds} s");
        }
    }
}
