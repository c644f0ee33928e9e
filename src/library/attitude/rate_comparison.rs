//! Comparison of the own body rates with those of an autopilot.
//!
//! Either may be wrong. The field, which moves in body axes by the true rates, shows which, if its motion depends on the difference. With
//! stuck or clipped own rates, by MSP, a tenth as many headings are bad as without the field. Where it supports the own rates they replace
//! the autopilot's: with the wrong sign by MAVLink 0.01 % of a plane's headings are bad, and before a quarter was empty. Where it supports
//! neither for a third of a second, the autopilot's are used, as by a module without a gyro.

use nalgebra::Vector3;

use super::autopilot_errors::GyroOffset;
use super::module_turn::ModuleTurn;
use super::report::BodyRates;
use super::vector_motion::{MOTION_MEMORY_S, VectorMotion};
use crate::time::Timestamp;
use crate::trig::{DEG, VectorLength as _, square};

/// Time constant of the means, seconds: that of the field's motion. The noise of rates that are computed from angles is no difference.
const MEAN_TIME_S: f32 = MOTION_MEMORY_S;

/// Latency that is no difference, seconds. It makes one of the mean rates later, and these change by the deviation of the rates from
/// them in their time constant.
const MAX_LATENCY_S: f32 = 0.05;

/// Allowed mean difference, rad/s, and relative to the autopilot's rates: offsets and scales of two gyros. Of rates clipped at 8 deg/s,
/// by MSP, ten times as many headings are bad with 1.5 deg/s, 10 % and 0.5 s. After a difference half of it is allowed until they agree.
const MAX_DIFFERENCE_RAD_S: f32 = 0.8 * DEG;
const MAX_RELATIVE_DIFFERENCE: f32 = 0.06;
const AGREEING_SHARE: f32 = 0.5;

/// Reports in a row without support for the own rates after which these are not used: 0.3 s at 40 Hz.
const MAX_UNSUPPORTED_REPORTS: u8 = 12;

/// Agreeing reports in a row, in rotation, after which both are used again: 6 s at 40 Hz. Of rates clipped at 8 deg/s, by MSP, 0.01 % of
/// the headings are bad, with 3 s 0.1 %.
const MIN_AGREEING_REPORTS: u8 = 250;

/// Weight of a differing report whose own rates the field supports, in agreeing reports: own rates are used again after 0.3 s.
const SUPPORTED_REPORT_WEIGHT: u8 = 20;

/// Slowest rotation in which an agreement counts, rad/s: a turn.
const MIN_AGREEING_RATE_RAD_S: f32 = 10.0 * DEG;

/// Smallest error of the field's motion as one gyro's rates predict it, radians (2 deg), and largest ratio of the other's error to it,
/// for the field to support the other.
const MIN_PREDICTION_ERROR_RAD: f32 = 0.035;
const MAX_ERROR_RATIO: f32 = 0.5;

/// Fastest mean rotation in which the difference of the rates is one of offsets, rad/s, and its error relative to that rotation, by the
/// scales. In turns an error of 10 % of either gyro would be an offset.
const MAX_OFFSET_RATE_RAD_S: f32 = 6.0 * DEG;
const SCALE_DIFFERENCE: f32 = 0.03;

/// Which rates may be used.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum UsableRates {
    Both,
    Autopilots,
    Own,
    /// They differ, and it is not yet known which are wrong.
    Neither,
}

/// What a report and the field show.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Verdict {
    Agreement,
    /// The rates differ, and the field supports neither.
    Difference,
    OwnSupported,
    AutopilotsSupported,
    /// They differ about the z axis only: the module turns in its mount, or the aircraft, and the autopilot's are wrong.
    ModuleTurns,
}

/// Difference of own and autopilot's body rates, and its consequence. Own rates replace rough ones in any case.
#[derive(Debug)]
pub(super) struct RateComparison {
    updated_at: Timestamp,
    /// Motion of the field, by own rates and by the autopilot's.
    field_motion: [VectorMotion; 2],
    mean_own_rad_s: Vector3<f32>,
    mean_autopilot_rad_s: Vector3<f32>,
    module_turn: ModuleTurn,
    unsupported_reports: u8,
    agreeing_reports: u8,
    usable: UsableRates,
    /// Number of reports without agreement, wraps.
    difference_count: u32,
}

impl RateComparison {
    pub const fn new() -> Self {
        Self {
            updated_at: Timestamp::START,
            field_motion: [VectorMotion::new(), VectorMotion::new()],
            mean_own_rad_s: Vector3::new(0.0, 0.0, 0.0),
            mean_autopilot_rad_s: Vector3::new(0.0, 0.0, 0.0),
            module_turn: ModuleTurn::new(),
            unsupported_reports: 0,
            agreeing_reports: 0,
            usable: UsableRates::Both,
            difference_count: 0,
        }
    }

