//! Rates of roll, pitch and heading, from body rates.

use crate::attitude::report::{AttitudeReport, BodyRates};
use crate::frames::{RollPitch, wrap_pi};
use crate::trig;

/// Euler-angle rates, rad/s (ZYX kinematics).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EulerRates {
    /// Roll rate `phi' = p + tan(theta) (q sin(phi) + r cos(phi))`.
    pub roll_rad_s: f32,
    /// Pitch rate `theta' = q cos(phi) - r sin(phi)`.
    pub pitch_rad_s: f32,
    /// Heading rate `psi' = (q sin(phi) + r cos(phi)) / cos(theta)`.
    pub heading_rad_s: f32,
}

/// Lower limit of the cosine of pitch, near the singularity at vertical pitch; reached at 78.5 deg.
pub(crate) const MIN_COS_PITCH: f32 = 0.2;
const MAX_TAN_PITCH: f32 = 5.0;

impl EulerRates {
    /// Angle rates of a report; `None` without body rates.
    #[must_use]
    pub fn from_report(report: &AttitudeReport) -> Option<Self> {
        report.body_rates.map(|rates| Self::from_body_rates(rates, report.attitude))
    }

    /// Angle rates of body rates at an attitude.
    #[must_use]
    pub fn from_body_rates(rates: BodyRates, attitude: RollPitch) -> Self {
        let [p, q, r] = rates.rad_s();
        let (sin_roll, cos_roll) = trig::sin_cos(attitude.roll_rad);
        let (sin_pitch, cos_pitch) = trig::sin_cos(attitude.pitch_rad);
        let about_level = q * sin_roll + r * cos_roll;
        let tan_pitch = (sin_pitch / cos_pitch).clamp(-MAX_TAN_PITCH, MAX_TAN_PITCH);
        Self {
            roll_rad_s: p + tan_pitch * about_level,
            pitch_rad_s: q * cos_roll - r * sin_roll,
            heading_rad_s: about_level / cos_pitch.max(MIN_COS_PITCH),
        }
    }

    /// Body rates p, q, r at an attitude, rad/s: the inverse of [`from_body_rates`](Self::from_body_rates).
    #[must_use]
    pub fn to_body_rates(self, attitude: RollPitch) -> [f32; 3] {
        let (sin_roll, cos_roll) = trig::sin_cos(attitude.roll_rad);
        let (sin_pitch, cos_pitch) = trig::sin_cos(attitude.pitch_rad);
        let about_level = self.heading_rad_s * cos_pitch;
        [
            self.roll_rad_s - self.heading_rad_s * sin_pitch,
            self.pitch_rad_s * cos_roll + about_level * sin_roll,
            about_level * cos_roll - self.pitch_rad_s * sin_roll,
        ]
    }

    /// Linear interpolation; `fraction` 0 is `self`, 1 is `later`.
    pub(super) fn interpolate(&self, later: &Self, fraction: f32) -> Self {
        let interpolate_rate = |from: f32, to: f32| from + fraction * (to - from);
        Self {
            roll_rad_s: interpolate_rate(self.roll_rad_s, later.roll_rad_s),
            pitch_rad_s: interpolate_rate(self.pitch_rad_s, later.pitch_rad_s),
            heading_rad_s: interpolate_rate(self.heading_rad_s, later.heading_rad_s),
        }
    }
}

/// Angle rates and integrated heading at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GyroHeading {
    /// Rates of the Euler angles.
    pub euler_rates: EulerRates,
    /// Integrated heading rate, radians, `-pi..pi`. Only differences within one `run_number` are meaningful.
    pub relative_heading_rad: f32,
    /// Number of the integration run, wraps. A long gap, missing rates or another source starts a new run.
    pub run_number: u8,
}

impl GyroHeading {
    /// State `seconds` later, at constant rates.
    #[must_use]
    pub fn extrapolated(self, seconds: f32) -> Self {
        Self {
            relative_heading_rad: wrap_pi(self.relative_heading_rad + self.euler_rates.heading_rad_s * seconds),
            ..self
        }
    }
}

/// Integrated heading rate up to a report.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeadingIntegral {
    /// Angle rates of the report; `None` without body rates.
    pub euler_rates: Option<EulerRates>,
    relative_heading_rad: f32,
    pub run_number: u8,
    /// Heading in the source's own frame, if it reports it.
    frame_heading_rad: Option<f32>,
}

impl HeadingIntegral {
    /// Before the first report, whose run has the number after this one.
    pub const fn before_run(run_number: u8) -> Self {
        Self { euler_rates: None, relative_heading_rad: 0.0, run_number, frame_heading_rad: None }
    }

