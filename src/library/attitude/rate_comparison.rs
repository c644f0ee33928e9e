//! Comparison of the own body rates with those of an autopilot.
//!
//! Either may be wrong; an autopilot's are those of a module without a gyro, so a contradiction means that the own ones are not used.

use nalgebra::Vector3;

use super::report::BodyRates;
use crate::time::Timestamp;
use crate::trig::{DEG, VectorLength as _};

/// Time constant of the means, seconds: a roll into a turn. The noise of rates that are computed from angles is no difference.
const MEAN_TIME_S: f32 = 2.0;

/// Latency that is no difference, seconds. It makes one of the mean rates later, and these change by the deviation of the rates from
/// them in their time constant.
const MAX_LATENCY_S: f32 = 0.05;

/// Allowed mean difference, rad/s, and relative to the autopilot's rates: offsets and scales of two gyros. Of rates clipped at 8 deg/s,
/// by MSP, ten times as many headings are bad with 1.5 deg/s, 10 % and 0.5 s.
const MAX_DIFFERENCE_RAD_S: f32 = 0.8 * DEG;
const MAX_RELATIVE_DIFFERENCE: f32 = 0.06;

/// Differing reports in a row that are a contradiction: 0.3 s at 40 Hz.
const MAX_DIFFERING_REPORTS: u8 = 12;

/// Agreeing reports in a row, in rotation, that end it: 6 s at 40 Hz. Of rates clipped at 8 deg/s, by MSP, 0.01 % of the headings are bad,
/// with 3 s 0.1 %.
const MIN_AGREEING_REPORTS: u8 = 250;

/// Slowest rotation in which an agreement counts, rad/s: a turn.
const MIN_AGREEING_RATE_RAD_S: f32 = 10.0 * DEG;

/// Difference of own and autopilot's body rates, and its consequence.
#[derive(Debug)]
pub(super) struct RateComparison {
    updated_at: Timestamp,
    mean_own_rad_s: Vector3<f32>,
    mean_autopilot_rad_s: Vector3<f32>,
    differing_reports: u8,
    agreeing_reports: u8,
    is_contradicted: bool,
    /// Number of differing reports, wraps.
    difference_count: u32,
}

impl RateComparison {
    pub const fn new() -> Self {
        Self {
            updated_at: Timestamp::START,
            mean_own_rad_s: Vector3::new(0.0, 0.0, 0.0),
            mean_autopilot_rad_s: Vector3::new(0.0, 0.0, 0.0),
            differing_reports: 0,
            agreeing_reports: 0,
            is_contradicted: false,
            difference_count: 0,
        }
    }

    /// Compares the rates of an instant; returns whether the own ones may be used there.
    pub fn compare_rates(&mut self, at: Timestamp, own: BodyRates, autopilot: BodyRates) -> bool {
        let [own_rad_s, autopilot_rad_s] = [own, autopilot].map(|rates| Vector3::from(rates.rad_s()));
        let weight = (at.us_since(self.updated_at) as f32 * 1e-6 / MEAN_TIME_S).min(1.0);
        self.updated_at = at;
        self.mean_own_rad_s += (own_rad_s - self.mean_own_rad_s) * weight;
        self.mean_autopilot_rad_s += (autopilot_rad_s - self.mean_autopilot_rad_s) * weight;
        let by_latency_rad_s = (own_rad_s - self.mean_own_rad_s).vector_length() * (MAX_LATENCY_S / MEAN_TIME_S);
        let allowed_rad_s = MAX_DIFFERENCE_RAD_S
            + MAX_RELATIVE_DIFFERENCE * self.mean_autopilot_rad_s.vector_length()
            + by_latency_rad_s;
        let differs = (self.mean_own_rad_s - self.mean_autopilot_rad_s).amax() > allowed_rad_s;
        self.count_report(differs, own.magnitude_rad_s() >= MIN_AGREEING_RATE_RAD_S);
        !differs && !self.is_contradicted
    }

    fn count_report(&mut self, differs: bool, is_rotating: bool) {
        let next = |count: u8, is_continued: bool| if is_continued { count.saturating_add(1) } else { 0 };
        self.difference_count = self.difference_count.wrapping_add(differs.into());
        self.differing_reports = next(self.differing_reports, differs);
        if differs || is_rotating {
            self.agreeing_reports = next(self.agreeing_reports, !differs);
        }
        self.is_contradicted = if self.is_contradicted {
            self.agreeing_reports < MIN_AGREEING_REPORTS
        } else {
            self.differing_reports >= MAX_DIFFERING_REPORTS
        };
    }

    /// Ends a contradiction that a long latency explains.
    pub const fn forgive_contradiction(&mut self) {
        self.is_contradicted = false;
    }

    pub const fn is_contradicted(&self) -> bool {
        self.is_contradicted
    }

    pub const fn difference_count(&self) -> u32 {
        self.difference_count
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{heading_and_roll_in_turns_deg, report_time};
    use super::*;

    /// Times, seconds, at which the own rates are refused and used again, of 100 s of rolls into turns and out of them, at 50 Hz, with an
    /// autopilot's latency, and an error of the own rates of each axis, deg/s, from 30 to 50 s.
    fn changes_s(latency_s: f32, error_deg_s: f32) -> Vec<f32> {
        let (mut comparison, mut changes) = (RateComparison::new(), Vec::new());
        let rates = |t_s: f32, error_deg_s: f32| {
            let [[heading, roll], [heading_before, roll_before]] = [t_s, t_s - 0.02].map(heading_and_roll_in_turns_deg);
            let rates_deg_s = [(roll - roll_before) * 50.0, 0.0, (heading - heading_before) * 50.0];
            BodyRates::from_rad_s(rates_deg_s.map(|rate| (rate + error_deg_s).to_radians())).unwrap()
        };
        for i in 0..5000_u16 {
            let t_s = 1.0 + f32::from(i) * 0.02;
            let error_deg_s = if (30.0..50.0).contains(&t_s) { error_deg_s } else { 0.0 };
            let was_contradicted = comparison.is_contradicted();
            comparison.compare_rates(report_time(i), rates(t_s, error_deg_s), rates(t_s - latency_s, 0.0));
            if comparison.is_contradicted() != was_contradicted {
                changes.push(t_s);
            }
        }
        changes
    }

    /// An error of 5 deg/s is refused within two seconds, and used again after a turn.
    #[test]
    fn wrong_rates_are_refused_until_they_agree_in_a_turn() {
        for (latency_s, error_deg_s) in [(0.0, 0.0), (0.05, 0.0), (0.05, 0.5)] {
            assert_eq!(changes_s(latency_s, error_deg_s), [], "{latency_s} {error_deg_s}");
        }
        let changes = changes_s(0.0, 5.0);
        let [refused_s, used_s] = changes[..] else { panic!("{changes:?}") };
        assert!((30.0..32.0).contains(&refused_s) && (50.0..80.0).contains(&used_s), "{changes:?}");
    }
}