    /// Compares the rates of an instant, at which the field has this direction in body axes; returns which may be used there.
    pub fn compare_rates(
        &mut self,
        at: Timestamp,
        own: BodyRates,
        autopilot: BodyRates,
        field_direction: Option<Vector3<f32>>,
    ) -> UsableRates {
        let [own_rad_s, autopilot_rad_s] = [own, autopilot].map(|rates| Vector3::from(rates.rad_s()));
        let step_s = (at.us_since(self.updated_at) as f32 * 1e-6).min(MEAN_TIME_S);
        let weight = step_s / MEAN_TIME_S;
        if let Some(direction) = field_direction {
            for (motion, rates_rad_s) in self.field_motion.iter_mut().zip([own_rad_s, autopilot_rad_s]) {
                motion.accumulate_motion(direction, rates_rad_s * step_s, step_s);
            }
        }
        self.updated_at = at;
        self.mean_own_rad_s += (own_rad_s - self.mean_own_rad_s) * weight;
        self.mean_autopilot_rad_s += (autopilot_rad_s - self.mean_autopilot_rad_s) * weight;
        let by_gyros_rad_s = self.by_gyros_rad_s();
        self.module_turn.accumulate_difference((own_rad_s - autopilot_rad_s).z * step_s, by_gyros_rad_s * step_s);
        let verdict = self.verdict(own_rad_s, autopilot.is_rough());
        if verdict == Verdict::Agreement {
            let mean_difference_rad_s = (self.mean_own_rad_s - self.mean_autopilot_rad_s).z;
            self.module_turn.restart(mean_difference_rad_s * MEAN_TIME_S, by_gyros_rad_s * MEAN_TIME_S);
        }
        self.module_turn.set_turning(verdict == Verdict::ModuleTurns);
        self.count_report(verdict, own.magnitude_rad_s() >= MIN_AGREEING_RATE_RAD_S);
        self.usable = self.usable_after(verdict, autopilot.is_rough());
        match (self.usable, verdict) {
            (UsableRates::Both, Verdict::Difference) if !autopilot.is_rough() => UsableRates::Neither,
            (_, Verdict::Difference | Verdict::AutopilotsSupported | Verdict::ModuleTurns) => UsableRates::Autopilots,
            (usable, _) => usable,
        }
    }

    /// Difference by the errors of two gyros, rad/s.
    fn by_gyros_rad_s(&self) -> f32 {
        MAX_DIFFERENCE_RAD_S + MAX_RELATIVE_DIFFERENCE * self.mean_autopilot_rad_s.vector_length()
    }

    fn verdict(&self, own_rad_s: Vector3<f32>, are_autopilots_rough: bool) -> Verdict {
        let [own_error_rad, autopilot_error_rad] = self.field_motion.each_ref().map(VectorMotion::error_rad);
        let by_latency_rad_s = (own_rad_s - self.mean_own_rad_s).vector_length() * (MAX_LATENCY_S / MEAN_TIME_S);
        let were_autopilots_wrong = self.usable == UsableRates::Own;
        let allowed_share = if were_autopilots_wrong { AGREEING_SHARE } else { 1.0 };
        let difference_rad_s = self.mean_own_rad_s - self.mean_autopilot_rad_s;
        let allowed_rad_s = allowed_share * (self.by_gyros_rad_s() + by_latency_rad_s);
        if is_clearly_smaller(autopilot_error_rad, own_error_rad) {
            Verdict::AutopilotsSupported
        } else if difference_rad_s.amax() <= allowed_rad_s {
            Verdict::Agreement
        } else if were_autopilots_wrong {
            Verdict::OwnSupported
        } else if difference_rad_s.xy().amax() <= allowed_rad_s
            && self.module_turn.is_possible()
            && !are_autopilots_rough
        {
            Verdict::ModuleTurns
        } else if is_clearly_smaller(own_error_rad, autopilot_error_rad) {
            Verdict::OwnSupported
        } else {
            Verdict::Difference
        }
    }

    fn count_report(&mut self, verdict: Verdict, is_rotating: bool) {
        let agreeing_weight = match (verdict, self.usable) {
            (Verdict::Agreement, _) => 1,
            (Verdict::OwnSupported, UsableRates::Autopilots) => SUPPORTED_REPORT_WEIGHT,
            _ => 0,
        };
        if agreeing_weight == 0 {
            self.agreeing_reports = 0;
        } else if is_rotating {
            self.agreeing_reports = self.agreeing_reports.saturating_add(agreeing_weight);
        }
        if verdict != Verdict::Agreement {
            self.difference_count = self.difference_count.wrapping_add(1);
        }
        if matches!(verdict, Verdict::Difference | Verdict::AutopilotsSupported) {
            self.unsupported_reports = self.unsupported_reports.saturating_add(1);
        } else {
            self.unsupported_reports = 0;
        }
    }

