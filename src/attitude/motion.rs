//! How roll, pitch and heading change, by the body rates of a report.

use super::Report;
use crate::frames::wrap_pi;
use crate::trig;

/// Rates of the three angles, radians a second: the usual kinematics of yaw, pitch and roll.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// `phi' = p + tan(theta) (q sin(phi) + r cos(phi))`.
    pub roll_rad_s: f32,
    /// `theta' = q cos(phi) - r sin(phi)`.
    pub pitch_rad_s: f32,
    /// `psi' = (q sin(phi) + r cos(phi)) / cos(theta)`.
    pub heading_rad_s: f32,
}

/// Roll and heading mean nothing at a vertical nose; there their rates are held at those of 78.5 deg.
const MIN_COS_PITCH: f32 = 0.2;
const MAX_TAN_PITCH: f32 = 5.0;

impl Motion {
    /// By the rates and the attitude of a report; none where its source gives no rates.
    #[must_use]
    pub fn of(report: &Report) -> Option<Self> {
        if !report.has_rates() {
            return None;
        }
        let [p, q, r] = report.rates_rad_s;
        let (sin_roll, cos_roll) = trig::sin_cos(report.attitude.roll_rad);
        let (sin_pitch, cos_pitch) = trig::sin_cos(report.attitude.pitch_rad);
        let about_level = q * sin_roll + r * cos_roll;
        let tan_pitch = (sin_pitch / cos_pitch).clamp(-MAX_TAN_PITCH, MAX_TAN_PITCH);
        Some(Self {
            roll_rad_s: p + tan_pitch * about_level,
            pitch_rad_s: q * cos_roll - r * sin_roll,
            heading_rad_s: about_level / cos_pitch.max(MIN_COS_PITCH),
        })
    }

    /// Of the way from this one to a later one, the part that `fraction` says.
    pub(super) fn towards(&self, later: &Self, fraction: f32) -> Self {
        let between = |from: f32, to: f32| from + fraction * (to - from);
        Self {
            roll_rad_s: between(self.roll_rad_s, later.roll_rad_s),
            pitch_rad_s: between(self.pitch_rad_s, later.pitch_rad_s),
            heading_rad_s: between(self.heading_rad_s, later.heading_rad_s),
        }
    }
}

/// What the gyro says of an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Turning {
    /// How fast the angles change.
    pub motion: Motion,
    /// How far the heading has turned since the count began, radians, `-pi..pi`: only differences mean anything, and
    /// only between instants of the same run.
    pub turned_rad: f32,
    /// Counts the runs, wrapping: without rates for too long, or with another source, another one begins.
    pub run: u8,
}

impl Turning {
    /// What it was so much earlier, seconds, with the rates as they are.
    #[must_use]
    pub fn before(self, earlier_s: f32) -> Self {
        Self { turned_rad: wrap_pi(self.turned_rad - self.motion.heading_rad_s * earlier_s), ..self }
    }
}

/// The rates of a report and the integral of its heading's up to there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Integral {
    motion: Option<Motion>,
    turned_rad: f32,
    run: u8,
}

impl Integral {
    /// Before any report.
    pub const NOTHING: Self = Self { motion: None, turned_rad: 0.0, run: 0 };

    /// With the next report, `step_s` after the one of this integral; the mean of both rates stands for the time
    /// between them. None: too long after it, or of another source.
    pub fn next(&self, report: &Report, step_s: Option<f32>) -> Self {
        let motion = Motion::of(report);
        match (self.motion, motion, step_s) {
            (Some(before), Some(now), Some(step_s)) => {
                let mean = before.towards(&now, 0.5);
                Self { motion, turned_rad: wrap_pi(self.turned_rad + mean.heading_rad_s * step_s), run: self.run }
            }
            _ => Self { motion, turned_rad: 0.0, run: self.run.wrapping_add(1) },
        }
    }

    /// `ahead_s` later than its report, with the rates as they were.
    pub fn ahead(&self, ahead_s: f32) -> Option<Turning> {
        let motion = self.motion?;
        let turned_rad = wrap_pi(self.turned_rad + motion.heading_rad_s * ahead_s);
        Some(Turning { motion, turned_rad, run: self.run })
    }

