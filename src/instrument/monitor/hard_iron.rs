//! Significance test for a change of hard iron since the calibration.

use nalgebra::Vector3;

use crate::time::Timestamp;
use crate::trig::Length as _;

/// Change of hard iron since the calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardIronChange {
    /// Change of the corrected field, body axes, microtesla.
    pub change_ut: Vector3<f32>,
    /// Standard deviation of the least certain component, microtesla.
    pub sigma_ut: f32,
}

/// Reports each change of hard iron once, and not more often than every 30 s.
#[derive(Clone, Copy, Debug)]
pub struct HardIronChangeReporter {
    last_reported: Option<HardIronChange>,
    last_report_at: Option<Timestamp>,
}

/// Relative difference from the last report that causes another one.
const REPORT_AGAIN_RATIO: f32 = 0.5;

/// Smallest such difference, microtesla: less is the estimate's own motion.
const MIN_REPORT_AGAIN_UT: f32 = 2.0;

/// Shortest time between two reports, microseconds: iron that comes and goes is not reported at each turn.
const MIN_REPORT_PERIOD_US: u64 = 30_000_000;

impl HardIronChangeReporter {
    /// Nothing reported yet.
    pub const NONE: Self = Self { last_reported: None, last_report_at: None };

    /// Returns the present change if it is to be reported; `Some(None)` if hard iron is back as calibrated.
    pub fn update(&mut self, at: Timestamp, now: Option<HardIronChange>) -> Option<Option<HardIronChange>> {
        if self.last_report_at.is_some_and(|last| at.us_since(last) < MIN_REPORT_PERIOD_US) {
            return None;
        }
        let is_news = match (self.last_reported, now) {
            (None, None) => false,
            (Some(reported), Some(now)) => {
                let least_ut = (REPORT_AGAIN_RATIO * reported.change_ut.length()).max(MIN_REPORT_AGAIN_UT);
                (now.change_ut - reported.change_ut).length() > least_ut
            }
            (Some(_), None) | (None, Some(_)) => true,
        };
        is_news.then(|| {
            (self.last_reported, self.last_report_at) = (now, Some(at));
            now
        })
    }
}

/// Smallest reported change, relative to the field strength: 1 uT in 50 uT, at most 3 deg of heading.
const MIN_REPORTED_CHANGE: f32 = 0.02;

/// Significance: sigmas of the least certain component.
const SIGNIFICANCE_SIGMAS: f32 = 4.0;

/// Time without a failed gate before a report, seconds, for objects that pass by.
const MIN_UNDISTURBED_S: f32 = 15.0;

const HYSTERESIS_RATIO: f32 = 0.75;

#[derive(Clone, Copy, Debug)]
pub(super) struct HardIronDetector {
    is_reported: bool,
    undisturbed_s: f32,
}

impl HardIronDetector {
    pub const NEW: Self = Self { is_reported: false, undisturbed_s: 0.0 };

    /// Updates with the estimated change (relative to the field strength) and the largest sigma of its components,
    /// `step_s` after the last; returns whether the change is significant.
    pub fn update(&mut self, change: &Vector3<f32>, sigma: f32, is_silent: bool, step_s: f32) -> bool {
        self.undisturbed_s = if is_silent { 0.0 } else { self.undisturbed_s + step_s };
        let part = change.length() / MIN_REPORTED_CHANGE.max(SIGNIFICANCE_SIGMAS * sigma);
        if self.is_reported {
            // A larger sigma does not end a reported change.
            self.is_reported = change.length() > HYSTERESIS_RATIO * MIN_REPORTED_CHANGE;
        } else {
            self.is_reported = self.undisturbed_s >= MIN_UNDISTURBED_S && part > 1.0;
        }
        self.is_reported
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn repeat_update(moved: &mut HardIronDetector, change: f32, sigma: f32, is_silent: bool, tenths: usize) -> bool {
        (0..tenths).map(|_| moved.update(&Vector3::new(0.0, -change, 0.0), sigma, is_silent, 0.1)).last().unwrap()
    }

    #[test]
    fn a_large_and_certain_hard_iron_change_is_reported() {
        for (change, sigma, expected) in
            [(0.021, 0.005, true), (0.019, 0.001, false), (0.1, 0.024, true), (0.1, 0.026, false)]
        {
            assert_eq!(
                repeat_update(&mut HardIronDetector::NEW.clone(), change, sigma, false, 200),
                expected,
                "{change} {sigma}"
            );
        }
    }

    #[test]
    fn each_change_is_reported_once() {
        let change = |y_ut: f32| Some(HardIronChange { change_ut: Vector3::new(0.0, y_ut, 0.0), sigma_ut: 0.1 });
        let mut reporter = HardIronChangeReporter::NONE;
        let mut at = Timestamp::from_us(0);
        for (now, expected) in [
            (None, None),
            (change(4.0), Some(change(4.0))),
            (change(4.1), None),
            (change(5.9), None),
            (change(2.1), None),
            (change(6.1), Some(change(6.1))),
            (change(3.2), None),
            (change(-6.0), Some(change(-6.0))),
            (None, Some(None)),
            (None, None),
        ] {
            at = at.plus_us(MIN_REPORT_PERIOD_US);
            assert_eq!(reporter.update(at, now), expected, "{now:?}");
        }
    }

    /// Iron that comes and goes within 30 s causes one text, and the next one has what holds then.
    #[test]
    fn reports_are_30_seconds_apart() {
        let change = Some(HardIronChange { change_ut: Vector3::new(5.0, 0.0, 0.0), sigma_ut: 0.1 });
        let mut reporter = HardIronChangeReporter::NONE;
        let mut reports = (0..700_u32).filter_map(|tenth| {
            let now = if tenth / 10 % 2 == 0 { change } else { None };
            reporter.update(Timestamp::from_us(u64::from(tenth) * 100_000), now).map(|report| (tenth, report))
        });
        assert_eq!(reports.by_ref().collect::<Vec<_>>(), [(0, change), (310, None), (620, change)]);
    }

    #[test]
    fn a_hard_iron_change_is_reported_after_15_calm_seconds() {
        let mut moved = HardIronDetector::NEW;
        assert!(!repeat_update(&mut moved, 0.1, 0.01, true, 300));
        assert!(!repeat_update(&mut moved, 0.1, 0.01, false, 149));
        assert!(repeat_update(&mut moved, 0.1, 0.01, false, 2));
    }

    #[test]
    fn a_reported_hard_iron_change_holds_until_it_vanishes() {
        let mut moved = HardIronDetector::NEW;
        assert!(repeat_update(&mut moved, 0.1, 0.01, false, 200));
        assert!(repeat_update(&mut moved, 0.1, 0.2, true, 50));
        assert!(repeat_update(&mut moved, 0.016, 0.01, false, 1));
        assert!(!repeat_update(&mut moved, 0.014, 0.01, false, 1));
        assert!(!repeat_update(&mut moved, 0.016, 0.001, false, 200));
    }
}