    fn usable_after(&self, verdict: Verdict, are_autopilots_rough: bool) -> UsableRates {
        match self.usable {
            UsableRates::Both if verdict == Verdict::OwnSupported && !are_autopilots_rough => UsableRates::Own,
            UsableRates::Both | UsableRates::Own if self.unsupported_reports >= MAX_UNSUPPORTED_REPORTS => {
                UsableRates::Autopilots
            }
            UsableRates::Own | UsableRates::Autopilots if self.agreeing_reports >= MIN_AGREEING_REPORTS => {
                UsableRates::Both
            }
            usable => usable,
        }
    }

    /// Offset of the autopilot's gyro against the own one, whose offset has this variance, (rad/s)^2; `None` in a turn.
    pub fn autopilot_offset(&self, own_variance: f32) -> Option<GyroOffset> {
        let rate_rad_s = self.mean_own_rad_s.vector_length();
        (rate_rad_s < MAX_OFFSET_RATE_RAD_S).then(|| GyroOffset {
            rad_s: self.mean_autopilot_rad_s - self.mean_own_rad_s,
            variance: own_variance + square(SCALE_DIFFERENCE * rate_rad_s),
        })
    }

    pub const fn module_turn(&self) -> &ModuleTurn {
        &self.module_turn
    }

    /// Uses both rates again, whose difference a long latency explains.
    pub const fn forgive_difference(&mut self) {
        self.usable = UsableRates::Both;
    }

    /// Which rates may be used, after the reports so far; never `Neither`.
    pub const fn usable(&self) -> UsableRates {
        self.usable
    }

    pub fn are_own_refused(&self) -> bool {
        self.usable == UsableRates::Autopilots
    }

    pub const fn difference_count(&self) -> u32 {
        self.difference_count
    }
}

/// Whether rates predict the field's motion, and others do not, with these errors of the motion.
fn is_clearly_smaller(error_rad: f32, other_error_rad: f32) -> bool {
    other_error_rad > MIN_PREDICTION_ERROR_RAD && error_rad < MAX_ERROR_RATIO * other_error_rad
}

#[cfg(test)]
mod tests {
    use super::super::testing::{heading_and_roll_in_turns_deg, report_time};
    use super::*;
    use crate::frames::{Field, RollPitch};

    /// Times, seconds, after which other rates are usable, and number of differing reports, of 100 s of rolls into turns and out of them,
    /// at 50 Hz, with an autopilot's latency, and errors of the own and of its rates of each axis, deg/s, from 30 to 50 s. A field is
    /// known or not.
    fn changes(latency_s: f32, errors_deg_s: [f32; 2], is_field_known: bool) -> (Vec<(f32, UsableRates)>, u32) {
        let (mut comparison, mut changes) = (RateComparison::new(), Vec::new());
        let rates = |t_s: f32, error_deg_s: f32| {
            let [[heading, roll], [heading_before, roll_before]] = [t_s, t_s - 0.02].map(heading_and_roll_in_turns_deg);
            let (heading_rate, (sin_roll, cos_roll)) = ((heading - heading_before) * 50.0, roll.to_radians().sin_cos());
            let rates_deg_s = [(roll - roll_before) * 50.0, heading_rate * sin_roll, heading_rate * cos_roll];
            BodyRates::from_rad_s(rates_deg_s.map(|rate| (rate + error_deg_s).to_radians())).unwrap()
        };
        for i in 0..5000_u16 {
            let t_s = 1.0 + f32::from(i) * 0.02;
            let [own_error_deg_s, autopilot_error_deg_s] =
                if (30.0..50.0).contains(&t_s) { errors_deg_s } else { [0.0; 2] };
            let [heading_deg, roll_deg] = heading_and_roll_in_turns_deg(t_s);
            let level = Field::new(Field::earth_field(1.0, 1.1, heading_deg.to_radians()).ut);
            let field = is_field_known.then(|| RollPitch::from_deg(roll_deg, 0.0).to_body_frame(level).ut);
            let usable_before = comparison.usable();
            let [own, autopilot] = [rates(t_s, own_error_deg_s), rates(t_s - latency_s, autopilot_error_deg_s)];
            comparison.compare_rates(report_time(i), own, autopilot, field);
            if comparison.usable() != usable_before {
                changes.push((t_s, comparison.usable()));
            }
        }
        (changes, comparison.difference_count())
    }