    /// Integrates to the next report, `step_s` later: by the source's own integral, or with the mean of both rates. `None`
    /// starts a new run.
    pub fn integrate_to_report(&self, report: &AttitudeReport, step_s: Option<f32>) -> Self {
        let euler_rates = EulerRates::from_report(report);
        let frame_heading_rad = report.body_rates.and_then(|rates| rates.frame_heading_rad());
        match (self.euler_rates, euler_rates, step_s) {
            (Some(before), Some(now), Some(step_s)) => {
                let turned_rad = match (self.frame_heading_rad, frame_heading_rad) {
                    (Some(before_rad), Some(now_rad)) => now_rad - before_rad,
                    _ => before.interpolate(&now, 0.5).heading_rad_s * step_s,
                };
                let relative_heading_rad = wrap_pi(self.relative_heading_rad + turned_rad);
                Self { euler_rates, relative_heading_rad, run_number: self.run_number, frame_heading_rad }
            }
            _ => Self {
                euler_rates,
                relative_heading_rad: 0.0,
                run_number: self.run_number.wrapping_add(1),
                frame_heading_rad,
            },
        }
    }

    /// State `seconds` after the report, at constant rates.
    pub fn extrapolate_integral(&self, seconds: f32) -> Option<GyroHeading> {
        let rates = self.euler_rates?;
        let turned_rad = wrap_pi(self.relative_heading_rad + rates.heading_rad_s * seconds);
        Some(GyroHeading { euler_rates: rates, relative_heading_rad: turned_rad, run_number: self.run_number })
    }

    /// State between two reports `step_s` apart, at `fraction` of the interval.
    pub fn interpolate(&self, later: &Self, step_s: f32, fraction: f32) -> Option<GyroHeading> {
        let (earlier_rates, later_rates) = (self.euler_rates?, later.euler_rates?);
        let euler_rates = earlier_rates.interpolate(&later_rates, fraction);
        let remaining_turn_rad = if later.frame_heading_rad.is_some() {
            wrap_pi(later.relative_heading_rad - self.relative_heading_rad) * (1.0 - fraction)
        } else {
            // Integral of a linearly changing rate, backward from the later report, whose run continues.
            euler_rates.interpolate(&later_rates, 0.5).heading_rad_s * (1.0 - fraction) * step_s
        };
        (self.run_number == later.run_number).then(|| GyroHeading {
            euler_rates,
            relative_heading_rad: wrap_pi(later.relative_heading_rad - remaining_turn_rad),
            run_number: later.run_number,
        })
    }
}

#[cfg(test)]
mod tests {

    use super::super::testing;
    use super::*;

    fn report(roll_deg: f32, pitch_deg: f32, rates_deg_s: [f32; 3]) -> AttitudeReport {
        testing::report(RollPitch::from_deg(roll_deg, pitch_deg), rates_deg_s.map(f32::to_radians))
    }

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
            let motion = EulerRates::from_report(&report(roll_deg, pitch_deg, rates_deg_s)).unwrap();
            let found = [motion.roll_rad_s, motion.pitch_rad_s, motion.heading_rad_s].map(f32::to_degrees);
            for (found, expected) in found.into_iter().zip(expected_deg_s) {
                assert!((found - expected).abs() < 1e-3, "{roll_deg} {pitch_deg} {rates_deg_s:?}: {found} {expected}");
            }
        }
        assert_eq!(EulerRates::from_report(&report(10.0, 5.0, [0.0; 3])), None);
    }

    /// Heading rate from 10 to 30 deg/s in 1 s: a turn of 20 deg, 7.5 deg after 0.5 s.
    #[test]
    fn rates_are_integrated_by_the_trapezoidal_rule() {
        let began = HeadingIntegral::before_run(0).integrate_to_report(&report(0.0, 0.0, [0.0, 0.0, 10.0]), None);
        let ended = began.integrate_to_report(&report(0.0, 0.0, [0.0, 0.0, 30.0]), Some(1.0));
        let turned_deg = |turning: Option<GyroHeading>| turning.unwrap().relative_heading_rad.to_degrees();
        assert!((turned_deg(ended.extrapolate_integral(0.0)) - 20.0).abs() < 1e-4);
        assert!((turned_deg(ended.extrapolate_integral(0.1)) - 23.0).abs() < 1e-4);
        assert!((turned_deg(began.interpolate(&ended, 1.0, 0.5)) - 7.5).abs() < 1e-4);
        assert!(turned_deg(began.interpolate(&ended, 1.0, 0.0)).abs() < 1e-4);
        assert!((turned_deg(began.interpolate(&ended, 1.0, 1.0)) - 20.0).abs() < 1e-4);
        let half = began.interpolate(&ended, 1.0, 0.5).unwrap();
        assert!((half.euler_rates.heading_rad_s.to_degrees() - 20.0).abs() < 1e-4);
        assert_eq!(half.run_number, ended.extrapolate_integral(0.0).unwrap().run_number);
    }

    /// A turn of 0.5 rad/s, 0.2 s before: 0.1 rad less, across south.
    #[test]
    fn a_gyro_heading_is_turned_back_to_an_earlier_time() {
        let euler_rates = EulerRates { heading_rad_s: 0.5, ..EulerRates::default() };
        let now = GyroHeading { euler_rates, relative_heading_rad: -3.1, run_number: 7 };
        let before = now.extrapolated(-0.2);
        assert!((before.relative_heading_rad - (core::f32::consts::TAU - 3.2)).abs() < 1e-5, "{before:?}");
        assert_eq!((before.euler_rates, before.run_number), (euler_rates, 7));
    }
}