    /// Of the time `step_s` to the next report's integral, the part that `fraction` says.
    pub fn between(&self, after: &Self, step_s: f32, fraction: f32) -> Option<Turning> {
        let (from, to) = (self.motion?, after.motion?);
        let motion = from.towards(&to, fraction);
        // The rate grows evenly, so its integral from here is that of the mean so far; counted back from the later
        // report, which is of the run that goes on.
        let rest = motion.towards(&to, 0.5).heading_rad_s * (1.0 - fraction) * step_s;
        (self.run == after.run).then(|| Turning {
            motion,
            turned_rad: wrap_pi(after.turned_rad - rest),
            run: after.run,
        })
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::PI;

    use super::super::Source;
    use super::*;
    use crate::frames::Attitude;
    use crate::time::WrappingMillis;

    fn report(roll_deg: f32, pitch_deg: f32, rates_deg_s: [f32; 3]) -> Report {
        Report {
            source: Source::default(),
            sender_time: WrappingMillis::default(),
            attitude: Attitude::from_deg(roll_deg, pitch_deg),
            rates_rad_s: rates_deg_s.map(f32::to_radians),
        }
    }

    /// What is known by hand: level, banked, and climbing steeply; the vertical nose is held.
    #[test]
    fn the_angles_change_by_the_body_rates() {
        for (roll_deg, pitch_deg, rates_deg_s, expected_deg_s) in [
            (0.0, 0.0, [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
            (90.0, 0.0, [0.0, 2.0, 3.0], [0.0, -3.0, 2.0]),
            (-90.0, 0.0, [0.0, 2.0, 3.0], [0.0, 3.0, -2.0]),
            (0.0, 60.0, [0.0, 0.0, 1.0], [1.732, 0.0, 2.0]),
            (0.0, -60.0, [0.0, 0.0, 1.0], [-1.732, 0.0, 2.0]),
            (60.0, 60.0, [0.0, 2.0, 0.0], [3.0, 1.0, 3.4641]),
            (0.0, 89.0, [0.0, 0.0, 1.0], [5.0, 0.0, 5.0]),
            (0.0, -89.0, [0.0, 0.0, 1.0], [-5.0, 0.0, 5.0]),
        ] {
            let motion = Motion::of(&report(roll_deg, pitch_deg, rates_deg_s)).unwrap();
            let found = [motion.roll_rad_s, motion.pitch_rad_s, motion.heading_rad_s].map(f32::to_degrees);
            for (found, expected) in found.into_iter().zip(expected_deg_s) {
                assert!((found - expected).abs() < 1e-3, "{roll_deg} {pitch_deg} {rates_deg_s:?}: {found} {expected}");
            }
        }
        assert_eq!(Motion::of(&report(10.0, 5.0, [0.0; 3])), None);
    }

    /// A rate that grows evenly from 10 to 30 deg/s within a second turns by 20 deg, by 7.5 - 1.25 of them half-way.
    #[test]
    fn rates_are_integrated_by_the_mean_of_two_reports() {
        let began = Integral::NOTHING.next(&report(0.0, 0.0, [0.0, 0.0, 10.0]), None);
        let ended = began.next(&report(0.0, 0.0, [0.0, 0.0, 30.0]), Some(1.0));
        let turned_deg = |turning: Option<Turning>| turning.unwrap().turned_rad.to_degrees();
        assert!((turned_deg(ended.ahead(0.0)) - 20.0).abs() < 1e-4);
        assert!((turned_deg(ended.ahead(0.1)) - 23.0).abs() < 1e-4);
        assert!((turned_deg(began.between(&ended, 1.0, 0.5)) - 7.5).abs() < 1e-4);
        assert!(turned_deg(began.between(&ended, 1.0, 0.0)).abs() < 1e-4);
        assert!((turned_deg(began.between(&ended, 1.0, 1.0)) - 20.0).abs() < 1e-4);
        let half = began.between(&ended, 1.0, 0.5).unwrap();
        assert!((half.motion.heading_rad_s.to_degrees() - 20.0).abs() < 1e-4);
        assert_eq!(half.run, ended.ahead(0.0).unwrap().run);
    }

    /// Round and round at 300 deg/s for an hour: the count stays within the circle, and rounding turns it by less than
    /// a degree, which a gyro does in a minute.
    #[test]
    fn the_count_never_grows() {
        let turning = report(0.0, 0.0, [0.0, 0.0, 300.0]);
        let mut integral = Integral::NOTHING.next(&turning, None);
        for _ in 0..50 * 3600 {
            integral = integral.next(&turning, Some(0.02));
            assert!(integral.turned_rad.abs() <= PI);
        }
        assert!(integral.turned_rad.abs().to_degrees() < 1.0, "{}", integral.turned_rad.to_degrees());
    }

    /// Without rates nothing is known of what lies between.
    #[test]
    fn what_is_not_known_begins_another_run() {
        let turning = report(0.0, 0.0, [0.0, 0.0, 30.0]);
        let first = Integral::NOTHING.next(&turning, None);
        let second = first.next(&turning, Some(0.02));
        assert_eq!(second.run, first.run);
        let later = second.next(&turning, None);
        assert_ne!(later.run, second.run);
        assert_eq!(second.between(&later, 5.0, 0.5), None);
        let silent = second.next(&report(0.0, 0.0, [0.0; 3]), Some(0.02));
        assert_eq!(silent.ahead(0.0), None);
        assert_eq!(second.between(&silent, 0.02, 0.5), None);
        let again = silent.next(&turning, Some(0.02));
        assert_ne!(again.ahead(0.0).unwrap().run, second.run);
    }
}