    /// An error of 5 deg/s ends the use of the wrong rates within two seconds, until a turn after it. Without a field it ends that of the
    /// own ones, whichever are wrong.
    #[test]
    fn wrong_rates_are_not_used_until_they_agree_in_a_turn() {
        use UsableRates::{Autopilots, Both, Own};
        for (errors_deg_s, is_field_known, usable) in [
            ([5.0, 0.0], false, Autopilots),
            ([0.0, 5.0], false, Autopilots),
            ([5.0, 0.0], true, Autopilots),
            ([0.0, 5.0], true, Own),
        ] {
            let (changes, difference_count) = changes(0.0, errors_deg_s, is_field_known);
            let [(from_s, found), (until_s, Both)] = changes[..] else { panic!("{errors_deg_s:?}: {changes:?}") };
            assert!(found == usable && (30.0..32.0).contains(&from_s), "{errors_deg_s:?}: {changes:?}");
            assert!((50.0..80.0).contains(&until_s), "{errors_deg_s:?}: {changes:?}");
            assert!(difference_count > 800, "{errors_deg_s:?}: {difference_count}");
        }
    }

    #[test]
    fn both_rates_are_used_while_they_differ_by_latency_and_offsets() {
        for is_field_known in [false, true] {
            for (latency_s, own_error_deg_s) in [(0.0, 0.0), (0.05, 0.0), (0.05, 0.5)] {
                let (changes, _) = changes(latency_s, [own_error_deg_s, 0.0], is_field_known);
                assert_eq!(changes, [], "{latency_s} {own_error_deg_s}");
            }
        }
    }

    /// In a turn scales differ, too.
    #[test]
    fn a_difference_of_offsets_shows_outside_turns() {
        let offset_deg_s = [0.1, -0.3, 0.2];
        for (turn_deg_s, is_shown) in [(0.0, true), (3.0, true), (9.0, false)] {
            let mut comparison = RateComparison::new();
            for i in 0..1000_u16 {
                let [own, autopilot] = [[0.0; 3], offset_deg_s].map(|[p, q, r]: [f32; 3]| {
                    BodyRates::from_rad_s([p + 0.01, q, r + turn_deg_s].map(f32::to_radians)).unwrap()
                });
                comparison.compare_rates(report_time(i), own, autopilot, None);
            }
            let found = comparison.autopilot_offset(1e-8);
            assert_eq!(found.is_some(), is_shown, "{turn_deg_s}");
            if let Some(GyroOffset { rad_s, variance }) = found {
                let error = rad_s - Vector3::from(offset_deg_s) * DEG;
                assert!(error.amax() < 0.01 * DEG && variance >= 1e-8, "{turn_deg_s}: {rad_s} {variance}");
            }
        }
    }

    /// Largest unexplained turn, degrees, and rates usable at the end of 60 s in which the aircraft flies straight, the module turns by
    /// this angle within 1 s after 20 s, and the autopilot's gyro has this offset about the z axis from then on, deg/s.
    fn straight_flight(turn_deg: f32, offset_deg_s: f32) -> (f32, UsableRates) {
        let (mut comparison, mut largest_deg) = (RateComparison::new(), 0.0_f32);
        for i in 0..3000_u16 {
            let t_s = f32::from(i) * 0.02;
            let turned_deg = (t_s - 20.0).clamp(0.0, 1.0) * turn_deg;
            let own_rate_deg_s = if (20.0..21.0).contains(&t_s) { turn_deg } else { 0.0 };
            let autopilots_rate_deg_s = if t_s < 20.0 { 0.0 } else { offset_deg_s };
            let [own, autopilots] = [own_rate_deg_s, autopilots_rate_deg_s]
                .map(|rate_deg_s| BodyRates::from_rad_s([1e-4, 0.0, rate_deg_s.to_radians()]).unwrap());
            let field = Field::earth_field(1.0, 1.1, turned_deg.to_radians()).ut;
            comparison.compare_rates(report_time(i), own, autopilots, Some(field));
            largest_deg = largest_deg.max(comparison.module_turn().unexplained_rad().to_degrees());
        }
        (largest_deg, comparison.usable())
    }

    /// A module that turns in its mount is no error of the autopilot's gyro; an offset about the same axis is no turn of the module. An
    /// offset of 1.5 deg/s moves this field too little to show whose it is.
    #[test]
    fn a_turn_in_the_mount_is_not_a_gyros_error() {
        for (turn_deg, offset_deg_s, unexplained_deg, usable) in [
            (10.0, 0.0, 4.0..=10.0, UsableRates::Both),
            (-20.0, 0.0, 10.0..=20.0, UsableRates::Both),
            (0.0, 1.5, 0.0..=1.0, UsableRates::Autopilots),
            (0.0, -5.0, 0.0..=30.0, UsableRates::Own),
        ] {
            let found = straight_flight(turn_deg, offset_deg_s);
            assert!(unexplained_deg.contains(&found.0) && found.1 == usable, "{turn_deg} {offset_deg_s}: {found:?}");
        }
    }
}
